"""Fit of the model to the runs: start values, least squares, noise, and faults of the sensors.

`search.py` holds the complete search from start values to a fitted model.
"""
