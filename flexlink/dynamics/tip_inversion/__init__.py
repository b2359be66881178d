"""Motion and torques of an arm whose tip follows a given path: bounded inverse dynamics of a flexible arm."""
