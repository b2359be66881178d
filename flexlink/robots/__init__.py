"""Import third-party robots: the tree of rigid links in a URDF, the parts that become an arm, and flexible links."""
