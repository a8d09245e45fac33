"""The model moved until it explains the runs: start values, least squares, noise, and faults of the sensors.

`search.py` is the whole way from start values to a fitted model.
"""
