"""One chapter a file: `ID`, `TITLE`, `SHORT` (in the navigation), and `made(study)`, which returns its `Part`.

None stands for a chapter that the scene has nothing to say in. What cannot be computed is left to raise: the page then
says so in the chapter's place. `report.PARTS` has their order.
"""
