"""Bayesian updating and class selection from nonlinear normal modes (Song et al. 2021)."""
