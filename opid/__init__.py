"""Identify nonlinear mechanical structures from what an accelerometer recorded in operation.

Where to look: `read_study` or `study_from_logs`, then `identify`, then `text` and `write_report`; each step of the
chain is a function of its own in `opid.suspensions`, virtual test runs are in `opid.virtual`, the signals in
`opid.signals`. Names load when they are first used, so that `import opid` is quick.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
