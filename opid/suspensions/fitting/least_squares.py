"""General least squares: bounded steps, laws that are linear in their amplitudes, and covariances.

Steps are those of Levenberg (1944) and Marquardt (1963), with few evaluations. In separable least squares only the
inner parameters of a law are searched; the parameters that enter linearly are solved for.

    y = sum_j w_j c_j + sum_i A_i g_i(motion; inner parameters of term i)

For given inner parameters (scales, lags, exponents) the weights w, the amplitudes A and the initial values of memories
follow from linear least squares (variable projection, Golub & Pereyra 1973). The search over the inner parameters uses
the derivative of Kaufman (1975).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.laws.law import Law, Parameter, Term
from opid.mechanics.memory import Motion
from opid.signals.recording import FloatArray
from opid.suspensions.model.law_parameters import positive, reference


class Residual(Protocol):
    """Errors, (n,), and their derivatives, (n, n_unknowns)."""

    @property
    def stacked(self) -> FloatArray:
        """(n,) errors."""

    @property
    def jacobian(self) -> FloatArray:
        """(n, n_unknowns) derivatives."""


AnyResidual = TypeVar("AnyResidual", bound=Residual)

_LARGEST_ENTRY = 1e100  # of a column, whose squares a computer still adds up


def least_squares(
    evaluate: Callable[[FloatArray], AnyResidual | None],
    theta: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    caps: FloatArray,
    *,
    free: slice | NDArray[np.int64] = slice(None),
    most_evaluations: int,
    least_promise: float,
    negligible_promise: float,
    first_damping: float,
    least_damping: float,
    first: Callable[[FloatArray], AnyResidual] | None = None,
) -> tuple[FloatArray, AnyResidual | None, int]:
    """Return the vector of least squared error near `theta`, its errors if they are known, and the evaluations spent.

    The last step is taken without an evaluation of its errors. If its expected improvement is negligible, the errors
    before it are returned.

    Args:
        evaluate: returns the errors at a vector; None if there are none.
        theta: (n_unknowns,) start vector.
        lower: (n_unknowns,) lower bounds.
        upper: (n_unknowns,) upper bounds.
        caps: (n_unknowns,) largest change of each entry in one step.
        free: the entries that may move.
        most_evaluations: most evaluations.
        least_promise: the search ends when the next step is expected to lower the squared error over its variance by
            less.
        negligible_promise: a last step with a smaller expected improvement does not change the errors.
        first_damping: damping of the step after one that failed, over the squared norm of each column.
        least_damping: a smaller damping is set to zero.
        first: replaces `evaluate` at the start, and may raise an error.
    """
    lower, upper, caps = lower[free], upper[free], caps[free]
    best = theta.copy()
    best[free] = np.clip(best[free], lower, upper)
    errors = (first or evaluate)(best)
    if errors is None:
        return best, None, 1
    cost, damping, n_data, failed = _compute_cost(errors), 0.0, errors.stacked.size, False
    for spent in range(1, most_evaluations):
        step, promise = _compute_step(errors, free, damping, best[free], lower, upper, caps)
        trial = best.copy()
        trial[free] = np.clip(best[free] + step, lower, upper)
        if promise * n_data < least_promise * cost:
            return trial, errors if promise * n_data < negligible_promise * cost else None, spent
        new = evaluate(trial)
        if new is not None and _compute_cost(new) < cost:
            # After a longer step has failed, the damping is kept: the next longer step may fail as well.
            eased = damping if failed else damping / 10 if damping > least_damping else 0.0
            best, errors, cost, damping, failed = trial, new, _compute_cost(new), eased, False
        else:
            damping, failed = max(10 * damping, first_damping), True
    return best, errors, most_evaluations


def _compute_cost(errors: Residual) -> float:
    return float(errors.stacked @ errors.stacked)


def _compute_step(
    errors: Residual,
    free: slice | NDArray[np.int64],
    damping: float,
    at: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    caps: FloatArray,
) -> tuple[FloatArray, float]:
    """Return the next step of the free entries, and its improvement of the squared error by the linear model."""
    jacobian, residual = errors.jacobian[:, free], errors.stacked
    gradient = jacobian.T @ residual
    # An entry at a bound stays there if the step would go beyond it.
    moving = ~(((at <= lower) & (gradient > 0)) | ((at >= upper) & (gradient < 0)))
    columns = jacobian[:, moving]
    size = np.maximum(np.sqrt(np.sum(columns**2, axis=0)), 1e-300)
    scaled = columns / size
    if damping:
        scaled = np.concatenate([scaled, np.sqrt(damping) * np.eye(size.size)])
        residual = np.concatenate([residual, np.zeros(size.size)])
    step = np.zeros(at.size)
    step[moving] = -np.linalg.lstsq(scaled, residual, rcond=1e-12)[0] / size
    step /= max(1.0, float(np.max(np.abs(step) / caps)))
    ahead = errors.stacked + jacobian @ step
    return step, _compute_cost(errors) - float(ahead @ ahead)


@dataclass(frozen=True)
class SeparableSettings:
    """Ranges in which inner parameters are searched.

    Args:
        beyond_seen: a scale is searched from the smallest one that can be seen (`Parameter.over_rms`) to this many
            times the largest: there a friction is a straight line and a gas column a parabola.
        exponents: smallest and largest exponent of a kind that states none: 0.1 is nearly dry friction, and a power
            above 6 acts like a stop.
        shapes: largest absolute value of a shape; for one in seconds, over the ratio of the rms motions.
        start_fractions: fractions of the largest scale that can be seen at which the search of a scale begins: for a
            friction 0.1, 0.4 and 1.5 rms velocities, for a gas column 10, 40 and 150 rms travels.
    """

    beyond_seen: float = 10.0
    exponents: tuple[float, float] = (0.1, 6.0)
    shapes: float = 10.0
    start_fractions: tuple[float, ...] = (1 / 30, 2 / 15, 1 / 2)


DEFAULTS = SeparableSettings()


@dataclass(frozen=True, eq=False)
class SeparableFit:
    """A law fitted beside columns that enter linearly.

    Args:
        weights: (n_columns,) weights of the columns.
        start_weights: (n_memories,) weights of `Motion.start_columns` of the law.
        law: the law with the fitted values.
        residual: (n,) y minus the fit.
        at_bound: for each entry of `law.vector`, whether its search ended at a bound.
    """

    weights: FloatArray
    start_weights: FloatArray
    law: Law
    residual: FloatArray
    at_bound: tuple[bool, ...]


def fit_separable(
    columns: FloatArray,
    law: Law,
    motion: Motion,
    y: FloatArray,
    *,
    starts: Sequence[Law] | None = None,
    free_exponents: bool = False,
    noise: float = 0.0,
    tolerance: float = 1e-7,
    settings: SeparableSettings = DEFAULTS,
) -> SeparableFit:
    """Return the least-squares fit of the columns and the law to `y`.

    Args:
        columns: (n, n_columns) columns that enter linearly beside the law.
        law: a law with the terms to be fitted.
        motion: (n,) samples at which the law is evaluated.
        y: (n,) values to be fitted.
        starts: laws of the same terms with start values of the inner parameters; None for `start_laws`.
        free_exponents: whether exponents are searched, too; otherwise they stay as in the first start.
        noise: standard deviation of an error, in the unit of `y`; it weights prior knowledge of exponents.
        tolerance: the search ends when the squared error, or the searched vector, changes by a smaller fraction.
        settings: the ranges in which inner parameters are searched.

    >>> z = np.linspace(-1.0, 1.0, 201)
    >>> friction, motion = Law((Term("arctan_velocity", (3.0, 0.2)),)), Motion(z, np.sin(9 * z))
    >>> fit = fit_separable(z[:, np.newaxis], friction, motion, 5 * z + motion.force(friction))
    >>> np.round([*fit.weights, *fit.law.vector], 6).tolist()
    [5.0, 3.0, 0.2]
    """
    from scipy import optimize

    starts = starts or start_laws(law, motion, settings)
    search = _make_search(starts[0], motion, inner_indices(law, free_exponents=free_exponents), settings)
    if not search.free:
        return _make_fit(columns, search, np.empty(0), motion, y)
    # `optimize.least_squares` asks for the residual and then for its derivative at the same point.
    last: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def solve(inner: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = inner.tobytes()
        if key not in last:
            last.clear()
            residual, slopes = _project(columns, search, inner, motion, y)
            departure, by_inner = _compare_with_prior(search, inner, noise)
            last[key] = np.concatenate([residual, departure]), np.concatenate([slopes, by_inner])
        return last[key]

    solutions = []
    for start in starts:
        inner = np.clip(search.encode(start), search.lower, search.upper)
        if np.isfinite(solve(inner)[0]).all():
            solutions.append(
                optimize.least_squares(
                    lambda inner: solve(inner)[0],
                    inner,
                    jac=lambda inner: solve(inner)[1],
                    bounds=(search.lower, search.upper),
                    x_scale=0.5,
                    xtol=tolerance,
                    ftol=tolerance,
                    method="dogbox",
                )
            )
    if not solutions:  # no start lies where the law is defined: the straight columns alone
        return _make_fit(columns, search, search.encode(starts[0]), motion, y)
    best = min(solutions, key=lambda solution: solution.cost).x
    return _make_fit(columns, search, best, motion, y)


def unit_law(law: Law) -> Law:
    """Return the law with every amplitude 1, so that its `parameter_gradient` holds the basis.

    Args:
        law: any law.

    >>> unit_law(Law((Term("arctan_velocity", (400.0, 0.02)),))).vector.tolist()
    [1.0, 0.02]
    """
    return Law(tuple(Term(term.name, (1.0, *term.inner)) for term in law.terms))


def inner_indices(law: Law, *, free_exponents: bool = False) -> list[int]:
    """Return the indices in `law.vector` of the searched entries: scales, lags and shapes, and exponents if free.

    Args:
        law: any law.
        free_exponents: whether exponents are searched too.
    """
    fixed = ("amplitude",) if free_exponents else ("amplitude", "exponent")
    return [k for k, parameter in enumerate(law.parameter_list) if parameter.role not in fixed]


def start_laws(law: Law, motion: Motion, settings: SeparableSettings = DEFAULTS) -> list[Law]:
    """Return the law with its scales at each fraction of the largest one that the motion shows, lags at the rms ratio.

    Exponents and shapes are those of the law.

    Args:
        law: any law.
        motion: the motion that shows it.
        settings: the fractions.
    """
    starts = []
    for fraction in settings.start_fractions:
        vector = law.vector.copy()
        for k, parameter in enumerate(law.parameter_list):
            if parameter.role == "scale":
                vector[k] = fraction * parameter.over_rms[1] * _find_reference(parameter, motion)
            elif parameter.role == "lag":
                vector[k] = _find_reference(parameter, motion)
        starts.append(law.with_vector(vector))
    return list(dict.fromkeys(starts))


def independent_samples(residual: FloatArray) -> float:
    """Return the samples over the integrated autocorrelation time (the first negative value ends the sum).

    Args:
        residual: (n,) residual in the order of time.

    >>> white = np.random.default_rng(0).standard_normal(20000)
    >>> slow = np.repeat(white[:2000], 10)
    >>> bool(17000 < independent_samples(white) <= 20000), bool(1700 < independent_samples(slow) < 2300)
    (True, True)
    """
    from scipy import fft

    centred = residual - residual.mean()
    power = float(centred @ centred)
    if power == 0 or residual.size < 4:
        return float(residual.size)
    # Zeros behind the residual keep its end apart from its start.
    n_lines = fft.next_fast_len(2 * residual.size, real=True)
    correlation = fft.irfft(np.abs(fft.rfft(centred, n_lines)) ** 2, n_lines)[: residual.size] / power
    negative = np.flatnonzero(correlation < 0)
    stop = int(negative[0]) if negative.size else residual.size
    return float(residual.size / max(1.0, 1 + 2 * float(np.sum(correlation[1:stop]))))


@dataclass(frozen=True, eq=False)
class _Search:
    """Inner parameters in the form of the search: positive ones as logarithms, because they vary over decades.

    Args:
        law: a law with the values that are not searched.
        free: indices in `law.vector` of the searched entries.
        size: (n_free,) divisor of each entry that is not a logarithm.
        lower: (n_free,) lower bounds.
        upper: (n_free,) upper bounds.
    """

    law: Law
    free: list[int]
    size: FloatArray
    lower: FloatArray
    upper: FloatArray

    def encode(self, law: Law) -> FloatArray:
        """Return the searched vector of a law."""
        values = law.vector[self.free]
        positive = self._positive
        return np.where(positive, np.log(np.where(positive, values, 1.0)), values / self.size)

    def decode(self, inner: FloatArray) -> Law:
        """Return the law of a searched vector, with unit amplitudes."""
        vector = unit_law(self.law).vector
        positive = self._positive
        vector[self.free] = np.where(positive, np.exp(np.where(positive, inner, 0.0)), inner * self.size)
        return unit_law(self.law).with_vector(vector)

    def stretch(self, law: Law) -> FloatArray:
        """Return the derivatives of the searched entries of a law by the searched vector."""
        return np.where(self._positive, law.vector[self.free], self.size)

    @property
    def _positive(self) -> NDArray[np.bool_]:
        return positive(self.law)[self.free]


def _make_search(law: Law, motion: Motion, free: list[int], settings: SeparableSettings) -> _Search:
    size, bounds = [], []
    for parameter in (law.parameter_list[k] for k in free):
        reference = 1.0 if parameter.unit == "1" else _find_reference(parameter, motion)
        seen = settings.beyond_seen * parameter.over_rms[1]
        size.append(reference)
        if parameter.role == "scale":
            bounds.append(tuple(np.log(np.multiply(reference, (parameter.over_rms[0], seen)))))
        elif parameter.role == "exponent":
            stated = np.isfinite(parameter.within[1])
            bounds.append(tuple(np.log(parameter.within if stated else settings.exponents)))
        else:
            largest = settings.shapes if parameter.role == "shape" else seen
            bounds.append((-largest, largest))
    lower, upper = np.array(bounds).reshape(-1, 2).T
    return _Search(law, free, np.array(size), lower, upper)


def _project(
    columns: FloatArray, search: _Search, inner: FloatArray, motion: Motion, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the residual for a searched vector, and its derivatives by that vector."""
    shapes = search.decode(inner)
    gradient = motion.parameter_gradient(shapes)
    linear = np.concatenate([columns, motion.start_columns(shapes)], axis=1)
    basis = np.concatenate([linear, gradient[:, _list_amplitudes(shapes)]], axis=1)
    if not (_has_squares(gradient) and _has_squares(basis)):
        return np.full(y.size, np.nan), np.zeros((y.size, len(search.free)))
    q, weights = _solve_linear(basis, y)
    residual = y - basis @ weights
    owner = np.cumsum([parameter.role == "amplitude" for parameter in shapes.parameter_list]) - 1
    slopes = gradient[:, search.free] * weights[linear.shape[1] + owner[search.free]] * search.stretch(shapes)
    return residual, q @ (q.T @ slopes) - slopes


def _compare_with_prior(search: _Search, inner: FloatArray, noise: float) -> tuple[FloatArray, FloatArray]:
    """Return the departures of exponents from their prior values, in the unit of a residual, and the derivatives."""
    known = [(k, search.law.parameter_list[index].known) for k, index in enumerate(search.free)]
    rows = [(k, noise * each[0] / each[1], float(np.log(each[0]))) for k, each in known if each is not None]
    slopes = np.zeros((len(rows), inner.size))
    for row, (k, weight, _) in enumerate(rows):
        slopes[row, k] = weight
    return np.array([weight * (inner[k] - mean) for k, weight, mean in rows]), slopes


def _has_squares(columns: FloatArray) -> bool:
    """Return whether all entries are finite, and so small that the sum of their squares is."""
    return bool((np.abs(columns) < _LARGEST_ENTRY).all())


def _solve_linear(basis: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    rms = np.sqrt(np.mean(basis**2, axis=0))
    # Rounding gives a column of zeros a weight, which a tiny scale would make huge.
    scale = np.where(rms > 0.0, rms, 1.0)
    q, r = np.linalg.qr(basis / scale)
    return q, np.linalg.lstsq(r, q.T @ y, rcond=1e-12)[0] / scale


def _make_fit(columns: FloatArray, search: _Search, inner: FloatArray, motion: Motion, y: FloatArray) -> SeparableFit:
    shapes = search.decode(inner)
    gradient = motion.parameter_gradient(shapes)
    own = np.concatenate([motion.start_columns(shapes), gradient[:, _list_amplitudes(shapes)]], axis=1)
    if not _has_squares(own):  # a law that is not defined on the motion is left out of the fit
        own = np.zeros_like(own)
    basis = np.concatenate([columns, own], axis=1)
    _, weights = _solve_linear(basis, y)
    n_columns, n_terms = columns.shape[1], len(shapes.terms)
    straight, start, amplitudes = np.split(weights, [n_columns, weights.size - n_terms])
    terms = zip(shapes.terms, amplitudes.tolist(), strict=True)
    fitted = Law(tuple(Term(term.name, (amplitude, *term.inner)) for term, amplitude in terms))
    at_bound = np.zeros(fitted.vector.size, dtype=bool)
    at_bound[search.free] = np.isclose(inner, search.lower, atol=1e-3) | np.isclose(inner, search.upper, atol=1e-3)
    return SeparableFit(straight, start, fitted, y - basis @ weights, tuple(at_bound.tolist()))


def _list_amplitudes(law: Law) -> list[int]:
    return [k for k, parameter in enumerate(law.parameter_list) if parameter.role == "amplitude"]


def _find_reference(parameter: Parameter, motion: Motion) -> float:
    """Return the rms motion that an inner parameter is compared with."""
    return reference(parameter, *(float(np.sqrt(np.mean(values**2))) for values in (motion.z, motion.v)))


def clustered_covariance(jacobian: FloatArray, residual: FloatArray, cells: NDArray[np.int64]) -> FloatArray:
    """Return the sandwich covariance with scores added up over cells (Liang & Zeger 1986, small-sample factor).

    Within a cell (a stretch of time, a few neighbouring lines) residuals may have any correlation.

    Args:
        jacobian: (n_data, n_parameters).
        residual: (n_data,).
        cells: (n_data,) the cell of each residual.

    >>> rng = np.random.default_rng(0)
    >>> covariance = clustered_covariance(np.ones((4000, 1)), rng.standard_normal(4000), np.arange(4000) // 4)
    >>> round(float(4000 * covariance[0, 0]), 1)
    1.0
    >>> alike = np.ones((4000, 2)) + np.outer(rng.standard_normal(4000), [0.0, 1e-9])
    >>> bool(np.all(np.diag(clustered_covariance(alike, rng.standard_normal(4000), np.arange(4000) // 4)) > 1e14))
    True
    """
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = jacobian / scale
    # The inverse is that of the columns and not of their products, so that parameters that are known a million times
    # less well than others keep their accuracy.
    across, triangle = np.linalg.qr(scaled)
    factor, scores = add_scores(across, residual, cells)
    moved = np.sqrt(factor) * scores @ np.linalg.pinv(triangle, rcond=1e-13).T / scale
    return moved.T @ moved


def add_scores(jacobian: FloatArray, residual: FloatArray, cells: NDArray[np.int64]) -> tuple[float, FloatArray]:
    """Return the small-sample factor, and the scores added up over cells, (n_cells, n_parameters).

    A sandwich is made of the scores and not of their products: as a product of one matrix with itself it has no
    variance below zero where columns are nearly alike.

    >>> add_scores(np.ones((4, 1)), np.array([1.0, 1.0, 1.0, -1.0]), np.array([0, 0, 1, 1]))
    (2.0, array([[2.],
           [0.]]))
    """
    _, index = np.unique(cells, return_inverse=True)
    n_cells, n_parameters = int(index.max()) + 1, jacobian.shape[1]
    scores = np.zeros((n_cells, n_parameters))
    np.add.at(scores, index, jacobian * residual[:, np.newaxis])
    return n_cells / max(n_cells - n_parameters, 1), scores
