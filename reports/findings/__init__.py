"""Findings: conclusions from the stored rows, in sentences; one finding per file.

Each module defines the id of its chapter in sections.toml (`SECTION`) and `find(results) -> Iterator[Table]`.
`TAKES` names stored series that need no figure because the table covers them. New modules are found automatically.
"""
