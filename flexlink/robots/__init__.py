"""Robots of others: a tree of rigid links read from a URDF, the path through it that becomes an arm, and links that bend."""
