"""The numbers of an answer: as fitted, without those that are not determined, and the gas of a strut as serviced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.estimate import Estimate, Estimates
from opid.mechanics.laws.law import Law
from opid.mechanics.weight import ATMOSPHERE_PA
from opid.signals.recording import FloatArray
from opid.suspensions.answer.intervals import Parameters
from opid.suspensions.answer.refusals import ConfoundedTerm
from opid.suspensions.candidates import Choice, FittedStructure
from opid.suspensions.fitting.noise import sensor_ratio, thin_samples
from opid.suspensions.result import (
    AtRest,
    BodyParameters,
    BodyRatios,
    Evidence,
    GasColumn,
    GearParameters,
    GearRatios,
    InterfaceEstimate,
)
from opid.suspensions.settings import GasSettings


@dataclass(frozen=True, eq=False)
class Numbers(Estimates):
    """The numbers of an answer.

    Args:
        parameters: absolute values.
        ratios: values that need no known mass.
        interfaces: the suspensions, in the order of the study.
        corrections: {"x_m[left]": Estimate, ...}, corrections of coordinates.
    """

    parameters: GearParameters | BodyParameters
    ratios: GearRatios | BodyRatios
    interfaces: tuple[InterfaceEstimate, ...]
    corrections: Mapping[str, Estimate]

    def without_intervals(self) -> Numbers:
        """Return the values alone."""
        return self.with_estimates(Estimate.without_interval)

    def without_scale(self) -> Numbers:
        """Return the numbers without absolute values of the body."""
        return self.with_estimates(_withhold_estimate, only={"parameters"})

    def without_motions(self, motions: Sequence[str]) -> Numbers:
        """Return the numbers without the inertia of motions that the runs hardly determine."""
        parameters = self.parameters.with_estimates(
            _withhold_estimate, only={f"{motion}_inertia_kg_m2" for motion in motions}
        )
        ratios = self.ratios.with_estimates(_withhold_estimate, only={f"{motion}_radius_m" for motion in motions})
        return replace(self, parameters=parameters, ratios=ratios)

    def without_values(self) -> Numbers:
        """Return only the names of the laws, for a refused answer."""
        empty = self.with_estimates(_withhold_estimate)
        interfaces = tuple(replace(each, law_estimates={}, at_rest=()) for each in empty.interfaces)
        return replace(empty, interfaces=interfaces, corrections={})

    def without_intervals_of(self, terms: Sequence[ConfoundedTerm], names: Mapping[str, Sequence[str]]) -> Numbers:
        """Return the numbers without the intervals of terms and of the parameters that they are confounded with."""
        parameters, ratios, interfaces = self.parameters, self.ratios, list(self.interfaces)
        for term in terms:
            parameters = parameters.with_estimates(Estimate.without_interval, only=term.confounded_with)
            ratios = ratios.with_estimates(Estimate.without_interval, only=term.confounded_with)
            for k, each in enumerate(interfaces):
                if each.name in names[term.group]:
                    laws = term.without_interval(each.law_estimates)
                    bare = each.with_estimates(Estimate.without_interval, only=term.confounded_with)
                    at_rest = tuple(
                        run.with_estimates(Estimate.without_interval, only=term.confounded_at_rest)
                        for run in each.at_rest
                    )
                    interfaces[k] = replace(bare, law_estimates=laws, at_rest=at_rest)
        return replace(self, parameters=parameters, ratios=ratios, interfaces=tuple(interfaces))


def _withhold_estimate(_: Estimate) -> Estimate:
    return Estimate()


def collect_numbers(choice: Choice, evidence: Sequence[Evidence], *, per_mass: bool, ground: bool) -> Numbers:
    """Return the numbers of the fits of an answer.

    With `per_mass` suspensions are reported per kg of the body, and no masses; `ground` says whether springs to the
    ground were allowed.
    """
    parts = choice.parts
    interfaces = _estimate_interfaces(choice, evidence, per_mass=per_mass, ground=ground)
    if choice.study.is_one_gear:
        first, known = interfaces[0], parts[0].known
        std = evidence[0].ground.std_per_mass[0] if ground else None
        ratios = known.gear_ratios(known.ground(0, std, per_mass=True))
        gear = GearParameters()
        if not per_mass:
            gear = GearParameters(known.mass, first.stiffness, first.damping, first.ground_stiffness)
        return Numbers(gear, ratios, interfaces, {})
    if choice.kind == "rigid_body":
        body, radii = parts[0].known.estimate_rigid_body()
    else:
        body, radii = BodyParameters(_sum_masses(parts)), BodyRatios()
    return Numbers(BodyParameters() if per_mass else body, radii, interfaces, _collect_corrections(parts))


def _sum_masses(parts: Sequence[FittedStructure]) -> Estimate:
    """Return the mass of all gears together, if each of them is known."""
    if not all(part.fit.model.mass_free for part in parts):
        return Estimate()
    value = variance = 0.0
    for part in parts:
        mass, count = part.known.mass, len(part.interfaces)
        if mass.value is None or mass.std is None:
            return Estimate()
        value, variance = value + count * mass.value, variance + (count * mass.std) ** 2
    return Estimate.normal(value, float(np.sqrt(variance)))


def _estimate_interfaces(
    choice: Choice, evidence: Sequence[Evidence], *, per_mass: bool, ground: bool
) -> tuple[InterfaceEstimate, ...]:
    names = choice.study.names
    found: dict[int, InterfaceEstimate] = {}
    for part, row in zip(choice.parts, evidence, strict=True):
        fit, is_rigid = part.fit, part.kind == "rigid_body"
        mu = 1.0 if per_mass else fit.model.inverse_mass(fit.theta)
        rests = at_rest(part, per_mass=per_mass)
        for number, group in enumerate(fit.groups):
            stiffness, damping, law = part.known.suspension(number, per_mass=per_mass)
            std = row.ground.std_per_mass[number] if ground else None
            spring = part.known.ground(number, std, per_mass=per_mass)
            members = [part.interfaces[attachment] for attachment in group.members] if is_rigid else part.interfaces
            for k, member in enumerate(members):
                attachment = group.members[k] if is_rigid else 0
                travel, velocity = fit.motion(attachment)
                found[member] = InterfaceEstimate(
                    name=names[member],
                    shared_with=tuple(names[other] for other in members if other != member),
                    stiffness=stiffness,
                    damping=damping,
                    ground_stiffness=spring,
                    law=group.law.scaled(1 / mu) if group.law.terms else group.law,
                    law_estimates=law,
                    travel=thin_samples(travel),
                    velocity=thin_samples(velocity),
                    residual_over_noise=sensor_ratio(fit, attachment) * fit.model.level / part.level,
                    rest_m=part.known.rest(number),
                    at_rest=rests[attachment],
                    gas=None
                    if per_mass
                    else gas_of(part.known, number, choice.study.interfaces[member].piston_area_m2),
                )
    return tuple(found[k] for k in sorted(found))


def at_rest(part: FittedStructure, *, per_mass: bool) -> list[tuple[AtRest, ...]]:
    """Return each suspension at rest in each run; `per_mass` gives forces per unit of the reference mass."""
    found: list[list[AtRest]] = [[] for _ in range(part.fit.model.body.n_interfaces)]
    for index, name in enumerate(part.task.run_names):
        estimates = part.known.at_rest(index, per_mass=per_mass)
        for attachment, (travel_m, stiffness, damping) in enumerate(estimates):
            travel = part.fit.errors.predictions[index].travel[:, attachment] + (travel_m.value or 0.0)
            travelled_m, loop = (
                (float(travel.min()), float(travel.max())),
                part.known.loop(attachment, index, per_mass=per_mass),
            )
            found[attachment].append(AtRest(name, travel_m, stiffness, damping, travelled_m, loop))
    return [tuple(each) for each in found]


def _collect_corrections(parts: Sequence[FittedStructure]) -> dict[str, Estimate]:
    found = {}
    for part in parts:
        for coordinate in part.fit.model.body.coordinates:
            k = part.fit.model.names.index(coordinate.name)
            found[coordinate.name] = Estimate.normal(float(part.fit.theta[k]), part.known.std(k))
    return found


# ---- the gas of a strut -----------------------------------------------------------------------------


def gas_of(known: Parameters, number: int, piston_area_m2: float | None) -> GasColumn | None:
    """Return the gas that carries a group of interfaces in the reference run; None if there is none.

    The mass must be determined.
    """
    model, theta = known.fit.model, known.fit.theta
    index = index_of_gas(model.laws(theta)[number])
    if index is None or model.inverse_mass(theta) <= 0.0:
        return None

    def read(vector: FloatArray) -> FloatArray:
        term = model.laws(vector)[number].terms[index]
        return amounts_of_gas(term.amplitude / model.inverse_mass(vector), term.inner[0], piston_area_m2)

    return as_gas_column(known.estimate_function(read), piston_area_m2)


def index_of_gas(law: Law) -> int | None:
    """Return the index of the term of a law that is a column of gas; None if there is none."""
    return next((index for index, term in enumerate(law.terms) if term.kind.quasi_static), None)


def amounts_of_gas(force_n: float, length_m: float, piston_area_m2: float | None) -> FloatArray:
    """Return pressure times volume, gauge pressure and volume of a column of gas, (3,) in N m, Pa and m^3.

    The gauge pressure is the absolute pressure p minus that of the air.

    Args:
        force_n: force of the law at its origin, p A.
        length_m: length of the column, V/A.
        piston_area_m2: A; None if it is not stated, so that only the first of the three values belongs to the gas.
    """
    area = piston_area_m2 or 1.0
    return np.array([force_n * length_m, force_n / area - ATMOSPHERE_PA, area * length_m])


def as_gas_column(amounts: Sequence[Estimate], piston_area_m2: float | None) -> GasColumn:
    """Return the gas column of these amounts, with pressure and volume only if the `piston_area_m2` is stated."""
    return GasColumn(amounts[0]) if piston_area_m2 is None else GasColumn(*amounts)


def warn_of_area(gas: GasColumn | None, piston_area_m2: float | None, settings: GasSettings) -> Iterator[str]:
    """Yield that the stated area of a piston contradicts the static pressure, in one sentence.

    Args:
        gas: the gas that was found, or None.
        piston_area_m2: the stated area.
        settings: the pressures at which struts are serviced.
    """
    pressure, (low, high) = None if gas is None else gas.pressure_pa.value, settings.pressures_pa
    if pressure is not None and not low <= pressure <= high:
        yield (
            f"the stated piston_area_m2 of {piston_area_m2:g} contradicts the static pressure: with this area the gas "
            f"would have {1e-6 * pressure:.2g} MPa, but struts are serviced with {1e-6 * low:g} to {1e-6 * high:g} "
            "MPa; check the area and the unit of the mass changes (on the test bench, of the force)"
        )
