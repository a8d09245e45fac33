"""A small structure with two damped joints, and noisy backbones of it with the force, for the tests of updating."""

from dataclasses import replace
from functools import cache

import numpy as np

from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.backbones.quadrature_curves import quadrature_curve
from opid.mechanics.backbones.specimen import Specimen
from opid.mechanics.laws.law import Law, Term
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.study import UpdatingStudy
from opid.virtual.backbone_tests.measured import convert_curve

CUBIC, LINEAR, QUADRATIC, RATIO = 1.07e8, 0.4, 2.0, 0.002
DRIVE, CONTROLLED = "tip", "tip"
AMPLITUDE = np.linspace(2e-4, 4e-3, 12)
EVERYWHERE = np.ones(2, dtype=bool)


def system():
    """Two modes that move both joints, 14 and 25 Hz, and a third one at 60 Hz."""
    return JointedModes(
        (2 * np.pi * np.array([14.0, 25.0, 60.0])) ** 2,
        np.array([[0.9, 0.8, 0.3], [0.5, -0.7, 0.6], [0.3, 0.9, -0.5]]),
        np.array([[0.8, 0.7, 0.4], [0.75, -0.8, 0.5]]),
        ("tip", "middle", "end"),
        ("left", "right"),
    )


def specimen(*dampers, eigenvalue=None):
    """The structure with its springs and some dampers; other eigenvalues are an error of the linear structure."""
    law = Law((Term("cubic_stiffness", (CUBIC,)), *(Term(name, values) for name, values in dampers)))
    true = system() if eigenvalue is None else replace(system(), eigenvalue=eigenvalue)
    return Specimen(true, law, RATIO, DRIVE)


def solve_curve(true, mode):
    """The backbone of a mode as it would be measured without errors."""
    curve = quadrature_curve(
        true, mode=mode, sensor="tip", controlled_sensor=CONTROLLED, amplitude=AMPLITUDE, harmonics=(1, 3)
    )
    assert curve.converged.all()
    assert len(curve.levels) == AMPLITUDE.size
    return convert_curve(curve, DRIVE)


@cache
def curve_of(mode, *dampers):
    return solve_curve(specimen(*dampers), mode)


BOTH = (("signed_power_damping", (LINEAR, 1.0)), ("quadratic_damping", (QUADRATIC,)))
FRICTION = (("coulomb_friction", (4e-3, 4e-3)),)


def measured(dampers, seed, *, gain_std=0.02):
    """Three curves of each mode with noise, all with one error of calibration."""
    rng = np.random.default_rng(seed)
    gain, found = 1 + gain_std * rng.standard_normal(), []
    for mode in (1, 2):
        true = curve_of(mode, *dampers)
        linear = 1 + 0.004 * rng.standard_normal()
        for number in range(3):
            n = AMPLITUDE.size
            hz = true.frequency_hz * linear * (1 + 5e-4 * rng.standard_normal() + 1e-4 * rng.standard_normal(n))
            force = gain * true.force_n * (1 + 0.005 * rng.standard_normal() + 0.005 * rng.standard_normal(n))
            found.append(replace(true, name=f"mode {mode}, curve {number}", frequency_hz=hz, force_n=force))
    return tuple(found)


def damper(kind, scale):
    power = (1.0,) if kind == "signed_power_damping" else ()
    return UncertainTerm(kind, (scale, *power), (Prior(), *[None] * len(power)))


SPRING = UncertainTerm("cubic_stiffness", (CUBIC,), (Prior(),))
LINEAR_TERM, QUADRATIC_TERM = damper("signed_power_damping", LINEAR), damper("quadratic_damping", QUADRATIC)


def study(backbones, **changes):
    known = dict.fromkeys((1, 2), Prior("lognormal", RATIO, 0.03))
    classes = (
        ModelClass("both", (SPRING, LINEAR_TERM, QUADRATIC_TERM)),
        ModelClass("linear", (SPRING, LINEAR_TERM)),
        ModelClass("quadratic", (SPRING, QUADRATIC_TERM)),
    )
    given = {"classes": classes, "damping": known, "n_samples": 2000, "seed": 1} | changes
    return UpdatingStudy(title="damping", structure=system(), backbones=backbones, **given)
