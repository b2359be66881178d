"""Arms and runs at extreme parameters, and their outcomes in flexlink and in other engines."""
