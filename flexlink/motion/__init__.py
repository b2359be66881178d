"""In time: a `Scene` and its drives, runs one by one or many side by side, and their `Trajectory`."""
