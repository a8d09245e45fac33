"""The straight suspension that comes nearest to a gear over a motion: what a linear analysis would have found."""

from __future__ import annotations

import numpy as np

from opid.mechanics.memory import force_along
from opid.mechanics.prediction import Prediction
from opid.signals.recording import FloatArray
from opid.suspensions.model import Model


def straight_equivalent(model: Model, theta: FloatArray, run: int, motion: Prediction) -> FloatArray:
    """Return stiffness and damping over the mass of a run (1/s^2, 1/s), natural frequency (Hz) and damping ratio.

    Their force departs least from that of springs, damper and law, in the mean square over the motion (statistical
    linearisation, Roberts & Spanos 1990, Random vibration and statistical linearization, ch. 5).

    Args:
        model: of one gear.
        theta: its vector.
        run: place of the run.
        motion: of that run.

    Returns:
        (4,); frequency and damping ratio are NaN where it does not spring back.
    """
    z, v = motion.travel[:, 0], motion.velocity[:, 0]
    here = model.resting_interfaces(theta, run)[0]
    force = here.stiffness * z + here.damping * v
    if here.law.terms:
        force += force_along(here.law, z, v, model.runs[run].fs)
    straight = np.linalg.lstsq(np.stack([z, v], axis=1), force, rcond=None)[0]
    loading = float(model.runs[run].loading[0, 0])
    stiffness, damping = straight / (1.0 + model.inverse_mass(theta) * loading)
    omega = float(np.sqrt(stiffness)) if stiffness > 0.0 else np.nan
    return np.array([stiffness, damping, omega / (2 * np.pi), damping / (2 * omega)])
