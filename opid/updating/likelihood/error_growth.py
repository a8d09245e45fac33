"""How errors of the linear structure grow along backbones, where joints stiffen and modes mix."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from opid.mechanics.backbones.family import family_evaluator
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import (
    BackboneData,
    ErrorGrowth,
    ModeData,
    find_met_modes,
    with_noise,
)
from opid.updating.likelihood.curves import make_solver, normalise_slopes
from opid.updating.measured import MeasuredBackbone, by_mode
from opid.updating.model_class import ModelClass
from opid.updating.settings import UPDATING
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import reduce

STEP = 0.01  # fraction by which each factor is changed to find its effect on the backbones
# law of the trial backbones, which grow as the measured ones; with a quintic law errors grow 1.4 times as much
LAW = "cubic_stiffness"


# ---- errors of the stiffness factors ---------------------------------------------------------------


def growth_of_linear_error(
    structure: AffineStructure,
    factors: Mapping[str, float],
    backbones: Sequence[MeasuredBackbone],
    *,
    covariance: FloatArray | None,
    linear_error: float,
    n_modes: int,
) -> dict[int, float]:
    """Return how far the error of lambda grows while lambda doubles, by mode, in units of 2 `linear_error`.

    Phase I finds factors that make the linear frequencies right, sometimes for a wrong reason: it takes another error
    of a mode for one of the stiffness. Along a backbone the joints stiffen, the strain energy moves to other parts of
    the structure, and such an error appears in the frequency. With r_k(A) = d lambda(A) / d ln theta_k / lambda(0),
    less its value at amplitude 0, and C the covariance of ln theta, the growth is the root mean square of
    (r^T C r)^1/2 over that of lambda(A) / lambda(0) - 1. Modes whose curves do not grow, do not move the joints or do
    not converge are left out.

    `factors` are the factors of the stiffness parts, with the `covariance` that phase I leaves. Without phase I it is
    None, and each part may be wrong by itself, by as much as makes one frequency of it wrong by `linear_error`, the
    standard deviation of the relative error of a linear frequency. `n_modes` internal modes are kept.
    """
    best = np.array(list(factors.values()))
    alone = (2 * linear_error) ** 2 * np.eye(best.size)
    relative = alone if covariance is None else np.asarray(covariance) / np.outer(best, best)
    base = reduce(structure, factors, n_modes=n_modes)
    moved = [
        reduce(structure, {**factors, name: value * (1 + STEP)}, n_modes=n_modes) for name, value in factors.items()
    ]
    growth = {}
    for mode, curves in by_mode(backbones).items():
        found = _compute_growth(base, moved, curves)
        if found is not None:
            grown, by_factor = found
            variance = np.einsum("ka,kl,la->a", by_factor, relative, by_factor)
            growth[mode] = float(np.sqrt(variance.sum() / (grown**2).sum())) / (2 * linear_error)
    return growth


def _compute_growth(
    base: JointedModes, moved: Sequence[JointedModes], curves: Sequence[MeasuredBackbone]
) -> tuple[FloatArray, FloatArray] | None:
    """Return the growth of lambda, (n,), and its derivative by each factor, (n_factors, n), at measured amplitudes.

    None where lambda does not grow, or the backbones converge at too few amplitudes.
    """
    mode, sensor = curves[0].mode, curves[0].controlled_sensor
    mine = [one for one in curves if one.controlled_sensor == sensor]
    amplitude = np.linspace(
        min(one.controlled_amplitude[0] for one in mine),
        max(one.controlled_amplitude[-1] for one in mine),
        UPDATING.n_amplitudes,
    )
    # The trial backbones grow as the curve that grows or falls most.
    growths = [float(one.eigenvalue[-1] / one.eigenvalue[0]) - 1 for one in mine]
    wanted = max(growths, key=abs)
    coefficient = _find_coefficient(base, mode, sensor, float(amplitude[-1]), wanted)
    if coefficient is None:
        return None
    column = base.index(mode)
    relative, converged = [], []
    for system in (base, *moved):
        solved = family_evaluator(system, (LAW,), mode=mode, sensor=sensor, amplitude=amplitude)([[coefficient]])
        relative.append((solved.eigenvalue[0] - system.eigenvalue[column]) / base.eigenvalue[column])
        converged.append(solved.converged[0])
    kept = np.all(converged, axis=0)
    if kept.sum() < UPDATING.fewest_amplitudes:
        return None
    grown = relative[0][kept]
    return grown, np.array([(each[kept] - grown) / STEP for each in relative[1:]])


def _find_coefficient(system: JointedModes, mode: int, sensor: str, amplitude: float, growth: float) -> float | None:
    """Return the coefficient of the cubic law with which lambda grows so far at the amplitude; None if none does."""
    column = system.index(mode)
    at_sensor, at_joints = system.at_sensors[system.sensor(sensor), column], system.at_joints[:, column]
    if abs(growth) < UPDATING.least_growth or not at_sensor or not at_joints.any():
        return None
    # One harmonic of one mode gives lambda = lambda_0 + 3/4 c q^2 sum psi^4; other modes take a part of the force.
    alone = 0.75 * (amplitude / at_sensor) ** 2 * float(np.sum(at_joints**4))
    tried = growth * system.eigenvalue[column] / alone * np.geomspace(0.5, 50.0, 40)
    solved = family_evaluator(system, (LAW,), mode=mode, sensor=sensor, amplitude=[amplitude])(tried[:, None])
    fine = solved.converged[:, 0]
    if not fine.any():
        return None
    reached = (solved.eigenvalue[fine, 0] / system.eigenvalue[column] - 1) / growth
    order = np.argsort(reached)
    return float(np.interp(1.0, reached[order], tried[fine][order]))


# ---- errors of the modal eigenvalues ---------------------------------------------------------------


def with_modal_errors(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> BackboneData:
    """Return the backbones with errors of the modal eigenvalues that grow as the laws of a class make them grow.

    Where joints have laws of their own, modes mix the more the larger the motion is, and how far they do depends on how
    far apart their frequencies are: an error of one of them then changes the growth of the others. The growth is
    computed by the derivatives of the backbones at theta, (n_parameters,), and taken where it is larger than that of
    the data.
    """
    if data.form != "recommended" or data.noise.linear_error_growth is not None:
        return data
    modes = tuple(_widen(data, mode, model_class, theta) for mode in data.modes)
    return data if modes == data.modes else replace(data, modes=modes)


def _widen(data: BackboneData, mode: ModeData, model_class: ModelClass, theta: FloatArray) -> ModeData:
    system, own = find_met_modes(data, mode).remove_from(data.system), mode.mode - 1
    # A unit of each linear parameter is a change of one eigenvalue by all of it.
    couplings = np.array([np.diag(row) for row in np.diag(system.eigenvalue)])
    of_values, of_shapes = [], []
    for sensor, amplitude in mode.parts:
        solver = make_solver(data, model_class, mode, sensor, amplitude)
        found, slopes, shape_slopes = solver.find_slopes(theta[np.newaxis], couplings)
        n = model_class.n_parameters
        of_values.append(slopes[0, :, n:] / mode.linear)
        shapes = found.shapes[0][:, mode.rows]
        length = np.linalg.norm(shapes, axis=1, keepdims=True)
        of_shapes.append(normalise_slopes(shapes / length, shape_slopes[0][:, mode.rows, n:] / length[..., None]))
    at_nodes = np.concatenate(of_values)
    at_nodes[:, own] -= 1.0  # At small motions an error of the mode itself is all of it, and one of another is nothing.
    by_shape = np.concatenate(of_shapes)
    if not (np.isfinite(at_nodes).all() and np.isfinite(by_shape).all()) or not mode.growth.any():
        return mode
    size = np.sqrt(np.mean(mode.growth**2))
    moved = 2 * data.noise.linear_error / data.noise.linear_shape_error
    shape_points = np.einsum("jk,ksm->jsm", mode.between, by_shape)
    shape = float(np.sqrt(np.mean(np.sum(shape_points**2, axis=2))) / size) * moved
    patterns = _find_patterns(mode.between @ at_nodes, mode.growth, UPDATING.least_pattern * size)
    known = mode.errors or ErrorGrowth.of(data.noise)
    if not patterns.size and shape <= known.shape:
        return mode
    errors = replace(known, shape=max(shape, known.shape)).with_patterns(patterns)
    return with_noise(mode, data.noise, errors)


def _find_patterns(errors: FloatArray, growth: FloatArray, least: float) -> FloatArray:
    """Return the patterns, (n_points, n), of errors, (n_points, n_errors), beside a constant and one that grows with h.

    Together they vary as the errors do if these are independent; those of an rms below `least` are left out.
    """
    usual = np.linalg.qr(np.column_stack([np.ones_like(growth), growth]))[0]
    patterns, size, _ = np.linalg.svd(errors - usual @ (usual.T @ errors), full_matrices=False)
    return np.asarray((patterns * size)[:, size > least * np.sqrt(len(growth))])
