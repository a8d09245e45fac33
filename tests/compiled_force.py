"""The force of a law as the kernels compute it, number by number: for comparison with numpy."""

import numpy as np

from opid.mechanics.kernels.compilation import kernel
from opid.mechanics.kernels.steps import _compute_force


@kernel()
def compiled_force(codes, values, z, v):
    force = np.empty(z.size)
    for k in range(force.size):
        force[k] = _compute_force(codes, values, 0, codes.size, z[k], v[k])
    return force
