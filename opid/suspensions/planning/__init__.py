"""What runs that nobody has made yet will determine: information, expected intervals, and the cheapest plan."""
