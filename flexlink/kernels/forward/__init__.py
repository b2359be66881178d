"""Forward dynamics, O(n), and the inverse of M plus a diagonal."""
