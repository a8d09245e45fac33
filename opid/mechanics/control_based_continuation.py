"""Control-based continuation on a virtual test bench: a shaker under feedback holds one sensor in phase quadrature.

The frequency is moved until the force and the sensor are 90 degrees apart, level after level (Song et al. 2021, 3.3).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.laws import FloatArray
from opid.mechanics.quadrature_curves import (
    ContinuationLevel,
    MeasuredCurve,
    Specimen,
    growing_amplitudes,
    linear_start,
    phase_error,
)
from opid.mechanics.response import State, advance, state_at
from opid.mechanics.shaker_feedback import ClosedLoop, closed_loop
from opid.mechanics.structure import ComplexArray

STEP = 2.0
"""Of the fastest pole of the closed loop, rad: Runge-Kutta 4 stays bounded below 2.8, and what is slow is exact."""

_WITHIN_NOISE = 5.0
_MOST_FAILURES = 2
_STEEPER = 4.0


@dataclass(frozen=True)
class ReadingNoise:
    """White noise, independent in each sample and channel; by default none.

    Args:
        acceleration_m_per_s2: rms of the accelerometers, m/s^2.
        force_n: rms of the force cell, N.
        control_n: rms of what the feedback's own noise adds to the force, N; it shakes the structure.

    Raises:
        InputError: a level below 0.
    """

    acceleration_m_per_s2: float = 0.0
    force_n: float = 0.0
    control_n: float = 0.0

    def __post_init__(self) -> None:
        for each in fields(self):
            if not 0.0 <= getattr(self, each.name) < np.inf:
                raise InputError(f"{each.name} of the noise is {getattr(self, each.name)}: give 0 or more")


@dataclass(frozen=True)
class ContinuationSettings:
    """Settings of the continuation.

    Args:
        n_harmonics: harmonics that are recorded and whose control is taken away, the fundamental included.
        phase_tolerance_rad: phase error from quadrature that is accepted, radians (Song et al. 2021: 5e-3).
        most_invasive: rms of the control's harmonics above the first over its first that is accepted.
        steady_share: a level has settled when no first harmonic moves by more than this share, or by more than its
            noise explains, from one block of periods to the next.
        settle_periods: periods of such a block.
        record_periods: periods that are averaged for each record.
        longest_periods: allowed for settling, for each record.
        most_records: for each level.
        amplitude_share: how far the amplitude may lie from the one asked for.
        widest_share: how far the frequency may move from level to level, share of it.
        samples_per_period: the bench is sampled in step with its drive.
        feedback_damping: damping ratio that the feedback adds to the mode. Too little, and a change of the level leaves
            the branch where resonance curves fold; too much, and the feedback stirs up other modes, which the joints
            mix with this one at large amplitudes.
        modal_filter: whether the feedback reads the mode through a filter over all sensors, or the drive point alone.
            Where the drive point moves in other modes more than in this one, its own motion can hardly hold the mode.
        proportional_n_per_m: gain on the displacement that is read, N/m; the one on its velocity follows from
            `feedback_damping`.

    Raises:
        InputError: a value out of range.
    """

    n_harmonics: int = 7
    phase_tolerance_rad: float = 5e-3
    most_invasive: float = 2e-3
    steady_share: float = 3e-4
    settle_periods: int = 10
    record_periods: int = 20
    longest_periods: int = 400
    most_records: int = 15
    amplitude_share: float = 0.02
    widest_share: float = 0.03
    samples_per_period: int = 64
    feedback_damping: float = 0.015
    modal_filter: bool = True
    proportional_n_per_m: float = 0.0

    def __post_init__(self) -> None:
        counts = ("n_harmonics", "settle_periods", "record_periods", "longest_periods", "most_records")
        for each in fields(self):
            value, positive = getattr(self, each.name), each.name != "proportional_n_per_m"
            if each.name == "modal_filter":
                continue
            whole = each.name in (*counts, "samples_per_period")
            if not 0.0 <= value < np.inf or (positive and value == 0.0) or (whole and value != int(value)):
                needed = "a whole number, 1 or more" if whole else "a positive number" if positive else "0 or more"
                raise InputError(f"{each.name} of the continuation is {value}: give {needed}")
        if self.samples_per_period < 4 * self.n_harmonics:
            raise InputError(
                f"{self.samples_per_period} samples a period for {self.n_harmonics} harmonics: give four times as many"
            )


@dataclass(frozen=True, eq=False)
class _Bench:
    """What stays the same from level to level; `watched` are the columns of the sensor and the controlled sensor."""

    loop: ClosedLoop
    settings: ContinuationSettings
    noise: ReadingNoise
    rng: np.random.Generator
    watched: tuple[int, int]


@dataclass(frozen=True, eq=False)
class _Standing:
    """Where structure and controller stand: target (n_harmonics + 1,) of the drive point, the mean first, m.

    The frequency moves by `slope_hz` for each unit of the phase error's tangent; `before` is the frequency and target
    that the structure moves at, `held` the last amplitude, m.
    """

    state: State
    frequency_hz: float
    target: ComplexArray
    slope_hz: float
    before: tuple[float, ComplexArray]
    held: float = 0.0
    periods: int = 0


@dataclass(frozen=True, eq=False)
class _Record:
    """Harmonics of the mean of some periods: force (n,), sensors (n_sensors, n), control (n + 1,), its mean first."""

    force: ComplexArray
    sensors: ComplexArray
    control: ComplexArray


def measured_curve(
    specimen: Specimen,
    *,
    mode: int,
    sensor: str,
    controlled_sensor: str,
    amplitude: ArrayLike,
    rng: np.random.Generator,
    settings: ContinuationSettings | None = None,
    noise: ReadingNoise | None = None,
) -> MeasuredCurve:
    """Return one backbone measured by control-based continuation, simulated in the time domain (Song et al. 2021, 3.3).

    The control u = p (x* - x) + d (x*' - x') holds what the feedback reads, x, near a periodic target x*, whose first
    harmonic sets the level. Each record gives the target its other harmonics, x*_h = x_h, so that the control loses
    them: what is left is a sine, and the feedback is not invasive. A secant on the tangent of the phase error, which is
    nearly straight at constant amplitude, moves the frequency until force and sensor are in quadrature. Each level
    starts from where the last one stands, at a frequency extrapolated from the last three. The amplitude of a level is
    met within a tolerance only, as on a real bench: the record says what it was.

    Args:
        specimen: the structure with its shaker.
        mode: number of the mode, from 1.
        sensor: whose quadrature is held.
        controlled_sensor: whose amplitude is stepped up.
        amplitude: (n,) of its first harmonic, m, growing; where the joints are far from linear by no more than some
            10 % a level, or the structure may leave the branch on the way.
        rng: source of the noise.
        settings: of the continuation; the usual ones where left out.
        noise: of the readings; none where left out.

    Raises:
        InputError: no such mode or sensor, amplitudes that are not positive and growing, or a mode that the drive point
            or the controlled sensor does not move in.
    """
    wanted = growing_amplitudes(amplitude)
    _, force_n = linear_start(specimen, mode, controlled_sensor)
    chosen, system = settings or ContinuationSettings(), specimen.system
    watched = system.sensor(sensor), system.sensor(controlled_sensor)
    loop = closed_loop(
        specimen,
        mode,
        damping_ratio=chosen.feedback_damping,
        proportional_n_per_m=chosen.proportional_n_per_m,
        modal_filter=chosen.modal_filter,
    )
    bench = _Bench(loop, chosen, noise or ReadingNoise(), rng, watched)
    standing, failures = _at_rest(bench, specimen, mode, force_n * wanted[0]), 0
    levels: list[ContinuationLevel] = []
    for a in wanted:
        standing = _ahead(standing, [level for level in levels if level.converged], watched[1], float(a))
        try:
            level, standing = _level(bench, standing, float(a), sensor)
        except InputError as error:
            levels.append(_lost(bench, standing, float(a), str(error)))
            break
        levels.append(level)
        failures = 0 if level.converged else failures + 1
        if failures == _MOST_FAILURES:
            break
    return MeasuredCurve(mode, sensor, controlled_sensor, system.sensors, tuple(levels))


def _at_rest(bench: _Bench, specimen: Specimen, mode: int, force_n: float) -> _Standing:
    """Before the first level: the target that makes the force of the linear mode."""
    place = specimen.system.place(mode)
    frequency = float(specimen.system.frequency_hz[place])
    omega = 2.0 * np.pi * frequency
    target = np.zeros(bench.settings.n_harmonics + 1, dtype=complex)
    # at resonance the mode lags the force by a quarter: x = -j |F| / (c omega)
    modal = float(specimen.modal_damping[place] / specimen.drive_row[place] ** 2)
    target[1] = force_n * (1.0 / (1j * omega * modal) + 1.0 / (bench.loop.gains[0] + 1j * omega * bench.loop.gains[1]))
    slope = -float(specimen.zeta[place]) * frequency
    return _Standing(state_at(bench.loop.ready), frequency, target, slope, (frequency, np.zeros_like(target)))


def _ahead(standing: _Standing, done: list[ContinuationLevel], column: int, wanted: float) -> _Standing:
    """The target for the next amplitude, and the frequency as a polynomial of the last ones, over amplitude squared."""
    if not done:
        return standing
    held = np.array([abs(level.sensors[column, 0]) for level in done[-3:]])
    frequency = np.array([level.frequency_hz for level in done[-3:]])
    target = standing.target.copy()
    target[1] *= wanted / standing.held
    others = (held[:, None] ** 2 - held**2) + np.eye(held.size)
    weights = (wanted**2 - held**2) + np.zeros((held.size, 1))
    np.fill_diagonal(weights, 1.0)
    return replace(standing, target=target, frequency_hz=float((weights / others).prod(axis=1) @ frequency))


def _level(bench: _Bench, standing: _Standing, wanted: float, sensor: str) -> tuple[ContinuationLevel, _Standing]:
    """Move target and frequency until one amplitude is held at quadrature without invasion."""
    settings, begun, target = bench.settings, standing.frequency_hz, standing.target
    points: list[tuple[float, float]] = []
    for n_records in range(1, settings.most_records + 1):
        record, standing, steady = _settled(bench, standing)
        first, held = record.sensors[:, 0], abs(record.sensors[bench.watched[1], 0])
        error = phase_error(record.force[0], first[bench.watched[0]])
        invasion = float(np.linalg.norm(np.delete(record.control, 1)) / abs(record.control[1]))
        quadrature = abs(error) <= settings.phase_tolerance_rad
        kept = invasion <= settings.most_invasive + _noise_floor(bench) / abs(record.control[1])
        near = abs(held / wanted - 1.0) <= settings.amplitude_share
        # a phase at another amplitude is a point of another curve
        points = [*(points if near else []), (standing.frequency_hz, np.tan(error))]
        if quadrature and kept and near and steady:
            break
        away = abs(standing.frequency_hz / begun - 1.0) > settings.widest_share
        if away and not quadrature:
            break
        last = n_records == settings.most_records
        standing = standing if last else _moved(bench, standing, record, points, 1.0 if near else wanted / held)
    converged = bool(quadrature and kept and near and steady)
    reason = "" if converged else _reason(bench, sensor, begun, error, invasion, held / wanted, away)
    found = points[-1][0], record.force, record.sensors, error, invasion
    level = ContinuationLevel(wanted, *found, converged, n_records, standing.periods, reason)
    standing = replace(standing, periods=0, held=held)
    # after a failure the next level starts from what this one did
    return level, standing if converged else replace(standing, held=wanted, frequency_hz=begun, target=target)


def _lost(bench: _Bench, standing: _Standing, wanted: float, text: str) -> ContinuationLevel:
    """The level at which the simulation ended."""
    n, sensors = bench.settings.n_harmonics, bench.loop.sensors
    nothing = np.full((len(sensors) + 1, n), complex(np.nan, np.nan))
    reason = f"the feedback lost the structure: {text}; or take a smaller feedback_damping"
    found = standing.frequency_hz, nothing[0], nothing[1:], np.nan, np.nan
    return ContinuationLevel(wanted, *found, False, 0, standing.periods, reason)


def _noise_floor(bench: _Bench) -> float:
    """What the feedback's own noise, which is part of the control, may add to its upper harmonics, N."""
    settings = bench.settings
    share = 2.0 * settings.n_harmonics / (settings.record_periods * settings.samples_per_period)
    return 2.0 * bench.noise.control_n * float(np.sqrt(share))


def _moved(
    bench: _Bench, standing: _Standing, record: _Record, points: list[tuple[float, float]], larger: float
) -> _Standing:
    """Target and frequency for the next record: the control's harmonics gone, a secant on the phase error's tangent."""
    settings, slope = bench.settings, standing.slope_hz
    (frequency, value), tolerance = points[-1], settings.phase_tolerance_rad
    if len(points) > 1 and abs(value - points[-2][1]) > 4.0 * tolerance:
        # points that lie close give a slope of noise: it stays within what damping can be
        found = (frequency - points[-2][0]) / (value - points[-2][1])
        slope *= float(np.clip(found / slope, 1.0 / _STEEPER, _STEEPER))
    step = float(np.clip(-slope * value, -0.01 * frequency, 0.01 * frequency))
    h = np.arange(settings.n_harmonics + 1)
    gain = bench.loop.gains[0] + 2j * np.pi * frequency * h * bench.loop.gains[1]
    off = np.divide(record.control, gain, out=np.zeros_like(record.control), where=gain != 0.0)
    # the mean stays, the fundamental is the level
    off[:2] = 0.0
    target = standing.target - off
    target[1] *= np.clip(larger, 0.2, 5.0)
    return replace(standing, frequency_hz=frequency + step, target=target)


def _settled(bench: _Bench, standing: _Standing) -> tuple[_Record, _Standing, bool]:
    """Run until the first harmonics stand, then record."""
    settings, periods, steady = bench.settings, 0, False
    last, state = None, standing.state
    # a step of the target sets the structure ringing, and near a fold it leaves the branch: there in small steps
    for share in np.arange(1, settings.settle_periods) / settings.settle_periods:
        frequency = (1.0 - share) * standing.before[0] + share * standing.frequency_hz
        target = (1.0 - share) * standing.before[1] + share * standing.target
        _, state = _periods(bench, replace(standing, frequency_hz=frequency, target=target), state, 1)
        periods += 1
    while not steady and periods < settings.longest_periods:
        record, state = _periods(bench, standing, state, settings.settle_periods)
        periods += settings.settle_periods
        steady = last is not None and _stands(bench, last, record, standing.frequency_hz)
        last = record
    record, state = _periods(bench, standing, state, settings.record_periods)
    periods += settings.record_periods
    before = standing.frequency_hz, standing.target
    return record, replace(standing, state=state, before=before, periods=standing.periods + periods), steady


def _stands(bench: _Bench, last: _Record, record: _Record, frequency_hz: float) -> bool:
    """Whether nothing that is watched has moved by more than the tolerance and the noise of two blocks explain."""
    settings = bench.settings
    of_mean = np.sqrt(4.0 / (settings.settle_periods * settings.samples_per_period)) * _WITHIN_NOISE
    watched = list(bench.watched)
    moved = np.abs(np.append(record.sensors[watched, 0] - last.sensors[watched, 0], record.force[0] - last.force[0]))
    size = np.abs(np.append(record.sensors[watched, 0], record.force[0]))
    of_motion = bench.noise.acceleration_m_per_s2 / (2.0 * np.pi * frequency_hz) ** 2
    noise = np.array([of_motion, of_motion, bench.noise.force_n + bench.noise.control_n])
    return bool((moved <= settings.steady_share * size + of_mean * noise).all())


def _periods(bench: _Bench, standing: _Standing, state: State, n_periods: int) -> tuple[_Record, State]:
    """Run whole periods of the drive, each from phase zero, and average them."""
    settings, frequency, target = bench.settings, standing.frequency_hz, standing.target
    n, omega = settings.samples_per_period, 2.0 * np.pi * frequency
    fs = n * frequency
    steps = int(np.ceil(bench.loop.fastest_rad_s / (STEP * fs)))
    p, d = bench.loop.gains
    h = np.arange(target.size)
    half_steps = np.exp(2j * np.pi / (2 * n * steps) * np.outer(np.arange(2 * n * steps), h))
    wave = (half_steps @ ((p + 1j * h * omega * d) * target)).real
    drive = np.append(np.tile(wave, n_periods), wave[0])
    if bench.noise.control_n:
        drive[:-1] += bench.noise.control_n * np.repeat(bench.rng.standard_normal(n * n_periods), 2 * steps)
    motion, after = advance(bench.loop.ready, state, drive[:, None], fs=fs, steps_per_sample=steps)

    def mean(series: FloatArray) -> FloatArray:
        return series[:-1].reshape(n_periods, n, -1).mean(axis=0)

    x, v, a = mean(motion.displacement), mean(motion.velocity), mean(motion.acceleration)
    control = mean(drive[:: 2 * steps, None])[:, 0] - p * (x @ bench.loop.reading) - d * (v @ bench.loop.reading)
    force = control if bench.loop.force is None else x @ bench.loop.force[0] + v @ bench.loop.force[1]
    # the mean over the periods has less noise than each sample
    shrunk = 1.0 / np.sqrt(n_periods)
    force = force + shrunk * bench.noise.force_n * bench.rng.standard_normal(n)
    acceleration = a @ bench.loop.sensors.T
    acceleration += shrunk * bench.noise.acceleration_m_per_s2 * bench.rng.standard_normal(acceleration.shape)
    displacement = -_harmonics(acceleration, target.size)[1:] / (h[1:, None] * omega) ** 2
    found = _harmonics(np.column_stack([force, control]), target.size)
    return _Record(found[1:, 0], displacement.T, found[:, 1]), after


def _harmonics(series: FloatArray, n_harmonics: int) -> ComplexArray:
    """(n_harmonics, n_channels) complex amplitudes of one period, the mean first."""
    found = np.fft.rfft(series, axis=0)[:n_harmonics] * (2.0 / len(series))
    found[0] *= 0.5
    return found


def _reason(
    bench: _Bench, sensor: str, begun_hz: float, error: float, invasion: float, ratio: float, away: bool
) -> str:
    """Why a level has not converged."""
    settings = bench.settings
    if away:
        return f"no quadrature at {sensor!r} within {settings.widest_share:.0%} of {begun_hz:.3f} Hz"
    if abs(error) > settings.phase_tolerance_rad:
        return f"after {settings.most_records} records {sensor!r} is still {error:.2g} rad off quadrature"
    if invasion > settings.most_invasive:
        return f"the control keeps harmonics of {invasion:.1%} of its first"
    if abs(ratio - 1.0) > settings.amplitude_share:
        return f"the amplitude stands at {ratio:.0%} of the one asked for"
    return f"the response has not settled within {settings.longest_periods} periods"
