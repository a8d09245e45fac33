"""Campaigns: many flights identified at once, each one a task of Dask, and their values as a dataset."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
