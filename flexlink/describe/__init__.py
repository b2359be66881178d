"""Descriptions written by the user, checked: arm, loads, motions and run settings, as plain data."""
