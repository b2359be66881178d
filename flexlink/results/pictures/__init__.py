"""Pictures that move: an arm along a run, true to scale or with its deflections magnified, as GIF, video or page."""
