"""The report of masses, suspensions and laws, of a test bench, and of many flights."""
