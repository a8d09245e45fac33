"""The force without a law, over the motion that the fitted model reconstructs, beside the law that was chosen.

The measured force on the body is averaged over cells of travel and velocity. What the law leaves of it there, in
standard errors, shows what no term of the library can: a memory, a stop, a law of another kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.mechanics.laws import Law
from opid.signals.recording import FloatArray
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.one_gear.model_fit import ModelFit
from opid.suspensions.one_gear.sparse_road import ForcePoints, force_points

N_CELLS = 16
# cells reach this many rms motions; fewer samples than this tell nothing
REACH_RMS, LEAST_COUNT = 3.0, 20
# a section holds the motion within this many rms of the other coordinate
SECTION_RMS = 0.3


@dataclass(frozen=True, eq=False)
class ForceSection:
    """The force along one coordinate, the other near zero.

    Args:
        position: (n,) middle of each bin, m or m/s.
        mean: (n,) measured force per unit of reference mass, less that of stiffness and damping and with the motion
            across taken to zero by the law, m/s^2; NaN where too few samples are.
        standard_error: (n,) of the mean.
        law: (n,) what the law gives there.
    """

    position: FloatArray
    mean: FloatArray
    standard_error: FloatArray
    law: FloatArray


@dataclass(frozen=True, eq=False)
class ForceSurface:
    """Measured force per unit of reference mass over cells of travel and velocity, and the law's.

    Args:
        law_name: of the law.
        travel_edges: (n + 1,) of the cells, m.
        velocity_edges: (n + 1,) of the cells, m/s.
        count: (n, n) samples in each cell, travel along the first axis.
        mean: (n, n) mean measured force, m/s^2; NaN where fewer than 20 samples are.
        standard_error: (n, n) of the mean, from the white noise of the reading.
        law: (n, n) mean force of stiffness, damping and law on the same samples.
        along_travel: section near zero velocity.
        along_velocity: section near zero travel.
        largest_standard_errors: largest departure of mean from law, in its standard errors.
        largest_percent: largest departure among the cells where it exceeds three standard errors, in % of the rms
            force; 0 where none does.
        expected_standard_errors: largest departure that chance alone makes in so many cells, once in 20 times.
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


def force_surface(runs: Sequence[DrivenRun], fit: ModelFit, *, n_cells: int = N_CELLS) -> ForceSurface:
    """Return the force over the reconstructed motion, cell by cell, beside the law.

    Args:
        runs: one `DrivenRun` a run.
        fit: the model fitted to them.
        n_cells: cells along each coordinate.
    """
    from scipy import stats

    points = force_points(runs, fit)
    edges = [np.linspace(-1, 1, n_cells + 1) * REACH_RMS * x.std() for x in (points.travel, points.velocity)]
    place = [np.digitize(x, e) - 1 for x, e in zip((points.travel, points.velocity), edges, strict=True)]
    inside = np.all([(p >= 0) & (p < n_cells) for p in place], axis=0)
    cell = np.where(inside, place[0] * n_cells + place[1], -1)
    # second differences hold the noise and nothing that a law could have missed
    noise = float(np.std(np.diff(points.force_per_mass - points.fitted, 2)) / np.sqrt(6))
    count, mean, error, law = (x.reshape(n_cells, n_cells) for x in _averages(points, cell, n_cells**2, noise))
    departure = (mean - law) / error
    known = np.isfinite(departure)
    rms = float(np.sqrt(np.mean(points.force_per_mass**2)))
    seen = known & (np.abs(departure) > 3)
    return ForceSurface(
        law_name=fit.law.name,
        travel_edges=edges[0],
        velocity_edges=edges[1],
        count=count.astype(np.int64),
        mean=mean,
        standard_error=error,
        law=law,
        along_travel=_section(points, fit.law, 0, edges[0], noise),
        along_velocity=_section(points, fit.law, 1, edges[1], noise),
        largest_standard_errors=float(np.max(np.abs(departure[known]), initial=0.0)),
        largest_percent=100 * float(np.max(np.abs((mean - law)[seen]), initial=0.0)) / rms,
        expected_standard_errors=float(stats.norm.isf(0.5 * (1 - 0.95 ** (1 / max(int(known.sum()), 1))))),
    )


def _averages(
    points: ForcePoints, cell: np.ndarray, n_cells: int, noise: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Count, mean force, standard error and mean law of each cell."""
    inside = cell >= 0
    number = np.bincount(cell[inside], minlength=n_cells).astype(np.float64)
    divisor = np.where(number >= LEAST_COUNT, number, np.nan)

    def mean_of(values: FloatArray) -> FloatArray:
        return np.bincount(cell[inside], weights=values[inside], minlength=n_cells) / divisor

    return number, mean_of(points.force_per_mass), noise / np.sqrt(divisor), mean_of(points.fitted)


def _section(points: ForcePoints, law: Law, axis: int, edges: FloatArray, noise: float) -> ForceSection:
    along, across = (points.travel, points.velocity)[:: 1 if axis == 0 else -1]
    n = edges.size - 1
    place = np.digitize(along, edges) - 1
    near = (np.abs(across) < SECTION_RMS * across.std()) & (place >= 0) & (place < n)
    _, mean, error, fitted = _averages(points, np.where(near, place, -1), n, noise)
    position = 0.5 * (edges[1:] + edges[:-1])
    zero = np.zeros(n)
    of_law = law.force(position, zero) if axis == 0 else law.force(zero, position)
    return ForceSection(position, of_law + mean - fitted, error, of_law)
