"""Judges that share no algorithm with the library: rooted trees, and a planar chain's Lagrangian in 50 digits."""
