"""The site: handwritten pages, and reference pages generated from types, parsers, data files and stored results."""
