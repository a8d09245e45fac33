"""Steady levels of a measured resonance test: where they lie in a log, and the harmonics of each of them.

A level is steady where amplitude and frequency of the mode do not drift beyond their noise. In it, and in short blocks
of the transients between levels, every channel is fitted by harmonics whose fundamental may grow or decay,

    x(t) = Re (X_1 + X_1' (t - t_0) + ...) exp(j omega t) + sum_h Re X_h exp(j h omega t) + mean.

With the pole p = j omega + a'/a of the modal acceleration, q = a / p^2 exactly for an exponential, and the equation of
the mode reads f_q p^2 / a = p^2 + c p + k: a level that still drifts, or that is off quadrature, is no less exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.structure import ComplexArray
from opid.modal.linear.modes import ModalTest, modal_filter, weigh_sensors, weighted_shapes, with_sensors
from opid.modal.resonance.appropriation import AppropriationLevel
from opid.modal.resonance.phase_lock import N_HARMONICS, find_resonance_error
from opid.modal.resonance.settings import ResonanceSettings
from opid.signals.recording import FloatArray

HANN_VARIANCE = 1.0 / 12.0 - 1.0 / (2.0 * np.pi**2)  # of the time under a Hann window, over the square of its length


@dataclass(frozen=True, eq=False)
class SteadyState:
    """A motion of the mode at one frequency, by which its equation is known at one amplitude.

    Args:
        source: name of the test or of the response curve.
        pole: p = a'/a + j omega of the modal acceleration, 1/s.
        force: fundamental of the modal force, N/kg^1/2.
        displacement: (n_harmonics,) harmonics of the modal displacement, m kg^1/2; the fundamental alone where no
            others were measured.
        force_error: standard deviation of real and imaginary part of the force, over its size.
        motion_error: the same of the motion.
        pole_std: standard deviation of real and imaginary part of the pole, 1/s.
        spread: variance of the amplitude over the window in which it was measured, over its square.
        outside: rms of the motion at the fundamental that no shape makes, over that of the sensors, beyond the noise;
            strains are weighted as in the modal filter.
    """

    source: str
    pole: complex
    force: complex
    displacement: ComplexArray
    force_error: float
    motion_error: float
    pole_std: float
    spread: float = 0.0
    outside: float = 0.0

    @property
    def amplitude(self) -> float:
        """Amplitude of the modal displacement, m kg^1/2."""
        return float(np.abs(self.displacement[0]))

    @property
    def frequency_hz(self) -> float:
        """Frequency of the motion, Hz."""
        return self.pole.imag / (2.0 * np.pi)

    @property
    def receptance_inverse(self) -> complex:
        """Modal force over modal displacement, 1/s^2."""
        return complex(self.force / self.displacement[0])

    @property
    def stiffness(self) -> float:
        """k at this amplitude, 1/s^2."""
        return (self.receptance_inverse - self.pole**2).real - self.damping * self.pole.real

    @property
    def damping(self) -> float:
        """c at this amplitude, 1/s."""
        return (self.receptance_inverse - self.pole**2).imag / self.pole.imag

    @property
    def phase_error_deg(self) -> float:
        """Phase of the modal acceleration over the modal force, less 90 degrees."""
        return float(np.degrees(find_resonance_error(self.displacement[0] * self.pole**2, self.force)))


@dataclass(frozen=True, eq=False)
class MeasuredLevel:
    """One stretch of a log.

    Args:
        start_s: where it begins, s from the first sample.
        stop_s: where it ends, s.
        level: its harmonics.
        state: what it says of the equation of the mode.
        is_steady: whether amplitude and frequency stand still in it; otherwise it is a block of a transient.
        fault: why the level does not count, "" if it does.
        is_clipped: whether a sensor is clipped in it.
    """

    start_s: float
    stop_s: float
    level: AppropriationLevel
    state: SteadyState
    is_steady: bool
    fault: str
    is_clipped: bool


def measure_levels(test: ModalTest, mode: int, settings: ResonanceSettings) -> tuple[MeasuredLevel, ...]:
    """Return the steady levels of a log in their order, and blocks of the transients between them.

    Args:
        test: a log with a force, of one level or of several.
        mode: number of the mode that was held, from 1.
        settings: where a level is steady.
    """
    stretches = list(_list_stretches(test, mode, settings))
    steady = [each for each in stretches if each[2]]
    done = []
    for begin, end, is_steady in stretches:
        since = begin - max((each[1] for each in steady if each[1] <= begin), default=0)
        done.append(_measure_stretch(test, mode, (begin, end), since / test.fs, is_steady, settings))
    return tuple(done)


def _list_voltages(test: ModalTest) -> list[str]:
    """Return the names of the channels in volts, of which the first one is that of the shaker."""
    return [channel.name for channel in test.recording.channels if channel.unit == "V"][:1]


# ---- where levels are steady ------------------------------------------------------------------------


def _list_stretches(test: ModalTest, mode: int, settings: ResonanceSettings) -> Iterator[tuple[int, int, bool]]:
    """Yield first and last sample of each steady stretch, and of each block of a transient after one, in order."""
    period = test.fs / float(test.modes.frequency_hz[test.modes.index(mode)])
    block, frame, last = round(settings.block_periods * period), round(settings.frame_periods * period), None
    assert test.force is not None
    volts = _list_voltages(test)
    drive = Drive(test.force, test.recording.channel(volts[0]) if volts else test.force)
    for begin, end in find_steady(test.modal_acceleration(mode), period, settings, drive):
        if last is not None:
            # The step lies within a frame of the end of the last level; a block must not contain it.
            yield from ((at, at + block, False) for at in range(last + frame, begin - block + 1, block))
        yield begin, end, True
        last = end


@dataclass(frozen=True, eq=False)
class Drive:
    """What drives a mode in a log.

    Args:
        force: (n,) the force, whose phase tells how far the motion is from resonance.
        amplitude: (n,) the channel whose amplitude the experimenter sets: the voltage, or the force where no voltage
            was recorded.
    """

    force: FloatArray
    amplitude: FloatArray


def find_steady(
    acceleration: FloatArray, period: float, settings: ResonanceSettings, drive: Drive | None = None
) -> list[tuple[int, int]]:
    """Return first and last sample of each stretch in which a mode moves steadily.

    Stretches that follow each other at one amplitude of the drive and one phase over the force are one level.

    Args:
        acceleration: (n,) modal acceleration.
        period: samples in a period of the mode.
        settings: where a level is steady.
        drive: what drives the mode; where None, stretches of one amplitude and frequency of the motion are one level.

    >>> step = np.repeat([1.0, 2.0], 2000)
    >>> record = step * np.sin(2 * np.pi / 10 * np.arange(4000))
    >>> [(begin < 100, end > 1900) for begin, end in find_steady(record, 10.0, ResonanceSettings())][:1]
    [(True, True)]
    """
    size = round(settings.frame_periods * period)
    hop = max(size // 2, 1)
    m = int(np.ceil(settings.window_periods * period / hop))
    if acceleration.size < size + (m - 1) * hop:
        return []
    frames = _follow(acceleration, period, size, hop)
    log_amplitude, phase = _find_log(frames), np.unwrap(np.angle(frames))
    windows = [np.lib.stride_tricks.sliding_window_view(each, m) for each in (log_amplitude, phase)]
    drifts = _find_trend(windows[0], 1), _find_trend(windows[1], 2)
    steady = np.ones(len(windows[0]), dtype=bool)
    for drift, noise in drifts:
        steady &= np.abs(drift) <= np.maximum(settings.most_drift, settings.drift_sigma * noise)
    steady &= drifts[0][1] <= settings.most_wander
    spans = [(first, last + m) for first, last in _list_runs(steady)]
    if drive is None:
        # Over a window the phase moves by m times its turn in a frame.
        stands = [(log_amplitude, settings.most_drift), (m * np.gradient(phase), settings.most_drift)]
    else:
        force, amplitude = (_follow(each, period, size, hop) for each in (drive.force, drive.amplitude))
        lead = np.unwrap(np.angle(frames * force.conj()))
        stands = [(_find_log(amplitude), settings.most_drift), (lead, np.radians(settings.same_level_deg))]
    found = []
    for first, last in _join_spans(spans, stands, m):
        begin, end = _trim(log_amplitude, first, last, m, settings)
        # A step may lie in the last half of the last frame, whose window hides it; there the transient begins.
        found.append((begin * hop + hop // 2, (end - 1) * hop + size // 4))
    return found


def _follow(samples: FloatArray, period: float, size: int, hop: int) -> ComplexArray:
    """Return the complex amplitude at a period in overlapping frames under a Hann window."""
    turned = samples * np.exp(-2j * np.pi / period * np.arange(samples.size))
    hann = np.hanning(size + 2)[1:-1]
    views = np.lib.stride_tricks.sliding_window_view(turned, size)[::hop]
    return np.asarray(views @ (2.0 * hann / hann.sum()), dtype=np.complex128)


def _find_log(frames: ComplexArray) -> FloatArray:
    return np.asarray(np.log(np.maximum(np.abs(frames), np.finfo(float).tiny)), dtype=np.float64)


def _join_spans(
    spans: list[tuple[int, int]], stands: Sequence[tuple[FloatArray, float]], m: int
) -> list[tuple[int, int]]:
    """Return the spans with those joined that belong to one level.

    Args:
        spans: first frame and end of each.
        stands: what is the same throughout a level, by frames, and by how much its medians may differ: the first frames
            of a span may hold the step before it.
        m: frames of a window; spans that are farther apart are different levels.
    """
    joined: list[tuple[int, int]] = []
    for span in spans:
        if joined and span[0] - joined[-1][1] < m:
            before, after = slice(*joined[-1]), slice(*span)
            if all(abs(float(np.median(each[after]) - np.median(each[before]))) <= most for each, most in stands):
                joined[-1] = (joined[-1][0], span[1])
                continue
        # A frame belongs to one level.
        joined.append((max(span[0], joined[-1][1] if joined else 0), span[1]))
    return [each for each in joined if each[1] - each[0] >= m]


def _find_trend(windows: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Return the change over each window that its highest power makes, and its standard deviation by the scatter."""
    x = np.linspace(-0.5, 0.5, windows.shape[1])
    basis = np.polynomial.legendre.legvander(2.0 * x, order)
    coefficients = windows @ np.linalg.pinv(basis).T
    rest = windows - coefficients @ basis.T
    std = np.sqrt((rest**2).sum(axis=1) / (x.size - order - 1))
    return 2.0 * coefficients[:, order], 2.0 * std * np.sqrt(np.linalg.inv(basis.T @ basis)[order, order])


def _list_runs(flags: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    yield from ((int(first), int(last) - 1) for first, last in zip(edges[::2], edges[1::2], strict=True))


def _trim(log_amplitude: FloatArray, begin: int, end: int, fewest: int, settings: ResonanceSettings) -> tuple[int, int]:
    """Return the frames of a stretch without the end of its transient: what is left has no trend beyond its noise."""
    while end - begin > fewest:
        drift, noise = _find_trend(log_amplitude[None, begin:end], 1)
        if abs(drift[0]) <= settings.drift_sigma * noise[0]:
            break
        begin += 1
    return begin, end


# ---- what a stretch holds -----------------------------------------------------------------------------


def _measure_stretch(
    test: ModalTest,
    mode: int,
    stretch: tuple[int, int],
    lock_time_s: float,
    is_steady: bool,
    settings: ResonanceSettings,
) -> MeasuredLevel:
    assert test.force is not None
    part = slice(*stretch)
    volts = [test.recording.channel(name)[part] for name in _list_voltages(test)]
    columns = [test.modal_acceleration(mode)[part], test.force[part], test.at_sensors[part], *volts]
    channels = np.column_stack(columns)
    fit, pole = _fit_pole(channels, test, mode)
    state = _make_state(test, mode, fit, pole, len(channels))
    clipped = _find_clipped(test, channels, settings) if is_steady else ""
    error = [state.motion_error, state.force_error]
    fault = (clipped or _find_fault(error, state, settings)) if is_steady else ""
    found = fit.value
    sensors = found[2 : 2 + len(test.sensors)]
    point = sensors[test.sensors.index(test.drive_point), 0] if test.drive_point in test.sensors else found[0, 0]
    level = AppropriationLevel(
        voltage_v=float(np.abs(found[-1, 0])) if volts else float("nan"),
        frequency_hz=pole.imag / (2.0 * np.pi),
        locked=is_steady and not fault,
        lock_time_s=lock_time_s,
        phase_error_deg=float(np.degrees(find_resonance_error(point, found[1, 0]))),
        unsteadiness=float(fit.rest[0] / max(np.abs(found[0, 0]), np.finfo(float).tiny)),
        force=found[1],
        sensors=sensors,
        modal=modal_filter(with_sensors(test.modes, test.sensors)) @ sensors,
        text=fault,
    )
    return MeasuredLevel(stretch[0] / test.fs, stretch[1] / test.fs, level, state, is_steady, fault, bool(clipped))


def _fit_pole(channels: FloatArray, test: ModalTest, mode: int) -> tuple[_Harmonics, complex]:
    """Return the harmonics of a stretch at the frequency of its own pole, and the pole, 1/s."""
    n, omega = len(channels), 2.0 * np.pi * float(test.modes.frequency_hz[test.modes.index(mode)])
    omega = _find_frequency(channels[:, 0], omega, test.fs)
    for _ in range(3):
        fit = _fit_harmonics(channels, omega / test.fs)
        pole = complex(fit.growth[0] * test.fs + 1j * omega)
        if abs(pole.imag - omega) < 1e-3 / n * test.fs:
            break
        omega = pole.imag
    return fit, pole


def _make_state(test: ModalTest, mode: int, fit: _Harmonics, pole: complex, n: int) -> SteadyState:
    """Return what the harmonics of n samples say of the equation of the mode."""
    assert test.drive_point is not None
    modes = with_sensors(test.modes, test.sensors)
    omega, found = pole.imag, fit.value
    error = fit.std / np.maximum(np.abs(found[:, 0]), np.finfo(float).tiny)
    sensors, weights = found[2 : 2 + len(test.sensors)], weigh_sensors(modes)
    by_shapes = weighted_shapes(modes) @ (modal_filter(modes) @ sensors)[:, 0]
    numbers = np.arange(1, N_HARMONICS + 1)
    displacement = found[0] / (1j * omega * numbers) ** 2
    displacement[0] = found[0, 0] / pole**2
    return SteadyState(
        source=test.name,
        pole=pole,
        force=modes.row(test.drive_point)[modes.index(mode)] * found[1, 0],
        displacement=displacement,
        force_error=float(error[1]),
        motion_error=float(error[0]),
        pole_std=float(fit.growth_std[0]) * test.fs,
        spread=(pole.real * n / test.fs) ** 2 * HANN_VARIANCE,
        outside=_find_outside(weights * sensors[:, 0], by_shapes, weights * fit.std[2 : 2 + len(sensors)]),
    )


def _find_frequency(samples: FloatArray, omega: float, fs: float) -> float:
    """Return the frequency of the largest line near omega, rad/s, by the phase between the halves of a stretch."""
    half = samples.size // 2
    hann = np.hanning(half + 2)[1:-1]
    spectrum = np.abs(np.fft.rfft(hann * samples[:half], 4 * half))
    lines = 2.0 * np.pi * fs * np.fft.rfftfreq(4 * half)
    near = np.abs(lines - omega) < 0.25 * omega
    coarse = float(lines[near][np.argmax(spectrum[near])]) if near.any() else omega
    turn = np.exp(-1j * coarse / fs * np.arange(2 * half)) * samples[: 2 * half]
    first, second = hann @ turn[:half], hann @ turn[half:]
    return coarse + float(np.angle(second * np.conj(first))) * fs / half


@dataclass(frozen=True, eq=False)
class _Harmonics:
    """Fundamental and harmonics of some channels at the middle of a stretch."""

    value: ComplexArray  # (n_channels, 5) harmonics
    growth: ComplexArray  # (n_channels,) change of the fundamental over itself, 1/sample
    rest: FloatArray  # (n_channels,) rms of what is neither a harmonic nor the mean
    std: FloatArray  # (n_channels,) standard deviation of either part of a harmonic
    growth_std: FloatArray  # (n_channels,) standard deviation of either part of the change


def _fit_harmonics(channels: FloatArray, omega: float) -> _Harmonics:
    """Return the harmonics of channels (n, n_channels) under a Hann window; omega is in radians a sample.

    The mean of a derivative under a window is minus that of the function under the window's own derivative. The
    equation of the mode is linear in such means, so it holds for them however the amplitude moves in the stretch.
    """
    n = channels.shape[0]
    time, angle = np.arange(n) - 0.5 * (n - 1), np.pi / (n + 1) * np.arange(1, n + 1)
    window, slope = np.sin(angle) ** 2, np.pi / (n + 1) * np.sin(2.0 * angle)
    waves = np.exp(1j * omega * time[:, None] * np.arange(1, N_HARMONICS + 1))
    basis = np.column_stack([waves.real, -waves.imag, np.ones(n)])
    weighted = window[:, None] * basis
    inverse = np.linalg.inv(weighted.T @ basis)
    solved = inverse @ (weighted.T @ channels)
    left = channels - basis @ solved
    rest = np.sqrt((window @ left**2) / window.sum())
    value = (solved[:N_HARMONICS] + 1j * solved[N_HARMONICS : 2 * N_HARMONICS]).T
    first = np.where(value[:, 0] == 0.0, 1.0, value[:, 0])
    # What the fit leaves still holds the change of the fundamental; the fundamental itself has none.
    growth = -2.0 * ((slope * waves[:, 0].conj()) @ left) / window.sum() / first
    return _Harmonics(
        value,
        growth,
        rest,
        rest * float(np.sqrt((inverse @ (weighted.T @ weighted) @ inverse)[0, 0])),
        rest * float(np.sqrt(2.0 * np.sum(slope**2))) / window.sum() / np.abs(first),
    )


def _find_outside(measured: ComplexArray, by_shapes: ComplexArray, noise: FloatArray) -> float:
    """Return the motion of the sensors that no shape makes over all motion, beyond what the noise makes."""
    missed = np.sum(np.abs(measured - by_shapes) ** 2) - 2.0 * np.sum(noise**2)
    return float(np.sqrt(max(missed, 0.0) / np.sum(np.abs(measured) ** 2)))


def _find_fault(error: Sequence[float], state: SteadyState, settings: ResonanceSettings) -> str:
    """Return why a level does not count, "" if it does."""
    for name, value in zip(("the mode", "the force"), error, strict=False):
        if value * settings.least_signal > 1.0:
            return f"{name} does not stand out from the noise (amplitude {1.0 / value:.1f} standard deviations)"
    if settings.farthest_deg < abs(state.phase_error_deg) < 180.0 - settings.farthest_deg:
        return (
            f"the phase is {state.phase_error_deg:.0f} degrees off quadrature: hold the level nearer to phase resonance"
        )
    return ""


def _find_clipped(test: ModalTest, channels: FloatArray, settings: ResonanceSettings) -> str:
    """Return which channel of a level is clipped, "" if none is."""
    for name, samples in zip(("the force", *map(repr, test.sensors)), channels.T[1:], strict=False):
        if is_flat_topped(samples, settings.flat_fraction):
            return f"{name} is clipped: measure it with a larger range"
    return ""


def is_flat_topped(samples: FloatArray, flat_fraction: float) -> bool:
    """Return whether more samples lie at an end of a steady vibration than its resolution explains.

    >>> wave = np.sin(0.1 * np.arange(3000))
    >>> is_flat_topped(wave, 0.01), is_flat_topped(np.clip(wave, -2.0, 0.9), 0.01)
    (False, True)
    """
    values = np.unique(samples)
    step = float(np.diff(values).min(initial=np.inf))
    half = max(0.5 * float(values[-1] - values[0]), np.finfo(float).tiny)
    # A sine spends this part of its time within one step of an end.
    expected = float(np.arccos(1.0 - min(step / half, 2.0))) / np.pi
    at_ends = max(float(np.mean(samples == end)) for end in (values[0], values[-1]))
    return at_ends > flat_fraction + 3.0 * expected
