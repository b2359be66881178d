"""Random scenes for advice, and independent references to check it."""
