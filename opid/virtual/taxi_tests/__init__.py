"""A gear or a whole aircraft that taxies over a rough runway, and what the loggers make of it."""
