"""Random scenes for advice, and the references that judge it."""
