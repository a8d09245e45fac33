"""Results -> Axes: one function a figure, each takes a result (and Axes, if you have some) and computes nothing.

The only room with matplotlib. Without Axes a function draws on a figure of its own, which no backend holds:
`opid.plots.figure_of(axes).savefig("slices.png")`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
