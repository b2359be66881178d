"""The report of a validation study, made from its stored results alone."""
