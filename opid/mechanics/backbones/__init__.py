"""Backbones of nonlinear normal modes: by harmonic balance, by arclength, and as forcing at one point finds them."""
