"""Figures of Bayesian updating: backbones, classes, the linear structure, and posterior samples."""
