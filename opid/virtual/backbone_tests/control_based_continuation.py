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
    find_quadrature_error,
    require_growing_amplitudes,
)
from opid.mechanics.backbones.specimen import Specimen, solve_linear_start
from opid.mechanics.response import State, state_at
from opid.mechanics.structure import ComplexArray
from opid.virtual.backbone_tests.shaker_feedback import (
    ClosedLoop,
    ReadingNoise,
    Record,
    close_loop,
    compute_phase_noise,
    record_periods,
)

_WITHIN_NOISE = 5.0
_MOST_FAILURES = 2
_STEEPER = 4.0
# number of levels after which it is known whether a mode hardens
_N_BEFORE_STIFFENING = 2
# distance of two phases below which they give no slope, rad, as the response still moves a little
_CLOSE_PHASES = 2e-3


@dataclass(frozen=True)
class ContinuationSettings:
    """Settings of the continuation.

    Args:
        n_harmonics: harmonics that are recorded and whose control is removed, the fundamental included.
        phase_tolerance_rad: largest phase error from quadrature that is accepted, radians (Song et al. 2021: 5e-3).
        frequency_fraction: fraction by which the frequency may still have to move to quadrature. Where a sensor is
            about to lose quadrature, 5e-3 rad are 2e-4 of the frequency.
        most_invasive: largest rms of the control's harmonics above the first, over its first, that is accepted.
        steady_fraction: fraction by which first harmonics may move from one block of periods to the next at a steady
            level, beyond the movement that their noise explains.
        settle_periods: periods of such a block.
        record_periods: periods that are averaged for each record; more where the noise would hide `frequency_fraction`.
        longest_periods: largest number of periods for settling, and for averaging, of each record.
        most_records: largest number of records for each level.
        amplitude_fraction: fraction by which the amplitude may differ from the wanted one.
        widest_fraction: fraction by which the frequency may move from level to level.
        samples_per_period: samples in a period, as the bench is sampled in step with its drive.
        feedback_damping: damping ratio that the feedback adds to the mode. If it is too small, a change of the level
            leaves the branch where resonance curves fold; if it is too large, the feedback excites other modes, which
            the joints mix with this one at large amplitudes.
        feedback_stiffness: fraction of its frequency by which the feedback stiffens a mode that hardens, or softens one
            that softens, as its first two levels show. Without it the structure leaves the branch where a sensor
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
                f"samples_per_period is {self.samples_per_period} for {self.n_harmonics} harmonics: give at least "
                f"{4 * self.n_harmonics}, four for each harmonic"
            )


@dataclass(frozen=True, eq=False)
class _Bench:
    """The parts that all levels have in common; `watched` are the columns of the sensor and the controlled sensor."""

    loop: ClosedLoop
    settings: ContinuationSettings
    noise: ReadingNoise
    rng: np.random.Generator
    watched: tuple[int, int]


@dataclass(frozen=True, eq=False)
class _BenchState:
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

    The control u = p (x* - x) + d (x*' - x') holds the reading of the feedback, x, near a periodic target x*, whose
    first harmonic sets the level. Each record gives the target its other harmonics, x*_h = x_h, so that the control
    loses them: a sine remains, and the feedback is not invasive. A secant on the tangent of the phase error, which is
    nearly straight at constant amplitude, moves the frequency until force and sensor are in quadrature. Each level
    starts from the state of the last one, at a frequency extrapolated from the last three. The amplitude of a level is
    only met within a tolerance, as on a real bench: the record holds its value.

    Args:
        specimen: the structure with its shaker.
        mode: number of the mode, from 1.
        sensor: the sensor whose quadrature is held.
        controlled_sensor: the sensor whose amplitude grows from level to level.
        amplitude: (n,) growing amplitudes of its first harmonic, m; where the joints are far from linear, steps of no
            more than some 10 %, or the structure may leave the branch.
        rng: source of the noise.
        settings: settings of the continuation; the usual ones where left out.
        noise: noise of the readings; none where left out.

    Raises:
        InputError: no such mode or sensor, amplitudes that are not positive and growing, or a mode in which the drive
            point or the controlled sensor does not move.
    """
    wanted = require_growing_amplitudes(amplitude)
    _, force_n = solve_linear_start(specimen, mode, controlled_sensor)
    chosen, system = settings or ContinuationSettings(), specimen.system
    watched = system.sensor(sensor), system.sensor(controlled_sensor)

    def close_at(stiffness_fraction: float) -> ClosedLoop:
        damping, filtered = chosen.feedback_damping, chosen.modal_filter
        return close_loop(
            specimen, mode, damping_ratio=damping, stiffness_fraction=stiffness_fraction, modal_filter=filtered
        )

    bench = _Bench(close_at(0.0), chosen, noise or ReadingNoise(), rng, watched)
    current, failures = _prepare_start(bench, specimen, mode, force_n * wanted[0]), 0
    levels: list[ContinuationLevel] = []
    for a in wanted:
        current = _extrapolate(current, float(a))
        try:
            level, current = _measure_level(bench, current, float(a), sensor)
        except InputError as error:
            levels.append(_describe_lost_level(bench, current, str(error)))
            break
        levels.append(level)
        if level.converged and len(current.done) == _N_BEFORE_STIFFENING:
            hardens = current.done[-1][1] > current.done[0][1]
            bench, current = _renew_loop(bench, current, close_at((1 if hardens else -1) * chosen.feedback_stiffness))
        failures = 0 if level.converged else failures + 1
        if failures == _MOST_FAILURES:
            break
    return MeasuredCurve(mode, sensor, controlled_sensor, system.sensors, tuple(levels))


def _prepare_start(bench: _Bench, specimen: Specimen, mode: int, force_n: float) -> _BenchState:
    """Return the state before the first level, with the target that makes the force of the linear mode."""
    column = specimen.system.index(mode)
    frequency = float(specimen.system.frequency_hz[column])
    omega = 2.0 * np.pi * frequency
    target = np.zeros(bench.settings.n_harmonics + 1, dtype=complex)
    # At resonance the mode lags behind the force by a quarter of a period: x = -j |F| / (c omega).
    modal = float(specimen.modal_damping[column] / specimen.drive_row[column] ** 2)
    target[1] = force_n * (1.0 / (1j * omega * modal) + 1.0 / (bench.loop.gains[0] + 1j * omega * bench.loop.gains[1]))
    slope = -float(specimen.zeta[column]) * frequency
    still = frequency, np.zeros_like(target)
    return _BenchState(state_at(bench.loop.ready), frequency, target, slope, still, bench.settings.record_periods)


def _renew_loop(bench: _Bench, current: _BenchState, loop: ClosedLoop) -> tuple[_Bench, _BenchState]:
    """Change the feedback so that the motion of the structure stays the same."""
    omega = 2.0 * np.pi * current.frequency_hz
    before, after = (p + 1j * omega * d for p, d in (bench.loop.gains, loop.gains))
    target = current.target.copy()
    # Only the fundamental of the control is left, so that no other harmonic changes.
    target[1] += current.control_n * (1.0 / after - 1.0 / before)
    still = current.frequency_hz, target
    return replace(bench, loop=loop), replace(current, target=target, before=still)


def _extrapolate(current: _BenchState, wanted: float) -> _BenchState:
    """Set frequency and target for the next amplitude, by polynomials of the last ones over amplitude squared."""
    if not current.done:
        return current
    held = np.array([level[0] for level in current.done])
    others = (held[:, None] ** 2 - held**2) + np.eye(held.size)
    apart = (wanted**2 - held**2) + np.zeros((held.size, 1))
    np.fill_diagonal(apart, 1.0)
    weights = (apart / others).prod(axis=1)
    frequency = float(weights @ np.array([level[1] for level in current.done]))
    target = wanted * (weights / held) @ np.stack([level[2] for level in current.done])
    # The level itself must not depend on the noise of three levels.
    target[1] = current.target[1] * wanted / current.held
    return replace(current, target=target, frequency_hz=frequency)


def _measure_level(
    bench: _Bench, current: _BenchState, wanted: float, sensor: str
) -> tuple[ContinuationLevel, _BenchState]:
    """Move target and frequency until one amplitude is held at quadrature without invasion."""
    settings, begun, before = bench.settings, current.frequency_hz, current
    points: list[tuple[float, float]] = []
    for n_records in range(1, settings.most_records + 1):
        record, current, steady = _run_until_steady(bench, current)
        frequency, held = current.frequency_hz, abs(record.sensors[bench.watched[1], 0])
        error = find_quadrature_error(record.force[0], record.sensors[bench.watched[0], 0])
        invasion = float(np.linalg.norm(np.delete(record.control, 1)) / abs(record.control[1]))
        points.append((frequency, float(np.tan(error))))
        current, off = _judge_record(bench, current, record, points, before.slope_hz)
        quadrature = abs(error) <= settings.phase_tolerance_rad and off <= settings.frequency_fraction
        kept = invasion <= settings.most_invasive + _find_noise_floor(bench) / abs(record.control[1])
        near = abs(held / wanted - 1.0) <= settings.amplitude_fraction
        if quadrature and kept and near and steady:
            break
        away = abs(frequency / begun - 1.0) > settings.widest_fraction
        if away and not quadrature:
            break
        if n_records < settings.most_records:
            current = _move_frequency(bench, current, record, points[-1][1], 1.0 if near else wanted / held)
        # Phases at different amplitudes belong to different curves.
        points = points if near else []
    converged = bool(quadrature and kept and near and steady)
    reason = "" if converged else _give_reason(bench, sensor, begun, error, off, invasion, held / wanted, away)
    found = frequency, record.force, record.sensors, error, invasion
    level = ContinuationLevel(*found, converged, n_records, current.periods, reason)
    if converged:
        done = (*current.done[-2:], (held, frequency, current.target))
        return level, replace(current, periods=0, held=held, done=done, control_n=complex(record.control[1]))
    # The next level starts like this one.
    again = replace(current, frequency_hz=begun, target=before.target, slope_hz=before.slope_hz)
    return level, replace(again, periods=0, held=wanted)


def _describe_lost_level(bench: _Bench, current: _BenchState, text: str) -> ContinuationLevel:
    """Return the level at which the simulation failed."""
    n, sensors = bench.settings.n_harmonics, bench.loop.sensors
    nothing = np.full((len(sensors) + 1, n), complex(np.nan, np.nan))
    reason = f"the feedback no longer holds the structure: {text}; or take a smaller feedback_damping"
    found = current.frequency_hz, nothing[0], nothing[1:], np.nan, np.nan
    return ContinuationLevel(*found, False, 0, current.periods, reason)


def _find_noise_floor(bench: _Bench) -> float:
    """Return the upper harmonics of the control that the noise of the feedback may explain, N."""
    settings = bench.settings
    fraction = 2.0 * settings.n_harmonics / (settings.record_periods * settings.samples_per_period)
    return 2.0 * bench.noise.control_n * float(np.sqrt(fraction))


def _judge_record(
    bench: _Bench, current: _BenchState, record: Record, points: list[tuple[float, float]], usual_hz: float
) -> tuple[_BenchState, float]:
    """Set slope and periods for the next record by the last two points; return the frequency's relative error, too."""
    settings, slope, (frequency, value) = bench.settings, current.slope_hz, points[-1]
    spread = compute_phase_noise(record, bench.watched[0], bench.noise, frequency, settings.samples_per_period)
    if len(points) > 1 and abs(value - points[-2][1]) > max(_CLOSE_PHASES, _WITHIN_NOISE * spread):
        found = (frequency - points[-2][0]) / (value - points[-2][1])
        # Two points give a wrong slope while harmonics still change, so it is kept near that of the last level.
        slope = usual_hz * float(np.clip(found / usual_hz, 1.0 / _STEEPER, _STEEPER))
    steep = abs(slope) / frequency
    # With this number of periods the noise of the frequency is half of the accepted error.
    longer = (2.0 * steep * spread / settings.frequency_fraction) ** 2 * record.n_periods
    averaged = int(np.clip(np.ceil(longer), settings.record_periods, settings.longest_periods))
    # A record that is long enough may be off by its noise.
    explained = 2.0 * spread if record.n_periods >= averaged else 0.0
    return replace(current, slope_hz=slope, averaged=averaged), steep * max(abs(value) - explained, 0.0)


def _move_frequency(bench: _Bench, current: _BenchState, record: Record, value: float, larger: float) -> _BenchState:
    """Set target and frequency for the next record, without the control's harmonics, by a secant on the phase error."""
    frequency = current.frequency_hz
    step = float(np.clip(-current.slope_hz * value, -0.01 * frequency, 0.01 * frequency))
    h = np.arange(bench.settings.n_harmonics + 1)
    gain = bench.loop.gains[0] + 2j * np.pi * frequency * h * bench.loop.gains[1]
    off = np.divide(record.control, gain, out=np.zeros_like(record.control), where=gain != 0.0)
    # The mean of the target stays, and its fundamental sets the level.
    off[:2] = 0.0
    target = current.target - off
    target[1] *= np.clip(larger, 0.2, 5.0)
    return replace(current, frequency_hz=frequency + step, target=target)


def _run_until_steady(bench: _Bench, current: _BenchState) -> tuple[Record, _BenchState, bool]:
    """Run until the first harmonics are steady, then record."""
    settings, periods, steady = bench.settings, 0, False
    last, state = None, current.state
    # A large step of the target would excite free vibrations, and the structure might leave the branch near a fold.
    for fraction in np.arange(1, settings.settle_periods) / settings.settle_periods:
        frequency = (1.0 - fraction) * current.before[0] + fraction * current.frequency_hz
        target = (1.0 - fraction) * current.before[1] + fraction * current.target
        _, state = _drive_periods(bench, replace(current, frequency_hz=frequency, target=target), state, 1)
        periods += 1
    while not steady and periods < settings.longest_periods:
        record, state = _drive_periods(bench, current, state, settings.settle_periods)
        periods += settings.settle_periods
        steady = last is not None and _is_steady(bench, last, record, current.frequency_hz)
        last = record
    record, state = _drive_periods(bench, current, state, current.averaged)
    periods += current.averaged
    before = current.frequency_hz, current.target
    return record, replace(current, state=state, before=before, periods=current.periods + periods), steady


def _is_steady(bench: _Bench, last: Record, record: Record, frequency_hz: float) -> bool:
    """Return whether no watched harmonic has moved by more than the tolerance and the noise of two blocks."""
    settings = bench.settings
    of_mean = np.sqrt(4.0 / (settings.settle_periods * settings.samples_per_period)) * _WITHIN_NOISE
    watched = list(bench.watched)
    moved = np.abs(np.append(record.sensors[watched, 0] - last.sensors[watched, 0], record.force[0] - last.force[0]))
    size = np.abs(np.append(record.sensors[watched, 0], record.force[0]))
    of_motion = bench.noise.acceleration_m_per_s2 / (2.0 * np.pi * frequency_hz) ** 2
    noise = np.array([of_motion, of_motion, bench.noise.force_n + bench.noise.control_n])
    return bool((moved <= settings.steady_fraction * size + of_mean * noise).all())


def _drive_periods(bench: _Bench, current: _BenchState, state: State, n_periods: int) -> tuple[Record, State]:
    return record_periods(
        bench.loop,
        state,
        current.target,
        frequency_hz=current.frequency_hz,
        n_periods=n_periods,
        samples_per_period=bench.settings.samples_per_period,
        noise=bench.noise,
        rng=bench.rng,
    )


def _give_reason(
    bench: _Bench, sensor: str, begun_hz: float, error: float, off: float, invasion: float, ratio: float, away: bool
) -> str:
    settings = bench.settings
    if away:
        return f"{sensor!r} does not reach quadrature within {settings.widest_fraction:.0%} of {begun_hz:.3f} Hz"
    if abs(error) > settings.phase_tolerance_rad:
        return f"after {settings.most_records} records {sensor!r} is still {error:.2g} rad off quadrature"
    if off > settings.frequency_fraction:
        return f"after {settings.most_records} records the frequency is still off quadrature by {off:.1g} of itself"
    if invasion > settings.most_invasive:
        return f"the higher harmonics of the control stay at {invasion:.1%} of its first"
    if abs(ratio - 1.0) > settings.amplitude_fraction:
        return f"the amplitude stays at {ratio:.0%} of the wanted one"
    return f"the response is not steady within {settings.longest_periods} periods"
