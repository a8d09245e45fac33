"""From derivatives by what the interfaces are in one run to derivatives by the entries of the vector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from opid.mechanics.driven import N_HEAD, Interface
from opid.mechanics.laws import Term
from opid.mechanics.repeatability import PARTS, part_rows
from opid.mechanics.weight import Rest, by_parameters
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.unknowns import Unknowns


def add_rest(
    unknowns: Unknowns,
    change: ComplexArray,
    rest: Rest,
    slots: Sequence[Interface],
    theta: FloatArray,
    place: int,
    by: ComplexArray,
) -> None:
    """Add what stiffness, law, mass and departures do to the lines by way of the place where a run rests."""
    firsts = np.cumsum([0, *(slot.n_parameters for slot in slots)])
    by_travel = change[firsts[:-1] + N_HEAD - 1].copy()
    stiffer = unknowns.stiffer(theta, place)
    for number, (slot, travel) in enumerate(zip(slots, rest.travel, strict=True)):
        moved = np.tensordot(-rest.compliance[:, number], by_travel, axes=1)
        force = (1.0 + stiffer) * by_parameters(slot, travel)
        force[2] = travel  # the spring to the ground is none of the strut's
        change[firsts[number] : firsts[number + 1]] += np.multiply.outer(force, moved)
        if unknowns.n_departures and len(slots) == 1:
            own = slot.stiffness * travel + float(slot.law.static_force(travel)[0])
            by[unknowns.places_of_run(place)[1].start] += (own + unknowns.own_load) * moved
    if unknowns.mass_free:
        row = firsts[-1] + len(unknowns.body.names)
        change[row] += np.tensordot(rest.by_load / unknowns.inverse_mass(theta), by_travel, axes=1)


def add_departures(
    unknowns: Unknowns,
    change: ComplexArray,
    slots: Sequence[Interface],
    theta: FloatArray,
    place: int,
    by: ComplexArray,
) -> None:
    """Turn derivatives by what suspensions have in a run into those by what they have in all, and by departures."""
    firsts = np.cumsum([0, *(slot.n_parameters for slot in slots)])
    row = unknowns.places_of_run(place)[1].start
    for group, departure in zip(unknowns.groups, unknowns.departures(theta, place), strict=True):
        for part, factor in enumerate(departure.values):
            for slot in group.slots:
                for entry, value in part_rows(slots[slot])[part]:
                    own = change[firsts[slot] + entry]
                    by[row + part] += value * own
                    own *= 1.0 + factor
        row += len(PARTS)


def sort_out(
    unknowns: Unknowns,
    change: ComplexArray,
    slots: Sequence[Interface],
    slopes: Sequence[FloatArray],
    by_fault: Sequence[tuple[str, int, FloatArray]],
    place: int,
    by: ComplexArray,
    candidates: Mapping[int, Sequence[Term]],
) -> ComplexArray:
    """Add the derivatives by what the slots have to those by the entries of the vector; return the candidates'."""
    firsts = np.cumsum([0, *(slot.n_parameters for slot in slots)])
    further: list[ComplexArray] = []
    for number, (group, first) in enumerate(zip(unknowns.groups, unknowns.first_of_group, strict=True)):
        n_law = group.law.vector.size
        n_more = sum(len(term.values) for term in candidates.get(number, ()))
        more = np.zeros((n_more, *change.shape[1:]), dtype=np.complex128)
        for slot in group.slots:
            own = change[firsts[slot] : firsts[slot + 1]]
            head = [k for k, has_it in enumerate((True, True, group.ground, group.has_origin)) if has_it]
            by[first : first + group.n_head] += own[head]
            by[unknowns.law_places(number)] += own[N_HEAD : N_HEAD + n_law] * slopes[number][:, np.newaxis, np.newaxis]
            more += own[N_HEAD + n_law :]
        further.append(more)
    for k, (slot, _) in enumerate(unknowns.searched):
        row = unknowns.first_inside + 2 * k
        by[row : row + 2] += change[firsts[slot] : firsts[slot] + 2]
    body, n_coordinates = unknowns.body, len(unknowns.body.coordinates)
    n_factors = len(body.names) + unknowns.mass_free
    rest = change[firsts[-1] :]
    by[unknowns.first_factor : unknowns.first_factor + n_factors] += rest[:n_factors]
    by[unknowns.first_coordinate : unknowns.n_shared] += rest[n_factors : n_factors + n_coordinates]
    if unknowns.mass_free:
        row = unknowns.first_fault - 1
        for slot, spring in enumerate(body.inside, start=body.n_interfaces):
            by[row] += (spring.stiffness_n_per_m or 0.0) * change[firsts[slot]]
            by[row] += (spring.damping_n_s_per_m or 0.0) * change[firsts[slot] + 1]
    rest = rest[n_factors + n_coordinates :]
    names = [fault.name for fault in unknowns.faults]
    for row, (name, _, _) in enumerate(by_fault):
        by[unknowns.first_fault + names.index(name)] += rest[row]
    starts, row = rest[len(by_fault) :], unknowns.places_of_run(place)[0].start
    for interface in range(body.n_interfaces):
        by[row + 2 * interface] = starts[interface]
        by[row + 2 * interface + 1] = starts[body.n_slots + interface]
    return np.concatenate(further)
