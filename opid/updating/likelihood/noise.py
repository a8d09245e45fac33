"""Errors of measured backbones: the settings for them, and a noise model whose levels are integrated out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError
from opid.signals.recording import FloatArray

LINEAR_ERROR_GROWTH = 0.3
"""The growth of the linear error of a structure that is known by its modes alone. On the wing-engine structure 91 of
100 intervals then hold the coefficient if the linear error is one of the moduli; if it is one of the modal eigenvalues,
nearly all do, for they are too wide."""

UNMENDED_GROWTH = 0.22
"""The growth of an error that no stiffness factor can correct, beside the error that phase I leaves in the factors. An
error of a modal eigenvalue grows by 0.02 and 0.1 in the two modes of the wing-engine structure, more where modes
interact."""

RATIOS = np.geomspace(0.03, 100.0, 24)  # standard deviation of a curve's offset over that of a point: grid of the sum
OWN_WEIGHT = 0.5  # shape of the inverse gamma prior of the variance of a point, which counts as much as one point


@dataclass(frozen=True)
class NoiseSettings:
    """Settings for the errors of backbones.

    The first three serve both phases of the paper's forms and of "independent". The others, from `linear_error` on,
    serve the recommended form; phase I of "independent" uses `linear_error`, too.

    Args:
        weight: weight w_m of every mode (Song eqs. 5 and 6), or of each mode by its number, 1 where left out: a mode
            of twice the weight has errors twice as large.
        cov: coefficient of variation of lambda by the number of the mode; from the curves of each mode where None.
        shape_factor: sigma_phi over w CoV; the square root of the number of sensors where None (Song eq. 6).
        linear_error: standard deviation of the relative error of a linear frequency of the model.
        linear_error_growth: growth of that error of lambda while the nonlinearity doubles lambda, relative to the error
            itself: 0 for an error of the modal eigenvalue, 0.5 and 0.1 for errors of the moduli in the two modes of
            the wing-engine structure. Where None, a structure of parts tells it for each mode, by the errors of their
            stiffness that phase I leaves (`opid.updating.linear_updating`) or, without phase I, by an error of each
            part, and 0.22 for others; elsewhere 0.3.
        point_noise: expected relative error of a measured frequency; the actual error is inferred, and this value
            counts as much as one point.
        curve_offset: expected relative offset of the frequencies of a curve (imperfect quadrature); the actual offset
            is inferred, with a half normal prior of twice this scale.
        day_offset: standard deviation of a relative offset of the frequencies that all curves of a test day have in
            common, where the study names the days: temperature, and a structure that was mounted anew.
        curve_growth: growth of the offset of a curve while lambda doubles, in units of the noise of a point.
        linear_shape_error: standard deviation of the error of a linear shape of unit length at each sensor, for phase
            II only: in phase I the inferred scatter of the shapes includes the errors of the model.
        shape_noise: expected error of a measured shape of unit length at each sensor; it counts as much as one point.
        shape_offset: expected offset of the shapes of a curve at each sensor; the actual offset is inferred.
        shapes: whether the shapes are used at all.
        force_error: standard deviation of the relative error that the work of the force has at all points: calibration
            of force and motion.
        energy_error: standard deviation of the relative error of the energy that the model loses in a mode at an
            amplitude, for its shape has an error.
        force_floor: standard deviation of an error of the force that does not grow with it (hum, cables, friction of
            the shaker), as a fraction of the largest force of the mode.
        force_noise: expected relative error of the work of the force at a point; it counts as much as one point.
        force_offset: expected relative offset of the work along a curve (a phase that is not that of the mode); the
            actual offset is inferred.
        motion_error: standard deviation of the relative error of the amplitudes of each controlled sensor, alike in all
            of its curves: its calibration. 0 takes the amplitudes as exact.
        harmonic_error: standard deviation of a relative error that all points of a sensor have in one of its higher
            harmonics: calibration there, and the motion that the force makes beside the backbone.
        harmonic_noise: standard deviation of a higher harmonic at a point, as a fraction of the largest first harmonic
            of all sensors: noise, and distortion of sensor and shaker.

    Raises:
        InputError: a number that is not positive; the two growths and `motion_error` may be 0.
    """

    weight: float | Mapping[int, float] = 1.0
    cov: Mapping[int, float] | None = None
    shape_factor: float | None = None
    linear_error: float = 0.004
    linear_error_growth: float | None = None
    point_noise: float = 0.0005
    curve_offset: float = 0.003
    day_offset: float = 0.001
    curve_growth: float = 3.0
    linear_shape_error: float = 0.02
    shape_noise: float = 0.003
    shape_offset: float = 0.003
    shapes: bool = True
    force_error: float = 0.02
    energy_error: float = 0.01
    force_floor: float = 0.002
    force_noise: float = 0.005
    force_offset: float = 0.01
    motion_error: float = 0.01
    harmonic_error: float = 0.02
    harmonic_noise: float = 1e-4

    def __post_init__(self) -> None:
        given = vars(self) | {f"cov of mode {mode}": value for mode, value in (self.cov or {}).items()}
        if isinstance(self.weight, Mapping):
            given |= {f"weight of mode {mode}": value for mode, value in self.weight.items()}
        for name, value in given.items():
            if value is None or isinstance(value, Mapping) or name == "shapes":
                continue
            may_be_0 = name in ("linear_error_growth", "curve_growth", "motion_error")
            if not (np.isfinite(value) and (value > 0 or (may_be_0 and value == 0))):
                raise InputError(f"{name} is {value}: give {'0 or more' if may_be_0 else 'a positive number'}")

    def weight_of(self, mode: int) -> float:
        """Return the weight w_m of a mode, by its number from 1."""
        return self.weight.get(mode, 1.0) if isinstance(self.weight, Mapping) else self.weight

    @property
    def growth_of_linear_error(self) -> float:
        """`linear_error_growth`, or its value where it is not known."""
        return LINEAR_ERROR_GROWTH if self.linear_error_growth is None else self.linear_error_growth

    @property
    def stated_for_papers(self) -> tuple[str, ...]:
        """Names of the settings that are stated and that the recommended form does not use."""
        unused = {"weight": 1.0, "cov": None, "shape_factor": None}
        return tuple(name for name, default in unused.items() if getattr(self, name) != default)


@dataclass(frozen=True, eq=False)
class Days:
    """The offsets of test days, which are independent, as a mean and orthonormal contrasts.

    Args:
        std: standard deviation of the offset of a day, in units of that of the common errors.
        constant: size of a constant error that also holds the mean offset of the days, in that unit.
        contrasts: (n_points, n_days - 1) patterns of the differences between the days, in that unit.
    """

    std: float
    constant: float
    contrasts: FloatArray

    @staticmethod
    def of(day: NDArray[np.int64], std: float) -> Days:
        """Return the offsets of the days of points, (n_points,), numbered from 0.

        >>> days = Days.of(np.array([0, 0, 1]), 0.5)
        >>> both = np.column_stack([np.full(3, days.constant), days.contrasts])
        >>> np.round(both @ both.T, 6).tolist()  # 1, and 0.25 more on the same day
        [[1.25, 1.25, 1.0], [1.25, 1.25, 1.0], [1.0, 1.0, 1.25]]
        """
        n = int(day.max()) + 1 if std > 0.0 else 1
        # Any orthonormal columns across the mean are contrasts.
        across = np.linalg.qr(np.column_stack([np.ones(n), np.eye(n)[:, : n - 1]]))[0][:, 1:]
        return Days(std, float(np.sqrt(1.0 + std**2 / n)), std * across[day if n > 1 else np.zeros_like(day)])


@dataclass(frozen=True, eq=False)
class CurveNoise:
    """Measured curves with their errors, in coordinates in which the covariance is diagonal.

    The error of point j of curve c is  sum_k b_k g_kj  +  o_c + p_c (h_j - mean h of c)  +  e_cj: the common error of
    all curves, of patterns g_k with Gaussian b_k, the first two of which are 1 and h; the last ones may be contrasts
    between test days, whose mean offset is a part of the first; the offset of a curve, of
    standard deviation rho sigma; its growth, of a fixed multiple of sigma; the noise of a point, of standard deviation
    sigma. h is the growth of the quantity by the nonlinearity. If the growths were as free as the offsets, all curves
    of a wrong law would take the slope that the law lacks. Of each ratio rho the common errors are turned so that they
    are independent given the data.
    """

    data: FloatArray  # (n_coordinates, n_channels) measured values in these coordinates
    model: FloatArray  # (n_coordinates, n_nodes) matrix that takes the model's values at its nodes to them
    outside: FloatArray  # (n_channels,) sum of squares of the part that no model and no offset can explain
    n_points: int  # number of all points
    shrink: FloatArray  # (n_coordinates, n_ratios) inverse of the variance in units of sigma^2, for each ratio rho
    common: FloatArray  # (n_coordinates, n_common n_ratios) generalised least squares of the turned b, for each ratio
    precision: FloatArray  # (n_common, n_ratios) precision of the turned b, 1 / sigma^2
    turn: FloatArray  # (n_ratios, n_common, n_common) takes the turned b to b
    constant: FloatArray  # (n_ratios,) part of the log density that depends on neither model nor data
    common_variance: float  # prior variance of every b in its own unit
    common_scale: float  # unit of b_1
    # (1 + n_patterns, n_points) growth h of each point, and the patterns of the other common errors there
    patterns: FloatArray
    days: Days  # the offsets of test days
    own_growth: float  # standard deviation of p_c over sigma
    expected: FloatArray  # (n_channels,) scale of the prior of sigma^2
    offset: float  # expected rho sigma


def curve_noise(
    values: FloatArray,
    between: FloatArray,
    curve: NDArray[np.int64],
    growth: FloatArray,
    *,
    common_std: float,
    common_growth: float,
    own_growth: float,
    offset: float,
    expected: float,
    patterns: FloatArray | None = None,
    day: NDArray[np.int64] | None = None,
    day_std: float = 0.0,
) -> CurveNoise:
    """Return the noise model of measured curves, (n_points, n_channels); channels have offsets and levels of their own.

    `between`, (n_points, n_nodes), takes values at the nodes of the model to the points, `curve`, (n_points,), numbers
    their curves from 0, and `growth`, (n_points,), is h, 0 in the linear range. `common_std` is the prior standard
    deviation of b_0, `common_growth` that of b_1 in units of it. `patterns`, (n_points, n_patterns), are those of
    further common errors in units of `common_std`. `offset` and `expected` are the expected standard deviations of a
    curve's offset and of a point's noise. `day`, (n_points,), numbers the test days from 0, if they are known, and
    `day_std` is the standard deviation of the offset of a day.
    """
    others = np.empty((len(growth), 0)) if patterns is None else patterns
    days = Days.of(np.zeros(len(growth), dtype=np.int64) if day is None else day, day_std / common_std)
    others = np.column_stack([others, days.contrasts])
    offsets = np.eye(int(curve[-1]) + 1)[curve]
    centred = growth - offsets @ ((offsets.T @ growth) / offsets.sum(axis=0))
    # Offsets and growths of all curves are orthogonal, so that every ratio has the same basis.
    own = np.concatenate([offsets, offsets * centred[:, None]], axis=1)
    square = (own**2).sum(axis=0)
    seen = square > 1e-12 * len(values)
    left = own[:, seen] / np.sqrt(square[seen])
    # The pull of a mode that is met is no polynomial, as the model between its nodes is.
    spanned = np.column_stack([between, others])
    remainder = spanned - left @ (left.T @ spanned)
    other, size, _ = np.linalg.svd(remainder, full_matrices=False)
    basis = np.concatenate([left, other[:, size > 1e-9 * np.linalg.norm(between)]], axis=1)
    of_offsets, of_growths = np.zeros((2, basis.shape[1]))
    n_curves = offsets.shape[1]
    of_offsets[:n_curves] = square[:n_curves]
    of_growths[n_curves : left.shape[1]] = square[n_curves:][seen[n_curves:]]
    shrink = 1 / (1 + np.outer(of_offsets, RATIOS**2) + own_growth**2 * of_growths[:, None])
    # A prior width of 0 would make the matrices singular: a tiny one leaves the slope out, too.
    scale = max(common_growth, 1e-6)
    together = basis.T @ np.column_stack([np.full_like(growth, days.constant), scale * growth, others])
    precision, turn = np.linalg.eigh(np.einsum("ka,kg,kb->gab", together, shrink, together))
    common = np.einsum("gab,ka,kg->kbg", turn, together, shrink) / precision.T
    n_points = len(values)
    step = float(np.log(RATIOS[1] / RATIOS[0]))
    constant = 0.5 * np.log(shrink).sum(axis=0) - 0.5 * np.log(precision).sum(axis=1) + np.log(step)
    rotated = basis.T @ values
    outside = ((values - basis @ rotated) ** 2).sum(axis=0)
    return CurveNoise(
        rotated, basis.T @ between, outside, n_points, shrink, common.reshape(len(shrink), -1), precision.T, turn,
        constant, common_std**2, scale, np.column_stack([growth, others]).T, days, own_growth,
        np.full(values.shape[1], OWN_WEIGHT * expected**2), offset,
    )  # fmt: skip


def log_marginal(noise: CurveNoise, model: FloatArray) -> FloatArray:
    """Return the logarithm of the density of the measured curves given the model, (n,), all errors integrated out.

    Given the ratio rho, sigma^2 has an inverse gamma prior and is integrated in closed form. So is b: its posterior
    under a flat prior is taken as Gaussian and multiplied by its prior (right up to terms of 1 / n_points). The density
    is summed over a grid of ratios that is even in the logarithm, for each channel by itself.

    The model has the shape (n, n_nodes, n_channels).
    """
    return _add_ratios(noise, _weigh_ratios(noise, model)[0]).sum(axis=-1)


def _add_ratios(noise: CurveNoise, each: FloatArray) -> FloatArray:
    """Return the log density of each channel, (n, n_channels), from that of each ratio up to constants."""
    from scipy.special import gammaln

    shape = _find_gamma_shape(noise)
    constant = OWN_WEIGHT * np.log(noise.expected) + gammaln(shape) - gammaln(OWN_WEIGHT)
    constant = constant - 0.5 * noise.n_points * np.log(2 * np.pi)
    # scipy's logsumexp takes ten times as long for so few numbers.
    top = each.max(axis=2)
    total = top + np.log(np.exp(each - top[..., None]).sum(axis=2))
    summed: FloatArray = total + constant
    return summed


def log_marginal_slopes(noise: CurveNoise, model: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return `log_marginal`, (n,), and its derivatives by the values of the model, (n, n_nodes, n_channels)."""
    each, common, rate = _weigh_ratios(noise, model)
    density = _add_ratios(noise, each).sum(axis=-1)
    left = (noise.data - noise.model @ model).swapaxes(1, 2)
    shape = _find_gamma_shape(noise)
    variance = (rate / shape)[:, :, None] / noise.precision + noise.common_variance
    # by the rate of sigma^2 of each ratio: of the prior of rho sigma, of the power of the rate, and of the prior of b
    own = rate / shape * RATIOS**2 / (2 * noise.offset) ** 2
    of_prior = ((1 / variance - common**2 / variance**2) / noise.precision).sum(axis=2) / shape
    by_rate = (0.5 - 0.5 * own - shape) / rate - 0.5 * of_prior
    weight = np.exp(each - each.max(axis=2, keepdims=True))
    weight = weight / weight.sum(axis=2, keepdims=True)
    # The rate and b of each ratio follow from what the model leaves of the data.
    by_common = weight[:, :, None] * (-common / variance - by_rate[:, :, None] * noise.precision * common)
    by_left = left * ((weight * by_rate) @ noise.shrink.T)
    by_left = by_left + by_common.reshape(*by_common.shape[:2], -1) @ noise.common.T
    return density, -np.einsum("kj,nck->njc", noise.model, by_left)


def draw_errors(
    noise: CurveNoise, model: FloatArray, growth: FloatArray, rng: np.random.Generator, *, has_noise: bool = True
) -> FloatArray:
    """Return errors of a further curve given the measured ones, (n, n_new, n_channels).

    For each row of the model, (n, n_nodes, n_channels), a ratio, a noise level and the common errors of each channel
    are drawn from their posterior, then the offsets of a new curve and of its day and, if it has noise, that of its
    points. The errors are to be added to the model's values where its growth is h, (n, n_new).
    """
    each, common, rate = _weigh_ratios(noise, model)
    ratio = np.argmax(each + rng.gumbel(size=each.shape), axis=2)
    chosen = ratio[:, :, np.newaxis]
    sigma2 = np.take_along_axis(rate, chosen, axis=2)[..., 0] / rng.gamma(_find_gamma_shape(noise), size=ratio.shape)
    flat = noise.precision.T[ratio] / sigma2[..., np.newaxis]
    precision = flat + 1 / noise.common_variance
    fitted = np.take_along_axis(common, chosen[:, :, np.newaxis], axis=3)[..., 0]
    turned = flat * fitted / precision + rng.standard_normal(flat.shape) / np.sqrt(precision)
    b = np.einsum("ncab,ncb->nca", noise.turn[ratio], turned)
    sigma = np.sqrt(sigma2)
    offset = sigma * RATIOS[ratio] * rng.standard_normal(ratio.shape)
    slope = noise.own_growth * sigma * rng.standard_normal(ratio.shape)
    points = has_noise * sigma[:, np.newaxis] * rng.standard_normal((*growth.shape, ratio.shape[1]))
    centred = growth - growth.mean(axis=1, keepdims=True)
    n_contrasts = noise.days.contrasts.shape[1]
    known = noise.patterns[: len(noise.patterns) - n_contrasts, np.argsort(noise.patterns[0])]
    others = [np.interp(growth, known[0], pattern) for pattern in known[1:]]
    constant = np.full_like(growth, noise.days.constant)
    patterns = np.stack([constant, noise.common_scale * growth, *others], axis=2)
    if noise.days.std > 0.0:
        # the new day beside the mean of the measured ones, which is in the common error
        of_day = noise.days.std * np.sqrt(noise.common_variance * (1.0 + 1.0 / (1 + n_contrasts)))
        offset = offset + of_day * rng.standard_normal(offset.shape)
    own: FloatArray = offset[:, np.newaxis] + centred[..., np.newaxis] * slope[:, np.newaxis] + points
    return np.einsum("nca,nja->njc", b[..., : patterns.shape[2]], patterns) + own


def draw_linear_errors(patterns: FloatArray, n_channels: int, std: float, rng: np.random.Generator) -> FloatArray:
    """Return common errors sum_k b_k g_k of a mode or sensor of which nothing was measured, (n, n_new, n_channels).

    `patterns`, (n, n_new, n_patterns), are the g_k, and `std` is the prior standard deviation of every b_k.
    """
    b = std * rng.standard_normal((len(patterns), patterns.shape[2], n_channels))
    errors: FloatArray = patterns @ b
    return errors


def draw_set(
    noise: CurveNoise,
    model: FloatArray,
    between: FloatArray,
    curve: NDArray[np.int64],
    growth: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Return the values of a new set of curves, as many and as long as the measured ones, (n_points, n_channels).

    The levels of noise are drawn from their posterior given the measured curves, the common errors from their prior: it
    is another structure of the same kind in another test. `model`, (n_nodes, n_channels), are the values of the model
    at its nodes; `between`, `curve` and `growth` are those of `curve_noise`.
    """
    each, _, rate = (part[0] for part in _weigh_ratios(noise, model[np.newaxis]))
    channels = np.arange(len(each))
    ratio = np.argmax(each + rng.gumbel(size=each.shape), axis=1)
    sigma = np.sqrt(rate[channels, ratio] / rng.gamma(_find_gamma_shape(noise), size=channels.size))
    constant = np.full_like(growth, noise.days.constant)
    patterns = np.column_stack([constant, noise.common_scale * growth, *noise.patterns[1:]])
    common = patterns @ (np.sqrt(noise.common_variance) * rng.standard_normal((patterns.shape[1], channels.size)))
    of_curve = np.eye(int(curve[-1]) + 1)[curve]
    centred = growth - of_curve @ ((of_curve.T @ growth) / of_curve.sum(axis=0))
    offset, slope = sigma * RATIOS[ratio], noise.own_growth * sigma
    own = of_curve @ (offset * rng.standard_normal((of_curve.shape[1], channels.size)))
    own += (of_curve @ (slope * rng.standard_normal((of_curve.shape[1], channels.size)))) * centred[:, None]
    values: FloatArray = between @ model + common + own + sigma * rng.standard_normal((len(growth), channels.size))
    return values


def _find_gamma_shape(noise: CurveNoise) -> float:
    """Return the shape of the inverse gamma posterior of sigma^2, of which each b takes a degree of freedom."""
    return OWN_WEIGHT + (noise.n_points - len(noise.precision)) / 2


def _weigh_ratios(noise: CurveNoise, model: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return for each ratio the log density up to constants, the turned b by least squares, and the rate of sigma^2.

    Shapes (n, n_channels, n_ratios), (n, n_channels, n_common, n_ratios) and (n, n_channels, n_ratios); the rate is
    that of the inverse gamma posterior.
    """
    left = (noise.data - noise.model @ model).swapaxes(1, 2)
    shape = _find_gamma_shape(noise)
    common = (left @ noise.common).reshape(*left.shape[:2], *noise.precision.shape)
    square = common**2
    explained = (noise.precision * square).sum(axis=2)
    rate = noise.expected[:, None] + 0.5 * np.maximum(left**2 @ noise.shrink + noise.outside[:, None] - explained, 0.0)
    sigma2 = rate / shape
    # the variance of b under a flat prior plus that of the prior
    variance = sigma2[:, :, None] / noise.precision + noise.common_variance
    prior = (square / variance + np.log(variance)).sum(axis=2)
    # The half normal prior of rho sigma, at the best sigma, has twice the expected offset as its scale.
    scaled = RATIOS / (2 * noise.offset)
    constant = noise.constant + np.log(scaled) + 0.5 * np.log(2 / np.pi) - shape * np.log(shape)
    return constant + (0.5 - shape) * np.log(sigma2) - 0.5 * (sigma2 * scaled**2 + prior), common, rate
