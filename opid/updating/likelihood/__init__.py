"""The likelihood of measured backbones and linear modes for given parameters, and the noise in them."""
