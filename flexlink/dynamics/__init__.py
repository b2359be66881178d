"""The terms of the equation of motion at a state, checked, and what rounding explains of them."""
