"""Forces on a chain besides inertia and gravity: springs and friction of single joints, and force elements.

A force element is a record with constants and scratch, plus one function for each line of the table in `elements`.
"""
