"""The numbers of an answer: as fitted, and with what is not to be told taken out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.estimate import Estimate
from opid.signals.recording import FloatArray
from opid.suspensions.candidates import Fitted
from opid.suspensions.intervals import (
    body_estimates,
    gear_ratios,
    ground_estimate,
    mass_of,
    suspension_estimates,
)
from opid.suspensions.residual import sensor_ratio, thinned
from opid.suspensions.result import (
    BODY_PARAMETERS,
    BODY_RATIOS,
    GEAR_PARAMETERS,
    GEAR_RATIOS,
    Evidence,
    InterfaceEstimate,
)
from opid.suspensions.study import Study
from opid.suspensions.warnings import StraightTerm

_TRADES_WITH = {
    "m/s": ("suspension_damping_n_s_per_m", "damping_per_mass", "damping_ratio"),
    "m": ("suspension_stiffness_n_per_m", "stiffness_per_mass", "natural_frequency_hz", "damping_ratio"),
}
"""What a term that is straight in velocity (its scale in m/s) or in travel (m) cannot be told from."""


@dataclass(frozen=True, eq=False)
class Numbers:
    """What an answer tells.

    Args:
        parameters: one `Estimate` for each name in `GEAR_PARAMETERS` or `BODY_PARAMETERS`.
        ratios: one `Estimate` for each name in `GEAR_RATIOS` or `BODY_RATIOS`.
        interfaces: the suspensions, in the order of the study.
        corrections: {"x_m[left]": Estimate, ...} of coordinates.
    """

    parameters: Mapping[str, Estimate]
    ratios: Mapping[str, Estimate]
    interfaces: tuple[InterfaceEstimate, ...]
    corrections: Mapping[str, Estimate]

    def without_intervals(self) -> Numbers:
        """Return the values alone."""
        parameters, ratios, corrections = (
            {name: Estimate(each.value) for name, each in table.items()}
            for table in (self.parameters, self.ratios, self.corrections)
        )
        return Numbers(parameters, ratios, tuple(map(_without_intervals, self.interfaces)), corrections)

    def without_scale(self) -> Numbers:
        """Return them without absolute values of the body."""
        return replace(self, parameters=dict.fromkeys(self.parameters, Estimate()))

    def without_motions(self, motions: Sequence[str]) -> Numbers:
        """Return them without the inertia of motions that the runs hardly tell."""
        parameters, ratios = dict(self.parameters), dict(self.ratios)
        for motion in motions:
            parameters[f"{motion}_inertia_kg_m2"] = ratios[f"{motion}_radius_m"] = Estimate()
        return replace(self, parameters=parameters, ratios=ratios)

    def without_values(self) -> Numbers:
        """Return nothing but the laws by name: every number would be a guess."""
        interfaces = tuple(
            replace(each, stiffness=Estimate(), damping=Estimate(), ground_stiffness=Estimate(), law_estimates={})
            for each in self.interfaces
        )
        nothing = {name: dict.fromkeys(getattr(self, name), Estimate()) for name in ("parameters", "ratios")}
        return Numbers(nothing["parameters"], nothing["ratios"], interfaces, {})

    def without_intervals_of(self, terms: Sequence[StraightTerm], names: Mapping[str, Sequence[str]]) -> Numbers:
        """Return them without the intervals of what trades with straight terms."""
        parameters, ratios, interfaces = dict(self.parameters), dict(self.ratios), list(self.interfaces)
        for term in terms:
            for name in _TRADES_WITH[term.unit]:
                for table in (parameters, ratios):
                    if name in table:
                        table[name] = Estimate(table[name].value)
            for k, each in enumerate(interfaces):
                if each.name in names[term.group]:
                    law = dict(each.law_estimates)
                    law[term.kind] = {name: Estimate(e.value) for name, e in law.get(term.kind, {}).items()}
                    interfaces[k] = replace(each, law_estimates=law)
                    if term.unit == "m/s":
                        interfaces[k] = replace(interfaces[k], damping=Estimate(each.damping.value))
                    else:
                        interfaces[k] = replace(interfaces[k], stiffness=Estimate(each.stiffness.value))
        return replace(self, parameters=parameters, ratios=ratios, interfaces=tuple(interfaces))


def found_numbers(
    study: Study,
    kind: str,
    parts: Sequence[Fitted],
    covariances: Sequence[FloatArray],
    evidence: Sequence[Evidence],
    *,
    per_mass: bool,
    ground: bool,
) -> Numbers:
    """Return the numbers of some fits as they are."""
    interfaces = _interfaces(study, parts, covariances, evidence, per_mass=per_mass, ground=ground)
    if study.is_one_gear:
        return Numbers(
            *_of_gear(parts[0], covariances[0], evidence[0], interfaces[0], per_mass, ground), interfaces, {}
        )
    parameters, ratios = dict.fromkeys(BODY_PARAMETERS, Estimate()), dict.fromkeys(BODY_RATIOS, Estimate())
    if kind == "rigid_body":
        parameters, ratios = body_estimates(parts[0].fit, covariances[0])
    else:
        parameters["sprung_mass_kg"] = _total(parts, covariances)
    if per_mass:
        parameters = dict.fromkeys(BODY_PARAMETERS, Estimate())
    return Numbers(parameters, ratios, interfaces, _corrections(parts, covariances))


def _of_gear(
    part: Fitted, covariance: FloatArray, evidence: Evidence, first: InterfaceEstimate, per_mass: bool, ground: bool
) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    std = evidence.ground.std_per_mass[0] if ground else None
    over_mass = ground_estimate(part.fit, covariance, 0, std, per_mass=True)
    ratios = gear_ratios(part.fit, covariance, over_mass)
    assert tuple(ratios) == GEAR_RATIOS
    if per_mass:
        return dict.fromkeys(GEAR_PARAMETERS, Estimate()), ratios
    values = (mass_of(part.fit, covariance), first.stiffness, first.damping, first.ground_stiffness)
    return dict(zip(GEAR_PARAMETERS, values, strict=True)), ratios


def _total(parts: Sequence[Fitted], covariances: Sequence[FloatArray]) -> Estimate:
    """Mass of all gears together, where each is known."""
    if not all(part.fit.model.mass_free for part in parts):
        return Estimate()
    value = variance = 0.0
    for part, covariance in zip(parts, covariances, strict=True):
        mass, count = mass_of(part.fit, covariance), len(part.interfaces)
        if mass.value is None or mass.std is None:
            return Estimate()
        value, variance = value + count * mass.value, variance + (count * mass.std) ** 2
    return Estimate.normal(value, float(np.sqrt(variance)))


def _interfaces(
    study: Study,
    parts: Sequence[Fitted],
    covariances: Sequence[FloatArray],
    evidence: Sequence[Evidence],
    *,
    per_mass: bool,
    ground: bool,
) -> tuple[InterfaceEstimate, ...]:
    found: dict[int, InterfaceEstimate] = {}
    for part, covariance, known in zip(parts, covariances, evidence, strict=True):
        fit, is_rigid = part.fit, part.kind == "rigid_body"
        mu = 1.0 if per_mass else fit.model.inverse_mass(fit.theta)
        for number, group in enumerate(fit.groups):
            stiffness, damping, law = suspension_estimates(fit, covariance, number, per_mass=per_mass)
            std = known.ground.std_per_mass[number] if ground else None
            spring = ground_estimate(fit, covariance, number, std, per_mass=per_mass)
            members = [part.interfaces[slot] for slot in group.slots] if is_rigid else part.interfaces
            for k, member in enumerate(members):
                slot = group.slots[k] if is_rigid else 0
                travel, velocity = fit.motion(slot)
                found[member] = InterfaceEstimate(
                    name=study.names[member],
                    shared_with=tuple(study.names[other] for other in members if other != member),
                    stiffness=stiffness,
                    damping=damping,
                    ground_stiffness=spring,
                    law=group.law.scaled(1 / mu) if group.law.terms else group.law,
                    law_estimates=law,
                    travel=thinned(travel),
                    velocity=thinned(velocity),
                    residual_over_noise=sensor_ratio(fit, slot) * fit.model.level / part.level,
                )
    return tuple(found[k] for k in sorted(found))


def _without_intervals(each: InterfaceEstimate) -> InterfaceEstimate:
    law = {kind: {name: Estimate(e.value) for name, e in table.items()} for kind, table in each.law_estimates.items()}
    return replace(
        each,
        stiffness=Estimate(each.stiffness.value),
        damping=Estimate(each.damping.value),
        ground_stiffness=Estimate(each.ground_stiffness.value),
        law_estimates=law,
    )


def _corrections(parts: Sequence[Fitted], covariances: Sequence[FloatArray]) -> dict[str, Estimate]:
    found = {}
    for part, covariance in zip(parts, covariances, strict=True):
        for coordinate in part.fit.model.body.coordinates:
            k = part.fit.model.names.index(coordinate.name)
            found[coordinate.name] = Estimate.normal(float(part.fit.theta[k]), float(np.sqrt(covariance[k, k])))
    return found
