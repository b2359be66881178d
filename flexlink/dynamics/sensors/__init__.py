"""Sensors on an arm: their ideal signals, and the readings of their instruments."""
