"""Feedforward with which the tip of a scene follows a move: path, refusals, driven scene, and its run."""
