"""What moves, when the law is known: laws, structures and their response, backbones, and a body driven from below."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
