"""Reports of Bayesian updating."""
