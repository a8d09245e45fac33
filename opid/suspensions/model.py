"""Prediction errors of a body on driven suspensions, and their derivatives, as functions of one vector.

The noise below the suspensions drives the model too. Every reading on the body therefore corrects the simulated motion
by as much as the noise levels make right (`opid.mechanics.prediction`), so that the errors are white for the true model
whatever the law. The lines of a band of them are compared: what sensors do below and above does not matter.

A gear alone is a body with one interface, M2 its mass: nothing here knows how many there are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.driven import N_HEAD, Interface, UnboundedResponseError
from opid.mechanics.laws import LINEAR, Law, Term, WithCandidates
from opid.mechanics.memory import force_along
from opid.mechanics.prediction import Noise, Prediction, predict
from opid.mechanics.repeatability import PARTS, Departure, part_rows
from opid.mechanics.weight import ATMOSPHERE_PA, Rest, by_parameters, depends_on_travel, rest_under, resting
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.body import Body, Mobility, mobility
from opid.suspensions.law_parameters import free_bounds, from_free, positive
from opid.suspensions.run import Corrected, DrivenRun
from opid.suspensions.sensor_facts import Fault, Sensors
from opid.suspensions.settings import Settings

# the reading of a slot that has no sensor: nothing is learnt from it
_NO_SENSOR_M_PER_S2 = 1e6
# of free motions: so much louder are the sensors on the body, and so much quieter those below
_DEAF = 1e4


@dataclass(frozen=True)
class Group:
    """Interfaces that share stiffness, damping, ground spring and law.

    Args:
        name: "left", or "left, right"; "" for one gear.
        slots: of its interfaces.
        law: says which terms, per unit of the reference mass.
        ground: whether springs act between the body and the ground at these interfaces.
        origin_m: about how far the origin of the law lies from where the interfaces rest in the reference run, m; the
            vector then says where they rest on it. None where it lies there.
    """

    name: str
    slots: tuple[int, ...]
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
        further = (("ground_stiffness_per_mass", self.ground), ("rest_m", self.has_origin))
        return ("stiffness_per_mass", "damping_per_mass", *(name for name, has_it in further if has_it))

    @property
    def n_head(self) -> int:
        """Entries of the vector before those of the law."""
        return len(self.head)

    def called(self, what: str) -> str:
        """Return the name of one of its parameters."""
        return f"{what}[{self.name}]" if self.name else what


@dataclass(frozen=True, eq=False)
class ProcessNoise:
    """What moves the body and no sensor measured: forces of others, and motion that the model does not know.

    Args:
        fraction: its rms acceleration over that of the readings of a run; 0 for none.
        corner_hz: above this frequency its spectral density falls, Hz.
        levels: of each run (n_sensors, n_lines) how large the errors are, band by band; empty where all are 1.
    """

    fraction: float = 0.0
    corner_hz: float = 10.0
    levels: tuple[FloatArray, ...] = ()


NO_PROCESS_NOISE = ProcessNoise()


@dataclass(frozen=True, eq=False)
class Errors:
    """Whitened prediction errors of all runs at one vector.

    Args:
        stacked: (n_data + n_priors,) real and imaginary parts of the lines, then the departures from what was known.
        jacobian: (n_data + n_priors, n_unknowns); no rows where it was not asked for.
        lines: one complex array (n_sensors * n_lines,) a run, one sensor after the other.
        predictions: of each run, without derivatives.
        candidates: derivatives by the amplitudes and inner values of further terms, (n_data, n_values), if asked for.
    """

    stacked: FloatArray
    jacobian: FloatArray
    lines: tuple[ComplexArray, ...]
    predictions: tuple[Prediction, ...]
    candidates: FloatArray


@dataclass(frozen=True, eq=False)
class Model:
    """Prediction errors and their derivatives as functions of one vector.

    Of each group stiffness, damping, [ground stiffness], [rest on its law] and law (positive entries as logarithms);
    stiffness and damping of each spring inside that is to be found; free factors of the mass; [1 / reference mass];
    faults of sensors; coordinates; then of each run travel and velocity of each interface at its start, and by how much
    springs, damping and friction of each group depart from those of all runs.

    Args:
        runs: the runs.
        body: the body.
        groups: which interfaces share what.
        sensors: what is known of the sensors, and which of their faults are free.
        mass_free: whether one over the reference mass is fitted.
        noise: (n_interfaces,) below the suspensions and (n_sensors,) on the body, m/s^2.
        motion_rms: (n_interfaces, 2) rms travel (m) and velocity (m/s), roughly.
        settings: of the estimator.
        repeatability: relative standard deviation of springs, damping and friction from run to run; 0 where they are
            the same in all.
        held_inverse_mass: one over the reference mass where it is not fitted, 1/kg; 0 for ratios alone.
        louder: while a fit comes from afar, by how much the noise that moves the suspensions is larger than that of
            the sensors below: it stands for what the model does not know yet.
        process: what moves the body and no sensor measured.
        is_held: whether, while a fit comes from afar, a column of gas carries all of the weight.
    """

    runs: tuple[DrivenRun, ...]
    body: Body
    groups: tuple[Group, ...]
    sensors: Sensors
    mass_free: bool
    noise: tuple[FloatArray, FloatArray]
    motion_rms: FloatArray
    settings: Settings
    repeatability: float = 0.0
    held_inverse_mass: float = 0.0
    louder: float = 1.0
    process: ProcessNoise = NO_PROCESS_NOISE
    is_held: bool = False

    @cached_property
    def coarse(self) -> Model:
        """The model of the same runs at a coarse rate; itself where theirs is."""
        runs = tuple(run.coarse for run in self.runs)
        return self if all(a is b for a, b in zip(runs, self.runs, strict=True)) else replace(self, runs=runs)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the shared parameters."""
        names: list[str] = []
        for group in self.groups:
            names += [group.called(head) for head in group.head]
            names += [f"{group.called('law')}[{i}]" for i in range(group.law.vector.size)]
        for _, spring in self._searched:
            names += [f"stiffness_per_mass[{spring}]", f"damping_per_mass[{spring}]"]
        names += [*self.body.names, *(["inverse_mass"] if self.mass_free else [])]
        names += [fault.name for fault in self.faults]
        return (*names, *(coordinate.name for coordinate in self.body.coordinates))

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The faults of sensors that are fitted."""
        return self.sensors.faults

    @cached_property
    def _searched(self) -> tuple[tuple[int, str], ...]:
        """Slots and names of the springs inside whose stiffness is to be found."""
        inside = enumerate(self.body.inside, start=self.body.n_interfaces)
        return tuple((slot, spring.name) for slot, spring in inside if spring.stiffness_n_per_m is None)

    @cached_property
    def first_of_group(self) -> tuple[int, ...]:
        """Place of the stiffness of each group in the vector."""
        sizes = [group.n_head + group.law.vector.size for group in self.groups]
        return tuple(int(place) for place in np.cumsum([0, *sizes])[:-1])

    @property
    def n_shared(self) -> int:
        """Number of shared parameters."""
        return len(self.names)

    @property
    def ground(self) -> bool:
        """Whether any spring acts between body and ground."""
        return any(group.ground for group in self.groups)

    @property
    def level(self) -> float:
        """The noise that is assumed, as white noise of one level on all sensors, m/s^2."""
        return noise_level(self.noise)

    @property
    def n_own(self) -> int:
        """Entries of the vector that each run has for itself."""
        return 2 * self.body.n_interfaces + self._n_departures

    @property
    def _n_departures(self) -> int:
        return len(PARTS) * len(self.groups) * (self.repeatability > 0.0)

    def places_of_run(self, place: int) -> tuple[slice, slice]:
        """Return where the start of a run and its departures stand in the vector."""
        first = self.n_shared + self.n_own * place
        middle = first + 2 * self.body.n_interfaces
        return slice(first, middle), slice(middle, first + self.n_own)

    @cached_property
    def is_weighed(self) -> NDArray[np.bool_]:
        """Which of the departures from what was known count for a model: all but those of how a run begins."""
        first = self._first_fault
        weighed = np.ones(self.n_shared - first + self.n_own * len(self.runs) + self.n_known_of_laws, dtype=bool)
        for place in range(len(self.runs)):
            start = self.places_of_run(place)[0]
            weighed[start.start - first : start.stop - first] = False
        return weighed

    def departures(self, theta: FloatArray, place: int) -> tuple[Departure, ...]:
        """Return by how much each group departs in a run from what it is in all."""
        if not self._n_departures:
            return (Departure(),) * len(self.groups)
        values = theta[self.places_of_run(place)[1]].reshape(-1, len(PARTS))
        return tuple(Departure(*row) for row in values.tolist())

    @property
    def n_known_of_laws(self) -> int:
        """How much of stiffness and laws was known before the data: exponents, and what carries the weight."""
        exponents = [parameter for group in self.groups for parameter in group.law.parameter_list if parameter.known]
        return len(exponents) + 2 * len(self.carriers)

    @property
    def weight(self) -> float:
        """What the suspension of one gear carries at rest in the reference run, per unit of the reference mass, m/s^2.

        It is 0 where no weight acts, and for bodies, of which gears carry shares not known.
        """
        return abs(float(self.body.fall[0])) if self.body.fall is not None and self.body.n_slots == 1 else 0.0

    @property
    def is_carried(self) -> bool:
        """Whether it is known what a column of gas would carry: it pushes outwards, so the axis must count so."""
        return self.weight > 0.0 and self.body.fall is not None and float(self.body.fall[0]) < 0.0

    @cached_property
    def carriers(self) -> tuple[tuple[int, int], ...]:
        """Groups whose law has a term that carries the weight, and where the term stands in the vector."""
        if not self.is_carried:
            return ()
        found, place = [], self.law_places(0).start
        for term in self.groups[0].law.terms:
            if term.kind.quasi_static:
                found.append((0, place))
            place += len(term.values)
        return tuple(found)

    def carried(self, theta: FloatArray) -> tuple[float, float]:
        """Return what gas that carries all of the weight pushes with, and the derivative by one over the mass.

        The air outside pushes back on the piston: per unit of the reference mass, m/s^2 and N.
        """
        air_n = ATMOSPHERE_PA * self.body.piston_area_m2
        mu = self.inverse_mass(theta)
        return self.weight + air_n * mu, air_n

    def carrier(self, number: int) -> Term:
        """Return the term of a group that carries the weight."""
        return next(term for term in self.groups[number].law.terms if term.kind.quasi_static)

    def _known_of_laws(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far exponents are from what is known of them, and what carries the weight from a column of gas alone."""
        left, rows = [], []

        def add(value: float, slopes: dict[int, float], std: float, *, is_loose: bool = False) -> None:
            size, share = value / std, 1.0 / std
            if is_loose:
                # Student's t of one degree of freedom: what the runs contradict is given up
                size, share = _loosely(size, share)
            left.append(size)
            rows.append(np.zeros(theta.size))
            for place, slope in slopes.items():
                rows[-1][place] = share * slope

        for number, group in enumerate(self.groups):
            for place, parameter in enumerate(group.law.parameter_list, start=self.law_places(number).start):
                if parameter.known:
                    mean, std = parameter.known
                    add(float(theta[place]) - float(np.log(mean)), {place: 1.0}, std / mean)
        for number, place in self.carriers:
            first, is_loose, gas = self.first_of_group[number], not self.is_held, self.settings.gas
            std = gas.carried if self.body.piston_area_m2 else gas.carried_unstated
            std *= self.settings.fit.held_fraction if self.is_held else 1.0
            weight, by_mass = self.carried(theta)
            length, exponent = np.exp(theta[place + 1 : place + 3]).tolist()
            slopes = {place: 1.0 / weight}
            if self.mass_free:
                slopes[self._first_fault - 1] = -float(theta[place]) * by_mass / weight**2
            add(float(theta[place]) / weight - 1.0, slopes, std, is_loose=is_loose)
            of_gas = length / (exponent * weight)
            beside = float(theta[first]) * of_gas
            slopes = {first: of_gas, place + 1: beside, place + 2: -beside}
            if self.mass_free:
                slopes[self._first_fault - 1] = -beside * by_mass / weight
            add(beside, slopes, std, is_loose=is_loose)
        return np.array(left), np.array(rows).reshape(-1, theta.size)

    @property
    def _first_coordinate(self) -> int:
        return self.n_shared - len(self.body.coordinates)

    @property
    def _first_fault(self) -> int:
        return self._first_coordinate - len(self.faults)

    @property
    def first_factor(self) -> int:
        """Where the free factors of the mass stand in the vector."""
        return self._first_fault - self.mass_free - len(self.body.names)

    @property
    def first_inside(self) -> int:
        """Place of the first spring inside that is to be found."""
        return self.first_factor - 2 * len(self._searched)

    def law_places(self, number: int) -> slice:
        """Return where the law of a group stands in the vector."""
        first = self.first_of_group[number] + self.groups[number].n_head
        return slice(first, first + self.groups[number].law.vector.size)

    def inverse_mass(self, theta: FloatArray) -> float:
        """Return one over the reference mass at a vector, 1/kg; 1 where the body is given in kg."""
        if self.mass_free:
            return float(theta[self._first_fault - 1])
        return 1.0 if self.body.absolute else self.held_inverse_mass

    def mobility(self, theta: FloatArray, place: int) -> Mobility:
        """Return what forces do to the body in one run."""
        first = self.first_factor
        factors, shifts = theta[first : first + len(self.body.names)], theta[self._first_coordinate : self.n_shared]
        return mobility(self.body, factors, self.inverse_mass(theta), shifts, self.runs[place].loading)

    def fault_values(self, theta: FloatArray) -> dict[str, float]:
        """Return the faults of the sensors at a vector by name."""
        first = self._first_fault
        return {fault.name: float(theta[first + k]) for k, fault in enumerate(self.faults)}

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds of the vector, infinite but for scales, damping, faults and coordinates."""
        lower = np.full(self.n_shared + self.n_own * len(self.runs), -np.inf)
        upper = -lower
        for number, group in enumerate(self.groups):
            travel_rms, velocity_rms = np.sqrt(np.mean(self.motion_rms[list(group.slots)] ** 2, axis=0))
            travel_rms = np.hypot(travel_rms, group.origin_m or 0.0)
            places = self.law_places(number)
            lower[places], upper[places] = free_bounds(group.law, travel_rms=travel_rms, velocity_rms=velocity_rms)
        farthest = self.settings.fit.farthest_std
        for k, fault in enumerate(self.faults, start=self._first_fault):
            lower[k], upper[k] = fault.nominal - farthest * fault.std, fault.nominal + farthest * fault.std
            if fault.kind == "gain":
                lower[k] = max(lower[k], self.settings.faults.least_gain)
            elif fault.kind == "corner":
                # however sharply a corner is stated: the sensor may have none
                lower[k] = min(fault.nominal, self.settings.faults.slight_corner_hz)
        for place in range(len(self.runs)):
            own = self.places_of_run(place)[1]
            upper[own] = self.settings.repeatability.farthest_std * self.repeatability
            lower[own] = -upper[own]
        for k, coordinate in enumerate(self.body.coordinates, start=self._first_coordinate):
            lower[k], upper[k] = -farthest * coordinate.std, farthest * coordinate.std
        return lower, upper

    def largest_steps(self) -> FloatArray:
        """Return how far each entry may move in a step."""
        caps = np.full(self.n_shared + self.n_own * len(self.runs), np.inf)
        for number, (group, first) in enumerate(zip(self.groups, self.first_of_group, strict=True)):
            caps[self.law_places(number)][positive(group.law)] = self.settings.fit.largest_log_step
            if group.origin_m is not None:
                caps[first + group.n_head - 1] = self.settings.fit.largest_log_step * group.origin_m
        return caps

    def laws(self, theta: FloatArray) -> tuple[Law, ...]:
        """Return the law of each group at a vector, per unit of the reference mass."""
        return tuple(law for law, _ in self._laws(theta))

    def _laws(self, theta: FloatArray) -> Iterator[tuple[Law, FloatArray]]:
        """The law of each group, and what its entries move by (see `from_free`)."""
        for number, (group, first) in enumerate(zip(self.groups, self.first_of_group, strict=True)):
            rest_m = float(theta[first + group.n_head - 1]) if group.has_origin else 0.0
            if group.law.terms:
                law, slope = from_free(group.law, theta[self.law_places(number)])
            else:
                law, slope = LINEAR, np.empty(0)
            yield law.resting_at(rest_m), slope

    def interfaces(
        self, theta: FloatArray, candidates: Mapping[int, Sequence[Term]] | None = None
    ) -> tuple[list[Interface], list[FloatArray]]:
        """Return the suspensions of all slots at a vector, and what their laws' entries move by (see `from_free`)."""
        slots: list[Interface] = [Interface(0.0, 0.0)] * self.body.n_slots
        slopes: list[FloatArray] = []
        for number, ((law, slope), first) in enumerate(zip(self._laws(theta), self.first_of_group, strict=True)):
            group, force = self.groups[number], law
            slopes.append(slope)
            if candidates and number in candidates:
                further = tuple(candidates[number])
                force = WithCandidates((*law.terms, *further), law.rest_m, len(further))  # type: ignore[assignment]
            ground = float(theta[first + 2]) if group.ground else 0.0
            for slot in group.slots:
                slots[slot] = Interface(float(theta[first]), float(theta[first + 1]), ground, force)
        mu = self.inverse_mass(theta)
        for slot, spring in enumerate(self.body.inside, start=self.body.n_interfaces):
            if spring.stiffness_n_per_m is not None and spring.damping_n_s_per_m is not None:
                slots[slot] = Interface(mu * spring.stiffness_n_per_m, mu * spring.damping_n_s_per_m)
        for k, (slot, _) in enumerate(self._searched):
            place = self.first_inside + 2 * k
            slots[slot] = Interface(float(theta[place]), float(theta[place + 1]))
        return slots, slopes

    def rest(self, theta: FloatArray, place: int, *, straight: bool = False) -> Rest | None:
        """Return where the suspensions of a run rest; None where that is without consequence for the motion.

        Args:
            theta: the vector.
            place: of the run.
            straight: also tell it where no law depends on the travel.

        Raises:
            UnboundedResponseError: springs that cannot carry what the run's loading weighs.
        """
        return self._rest(theta, place, self.interfaces(theta)[0], straight=straight)

    def _rest(
        self, theta: FloatArray, place: int, slots: Sequence[Interface], *, straight: bool = False
    ) -> Rest | None:
        fall, loading = self.body.fall, self.runs[place].loading
        stiffer = self._stiffer(theta, place)
        if fall is None or not (loading.any() or stiffer):
            return None
        if not straight and not any(depends_on_travel(slot.law) for slot in slots):
            return None
        load = self.inverse_mass(theta) * (loading @ fall)
        if not stiffer:
            return rest_under(slots, self.body.rows, load)
        return rest_under(self._departed(list(slots), theta, place), self.body.rows, load, -stiffer * fall)

    def _stiffer(self, theta: FloatArray, place: int) -> float:
        """By how much the springs of one gear depart in a run; 0 for bodies, of which gears carry shares not known."""
        if not self._n_departures or self.body.n_slots > 1:
            return 0.0
        return self.departures(theta, place)[0].spring

    def resting_interfaces(self, theta: FloatArray, place: int) -> list[Interface]:
        """Return the suspensions of all slots as they are in a run, where they rest in it."""
        slots, _ = self.interfaces(theta)
        return self._departed(_moved(slots, self._rest(theta, place, slots)), theta, place)

    def _departed(self, slots: list[Interface], theta: FloatArray, place: int) -> list[Interface]:
        """Suspensions as they are in a run."""
        if not self._n_departures:
            return slots
        changed = list(slots)
        for group, departure in zip(self.groups, self.departures(theta, place), strict=True):
            for slot in group.slots:
                changed[slot] = departure.of(slots[slot])
        return changed

    def corrected(self, theta: FloatArray, place: int) -> tuple[Corrected, Corrected]:
        """Return the drive and the readings of a run with the faults of the sensors taken out."""
        values = self.fault_values(theta)
        run = self.runs[place]
        return run.corrected("unsprung", self.sensors, values), run.corrected("sprung", self.sensors, values)

    def _predict(
        self, theta: FloatArray, place: int, sensitivity: bool, candidates: Mapping[int, Sequence[Term]] | None = None
    ) -> tuple[Prediction, ComplexArray, ComplexArray]:
        """Predict one run; also give the derivatives of the lines, (n_unknowns, n_sensors, n_lines)."""
        run, body, n_slots = self.runs[place], self.body, self.body.n_slots
        of_reference, slopes = self.interfaces(theta, candidates)
        rest = self._rest(theta, place, of_reference)
        resting = _moved(of_reference, rest)
        slots = self._departed(resting, theta, place)
        moved = self.mobility(theta, place)
        n_directions = len(body.names) + self.mass_free
        kept = [*range(n_directions), *range(len(body.names) + 1, len(moved.by_accelerance))]
        below, above = self.corrected(theta, place)
        n_sensors = above.value.shape[1]
        start, covariance = self._at_start(theta, place)
        prediction = predict(
            slots,
            moved.accelerance,
            _widened(below.value, n_slots),
            _widened(above.value, n_slots),
            fs=run.fs,
            noise=self._noise(theta, run),
            start=start,
            start_covariance=covariance,
            accelerance_directions=moved.by_accelerance[kept],
            # a sensor at its interface reads what acts there: the predictor then need not tell the two apart
            reading=None if self._is_plain else moved.reading,
            reading_directions=None if self._is_plain else moved.by_reading[kept],
            drive_directions=below.directions(n_slots),
            measured_directions=above.directions(n_slots),
            ground=self.ground,
            sensitivity=sensitivity,
        )
        by = np.zeros((theta.size if sensitivity else 0, n_sensors, run.omega.size), dtype=np.complex128)
        further = by[:0]
        if sensitivity:
            change = prediction.sensitivity[:n_sensors]
            if below.by or above.by:
                change = change.copy()
                first = change.shape[1] - self._n_starts - len(below.by) - len(above.by)
                self._add_spread(change[:, first:], prediction, theta, run, (*below.by, *above.by))
            lines = run.transform(change).transpose(1, 0, 2) / self._levels(place)
            if self._n_departures:
                self._add_departures(lines, resting, theta, place, by)
            if rest is not None:
                self._add_rest(lines, rest, of_reference, theta, place, by)
            further = self._sort_out(lines, slots, slopes, (*below.by, *above.by), place, by, candidates or {})
        # a hundred times larger than the rest, and used up
        return replace(prediction, sensitivity=prediction.sensitivity[:, :0]), by, further

    @cached_property
    def _is_plain(self) -> bool:
        """Whether the readings are the accelerations at the interfaces, in this order."""
        body = self.body
        return (
            body.rows.shape == body.readings.shape and np.array_equal(body.rows, body.readings) and not body.coordinates
        )

    @property
    def _n_starts(self) -> int:
        """Directions of the start state that the predictor has."""
        return (4 if self.ground else 2) * self.body.n_slots

    def looked_for_start(self, theta: FloatArray) -> FloatArray:
        """Return the vector with the travel and velocity that predict the first seconds of each run of one gear best.

        All cells of a grid are predicted for a short while, then the best of them for longer.
        """
        known, found = self.settings.fit, theta.copy()
        grid = np.linspace(-known.start_reach_rms, known.start_reach_rms, known.n_start_grid)
        rms = self.motion_rms[0]
        std = (grid[1] - grid[0]) / 2 * rms
        for place in range(len(self.runs)):
            cells = [np.array([z, v]) * rms for z in grid for v in grid]
            cost_of_start = self._start_costs(theta, place, std)
            for seconds, n_kept in known.start_rounds:
                costs = [cost_of_start(cell, seconds) for cell in cells]
                cells = [cells[k] for k in np.argsort(costs, kind="stable")[:n_kept]]
            found[self.places_of_run(place)[0]] = cells[0]
        return found

    def _start_costs(self, theta: FloatArray, place: int, cell_std: FloatArray) -> Callable[[FloatArray, float], float]:
        """What the first seconds of a run speak against a start: a function of the start and the seconds."""
        run, (below, above) = self.runs[place], self.corrected(theta, place)
        accelerance = self.mobility(theta, place).accelerance
        try:
            slots = self.resting_interfaces(theta, place)
        except UnboundedResponseError:
            return lambda cell, seconds: np.inf
        noise, (usual, covariance) = self._noise(theta, run), self._at_start(theta, place)
        np.fill_diagonal(covariance[:2, :2], cell_std**2)

        def cost(cell: FloatArray, seconds: float) -> float:
            n, start = min(run.n_samples, round(seconds * run.fs)), usual.copy()
            start[:2, 0] = cell
            try:
                begun = predict(
                    slots,
                    accelerance,
                    below.value[: 2 * n - 1],
                    above.value[:n],
                    fs=run.fs,
                    noise=noise,
                    start=start,
                    start_covariance=covariance,
                    ground=self.ground,
                    sensitivity=False,
                )
            except UnboundedResponseError:
                return np.inf
            return float(np.sum(begun.innovation**2) + 2 * np.sum(np.log(begun.spread)))

        return cost

    def _at_start(self, theta: FloatArray, place: int) -> tuple[FloatArray, FloatArray]:
        """State of all slots at the first sample of a run, and its covariance: what is fitted is known exactly."""
        body, known, run = self.body, self.settings.runs, self.runs[place]
        n, n_rows, n_sensors = body.n_interfaces, 6 if self.ground else 4, len(self.sensors.sprung)
        start, std = np.zeros((n_rows, body.n_slots)), np.zeros((n_rows, body.n_slots))
        start[:2, :n] = theta[self.places_of_run(place)[0]].reshape(-1, 2).T
        std[:2, :n] = 1e-9
        springs = np.abs(body.rows[n:]).max(axis=1, initial=0.0) > 0.0
        std[:2, n:] = springs * known.start_rms * self.motion_rms.max(axis=0, initial=0.0)[:, np.newaxis]
        for row, facts in ((-2, self.sensors.unsprung), (-1, self.sensors.sprung)):
            offsets = [known.offset_ac_m_per_s2 if each.corner_hz else known.offset_m_per_s2 for each in facts]
            std[row, : n if row == -2 else n_sensors] = offsets
        covariance = np.diag(std.ravel() ** 2)
        if self.ground:
            below, near = run.ground_at_start
            for k, sensor in enumerate(self.sensors.unsprung):
                rows = np.arange(2, 5) * body.n_slots + k
                if sensor.corner_hz:
                    # what an AC coupling took from the path is not known
                    far = (known.start_displacement_m, known.start_velocity_m_per_s, known.offset_ac_m_per_s2)
                    covariance[rows, rows] = np.square(far)
                else:
                    start[2:5, k], covariance[np.ix_(rows, rows)] = below[:, k], near[k]
        return start, covariance

    def _add_rest(
        self,
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
        stiffer, fall = self._stiffer(theta, place), self.body.fall
        for number, (slot, travel) in enumerate(zip(slots, rest.travel, strict=True)):
            moved = np.tensordot(-rest.push[:, number], by_travel, axes=1)
            force = (1.0 + stiffer) * by_parameters(slot, travel)
            force[2] = travel  # the spring to the ground is none of the strut's
            change[firsts[number] : firsts[number + 1]] += np.multiply.outer(force, moved)
            if self._n_departures and len(slots) == 1 and fall is not None:
                own = slot.stiffness * travel + float(slot.law.stand(travel)[0])
                by[self.places_of_run(place)[1].start] += (own + fall[0]) * moved
        if self.mass_free:
            row = firsts[-1] + len(self.body.names)
            change[row] += np.tensordot(rest.by_load / self.inverse_mass(theta), by_travel, axes=1)

    def _add_departures(
        self, change: ComplexArray, slots: Sequence[Interface], theta: FloatArray, place: int, by: ComplexArray
    ) -> None:
        """Turn derivatives by what suspensions have in a run into those by what they have in all, and by departures."""
        firsts = np.cumsum([0, *(slot.n_parameters for slot in slots)])
        row = self.places_of_run(place)[1].start
        for group, departure in zip(self.groups, self.departures(theta, place), strict=True):
            for part, factor in enumerate(departure.values):
                for slot in group.slots:
                    for entry, value in part_rows(slots[slot])[part]:
                        own = change[firsts[slot] + entry]
                        by[row + part] += value * own
                        own *= 1.0 + factor
            row += len(PARTS)

    def _sort_out(
        self,
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
        for number, (group, first) in enumerate(zip(self.groups, self.first_of_group, strict=True)):
            n_law = group.law.vector.size
            n_more = sum(len(term.values) for term in candidates.get(number, ()))
            more = np.zeros((n_more, *change.shape[1:]), dtype=np.complex128)
            for slot in group.slots:
                own = change[firsts[slot] : firsts[slot + 1]]
                head = [k for k, has_it in enumerate((True, True, group.ground, group.has_origin)) if has_it]
                by[first : first + group.n_head] += own[head]
                by[self.law_places(number)] += own[N_HEAD : N_HEAD + n_law] * slopes[number][:, np.newaxis, np.newaxis]
                more += own[N_HEAD + n_law :]
            further.append(more)
        for k, (slot, _) in enumerate(self._searched):
            row = self.first_inside + 2 * k
            by[row : row + 2] += change[firsts[slot] : firsts[slot] + 2]
        body, n_coordinates = self.body, len(self.body.coordinates)
        n_factors = len(body.names) + self.mass_free
        rest = change[firsts[-1] :]
        by[self.first_factor : self.first_factor + n_factors] += rest[:n_factors]
        by[self._first_coordinate : self.n_shared] += rest[n_factors : n_factors + n_coordinates]
        if self.mass_free:
            row = self._first_fault - 1
            for slot, spring in enumerate(body.inside, start=body.n_interfaces):
                by[row] += (spring.stiffness_n_per_m or 0.0) * change[firsts[slot]]
                by[row] += (spring.damping_n_s_per_m or 0.0) * change[firsts[slot] + 1]
        rest = rest[n_factors + n_coordinates :]
        names = [fault.name for fault in self.faults]
        for row, (name, _, _) in enumerate(by_fault):
            by[self._first_fault + names.index(name)] += rest[row]
        starts, row = rest[len(by_fault) :], self.places_of_run(place)[0].start
        for interface in range(body.n_interfaces):
            by[row + 2 * interface] = starts[interface]
            by[row + 2 * interface + 1] = starts[body.n_slots + interface]
        return np.concatenate(further)

    def _gains(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The gain of every sensor below the suspensions and on the body."""
        gains = np.ones(len(self.sensors.unsprung)), np.ones(len(self.sensors.sprung))
        for k, fault in enumerate(self.faults, start=self._first_fault):
            if fault.kind == "gain":
                gains[fault.side == "sprung"][fault.channel] = theta[k]
        return gains

    def _noise_of_readings(self, theta: FloatArray, run: DrivenRun) -> tuple[FloatArray, FloatArray]:
        """The noise behind the gains, as the run is sampled.

        The noise is that of a reading: a large gain must not make the errors look small. White noise sampled finer has
        the same density only at a higher level; of runs sampled coarser the drive alone is averaged.
        """
        below, above = (side * np.sqrt(run.finer) for side in self.noise)
        gains = self._gains(theta)
        return below / gains[0] / np.sqrt(run.stride), above / gains[1]

    def _noise(self, theta: FloatArray, run: DrivenRun) -> Noise:
        """The noise of all slots; an AC coupling that was undone adds up its own."""
        levels = self._noise_of_readings(theta, run)
        values, rows = self.fault_values(theta), []
        for side, level, n_all, absent in (
            ("unsprung", levels[0], self.body.n_slots, 0.0),
            ("sprung", levels[1], self.body.n_slots, _NO_SENSOR_M_PER_S2),
        ):
            corners = np.array([facts.corner_hz for facts in self.sensors.facts(side)])  # type: ignore[arg-type]
            for fault in self.faults:
                if fault.kind == "corner" and fault.side == side:
                    corners[fault.channel] = values[fault.name]
            walk = 2 * np.pi * corners / run.fs * level
            n_more = n_all - level.size
            rows.append((np.append(level, [absent] * n_more), np.append(walk, [0.0] * n_more)))
        motion = np.sqrt(self.louder**2 - 1) * rows[0][0]
        unmeasured = np.zeros(self.body.n_slots)
        if self.process.fraction:
            unmeasured[: len(levels[1])] = self.process.fraction * run.sprung.std(axis=0)
        return Noise(
            rows[0][0].tolist(),
            rows[1][0].tolist(),
            rows[0][1].tolist(),
            rows[1][1].tolist(),
            motion.tolist(),
            unmeasured.tolist(),
            self.process.corner_hz,
        )

    def simulated(self, theta: FloatArray) -> tuple[Prediction, ...]:
        """Return the free motion of each run: what sensors on the body read does not correct it.

        Args:
            theta: the vector.

        Raises:
            UnboundedResponseError: a motion that grows without bound.
        """
        below, above = self.noise
        deaf = replace(self, noise=(below / _DEAF, above * _DEAF), process=NO_PROCESS_NOISE)
        return deaf.evaluate(theta, sensitivity=False).predictions

    def _levels(self, place: int) -> FloatArray:
        """How large the errors of a run are, (n_sensors, n_lines) or one number for all."""
        level = self.runs[place].error_level
        return level * self.process.levels[place] if self.process.levels else np.full((1, 1), level)

    def _add_spread(
        self,
        change: FloatArray,
        prediction: Prediction,
        theta: FloatArray,
        run: DrivenRun,
        by_fault: Sequence[tuple[str, int, FloatArray]],
    ) -> None:
        """Add what a gain does to the innovations by way of their spread: all gains together change nothing."""
        kinds = {fault.name: fault for fault in self.faults}
        n_sensors, gains = len(self.sensors.sprung), self._gains(theta)
        own = (self._noise_of_readings(theta, run)[1][:, np.newaxis] / prediction.spread[:n_sensors]) ** 2
        for row, (name, channel, _) in enumerate(by_fault):
            fault = kinds[name]
            if fault.kind != "gain":
                continue
            gain = gains[fault.side == "sprung"][channel]
            if fault.side == "sprung":
                change[channel, row] += prediction.innovation[channel] * own[channel] / gain
            else:
                change[:, row] += prediction.innovation[:n_sensors] * (1 - own) / gain / len(self.sensors.unsprung)

    def evaluate(
        self,
        theta: FloatArray,
        *,
        sensitivity: bool = True,
        candidates: Mapping[int, Sequence[Term]] | None = None,
    ) -> Errors:
        """Return errors, Jacobian and predictions at a vector; of each run the lines of one sensor after the other.

        Candidates are further terms by number of the group, too weak to move anything: their derivatives are given.

        Raises:
            UnboundedResponseError: a suspension that grows without bound.
            ImpossibleBodyError: a mass matrix that is not positive definite.
        """
        lines, predictions = [], []
        blocks: list[FloatArray] = []
        further: list[FloatArray] = []
        for place, run in enumerate(self.runs):
            prediction, by, more = self._predict(theta, place, sensitivity, candidates)
            innovation = prediction.innovation[: len(self.sensors.sprung)]
            lines.append((run.transform(innovation) / self._levels(place)).ravel())
            predictions.append(prediction)
            if sensitivity:
                blocks += _real_rows(by)
                further += _real_rows(more)
        departure, by_prior = self._known_before(theta)
        stacked = np.concatenate([part for e in lines for part in (e.real, e.imag)] + [departure])
        jacobian = np.concatenate([*blocks, by_prior if sensitivity else by_prior[:0]])
        columns = np.concatenate(further) if further else np.empty((0, 0))
        return Errors(stacked, jacobian, tuple(lines), tuple(predictions), columns)

    def _known_before(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What was known before the data: faults of sensors, places, roughly how a run begins, and of the laws."""
        known = [(fault.nominal, fault.std) for fault in self.faults]
        known += [(0.0, coordinate.std) for coordinate in self.body.coordinates]
        start_rms = self.settings.runs.start_rms
        of_run = [(0.0, start_rms * float(rms)) for rms in self.motion_rms.ravel()]
        of_run += [(0.0, self.repeatability)] * self._n_departures
        known += of_run * len(self.runs)
        nominal, std = np.array(known).reshape(-1, 2).T
        first = theta.size - std.size
        jacobian = np.zeros((std.size, theta.size))
        jacobian[np.arange(std.size), first + np.arange(std.size)] = 1 / std
        of_laws, by_laws = self._known_of_laws(theta)
        return np.concatenate([(theta[first:] - nominal) / std, of_laws]), np.concatenate([jacobian, by_laws])

    def log_likelihood(self, errors: Errors, theta: FloatArray) -> float:
        """Return the logarithm of the likelihood of the lines, the noise level at its estimate, up to a constant.

        The spectral density of the readings is that of both noises, the one below passed through the transmissibility
        T with the mean slopes of the laws: N_s + T N_u T^H.
        """
        n_data = 2 * sum(line.size for line in errors.lines)
        cost = sum(float(np.sum(np.abs(line) ** 2)) for line in errors.lines)
        spread = 0.0
        for place, (run, prediction) in enumerate(zip(self.runs, errors.predictions, strict=True)):
            below, above = self._noise_of_readings(theta, run)
            ratio = self.transmissibility(theta, place, prediction)
            density = (ratio * below**2) @ ratio.conj().transpose(0, 2, 1) + np.diag(above**2)
            if self.process.fraction:
                density = density + self._process_density(theta, place, prediction)
            # of the readings themselves, before their gains were taken out
            spread += float(np.sum(np.linalg.slogdet(density)[1]))
            spread += 2 * run.omega.size * float(np.sum(np.log(self._gains(theta)[1])))
            spread += 2 * float(np.sum(np.log(np.broadcast_to(self._levels(place), (above.size, run.omega.size)))))
        return -0.5 * n_data * float(np.log(cost / n_data)) - spread

    def transmissibility(self, theta: FloatArray, place: int, prediction: Prediction) -> ComplexArray:
        """Return the acceleration of each sensor over that below each suspension, with the mean slopes of the laws.

        Returns:
            (n_lines, n_sensors, n_interfaces).
        """
        n = self.body.n_interfaces
        omega, moved, spring, ground, system = self._straight(theta, place, prediction)
        square = (omega**2)[:, np.newaxis, np.newaxis]
        driven = -np.eye(len(ground)) + moved.accelerance * ground / square
        travel = np.asarray(np.linalg.solve(system, driven[:, :, :n]), dtype=np.complex128)
        force = (spring + ground)[:, :, np.newaxis] * travel - (np.diag(ground) / square)[:, :, :n]
        read = moved.reading @ force
        return -read[:, : len(self.sensors.sprung)]

    def _process_density(self, theta: FloatArray, place: int, prediction: Prediction) -> ComplexArray:
        """What unmeasured forces make of the spectral density of the readings, (n_lines, n_sensors, n_sensors)."""
        run, n = self.runs[place], len(self.sensors.sprung)
        omega, moved, spring, ground, system = self._straight(theta, place, prediction)
        travel = np.linalg.solve(system, np.broadcast_to(np.eye(len(ground))[:, :n], (omega.size, len(ground), n)))
        read = np.eye(len(ground))[:, :n] - moved.reading @ ((spring + ground)[:, :, np.newaxis] * travel)
        decay = np.exp(-2 * np.pi * self.process.corner_hz / run.fs)
        shape = (1 - decay**2) / np.abs(1 - decay * np.exp(-1j * omega / run.fs)) ** 2
        rms = self.process.fraction * run.sprung.std(axis=0)
        density = (read[:, :n] * rms**2) @ read[:, :n].conj().transpose(0, 2, 1)
        return np.asarray(shape[:, np.newaxis, np.newaxis] * density, dtype=np.complex128)

    def _straight(
        self, theta: FloatArray, place: int, prediction: Prediction
    ) -> tuple[FloatArray, Mobility, ComplexArray, FloatArray, ComplexArray]:
        """Lines, what forces do to the body, springs with the mean slopes of the laws, and what gives z from z''."""
        omega = self.runs[place].omega
        slots = self.resting_interfaces(theta, place)
        moved = self.mobility(theta, place)
        spring = np.zeros((omega.size, len(slots)), dtype=np.complex128)
        ground = np.array([slot.ground_stiffness for slot in slots])
        for k, slot in enumerate(slots):
            assert isinstance(slot.law, Law)  # without candidates
            z, v = prediction.travel[:, k], prediction.velocity[:, k]
            by_z, by_v = slot.law.gradient(z, v)
            spring[:, k] = slot.stiffness + by_z.mean() + 1j * omega * (slot.damping + by_v.mean())
            if slot.law.has_memory:
                stiffness, damping = _of_memories(slot.law, z, v, self.runs[place].fs)
                spring[:, k] += stiffness + 1j * omega * damping
        square = (omega**2)[:, np.newaxis, np.newaxis]
        # z'' = -A F - u, F = spring z + ground (z + x1), x1 = -u / omega^2
        system = moved.accelerance * (spring + ground)[:, np.newaxis, :] - square * np.eye(len(slots))
        return omega, moved, spring, ground, system


def noise_level(noise: tuple[FloatArray, FloatArray]) -> float:
    """Return the noise of the sensors below and on the body as white noise of one level on all of them, m/s^2."""
    return float(np.sqrt(np.mean([float(np.mean(np.square(side))) for side in noise])))


def _of_memories(law: Law, z: FloatArray, v: FloatArray, fs: float) -> tuple[float, float]:
    """Stiffness and damping that come nearest to what the terms with memory do along a motion."""
    remembering = Law(tuple(term for term in law.terms if term.kind.memory is not None))
    columns, force = np.stack([z - z.mean(), v, np.ones_like(z)], axis=1), force_along(remembering, z, v, fs)
    # a memory that turns over too fast to be followed is none that holds
    found = np.linalg.lstsq(columns, np.where(np.isfinite(force), force, 0.0), rcond=None)[0]
    return float(found[0]), float(found[1])


def _moved(slots: list[Interface], rest: Rest | None) -> list[Interface]:
    """Suspensions where they rest in a run."""
    if rest is None:
        return slots
    return [resting(slot, float(travel)) for slot, travel in zip(slots, rest.travel, strict=True)]


def _loosely(size: float, share: float) -> tuple[float, float]:
    """Return the root of minus twice a log density with long tails, sqrt(2 log(1 + x^2/2)), and its derivative."""
    cost = float(np.sqrt(2.0 * np.log1p(0.5 * size**2)))
    return float(np.copysign(cost, size)), share * (abs(size) / (cost * (1.0 + 0.5 * size**2)) if size else 1.0)


def _widened(samples: FloatArray, n_slots: int) -> FloatArray:
    """A column for every slot: nothing drives or reads those behind."""
    if samples.shape[1] == n_slots:
        return samples
    return np.concatenate([samples, np.zeros((len(samples), n_slots - samples.shape[1]))], axis=1)


def _real_rows(by: ComplexArray) -> list[FloatArray]:
    rows = by.reshape(len(by), by.shape[1] * by.shape[2]).T
    return [rows.real, rows.imag]
