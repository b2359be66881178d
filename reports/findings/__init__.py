"""What follows from the rows, in sentences; one finding a file.

A module here says which chapter it belongs to (`SECTION`, an id of sections.toml) and has
`find(results) -> Iterator[Table]`; `TAKES` names stored series that need no figure beside its words. That is all:
it is found by being here.
"""
