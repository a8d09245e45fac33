"""Nonlinear modal models: modes with amplitude-dependent stiffness and damping, identified one by one (Pacini)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
