"""Many flights of one machine, compared."""
