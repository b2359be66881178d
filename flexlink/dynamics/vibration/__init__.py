"""Small motion about a state: frequencies, poles, the largest stable step."""
