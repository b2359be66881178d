"""What becomes of arms and conditions far from the usual, in flexlink and in other engines."""
