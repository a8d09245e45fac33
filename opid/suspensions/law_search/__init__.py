"""Which law: candidates ranked without a fit, the pursuit among them, and sparse regression.

The force without a law stands beside them, for what no term explains.
"""
