"""A law from a test bench: force and motion are measured."""
