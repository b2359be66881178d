"""Import third-party robots: read the links in a URDF file, select the parts of an arm, and make links flexible."""
