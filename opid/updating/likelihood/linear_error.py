"""How the error that phase I leaves in the linear structure grows along the backbones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from opid.mechanics.backbones.family import family_evaluator
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.signals.recording import FloatArray
from opid.updating.data.measured import MeasuredBackbone
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import reduce

STEP = 0.01
"""Share by which each factor is changed to see what it does to the backbones."""
N_AMPLITUDES = 12
"""At which the backbones are compared."""
LAW = "cubic_stiffness"
"""Law whose growth is that of the measured curves; with a quintic one errors grow some 1.4 times as far."""
COEFFICIENTS = np.geomspace(0.5, 50.0, 40)
"""Coefficients that are tried, in units of what one mode alone would need: others move with it and take of it."""
LEAST_GROWTH = 1e-3
"""Growth of lambda below which a curve is linear: there is nothing that an error could grow with."""
FEWEST = 3
"""Amplitudes at which all backbones must have converged."""


def growth_of_linear_error(
    structure: AffineStructure,
    factors: Mapping[str, float],
    covariance: FloatArray,
    backbones: Sequence[MeasuredBackbone],
    *,
    linear_error: float,
    n_modes: int = 15,
) -> dict[int, float]:
    """Return how far the error of lambda grows while lambda doubles, by mode, in units of 2 `linear_error`.

    Phase I finds factors with which the linear frequencies are right, for wrong reasons too: an error of a mode is
    taken for one of the stiffness. Along a backbone the joints stiffen, the parts of the structure share the strain
    energy anew, and such an error comes to light. With r_k(A) = d lambda(A) / d ln theta_k / lambda(0), less its value
    at amplitude 0, and C the covariance of ln theta, the growth is the root mean square of (r^T C r)^1/2 over that of
    lambda(A) / lambda(0) - 1. Modes are left out whose curves do not grow, do not move the joints or do not converge.

    Args:
        structure: the finite-element structure.
        factors: of its stiffness parts, by name, as updated.
        covariance: (n_factors, n_factors) of them, in the same order.
        backbones: measured.
        linear_error: standard deviation of the relative error of a linear frequency: the unit.
        n_modes: internal modes of the reduction.

    Raises:
        InputError: as `reduce`, or sensors that the structure does not have.
    """
    best = np.array(list(factors.values()))
    relative = np.asarray(covariance) / np.outer(best, best)
    base = reduce(structure, factors, n_modes=n_modes)
    moved = [
        reduce(structure, {**factors, name: value * (1 + STEP)}, n_modes=n_modes) for name, value in factors.items()
    ]
    growth = {}
    for mode in sorted({one.mode for one in backbones}):
        found = _strayed(base, moved, [one for one in backbones if one.mode == mode])
        if found is not None:
            grown, strayed = found
            variance = np.einsum("ka,kl,la->a", strayed, relative, strayed)
            growth[mode] = float(np.sqrt(variance.sum() / (grown**2).sum())) / (2 * linear_error)
    return growth


def _strayed(
    base: JointedModes, moved: Sequence[JointedModes], curves: Sequence[MeasuredBackbone]
) -> tuple[FloatArray, FloatArray] | None:
    """Growth of lambda (n,), and what each factor adds to it (n_factors, n), over the measured amplitudes."""
    mode, sensor = curves[0].mode, curves[0].controlled_sensor
    mine = [one for one in curves if one.controlled_sensor == sensor]
    amplitude = np.linspace(
        min(one.controlled_amplitude[0] for one in mine),
        max(one.controlled_amplitude[-1] for one in mine),
        N_AMPLITUDES,
    )
    # of the curve that grows most, either way
    growths = [float(one.eigenvalue[-1] / one.eigenvalue[0]) - 1 for one in mine]
    wanted = max(growths, key=abs)
    coefficient = _coefficient(base, mode, sensor, float(amplitude[-1]), wanted)
    if coefficient is None:
        return None
    place = base.place(mode)
    relative, converged = [], []
    for system in (base, *moved):
        solved = family_evaluator(system, (LAW,), mode=mode, sensor=sensor, amplitude=amplitude)([[coefficient]])
        relative.append((solved.eigenvalue[0] - system.eigenvalue[place]) / base.eigenvalue[place])
        converged.append(solved.converged[0])
    kept = np.all(converged, axis=0)
    if kept.sum() < FEWEST:
        return None
    grown = relative[0][kept]
    return grown, np.array([(each[kept] - grown) / STEP for each in relative[1:]])


def _coefficient(system: JointedModes, mode: int, sensor: str, amplitude: float, growth: float) -> float | None:
    """Of a cubic law with which lambda grows by this share up to the amplitude; None where none makes it grow."""
    place = system.place(mode)
    at_sensor, at_joints = system.at_sensors[system.sensor(sensor), place], system.at_joints[:, place]
    if abs(growth) < LEAST_GROWTH or not at_sensor or not at_joints.any():
        return None
    # lambda = lambda_0 + 3/4 c q^2 sum psi^4 by one harmonic of one mode
    alone = 0.75 * (amplitude / at_sensor) ** 2 * float(np.sum(at_joints**4))
    tried = growth * system.eigenvalue[place] / alone * COEFFICIENTS
    solved = family_evaluator(system, (LAW,), mode=mode, sensor=sensor, amplitude=[amplitude])(tried[:, None])
    fine = solved.converged[:, 0]
    if not fine.any():
        return None
    reached = (solved.eigenvalue[fine, 0] / system.eigenvalue[place] - 1) / growth
    order = np.argsort(reached)
    return float(np.interp(1.0, reached[order], tried[fine][order]))
