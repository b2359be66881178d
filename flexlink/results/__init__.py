"""A finished run, and what it is asked afterwards."""
