"""How likely measured backbones and linear modes are for given parameters, errors of the model included."""
