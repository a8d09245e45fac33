"""Figures of nonlinear modes: tests, fits, shapes, decays, and the truth tests."""
