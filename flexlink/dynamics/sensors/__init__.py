"""What sensors on an arm see, and what their instruments make of it."""
