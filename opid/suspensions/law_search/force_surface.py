"""The force without a law, over the motion that the fitted model reconstructs, compared with the chosen law.

The measured force on the body is averaged over cells of travel and velocity. Its departure from the law, in standard
errors, shows effects that no term of the library describes: a memory, a stop, a law of another kind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.mechanics.laws.law import Law
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.fit import Fit
from opid.suspensions.settings import SurfaceSettings


@dataclass(frozen=True, eq=False)
class ForcePoints:
    """Force of a suspension over the motion that a fitted model reconstructs, samples of all runs.

    Args:
        travel: (n,) from where the suspension rests in the reference run, m.
        velocity: (n,) z', m/s.
        force_per_mass: (n,) force on the body per unit of the reference mass, m/s^2.
        fitted: (n,) force of the fitted stiffness, damping and law, m/s^2.
    """

    travel: FloatArray
    velocity: FloatArray
    force_per_mass: FloatArray
    fitted: FloatArray


@dataclass(frozen=True, eq=False)
class ForceSection:
    """The force along one coordinate, the other near zero.

    Args:
        position: (n,) middle of each bin, m or m/s.
        mean: (n,) measured force per unit of the reference mass, minus that of stiffness and damping, and corrected by
            the law to zero of the other coordinate, m/s^2; NaN where there are too few samples.
        standard_error: (n,) standard error of the mean.
        law: (n,) force of the law there.
    """

    position: FloatArray
    mean: FloatArray
    standard_error: FloatArray
    law: FloatArray


@dataclass(frozen=True, eq=False)
class ForceSurface:
    """Measured force per unit of reference mass over cells of travel and velocity, and the law's.

    Args:
        law_name: name of the law.
        travel_edges: (n + 1,) edges of the cells, m.
        velocity_edges: (n + 1,) edges of the cells, m/s.
        count: (n, n) samples in each cell, travel along the first axis.
        mean: (n, n) mean measured force, m/s^2; NaN where there are fewer than 20 samples.
        standard_error: (n, n) standard error of the mean, from the white noise of the reading.
        law: (n, n) mean force of stiffness, damping and law on the same samples.
        along_travel: section near zero velocity.
        along_velocity: section near zero travel.
        largest_standard_errors: largest departure of mean from law, in its standard errors.
        largest_percent: largest departure among the cells where it exceeds three standard errors, in % of the rms
            force; 0 if none does.
        expected_standard_errors: largest departure that chance alone exceeds in so many cells once in 20 cases.
    """

    law_name: str
    travel_edges: FloatArray
    velocity_edges: FloatArray
    count: np.ndarray
    mean: FloatArray
    standard_error: FloatArray
    law: FloatArray
    along_travel: ForceSection
    along_velocity: ForceSection
    largest_standard_errors: float
    largest_percent: float
    expected_standard_errors: float

    @property
    def departure(self) -> FloatArray:
        """(n, n) departure of the measured mean from the law, in standard errors."""
        return (self.mean - self.law) / self.standard_error


def force_points(fit: Fit, attachment: int) -> ForcePoints:
    """Return the measured force of one suspension per unit of reference mass on the reconstructed motion.

    The readings minus the prediction, without their mean, are explained by additional forces of the suspensions; a
    sensor that responds to one suspension only gives the force of that one.
    """
    model, number = fit.model, next(k for k, group in enumerate(fit.model.groups) if attachment in group.members)
    law, (z, v) = list(fit.laws.values())[number], fit.motion(attachment)
    rests = [model.rest(fit.theta, index) for index in range(len(model.runs))]
    if any(rest is not None for rest in rests):
        at_rest = [0.0 if rest is None else float(rest.travel[attachment]) for rest in rests]
        z = z + np.repeat(at_rest, [prediction.travel.shape[0] for prediction in fit.errors.predictions])
    first = model.first_of_group[number]
    fitted = fit.theta[first] * z + fit.theta[first + 1] * v + law.force(z, v)
    missed = []
    for index, prediction in enumerate(fit.errors.predictions):
        read = model.correct(fit.theta, index)[1].value
        apart = read - prediction.acceleration[:, : read.shape[1]]
        solved = np.linalg.pinv(model.mobility(fit.theta, index).reading[: read.shape[1], : model.body.n_interfaces])
        missed.append((apart - apart.mean(axis=0)) @ solved[attachment])
    return ForcePoints(z, v, fitted - np.concatenate(missed), fitted)


def force_surface(fit: Fit, attachment: int) -> ForceSurface:
    """Return the force of one suspension over the reconstructed motion, cell by cell, beside the law."""
    from scipy import special

    settings = fit.model.settings.surface
    n_cells = settings.n_cells
    law = next(law for group, law in zip(fit.groups, fit.laws.values(), strict=True) if attachment in group.members)
    points = force_points(fit, attachment)
    edges = [np.linspace(-1, 1, n_cells + 1) * settings.reach_rms * x.std() for x in (points.travel, points.velocity)]
    index = [np.digitize(x, e) - 1 for x, e in zip((points.travel, points.velocity), edges, strict=True)]
    inside = np.all([(p >= 0) & (p < n_cells) for p in index], axis=0)
    cell = np.where(inside, index[0] * n_cells + index[1], -1)
    # Second differences contain the noise and no errors of the law.
    noise = float(np.std(np.diff(points.force_per_mass - points.fitted, 2)) / np.sqrt(6))
    count, mean, error, fitted = (
        x.reshape(n_cells, n_cells) for x in _average_cells(points, cell, n_cells**2, noise, settings)
    )
    departure = (mean - fitted) / error
    known = np.isfinite(departure)
    rms = float(np.sqrt(np.mean(points.force_per_mass**2)))
    seen = known & (np.abs(departure) > settings.seen_std)
    return ForceSurface(
        law_name=law.name,
        travel_edges=edges[0],
        velocity_edges=edges[1],
        count=count.astype(np.int64),
        mean=mean,
        standard_error=error,
        law=fitted,
        along_travel=_cut_section(points, law, 0, edges[0], noise, settings),
        along_velocity=_cut_section(points, law, 1, edges[1], noise, settings),
        largest_standard_errors=float(np.max(np.abs(departure[known]), initial=0.0)),
        largest_percent=100 * float(np.max(np.abs((mean - fitted)[seen]), initial=0.0)) / rms,
        expected_standard_errors=float(-special.ndtri(0.5 * (1 - 0.95 ** (1 / max(int(known.sum()), 1))))),
    )


def _average_cells(
    points: ForcePoints, cell: np.ndarray, n_cells: int, noise: float, settings: SurfaceSettings
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return count, mean force, standard error and mean law of each cell."""
    inside = cell >= 0
    number = np.bincount(cell[inside], minlength=n_cells).astype(np.float64)
    divisor = np.where(number >= settings.least_count, number, np.nan)

    def mean_of(values: FloatArray) -> FloatArray:
        return np.bincount(cell[inside], weights=values[inside], minlength=n_cells) / divisor

    return number, mean_of(points.force_per_mass), noise / np.sqrt(divisor), mean_of(points.fitted)


def _cut_section(
    points: ForcePoints, law: Law, axis: int, edges: FloatArray, noise: float, settings: SurfaceSettings
) -> ForceSection:
    along, across = (points.travel, points.velocity)[:: 1 if axis == 0 else -1]
    n = edges.size - 1
    index = np.digitize(along, edges) - 1
    near = (np.abs(across) < settings.section_rms * across.std()) & (index >= 0) & (index < n)
    _, mean, error, fitted = _average_cells(points, np.where(near, index, -1), n, noise, settings)
    position = 0.5 * (edges[1:] + edges[:-1])
    zero = np.zeros(n)
    of_law = law.force(position, zero) if axis == 0 else law.force(zero, position)
    return ForceSection(position, of_law + mean - fitted, error, of_law)


@dataclass(frozen=True, eq=False)
class VisitedForce:
    """An identified restoring force at the points of the plane that the runs visited.

    Args:
        travel: (n,) z, m.
        velocity: (n,) z', m/s.
        force: (n,) K2 z + C2 z' + f(z, z'), N, or per unit of mass in m/s^2 if the mass is not determined.
        nonlinear_force: (n,) f(z, z') alone.
        per_mass: whether the forces are per unit of mass.
    """

    travel: FloatArray
    velocity: FloatArray
    force: FloatArray
    nonlinear_force: FloatArray
    per_mass: bool


def visited_force(
    travel: FloatArray,
    velocity: FloatArray,
    law: Law,
    *,
    stiffness: float,
    damping: float,
    per_mass: bool,
    n_cells: int = 31,
) -> VisitedForce:
    """Evaluate an identified restoring force at the visited cells of the plane.

    Args:
        travel: (n,) travel of the runs, m.
        velocity: (n,) velocity of the runs, m/s.
        law: the nonlinear law.
        stiffness: K2 (or K2/M2).
        damping: C2 (or C2/M2).
        per_mass: whether the three are per unit of mass.
        n_cells: cells along each axis.

    >>> z, v = np.linspace(-1, 1, 99), np.linspace(-2, 2, 99)
    >>> force = visited_force(z, v, Law(), stiffness=2.0, damping=0.0, per_mass=False)
    >>> bool(np.allclose(force.force, 2 * force.travel))
    True
    """
    counts, z_edges, v_edges = np.histogram2d(travel, velocity, bins=n_cells)
    i, j = np.nonzero(counts)
    z, v = (z_edges[i] + z_edges[i + 1]) / 2, (v_edges[j] + v_edges[j + 1]) / 2
    nonlinear = law.force(z, v)
    return VisitedForce(z, v, stiffness * z + damping * v + nonlinear, nonlinear, per_mass)
