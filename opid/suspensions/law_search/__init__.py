"""Search for the law: candidates are ranked without a fit, then chosen by the pursuit or by sparse regression.

The force without a law is compared with them, and shows effects that no term describes.
"""
