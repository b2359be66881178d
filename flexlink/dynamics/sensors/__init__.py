"""Sensors on an arm: ideal signals, and readings of their instruments."""
