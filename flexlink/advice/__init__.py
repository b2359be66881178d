"""The smallest model that a scene needs: which links bend, how, and with which steps, for an error that is allowed."""
