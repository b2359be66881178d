"""Small motion about a state: natural frequencies, poles, and the largest stable step."""
