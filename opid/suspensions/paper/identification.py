"""Identify a suspension by the paper's chain (Iwaniec & Uhl 2007), mended or as printed.

The law is found by the common search for laws (`opid.suspensions.law_search.pursuit`) over the lines of the equation of
the sprung mass. Columns of candidates are derivatives of the residual of the equation. Every promising law is fitted to
all runs at once, from the start values of the columns and from the time-domain fit of the restoring-force surface.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.estimate import Estimate
from opid.mechanics.laws.law import Law, Term, default_law
from opid.progress import Say
from opid.suspensions.law_search.dictionary import LawDictionary, Node, make_dictionary
from opid.suspensions.law_search.force_surface import VisitedForce, visited_force
from opid.suspensions.law_search.pursuit import LawStep, chosen, search_laws
from opid.suspensions.model.law_parameters import faint_terms, has_slope
from opid.suspensions.paper.added_mass import AddedMass, absolute_parameters
from opid.suspensions.paper.chain import PaperChain, PreparedRun, chain_of, check_runs, prepare_runs
from opid.suspensions.paper.restoring_force import RestoringForce, fit_surface
from opid.suspensions.paper.result import (
    METHODS,
    PaperIdentification,
    PaperMethod,
    gain_like_fraction,
    law_estimates_of,
    parameters_of,
    ratios_of,
    straight_terms,
    warnings_of,
    warnings_of_logs,
)
from opid.suspensions.paper.settings import DEFAULTS, PaperSettings
from opid.suspensions.paper.spectral_equation import EquationLines, JointFit, differentiate, fit_equation
from opid.suspensions.result import GearParameters, GearRatios
from opid.suspensions.settings import SearchSettings
from opid.suspensions.study import Study
from opid.suspensions.weighing import compare_with_weighed, warn_of_weighed


def identify_by_paper(
    study: Study,
    *,
    method: PaperMethod = "classical",
    law: str | None = None,
    band_hz: tuple[float, float] = PaperSettings.band_hz,
    high_pass_hz: float = PaperSettings.high_pass_hz,
    ground: bool = True,
    settings: PaperSettings = DEFAULTS,
    progress: Say | None = None,
) -> PaperIdentification:
    """Identify mass, springs, damping and law of a suspension by the chain of Iwaniec & Uhl (2007).

    "classical" mends every step: sound integration, the complex equation, noise on both channels, all runs in one
    least-squares problem. "paper" gives the result of the chain as printed (`opid.suspensions.paper.printed`) for the
    strongest matched peaks, and the mended chain beside it in figures.

    Args:
        study: the runs; the first one with no mass change is the reference.
        method: "classical" or "paper".
        law: the law of the mended chain (`opid.laws.LAWS`, sums joined by "+"); it is searched if left out. The chain
            as printed has its own, the arctangents of eq. (3).
        band_hz: lines of the equation, Hz; cut at 0.4 of the sampling rate.
        high_pass_hz: corner of the integration that gives the motion inside the law, Hz.
        ground: whether a ground spring K3 is fitted (else it is 0).
        settings: all other settings.
        progress: called with the name of each step as it begins.

    Returns:
        The identification; if the runs do not determine the absolute scale, `not_determined` says why and the ratios to
        the mass are given.

    Raises:
        InputError: an unknown method or law, two channels that make no pair, or runs that are too short.
    """
    if method not in METHODS:
        raise InputError(f"there is no method {method!r}: {nearest(method, METHODS)}")
    say = progress or (lambda step: None)
    settings = replace(settings, law=law, band_hz=band_hz, high_pass_hz=high_pass_hz, ground=ground)
    settings = settings.stated_by(study.transmissibility)
    runs = prepare_runs(check_runs(study), settings, say)
    say("law")
    ladder = _try_laws(runs, settings)
    joint = chosen(ladder).fit
    chain = chain_of(runs, joint.law, joint.inverse_mass, settings, say)
    say("added mass")
    result = _build_without_numbers(study, method, chain, ladder, settings)
    if method == "paper":
        return _weigh(_conclude_as_printed(result))
    return _weigh(_refuse(result) if result.residual_over_noise > settings.verdicts.refused else _conclude(result))


def _weigh(result: PaperIdentification) -> PaperIdentification:
    """Compare the identified mass with the weighed ones."""
    study, settings = result.study, result.settings.weighing
    weighed = compare_with_weighed(study, result.parameters.sprung_mass_kg, settings=settings)
    warnings = (*result.warnings, *warn_of_weighed(study, weighed, settings))
    return replace(result, weighed=weighed, warnings=warnings)


def _try_laws(runs: Sequence[PreparedRun], settings: PaperSettings) -> tuple[LawStep[JointFit], ...]:
    lines, surfaces = [run.lines for run in runs], [run.surface for run in runs]
    changes = {run.mass_change_kg for run in runs}
    mu = 1 / (settings.start_mass_over_change * (max(changes) - min(changes))) if len(changes) > 1 else None
    if settings.law is None:
        return search_law(lines, surfaces, inverse_mass=mu, settings=settings)
    return tuple(
        LawStep(
            fit_law(lines, surfaces, name, inverse_mass=mu, settings=settings),
            name == settings.law,
            "given",
        )
        for name in dict.fromkeys(["linear", settings.law])
    )


def _build_without_numbers(
    study: Study, method: PaperMethod, chain: PaperChain, ladder: tuple[LawStep[JointFit], ...], settings: PaperSettings
) -> PaperIdentification:
    """Return the result without parameters, which follow from the evidence that it holds."""
    joint, nothing = chosen(ladder).fit, np.empty(0)
    added, reason = _scale_by_mass(joint, chain, settings)
    return PaperIdentification(
        study=study,
        method=method,
        title=study.title,
        date=study.date,
        parameters=GearParameters(),
        ratios=GearRatios(),
        law=joint.law,
        law_estimates={},
        restoring_force=VisitedForce(nothing, nothing, nothing, nothing, per_mass=True),
        chain=chain,
        joint=joint,
        ladder=ladder,
        added_mass=added,
        settings=settings,
        warnings=(),
        not_determined=reason,
    )


def _scale_by_mass(joint: JointFit, chain: PaperChain, settings: PaperSettings) -> tuple[AddedMass | None, str | None]:
    """Return the absolute parameters, or why there are none."""
    if "inverse_mass" not in joint.names:
        return None, (
            "all runs have the same sprung mass (mass_change_kg), so only ratios to the mass are determined: "
            "add a run at another mass"
        )
    try:
        return absolute_parameters(joint, [run.mass_change_kg for run in chain.runs], settings=settings), None
    except NotDeterminedError as error:
        return None, str(error)


def _conclude(result: PaperIdentification) -> PaperIdentification:
    """Give the values of the joint fit with intervals and warnings."""
    result, settings = _widen(result), result.settings
    joint, added = result.joint, result.added_mass
    gain = gain_like_fraction(joint, settings)
    ratios = ratios_of(joint, gain=gain, equal_gains=settings.equal_gains)
    if added is None:
        law, parameters = joint.law, result.parameters
        law_std = np.array([joint.std_of(f"law[{i}]") for i in range(law.vector.size)])
        stiffness, damping, _ = joint.ratios
    else:
        law, law_std = added.law, added.std[4:]
        parameters = parameters_of(added, gain=gain, equal_gains=settings.equal_gains)
        stiffness, damping = added.slopes
    laws = law_estimates_of(law, law_std)
    result = replace(result, parameters=parameters, ratios=ratios, law=law, law_estimates=laws)
    force = _build_force(result, stiffness, damping, per_mass=added is None)
    return _withhold_intervals(replace(result, restoring_force=force, warnings=tuple(warnings_of(result))))


def _widen(result: PaperIdentification) -> PaperIdentification:
    """Widen the covariance by the residual beyond noise, for the ratios and for the mass."""
    factor = max(1.0, result.residual_over_noise / result.settings.verdicts.doubtful)
    joint = replace(result.joint, covariance=result.joint.covariance * factor**2)
    if result.added_mass is None:
        return replace(result, joint=joint)
    added, reason = _scale_by_mass(joint, result.chain, result.settings)
    return replace(result, joint=joint, added_mass=added, not_determined=reason)


def _withhold_intervals(result: PaperIdentification) -> PaperIdentification:
    """Remove the intervals of values that a straight term is confounded with, and keep the values."""
    parameters, ratios, laws = result.parameters, result.ratios, result.law_estimates
    for term in straight_terms(result):
        parameters = parameters.with_estimates(Estimate.without_interval, only=term.confounded_with)
        ratios = ratios.with_estimates(Estimate.without_interval, only=term.confounded_with)
        laws = term.without_interval(laws)
    return replace(result, parameters=parameters, ratios=ratios, law_estimates=laws)


def _refuse(result: PaperIdentification) -> PaperIdentification:
    """Withhold the numbers of a model that does not explain the runs, and keep the ratios of the first run alone."""
    runs, ratios = result.chain.runs, result.ratios
    reason = (
        f"the fitted model leaves {result.residual_over_noise:.0f} times the sensor noise unexplained, so no number is "
        "reported: check the channels (swapped, upside down, in another unit) and the mass changes, "
        f"{'let the law be searched, ' * (result.settings.law is not None)}or take another band"
    )
    if len(runs) > 1 and len({run.mass_change_kg for run in runs}) == 1:
        frequencies = [run.spectral_fit.natural_frequency_hz for run in runs]
        reason = (
            "all runs are stated to have the same sprung mass, but they have different natural frequencies "
            f"({min(frequencies):.3f} to {max(frequencies):.3f} Hz): check mass_change_kg; the ratios given are those "
            "of the first run alone"
        )
        ratios = ratios_of(runs[0].spectral_fit, gain=0.0, equal_gains=result.settings.equal_gains)
    return replace(result, ratios=ratios, added_mass=None, not_determined=reason, warnings=tuple(warnings_of(result)))


def _conclude_as_printed(result: PaperIdentification) -> PaperIdentification:
    """Give the result of the printed chain for the strongest pair of peaks: no damping and no intervals."""
    chain = result.chain
    pair, law = chain.strongest_pair, chain.reference.printed.law
    warnings = [
        *warnings_of_logs(result),
        "the printed chain integrates a parabola into the travel, fixes the amplitude of the force, and its formula "
        "ignores damping and the sign of T above resonance: it is shown for comparison, and it has no intervals; use "
        "--method classical for an answer",
    ]
    averages = min(run.printed.T.spectra.n_averages for run in chain.runs)
    if averages < result.settings.few_averages:
        warnings.append(
            f"each printed transmissibility has only {averages:.1f} independent averages: {len(chain.pairs)} pairs of "
            "peaks match, most of them by chance"
        )
    if pair is None:
        has_one_mass = len({run.mass_change_kg for run in result.chain.runs}) == 1
        reason = "the runs have no peak of |T| in common, and the printed formula needs one pair"
        result = replace(result, not_determined=result.not_determined if has_one_mass else reason)
        result = replace(result, law=law, law_estimates=law_estimates_of(law), warnings=tuple(warnings))
        return replace(result, restoring_force=_build_force(result, 0.0, 0.0, per_mass=True))
    found, least_change = pair.as_printed, min(run.mass_change_kg for run in chain.runs)
    per_mass = found.sprung_mass_kg + min(least_change, 0.0) <= 0
    mass, stiffness, ground = found.sprung_mass_kg, found.stiffness_n_per_m, found.ground_stiffness_n_per_m
    ratios = GearRatios(Estimate(stiffness / mass), ground_stiffness_per_mass=Estimate(ground / mass))
    if per_mass:
        reason = f"the chain as printed gives an impossible sprung mass of {mass:.0f} kg; {pair.match.reason}"
        result = replace(result, not_determined=reason)
    else:
        parameters = GearParameters(Estimate(mass), Estimate(stiffness), Estimate(), Estimate(ground))
        result, law = replace(result, parameters=parameters, not_determined=None), law.scaled(mass)
    if not pair.match.credible:
        warnings.append(pair.match.reason)
    result = replace(result, law=law, law_estimates=law_estimates_of(law))
    force = _build_force(result, stiffness / mass if per_mass else stiffness, 0.0, per_mass=per_mass)
    return replace(result, ratios=ratios, restoring_force=force, warnings=tuple(warnings))


def _build_force(result: PaperIdentification, stiffness: float, damping: float, *, per_mass: bool) -> VisitedForce:
    return visited_force(
        np.concatenate([run.surface.travel for run in result.chain.runs]),
        np.concatenate([run.surface.velocity for run in result.chain.runs]),
        result.law,
        stiffness=stiffness,
        damping=damping,
        per_mass=per_mass,
        n_cells=result.settings.force_cells,
    )


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
        """Settings of the search: there are few candidates, so each one that may be better is fitted."""
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
        offered = [
            term for kind in kinds if kind not in fit.law.parameters for term in self._list_faint_terms(kind, fit)
        ]
        # Scales that are changed by a thousandth give the derivative by their logarithm.
        moved = [Term(term.name, (term.amplitude, *(1.001 * scale for scale in term.inner))) for term in offered]
        residual, by_law, by_others, by_terms = differentiate(self.runs, fit, [*offered, *moved])
        nodes: dict[str, list[Node]] = {}
        for term, column, beside in zip(offered, by_terms[: len(offered)], by_terms[len(offered) :], strict=True):
            slope = 1000 * (beside - column) if has_slope(term.kind) else None
            nodes.setdefault(term.name, []).append(Node(Term(term.name, (1.0, *term.inner)), column, slope))
        return {"": make_dictionary(fit.law, residual, by_law, by_others, nodes, self.settings, n_data=fit.n_data)}

    def refit(self, fit: JointFit | None, laws: Mapping[str, Law]) -> JointFit:
        """Fit another law from its present values, and from those of the surface."""
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

    def _list_faint_terms(self, kind: str, fit: JointFit) -> list[Term]:
        """Return terms of a kind that are too weak to change the motion."""
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
        settings: candidates, margins, the most terms of a law, and whether the ground spring is free.

    Raises:
        InputError: an unknown candidate.
    """
    for name in settings.candidates:
        default_law(name)  # refuses an unknown candidate
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
        settings: number of points for the start values, width of the clusters, and whether the ground spring is free.

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
