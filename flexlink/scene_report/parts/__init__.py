"""One chapter per file: `made(study)` returns its `Part`; `building.CHAPTERS` has titles and order.

A chapter that does not apply to the scene is None. If a chapter raises an error, the page shows it instead.
"""
