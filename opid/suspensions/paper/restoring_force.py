"""Restoring-force surfaces, and laws fitted to their points.

The sprung mass obeys M2 x2'' = -C2 z' - K2 z - K3 x2 - f(z, z') (Iwaniec & Uhl 2007, eq. 2), so -x2'' is the restoring
force per unit mass. Plotted over the travel z and the rate z' it shows the law before any law is assumed (Masri &
Caughey 1979).

The paper models both curves by f/M2 = a z + arctan(d b (z + c z')) (eq. 3): a slope, an amplitude and an inner scale.
There the amplitude is fixed at pi/2 m/s^2, see `fit_slice`; the mended chain fits it. An arctangent can be seen only if
the motion is large enough: below a third of its scale it is a straight line, and only amplitude/scale is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError
from opid.mechanics.laws.law import LAWS, Law, Term, default_law
from opid.mechanics.memory import Motion, recorded_motion
from opid.signals.motion import filter_like, relative_motion
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.least_squares import (
    SeparableFit,
    clustered_covariance,
    fit_separable,
    independent_samples,
    unit_law,
)
from opid.suspensions.paper.settings import DEFAULTS, PaperSettings


@dataclass(frozen=True, eq=False)
class RestoringForce:
    """The scattered restoring-force surface of one run, with one point for each sample.

    Args:
        travel: (n,) relative displacement z = x2 - x1, m.
        velocity: (n,) relative velocity z', m/s.
        force_per_mass: (n,) -x2'' through the same filter, m/s^2.
        fs: sampling rate, Hz.
    """

    travel: FloatArray
    velocity: FloatArray
    force_per_mass: FloatArray
    fs: float

    def thinned(self, n_points: int) -> RestoringForce:
        """Return about `n_points` points at equal steps, enough for start values and for verdicts on terms."""
        step = max(1, self.travel.size // n_points)
        z, v, force = (np.ascontiguousarray(each[::step]) for each in (self.travel, self.velocity, self.force_per_mass))
        return RestoringForce(z, v, force, self.fs / step)


@dataclass(frozen=True, eq=False)
class BinnedSurface:
    """The surface averaged over cells of the plane of travel and velocity.

    Args:
        travel_edges: (n_travel + 1,) m.
        velocity_edges: (n_velocity + 1,) m/s.
        counts: (n_travel, n_velocity) points in each cell.
        mean: (n_travel, n_velocity) mean force per mass, m/s^2; NaN where a cell has too few points.
        scatter: (n_travel, n_velocity) standard deviation within the cell, m/s^2; NaN in the same cells.
        min_count: number of points below which a cell is left empty.
    """

    travel_edges: FloatArray
    velocity_edges: FloatArray
    counts: FloatArray
    mean: FloatArray
    scatter: FloatArray
    min_count: int

    @property
    def visited(self) -> NDArray[np.bool_]:
        """(n_travel, n_velocity) True where a cell has `min_count` points or more."""
        return self.counts >= self.min_count

    @property
    def coverage(self) -> float:
        """Fraction of the cells of the bounding rectangle that were visited."""
        return float(np.mean(self.visited))

    @property
    def centres(self) -> tuple[FloatArray, FloatArray]:
        """Travel and velocity at the middle of each cell, two arrays (n_travel, n_velocity)."""
        travel = (self.travel_edges[1:] + self.travel_edges[:-1]) / 2
        velocity = (self.velocity_edges[1:] + self.velocity_edges[:-1]) / 2
        return tuple(np.meshgrid(travel, velocity, indexing="ij"))  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class SliceCurve:
    """The points of a surface near one axis: the stiffness curve (z' near 0) or the damping curve (z near 0).

    Args:
        along: "travel" (stiffness curve) or "velocity" (damping curve).
        position: (n,) travel in m or velocity in m/s, in the order of time.
        force_per_mass: (n,) m/s^2.
        sample: (n,) index of each point in the run.
        half_width: half width of the slice in the other coordinate, m/s or m.
        fs: sampling rate of the run, Hz.
    """

    along: Literal["travel", "velocity"]
    position: FloatArray
    force_per_mass: FloatArray
    sample: np.ndarray
    half_width: float
    fs: float


def restoring_force(
    unsprung: ArrayLike, sprung: ArrayLike, *, fs: float, high_pass_hz: float = PaperSettings.high_pass_hz
) -> RestoringForce:
    """Return the points (z, z', -x2'') of one run, without the ends in which the filter has not settled.

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        fs: sampling rate, Hz.
        high_pass_hz: as in `opid.signals.integrate`.

    Raises:
        InputError: as `relative_motion`, or a run too short to leave anything once the ends are cut.

    >>> t = np.arange(5120) / 256.0
    >>> surface = restoring_force(np.zeros(t.size), np.cos(12 * t), fs=256.0)
    >>> bool(np.corrcoef(surface.force_per_mass, surface.travel)[0, 1] > 0.999)
    True
    """
    motion = relative_motion(unsprung, sprung, fs=fs, high_pass_hz=high_pass_hz)
    inside = motion.interior
    if motion.displacement[inside].size < fs:
        raise InputError(
            f"the run lasts {motion.displacement.size / fs:.3g} s and the {high_pass_hz:g} Hz high-pass needs "
            f"{2 * motion.settle_s:.3g} s to settle: give a longer run or a higher corner"
        )
    force = -filter_like(sprung, motion)
    return RestoringForce(motion.displacement[inside], motion.velocity[inside], force[inside], float(fs))


def binned_surface(
    surface: RestoringForce,
    *,
    n_travel: int = PaperSettings.n_cells,
    n_velocity: int = PaperSettings.n_cells,
    min_count: int = PaperSettings.least_points_of_cell,
) -> BinnedSurface:
    """Average a scattered surface over the cells of a grid, with counts and scatter.

    Args:
        surface: the points.
        n_travel: cells along the travel.
        n_velocity: cells along the velocity.
        min_count: points below which a cell stays empty.

    Raises:
        InputError: fewer than two cells along an axis, or a surface without extent.

    >>> rng = np.random.default_rng(0)
    >>> z, v = rng.standard_normal((2, 5000))
    >>> grid = binned_surface(RestoringForce(z, v, 3 * z, 100.0), n_travel=9, n_velocity=9)
    >>> grid.counts.sum() == 5000, 0 < grid.coverage < 1
    (np.True_, True)
    """
    if min(n_travel, n_velocity) < 2 or min_count < 1:
        raise InputError(
            f"the grid is {n_travel} x {n_velocity} cells of {min_count} point(s): give 2 x 2 and 1 at least"
        )
    z, v, force = surface.travel, surface.velocity, surface.force_per_mass
    if np.ptp(z) == 0 or np.ptp(v) == 0:
        raise InputError("the surface has no extent in travel or in velocity: the two sensors moved as one")
    grid = (np.linspace(z.min(), z.max(), n_travel + 1), np.linspace(v.min(), v.max(), n_velocity + 1))
    counts, _, _ = np.histogram2d(z, v, bins=grid)
    total, _, _ = np.histogram2d(z, v, bins=grid, weights=force)
    square, _, _ = np.histogram2d(z, v, bins=grid, weights=force**2)
    enough = counts >= min_count
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(enough, total / counts, np.nan)
        scatter = np.sqrt(np.maximum(square / counts - mean**2, 0))
    return BinnedSurface(*grid, counts, mean, scatter, min_count)


def slice_curve(
    surface: RestoringForce,
    *,
    along: Literal["travel", "velocity"],
    half_width_std: float = PaperSettings.slice_half_width,
) -> SliceCurve:
    """Return the points of a surface near an axis.

    Along the travel this is the stiffness curve (z' near 0), along the velocity the damping curve (z near 0).

    Args:
        surface: the points.
        along: "travel" or "velocity".
        half_width_std: half width of the slice over the standard deviation of the other coordinate.

    Raises:
        InputError: an unknown axis, or a slice with fewer than 50 points.

    >>> rng = np.random.default_rng(0)
    >>> z, v = rng.standard_normal((2, 5000))
    >>> slice_curve(RestoringForce(z, v, 3 * z, 100.0), along="travel").position.size > 300
    True
    """
    if along not in ("travel", "velocity"):
        raise InputError(f"along is {along!r}: give 'travel' or 'velocity'")
    position, other = (surface.travel, surface.velocity) if along == "travel" else (surface.velocity, surface.travel)
    half_width = half_width_std * float(other.std())
    sample = np.flatnonzero(np.abs(other) <= half_width)
    if sample.size < 50:
        raise InputError(
            f"{sample.size} samples of the record lie near the axis of the {along}, and at least 50 are needed for its "
            "curve: record longer, or at a higher rate"
        )
    return SliceCurve(along, position[sample], surface.force_per_mass[sample], sample, half_width, surface.fs)


@dataclass(frozen=True, eq=False)
class TermVerdict:
    """How well one term of a law can be distinguished from the linear terms.

    Args:
        name: kind of the term.
        departure: rms departure of the term from its best fit by the linear terms, over its own rms (0: straight).
        evidence: twice the gain in log-likelihood by this term, for independent samples.
        distinguishable: whether the data show the term.
        statement: the same in words.
    """

    name: str
    departure: float
    evidence: float
    distinguishable: bool
    statement: str


@dataclass(frozen=True, eq=False)
class LawFit:
    """A law fitted to restoring-force points, all per unit of sprung mass.

    Args:
        straight: values of the straight terms, `{"stiffness_per_mass": 1/s^2, "damping_per_mass": 1/s,
            "offset": m/s^2}`; a slice curve has only one of the two.
        straight_std: their standard deviations.
        law: the nonlinear terms, amplitudes in m/s^2 (or m/s^2 over the unit of the shape).
        law_std: (n_parameters,) standard deviations in the order of `law.vector`.
        residual: (n,) measured minus fitted, m/s^2.
        verdicts: one for each term of the law.
    """

    straight: dict[str, float]
    straight_std: dict[str, float]
    law: Law
    law_std: FloatArray
    residual: FloatArray
    verdicts: tuple[TermVerdict, ...]

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residual, m/s^2."""
        return float(np.sqrt(np.mean(self.residual**2)))


def fit_slice(
    curve: SliceCurve, *, amplitude_m_per_s2: float | None = None, settings: PaperSettings = DEFAULTS
) -> LawFit:
    """Fit slope, amplitude and inner scale of an arctangent to a slice curve (Figs. 6 and 7 of the paper).

    -x2'' = offset + slope u + A (2/pi) arctan(u/s), u the travel or the velocity. In eq. (3) of the paper A is
    pi/2 m/s^2, the slope is a and 1/s is d b.

    Args:
        curve: the points of the slice.
        amplitude_m_per_s2: A if it is known, m/s^2; it is fitted if left out.
        settings: the time over which residuals are correlated, and the significance of a term.

    >>> u = np.linspace(-0.2, 0.2, 4000)
    >>> y = 3 * u + 0.2 * 2 / np.pi * np.arctan(u / 0.02) + 1e-3 * np.random.default_rng(0).standard_normal(u.size)
    >>> fit = fit_slice(SliceCurve("velocity", u, y, np.arange(u.size), 1e-3, 500.0))
    >>> np.round(fit.law.vector, 3).tolist(), fit.verdicts[0].distinguishable
    ([0.2, 0.02], True)
    """
    u = curve.position
    zero = np.zeros_like(u)
    if curve.along == "travel":
        z, v, name, column = u, zero, "arctan_displacement", "stiffness_per_mass"
    else:
        z, v, name, column = zero, u, "arctan_velocity", "damping_per_mass"
    straight = {column: u, "offset": np.ones_like(u)}
    cluster = curve.sample / (settings.cluster_s * curve.fs)
    motion, y, fit = Motion(z, v), curve.force_per_mass, None
    if amplitude_m_per_s2 is not None:
        fit = _fit_scale(np.stack([u, np.ones_like(u)], axis=1), name, amplitude_m_per_s2, motion, y, settings)
    return _fit(straight, default_law(name), motion, y, cluster, settings, fit)


def fit_surface(
    surface: RestoringForce,
    law_name: str = "arctan_displacement+arctan_velocity",
    *,
    settings: PaperSettings = DEFAULTS,
) -> LawFit:
    """Fit a law to all points of a restoring-force surface.

    -x2'' = offset + (K2/M2) z + (C2/M2) z' + sum_i A_i g_i(z, z'; s_i). A ground spring is not separable here: with
    K3 > 0 the term K3 x2/M2 stays in the residual.

    Args:
        surface: the points.
        law_name: any law of `opid.laws.LAWS` or a sum; "linear" fits the straight terms alone.
        settings: the time over which residuals are correlated, and the significance of a term.

    Raises:
        InputError: an unknown law.

    >>> rng = np.random.default_rng(0)
    >>> z, v = 3e-3 * rng.standard_normal(5000), 0.05 * rng.standard_normal(5000)
    >>> force = 200 * z + 3 * v + 0.2 * 2 / np.pi * np.arctan(v / 0.02)
    >>> fit = fit_surface(RestoringForce(z, v, force, 500.0), "arctan_velocity")
    >>> np.round([fit.straight["stiffness_per_mass"], *fit.law.vector], 3).tolist()
    [200.0, 0.2, 0.02]
    """
    z, v = surface.travel, surface.velocity
    straight = {"stiffness_per_mass": z, "damping_per_mass": v, "offset": np.ones_like(z)}
    cluster = np.arange(z.size) / (settings.cluster_s * surface.fs)
    motion = recorded_motion(z, v, surface.fs)
    return _fit(straight, default_law(law_name), motion, surface.force_per_mass, cluster, settings)


def _fit(
    straight: dict[str, FloatArray],
    law: Law,
    motion: Motion,
    y: FloatArray,
    cluster: FloatArray,
    settings: PaperSettings,
    given: SeparableFit | None = None,
) -> LawFit:
    """Fit by separable least squares; standard deviations and verdicts hold for a correlated residual.

    `given` is a fit in which the amplitudes of the law are known.
    """
    columns = np.stack(list(straight.values()), axis=1)
    n_straight = columns.shape[1]
    fit = given or fit_separable(columns, law, motion, y)
    starts = motion.start_columns(fit.law)
    slopes = motion.parameter_gradient(fit.law)
    if given is not None:
        slopes = slopes * [parameter.role != "amplitude" for parameter in fit.law.parameter_list]
    jacobian = np.concatenate([columns, slopes, starts], axis=1)
    covariance = clustered_covariance(jacobian, fit.residual, np.floor(cluster).astype(np.int64))
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    names = list(straight)
    return LawFit(
        straight=dict(zip(names, fit.weights.tolist(), strict=True)),
        straight_std=dict(zip(names, std[:n_straight].tolist(), strict=True)),
        law=fit.law,
        law_std=std[n_straight : std.size - fit.start_weights.size],
        residual=fit.residual,
        verdicts=_judge_terms(np.concatenate([columns, starts], axis=1), fit, motion, y, settings),
    )


def _fit_scale(
    columns: FloatArray, name: str, amplitude: float, motion: Motion, y: FloatArray, settings: PaperSettings
) -> SeparableFit:
    """Fit the inner scale of one term of known amplitude beside columns that enter linearly."""
    from scipy import optimize

    q = np.linalg.qr(columns)[0]
    rms = float(np.sqrt(np.mean(columns[:, 0] ** 2)))
    grid = np.log(rms * np.geomspace(*settings.printed.scales_over_rms, settings.printed.n_scales))

    def leave(log_scale: float) -> FloatArray:
        left = y - motion.force(Law((Term(name, (amplitude, float(np.exp(log_scale)))),)))
        return left - q @ (q.T @ left)

    errors = [float(np.sum(leave(each) ** 2)) for each in grid]
    best = int(np.argmin(errors))
    around = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    found = optimize.minimize_scalar(lambda each: float(np.sum(leave(each) ** 2)), bounds=around, method="bounded")
    law = Law((Term(name, (amplitude, float(np.exp(found.x)))),))
    weights = np.asarray(np.linalg.lstsq(columns, y - motion.force(law), rcond=None)[0], dtype=np.float64)
    is_at_bound = best in (0, grid.size - 1)
    return SeparableFit(weights, np.empty(0), law, leave(found.x), (False, is_at_bound))


def _judge_terms(
    columns: FloatArray, fit: SeparableFit, motion: Motion, y: FloatArray, settings: PaperSettings
) -> tuple[TermVerdict, ...]:
    """Return how much worse the fit is without each term, and how straight the term is."""
    shapes = {unit.name: motion.force(Law((unit,))) for unit in unit_law(fit.law).terms}
    n, verdicts = independent_samples(fit.residual), []
    for name, shape in shapes.items():
        others = np.stack([*columns.T, *(shapes[other] for other in shapes if other != name)], axis=1)
        scale = np.sqrt(np.mean(others**2, axis=0))
        bent = shape - (others / scale) @ np.linalg.lstsq(others / scale, shape, rcond=None)[0]
        without = y - (others / scale) @ np.linalg.lstsq(others / scale, y, rcond=None)[0]
        departure = float(np.sqrt(np.mean(bent**2) / np.mean(shape**2)))
        evidence = float(n * np.log(np.sum(without**2) / max(float(np.sum(fit.residual**2)), 1e-300)))
        seen = evidence > settings.seen_above and departure > settings.least_departure
        by_velocity = "m/s" in {parameter.unit for parameter in LAWS[name].parameters} or "damping" in name
        velocity, travel = f"velocity of {2 * motion.v.std():.3g} m/s", f"travel of {2e3 * motion.z.std():.3g} mm"
        visited, beside = (velocity, "damping") if by_velocity else (travel, "stiffness")
        verdict = "the data show it" if seen else f"it cannot be distinguished from {beside}"
        statement = (
            f"over the visited {visited} (two standard deviations) {name} departs from a straight line by "
            f"{100 * departure:.2g} % of its rms; {verdict} (evidence {max(evidence, 0):.0f}, {settings.seen_above:g} "
            "needed)"
        )
        verdicts.append(TermVerdict(name, departure, evidence, seen, statement))
    return tuple(verdicts)
