"""The numbers of an answer: as fitted, and with what is not to be told taken out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.estimate import Estimate
from opid.signals.recording import FloatArray
from opid.suspensions.candidates import Fitted
from opid.suspensions.fit import EXPLAINS
from opid.suspensions.intervals import body_estimates, mass_of, suspension_estimates
from opid.suspensions.levels import REFUSED, level_of, thinned
from opid.suspensions.result import BODY_PARAMETERS, BODY_RATIOS, InterfaceEstimate
from opid.suspensions.study import BodyStudy


@dataclass(frozen=True, eq=False)
class Numbers:
    """What an answer tells.

    Args:
        parameters: one `Estimate` for each name in `BODY_PARAMETERS`.
        ratios: one `Estimate` for each name in `BODY_RATIOS`.
        interfaces: the suspensions, in the order of the study.
        corrections: {"x_m[left]": Estimate, ...} of coordinates.
    """

    parameters: Mapping[str, Estimate]
    ratios: Mapping[str, Estimate]
    interfaces: tuple[InterfaceEstimate, ...]
    corrections: Mapping[str, Estimate]

    def told(self, ratio: float, lack: float, reason: str | None, loose: Sequence[str]) -> Numbers:
        """Return what is to be told of them.

        Args:
            ratio: residual over noise of the worst part: beyond `REFUSED` no value is told.
            lack: the larger of that and of what it leaves of runs that the others predict. Beyond `EXPLAINS` intervals
                are withheld: what a structure lacks is no noise, and does not average out.
            reason: why the mass is not determined; None if it is.
            loose: motions whose inertia is hardly told.
        """
        parameters, ratios, interfaces = dict(self.parameters), dict(self.ratios), self.interfaces
        corrections = dict(self.corrections)
        for motion in loose:
            parameters[f"{motion}_inertia_kg_m2"] = ratios[f"{motion}_radius_m"] = Estimate()
        if lack > EXPLAINS:
            parameters, ratios, corrections = (
                {name: Estimate(each.value) for name, each in table.items()}
                for table in (parameters, ratios, corrections)
            )
            interfaces = tuple(_without_intervals(each) for each in interfaces)
        if reason:
            parameters = dict.fromkeys(BODY_PARAMETERS, Estimate())
        if ratio > REFUSED:
            ratios = dict.fromkeys(BODY_RATIOS, Estimate())
            interfaces = tuple(
                replace(each, stiffness=Estimate(), damping=Estimate(), law_estimates={}) for each in interfaces
            )
        return Numbers(parameters, ratios, interfaces, corrections)


def found_numbers(
    study: BodyStudy, kind: str, parts: Sequence[Fitted], covariances: Sequence[FloatArray], *, per_mass: bool
) -> Numbers:
    """Return the numbers of some fits as they are.

    Args:
        study: the study.
        kind: of structure.
        parts: the fits that make up the answer.
        covariances: of their shared parameters.
        per_mass: whether suspensions are told per kg of the body, and no masses.
    """
    parameters, ratios = dict.fromkeys(BODY_PARAMETERS, Estimate()), dict.fromkeys(BODY_RATIOS, Estimate())
    if kind == "rigid_body":
        parameters, ratios = body_estimates(parts[0].found, covariances[0])
    else:
        parameters["sprung_mass_kg"] = _total(parts, covariances)
    if per_mass:
        parameters = dict.fromkeys(BODY_PARAMETERS, Estimate())
    interfaces = _interfaces(study, parts, covariances, per_mass=per_mass)
    return Numbers(parameters, ratios, interfaces, _corrections(parts, covariances))


def _total(parts: Sequence[Fitted], covariances: Sequence[FloatArray]) -> Estimate:
    """Mass of all gears together, where each is known."""
    if not all(part.found.model.mass_free for part in parts):
        return Estimate()
    value = variance = 0.0
    for part, covariance in zip(parts, covariances, strict=True):
        mass, count = mass_of(part.found, covariance), len(part.interfaces)
        if mass.value is None or mass.std is None:
            return Estimate()
        value, variance = value + count * mass.value, variance + (count * mass.std) ** 2
    return Estimate.normal(value, float(np.sqrt(variance)))


def _interfaces(
    study: BodyStudy,
    parts: Sequence[Fitted],
    covariances: Sequence[FloatArray],
    *,
    per_mass: bool,
) -> tuple[InterfaceEstimate, ...]:
    found: dict[int, InterfaceEstimate] = {}
    for part, covariance in zip(parts, covariances, strict=True):
        fit = part.found
        mu = 1.0 if per_mass else fit.model.inverse_mass(fit.theta)
        for number, group in enumerate(fit.groups()):
            stiffness, damping, law = suspension_estimates(fit, covariance, number, per_mass=per_mass)
            members = [part.interfaces[slot] for slot in group.slots] if part.kind == "rigid_body" else part.interfaces
            for k, member in enumerate(members):
                slot = group.slots[k] if part.kind == "rigid_body" else 0
                found[member] = InterfaceEstimate(
                    name=study.names[member],
                    shared_with=tuple(study.names[other] for other in members if other != member),
                    stiffness=stiffness,
                    damping=damping,
                    law=group.law.scaled(1 / mu) if group.law.terms else group.law,
                    law_estimates=law,
                    travel=thinned([p.travel[:, slot] for p in fit.errors.predictions]),
                    velocity=thinned([p.velocity[:, slot] for p in fit.errors.predictions]),
                    residual_over_noise=level_of(fit, slot) / part.noise,
                )
    return tuple(found[k] for k in sorted(found))


def _without_intervals(each: InterfaceEstimate) -> InterfaceEstimate:
    law = {kind: {name: Estimate(e.value) for name, e in table.items()} for kind, table in each.law_estimates.items()}
    return replace(
        each, stiffness=Estimate(each.stiffness.value), damping=Estimate(each.damping.value), law_estimates=law
    )


def _corrections(parts: Sequence[Fitted], covariances: Sequence[FloatArray]) -> dict[str, Estimate]:
    found = {}
    for part, covariance in zip(parts, covariances, strict=True):
        for coordinate in part.found.model.body.coordinates:
            k = part.found.model.names.index(coordinate.name)
            found[coordinate.name] = Estimate.normal(float(part.found.theta[k]), float(np.sqrt(covariance[k, k])))
    return found
