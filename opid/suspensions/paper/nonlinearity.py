"""Fit a law to restoring-force points, and say when it cannot be told from a straight line.

Iwaniec & Uhl (2007, eq. 3) model both curves by f/M2 = a z + arctan(d b (z + c z')): a slope, an amplitude and an
inner scale. The amplitude there is fixed at pi/2 m/s^2; here it is fitted. Whether an arctangent is *seen* depends on
how far the motion bends it: below a third of its scale it is a straight line, and only amplitude/scale is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.mechanics.laws.law import LAWS, Law, default_law
from opid.mechanics.memory import Motion, recorded_motion
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.least_squares import (
    SeparableFit,
    clustered_covariance,
    independent_samples,
    separable_fit,
    unit_law,
)
from opid.suspensions.paper.restoring_force import RestoringForce, SliceCurve
from opid.suspensions.paper.settings import DEFAULTS, PaperSettings


@dataclass(frozen=True, eq=False)
class TermVerdict:
    """How well one term of a law can be told from the straight terms beside it.

    Args:
        name: kind of the term.
        departure: rms departure of the term from its best fit by the straight terms, over its own rms (0: straight).
        evidence: twice the gain in log-likelihood by this term, counted in independent samples.
        distinguishable: whether the data see the term.
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


def fit_slice(curve: SliceCurve, *, settings: PaperSettings = DEFAULTS) -> LawFit:
    """Fit slope, amplitude and inner scale of an arctangent to a slice curve (Figs. 6 and 7 of the paper).

    -x2'' = offset + slope u + A (2/pi) arctan(u/s), u the travel or the velocity.

    Args:
        curve: the points of the slice.
        settings: what is correlated in time, and from when a term is seen.

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
    return _fit(straight, default_law(name), Motion(z, v), curve.force_per_mass, cluster, settings)


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
        settings: what is correlated in time, and from when a term is seen.

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
) -> LawFit:
    """Fit by separable least squares; standard deviations and verdicts from the residual as it is."""
    columns = np.stack(list(straight.values()), axis=1)
    n_straight = columns.shape[1]
    fit = separable_fit(columns, law, motion, y)
    starts = motion.start_columns(fit.law)
    jacobian = np.concatenate([columns, motion.parameter_gradient(fit.law), starts], axis=1)
    covariance = clustered_covariance(jacobian, fit.residual, np.floor(cluster).astype(np.int64))
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    names = list(straight)
    return LawFit(
        straight=dict(zip(names, fit.weights.tolist(), strict=True)),
        straight_std=dict(zip(names, std[:n_straight].tolist(), strict=True)),
        law=fit.law,
        law_std=std[n_straight : std.size - fit.start_weights.size],
        residual=fit.residual,
        verdicts=_verdicts(np.concatenate([columns, starts], axis=1), fit, motion, y, settings),
    )


def _verdicts(
    columns: FloatArray, fit: SeparableFit, motion: Motion, y: FloatArray, settings: PaperSettings
) -> tuple[TermVerdict, ...]:
    """Leave out one term at a time: how much worse is the fit, and how straight was the term?"""
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
        told = "the data see it" if seen else f"it cannot be told from {beside}"
        statement = (
            f"over the visited {visited} (two standard deviations) {name} departs from a straight line by "
            f"{100 * departure:.2g} % of its rms; {told} (evidence {max(evidence, 0):.0f}, {settings.seen_above:g} "
            "needed)"
        )
        verdicts.append(TermVerdict(name, departure, evidence, seen, statement))
    return tuple(verdicts)
