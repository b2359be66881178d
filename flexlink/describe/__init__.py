"""What the user writes down, checked: arm, loads, motions, run settings, as plain data."""
