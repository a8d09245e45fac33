"""Planning: runs that nobody has made yet, from a guessed gear or from the study of runs that were made."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
