"""Where bodies and hinges are, and how a tree of them branches."""
