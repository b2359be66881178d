"""From a scene to its motion in time."""
