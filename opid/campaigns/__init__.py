"""Campaigns: many flights identified at once, each one a task of Dask."""
