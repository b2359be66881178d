"""Report of a validation study, made only from its stored results."""
