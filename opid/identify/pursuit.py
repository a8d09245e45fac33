"""Which law, by prediction: add the term that most lowers the prediction error of the driven model.

Candidates are ranked without a fit: the model is simulated once with the term at amplitude zero, and the derivative of
the prediction by that amplitude, made orthogonal to what the model can already do, says how much the error would fall
(a score test). The best few are fitted; the best of them is kept if the information criterion and the error agree.
A backward pass then drops terms that the later ones made useless.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from opid.identify.joint_fit import LadderStep
from opid.identify.law_search import BIC_MARGIN
from opid.identify.model_fit import DrivenRun, ModelFit, fit_model, score_of_term
from opid.mechanics.laws import LAWS, Law, Term

LIBRARY = (
    "arctan_velocity",
    "arctan_displacement",
    "coulomb_friction",
    "quadratic_damping",
    "cubic_damping",
    "quadratic_stiffness",
    "cubic_stiffness",
    "quintic_stiffness",
)
# the fitted error must fall by this share: below, a term only mends what the sensors did
ERROR_MARGIN = 0.005
N_REFITTED = 3
# inner scales at which a candidate is tried, over the rms motion
SCALES = (0.15, 0.6)


def pursue_law(
    runs: Sequence[DrivenRun],
    start: ModelFit,
    *,
    library: Sequence[str] = LIBRARY,
    most_terms: int = 3,
    progress: Callable[[str], None] | None = None,
) -> tuple[LadderStep, ...]:
    """Return the ladder of fitted laws; the last one with `kept` is the choice.

    Args:
        runs: one `DrivenRun` a run.
        start: a fitted model to grow from, usually with the law of the classical chain.
        library: names in `opid.mechanics.laws.LAWS` that may be added.
        most_terms: terms at the most.
        progress: called with the name of each law before it is fitted.
    """
    say = progress or (lambda step: None)
    ladder = [LadderStep(start.law.name, start, True)]
    current = start
    while len(current.law.terms) < most_terms:
        grown = _grown(runs, current, library, say)
        if not grown:
            break
        best = min(grown, key=lambda fit: fit.bic)
        worthwhile = _better(best, current)
        ladder += [LadderStep(fit.law.name, fit, worthwhile and fit is best) for fit in grown]
        if not worthwhile:
            break
        current = best
    while len(current.law.terms) > 1:
        shrunk = [refit(runs, current, _without(current.law, term)) for term in current.law.terms]
        best = min(shrunk, key=lambda fit: fit.bic)
        # a term must earn its place against the model without it, by the same margin that let it in
        if _better(current, best):
            break
        ladder.append(LadderStep(best.law.name, best, True))
        current = best
    return tuple(ladder)


def refit(runs: Sequence[DrivenRun], fit: ModelFit, law: Law) -> ModelFit:
    """Fit another law, from everything else that a fit found.

    What a dropped term did on average goes to the start values of stiffness and damping.

    Args:
        runs: one `DrivenRun` a run.
        fit: where to start.
        law: the law per unit of sprung mass to start from.
    """
    travel, velocity = _motion(fit)
    names = {term.name for term in law.terms}
    dropped = Law(tuple(term for term in fit.law.terms if term.name not in names))
    by_travel, by_velocity = (float(np.mean(slope)) for slope in dropped.gradient(travel, velocity))
    return fit_model(
        runs,
        law,
        stiffness_per_mass=fit["stiffness_per_mass"] + by_travel,
        damping_per_mass=fit["damping_per_mass"] + by_velocity,
        ground="ground_stiffness_per_mass" in fit.names,
        ground_stiffness_per_mass=fit["ground_stiffness_per_mass"],
        inverse_mass=fit["inverse_mass"] if "inverse_mass" in fit.names else None,
        motion_rms=(float(travel.std()), float(velocity.std())),
    )


def _grown(
    runs: Sequence[DrivenRun], current: ModelFit, library: Sequence[str], say: Callable[[str], None]
) -> list[ModelFit]:
    """Fit the candidates that promise most."""
    have = {term.name for term in current.law.terms}
    travel, velocity = _motion(current)
    scored = []
    for name in library:
        if name in have:
            continue
        for scale in SCALES:
            term = _at_zero(name, scale, travel, velocity)
            gain, amplitude = score_of_term(runs, current, term)
            scored.append((gain, name, Term(name, (amplitude, *term.inner))))
            if not term.inner:
                break
    best: dict[str, tuple[float, Term]] = {}
    for gain, name, term in scored:
        if name not in best or gain > best[name][0]:
            best[name] = (gain, term)
    promising = sorted(best.values(), key=lambda entry: -entry[0])[:N_REFITTED]
    fits = []
    for _, term in promising:
        law = current.law + Law((term,))
        say(law.name)
        fits.append(refit(runs, current, law))
    return fits


def _better(fit: ModelFit, than: ModelFit) -> bool:
    return fit.bic < than.bic - BIC_MARGIN and fit.noise_m_per_s2 < (1 - ERROR_MARGIN) * than.noise_m_per_s2


def _without(law: Law, term: Term) -> Law:
    return Law(tuple(other for other in law.terms if other is not term))


def _motion(fit: ModelFit) -> tuple[np.ndarray, np.ndarray]:
    return (
        np.concatenate([response.travel[:, 0] for response in fit.responses]),
        np.concatenate([response.velocity[:, 0] for response in fit.responses]),
    )


def _at_zero(name: str, scale: float, travel: np.ndarray, velocity: np.ndarray) -> Term:
    """Return a term of amplitude zero whose inner scale is a share of the rms motion."""
    values = [0.0]
    for parameter in LAWS[name].parameters[1:]:
        if parameter.role == "scale":
            values.append(scale * float((velocity if parameter.unit == "m/s" else travel).std()))
        else:
            values.append(parameter.default)
    return Term(name, tuple(values))
