"""Runge-Kutta methods and lumping rules, as data files with what follows from their numbers."""
