"""Judges that share no algorithm with the library: rooted trees, closed forms, and chains in 40 and 50 digits."""
