"""Identify nonlinear mechanical structures from what an accelerometer recorded in operation."""
