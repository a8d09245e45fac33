"""Separable least squares: only the inner parameters of a law are searched; what enters linearly is solved for.

    y = sum_j w_j c_j + sum_i A_i g_i(z, v; inner parameters of term i)

For given inner parameters (scales, lags, exponents) the weights w and the amplitudes A follow from linear least squares
(variable projection, Golub & Pereyra 1973). The search over the inner parameters uses the derivative of Kaufman (1975).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.mechanics.laws import Law, Parameter, Term
from opid.signals.recording import FloatArray
from opid.suspensions.law_parameters import reference


@dataclass(frozen=True)
class SeparableSettings:
    """Where inner parameters are searched.

    Args:
        beyond_seen: a scale is searched from the least that can be seen (`Parameter.over_rms`) to this many times the
            largest: there a friction is a straight line and a gas spring a parabola.
        exponents: least and largest exponent: 0.1 is nearly dry friction, and beyond 6 a power is a wall.
        start_fractions: fractions of the largest scale that can be seen from which a scale is searched: of a friction
            0.1, 0.4 and 1.5 rms velocities, of a gas column 10, 40 and 150 rms travels.
    """

    beyond_seen: float = 10.0
    exponents: tuple[float, float] = (0.1, 6.0)
    start_fractions: tuple[float, ...] = (1 / 30, 2 / 15, 1 / 2)


DEFAULTS = SeparableSettings()


@dataclass(frozen=True, eq=False)
class SeparableFit:
    """A law fitted beside columns that enter linearly.

    Args:
        weights: (n_columns,) of the columns.
        law: with the fitted values.
        residual: (n,) y minus the fit.
        at_bound: for each entry of `law.vector`, whether its search ended at a bound.
    """

    weights: FloatArray
    law: Law
    residual: FloatArray
    at_bound: tuple[bool, ...]


def separable_fit(
    columns: FloatArray,
    law: Law,
    z: FloatArray,
    v: FloatArray,
    y: FloatArray,
    *,
    starts: Sequence[Law] | None = None,
    free_exponents: bool = False,
    settings: SeparableSettings = DEFAULTS,
) -> SeparableFit:
    """Return the least-squares fit of the columns and the law to `y`.

    Args:
        columns: (n, n_columns) what enters linearly beside the law.
        law: its terms say what is fitted.
        z: (n,) travel, m.
        v: (n,) velocity, m/s.
        y: (n,) what is fitted.
        starts: laws of the same terms whose inner parameters the search starts from; None for `start_laws`.
        free_exponents: whether exponents are searched too; otherwise they stay at the first start.
        settings: where inner parameters are searched.

    >>> z = np.linspace(-1.0, 1.0, 201)
    >>> friction = Law((Term("arctan_velocity", (3.0, 0.2)),))
    >>> fit = separable_fit(z[:, np.newaxis], friction, z, np.sin(9 * z), 5 * z + friction.force(z, np.sin(9 * z)))
    >>> np.round([*fit.weights, *fit.law.vector], 6).tolist()
    [5.0, 3.0, 0.2]
    """
    from scipy import optimize

    starts = starts or start_laws(law, z, v, settings)
    free = inner_indices(law, free_exponents=free_exponents)
    if not free:
        return _fitted(columns, starts[0], free, np.empty(0), z, v, y, (np.empty(0), np.empty(0)))
    bounds = _search_bounds(law, free, z, v, settings)
    # least_squares asks for the residual and then for its derivative at the same point
    last: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def solved(inner: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = inner.tobytes()
        if key not in last:
            last.clear()
            last[key] = _projected(columns, _with_inner(starts[0], free, inner), free, z, v, y)
        return last[key]

    solutions = []
    for start in starts:
        inner = np.clip(_encode(start, free), *bounds)
        if np.isfinite(solved(inner)[0]).all():
            solutions.append(
                optimize.least_squares(
                    lambda inner: solved(inner)[0],
                    inner,
                    jac=lambda inner: solved(inner)[1],
                    bounds=bounds,
                    x_scale=0.5,
                    xtol=1e-7,
                    ftol=1e-7,
                    method="dogbox",
                )
            )
    if not solutions:  # no start lies where the law is defined: the straight columns alone
        return _fitted(columns, starts[0].scaled(0.0), free, _encode(starts[0], free), z, v, y, bounds)
    best = min(solutions, key=lambda solution: solution.cost).x
    return _fitted(columns, starts[0], free, best, z, v, y, bounds)


def unit_law(law: Law) -> Law:
    """Return the law with every amplitude 1, so that its `parameter_gradient` holds the basis.

    Args:
        law: any law.

    >>> unit_law(Law((Term("arctan_velocity", (400.0, 0.02)),))).vector.tolist()
    [1.0, 0.02]
    """
    return Law(tuple(Term(term.name, (1.0, *term.inner)) for term in law.terms))


def inner_indices(law: Law, *, free_exponents: bool = False) -> list[int]:
    """Return the indices in `law.vector` of what is searched: scales and lags, and exponents if they are free."""
    fixed = ("amplitude",) if free_exponents else ("amplitude", "exponent")
    return [k for k, parameter in enumerate(law.parameter_list) if parameter.role not in fixed]


def start_laws(law: Law, z: FloatArray, v: FloatArray, settings: SeparableSettings = DEFAULTS) -> list[Law]:
    """Return the law with its scales at each fraction of the largest that the motion shows, lags at the rms ratio."""
    starts = []
    for fraction in settings.start_fractions:
        vector = law.vector.copy()
        for k in inner_indices(law):
            parameter = law.parameter_list[k]
            reference = _reference(parameter, z, v)
            vector[k] = fraction * parameter.over_rms[1] * reference if _positive(parameter) else reference
        starts.append(law.with_vector(vector))
    return list(dict.fromkeys(starts))


def independent_samples(residual: FloatArray) -> float:
    """Return the samples over the integrated autocorrelation time (the first negative value ends the sum).

    Args:
        residual: (n,) in order of time.

    >>> white = np.random.default_rng(0).standard_normal(20000)
    >>> slow = np.repeat(white[:2000], 10)
    >>> bool(17000 < independent_samples(white) <= 20000), bool(1700 < independent_samples(slow) < 2300)
    (True, True)
    """
    from scipy import signal

    centred = residual - residual.mean()
    power = float(centred @ centred)
    if power == 0 or residual.size < 4:
        return float(residual.size)
    correlation = signal.correlate(centred, centred, method="fft")[residual.size - 1 :] / power
    negative = np.flatnonzero(correlation < 0)
    stop = int(negative[0]) if negative.size else residual.size
    return float(residual.size / max(1.0, 1 + 2 * float(np.sum(correlation[1:stop]))))


def _projected(
    columns: FloatArray, shapes: Law, free: list[int], z: FloatArray, v: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the residual for given inner parameters and its derivative by them, as `_encode` moves them."""
    gradient = unit_law(shapes).parameter_gradient(z, v)
    if not np.isfinite(gradient).all():
        return np.full(y.size, np.nan), np.zeros((y.size, len(free)))
    q, weights = _linear(columns, shapes, gradient, y)
    basis = np.concatenate([columns, gradient[:, _amplitudes(shapes)]], axis=1)
    residual = y - basis @ weights
    owner = np.cumsum([parameter.role == "amplitude" for parameter in shapes.parameter_list]) - 1
    slopes = np.stack([gradient[:, k] * weights[columns.shape[1] + owner[k]] * _stretch(shapes, k) for k in free], 1)
    return residual, q @ (q.T @ slopes) - slopes


def _linear(columns: FloatArray, law: Law, gradient: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    basis = np.concatenate([columns, gradient[:, _amplitudes(law)]], axis=1)
    scale = np.maximum(np.sqrt(np.mean(basis**2, axis=0)), 1e-300)
    q, r = np.linalg.qr(basis / scale)
    return q, np.linalg.lstsq(r, q.T @ y, rcond=1e-12)[0] / scale


def _fitted(
    columns: FloatArray,
    law: Law,
    free: list[int],
    inner: FloatArray,
    z: FloatArray,
    v: FloatArray,
    y: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
) -> SeparableFit:
    shapes = unit_law(_with_inner(law, free, inner))
    gradient = shapes.parameter_gradient(z, v)
    defined = bool(np.isfinite(gradient).all())
    _, weights = _linear(columns, shapes, gradient if defined else np.zeros_like(gradient), y)
    n_columns = columns.shape[1]
    amplitudes = iter(weights[n_columns:].tolist())
    fitted = Law(tuple(Term(term.name, (next(amplitudes), *term.inner)) for term in shapes.terms))
    residual = y - columns @ weights[:n_columns] - (fitted.force(z, v) if defined else 0.0)
    at_bound = np.zeros(fitted.vector.size, dtype=bool)
    at_bound[free] = np.isclose(inner, bounds[0], atol=1e-3) | np.isclose(inner, bounds[1], atol=1e-3)
    return SeparableFit(weights[:n_columns], fitted, residual, tuple(at_bound.tolist()))


def _amplitudes(law: Law) -> list[int]:
    return [k for k, parameter in enumerate(law.parameter_list) if parameter.role == "amplitude"]


def _positive(parameter: Parameter) -> bool:
    return parameter.role != "lag"


def _stretch(law: Law, k: int) -> float:
    """Return the derivative of an inner parameter by what the search moves: positive ones move as logarithms."""
    return float(law.vector[k]) if _positive(law.parameter_list[k]) else 1.0


def _encode(law: Law, free: list[int]) -> FloatArray:
    """Positive parameters as logarithms (they spread over decades), lags as they are."""
    return np.array([np.log(law.vector[k]) if _positive(law.parameter_list[k]) else law.vector[k] for k in free])


def _with_inner(law: Law, free: list[int], inner: FloatArray) -> Law:
    vector = law.vector.copy()
    for k, value in zip(free, inner, strict=True):
        vector[k] = np.exp(value) if _positive(law.parameter_list[k]) else value
    return law.with_vector(vector)


def _reference(parameter: Parameter, z: FloatArray, v: FloatArray) -> float:
    """Return the rms motion that an inner parameter is to be compared with."""
    return reference(parameter, *(float(np.sqrt(np.mean(values**2))) for values in (z, v)))


def _search_bounds(
    law: Law, free: list[int], z: FloatArray, v: FloatArray, settings: SeparableSettings
) -> tuple[FloatArray, FloatArray]:
    lower, upper = [], []
    for k in free:
        parameter = law.parameter_list[k]
        reference = 1.0 if parameter.role == "exponent" else _reference(parameter, z, v)
        seen = (parameter.over_rms[0], settings.beyond_seen * parameter.over_rms[1])
        least, most = settings.exponents if parameter.role == "exponent" else seen
        lower.append(np.log(least * reference) if _positive(parameter) else -most * reference)
        upper.append(np.log(most * reference) if _positive(parameter) else most * reference)
    return np.array(lower), np.array(upper)
