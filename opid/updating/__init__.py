"""Bayesian updating and class selection from nonlinear normal modes (Song et al. 2021)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
