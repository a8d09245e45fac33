"""Prediction errors of a body on driven suspensions, and their derivatives, as functions of one vector.

The noise below the suspensions drives the model, too. Every reading on the body therefore corrects the simulated motion
by an amount that follows from the noise levels (`opid.mechanics.driven`), so that the errors are white for the true
model, whatever the law. Only the lines in a band are compared: the readings below and above it do not matter.

The likelihood needs the spectral density of both noises, for which each law is replaced by its mean slopes.

A gear alone is a body with one interface, M2 its mass. The equations are the same for any number of interfaces; only a
column of gas, which carries the weight, needs a single suspension.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.driven import Interface, Noise, Prediction, predict
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.memory import force_along
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.model.body import Mobility
from opid.suspensions.model.run import DrivenRun
from opid.suspensions.model.unknowns import (
    Unknowns,
    add_departures,
    add_rest,
    compare_with_prior,
    put_at_rest,
    sort_out,
)

# noise of an attachment without a sensor, whose reading is then ignored
_NO_SENSOR_M_PER_S2 = 1e6
# factor on the noise on the body, and divisor of the noise below, for free motions
_DEAF = 1e4


@dataclass(frozen=True, eq=False)
class ProcessNoise:
    """Process noise: unmeasured forces on the body, and motion that the model does not describe.

    Args:
        fraction: its rms acceleration over that of the readings of a run; 0 for none.
        corner_hz: frequency above which its spectral density decreases, Hz.
        levels: for each run (n_sensors, n_lines) relative size of the errors, band by band; empty if all are 1.
    """

    fraction: float = 0.0
    corner_hz: float = 10.0
    levels: tuple[FloatArray, ...] = ()

    def acceleration_rms(self, run: DrivenRun) -> FloatArray:
        """Return its rms acceleration at each sensor on the body in a run, m/s^2; it does not move those of struts."""
        rms = self.fraction * run.sprung.std(axis=0)
        rms[rms.size - run.n_strut :] = 0.0
        return np.asarray(rms)


NO_PROCESS_NOISE = ProcessNoise()


@dataclass(frozen=True, eq=False)
class Errors:
    """Whitened prediction errors of all runs at one vector.

    Args:
        stacked: (n_data + n_priors,) real and imaginary parts of the lines, then the departures from prior values.
        jacobian: (n_data + n_priors, n_unknowns) derivatives; no rows if they were not requested.
        lines: one complex array (n_sensors * n_lines,) for each run, one sensor after the other.
        predictions: prediction of each run, without derivatives.
        candidates: (n_data, n_values) derivatives by the amplitudes and inner values of further terms, if requested.
    """

    stacked: FloatArray
    jacobian: FloatArray
    lines: tuple[ComplexArray, ...]
    predictions: tuple[Prediction, ...]
    candidates: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Model(Unknowns):
    """Prediction errors and their derivatives as functions of one vector (see `Unknowns` for its entries).

    Args:
        noise: noise of the sensors below the suspensions, (n_interfaces,), and on the body, (n_sensors,), m/s^2.
        most_noise: factor by which the noise in the band may be larger; 1 if it was stated or if spectra show it.
        louder: factor on the noise that moves the suspensions during continuation; it stands for errors of parameters
            that are still wrong.
        process: process noise.
        is_held: whether, during continuation, a column of gas carries all of the weight.
        forgets: whether the first periods are not compared, because the initial forces of the sliders of a joint are
            unknown. Fits are compared with each other only if they use the same samples.
    """

    noise: tuple[FloatArray, FloatArray]
    most_noise: float = 1.0
    louder: float = 1.0
    process: ProcessNoise = NO_PROCESS_NOISE
    is_held: bool = False
    forgets: bool = False

    @cached_property
    def coarse(self) -> Model:
        """The model of the same runs at a coarse rate; itself if their rate is coarse already."""
        runs = tuple(run.coarse for run in self.runs)
        return self if all(a is b for a, b in zip(runs, self.runs, strict=True)) else replace(self, runs=runs)

    @cached_property
    def free(self) -> Model:
        """The model of the free motion: readings on the body do not correct it, and the drive is exact.

        Its errors have the same unit.
        """
        below, above = self.noise
        runs = tuple(replace(run, error_level=run.error_level / _DEAF, drive_step_m_per_s2=0.0) for run in self.runs)
        return replace(self, runs=runs, noise=(below / _DEAF, above * _DEAF), process=NO_PROCESS_NOISE)

    @property
    def level(self) -> float:
        """The assumed noise, as white noise of one level on all accelerometers, m/s^2."""
        below, above = self.noise
        return noise_level((below, above[: above.size - self.runs[0].n_strut]))

    @property
    def n_known_of_laws(self) -> int:
        """Number of priors of stiffness, laws and mass: of exponents, of the carried weight, and of the mass."""
        exponents = [parameter for group in self.groups for parameter in group.law.parameter_list if parameter.known]
        return len(exponents) + 2 * len(self.carriers) + self.has_prior_mass + len(self.scales)

    @property
    def slips(self) -> bool:
        """Whether a law has elements that slip, one after the other."""
        return any(term.kind.slips for group in self.groups for term in group.law.terms)

    @cached_property
    def _fades(self) -> tuple[FloatArray, ...]:
        """Weight of each sample of a run, with mean square 1; empty if all samples have the same weight.

        Errors due to unknown initial forces of sliders last until the motion has made all of them slide that it can.
        """
        if not self.forgets:
            return ()
        known = self.settings.fit
        travel_rms, velocity_rms = self.motion_rms.T
        unknown_s = known.unknown_periods * 2 * np.pi * float(np.max(travel_rms / velocity_rms))
        fades = []
        for run in self.runs:
            last = min(int(unknown_s * run.fs), int(known.most_unknown_fraction * run.n_samples))
            # The weight rises from zero over the last fifth, so that the errors have no edge.
            fade = np.clip((np.arange(1, run.n_samples + 1) - 0.8 * last) / max(0.2 * last, 1.0), 0.0, 1.0)
            fade = 0.5 - 0.5 * np.cos(np.pi * fade)
            fades.append(fade / np.sqrt(np.mean(fade**2)))
        return tuple(fades)

    @cached_property
    def compared_fraction(self) -> float:
        """Fraction of the samples that are compared."""
        n = sum(run.n_samples for run in self.runs)
        return sum(fade.size / float(fade.max()) ** 2 for fade in self._fades) / n if self._fades else 1.0

    def _fade_errors(self, index: int, errors: FloatArray) -> FloatArray:
        return errors * self._fades[index] if self._fades else errors

    @cached_property
    def compared(self) -> slice:
        """Sensors whose prediction errors are compared, a slice of those on the body.

        Where the drive was not measured, the errors of the sensors above the suspensions tell of the drive, of which
        nothing is assumed, and those of the others, for which the first ones are known, tell of the suspensions.
        """
        is_driven = not any(run.drive_step_m_per_s2 for run in self.runs)
        return slice(0 if is_driven else self.body.n_interfaces, len(self.sensors.sprung))

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """Which entries of the vector cannot move, and only widen the intervals of the others."""
        lower, upper = self.bounds()
        return np.asarray(lower == upper)

    @cached_property
    def is_weighed(self) -> NDArray[np.bool_]:
        """Which departures from prior values enter the criterion of a model: all except those of initial states."""
        first = self.first_fault
        weighed = np.ones(self.n_shared - first + self.n_own * len(self.runs) + self.n_known_of_laws, dtype=bool)
        for index in range(len(self.runs)):
            start = self.indices_of_run(index)[0]
            weighed[start.start - first : start.stop - first] = False
        return weighed

    def _predict(
        self,
        theta: FloatArray,
        index: int,
        sensitivity: bool,
        suspensions: tuple[list[Interface], list[FloatArray]],
        candidates: Mapping[int, Sequence[Term]],
    ) -> tuple[Prediction, ComplexArray, ComplexArray]:
        """Predict one run; also give the derivatives of the lines, (n_unknowns, n_sensors, n_lines).

        The suspensions are those of the reference run, as `interfaces` returns them.
        """
        run, body, n_attachments = self.runs[index], self.body, self.body.n_attachments
        of_reference, slopes = suspensions
        rest = self._build_rest(theta, index, of_reference)
        resting = put_at_rest(of_reference, rest)
        moving = self.apply_departures(resting, theta, index)
        moved = self.mobility(theta, index)
        n_directions = len(body.names) + self.mass_free
        kept = [*range(n_directions), *range(len(body.names) + 1, len(moved.by_accelerance))]
        below, above = self.correct(theta, index)
        n_sensors = above.value.shape[1]
        start, covariance = state_at_start(self, theta, index)
        prediction = predict(
            moving,
            moved.accelerance,
            _widen(below.value, n_attachments),
            _widen(above.value, n_attachments),
            fs=run.fs,
            noise=self.noise_in(theta, run),
            start=start,
            start_covariance=covariance,
            accelerance_directions=moved.by_accelerance[kept],
            # A sensor at its interface reads the acceleration there, so that the predictor need not distinguish them.
            reading=None if self._is_plain else moved.reading,
            reading_directions=None if self._is_plain else moved.by_reading[kept],
            reading_of_travel=self._reading_of_travel,
            drive_directions=below.directions(n_attachments),
            measured_directions=above.directions(n_attachments),
            ground=self.ground,
            sensitivity=sensitivity,
        )
        n_compared = len(range(n_sensors)[self.compared])
        by = np.zeros((theta.size if sensitivity else 0, n_compared, run.omega.size), dtype=np.complex128)
        further = by[:0]
        if sensitivity:
            change = prediction.sensitivity[:n_sensors]
            if below.by or above.by:
                change = change.copy()
                first = change.shape[1] - self._n_starts - len(below.by) - len(above.by)
                self._add_spread(change[:, first:], prediction, theta, run, (*below.by, *above.by))
            lines = run.transform(self._fade_errors(index, change[self.compared]))
            lines = lines.transpose(1, 0, 2) / self._compute_levels(index)
            if self.n_departures:
                add_departures(self, lines, resting, theta, index, by)
            if rest is not None:
                add_rest(self, lines, rest, of_reference, theta, index, by)
            further = sort_out(self, lines, moving, slopes, (*below.by, *above.by), index, by, candidates)
        # The sensitivity is no longer needed, and a hundred times larger than everything else.
        return replace(prediction, sensitivity=prediction.sensitivity[:, :0]), by, further

    @cached_property
    def _is_plain(self) -> bool:
        """Whether the readings are the accelerations at the interfaces, in this order."""
        body = self.body
        return (
            body.of_travel is None
            and body.of_force is None
            and body.rows.shape == body.readings.shape
            and np.array_equal(body.rows, body.readings)
            and not body.coordinates
        )

    @cached_property
    def _reading_of_travel(self) -> FloatArray | None:
        """Reading of each attachment's sensor for a unit travel of each, (n_attachments, n_attachments) 1/s^2."""
        if self.body.of_travel is None:
            return None
        found = np.zeros((self.body.n_attachments, self.body.n_attachments))
        found[: len(self.body.of_travel)] = self.body.of_travel
        return found

    @property
    def _n_starts(self) -> int:
        """Number of directions of the initial state in the predictor."""
        return (4 if self.ground else 2) * self.body.n_attachments

    def _compute_noise_of_readings(self, theta: FloatArray, run: DrivenRun) -> tuple[FloatArray, FloatArray]:
        """Return the noise of the corrected readings at the rate of the run.

        The noise is that of the readings: a large gain must not make the errors look small. White noise that is sampled
        finer has the same density only with a larger rms; in runs that are sampled coarser only the drive is averaged.
        """
        below, above = (side * np.sqrt(run.finer) for side in self.noise)
        gains = self.gains(theta, run.number)
        return below / gains[0] / np.sqrt(run.stride), above / gains[1]

    def noise_in(self, theta: FloatArray, run: DrivenRun) -> Noise:
        """Return the noise of all attachments in a run; an AC coupling that was undone integrates its noise."""
        levels = self._compute_noise_of_readings(theta, run)
        values, rows = self.fault_values(theta), []
        for side, level, n_all, absent in (
            ("unsprung", levels[0], self.body.n_attachments, 0.0),
            ("sprung", levels[1], self.body.n_attachments, _NO_SENSOR_M_PER_S2),
        ):
            corners = np.array([facts.corner_hz for facts in self.sensors.facts(side)])  # type: ignore[arg-type]
            for fault in self.faults:
                if fault.kind == "corner" and fault.side == side:
                    corners[fault.channel] = values[fault.name]
            walk = 2 * np.pi * corners / run.fs * level
            n_more = n_all - level.size
            rows.append((np.append(level, [absent] * n_more), np.append(walk, [0.0] * n_more)))
        motion = np.sqrt(self.louder**2 - 1) * rows[0][0]
        if run.drive_step_m_per_s2:
            rows[0][1][: self.body.n_interfaces] = run.step_of_unmeasured_drive
        unmeasured = np.zeros(self.body.n_attachments)
        if self.process.fraction:
            unmeasured[: len(levels[1])] = self.process.acceleration_rms(run)
        return Noise(
            rows[0][0].tolist(),
            rows[1][0].tolist(),
            rows[0][1].tolist(),
            rows[1][1].tolist(),
            motion.tolist(),
            unmeasured.tolist(),
            self.process.corner_hz,
        )

    def simulate(self, theta: FloatArray) -> tuple[Prediction, ...]:
        """Return the free motion of each run, which the readings on the body do not correct.

        Args:
            theta: the vector.

        Raises:
            UnboundedResponseError: a motion that grows without bound.
        """
        return self.free.evaluate(theta, sensitivity=False).predictions

    def _compute_levels(self, index: int) -> FloatArray:
        """Return the relative size of the errors of a run, (n_sensors, n_lines) or one number for all."""
        level = self.runs[index].error_level
        return level * self.process.levels[index] if self.process.levels else np.full((1, 1), level)

    def _add_spread(
        self,
        change: FloatArray,
        prediction: Prediction,
        theta: FloatArray,
        run: DrivenRun,
        by_fault: Sequence[tuple[str, int, FloatArray]],
    ) -> None:
        """Add the effect of a gain on the innovations through their spread: all gains together change nothing."""
        kinds = {fault.name: fault for fault in self.faults}
        n_sensors, values = len(self.sensors.sprung), self.fault_values(theta)
        own = (self._compute_noise_of_readings(theta, run)[1][:, np.newaxis] / prediction.spread[:n_sensors]) ** 2
        if run.drive_step_m_per_s2:
            # No gain acts on a drive that was not measured: one on a reading scales its errors, whatever their origin.
            own = np.ones_like(own)
        for row, (name, channel, _) in enumerate(by_fault):
            fault = kinds[name]
            if fault.kind != "gain":
                continue
            gain = values[name]
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
        """Return errors, Jacobian and predictions at a vector; for each run the lines of one sensor after the other.

        Candidates are further terms by the number of the group, too weak to change the motion; their derivatives are
        returned.

        Raises:
            UnboundedResponseError: a suspension that grows without bound.
            ImpossibleBodyError: a mass matrix that is not positive definite.
        """
        lines, predictions = [], []
        blocks: list[FloatArray] = []
        further: list[FloatArray] = []
        suspensions = self.interfaces(theta, candidates)
        for index, run in enumerate(self.runs):
            prediction, by, more = self._predict(theta, index, sensitivity, suspensions, candidates or {})
            innovation = prediction.innovation[: len(self.sensors.sprung)][self.compared]
            lines.append((run.transform(self._fade_errors(index, innovation)) / self._compute_levels(index)).ravel())
            predictions.append(prediction)
            if sensitivity:
                blocks += _stack_real_rows(by)
                further += _stack_real_rows(more)
        departure, by_prior = compare_with_prior(self, theta, is_held=self.is_held)
        stacked = np.concatenate([part for e in lines for part in (e.real, e.imag)] + [departure])
        jacobian = np.concatenate([*blocks, by_prior if sensitivity else by_prior[:0]])
        if sensitivity:
            _release_held(jacobian[: len(jacobian) - len(by_prior)], self.held)
        columns = np.concatenate(further) if further else np.empty((0, 0))
        return Errors(stacked, jacobian, tuple(lines), tuple(predictions), columns)

    def log_likelihood(self, errors: Errors, theta: FloatArray) -> float:
        """Return the logarithm of the likelihood of the lines, the noise level at its estimate, up to a constant.

        The spectral density of the readings is that of both noises, the one below passed through the transmissibility
        T with the mean slopes of the laws: N_s + T N_u T^H.
        """
        n_data, n_compared = 2 * sum(line.size for line in errors.lines), len(self.sensors.sprung) - self.compared.start
        cost = sum(float(np.sum(np.abs(line) ** 2)) for line in errors.lines)
        spread = 0.0
        for index, (run, prediction) in enumerate(zip(self.runs, errors.predictions, strict=True)):
            below, above = self._compute_noise_of_readings(theta, run)
            straight = straighten(self, theta, index, prediction)
            ratio = transmissibility(self, straight)
            drive = below**2 + run.density_of_unmeasured_drive()[:, np.newaxis]
            density = (ratio * drive[:, np.newaxis, :]) @ ratio.conj().transpose(0, 2, 1) + np.diag(above**2)
            if self.process.fraction:
                density = density + spectral_density(self.process, run, straight)
            # The density is that of the readings before they were divided by their gains, the others given.
            given = self.compared.start
            spread += float(np.sum(np.linalg.slogdet(density)[1]))
            spread -= float(np.sum(np.linalg.slogdet(density[:, :given, :given])[1])) if given else 0.0
            spread += 2 * run.omega.size * float(np.sum(np.log(self.gains(theta, run.number)[1][given:])))
            spread += 2 * float(
                np.sum(np.log(np.broadcast_to(self._compute_levels(index), (n_compared, run.omega.size))))
            )
        return -0.5 * n_data * float(np.log(cost / n_data)) - spread


def noise_level(noise: tuple[FloatArray, FloatArray]) -> float:
    """Return the noise of the sensors below and on the body as white noise of one level on all of them, m/s^2."""
    return float(np.sqrt(np.mean([float(np.mean(np.square(side))) for side in noise])))


def _widen(samples: FloatArray, n_attachments: int) -> FloatArray:
    """Return samples with a column for every attachment; attachments that are no interfaces have zeros."""
    if samples.shape[1] == n_attachments:
        return samples
    return np.concatenate([samples, np.zeros((len(samples), n_attachments - samples.shape[1]))], axis=1)


def _release_held(jacobian: FloatArray, held: NDArray[np.bool_]) -> None:
    """Replace the derivatives of the data by entries that are held by their projection on those of the others.

    The data then tell nothing of an entry that is held, and its whole effect is one of the others.
    """
    if held.any():
        others = jacobian[:, ~held]
        jacobian[:, held] = others @ np.linalg.lstsq(others, jacobian[:, held], rcond=1e-10)[0]


def _stack_real_rows(by: ComplexArray) -> list[FloatArray]:
    rows = by.reshape(len(by), by.shape[1] * by.shape[2]).T
    return [rows.real, rows.imag]


def state_at_start(unknowns: Unknowns, theta: FloatArray, index: int) -> tuple[FloatArray, FloatArray]:
    """Return the state at a run's first sample and its covariance; fitted entries are taken as exact."""
    body, known, run = unknowns.body, unknowns.settings.runs, unknowns.runs[index]
    n, n_rows, n_sensors = body.n_interfaces, 6 if unknowns.ground else 4, len(unknowns.sensors.sprung)
    start, std = np.zeros((n_rows, body.n_attachments)), np.zeros((n_rows, body.n_attachments))
    start[:2, :n] = theta[unknowns.indices_of_run(index)[0]].reshape(-1, 2).T
    std[:2, :n] = 1e-9
    springs = np.abs(body.rows[n:]).max(axis=1, initial=0.0) > 0.0
    std[:2, n:] = springs * known.start_rms * unknowns.motion_rms.max(axis=0, initial=0.0)[:, np.newaxis]
    for row, facts in ((-2, unknowns.sensors.unsprung), (-1, unknowns.sensors.sprung)):
        offsets = [known.offset_ac_m_per_s2 if each.corner_hz else known.offset_m_per_s2 for each in facts]
        std[row, : n if row == -2 else n_sensors] = offsets
    if run.drive_step_m_per_s2:
        # The offset of the drive is the drive itself.
        std[-2, :n] = run.unsprung.std(axis=0)
    covariance = np.diag(std.ravel() ** 2)
    if unknowns.ground:
        below, near = run.ground_at_start
        for k, sensor in enumerate(unknowns.sensors.unsprung):
            rows = np.arange(2, 5) * body.n_attachments + k
            if sensor.corner_hz:
                # The slow motion that an AC coupling removed from the path is unknown.
                far = (known.start_displacement_m, known.start_velocity_m_per_s, known.offset_ac_m_per_s2)
                covariance[rows, rows] = np.square(far)
            else:
                start[2:5, k], covariance[np.ix_(rows, rows)] = below[:, k], near[k]
    return start, covariance


@dataclass(frozen=True, eq=False)
class Straight:
    """A run with the mean slopes of its laws, on the lines that are compared.

    Args:
        omega: (n_lines,) angular frequencies, rad/s.
        moved: accelerances of the body.
        spring: (n_lines, n_attachments) force on the body by travel, with the mean slopes of the laws.
        ground: (n_attachments,) stiffness of the springs to the ground.
        system: (n_lines, n_attachments, n_attachments) matrix that relates travel to accelerations.
        of_travel: (n_sensors, n_attachments) reading of each sensor for a unit travel, 1/s^2; None if none reads it.
    """

    omega: FloatArray
    moved: Mobility
    spring: ComplexArray
    ground: FloatArray
    system: ComplexArray
    of_travel: FloatArray | None = None


def straighten(unknowns: Unknowns, theta: FloatArray, index: int, prediction: Prediction) -> Straight:
    """Return a run with the mean slopes of the laws along its predicted motion."""
    omega = unknowns.runs[index].omega
    suspensions = unknowns.resting_interfaces(theta, index)
    moved = unknowns.mobility(theta, index)
    spring = np.zeros((omega.size, len(suspensions)), dtype=np.complex128)
    ground = np.array([suspension.ground_stiffness for suspension in suspensions])
    for k, suspension in enumerate(suspensions):
        assert isinstance(suspension.law, Law)  # without candidates
        z, v = prediction.travel[:, k], prediction.velocity[:, k]
        by_z, by_v = suspension.law.gradient(z, v)
        spring[:, k] = suspension.stiffness + by_z.mean() + 1j * omega * (suspension.damping + by_v.mean())
        if suspension.law.has_memory:
            stiffness, damping = _linearise_memories(suspension.law, z, v, unknowns.runs[index].fs)
            spring[:, k] += stiffness + 1j * omega * damping
    square = (omega**2)[:, np.newaxis, np.newaxis]
    # z'' = -A F - u, F = spring z + ground (z + x1), x1 = -u / omega^2
    system = moved.accelerance * (spring + ground)[:, np.newaxis, :] - square * np.eye(len(suspensions))
    return Straight(omega, moved, spring, ground, system, unknowns.body.of_travel)


def transmissibility(unknowns: Unknowns, straight: Straight) -> ComplexArray:
    """Return the acceleration of each sensor over that below each suspension, with the mean slopes of the laws.

    Returns:
        (n_lines, n_sensors, n_interfaces).
    """
    moved, ground, n = straight.moved, straight.ground, unknowns.body.n_interfaces
    square = (straight.omega**2)[:, np.newaxis, np.newaxis]
    driven = -np.eye(len(ground)) + moved.accelerance * ground / square
    travel = np.asarray(np.linalg.solve(straight.system, driven[:, :, :n]), dtype=np.complex128)
    force = (straight.spring + ground)[:, :, np.newaxis] * travel - (np.diag(ground) / square)[:, :, :n]
    read = moved.reading @ force
    if unknowns.body.of_travel is not None:
        read[:, : len(unknowns.body.of_travel)] -= unknowns.body.of_travel @ travel
    return -read[:, : len(unknowns.sensors.sprung)]


def spectral_density(process: ProcessNoise, run: DrivenRun, straight: Straight) -> ComplexArray:
    """Return the spectral density of the readings due to process noise, (n_lines, n_sensors, n_sensors)."""
    rms, omega, ground = process.acceleration_rms(run), straight.omega, straight.ground
    n = rms.size
    travel = np.linalg.solve(straight.system, np.broadcast_to(np.eye(len(ground))[:, :n], (omega.size, len(ground), n)))
    read = np.eye(len(ground))[:, :n] - straight.moved.reading @ ((straight.spring + ground)[:, :, np.newaxis] * travel)
    if straight.of_travel is not None:
        read[:, : len(straight.of_travel)] += straight.of_travel @ travel
    decay = np.exp(-2 * np.pi * process.corner_hz / run.fs)
    shape = (1 - decay**2) / np.abs(1 - decay * np.exp(-1j * omega / run.fs)) ** 2
    density = (read[:, :n] * rms**2) @ read[:, :n].conj().transpose(0, 2, 1)
    return np.asarray(shape[:, np.newaxis, np.newaxis] * density, dtype=np.complex128)


def straight_equivalent(model: Model, run: int, motion: Prediction) -> Callable[[FloatArray], FloatArray]:
    """Return a function of the vector: stiffness and damping over the mass of a run, frequency, damping ratio.

    They belong to the linear suspension whose force is nearest to that of springs, damper and law, in the mean square
    over the motion (statistical linearisation, Roberts & Spanos 1990, Random vibration and statistical linearization,
    ch. 5).

    Args:
        model: the model of one gear.
        run: index of the run.
        motion: predicted motion of that run.

    Returns:
        A function that returns (4,) 1/s^2, 1/s, Hz and 1; frequency and damping ratio are NaN for a negative stiffness.
    """
    z, v = motion.travel[:, 0], motion.velocity[:, 0]
    nearest, fs = np.linalg.pinv(np.stack([z, v], axis=1)), model.runs[run].fs
    loading = float(model.runs[run].loading[0, 0])

    @cache
    def of_law(law: Law) -> FloatArray:
        return np.asarray(nearest @ force_along(law, z, v, fs)) if law.terms else np.zeros(2)

    def of_vector(theta: FloatArray) -> FloatArray:
        here = model.resting_interfaces(theta, run)[0]
        assert isinstance(here.law, Law)  # without candidates
        straight = of_law(here.law) + np.array([here.stiffness, here.damping])
        stiffness, damping = straight / (1.0 + model.inverse_mass(theta) * loading)
        omega = float(np.sqrt(stiffness)) if stiffness > 0.0 else np.nan
        return np.array([stiffness, damping, omega / (2 * np.pi), damping / (2 * omega)])

    return of_vector


def _linearise_memories(law: Law, z: FloatArray, v: FloatArray, fs: float) -> tuple[float, float]:
    """Return the stiffness and damping whose force is nearest to that of the terms with memory along a motion."""
    columns, force = np.stack([z - z.mean(), v, np.ones_like(z)], axis=1), force_along(law.remembering, z, v, fs)
    # A memory that turns over too fast to be followed is taken as zero.
    found = np.linalg.lstsq(columns, np.where(np.isfinite(force), force, 0.0), rcond=None)[0]
    return float(found[0]), float(found[1])
