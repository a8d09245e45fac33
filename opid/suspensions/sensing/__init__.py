"""Virtual sensors: forces, travel and motion of an identified body along a record, with bands."""
