"""A virtual test on disk: its logs, the study that names them, and its truth.json, written and read."""
