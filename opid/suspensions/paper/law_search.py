"""Which law: add the term that most improves the joint fit, until nothing improves it enough.

Every candidate is fitted to all runs at once (`opid.suspensions.paper.spectral_equation`), started from the time-domain
fit of the restoring-force surface. A term is kept if it lowers both the Bayesian information criterion and the
unexplained noise by the margins of the settings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from opid.errors import InputError
from opid.mechanics.laws import LAWS, Law, default_law
from opid.suspensions.law_search import LawStep
from opid.suspensions.paper.joint_fit import JointFit
from opid.suspensions.paper.nonlinearity import fit_surface
from opid.suspensions.paper.restoring_force import RestoringForce
from opid.suspensions.paper.settings import DEFAULTS, PaperSettings
from opid.suspensions.paper.spectral_equation import EquationLines, fit_equation


def search_law(
    runs: Sequence[EquationLines],
    surfaces: Sequence[RestoringForce],
    *,
    inverse_mass: float | None,
    ground: bool = True,
    settings: PaperSettings = DEFAULTS,
) -> tuple[LawStep[JointFit], ...]:
    """Return the ladder of laws that were tried; the last one with `kept` is the choice.

    Args:
        runs: one `EquationLines` a run.
        surfaces: one `RestoringForce` a run, for start values.
        inverse_mass: start value of 1/M2, 1/kg; None fits ratios only.
        ground: whether the ground spring is free.
        settings: candidates, margins, and how many terms there may be.

    Raises:
        InputError: an unknown candidate.
    """

    def fitted(name: str, before: JointFit | None = None) -> JointFit:
        return fit_law(runs, surfaces, name, inverse_mass=inverse_mass, ground=ground, before=before, settings=settings)

    for name in settings.candidates:
        if name not in LAWS:
            default_law(name)  # says which law is meant
    if settings.most_terms < 0:
        raise InputError(f"most_terms is {settings.most_terms}: give 0 or more")
    current = LawStep(fitted("linear"), True, "equation")
    ladder = [current]
    names: list[str] = []
    while len(names) < settings.most_terms:
        rest = [name for name in settings.candidates if name not in names]
        tried = [fitted("+".join([*names, name]), current.fit) for name in rest]
        if not tried:
            break
        best = min(tried, key=lambda fit: fit.bic)
        is_better = (
            best.bic < current.fit.bic - settings.bic_margin
            and best.noise_m_per_s2 < (1 - settings.noise_margin) * current.fit.noise_m_per_s2
        )
        ladder += [LawStep(fit, is_better and fit is best, "equation") for fit in tried]
        if not is_better:
            break
        names.append(rest[tried.index(best)])
        current = LawStep(best, True, "equation")
    return tuple(ladder)


def fit_law(
    runs: Sequence[EquationLines],
    surfaces: Sequence[RestoringForce],
    law_name: str,
    *,
    inverse_mass: float | None,
    ground: bool = True,
    before: JointFit | None = None,
    settings: PaperSettings = DEFAULTS,
) -> JointFit:
    """Fit one law to all runs, from start values that the restoring-force surface gives.

    Args:
        runs: one `EquationLines` a run.
        surfaces: one `RestoringForce` a run.
        law_name: the law.
        inverse_mass: start value of 1/M2, 1/kg; None fits ratios only.
        ground: whether the ground spring is free.
        before: a fit whose law lacks one term of this one: a second start.
        settings: how many points give the start values, and what is correlated.

    Returns:
        The better of the fits from the starts.
    """
    surface = thinned(surfaces[0], n_points=settings.start_points)
    rough = fit_surface(surface, law_name, settings=settings)
    starts = [(rough.straight["stiffness_per_mass"], rough.straight["damping_per_mass"], rough.law, inverse_mass)]
    if before is not None and before.law.terms:
        grown = _grown(before.law, rough.law)
        mu = before["inverse_mass"] if inverse_mass is not None else None
        starts.append((before["stiffness_per_mass"], before["damping_per_mass"], grown, mu))
    fits = [
        fit_equation(
            runs,
            law,
            stiffness_per_mass=stiffness,
            damping_per_mass=damping,
            ground=ground,
            inverse_mass=mu,
            cluster_hz=settings.cluster_hz,
        )
        for stiffness, damping, law, mu in starts
    ]
    return max(fits, key=lambda fit: fit.log_likelihood)


def _grown(law: Law, larger: Law) -> Law:
    """Return `law` with the terms of `larger` that it lacks."""
    have = {term.name for term in law.terms}
    return law + Law(tuple(term for term in larger.terms if term.name not in have))


def thinned(surface: RestoringForce, *, n_points: int = PaperSettings.start_points) -> RestoringForce:
    """Return every so many points of a surface: enough for start values and for verdicts on terms.

    Args:
        surface: the points of one run.
        n_points: about so many are left.
    """
    step = max(1, surface.travel.size // n_points)
    return RestoringForce(
        np.ascontiguousarray(surface.travel[::step]),
        np.ascontiguousarray(surface.velocity[::step]),
        np.ascontiguousarray(surface.force_per_mass[::step]),
        surface.fs / step,
        surface.method,
        surface.high_pass_hz,
    )
