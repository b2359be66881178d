"""Robots of others: a URDF's tree of rigid links, what of it becomes an arm, whole or in part, and links that bend."""
