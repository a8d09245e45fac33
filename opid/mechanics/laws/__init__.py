"""Restoring-force laws as values: what a term can be, terms that remember, a user's own kinds, and their sum."""
