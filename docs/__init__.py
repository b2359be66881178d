"""The site: pages by hand, and reference pages generated from types, parsers, data files and stored results."""
