"""The vector of unknowns of all runs: its layout, and the suspensions and sensors at its values.

The module also holds the prior knowledge of the entries, and the conversion of derivatives by the parameters of the
interfaces in one run to those by the entries.

A gear alone is a body with one interface, M2 its mass. The equations are the same for any number of interfaces; only a
column of gas, which carries the weight, needs a single suspension.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from opid.mechanics.driven import N_HEAD, Interface
from opid.mechanics.laws.law import LINEAR, Law, Term, WithCandidates
from opid.mechanics.repeatability import PARTS, Departure, part_rows
from opid.mechanics.weight import (
    ATMOSPHERE_PA,
    GRAVITY_M_PER_S2,
    Rest,
    by_parameters,
    depends_on_rest,
    find_rest,
    resting,
)
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.model.body import Body, Mobility, Scale, mobility
from opid.suspensions.model.law_parameters import free_bounds, from_free, positive
from opid.suspensions.model.run import Corrected, DrivenRun
from opid.suspensions.sensor_facts import Fault, Sensors
from opid.suspensions.settings import Settings

GROUND = "ground_stiffness_per_mass"
"""Name of the unknown of a spring to the ground."""


@dataclass(frozen=True)
class Group:
    """Interfaces that share stiffness, damping, ground spring and law.

    Args:
        name: "left", or "left, right"; "" for one gear.
        members: indices of its interfaces.
        law: a law with the terms to be fitted, per unit of the reference mass.
        ground: whether springs act between the body and the ground at these interfaces.
        origin_m: approximate distance of the origin of the law from the rest position in the reference run, m; the
            vector then has the rest position as an entry. None if the origin is the rest position.
    """

    name: str
    members: tuple[int, ...]
    law: Law = LINEAR
    ground: bool = False
    origin_m: float | None = None

    @property
    def has_origin(self) -> bool:
        """Whether the law has an origin of its own."""
        return self.origin_m is not None

    @property
    def head(self) -> tuple[str, ...]:
        """Names of the entries of the vector before those of the law."""
        further = ((GROUND, self.ground), ("rest_m", self.has_origin))
        return ("stiffness_per_mass", "damping_per_mass", *(name for name, has_it in further if has_it))

    @property
    def n_head(self) -> int:
        """Number of entries of the vector before those of the law."""
        return len(self.head)

    def name_of(self, what: str) -> str:
        """Return the name of one of its parameters."""
        return f"{what}[{self.name}]" if self.name else what


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns that all runs have in common, those of each run, and their layout in one vector.

    The vector holds, for each group, stiffness, damping, [ground stiffness], [rest position on its law] and law
    (positive entries as logarithms); stiffness and damping of each unknown spring inside; free factors of the mass;
    [1 / reference mass]; faults of sensors; coordinates; then, for each run, initial travel and velocity of each
    interface, and the departures of springs, damping and friction of each group from those of all runs.

    Args:
        runs: the runs.
        body: the body.
        groups: the groups of interfaces that share a suspension.
        sensors: facts known of the sensors, and their free faults.
        mass_free: whether one over the reference mass is fitted.
        motion_rms: (n_interfaces, 2) approximate rms travel (m) and velocity (m/s).
        settings: settings of the estimator.
        repeatability: relative standard deviation of springs, damping and friction from run to run; 0 if they are the
            same in all runs.
        held_inverse_mass: one over the reference mass if it is not fitted, 1/kg; 0 for ratios alone.
        gains_differ: factor on the stated standard deviations by which gains differ from run to run.
    """

    runs: tuple[DrivenRun, ...]
    body: Body
    groups: tuple[Group, ...]
    sensors: Sensors
    mass_free: bool
    motion_rms: FloatArray
    settings: Settings
    repeatability: float = 0.0
    held_inverse_mass: float = 0.0
    gains_differ: float = 1.0

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the shared parameters."""
        names: list[str] = []
        for group in self.groups:
            names += [group.name_of(head) for head in group.head]
            names += [f"{group.name_of('law')}[{i}]" for i in range(group.law.vector.size)]
        for _, spring in self.searched:
            names += [f"stiffness_per_mass[{spring}]", f"damping_per_mass[{spring}]"]
        names += [*self.body.names, *(["inverse_mass"] if self.mass_free else [])]
        names += [fault.name for fault in self.faults]
        return (*names, *(coordinate.name for coordinate in self.body.coordinates))

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The faults of sensors that are fitted."""
        return self.sensors.faults

    @cached_property
    def searched(self) -> tuple[tuple[int, str], ...]:
        """Attachments and names of the unknown springs inside."""
        inside = enumerate(self.body.inside, start=self.body.n_interfaces)
        return tuple((attachment, spring.name) for attachment, spring in inside if spring.stiffness_n_per_m is None)

    @cached_property
    def first_of_group(self) -> tuple[int, ...]:
        """Index of the stiffness of each group in the vector."""
        sizes = [group.n_head + group.law.vector.size for group in self.groups]
        return tuple(int(index) for index in np.cumsum([0, *sizes])[:-1])

    @property
    def n_shared(self) -> int:
        """Number of shared parameters."""
        return len(self.names)

    @property
    def ground(self) -> bool:
        """Whether any spring acts between body and ground."""
        return any(group.ground for group in self.groups)

    @property
    def n_own(self) -> int:
        """Number of entries of the vector for each run."""
        return 2 * self.body.n_interfaces + self.n_departures

    @property
    def n_departures(self) -> int:
        """Number of departures of the groups in one run."""
        return len(PARTS) * len(self.groups) * (self.repeatability > 0.0)

    def indices_of_run(self, index: int) -> tuple[slice, slice]:
        """Return the indices of the initial state of a run, and of its departures."""
        first = self.n_shared + self.n_own * index
        middle = first + 2 * self.body.n_interfaces
        return slice(first, middle), slice(middle, first + self.n_own)

    def departures(self, theta: FloatArray, index: int) -> tuple[Departure, ...]:
        """Return the departures of each group in a run from the parameters of all runs."""
        if not self.n_departures:
            return (Departure(),) * len(self.groups)
        values = theta[self.indices_of_run(index)[1]].reshape(-1, len(PARTS))
        return tuple(Departure(*row) for row in values.tolist())

    @property
    def has_prior_mass(self) -> bool:
        """Whether the mass is fitted and known beforehand."""
        return self.mass_free and self.body.prior_mass_kg > 0.0

    @property
    def scales(self) -> tuple[tuple[Scale, int], ...]:
        """Sensors of a force whose gain gives the mass, if it is fitted, with the index of their gain in the vector."""
        if not self.mass_free:
            return ()
        return tuple(
            (scale, index)
            for scale in self.body.scales
            for index, fault in enumerate(self.faults, start=self.first_fault)
            if (fault.kind, fault.side, fault.channel, fault.run) == ("gain", "sprung", scale.channel, None)
        )

    @cached_property
    def stds_of_run_gains(self) -> dict[int, float]:
        """Stated standard deviations of the gains that differ from run to run, by their index in the vector."""
        return {
            index: fault.std
            for index, fault in enumerate(self.faults, start=self.first_fault)
            if fault.kind == "gain" and fault.run is not None
        }

    def describe_sensor(self, fault: Fault) -> str:
        """Return the sensor that has a fault in words: "sprung sensor", or "sensor of the strut at 'nose_load'".

        Args:
            fault: one of `faults`.
        """
        first_of_struts = len(self.sensors.sprung) - self.runs[0].n_strut
        of_strut = fault.side == "sprung" and fault.channel >= first_of_struts
        # A gear alone has one group, and its sensors need no names.
        name = self.sensors.names[fault.channel] or self.groups[0].name
        return ("sensor of the strut" if of_strut else f"{fault.side} sensor") + (f" at {name!r}" if name else "")

    @property
    def own_load(self) -> float:
        """Weight of a body on one suspension without a loading, with its sign; 0 if no weight acts.

        Per unit of the reference mass, m/s^2; in N where the body is given in kg.
        """
        return 0.0 if self.body.fall is None else float(self.body.unit[0, 0] * self.body.fall[0])

    @property
    def weight(self) -> float:
        """Force that one gear carries at rest in the reference run, per unit of the reference mass, m/s^2.

        It is 0 if no weight acts, and for bodies, because the fractions that their gears carry are unknown.
        """
        return abs(self.own_load) if self.body.is_one_gear else 0.0

    @property
    def is_carried(self) -> bool:
        """Whether the load of a column of gas is known; the axis must count outwards, as the gas pushes."""
        return self.body.is_one_gear and self.own_load < 0.0

    @cached_property
    def carriers(self) -> tuple[tuple[int, int], ...]:
        """Groups whose law has a term that carries the weight, and the index of the term in the vector."""
        if not self.is_carried:
            return ()
        found, index = [], self.law_indices(0).start
        for term in self.groups[0].law.terms:
            if term.kind.quasi_static:
                found.append((0, index))
            index += len(term.values)
        return tuple(found)

    def carrier(self, number: int) -> Term:
        """Return the term of a group that carries the weight."""
        return next(term for term in self.groups[number].law.terms if term.kind.quasi_static)

    @property
    def first_coordinate(self) -> int:
        """Index of the first coordinate in the vector."""
        return self.n_shared - len(self.body.coordinates)

    @property
    def first_fault(self) -> int:
        """Index of the first fault of a sensor in the vector."""
        return self.first_coordinate - len(self.faults)

    @property
    def first_factor(self) -> int:
        """Index of the first free factor of the mass in the vector."""
        return self.first_fault - self.mass_free - len(self.body.names)

    @property
    def first_inside(self) -> int:
        """Index of the first unknown spring inside."""
        return self.first_factor - 2 * len(self.searched)

    def law_indices(self, number: int) -> slice:
        """Return the indices of the law of a group in the vector."""
        first = self.first_of_group[number] + self.groups[number].n_head
        return slice(first, first + self.groups[number].law.vector.size)

    def inverse_mass(self, theta: FloatArray) -> float:
        """Return one over the reference mass at a vector, 1/kg; 1 where the body is given in kg."""
        if self.mass_free:
            return float(theta[self.first_fault - 1])
        return 1.0 if self.body.absolute else self.held_inverse_mass

    def mobility(self, theta: FloatArray, index: int) -> Mobility:
        """Return the accelerances of the body in one run."""
        first = self.first_factor
        factors, shifts = theta[first : first + len(self.body.names)], theta[self.first_coordinate : self.n_shared]
        return mobility(self.body, factors, self.inverse_mass(theta), shifts, self.runs[index].loading)

    def fault_values(self, theta: FloatArray) -> dict[str, float]:
        """Return the faults of the sensors at a vector by name."""
        first = self.first_fault
        return {fault.name: float(theta[first + k]) for k, fault in enumerate(self.faults)}

    def gains(self, theta: FloatArray, run: int) -> tuple[FloatArray, FloatArray]:
        """Return the gain of every sensor below the suspensions and on the body in the run with a number."""
        gains = np.ones(len(self.sensors.unsprung)), np.ones(len(self.sensors.sprung))
        for k, fault in enumerate(self.faults, start=self.first_fault):
            if fault.kind == "gain" and fault.run in (None, run):
                gains[fault.side == "sprung"][fault.channel] *= theta[k]
        return gains

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds of the vector, infinite except for laws, faults, coordinates and departures."""
        lower = np.full(self.n_shared + self.n_own * len(self.runs), -np.inf)
        upper = -lower
        for number, group in enumerate(self.groups):
            travel_rms, velocity_rms = np.sqrt(np.mean(self.motion_rms[list(group.members)] ** 2, axis=0))
            rests_apart_m = self._estimate_distance_of_rests(travel_rms, velocity_rms)
            travel_rms = np.hypot(travel_rms, group.origin_m or 0.0)
            indices = self.law_indices(number)
            lower[indices], upper[indices] = free_bounds(
                group.law,
                travel_rms=travel_rms,
                velocity_rms=velocity_rms,
                rests_apart_m=rests_apart_m,
                slide_beyond=self.settings.fit.slide_beyond,
            )
        farthest = self.settings.fit.farthest_std
        for k, fault in enumerate(self.faults, start=self.first_fault):
            reach = farthest * fault.std * (self.gains_differ if k in self.stds_of_run_gains else 1.0)
            lower[k], upper[k] = fault.nominal - reach, fault.nominal + reach
            if fault.kind == "gain" and any(run.drive_step_m_per_s2 for run in self.runs):
                # Without a measured drive a gain is the same as another stiffness, damping and law. What little tells
                # them apart is what is assumed of the drive: the gain stays as stated, and only widens the intervals.
                lower[k] = upper[k] = fault.nominal
            elif fault.kind == "gain":
                lower[k] = max(lower[k], self.settings.faults.least_gain)
            elif fault.kind == "corner":
                # Even if a corner is stated with a small standard deviation, the sensor may have none.
                lower[k] = min(fault.nominal, self.settings.faults.slight_corner_hz)
        for index in range(len(self.runs)):
            own = self.indices_of_run(index)[1]
            upper[own] = self.settings.repeatability.farthest_std * self.repeatability
            lower[own] = -upper[own]
        for k, coordinate in enumerate(self.body.coordinates, start=self.first_coordinate):
            lower[k], upper[k] = -farthest * coordinate.std, farthest * coordinate.std
        return lower, upper

    def _estimate_distance_of_rests(self, travel_rms: float, velocity_rms: float) -> float:
        """Return the approximate distance between the rest positions of runs of other loadings, m.

        These runs visit the law there, too.
        """
        if self.body.fall is None or not any(run.loading.any() for run in self.runs):
            return 0.0
        static_m = GRAVITY_M_PER_S2 * (travel_rms / velocity_rms) ** 2
        return self.settings.fit.usual_mass_fraction * static_m

    def largest_steps(self) -> FloatArray:
        """Return the largest change of each entry in one step."""
        caps = np.full(self.n_shared + self.n_own * len(self.runs), np.inf)
        for number, (group, first) in enumerate(zip(self.groups, self.first_of_group, strict=True)):
            caps[self.law_indices(number)][positive(group.law)] = self.settings.fit.largest_log_step
            if group.origin_m is not None:
                caps[first + group.n_head - 1] = self.settings.fit.largest_log_step * group.origin_m
        return caps

    def laws(self, theta: FloatArray) -> tuple[Law, ...]:
        """Return the law of each group at a vector, per unit of the reference mass."""
        return tuple(law for law, _ in self._build_laws(theta))

    def _build_laws(self, theta: FloatArray) -> Iterator[tuple[Law, FloatArray]]:
        """Yield the law of each group, and the derivatives of its vector by the entries (see `from_free`)."""
        for number, (group, first) in enumerate(zip(self.groups, self.first_of_group, strict=True)):
            rest_m = float(theta[first + group.n_head - 1]) if group.has_origin else 0.0
            if group.law.terms:
                law, slope = from_free(group.law, theta[self.law_indices(number)])
            else:
                law, slope = LINEAR, np.empty(0)
            yield law.resting_at(rest_m), slope

    def interfaces(
        self, theta: FloatArray, candidates: Mapping[int, Sequence[Term]] | None = None
    ) -> tuple[list[Interface], list[FloatArray]]:
        """Return all suspensions at a vector, and the derivatives of their laws by the entries (see `from_free`)."""
        suspensions: list[Interface] = [Interface(0.0, 0.0)] * self.body.n_attachments
        slopes: list[FloatArray] = []
        for number, ((law, slope), first) in enumerate(zip(self._build_laws(theta), self.first_of_group, strict=True)):
            group, force = self.groups[number], law
            slopes.append(slope)
            if candidates and number in candidates:
                further = tuple(candidates[number])
                force = WithCandidates((*law.terms, *further), law.rest_m, len(further))  # type: ignore[assignment]
            ground = float(theta[first + 2]) if group.ground else 0.0
            for attachment in group.members:
                suspensions[attachment] = Interface(float(theta[first]), float(theta[first + 1]), ground, force)
        mu = self.inverse_mass(theta)
        for attachment, spring in enumerate(self.body.inside, start=self.body.n_interfaces):
            if spring.stiffness_n_per_m is not None and spring.damping_n_s_per_m is not None:
                suspensions[attachment] = Interface(mu * spring.stiffness_n_per_m, mu * spring.damping_n_s_per_m)
        for k, (attachment, _) in enumerate(self.searched):
            index = self.first_inside + 2 * k
            suspensions[attachment] = Interface(float(theta[index]), float(theta[index + 1]))
        return suspensions, slopes

    def rest(self, theta: FloatArray, index: int, *, straight: bool = False) -> Rest | None:
        """Return the rest position of the suspensions in a run; None if it does not affect the motion.

        With `straight` it is returned even if no law depends on the travel.

        Raises:
            UnboundedResponseError: springs that cannot carry the weight of the run's loading.
        """
        return self._build_rest(theta, index, self.interfaces(theta)[0], straight=straight)

    def _build_rest(
        self, theta: FloatArray, index: int, suspensions: Sequence[Interface], *, straight: bool = False
    ) -> Rest | None:
        fall, loading = self.body.fall, self.runs[index].loading
        stiffer = self.stiffer(theta, index)
        if fall is None or not (loading.any() or stiffer):
            return None
        if not straight and not any(depends_on_rest(suspension.law) for suspension in suspensions):
            return None
        load = self.inverse_mass(theta) * (loading @ fall)
        if not stiffer:
            return find_rest(suspensions, self.body.rows, load)
        held = np.array([-stiffer * self.own_load])
        return find_rest(self.apply_departures(list(suspensions), theta, index), self.body.rows, load, held)

    def stiffer(self, theta: FloatArray, index: int) -> float:
        """Return the departure of the springs of one gear in a run.

        It is 0 for bodies, because the fractions of the weight that their gears carry are unknown.
        """
        if not self.n_departures or not self.body.is_one_gear:
            return 0.0
        return self.departures(theta, index)[0].spring

    def resting_interfaces(self, theta: FloatArray, index: int) -> list[Interface]:
        """Return all suspensions at their rest position in a run, with the departures of that run."""
        suspensions, _ = self.interfaces(theta)
        return self.apply_departures(
            put_at_rest(suspensions, self._build_rest(theta, index, suspensions)), theta, index
        )

    def apply_departures(self, suspensions: list[Interface], theta: FloatArray, index: int) -> list[Interface]:
        """Return suspensions with the departures of a run."""
        if not self.n_departures:
            return suspensions
        changed = list(suspensions)
        for group, departure in zip(self.groups, self.departures(theta, index), strict=True):
            for attachment in group.members:
                changed[attachment] = departure.of(suspensions[attachment])
        return changed

    def correct(self, theta: FloatArray, index: int) -> tuple[Corrected, Corrected]:
        """Return the drive and the readings of a run, corrected for the faults of the sensors."""
        values = self.fault_values(theta)
        run = self.runs[index]
        return run.correct("unsprung", self.sensors, values), run.correct("sprung", self.sensors, values)


def put_at_rest(suspensions: list[Interface], rest: Rest | None) -> list[Interface]:
    """Return suspensions at their rest position in a run."""
    if rest is None:
        return suspensions
    return [resting(suspension, float(travel)) for suspension, travel in zip(suspensions, rest.travel, strict=True)]


def compare_with_prior(unknowns: Unknowns, theta: FloatArray, *, is_held: bool) -> tuple[FloatArray, FloatArray]:
    """Return the departures from prior values, each over its standard deviation, and their Jacobian.

    Those of sensor faults, of coordinates, and of initial states and departures of runs come first, then those of laws
    and of the mass.
    """
    known = [
        (fault.nominal, fault.std * (unknowns.gains_differ if index in unknowns.stds_of_run_gains else 1.0))
        for index, fault in enumerate(unknowns.faults, start=unknowns.first_fault)
    ]
    known += [(0.0, coordinate.std) for coordinate in unknowns.body.coordinates]
    start_rms = unknowns.settings.runs.start_rms
    of_run = [(0.0, start_rms * float(rms)) for rms in unknowns.motion_rms.ravel()]
    of_run += [(0.0, unknowns.repeatability)] * unknowns.n_departures
    known += of_run * len(unknowns.runs)
    nominal, std = np.array(known).reshape(-1, 2).T
    first = theta.size - std.size
    jacobian = np.zeros((std.size, theta.size))
    jacobian[np.arange(std.size), first + np.arange(std.size)] = 1 / std
    of_laws, by_laws = _compare_laws_with_prior(unknowns, theta, is_held=is_held)
    return np.concatenate([(theta[first:] - nominal) / std, of_laws]), np.concatenate([jacobian, by_laws])


def _compare_laws_with_prior(unknowns: Unknowns, theta: FloatArray, *, is_held: bool) -> tuple[FloatArray, FloatArray]:
    """Return the departures of exponents and mass from prior values, and of the carried weight from that of gas."""
    left, rows = [], []

    def add(value: float, slopes: dict[int, float], std: float, *, is_loose: bool = False) -> None:
        size, slope_factor = value / std, 1.0 / std
        if is_loose:
            # The prior is Student's t with one degree of freedom: it is given up if the runs contradict it.
            size, slope_factor = _weigh_loosely(size, slope_factor)
        left.append(size)
        rows.append(np.zeros(theta.size))
        for index, slope in slopes.items():
            rows[-1][index] = slope_factor * slope

    for number, group in enumerate(unknowns.groups):
        for index, parameter in enumerate(group.law.parameter_list, start=unknowns.law_indices(number).start):
            if parameter.known:
                mean, std = parameter.known
                add(float(theta[index]) - float(np.log(mean)), {index: 1.0}, std / mean)
    for number, index in unknowns.carriers:
        first, is_loose, gas = unknowns.first_of_group[number], not is_held, unknowns.settings.gas
        std = gas.carried if unknowns.body.piston_area_m2 else gas.carried_unstated
        std *= unknowns.settings.fit.held_fraction if is_held else 1.0
        weight, by_mass = _compute_carried_force(unknowns, theta)
        length, exponent = np.exp(theta[index + 1 : index + 3]).tolist()
        slopes = {index: 1.0 / weight}
        if unknowns.mass_free:
            slopes[unknowns.first_fault - 1] = -float(theta[index]) * by_mass / weight**2
        add(float(theta[index]) / weight - 1.0, slopes, std, is_loose=is_loose)
        of_gas = length / (exponent * weight)
        beside = float(theta[first]) * of_gas
        slopes = {first: of_gas, index + 1: beside, index + 2: -beside}
        if unknowns.mass_free:
            slopes[unknowns.first_fault - 1] = -beside * by_mass / weight
        add(beside, slopes, std, is_loose=is_loose)
    body = unknowns.body
    if unknowns.has_prior_mass:
        index = unknowns.first_fault - 1
        off = float(theta[index]) * body.prior_mass_kg - 1.0
        add(off, {index: body.prior_mass_kg}, body.prior_tolerance_kg / body.prior_mass_kg)
    for scale, gain in unknowns.scales:
        index = unknowns.first_fault - 1
        mass_kg, mu = scale.kg * float(theta[gain]), float(theta[index])
        add(mu * mass_kg - 1.0, {index: mass_kg, gain: mu * scale.kg}, scale.tolerance)
    return np.array(left), np.array(rows).reshape(-1, theta.size)


def _compute_carried_force(unknowns: Unknowns, theta: FloatArray) -> tuple[float, float]:
    """Return the force of gas that carries all of the weight, and its derivative by one over the mass.

    It includes the force of the air outside on the piston. Per unit of the reference mass, m/s^2; the derivative in N.
    """
    air_n = ATMOSPHERE_PA * unknowns.body.piston_area_m2
    mu = unknowns.inverse_mass(theta)
    return unknowns.weight + air_n * mu, air_n


def _weigh_loosely(size: float, slope_factor: float) -> tuple[float, float]:
    """Return the root of minus twice a log density with long tails, sqrt(2 log(1 + x^2/2)), and its derivative."""
    cost = float(np.sqrt(2.0 * np.log1p(0.5 * size**2)))
    return float(np.copysign(cost, size)), slope_factor * (abs(size) / (cost * (1.0 + 0.5 * size**2)) if size else 1.0)


def add_rest(
    unknowns: Unknowns,
    change: ComplexArray,
    rest: Rest,
    suspensions: Sequence[Interface],
    theta: FloatArray,
    index: int,
    by: ComplexArray,
) -> None:
    """Add the derivatives of the lines by stiffness, law, mass and departures through the rest position of a run."""
    firsts = np.cumsum([0, *(suspension.n_parameters for suspension in suspensions)])
    by_travel = change[firsts[:-1] + N_HEAD - 1].copy()
    stiffer = unknowns.stiffer(theta, index)
    for number, (suspension, travel) in enumerate(zip(suspensions, rest.travel, strict=True)):
        moved = np.tensordot(-rest.compliance[:, number], by_travel, axes=1)
        force = (1.0 + stiffer) * by_parameters(suspension, travel)
        force[2] = travel  # the departure of the strut's springs does not apply to the spring to the ground
        change[firsts[number] : firsts[number + 1]] += np.multiply.outer(force, moved)
        if unknowns.n_departures and number == 0 and unknowns.body.is_one_gear:
            own = suspension.stiffness * travel + float(suspension.law.static_force(travel)[0])
            by[unknowns.indices_of_run(index)[1].start] += (own + unknowns.own_load) * moved
    if unknowns.mass_free:
        row = firsts[-1] + len(unknowns.body.names)
        change[row] += np.tensordot(rest.by_load / unknowns.inverse_mass(theta), by_travel, axes=1)


def add_departures(
    unknowns: Unknowns,
    change: ComplexArray,
    suspensions: Sequence[Interface],
    theta: FloatArray,
    index: int,
    by: ComplexArray,
) -> None:
    """Convert derivatives by the parameters of a run into those by the common parameters, and by departures."""
    firsts = np.cumsum([0, *(suspension.n_parameters for suspension in suspensions)])
    row = unknowns.indices_of_run(index)[1].start
    for group, departure in zip(unknowns.groups, unknowns.departures(theta, index), strict=True):
        for part, factor in enumerate(departure.values):
            for attachment in group.members:
                for entry, value in part_rows(suspensions[attachment])[part]:
                    own = change[firsts[attachment] + entry]
                    by[row + part] += value * own
                    own *= 1.0 + factor
        row += len(PARTS)


def sort_out(
    unknowns: Unknowns,
    change: ComplexArray,
    suspensions: Sequence[Interface],
    slopes: Sequence[FloatArray],
    by_fault: Sequence[tuple[str, int, FloatArray]],
    index: int,
    by: ComplexArray,
    candidates: Mapping[int, Sequence[Term]],
) -> ComplexArray:
    """Add the derivatives by the suspensions' parameters to those by the vector; return those by the candidates."""
    firsts = np.cumsum([0, *(suspension.n_parameters for suspension in suspensions)])
    further: list[ComplexArray] = []
    for number, (group, first) in enumerate(zip(unknowns.groups, unknowns.first_of_group, strict=True)):
        n_law = group.law.vector.size
        n_more = sum(len(term.values) for term in candidates.get(number, ()))
        more = np.zeros((n_more, *change.shape[1:]), dtype=np.complex128)
        for attachment in group.members:
            own = change[firsts[attachment] : firsts[attachment + 1]]
            head = [k for k, has_it in enumerate((True, True, group.ground, group.has_origin)) if has_it]
            by[first : first + group.n_head] += own[head]
            by[unknowns.law_indices(number)] += own[N_HEAD : N_HEAD + n_law] * slopes[number][:, np.newaxis, np.newaxis]
            more += own[N_HEAD + n_law :]
        further.append(more)
    for k, (attachment, _) in enumerate(unknowns.searched):
        row = unknowns.first_inside + 2 * k
        by[row : row + 2] += change[firsts[attachment] : firsts[attachment] + 2]
    body, n_coordinates = unknowns.body, len(unknowns.body.coordinates)
    n_factors = len(body.names) + unknowns.mass_free
    rest = change[firsts[-1] :]
    by[unknowns.first_factor : unknowns.first_factor + n_factors] += rest[:n_factors]
    by[unknowns.first_coordinate : unknowns.n_shared] += rest[n_factors : n_factors + n_coordinates]
    if unknowns.mass_free:
        row = unknowns.first_fault - 1
        for attachment, spring in enumerate(body.inside, start=body.n_interfaces):
            by[row] += (spring.stiffness_n_per_m or 0.0) * change[firsts[attachment]]
            by[row] += (spring.damping_n_s_per_m or 0.0) * change[firsts[attachment] + 1]
    rest = rest[n_factors + n_coordinates :]
    names = [fault.name for fault in unknowns.faults]
    for row, (name, _, _) in enumerate(by_fault):
        by[unknowns.first_fault + names.index(name)] += rest[row]
    starts, row = rest[len(by_fault) :], unknowns.indices_of_run(index)[0].start
    for interface in range(body.n_interfaces):
        by[row + 2 * interface] = starts[interface]
        by[row + 2 * interface + 1] = starts[body.n_attachments + interface]
    return np.concatenate(further)
