"""Runge-Kutta steps, fixed and adaptive, explicit and implicit."""
