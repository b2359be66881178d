"""Parts of all HTML pages: chapters, tables, pictures, verdicts, and their style."""
