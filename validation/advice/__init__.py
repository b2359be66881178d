"""What advice is judged by: random arms in situations that it is asked about, and the truth about their tips."""
