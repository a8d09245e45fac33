"""What is below the suspension of a gear: unsprung mass, tyre, and the road that it rolls on."""
