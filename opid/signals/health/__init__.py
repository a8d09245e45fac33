"""Whether a log can be trusted: its clock, its channels, their spectra, and one channel beside another.

`inspection.inspect` asks all of it of a log of any length.
"""
