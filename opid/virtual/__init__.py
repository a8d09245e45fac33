"""Tests with known truth: machines that taxi, modal tests and backbones, simulated as their sensors would record them.

No other package writes a truth.json.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
