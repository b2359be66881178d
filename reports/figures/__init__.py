"""One figure per file.

Each module defines the id of its chapter in sections.toml (`SECTION`), the stored series that it draws (`TAKES`, their
`what`; all others are drawn as plain curves), and `draw(results) -> Iterator[Picture]`, which yields nothing without
data. New modules are found automatically.
"""
