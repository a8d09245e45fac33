"""Runs under known loads to parameters: one estimator for one suspension or several.

Its steps are in `model`, `fitting`, `law_search` and `answer`. Beside it, in folders of their own: the chain of Iwaniec
& Uhl (2007), laws from a test bench, many flights compared.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
