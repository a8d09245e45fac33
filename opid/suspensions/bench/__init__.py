"""Identification of a law on a test bench, from measured force and motion."""
