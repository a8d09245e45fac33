"""A gear or a whole aircraft that taxies over a rough runway, and the records of its loggers."""
