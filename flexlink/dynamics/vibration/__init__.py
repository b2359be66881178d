"""Small motion about a state: natural frequencies, poles, the largest stable step."""
