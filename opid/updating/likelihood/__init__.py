"""How likely measured backbones and linear modes are for given parameters, and the noise that they have."""
