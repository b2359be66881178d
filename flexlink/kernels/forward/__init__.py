"""Forward dynamics in O(n), and solutions of (M + A) x = r with a diagonal or block-diagonal A."""
