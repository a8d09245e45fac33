"""What is told of masses, suspensions and laws, of a test bench, and of many flights."""
