"""Measured backbones of a wing with engines: finite elements, a shaker under feedback, and its continuation."""
