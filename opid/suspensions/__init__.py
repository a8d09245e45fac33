"""Runs under known loads to parameters: one estimator for one suspension or several; beside it, in folders of their own,
the chain of Iwaniec & Uhl (2007), laws from a test bench, and the comparison of many flights.
"""
