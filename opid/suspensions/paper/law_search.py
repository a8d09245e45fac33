"""Which law, on the equation of the sprung mass: the one search (`opid.suspensions.law_search.pursuit`) over its lines.

Columns of candidates are derivatives of the residual of the equation. Every law that is worth it is fitted to all runs
at once, from the values that the columns suggest and from the time-domain fit of the restoring-force surface.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from opid.errors import InputError
from opid.mechanics.laws.law import Law, Term, default_law
from opid.suspensions.law_search.dictionary import LawDictionary, Node, make_dictionary
from opid.suspensions.law_search.pursuit import LawStep, search_laws
from opid.suspensions.model.law_parameters import faint_terms, has_slope
from opid.suspensions.paper.nonlinearity import fit_surface
from opid.suspensions.paper.restoring_force import RestoringForce
from opid.suspensions.paper.settings import DEFAULTS, PaperSettings
from opid.suspensions.paper.spectral_equation import EquationLines, JointFit, differentiate, fit_equation
from opid.suspensions.settings import SearchSettings


@dataclass(frozen=True, eq=False)
class EquationLaws:
    """A `LawProblem` of fits of the equation.

    Args:
        runs: one `EquationLines` a run.
        surfaces: one `RestoringForce` a run, for start values.
        inverse_mass: start value of 1/M2, 1/kg; None fits ratios only.
        known: settings of the chain.
    """

    runs: Sequence[EquationLines]
    surfaces: Sequence[RestoringForce]
    inverse_mass: float | None
    known: PaperSettings

    @property
    def settings(self) -> SearchSettings:
        """Of the search: all candidates are few, so each that may be better is fitted."""
        return SearchSettings(
            bic_margin=self.known.bic_margin,
            error_margin=self.known.noise_margin,
            first_order_error=self.known.first_order_error,
            n_refitted=len(self.known.candidates),
            most_terms=self.known.most_terms,
            alike_bic=self.known.bic_margin,
        )

    def dictionaries(self, fit: JointFit, kinds: Sequence[str]) -> dict[str, LawDictionary]:
        """Return the candidates beside a fit."""
        offered = [term for kind in kinds if kind not in fit.law.parameters for term in self._faint(kind, fit)]
        # a scale that is moved by a thousandth shows the derivative by its logarithm
        moved = [Term(term.name, (term.amplitude, *(1.001 * scale for scale in term.inner))) for term in offered]
        residual, by_law, by_others, by_terms = differentiate(self.runs, fit, [*offered, *moved])
        nodes: dict[str, list[Node]] = {}
        for term, column, beside in zip(offered, by_terms[: len(offered)], by_terms[len(offered) :], strict=True):
            slope = 1000 * (beside - column) if has_slope(term.kind) else None
            nodes.setdefault(term.name, []).append(Node(Term(term.name, (1.0, *term.inner)), column, slope))
        return {"": make_dictionary(fit.law, residual, by_law, by_others, nodes, self.settings, n_data=fit.n_data)}

    def refit(self, fit: JointFit | None, laws: Mapping[str, Law]) -> JointFit:
        """Fit another law from the values that it has, and from those of the surface."""
        return fit_law(
            self.runs,
            self.surfaces,
            laws[""].name,
            inverse_mass=self.inverse_mass,
            before=None if fit is None else (fit, laws[""]),
            settings=self.known,
        )

    def left_out(self, fit: JointFit) -> None:
        """Return None: the ratios of one run do not predict another."""

    def confirms(self, fit: JointFit, than: JointFit) -> bool:
        """Return True: nothing is left out."""
        return True

    def _faint(self, kind: str, fit: JointFit) -> list[Term]:
        """Terms too weak to move anything."""
        travel, velocity = (
            np.concatenate([getattr(run, name) for run in self.runs]) for name in ("travel", "velocity")
        )
        return faint_terms(
            kind,
            travel,
            velocity,
            travel_rms=float(travel.std()),
            velocity_rms=float(velocity.std()),
            noise=fit.noise_m_per_s2,
            settings=self.settings,
        )


def search_law(
    runs: Sequence[EquationLines],
    surfaces: Sequence[RestoringForce],
    *,
    inverse_mass: float | None,
    settings: PaperSettings = DEFAULTS,
) -> tuple[LawStep[JointFit], ...]:
    """Return the ladder of laws that were tried; the last one with `kept` is the choice.

    Args:
        runs: one `EquationLines` a run.
        surfaces: one `RestoringForce` a run, for start values.
        inverse_mass: start value of 1/M2, 1/kg; None fits ratios only.
        settings: candidates, margins, how many terms there may be, and whether the ground spring is free.

    Raises:
        InputError: an unknown candidate.
    """
    for name in settings.candidates:
        default_law(name)  # an unknown one is named here
    if settings.most_terms < 0:
        raise InputError(f"most_terms is {settings.most_terms}: give 0 or more")
    problem = EquationLaws(runs, surfaces, inverse_mass, settings)
    return search_laws(problem, problem.refit(None, {"": Law()}), kinds=settings.candidates)


def fit_law(
    runs: Sequence[EquationLines],
    surfaces: Sequence[RestoringForce],
    law_name: str,
    *,
    inverse_mass: float | None,
    before: tuple[JointFit, Law] | None = None,
    settings: PaperSettings = DEFAULTS,
) -> JointFit:
    """Fit one law to all runs, from start values that the restoring-force surface gives.

    Args:
        runs: one `EquationLines` a run.
        surfaces: one `RestoringForce` a run.
        law_name: the law.
        inverse_mass: start value of 1/M2, 1/kg; None fits ratios only.
        before: a fit of another law, and values of this one beside it: a second start.
        settings: how many points give the start values, what is correlated, and whether the ground spring is free.

    Returns:
        The better of the fits from the starts.
    """
    rough = fit_surface(surfaces[0].thinned(settings.start_points), law_name, settings=settings)
    starts = [(rough.straight["stiffness_per_mass"], rough.straight["damping_per_mass"], rough.law, inverse_mass)]
    if before is not None:
        fit, law = before
        mu = fit.inverse_mass if inverse_mass is not None else None
        starts.append((*fit.ratios[:2], law, mu))
    fits = [
        fit_equation(
            runs,
            law,
            stiffness_per_mass=stiffness,
            damping_per_mass=damping,
            ground=settings.ground,
            inverse_mass=mu,
            cluster_hz=settings.cluster_hz,
        )
        for stiffness, damping, law, mu in starts
    ]
    return max(fits, key=lambda fit: fit.log_likelihood)
