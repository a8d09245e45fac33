"""Linear modes: shapes and their files, modal coordinates, frequency responses, and modes that shift with the level."""
