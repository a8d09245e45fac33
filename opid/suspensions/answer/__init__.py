"""What may be told: the numbers, their intervals and what limits them, what is refused and why, and what to doubt."""
