"""Phase I: parameters of the linear structure from the lowest points of backbones (Song et al. 2021; 2.1.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, nearest
from opid.estimate import Estimate
from opid.signals.recording import FloatArray
from opid.updating.chains import spread_starts
from opid.updating.diagnostics import diagnose, presses_against
from opid.updating.maximum import maximum_a_posteriori
from opid.updating.measured import MeasuredBackbone
from opid.updating.metropolis import adaptive_metropolis
from opid.updating.model_class import Prior
from opid.updating.reduction import lowest_modes
from opid.updating.result import LinearMode, LinearPosterior
from opid.updating.ritz import RitzModel, ritz_model, ritz_modes
from opid.updating.structure import AffineStructure

LEAST_RATIO = 0.01
"""Of the upper end of a prior: where its lower end is 0, the Ritz vectors serve from there."""
FAR = 5.0
"""Standard deviations of a prior without an end to which the Ritz vectors serve."""
FEW_SETS = 4
"""With fewer curves of a mode their scatter is a poor estimate."""
PEAK = 1e-6
"""How much the log density of the best parameters may be short of its maximum: far above its rounding, 1e-9."""
UNMIXED = 1.1
"""R-hat above which the chains are not to be trusted."""
MISFIT = 3.0
"""Standard deviations of the mean of the measured eigenvalues by which the updated one may miss it."""
MOVED = 1.0
"""Standard deviations of the mean by which the lowest points may lie off the linear frequency of their curves."""

Cov = float | Mapping[int, float] | Literal["scatter", "inferred"]
ShapeStd = float | Literal["paper", "scatter", "inferred"]


@dataclass(frozen=True, eq=False)
class LinearData:
    """The lowest points of all backbones of one mode, every curve a data set of its own.

    Args:
        mode: its number, from 1.
        eigenvalue: (n_sets,) measured, 1/s^2.
        shapes: (n_sets, n_sensors) measured, of unit length.
        rows: (n_sensors,) places of those sensors among the sensors of the structure.
        eigenvalue_std: (n_sets,) sigma_lambda = w CoV lambda (Song eq. 5), 1/s^2.
        shape_std: sigma_phi of an entry of the shape (eq. 6).
        infer_eigenvalue_std: whether that is a guess, its common factor to be integrated out.
        infer_shape_std: likewise.
    """

    mode: int
    eigenvalue: FloatArray
    shapes: FloatArray
    rows: FloatArray
    eigenvalue_std: FloatArray
    shape_std: float
    infer_eigenvalue_std: bool = False
    infer_shape_std: bool = False


def linear_data(
    structure: AffineStructure,
    backbones: Sequence[MeasuredBackbone],
    *,
    cov: Cov = "scatter",
    weights: Mapping[int, float] | None = None,
    shape_std: ShapeStd = "paper",
) -> tuple[LinearData, ...]:
    """Return the lowest points of backbones, by mode, with the standard deviations of eqs. (5) and (6).

    Args:
        structure: whose sensors they were measured at.
        backbones: all of one mode with the same sensors, which may be some of the structure's.
        cov: coefficient of variation of the eigenvalue (twice that of the frequency): one for all modes, or by mode
            (those left out as "scatter"); "scatter" for that of the curves of each mode, as the paper has it;
            "inferred" for that unknown, integrated out with the prior 1 / CoV: right where there are few curves.
        weights: w_m by mode; 1 where left out.
        shape_std: standard deviation of an entry of a shape of unit length: "paper" for sqrt(n_sensors) w_m CoV
            (eq. 6, a weighting and no model of noise), "scatter" for that of the curves about their mean, "inferred"
            for that unknown, or a number.

    Raises:
        InputError: no backbone, a sensor that the structure does not have, curves of one mode with different sensors,
            one curve of a mode or curves without scatter where it is to be estimated, or values that are not positive.
    """
    if not backbones:
        raise InputError("no backbone is given: measure at least one")
    modes = sorted({curve.mode for curve in backbones})
    if isinstance(cov, str) and cov not in ("scatter", "inferred"):
        raise InputError(f"cov is {cov!r}: give 'scatter', 'inferred' or a number")
    if isinstance(shape_std, str) and shape_std not in ("paper", "scatter", "inferred"):
        raise InputError(f"shape_std is {shape_std!r}: give 'paper', 'scatter', 'inferred' or a number")
    for what, by_mode in (("cov", cov), ("weights", weights)):
        for mode in by_mode if isinstance(by_mode, Mapping) else ():
            if mode not in modes:
                raise InputError(f"{what} names mode {mode}, of which there is no backbone: there are {modes}")
    return tuple(
        _of_one_mode(structure, mode, [c for c in backbones if c.mode == mode], cov, weights or {}, shape_std)
        for mode in modes
    )


def log_likelihood(data: Sequence[LinearData], model: RitzModel, theta: ArrayLike) -> FloatArray:
    """Return log p(D | theta) for each row of theta (Song eqs. 3, 4 and 7 to 9), (n, n_parameters) -> (n,).

    The density of an error is 1 / (sqrt(2 pi) sigma): eq. (7) as printed has sigma beneath the root. The error of a
    shape has e^T e = 1 - MAC when it is scaled by a_m. Impossible parameters, with an eigenvalue below 0, give -inf.

    Args:
        data: of `linear_data`.
        model: modes for any theta.
        theta: (n, n_parameters).
    """
    eigenvalue, shapes = ritz_modes(model, theta)
    total = np.zeros(len(eigenvalue))
    for each in data:
        found, shape = eigenvalue[:, each.mode - 1], shapes[:, each.rows, each.mode - 1]
        score = (each.eigenvalue - found[:, None]) / each.eigenvalue_std
        total += _log_normal((score**2).sum(axis=1), score.shape[1], each.infer_eigenvalue_std)
        length = np.maximum(np.linalg.norm(shape, axis=1), 1e-300)
        rest = 1 - ((shape / length[:, None]) @ each.shapes.T) ** 2  # 1 - MAC, (n, n_sets)
        # a shape of unit length has one entry less to choose than sensors
        free = each.shapes.shape[0] * (each.shapes.shape[1] - 1)
        total += _log_normal(rest.sum(axis=1) / each.shape_std**2, free, each.infer_shape_std)
        total -= np.log(each.eigenvalue_std).sum() + free * np.log(each.shape_std)
    return np.where(eigenvalue[:, 0] > -1e-6 * np.abs(eigenvalue[:, -1]), total, -np.inf)


def _log_normal(squares: FloatArray, n: int, infer: bool) -> FloatArray:
    """Logarithm of the density of n normal errors, scaled to 1, with this sum of squares.

    With `infer` all of them are larger by an unknown factor s that is integrated out with the prior 1 / s.
    """
    from scipy.special import gammaln

    if not infer:
        return -0.5 * squares - 0.5 * n * np.log(2 * np.pi)
    return gammaln(n / 2) - np.log(2) - 0.5 * n * np.log(np.pi * np.maximum(squares, 1e-300))


def log_posterior(
    data: Sequence[LinearData], model: RitzModel, priors: Mapping[str, Prior]
) -> Callable[[FloatArray], FloatArray]:
    """Return theta (n, n_parameters) -> (n,), the logarithm of likelihood times prior.

    Args:
        data: of `linear_data`.
        model: modes for any theta.
        priors: of each parameter of the model, by name.
    """
    ordered = [priors[name] for name in model.names]

    def density(theta: FloatArray) -> FloatArray:
        rows = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        total = np.sum([prior.log_density(rows[:, k]) for k, prior in enumerate(ordered)], axis=0)
        inside = np.isfinite(total) & (rows > 0).all(axis=1)
        total = np.where(inside, total, -np.inf)
        total[inside] += log_likelihood(data, model, rows[inside])
        return total

    return density


def update_linear(
    structure: AffineStructure,
    backbones: Sequence[MeasuredBackbone],
    *,
    priors: Mapping[str, Prior],
    rng: np.random.Generator,
    cov: Cov = "scatter",
    weights: Mapping[int, float] | None = None,
    shape_std: ShapeStd = "paper",
    n_chains: int = 4,
    n_samples: int = 1000,
    n_warm_up: int = 200,
    progress: Callable[[float], None] | None = None,
) -> LinearPosterior:
    """Return the parameters of the linear structure given the lowest point of every backbone (Song section 4.1).

    Adaptive Metropolis chains begin around the maximum a posteriori, with its curvature for their first jumps.

    Args:
        structure: the finite-element structure.
        backbones: measured; modes are counted from the lowest one of the structure, rigid ones included.
        priors: of the parameters to update, by name; a part of the stiffness that is left out stays at 1.
        rng: source of chance.
        cov: see `linear_data`.
        weights: see `linear_data`.
        shape_std: see `linear_data`.
        n_chains: chains.
        n_samples: kept of each.
        n_warm_up: dropped of each before them.
        progress: called with the share that is done.

    Raises:
        InputError: see `linear_data`; a prior of an unknown parameter, or one that allows nothing above 0.
        NotDeterminedError: the data do not tell a parameter.
    """
    data = linear_data(structure, backbones, cov=cov, weights=weights, shape_std=shape_std)
    modes = [each.mode for each in data]
    model = ritz_model(structure, box=_prior_box(structure, priors), modes=modes)
    density = log_posterior(data, model, priors)
    ordered = [priors[name] for name in model.names]
    support = [(max(low, 0.0), high) for low, high in (prior.support for prior in ordered)]
    draws = np.column_stack([prior.sample(200, rng) for prior in ordered])
    peak = maximum_a_posteriori(density, draws, support=support, tolerance=PEAK)
    start = spread_starts(density, peak.theta, peak.covariance, n_chains=n_chains, rng=rng)
    chain = adaptive_metropolis(
        density, start, covariance=peak.covariance, n_samples=n_samples, n_warm_up=n_warm_up, rng=rng, progress=progress
    )
    samples = chain.pooled
    diagnostics = diagnose(chain)
    table = _mode_table(structure, data, dict(zip(model.names, peak.theta.tolist(), strict=True)))
    warnings = [
        pressure.sentence.replace(f"theta_{pressure.parameter}", model.names[pressure.parameter - 1], 1)
        for pressure in presses_against(samples, ordered)
    ]
    if diagnostics.r_hat > UNMIXED:
        warnings.append(
            f"the chains of the linear parameters have not mixed (R-hat {diagnostics.r_hat:.2f}): take more samples"
        )
    return LinearPosterior(
        names=model.names,
        best=peak.theta,
        estimates={name: _estimate(column) for name, column in zip(model.names, samples.T, strict=True)},
        covariance=np.atleast_2d(np.cov(samples, rowvar=False)),
        samples=samples,
        modes=table,
        diagnostics=diagnostics,
        warnings=(*warnings, *_doubts(data, table, backbones, cov)),
    )


def _of_one_mode(
    structure: AffineStructure,
    mode: int,
    curves: Sequence[MeasuredBackbone],
    cov: Cov,
    weights: Mapping[int, float],
    shape_std: ShapeStd,
) -> LinearData:
    sensors = curves[0].sensors
    for curve in curves:
        if curve.sensors != sensors:
            raise InputError(
                f"the backbones {curves[0].name!r} and {curve.name!r} of mode {mode} have different sensors, {sensors} "
                f"and {curve.sensors}: give all curves of a mode the same ones"
            )
    for sensor in sensors:
        if sensor not in structure.sensors:
            raise InputError(
                f"the backbone {curves[0].name!r} has the sensor {sensor!r}, which the structure does not have: "
                f"{nearest(sensor, structure.sensors)}"
            )
    if len(sensors) < 2 and shape_std != "paper":
        raise InputError(f"the backbones of mode {mode} have one sensor, which makes no shape: leave shape_std out")
    eigenvalue = np.array([curve.eigenvalue[0] for curve in curves])
    lowest = np.array([curve.amplitude[0] for curve in curves])
    shapes = lowest / np.linalg.norm(lowest, axis=1, keepdims=True)
    spread = _variation(mode, eigenvalue, cov)
    weight = _positive(f"the weight of mode {mode}", weights.get(mode, 1.0))
    if shape_std == "paper":
        sigma = float(np.sqrt(len(sensors))) * spread
    else:
        sigma = _shape_scatter(mode, shapes) if isinstance(shape_std, str) else _positive("shape_std", shape_std)
    return LinearData(
        mode,
        eigenvalue,
        shapes,
        rows=np.array([structure.sensors.index(sensor) for sensor in sensors]),
        eigenvalue_std=weight * spread * eigenvalue,
        shape_std=weight * sigma,
        infer_eigenvalue_std=cov == "inferred",
        infer_shape_std=shape_std == "inferred",
    )


def _variation(mode: int, eigenvalue: FloatArray, cov: Cov) -> float:
    """Coefficient of variation of the eigenvalue of a mode, given or of its curves."""
    given = cov.get(mode, "scatter") if isinstance(cov, Mapping) else cov
    if not isinstance(given, str):
        return _positive(f"cov of mode {mode}", given)
    if eigenvalue.size < 2:
        raise InputError(f"mode {mode} has one backbone, which has no scatter: give cov, that of its eigenvalue")
    spread = float(eigenvalue.std(ddof=1) / eigenvalue.mean())
    if spread <= 0:
        raise InputError(f"all backbones of mode {mode} begin at the same frequency: give cov, that of its eigenvalue")
    return spread


def _shape_scatter(mode: int, shapes: FloatArray) -> float:
    """Standard deviation of an entry of unit shapes about the shape that is nearest to all."""
    n_sets, n_sensors = shapes.shape
    rest = float(np.sum(np.linalg.svd(shapes, compute_uv=False)[1:] ** 2))
    if n_sets < 2 or rest <= 1e-20:
        raise InputError(f"the shapes of mode {mode} have no scatter between curves: give shape_std as a number")
    return float(np.sqrt(rest / ((n_sets - 1) * (n_sensors - 1))))


def _positive(what: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{what} is {value}: give a positive number")
    return float(value)


def _prior_box(structure: AffineStructure, priors: Mapping[str, Prior]) -> dict[str, tuple[float, float]]:
    """Where each prior allows its parameter to be, above 0."""
    box = {}
    for name, prior in priors.items():
        if name not in structure.parts:
            known = nearest(name, structure.parts) if structure.parts else "the structure has no part to update"
            raise InputError(f"there is a prior for {name!r}, which is no parameter: {known}")
        low, high = prior.support
        if prior.family == "normal":
            low, high = prior.first - FAR * prior.second, prior.first + FAR * prior.second
        if prior.family == "lognormal":
            low, high = (prior.first * np.exp(side * FAR * prior.second) for side in (-1, 1))
        if high <= 0:
            raise InputError(f"the prior of {name!r} allows nothing above 0: a factor of stiffness is positive")
        box[name] = (max(low, LEAST_RATIO * high), high)
    return box


def _estimate(column: FloatArray) -> Estimate:
    low, high = np.quantile(column, [0.025, 0.975])
    return Estimate(float(column.mean()), float(column.std(ddof=1)), (float(low), float(high)))


def _mode_table(
    structure: AffineStructure, data: Sequence[LinearData], best: Mapping[str, float]
) -> tuple[LinearMode, ...]:
    """Frequencies and MAC of the full structure before and after (Song Table 2)."""
    n_modes = max(each.mode for each in data)
    places = structure.sensor_places
    found = []
    for factors in ({}, best):
        eigenvalue, shapes = lowest_modes(structure.mass, structure.stiffness_at(factors), n_modes)
        found.append((np.sqrt(np.maximum(eigenvalue, 0.0)) / (2 * np.pi), shapes[places]))
    table = []
    for each in data:
        mode = each.mode - 1
        units = [shapes[each.rows, mode] / np.linalg.norm(shapes[each.rows, mode]) for _, shapes in found]
        before, after = (float(np.mean((each.shapes @ unit) ** 2)) for unit in units)
        identified = float(np.sqrt(each.eigenvalue).mean() / (2 * np.pi))
        initial, updated = (float(hz[mode]) for hz, _ in found)
        table.append(LinearMode(each.mode, identified, initial, updated, before, after))
    return tuple(table)


def _doubts(
    data: Sequence[LinearData],
    table: Sequence[LinearMode],
    backbones: Sequence[MeasuredBackbone],
    cov: Cov,
) -> list[str]:
    """What to doubt: a poor estimate of scatter, a mode that is missed, lowest points that are already nonlinear."""
    doubts = []
    for each, row in zip(data, table, strict=True):
        mode, n_sets = f"mode {each.mode}", each.eigenvalue.size
        std = float(each.eigenvalue_std.mean()) / np.sqrt(n_sets)  # of their mean
        estimated = cov == "scatter" or (isinstance(cov, Mapping) and each.mode not in cov)
        if n_sets < FEW_SETS and estimated:
            doubts.append(
                f"the scatter of {mode} is estimated from {n_sets} curves: measure more, give cov, or have it inferred"
            )
        missed = ((2 * np.pi * row.updated_hz) ** 2 - float(each.eigenvalue.mean())) / std
        if abs(missed) > MISFIT:
            doubts.append(
                f"the updated {mode} lies at {row.updated_hz:.4g} Hz, {abs(missed):.1f} standard deviations from the "
                f"measured {row.identified_hz:.4g} Hz: the structure has an error that its parameters cannot mend"
            )
        moved = float(np.mean([_nonlinear_part(c) for c in backbones if c.mode == each.mode])) / std
        if abs(moved) > MOVED:
            doubts.append(
                f"the lowest points of {mode} lie {abs(moved):.1f} standard deviations from the frequency that their "
                "curves point to at amplitude 0: measure at smaller amplitudes"
            )
    return doubts


def _nonlinear_part(curve: MeasuredBackbone) -> float:
    """Eigenvalue at the lowest point less that at amplitude 0, by a line in the square of the amplitude."""
    square = (curve.controlled_amplitude / curve.controlled_amplitude[0]) ** 2
    near = slice(0, max(3, np.count_nonzero(square <= 9)))
    return float(np.polyfit(square[near], curve.eigenvalue[near], 1)[0])
