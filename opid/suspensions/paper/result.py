"""Result of the paper's chain: its record, estimates with intervals, and warnings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import date
from typing import Any, Literal

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws.law import Law, law_rows
from opid.mechanics.weight import depends_on_travel
from opid.result import SummaryRow
from opid.signals.health.inspection import findings_in_words
from opid.signals.recording import FloatArray
from opid.suspensions.answer.refusals import ConfoundedTerm, straight_term
from opid.suspensions.law_search.force_surface import VisitedForce
from opid.suspensions.law_search.pursuit import LawStep, alternatives
from opid.suspensions.paper.added_mass import AddedMass
from opid.suspensions.paper.chain import PaperChain
from opid.suspensions.paper.settings import PaperSettings
from opid.suspensions.paper.spectral_equation import RATIOS, FittedRatios, JointFit
from opid.suspensions.result import GearParameters, GearRatios, Identification, ResultOfStudy, estimate_rows
from opid.suspensions.settings import SearchSettings
from opid.suspensions.study import Study
from opid.suspensions.weighing import WeighedMass

PaperMethod = Literal["classical", "paper"]
METHODS: tuple[PaperMethod, ...] = ("classical", "paper")


@dataclass(frozen=True, eq=False, repr=False)
class PaperIdentification(ResultOfStudy):
    """The result of an identification by the paper's chain.

    Args:
        study: the runs.
        method: "classical" (every step mended) or "paper" (the chain as printed; no intervals).
        title: title of the study.
        date: date of the runs; None if it is not known.
        parameters: absolute values of the reference run.
        ratios: values that need no known mass.
        law: the nonlinear law in N, or per unit of mass (m/s^2) if the mass is not determined.
        law_estimates: {kind: {parameter: Estimate}} in the same unit; empty if no law is concluded.
        restoring_force: the identified force over the visited plane; empty if no number is given.
        chain: the steps of the paper, run by run.
        joint: the fit of the equation to all runs, per unit of the reference mass; its intervals are widened if the
            model leaves much more than noise.
        ladder: the laws that were tried.
        added_mass: absolute parameters of `joint`; None if the mass is not determined.
        settings: the options of the call, and every number that was chosen.
        warnings: what limits the answer, one sentence each.
        not_determined: why absolute values are missing, or None.
        weighed: masses of runs by a scale, beside the identified ones.
    """

    study: Study
    method: PaperMethod
    title: str
    date: date | None
    parameters: GearParameters
    ratios: GearRatios
    law: Law
    law_estimates: Mapping[str, Mapping[str, Estimate]]
    restoring_force: VisitedForce
    chain: PaperChain
    joint: JointFit
    ladder: tuple[LawStep[JointFit], ...]
    added_mass: AddedMass | None
    settings: PaperSettings
    warnings: tuple[str, ...]
    not_determined: str | None
    weighed: tuple[WeighedMass, ...] = ()

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the parameters, the law, and the ratios that need no known mass."""
        laws = law_rows(self.law, self.law_estimates, "law", per_mass=self.per_mass)
        return (*estimate_rows(self.parameters), *laws, *estimate_rows(self.ratios))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, see `opid.suspensions.answer.as_json.result_json`."""
        from opid.suspensions.answer.as_json import result_json

        return result_json(self)

    def _write_headline(self) -> str:
        return f"{self.title or 'without a title'} (method {self.method}, law {self.law.name})"

    @property
    def per_mass(self) -> bool:
        """Whether the law and the restoring force are per unit of mass."""
        return self.restoring_force.per_mass

    @property
    def paper_chain(self) -> PaperChain:
        """The steps of the paper, under the name that other results have."""
        return self.chain

    @property
    def is_refused(self) -> bool:
        """Whether the residual of the joint fit is so large that none of its numbers is given and no figure shows it.

        The result of the printed chain for a pair of peaks does not depend on that fit and is given nevertheless.
        """
        return self.residual_over_noise > self.settings.verdicts.refused

    @property
    def residual_over_noise(self) -> float:
        """Noise that would explain the residual of the joint fit, over the sensors' own noise."""
        return self.joint.noise_m_per_s2 / max(self.chain.noise_floor_m_per_s2, 1e-12)

    @property
    def tried_kinds(self) -> tuple[str, ...]:
        """Names of the kinds of terms that were tried."""
        return tuple(
            sorted({term.name for step in self.ladder for law in step.fit.laws.values() for term in law.terms})
        )

    @property
    def alternative_laws(self) -> tuple[str, ...]:
        """Other laws that explain the runs as well, one sentence each."""
        return alternatives(self.ladder, SearchSettings(alike_bic=self.settings.bic_margin))


AnyIdentification = Identification | PaperIdentification
"""What `identify` returns: the driven model's answer, or that of the paper's chain."""


def straight_terms(result: PaperIdentification) -> Iterator[ConfoundedTerm]:
    """Yield the terms whose scale is much larger than the motion."""
    for term in result.joint.law.terms:
        for parameter, value in zip(term.kind.parameters, term.values, strict=True):
            name = "velocity" if parameter.unit == "m/s" else "travel"
            rms = max(float(getattr(run.surface, name).std()) for run in result.chain.runs)
            if parameter.role == "scale" and value > result.settings.straight_above * rms:
                yield straight_term("", term.name, parameter.unit, value, rms)


def gain_like_fraction(joint: JointFit, settings: PaperSettings) -> float:
    """Return |K3|/K2 if a gain error is a likelier reason for it than a spring to the ground, else 0.

    A relative gain error e gives a free mass a K3 of about -e K2, and K2 the same relative error.
    """
    if RATIOS[2] not in joint.names:
        return 0.0
    stiffness, _, ground = joint.ratios
    fraction, is_seen = abs(ground / stiffness), abs(ground) > 3 * joint.std_of(RATIOS[2])
    return fraction if is_seen and settings.negligible_ground < fraction < settings.gain_like else 0.0


def parameters_of(added: AddedMass, *, gain: float, equal_gains: float) -> GearParameters:
    """Return the absolute parameters with intervals that include a gain error of the fraction `gain`."""
    std, mu = added.std.copy(), added.fit.inverse_mass
    # A gain error that explains the ground spring changes stiffness and damping by the same fraction.
    std[1:3] = np.hypot(std[1:3], gain * np.abs(added.value[1:3]))
    std[3] = np.hypot(std[3], max(equal_gains, gain) * added.slopes[0])
    parameters = GearParameters(*map(Estimate.normal, added.value[:4], std[:4]))
    if RATIOS[2] not in added.fit.names:
        parameters = replace(parameters, ground_stiffness_n_per_m=Estimate(0.0))
    # The mass is 1/mu, so its interval is the image of that of mu and longer upwards.
    mu_std = added.fit.std_of("inverse_mass")
    if mu > 1.96 * mu_std:
        interval = (float(1 / (mu + 1.96 * mu_std)), float(1 / (mu - 1.96 * mu_std)))
        parameters = replace(parameters, sprung_mass_kg=Estimate(1 / mu, float(std[0]), interval))
    return parameters


def ratios_of(fit: FittedRatios, *, gain: float, equal_gains: float) -> GearRatios:
    """Return ratios to the mass, natural frequency and damping ratio on a still wheel, by the delta method."""
    k, c, ground = fit.ratios
    has_ground, total, std = RATIOS[2] in fit.names, k + ground, fit.std
    ratios = GearRatios(
        Estimate.normal(k, np.hypot(std[0], gain * k)),
        Estimate.normal(c, np.hypot(std[1], gain * c)),
        Estimate.normal(ground, np.hypot(std[2], max(equal_gains, gain) * k)) if has_ground else Estimate(0.0),
    )
    if total <= 0:
        return ratios
    omega = np.sqrt(total)
    gradients = np.zeros((2, len(fit.names)))
    gradients[:, 0] = 1 / (4 * np.pi * omega), -c / (4 * omega**3)
    gradients[1, 1] = 1 / (2 * omega)
    if has_ground:
        gradients[:, 2] = gradients[:, 0]
    own = np.sqrt(np.maximum(np.diag(gradients @ fit.covariance @ gradients.T), 0))
    frequency, zeta = omega / (2 * np.pi), c / (2 * omega)
    return replace(
        ratios,
        natural_frequency_hz=Estimate.normal(frequency, np.hypot(own[0], gain / 2 * frequency)),
        damping_ratio=Estimate.normal(zeta, np.hypot(own[1], gain * zeta)),
    )


def law_estimates_of(law: Law, std: FloatArray | None = None) -> dict[str, dict[str, Estimate]]:
    """Return {kind: {parameter: Estimate}} of a law and the standard deviations of its vector, if it has any."""
    known = [None] * law.vector.size if std is None else std.tolist()
    found = map(Estimate.normal, law.vector.tolist(), known)
    return {term.name: {parameter.name: next(found) for parameter in term.kind.parameters} for term in law.terms}


# ---- warnings --------------------------------------------------------------------------------------


def warnings_of(result: PaperIdentification) -> Iterator[str]:
    """Yield what limits an answer of the mended chain, one sentence each."""
    yield from warnings_of_logs(result)
    settings, fs = result.settings, result.study.fs
    high_hz = settings.band_at(fs)[1]
    if high_hz < settings.band_hz[1]:
        yield (
            f"the runs are sampled at {fs:g} Hz, and used up to {high_hz:.4g} Hz instead of {settings.band_hz[1]:g} "
            f"Hz, because the filters of loggers begin at {settings.highest_fraction_of_rate:g} of the rate: record "
            "faster, or give a band that ends below"
        )
    yield from _warn_of_residual(result)
    yield from _warn_of_averages(result)
    yield from _warn_of_ground(result)
    yield from _warn_of_mass_change(result)
    yield from _weight(result)
    yield from (term.warning for term in straight_terms(result))


def warnings_of_logs(result: PaperIdentification) -> Iterator[str]:
    """Yield warnings about the logs."""
    for run in result.chain.runs:
        yield from findings_in_words(run.name, run.findings)


def _warn_of_residual(result: PaperIdentification) -> Iterator[str]:
    unexplained, verdicts = result.residual_over_noise, result.settings.verdicts
    if unexplained > verdicts.doubtful:
        yield (
            f"the residual is {unexplained:.1f} times the sensor noise: the law lacks a term, the slow motion below "
            "the high-pass matters, or a sensor is faulty; the intervals are widened by a factor of "
            f"{unexplained / verdicts.doubtful:.1f}"
        )
    elif unexplained > verdicts.noted:
        yield (
            f"the residual is {unexplained:.1f} times the sensor noise: most of it is due to slow motion, which the "
            "integration removes from the law"
        )


def _warn_of_averages(result: PaperIdentification) -> Iterator[str]:
    averages = min(run.T.spectra.n_averages for run in result.chain.runs)
    if averages < result.settings.few_averages:
        yield (
            f"each transmissibility has only {averages:.1f} independent averages: its coherence is near 1 by "
            "construction and its peaks are chance (the parameters do not come from it)"
        )


def _warn_of_ground(result: PaperIdentification) -> Iterator[str]:
    ground = result.parameters.ground_stiffness_n_per_m
    stiffness = result.parameters.suspension_stiffness_n_per_m
    fraction = gain_like_fraction(result.joint, result.settings)
    if fraction:
        sign = np.sign(result.joint.ratios[2])
        yield (
            f"the ground spring is {100 * sign * fraction:.1f} % of the suspension: a gain error of about "
            f"{100 * fraction:.1f} % between the two sensors has this effect (AC coupling with different corners, "
            "too), so the intervals of stiffness and damping include such an error"
        )
    elif (
        ground.value is not None
        and stiffness.value is not None
        and abs(ground.value) > result.settings.negligible_ground * abs(stiffness.value)
        and not ground.holds(0.0)
    ):
        yield (
            f"the ground spring K3 = {ground.value:.3g} N/m differs from zero, yet a free aircraft has none: sensors "
            "whose AC-coupling corners differ, a gain error, or friction outside the law imitate it; the intervals "
            "hold for equal gains, and 1 % of gain difference moves stiffness and damping by about 1 %"
        )


def _warn_of_mass_change(result: PaperIdentification) -> Iterator[str]:
    mass = result.parameters.sprung_mass_kg
    if mass.value is None or mass.std is None:
        return
    changes = [run.mass_change_kg for run in result.chain.runs]
    fraction = (max(changes) - min(changes)) / mass.value
    if mass.std / mass.value > result.settings.loose_mass:
        yield (
            f"the mass change is {100 * fraction:.0f} % of the mass, which multiplies every relative error by about "
            f"{1 / fraction:.0f}: doubling it would halve the interval of the mass"
        )


def _weight(result: PaperIdentification) -> Iterator[str]:
    changes = {run.mass_change_kg for run in result.chain.runs}
    if len(changes) > 1 and result.study.interfaces[0].axis != "horizontal" and depends_on_travel(result.joint.law):
        yield (
            "the paper's equation has one law about one rest position, but runs of another mass rest elsewhere on a "
            "law that depends on the travel: the errors of stiffness, law and mass exceed their intervals; give "
            "method='model', which computes the rest position of each run, or axis = \"horizontal\" if no weight acts"
        )
