"""Films of an arm during a run, true to scale or with magnified deflections, as GIF, video or page."""
