"""Robots of others: a URDF's tree of rigid links, the path through it that becomes an arm, and links that bend."""
