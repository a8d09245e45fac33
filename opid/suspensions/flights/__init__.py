"""Comparison of many flights of one aircraft."""
