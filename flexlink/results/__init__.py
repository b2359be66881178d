"""Results of a run: samples, derived quantities, files, tables, and plots."""
