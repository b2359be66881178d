"""The report on a user's scene."""
