"""A nonlinear mode from forced tests: the excitation, the equation of motion, and the powers in its restoring force."""
