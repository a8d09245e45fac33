"""The likelihood of the lowest points of backbones given the linear structure (Song et al. 2021; 2.1.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, nearest, require_positive
from opid.signals.recording import FloatArray
from opid.updating.measured import MeasuredBackbone, by_mode, list_sensors, spread_sensors
from opid.updating.model_class import Prior
from opid.updating.sampling.chains import LogDensity, posterior_density
from opid.updating.settings import UPDATING
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import RitzModel, ritz_modes

OneCov = float | Literal["scatter", "inferred"]
OneShapeStd = float | Literal["paper", "inferred"]


class LinearErrors(TypedDict, total=False):
    """The errors of the lowest points, as far as they are known.

    Args:
        cov: coefficient of variation of the eigenvalue (twice that of the frequency), one for all modes or by mode. It
            is a number; "scatter" (the default, as in the paper) for that of the curves of each mode; or "inferred",
            which is right where there are few curves: it is then unknown and integrated out with the prior 1 / CoV.
        weight: w_m of all modes, or by mode; 1 where left out.
        shape_std: standard deviation of an entry of a shape of unit length, one for all modes or by mode. It is a
            number; "paper" (the default) for `shape_factor` w_m CoV (eq. 6, a weighting and no model of noise); or
            "inferred", as for `cov`.
        shape_factor: sigma_phi over w_m CoV of "paper"; the square root of the number of sensors where None.
        common_error: standard deviation of the relative error of a linear frequency of the model. It is common to all
            curves of a mode, so that more curves do not reduce it. With 0 (the default, the paper's form) the
            intervals only hold the errors in which curves differ. Otherwise the nonlinearity at the lowest points is
            an error, too, as far as their curves show it.
    """

    cov: OneCov | Mapping[int, OneCov]
    weight: float | Mapping[int, float]
    shape_std: OneShapeStd | Mapping[int, OneShapeStd]
    shape_factor: float | None
    common_error: float


@dataclass(frozen=True, eq=False)
class LinearData:
    """The lowest points of all backbones of one mode; every curve is a data set of its own."""

    mode: int  # number of the mode, from 1
    eigenvalue: FloatArray  # (n_sets,) measured eigenvalues, 1/s^2
    shapes: FloatArray  # (n_sets, n_sensors) measured shapes of unit length, 0 where a curve lacks the sensor
    seen: NDArray[np.bool_]  # (n_sets, n_sensors) whether each curve has the sensor
    rows: FloatArray  # (n_sensors,) indices of these sensors among the sensors of the structure
    eigenvalue_std: FloatArray  # (n_sets,) sigma_lambda = w CoV lambda (Song eq. 5), 1/s^2
    shape_std: float  # sigma_phi of an entry of the shape (eq. 6)
    infer_eigenvalue_std: bool = False  # whether `eigenvalue_std` is a guess whose common factor is integrated out
    infer_shape_std: bool = False  # whether the factor of `shape_std`, which may be any number, is integrated out
    # standard deviation of the error of the model, which is common to the eigenvalues of all curves, 1/s^2
    common_std: float = 0.0
    nonlinear_part: float = 0.0  # mean eigenvalue at the lowest points less that at amplitude 0, 1/s^2


def linear_data(
    structure: AffineStructure,
    backbones: Sequence[MeasuredBackbone],
    *,
    cov: OneCov | Mapping[int, OneCov] = "scatter",
    weight: float | Mapping[int, float] = 1.0,
    shape_std: OneShapeStd | Mapping[int, OneShapeStd] = "paper",
    shape_factor: float | None = None,
    common_error: float = 0.0,
) -> tuple[LinearData, ...]:
    """Return the lowest points of backbones, by mode, with the standard deviations of eqs. (5) and (6).

    The errors are those of `LinearErrors`. InputError: no backbone, a sensor that the structure does not have, a
    single curve or curves without scatter where that is to be estimated, or values that are not positive.
    """
    if not backbones:
        raise InputError("no backbone is given: measure at least one")
    curves_of = by_mode(backbones)
    for what, given, words in (("cov", cov, ("scatter", "inferred")), ("shape_std", shape_std, ("paper", "inferred"))):
        for mode in given if isinstance(given, Mapping) else ():
            if mode not in curves_of:
                raise InputError(f"{what} names mode {mode}, which has no backbone: name some of {[*curves_of]}")
        for each in given.values() if isinstance(given, Mapping) else (given,):
            if isinstance(each, str) and each not in words:
                raise InputError(f"{what} is {each!r}: give {', '.join(map(repr, words))} or a number")
    if not (np.isfinite(common_error) and common_error >= 0):
        raise InputError(f"common_error is {common_error}: give 0 or more")
    weights = weight if isinstance(weight, Mapping) else dict.fromkeys(curves_of, weight)
    for mode in weights:
        if mode not in curves_of:
            raise InputError(f"weight names mode {mode}, which has no backbone: name some of {[*curves_of]}")
    for what, number in (
        *((f"weight of mode {m}", each) for m, each in weights.items()),
        ("shape_factor", shape_factor),
    ):
        _ = None if number is None else require_positive(what, number)
    found = []
    for mode, curves in curves_of.items():
        sensors, one_shape = list_sensors(curves), _pick_mode(shape_std, mode, "paper")
        for sensor in sensors:
            if sensor not in structure.sensors:
                owner = next(curve for curve in curves if sensor in curve.sensors)
                raise InputError(
                    f"the backbone {owner.name!r} has the sensor {sensor!r}, which the structure does not have: "
                    f"{nearest(sensor, structure.sensors)}"
                )
        if len(sensors) < 2 and one_shape != "paper":
            raise InputError(
                f"the backbones of mode {mode} have one sensor, and one sensor has no shape: leave shape_std out"
            )
        one_cov = _pick_mode(cov, mode, "scatter")
        eigenvalue = np.array([curve.eigenvalue[0] for curve in curves])
        lowest = np.array([spread_sensors(curve.amplitude[0], curve.sensors, sensors) for curve in curves])
        spread = _find_variation(mode, eigenvalue, one_cov)
        factor = float(np.sqrt(len(sensors))) if shape_factor is None else shape_factor
        guess = factor * spread if one_shape == "paper" else 1.0
        own = weights.get(mode, 1.0)
        part = _find_nonlinear_part(curves)
        common_std = 2 * common_error * float(eigenvalue.mean())
        found.append(
            LinearData(
                mode,
                eigenvalue,
                lowest / np.linalg.norm(lowest, axis=1, keepdims=True),
                np.array([[name in curve.sensors for name in sensors] for curve in curves]),
                rows=np.array([structure.sensors.index(sensor) for sensor in sensors]),
                eigenvalue_std=own * spread * eigenvalue,
                shape_std=own * (guess if isinstance(one_shape, str) else require_positive("shape_std", one_shape)),
                infer_eigenvalue_std=one_cov == "inferred",
                infer_shape_std=one_shape == "inferred",
                common_std=float(np.hypot(common_std, part)) if common_error else 0.0,
                nonlinear_part=part,
            )
        )
    return tuple(found)


def log_likelihood(data: Sequence[LinearData], model: RitzModel, theta: ArrayLike) -> FloatArray:
    """Return log p(D | theta) for each row of theta (Song eqs. 3, 4 and 7 to 9), (n, n_parameters) -> (n,).

    The constant of the density is 1 / (sqrt(2 pi) sigma): eq. (7) as printed has sigma under the root. The error of a
    shape has e^T e = 1 - MAC when it is scaled by a_m. Impossible parameters, with an eigenvalue below 0, give -inf.
    An error that is common to all curves adds its variance to every entry of their covariance.
    """
    eigenvalue, shapes = ritz_modes(model, theta)
    total = np.zeros(len(eigenvalue))
    for each in data:
        found, shape = eigenvalue[:, each.mode - 1], shapes[:, each.rows, each.mode - 1]
        total += _weigh_eigenvalues(each, found)
        total += _weigh_shapes(each, shape / np.maximum(np.linalg.norm(shape, axis=1), 1e-300)[:, None])
    return np.where(eigenvalue[:, 0] > -1e-6 * np.abs(eigenvalue[:, -1]), total, -np.inf)


def mean_eigenvalue(data: LinearData) -> tuple[float, float]:
    """Return the mean of the measured eigenvalues, by their weights, and its standard deviation, 1/s^2.

    With `infer_eigenvalue_std` the noise follows from the scatter of the curves.
    """
    weight = data.eigenvalue_std**-2.0
    mean = float(weight @ data.eigenvalue / weight.sum())
    n_sets = data.eigenvalue.size
    noise = 1.0
    if data.infer_eigenvalue_std:
        noise = float(weight @ (data.eigenvalue - mean) ** 2) / (n_sets - 1)
    return mean, float(np.sqrt(noise / weight.sum() + data.common_std**2))


def log_posterior(data: Sequence[LinearData], model: RitzModel, priors: Mapping[str, Prior]) -> LogDensity:
    """Return theta (n, n_parameters) -> (n,), the logarithm of likelihood times prior of the model's names."""

    def log_prior(theta: FloatArray) -> FloatArray:
        rows = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        total = np.sum([priors[name].log_density(rows[:, k]) for k, name in enumerate(model.names)], axis=0)
        return np.where((rows > 0).all(axis=1), total, -np.inf)

    return posterior_density(lambda theta: log_likelihood(data, model, theta), log_prior)


def _weigh_eigenvalues(data: LinearData, found: FloatArray) -> FloatArray:
    weight = data.eigenvalue_std**-2.0
    mean = float(weight @ data.eigenvalue / weight.sum())
    scatter = float(weight @ (data.eigenvalue - mean) ** 2)
    missed = weight.sum() * (mean - found) ** 2
    n_sets = weight.size
    density = _weigh_normal_errors(
        np.full_like(missed, scatter), missed, n_sets, 1, data.common_std**2 * weight.sum(), data.infer_eigenvalue_std
    )
    return density - np.log(data.eigenvalue_std).sum()


def _weigh_shapes(data: LinearData, unit: FloatArray) -> FloatArray:
    """Return the log density of the shapes, by 1 - MAC; the model's own shape has no error here."""
    length = 1.0 if data.seen.all() else np.maximum(unit**2 @ data.seen.T, 1e-300)
    square = (1 - (unit @ data.shapes.T) ** 2 / length).sum(axis=1) / data.shape_std**2
    # The unit length fixes one entry of a shape.
    n_free = int((data.seen.sum(axis=1) - 1).sum())
    density = _weigh_normal_errors(square, np.zeros_like(square), n_free, 1, 0.0, data.infer_shape_std)
    return density - n_free * np.log(data.shape_std)


def _weigh_normal_errors(
    scatter: FloatArray, missed: FloatArray, n: int, free: int, shared: float, infer: bool
) -> FloatArray:
    """Return the log density, (n_theta,), of n normal errors with `free` entries each, in units of their noise.

    Their covariance is s^2 I + (shared / n) 1 1^T in every entry, so that two sums are enough: `scatter`, the sum of
    squares about their mean, (n_theta,), and `missed`, n times the square of that mean. s is 1; with `infer` it is
    unknown and integrated out with the prior 1 / s, in closed form without a shared error, else on a grid in log s.
    """
    from scipy.special import gammaln

    count = n * free
    if infer and shared <= 0:
        squares = np.maximum(scatter + missed, 1e-300)
        return gammaln(count / 2) - np.log(2) - 0.5 * count * np.log(np.pi * squares)
    if not infer:
        squares = scatter + missed / (1 + shared)
        return -0.5 * squares - 0.5 * free * np.log1p(shared) - 0.5 * count * np.log(2 * np.pi)
    # The grid goes from a tenth to 1e4 times the scatter, in steps of the standard deviation of log s: right to 1e-8.
    step = 1 / np.sqrt(2 * count)
    size = 0.5 * np.log(np.maximum(scatter, 1e-300) / count)
    logs = size[:, None] + np.arange(np.log(0.1), np.log(1e4), step)
    variance = np.exp(2 * logs)
    each = -0.5 * (scatter[:, None] / variance + missed[:, None] / (variance + shared))
    each -= (count - free) * logs + 0.5 * free * np.log(variance + shared)
    top = each.max(axis=1)
    total = top + np.log(np.exp(each - top[:, None]).sum(axis=1))
    return total + np.log(step) - 0.5 * count * np.log(2 * np.pi)


def _find_nonlinear_part(curves: Sequence[MeasuredBackbone]) -> float:
    """Return the mean eigenvalue at the lowest points of a mode less that at amplitude 0, 1/s^2.

    It is extrapolated by a line in a power of the amplitude: the square for springs, the first power or the root for
    joints that slip, where one of these leaves less of the lowest points of all curves. What the scatter of the points
    makes of it is taken off.
    """
    from scipy.stats import f as fisher

    found, freedom = [], 0
    for power in UPDATING.lowest_powers:
        parts, left, freedom, spread = [], 0.0, 0, 0.0
        for curve in curves:
            growth = (curve.controlled_amplitude / curve.controlled_amplitude[0]) ** power
            near = slice(0, max(3, np.count_nonzero(growth <= UPDATING.lowest_reach**power)))
            terms = np.column_stack([np.ones_like(growth[near]), growth[near]])
            fitted = np.linalg.lstsq(terms, curve.eigenvalue[near], rcond=None)[0]
            parts.append(float(fitted[1]))
            left += float(np.sum((curve.eigenvalue[near] - terms @ fitted) ** 2))
            freedom += len(terms) - 2
            spread += float(np.linalg.inv(terms.T @ terms)[1, 1]) / len(curves) ** 2
        part, variance = float(np.mean(parts)), spread * left / freedom
        found.append((left, float(np.sign(part) * np.sqrt(max(part**2 - variance, 0.0)))))
    usual, best = found[0], min(found)
    least = float(fisher.isf(UPDATING.lowest_chance, freedom, freedom))
    return usual[1] if usual[0] < least * best[0] else best[1]


def _find_variation(mode: int, eigenvalue: FloatArray, cov: OneCov) -> float:
    if not isinstance(cov, str):
        return require_positive(f"cov of mode {mode}", cov)
    if eigenvalue.size < 2:
        raise InputError(f"mode {mode} has one backbone, which has no scatter: give cov of its eigenvalue")
    spread = float(eigenvalue.std(ddof=1) / eigenvalue.mean())
    if spread <= 0:
        raise InputError(f"all backbones of mode {mode} begin at the same frequency: give cov of its eigenvalue")
    return spread


def _pick_mode(
    given: OneCov | OneShapeStd | Mapping[int, OneCov] | Mapping[int, OneShapeStd], mode: int, usual: str
) -> Any:
    return given.get(mode, usual) if isinstance(given, Mapping) else given
