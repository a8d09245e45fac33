"""Prediction errors of a body on driven suspensions and their derivatives, as functions of one vector.

Every reading on the body corrects the simulated motion by as much as the noise levels make right
(`opid.mechanics.prediction`), so that the errors are white for the true model. Lines of a band of them are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from opid.mechanics.driven import Interface
from opid.mechanics.laws import LINEAR, Law
from opid.mechanics.prediction import Noise, Prediction, predict
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.law_parameters import free_bounds, from_free, positive
from opid.suspensions.one_gear.driven_model import OFFSET_M_PER_S2, START_RMS, Errors
from opid.suspensions.run import BodyRun
from opid.suspensions.structure import Body, Mobility, mobility

# the reading of a slot that has no sensor: nothing is learnt from it
NO_SENSOR_M_PER_S2 = 1e6
# how far the logarithm of a positive entry may move in a step
LARGEST_LOG_STEP = 1.0
# places are not looked for farther from where they are said to be, in standard deviations
FARTHEST_STD = 6.0


@dataclass(frozen=True)
class Group:
    """Interfaces that share stiffness, damping and law.

    Args:
        name: "left", or "left, right".
        slots: of its interfaces.
        law: says which terms, per unit of the reference mass.
    """

    name: str
    slots: tuple[int, ...]
    law: Law = LINEAR


@dataclass(frozen=True, eq=False)
class BodyModel:
    """Prediction errors and their derivatives as functions of one vector.

    Stiffness, damping and law (positive entries as logarithms) of each group, stiffness and damping of each spring
    inside that is to be found, free factors of the mass, [1 / reference mass], coordinates; then travel and velocity of
    each interface at the start of each run.

    Args:
        runs: the runs.
        body: the body.
        groups: which interfaces share what.
        mass_free: whether one over the reference mass is fitted.
        noise: (2,) of the sensors below and on the body, m/s^2.
        motion_rms: (n_interfaces, 2) rms travel (m) and velocity (m/s), roughly.
        held_inverse_mass: one over the reference mass where it is not fitted, 1/kg; 0 for ratios alone.
    """

    runs: tuple[BodyRun, ...]
    body: Body
    groups: tuple[Group, ...]
    mass_free: bool
    noise: tuple[float, float]
    motion_rms: FloatArray
    held_inverse_mass: float = 0.0

    @cached_property
    def coarse(self) -> BodyModel:
        """The model of the same runs at a coarse rate; itself where theirs is."""
        runs = tuple(run.coarse for run in self.runs)
        return self if runs == self.runs else replace(self, runs=runs)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the shared parameters."""
        names: list[str] = []
        for group in self.groups:
            names += [f"stiffness_per_mass[{group.name}]", f"damping_per_mass[{group.name}]"]
            names += [f"law[{group.name}][{i}]" for i in range(group.law.vector.size)]
        for _, spring in self._searched:
            names += [f"stiffness_per_mass[{spring}]", f"damping_per_mass[{spring}]"]
        names += [*self.body.names, *(["inverse_mass"] if self.mass_free else [])]
        return (*names, *(coordinate.name for coordinate in self.body.coordinates))

    @cached_property
    def _searched(self) -> tuple[tuple[int, str], ...]:
        """Slots and names of the springs inside whose stiffness is to be found."""
        inside = enumerate(self.body.inside, start=self.body.n_interfaces)
        return tuple((slot, spring.name) for slot, spring in inside if spring.stiffness_n_per_m is None)

    @cached_property
    def first_of_group(self) -> tuple[int, ...]:
        """Place of the stiffness of each group in the vector."""
        sizes = [2 + group.law.vector.size for group in self.groups]
        return tuple(int(place) for place in np.concatenate([[0], np.cumsum(sizes)])[:-1])

    @property
    def n_shared(self) -> int:
        """Number of shared parameters."""
        return len(self.names)

    @property
    def _n_own(self) -> int:
        return 2 * self.body.n_interfaces

    @property
    def _first_mass(self) -> int:
        return self.n_shared - len(self.body.coordinates) - self.mass_free - len(self.body.names)

    def law_places(self, number: int) -> slice:
        """Place of the law of a group in the vector.

        Args:
            number: of the group.
        """
        first = self.first_of_group[number] + 2
        return slice(first, first + self.groups[number].law.vector.size)

    def inverse_mass(self, theta: FloatArray) -> float:
        """One over the reference mass at a vector, 1/kg; 1 where the body is given in kg.

        Args:
            theta: the vector.
        """
        if self.mass_free:
            return float(theta[self.names.index("inverse_mass")])
        return 1.0 if self.body.absolute else self.held_inverse_mass

    def mobility(self, theta: FloatArray, place: int) -> Mobility:
        """Return what forces do to the body in one run.

        Args:
            theta: the vector.
            place: of the run.
        """
        first, n_parts = self._first_mass, len(self.body.names)
        shifts = theta[self.n_shared - len(self.body.coordinates) : self.n_shared]
        return mobility(
            self.body, theta[first : first + n_parts], self.inverse_mass(theta), shifts, self.runs[place].loading
        )

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the vector, infinite but for scales, damping and coordinates."""
        lower = np.full(self.n_shared + self._n_own * len(self.runs), -np.inf)
        upper = -lower
        for number, group in enumerate(self.groups):
            travel_rms, velocity_rms = np.sqrt(np.mean(self.motion_rms[list(group.slots)] ** 2, axis=0))
            places = self.law_places(number)
            lower[places], upper[places] = free_bounds(group.law, travel_rms=travel_rms, velocity_rms=velocity_rms)
        for k, coordinate in enumerate(self.body.coordinates, start=self.n_shared - len(self.body.coordinates)):
            lower[k], upper[k] = -FARTHEST_STD * coordinate.std, FARTHEST_STD * coordinate.std
        return lower, upper

    def largest_steps(self) -> FloatArray:
        """How far each entry may move in a step."""
        caps = np.full(self.n_shared + self._n_own * len(self.runs), np.inf)
        for number, group in enumerate(self.groups):
            caps[self.law_places(number)][positive(group.law)] = LARGEST_LOG_STEP
        return caps

    def interfaces(self, theta: FloatArray) -> tuple[list[Interface], list[FloatArray]]:
        """Return the suspensions of all slots at a vector, and what their laws' entries move by (see `from_free`).

        Args:
            theta: the vector.
        """
        slots: list[Interface] = [Interface(0.0, 0.0)] * self.body.n_slots
        slopes: list[FloatArray] = []
        for number, (group, first) in enumerate(zip(self.groups, self.first_of_group, strict=True)):
            law, slope = LINEAR, np.empty(0)
            if group.law.terms:
                law, slope = from_free(group.law, theta[self.law_places(number)])
            slopes.append(slope)
            for slot in group.slots:
                slots[slot] = Interface(float(theta[first]), float(theta[first + 1]), 0.0, law)
        mu, first = self.inverse_mass(theta), self._first_mass - 2 * len(self._searched)
        for slot, spring in enumerate(self.body.inside, start=self.body.n_interfaces):
            if spring.stiffness_n_per_m is not None and spring.damping_n_s_per_m is not None:
                slots[slot] = Interface(mu * spring.stiffness_n_per_m, mu * spring.damping_n_s_per_m)
        for k, (slot, _) in enumerate(self._searched):
            slots[slot] = Interface(float(theta[first + 2 * k]), float(theta[first + 2 * k + 1]))
        return slots, slopes

    def predict(self, theta: FloatArray, place: int, *, sensitivity: bool = True) -> tuple[Prediction, ComplexArray]:
        """Predict one run; also give the derivatives of the lines of its errors, (n_unknowns, n_sensors, n_lines).

        Args:
            theta: the vector.
            place: of the run.
            sensitivity: whether the derivatives are wanted; there are none otherwise.
        """
        run, body, n_slots = self.runs[place], self.body, self.body.n_slots
        slots, slopes = self.interfaces(theta)
        moved = self.mobility(theta, place)
        n_directions = len(body.names) + self.mass_free
        kept = [*range(n_directions), *range(len(body.names) + 1, len(moved.by_accelerance))]
        drive, measured = np.zeros((len(run.drive), n_slots)), np.zeros((run.n_samples, n_slots))
        drive[:, : body.n_interfaces], measured[:, : run.sprung.shape[1]] = run.drive, run.sprung
        start, std = self._at_start(theta, place)
        prediction = predict(
            slots,
            moved.accelerance,
            drive,
            measured,
            fs=run.fs,
            noise=self._noise(run),
            start=start,
            start_std=std,
            accelerance_directions=moved.by_accelerance[kept],
            reading=moved.reading,
            reading_directions=moved.by_reading[kept],
            sensitivity=sensitivity,
        )
        n_sensors = run.sprung.shape[1]
        by = np.zeros((theta.size if sensitivity else 0, n_sensors, run.omega.size), dtype=np.complex128)
        if sensitivity:
            change = run.transform(prediction.sensitivity[:n_sensors]).transpose(1, 0, 2)
            self._sort_out(change, slots, slopes, n_directions, place, by)
        # a hundred times larger than the rest, and used up
        return replace(prediction, sensitivity=prediction.sensitivity[:, :0]), by

    def _at_start(self, theta: FloatArray, place: int) -> tuple[FloatArray, FloatArray]:
        """Travel, velocity and offsets of the sensors of all slots at the first sample of a run, and how well known."""
        body, n_sensors = self.body, self.runs[place].sprung.shape[1]
        start, std = np.zeros((4, body.n_slots)), np.zeros((4, body.n_slots))
        start[:2, : body.n_interfaces] = theta[self.n_shared + self._n_own * place :][: self._n_own].reshape(-1, 2).T
        std[:2, : body.n_interfaces] = 1e-9
        springs = np.abs(body.rows[body.n_interfaces :]).max(axis=1, initial=0.0) > 0.0
        std[:2, body.n_interfaces :] = springs * START_RMS * self.motion_rms.max(axis=0, initial=0.0)[:, np.newaxis]
        std[2, : body.n_interfaces] = std[3, :n_sensors] = OFFSET_M_PER_S2
        return start, std

    def _sort_out(
        self,
        change: ComplexArray,
        slots: Sequence[Interface],
        slopes: Sequence[FloatArray],
        n_directions: int,
        place: int,
        by: ComplexArray,
    ) -> None:
        """Add the derivatives by what the slots have to those by the entries of the vector."""
        firsts = np.concatenate([[0], np.cumsum([slot.n_parameters for slot in slots])])
        for number, (group, first) in enumerate(zip(self.groups, self.first_of_group, strict=True)):
            for slot in group.slots:
                by[first : first + 2] += change[firsts[slot] : firsts[slot] + 2]
                of_law = change[firsts[slot] + 3 : firsts[slot + 1]]
                by[self.law_places(number)] += of_law * slopes[number][:, np.newaxis, np.newaxis]
        first_mass = self._first_mass
        for k, (slot, _) in enumerate(self._searched):
            row = first_mass - 2 * len(self._searched) + 2 * k
            by[row : row + 2] += change[firsts[slot] : firsts[slot] + 2]
        directions = change[firsts[-1] :]
        by[first_mass : first_mass + n_directions] += directions[:n_directions]
        n_coordinates = len(self.body.coordinates)
        by[self.n_shared - n_coordinates : self.n_shared] += directions[n_directions : n_directions + n_coordinates]
        if self.mass_free:
            row = first_mass + n_directions - 1
            for slot, spring in enumerate(self.body.inside, start=self.body.n_interfaces):
                by[row] += (spring.stiffness_n_per_m or 0.0) * change[firsts[slot]]
                by[row] += (spring.damping_n_s_per_m or 0.0) * change[firsts[slot] + 1]
        starts, n_slots = directions[n_directions + n_coordinates :], self.body.n_slots
        row = self.n_shared + self._n_own * place
        for interface in range(self.body.n_interfaces):
            by[row + 2 * interface] = starts[interface]
            by[row + 2 * interface + 1] = starts[n_slots + interface]

    def _noise(self, run: BodyRun) -> Noise:
        """White noise sampled finer has the same density only at a higher level.

        Of runs sampled coarser the drive alone is averaged.
        """
        below, above = (level * float(np.sqrt(run.finer)) for level in self.noise)
        below /= float(np.sqrt(run.coarser))
        n_slots, n_sensors = self.body.n_slots, run.sprung.shape[1]
        drive = [below] * self.body.n_interfaces + [0.0] * (n_slots - self.body.n_interfaces)
        return Noise(drive, [above] * n_sensors + [NO_SENSOR_M_PER_S2] * (n_slots - n_sensors))

    def evaluate(self, theta: FloatArray, *, sensitivity: bool = True) -> Errors:
        """Return errors, Jacobian and predictions at a vector; of each run the lines of one sensor after the other.

        Args:
            theta: the vector.
            sensitivity: whether the Jacobian is wanted; it is empty otherwise.
        """
        lines, blocks, predictions = [], [], []
        for place, run in enumerate(self.runs):
            prediction, by = self.predict(theta, place, sensitivity=sensitivity)
            lines.append(run.transform(prediction.innovation[: run.sprung.shape[1]]).ravel())
            predictions.append(prediction)
            if sensitivity:
                blocks.append(by.reshape(len(by), -1).T)
        departure, by_prior = self._known_before(theta)
        stacked = np.concatenate([part for e in lines for part in (e.real, e.imag)] + [departure])
        jacobian = np.concatenate([part for b in blocks for part in (b.real, b.imag)] + [by_prior])
        return Errors(stacked, jacobian, tuple(lines), tuple(predictions))

    def _known_before(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What was known before the data: roughly where things are, and how a run begins."""
        std = [coordinate.std for coordinate in self.body.coordinates]
        std += [START_RMS * float(rms) for rms in self.motion_rms.ravel()] * len(self.runs)
        first = theta.size - len(std)
        jacobian = np.zeros((len(std), theta.size))
        jacobian[np.arange(len(std)), first + np.arange(len(std))] = 1 / np.array(std)
        return theta[first:] / np.array(std), jacobian

    def log_likelihood(self, errors: Errors) -> float:
        """Logarithm of the likelihood of the lines, with the noise level at its estimate, up to a constant.

        Args:
            errors: at a vector.
        """
        n_data = 2 * sum(line.size for line in errors.lines)
        cost = sum(float(np.sum(np.abs(line) ** 2)) for line in errors.lines)
        spread = sum(
            run.omega.size * float(np.sum(np.mean(2 * np.log(prediction.spread[: run.sprung.shape[1]]), axis=1)))
            for run, prediction in zip(self.runs, errors.predictions, strict=True)
        )
        return -0.5 * n_data * float(np.log(cost / n_data)) - spread
