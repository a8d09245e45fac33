"""Which law: add the term that most improves the joint fit, until nothing improves it enough.

Every candidate is fitted to all runs at once (`opid.suspensions.paper.spectral_equation`), started from the time-domain
fit of the restoring-force surface. A term is kept if it lowers the Bayesian information criterion by `BIC_MARGIN` and the
unexplained noise by `NOISE_MARGIN`: with thousands of lines the criterion alone would pay for correcting the filter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.errors import InputError
from opid.mechanics.laws import LAWS, Law, default_law
from opid.suspensions.paper.joint_fit import JointFit, LadderStep
from opid.suspensions.paper.nonlinearity import fit_surface
from opid.suspensions.paper.restoring_force import RestoringForce
from opid.suspensions.paper.spectral_equation import EquationLines, fit_equation

CANDIDATES = (
    "arctan_velocity",
    "arctan_displacement",
    "coulomb_friction",
    "quadratic_damping",
    "quadratic_stiffness",
    "cubic_stiffness",
)
BIC_MARGIN = 10.0
NOISE_MARGIN = 0.02
# points that the start values are fitted to: more would only cost time
N_START_POINTS = 3000


def search_law(
    runs: Sequence[EquationLines],
    surfaces: Sequence[RestoringForce],
    *,
    inverse_mass: float | None,
    ground: bool = True,
    candidates: Sequence[str] = CANDIDATES,
    most_terms: int = 2,
) -> tuple[LadderStep, ...]:
    """Return the ladder of laws that were tried; the last one with `kept` is the choice.

    Args:
        runs: one `EquationLines` a run.
        surfaces: one `RestoringForce` a run, for start values.
        inverse_mass: start value of 1/M2, 1/kg; None fits ratios only.
        ground: whether the ground spring is free.
        candidates: names in `LAWS` that may be added.
        most_terms: terms at the most.

    Raises:
        InputError: an unknown candidate.
    """
    for name in candidates:
        if name not in LAWS:
            default_law(name)  # says which law is meant
    if most_terms < 0:
        raise InputError(f"most_terms is {most_terms}: give 0 or more")
    settings = {"inverse_mass": inverse_mass, "ground": ground}
    current = LadderStep("linear", fit_law(runs, surfaces, "linear", **settings), True)  # type: ignore[arg-type]
    ladder = [current]
    names: list[str] = []
    while len(names) < most_terms:
        rest = [name for name in candidates if name not in names]
        tried = [
            fit_law(runs, surfaces, "+".join([*names, name]), before=current.fit, **settings)  # type: ignore[arg-type]
            for name in rest
        ]
        if not tried:
            break
        best = min(tried, key=lambda fit: fit.bic)
        worthwhile = (
            best.bic < current.fit.bic - BIC_MARGIN
            and best.noise_m_per_s2 < (1 - NOISE_MARGIN) * current.fit.noise_m_per_s2
        )
        ladder += [LadderStep(fit.law.name, fit, worthwhile and fit is best) for fit in tried]
        if not worthwhile:
            break
        names.append(rest[tried.index(best)])
        current = LadderStep(best.law.name, best, True)
    return tuple(ladder)


def fit_law(
    runs: Sequence[EquationLines],
    surfaces: Sequence[RestoringForce],
    law_name: str,
    *,
    inverse_mass: float | None,
    ground: bool = True,
    before: JointFit | None = None,
) -> JointFit:
    """Fit one law to all runs, from start values that the restoring-force surface gives.

    Args:
        runs: one `EquationLines` a run.
        surfaces: one `RestoringForce` a run.
        law_name: the law.
        inverse_mass: start value of 1/M2, 1/kg; None fits ratios only.
        ground: whether the ground spring is free.
        before: a fit whose law lacks one term of this one: a second start.

    Returns:
        The better of the fits from the starts.
    """
    surface = thinned(surfaces[0])
    rough = fit_surface(surface, law_name)
    starts = [(rough.straight["stiffness_per_mass"], rough.straight["damping_per_mass"], rough.law, inverse_mass)]
    if before is not None and before.law.terms:
        grown = _grown(before.law, rough.law)
        mu = before["inverse_mass"] if inverse_mass is not None else None
        starts.append((before["stiffness_per_mass"], before["damping_per_mass"], grown, mu))
    fits = [
        fit_equation(runs, law, stiffness_per_mass=stiffness, damping_per_mass=damping, ground=ground, inverse_mass=mu)
        for stiffness, damping, law, mu in starts
    ]
    return max(fits, key=lambda fit: fit.log_likelihood)


def _grown(law: Law, larger: Law) -> Law:
    """Return `law` with the terms of `larger` that it lacks."""
    have = {term.name for term in law.terms}
    return law + Law(tuple(term for term in larger.terms if term.name not in have))


def likely_law(surface: RestoringForce, *, candidates: Sequence[str] = CANDIDATES) -> str:
    """Return the candidate that fits the restoring-force points best, "linear" where none fits clearly better.

    Args:
        surface: the points of one run.
        candidates: names in `LAWS`.
    """
    points = thinned(surface)
    left = {name: fit_surface(points, name).residual_rms for name in ("linear", *candidates)}
    best = min(left, key=lambda name: left[name])
    return best if left[best] < (1 - NOISE_MARGIN) * left["linear"] else "linear"


def thinned(surface: RestoringForce) -> RestoringForce:
    """Return every so manieth point, some thousands: enough for start values and for verdicts on terms.

    Args:
        surface: the points of one run.
    """
    step = max(1, surface.travel.size // N_START_POINTS)
    return RestoringForce(
        np.ascontiguousarray(surface.travel[::step]),
        np.ascontiguousarray(surface.velocity[::step]),
        np.ascontiguousarray(surface.force_per_mass[::step]),
        surface.fs / step,
        surface.method,
        surface.high_pass_hz,
    )
