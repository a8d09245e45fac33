"""Posterior samples and evidence: Markov chains, transitional sampling, the most probable point, and diagnostics."""
