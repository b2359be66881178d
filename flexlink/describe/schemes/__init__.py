"""Runge-Kutta methods and lumping rules as data files, with the quantities derived from them."""
