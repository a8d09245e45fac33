"""A chain of four masses with one joint and a backbone of it, for the tests of study files."""

import numpy as np
from scipy import sparse

from opid.updating.checks import nominal_modes
from opid.updating.measured import MeasuredBackbone
from opid.updating.structure.affine import AffineStructure

DOFS = ("a", "b", "c", "tip")


def small_chain(stiffness=4e4):
    """Four masses of 2 kg on equal springs, the first on the ground: half of each spring is updated."""
    k = stiffness * (2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1))
    k[3, 3] = stiffness
    half = sparse.csr_matrix(0.5 * k)
    return AffineStructure(sparse.csr_matrix(2 * np.eye(4)), half, {"E": half}, DOFS, DOFS, {"end": ("c", "tip")})


def curve_of(mode=1, *, name="first", factor=1.0, n=6):
    """A backbone of the chain that hardens a little."""
    modes = nominal_modes(small_chain(), 4)
    shape = modes.at_sensors[:, mode - 1] / modes.at_sensors[3, mode - 1]
    level = np.linspace(1e-4, 2e-3, n)
    hz = factor * modes.frequency_hz[mode - 1] * (1 + 1e4 * level**2)
    return MeasuredBackbone(name, mode, "tip", hz, level[:, None] * shape, DOFS)
