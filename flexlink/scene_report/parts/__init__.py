"""One chapter per file: `made(study)` returns its `Part`; `building.CHAPTERS` defines titles and order.

`made` returns None if the chapter does not apply to the scene. If it raises an error, the page shows the error instead.
"""
