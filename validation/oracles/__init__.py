"""Independent references that share no algorithm with the library: rooted trees, closed forms, 50-digit chains."""
