"""Identify nonlinear mechanical structures from what an accelerometer recorded in operation.

Where to look: `read_study` or `study_from_logs`, then `identify`, then `text` and `write_report`. The steps of the
methods are in the namespaces `suspensions`, `modal` and `updating`, what they are made of in `signals`, `laws` and
`mechanics`, many flights at once in `campaigns`, tests with known truth in `virtual`, figures in `plots`;
`dir(opid.modal)` lists what is public there. `import opid.planning` plans runs. Names load when they are first used, so
that `import opid` is quick.
"""

import logging

import lazy_loader

__version__ = "0.1.0"

# a user who wants to read what happens gives the logger "opid" a handler
logging.getLogger(__name__).addHandler(logging.NullHandler())

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
