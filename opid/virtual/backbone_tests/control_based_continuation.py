"""Control-based continuation on a virtual test bench: a shaker under feedback holds one sensor in phase quadrature.

The frequency is moved until the force and the sensor are 90 degrees apart, level after level (Song et al. 2021, 3.3).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.backbones.quadrature_curves import (
    ContinuationLevel,
    MeasuredCurve,
    Specimen,
    growing_amplitudes,
    linear_start,
    phase_error,
)
from opid.mechanics.response import State, state_at
from opid.mechanics.structure import ComplexArray
from opid.virtual.backbone_tests.shaker_feedback import (
    ClosedLoop,
    ReadingNoise,
    Record,
    closed_loop,
    phase_noise,
    record_periods,
)

_WITHIN_NOISE = 5.0
_MOST_FAILURES = 2
_STEEPER = 4.0
# levels that tell whether a mode hardens
_N_TO_TELL = 2
# phases that are closer than this, rad, give no slope, as the response still moves a little
_CLOSE_PHASES = 2e-3


@dataclass(frozen=True)
class ContinuationSettings:
    """Settings of the continuation.

    Args:
        n_harmonics: harmonics that are recorded and whose control is taken away, the fundamental included.
        phase_tolerance_rad: phase error from quadrature that is accepted, radians (Song et al. 2021: 5e-3).
        frequency_fraction: of itself by which the frequency may still have to move to quadrature. Where a sensor is
            about to lose quadrature, 5e-3 rad are 2e-4 of the frequency.
        most_invasive: rms of the control's harmonics above the first over its first that is accepted.
        steady_fraction: a level is steady when no first harmonic moves by more than this fraction, or by more than
            its noise explains, from one block of periods to the next.
        settle_periods: periods of such a block.
        record_periods: periods that are averaged for each record; more where the noise would hide `frequency_fraction`.
        longest_periods: allowed for settling, and for averaging, for each record.
        most_records: for each level.
        amplitude_fraction: how far the amplitude may lie from the one asked for.
        widest_fraction: of itself by which the frequency may move from level to level.
        samples_per_period: the bench is sampled in step with its drive.
        feedback_damping: damping ratio that the feedback adds to the mode. Too little, and a change of the level leaves
            the branch where resonance curves fold; too much, and the feedback stirs up other modes, which the joints
            mix with this one at large amplitudes.
        feedback_stiffness: fraction of its frequency by which the feedback stiffens a mode that hardens, or softens one
            that softens, as its first two levels tell. Without it the structure leaves the branch where a sensor
            reaches quadrature beyond the resonance.
        modal_filter: whether the feedback reads the mode through a filter over all sensors, or the drive point alone.
            Where the drive point moves in other modes more than in this one, its own motion can hardly hold the mode.

    Raises:
        InputError: a value out of range.
    """

    n_harmonics: int = 7
    phase_tolerance_rad: float = 5e-3
    frequency_fraction: float = 1e-5
    most_invasive: float = 2e-3
    steady_fraction: float = 3e-4
    settle_periods: int = 10
    record_periods: int = 20
    longest_periods: int = 400
    most_records: int = 15
    amplitude_fraction: float = 0.02
    widest_fraction: float = 0.03
    samples_per_period: int = 64
    feedback_damping: float = 0.008
    feedback_stiffness: float = 0.003
    modal_filter: bool = True

    def __post_init__(self) -> None:
        counts = ("n_harmonics", "settle_periods", "record_periods", "longest_periods", "most_records")
        for each in fields(self):
            value, positive = getattr(self, each.name), each.name != "feedback_stiffness"
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
    """What all levels have in common; `watched` are the columns of the sensor and of the controlled sensor."""

    loop: ClosedLoop
    settings: ContinuationSettings
    noise: ReadingNoise
    rng: np.random.Generator
    watched: tuple[int, int]


@dataclass(frozen=True, eq=False)
class _Standing:
    """The state of structure and controller. `target`, (n_harmonics + 1,) m, has its mean first.

    The frequency moves by `slope_hz` for each unit of the phase error's tangent. `before` is the frequency and the
    target at which the structure moves, `control_n` the control of the last level, `held` its amplitude in m,
    `averaged` the periods of a record, `done` amplitude, frequency and target of the last levels that converged.
    """

    state: State
    frequency_hz: float
    target: ComplexArray
    slope_hz: float
    before: tuple[float, ComplexArray]
    averaged: int
    control_n: complex = 0.0
    held: float = 0.0
    periods: int = 0
    done: tuple[tuple[float, float, ComplexArray], ...] = ()


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

    def loop(stiffness_fraction: float) -> ClosedLoop:
        damping, filtered = chosen.feedback_damping, chosen.modal_filter
        return closed_loop(
            specimen, mode, damping_ratio=damping, stiffness_fraction=stiffness_fraction, modal_filter=filtered
        )

    bench = _Bench(loop(0.0), chosen, noise or ReadingNoise(), rng, watched)
    standing, failures = _at_rest(bench, specimen, mode, force_n * wanted[0]), 0
    levels: list[ContinuationLevel] = []
    for a in wanted:
        standing = _ahead(standing, float(a))
        try:
            level, standing = _level(bench, standing, float(a), sensor)
        except InputError as error:
            levels.append(_lost(bench, standing, float(a), str(error)))
            break
        levels.append(level)
        if level.converged and len(standing.done) == _N_TO_TELL:
            hardens = standing.done[-1][1] > standing.done[0][1]
            bench, standing = _renew_loop(bench, standing, loop((1 if hardens else -1) * chosen.feedback_stiffness))
        failures = 0 if level.converged else failures + 1
        if failures == _MOST_FAILURES:
            break
    return MeasuredCurve(mode, sensor, controlled_sensor, system.sensors, tuple(levels))


def _at_rest(bench: _Bench, specimen: Specimen, mode: int, force_n: float) -> _Standing:
    """The state before the first level, with the target that makes the force of the linear mode."""
    column = specimen.system.index(mode)
    frequency = float(specimen.system.frequency_hz[column])
    omega = 2.0 * np.pi * frequency
    target = np.zeros(bench.settings.n_harmonics + 1, dtype=complex)
    # at resonance the mode lags the force by a quarter: x = -j |F| / (c omega)
    modal = float(specimen.modal_damping[column] / specimen.drive_row[column] ** 2)
    target[1] = force_n * (1.0 / (1j * omega * modal) + 1.0 / (bench.loop.gains[0] + 1j * omega * bench.loop.gains[1]))
    slope = -float(specimen.zeta[column]) * frequency
    still = frequency, np.zeros_like(target)
    return _Standing(state_at(bench.loop.ready), frequency, target, slope, still, bench.settings.record_periods)


def _renew_loop(bench: _Bench, standing: _Standing, loop: ClosedLoop) -> tuple[_Bench, _Standing]:
    """Change the feedback so that the motion of the structure stays the same."""
    omega = 2.0 * np.pi * standing.frequency_hz
    before, after = (p + 1j * omega * d for p, d in (bench.loop.gains, loop.gains))
    target = standing.target.copy()
    # only the fundamental of the control is left, so that no other harmonic changes
    target[1] += standing.control_n * (1.0 / after - 1.0 / before)
    still = standing.frequency_hz, target
    return replace(bench, loop=loop), replace(standing, target=target, before=still)


def _ahead(standing: _Standing, wanted: float) -> _Standing:
    """Frequency and target for the next amplitude, as polynomials of the last ones over amplitude squared."""
    if not standing.done:
        return standing
    held = np.array([level[0] for level in standing.done])
    others = (held[:, None] ** 2 - held**2) + np.eye(held.size)
    apart = (wanted**2 - held**2) + np.zeros((held.size, 1))
    np.fill_diagonal(apart, 1.0)
    weights = (apart / others).prod(axis=1)
    frequency = float(weights @ np.array([level[1] for level in standing.done]))
    target = wanted * (weights / held) @ np.stack([level[2] for level in standing.done])
    # the level itself must not depend on the noise of three levels
    target[1] = standing.target[1] * wanted / standing.held
    return replace(standing, target=target, frequency_hz=frequency)


def _level(bench: _Bench, standing: _Standing, wanted: float, sensor: str) -> tuple[ContinuationLevel, _Standing]:
    """Move target and frequency until one amplitude is held at quadrature without invasion."""
    settings, begun, before = bench.settings, standing.frequency_hz, standing
    points: list[tuple[float, float]] = []
    for n_records in range(1, settings.most_records + 1):
        record, standing, steady = _run_until_steady(bench, standing)
        frequency, held = standing.frequency_hz, abs(record.sensors[bench.watched[1], 0])
        error = phase_error(record.force[0], record.sensors[bench.watched[0], 0])
        invasion = float(np.linalg.norm(np.delete(record.control, 1)) / abs(record.control[1]))
        points.append((frequency, float(np.tan(error))))
        standing, off = _judge_record(bench, standing, record, points, before.slope_hz)
        quadrature = abs(error) <= settings.phase_tolerance_rad and off <= settings.frequency_fraction
        kept = invasion <= settings.most_invasive + _noise_floor(bench) / abs(record.control[1])
        near = abs(held / wanted - 1.0) <= settings.amplitude_fraction
        if quadrature and kept and near and steady:
            break
        away = abs(frequency / begun - 1.0) > settings.widest_fraction
        if away and not quadrature:
            break
        if n_records < settings.most_records:
            standing = _move_frequency(bench, standing, record, points[-1][1], 1.0 if near else wanted / held)
        # phases at different amplitudes belong to different curves
        points = points if near else []
    converged = bool(quadrature and kept and near and steady)
    reason = "" if converged else _reason(bench, sensor, begun, error, off, invasion, held / wanted, away)
    found = frequency, record.force, record.sensors, error, invasion
    level = ContinuationLevel(wanted, *found, converged, n_records, standing.periods, reason)
    if converged:
        done = (*standing.done[-2:], (held, frequency, standing.target))
        return level, replace(standing, periods=0, held=held, done=done, control_n=complex(record.control[1]))
    # the next level starts like this one
    again = replace(standing, frequency_hz=begun, target=before.target, slope_hz=before.slope_hz)
    return level, replace(again, periods=0, held=wanted)


def _lost(bench: _Bench, standing: _Standing, wanted: float, text: str) -> ContinuationLevel:
    """The level at which the simulation failed."""
    n, sensors = bench.settings.n_harmonics, bench.loop.sensors
    nothing = np.full((len(sensors) + 1, n), complex(np.nan, np.nan))
    reason = f"the feedback lost the structure: {text}; or take a smaller feedback_damping"
    found = standing.frequency_hz, nothing[0], nothing[1:], np.nan, np.nan
    return ContinuationLevel(wanted, *found, False, 0, standing.periods, reason)


def _noise_floor(bench: _Bench) -> float:
    """The upper harmonics that the noise of the feedback, which is part of the control, may have, N."""
    settings = bench.settings
    fraction = 2.0 * settings.n_harmonics / (settings.record_periods * settings.samples_per_period)
    return 2.0 * bench.noise.control_n * float(np.sqrt(fraction))


def _judge_record(
    bench: _Bench, standing: _Standing, record: Record, points: list[tuple[float, float]], usual_hz: float
) -> tuple[_Standing, float]:
    """The slope by the last two points and the periods for the next record; and the relative error of the frequency."""
    settings, slope, (frequency, value) = bench.settings, standing.slope_hz, points[-1]
    spread = phase_noise(record, bench.watched[0], bench.noise, frequency, settings.samples_per_period)
    if len(points) > 1 and abs(value - points[-2][1]) > max(_CLOSE_PHASES, _WITHIN_NOISE * spread):
        found = (frequency - points[-2][0]) / (value - points[-2][1])
        # two points give a wrong slope while harmonics still change, so that it is kept near that of the last level
        slope = usual_hz * float(np.clip(found / usual_hz, 1.0 / _STEEPER, _STEEPER))
    steep = abs(slope) / frequency
    # as many periods as make the noise of the frequency half of what is accepted
    longer = (2.0 * steep * spread / settings.frequency_fraction) ** 2 * record.n_periods
    averaged = int(np.clip(np.ceil(longer), settings.record_periods, settings.longest_periods))
    # a record that is long enough may be off by its noise
    explained = 2.0 * spread if record.n_periods >= averaged else 0.0
    return replace(standing, slope_hz=slope, averaged=averaged), steep * max(abs(value) - explained, 0.0)


def _move_frequency(bench: _Bench, standing: _Standing, record: Record, value: float, larger: float) -> _Standing:
    """Target and frequency for the next record: the control's harmonics gone, a secant on the phase error's tangent."""
    frequency = standing.frequency_hz
    step = float(np.clip(-standing.slope_hz * value, -0.01 * frequency, 0.01 * frequency))
    h = np.arange(bench.settings.n_harmonics + 1)
    gain = bench.loop.gains[0] + 2j * np.pi * frequency * h * bench.loop.gains[1]
    off = np.divide(record.control, gain, out=np.zeros_like(record.control), where=gain != 0.0)
    # the mean stays, the fundamental is the level
    off[:2] = 0.0
    target = standing.target - off
    target[1] *= np.clip(larger, 0.2, 5.0)
    return replace(standing, frequency_hz=frequency + step, target=target)


def _run_until_steady(bench: _Bench, standing: _Standing) -> tuple[Record, _Standing, bool]:
    """Run until the first harmonics are steady, then record."""
    settings, periods, steady = bench.settings, 0, False
    last, state = None, standing.state
    # a large step of the target would set the structure ringing, and it might leave the branch near a fold
    for fraction in np.arange(1, settings.settle_periods) / settings.settle_periods:
        frequency = (1.0 - fraction) * standing.before[0] + fraction * standing.frequency_hz
        target = (1.0 - fraction) * standing.before[1] + fraction * standing.target
        _, state = _periods(bench, replace(standing, frequency_hz=frequency, target=target), state, 1)
        periods += 1
    while not steady and periods < settings.longest_periods:
        record, state = _periods(bench, standing, state, settings.settle_periods)
        periods += settings.settle_periods
        steady = last is not None and _stands(bench, last, record, standing.frequency_hz)
        last = record
    record, state = _periods(bench, standing, state, standing.averaged)
    periods += standing.averaged
    before = standing.frequency_hz, standing.target
    return record, replace(standing, state=state, before=before, periods=standing.periods + periods), steady


def _stands(bench: _Bench, last: Record, record: Record, frequency_hz: float) -> bool:
    """Whether no watched harmonic has moved by more than the tolerance and the noise of two blocks."""
    settings = bench.settings
    of_mean = np.sqrt(4.0 / (settings.settle_periods * settings.samples_per_period)) * _WITHIN_NOISE
    watched = list(bench.watched)
    moved = np.abs(np.append(record.sensors[watched, 0] - last.sensors[watched, 0], record.force[0] - last.force[0]))
    size = np.abs(np.append(record.sensors[watched, 0], record.force[0]))
    of_motion = bench.noise.acceleration_m_per_s2 / (2.0 * np.pi * frequency_hz) ** 2
    noise = np.array([of_motion, of_motion, bench.noise.force_n + bench.noise.control_n])
    return bool((moved <= settings.steady_fraction * size + of_mean * noise).all())


def _periods(bench: _Bench, standing: _Standing, state: State, n_periods: int) -> tuple[Record, State]:
    return record_periods(
        bench.loop,
        state,
        standing.target,
        frequency_hz=standing.frequency_hz,
        n_periods=n_periods,
        samples_per_period=bench.settings.samples_per_period,
        noise=bench.noise,
        rng=bench.rng,
    )


def _reason(
    bench: _Bench, sensor: str, begun_hz: float, error: float, off: float, invasion: float, ratio: float, away: bool
) -> str:
    settings = bench.settings
    if away:
        return f"no quadrature at {sensor!r} within {settings.widest_fraction:.0%} of {begun_hz:.3f} Hz"
    if abs(error) > settings.phase_tolerance_rad:
        return f"after {settings.most_records} records {sensor!r} is still {error:.2g} rad off quadrature"
    if off > settings.frequency_fraction:
        return f"after {settings.most_records} records the frequency still moves by {off:.1g} of it to quadrature"
    if invasion > settings.most_invasive:
        return f"the control keeps harmonics of {invasion:.1%} of its first"
    if abs(ratio - 1.0) > settings.amplitude_fraction:
        return f"the amplitude stands at {ratio:.0%} of the one asked for"
    return f"the response is not steady within {settings.longest_periods} periods"
