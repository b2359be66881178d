"""A page about a run: the parts that any report is made of, and the report on a user's own scene."""
