"""What any of our HTML pages is made of."""
