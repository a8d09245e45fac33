"""Voltages that drive a shaker: sine beats by both rules of the paper (Pacini section 3.1), and shaped sweeps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, require_positive
from opid.modal.linear.frequency_response import FrequencyResponse, resynthesised
from opid.modal.linear.modes import LinearModes
from opid.signals.recording import FloatArray
from opid.signals.spectra import Window

SweepKind = Literal["linear", "logarithmic"]

FEWEST_PERIODS = 3.0  # a beat with fewer periods of its sine has no clear peak at the centre frequency
HIGHEST_RATE = 1 / 2.56  # fraction of the sampling rate that the usual filters of a data acquisition let pass
N_FINE = 4096  # samples at which the spectrum of a window is computed

COUNTS_SAMPLES = (
    *("gaussian", "gauss", "gss", "general gaussian", "general_gaussian", "general gauss", "general_gauss", "ggs"),
    *("exponential", "poisson"),
)
"""Windows of scipy whose width is a number of samples, so that they do not scale with time."""


@dataclass(frozen=True)
class SineBeat:
    """A sine under a window, v = a(t) sin(omega_c t) (Pacini eq. 7), between two quiet times.

    Args:
        centre_hz: frequency of the sine, Hz.
        duration_s: length of the window, s.
        window: any name or tuple that scipy.signal.get_window takes, except those whose width counts samples.
        amplitude: peak of the window, V (or another unit that the shaker takes).
        lead_s: quiet time before the window, s.
        tail_s: quiet time after the window, s, in which the structure decays, see `quiet_s`.

    Raises:
        InputError: a frequency or duration that is not positive, fewer than three periods, a negative quiet time, or a
            window that is not known.
    """

    centre_hz: float
    duration_s: float
    window: Window = "blackmanharris"
    amplitude: float = 1.0
    lead_s: float = 0.0
    tail_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("centre_hz", "duration_s"):
            require_positive(name, getattr(self, name))
        for name in ("lead_s", "tail_s"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"{name} is {value}: give 0 or a positive number of seconds")
        if not np.isfinite(self.amplitude):
            raise InputError(f"amplitude is {self.amplitude}: give a finite number")
        periods = self.centre_hz * self.duration_s
        if periods < FEWEST_PERIODS * (1 - 1e-9):
            raise InputError(
                f"a beat of {self.duration_s:.3g} s holds {periods:.2g} periods of {self.centre_hz:.4g} Hz: give "
                f"{FEWEST_PERIODS / self.centre_hz:.3g} s (three periods) or more"
            )
        _sample_window(self.window, 8)


@dataclass(frozen=True)
class BeatDesign:
    """A sine beat and the rule that made it.

    Args:
        beat: the beat.
        first_minimum_hz: distance from the centre to the first minima of its spectrum, Hz.
        reason: the rule, and the neighbours or the band that decided, in one sentence.
    """

    beat: SineBeat
    first_minimum_hz: float
    reason: str


def sine_beat_voltage(beat: SineBeat, fs: float) -> FloatArray:
    """Return the samples of a sine beat, quiet times included, (n,) V.

    Args:
        beat: the beat.
        fs: sampling rate, Hz.

    Raises:
        InputError: a rate too low for the beat.

    >>> voltage = sine_beat_voltage(SineBeat(100.0, 0.5, tail_s=0.5), fs=1024.0)
    >>> voltage.size, bool(np.abs(voltage).max() > 0.9)
    (1024, True)
    """
    _require_rate(beat.centre_hz, fs, "the beat")
    n_samples = max(2, round((beat.lead_s + beat.duration_s + beat.tail_s) * fs))
    lead, length = round(beat.lead_s * fs), round(beat.duration_s * fs)
    time_s = np.arange(length + 1) / fs
    # The window has its ends on the first and the last sample.
    shape = _sample_window(beat.window, length + 1) * np.sin(2 * np.pi * beat.centre_hz * time_s)
    voltage = np.zeros(max(n_samples, lead + 1))
    inside = min(shape.size, voltage.size - lead)
    voltage[lead : lead + inside] = beat.amplitude * shape[:inside]
    return voltage


def quiet_s(modes: LinearModes, mode: int, *, decay_to: float = 1e-4) -> float:
    """Return how long a mode takes to decay, ln(1 / decay_to) / (zeta omega), s.

    Args:
        modes: the linear modes.
        mode: number of the mode, from 1.
        decay_to: fraction of its amplitude that is left at the end.

    Raises:
        InputError: a mode that does not decay, or a fraction outside 0 .. 1.

    >>> round(quiet_s(LinearModes([100.0], [0.004], [[0.5]], ("a",)), 1), 3)
    3.665
    """
    if not 0 < decay_to < 1:
        raise InputError(f"decay_to is {decay_to}: give a fraction between 0 and 1, e.g. 1e-4")
    rate = modes.damping()[modes.index(mode)] / 2
    if rate == 0:
        raise InputError(
            f"mode {mode} has no damping and does not decay: give its damping ratio, or the tail_s yourself"
        )
    return float(np.log(1 / decay_to) / rate)


def beat_between_neighbours(
    modes: LinearModes,
    mode: int,
    *,
    window: Window = "blackmanharris",
    amplitude: float = 1.0,
    lead_s: float = 0.0,
    tail_s: float | None = None,
) -> BeatDesign:
    """Return the beat whose spectrum has its first minima on the neighbouring modes (Pacini section 3.1, rule 1).

    The distances to the two usually differ: the nearer elastic neighbour decides, and the other lies beyond the first
    minimum.

    Args:
        modes: the linear modes.
        mode: number of the mode to excite, from 1.
        window: the window of the beat, see `SineBeat`.
        amplitude: peak of the window, V.
        lead_s: quiet time before the window, s.
        tail_s: quiet time after the window, s; where left out, the time in which the mode decays to 1e-4.

    Raises:
        InputError: a rigid-body mode, no other elastic mode, a neighbour at the same frequency, or one so far that the
            beat would be shorter than three periods.

    >>> modes = LinearModes([90.0, 100.0, 120.0], [0.004] * 3, [[0.5, 0.3, 0.2]], ("a",))
    >>> design = beat_between_neighbours(modes, 2)
    >>> round(design.beat.duration_s, 6), design.first_minimum_hz
    (0.4, 10.0)
    """
    centre = _require_elastic(modes, mode)
    if np.count_nonzero(np.abs(modes.frequency_hz - centre) < 1e-6 * centre) > 1:
        raise InputError(
            f"mode {mode} has a neighbour at its own frequency, {centre:.5g} Hz: no beat can excite it alone"
        )
    lower, upper = modes.neighbours_hz(mode)
    below, above = centre - lower if lower else None, upper - centre if np.isfinite(upper) else None
    distances = {word: each for word, each in (("below", below), ("above", above)) if each is not None}
    if not distances:
        raise InputError(f"mode {mode} has no elastic neighbour: design the beat by the drive-point peak instead")
    nearest = min(distances.values())
    duration = first_minimum_hz(window, 1.0) / nearest
    neighbours = " and ".join(f"{distance:.4g} Hz {word}" for word, distance in distances.items())
    reason = f"first minima {nearest:.4g} Hz from mode {mode}: the neighbouring elastic modes lie {neighbours}"
    beat = _make_beat(modes, mode, duration, window, amplitude, lead_s, tail_s, reason)
    return BeatDesign(beat, nearest, reason)


def beat_over_drive_point_peak(
    modes: LinearModes,
    mode: int,
    drive_point: str,
    *,
    response: FrequencyResponse | None = None,
    fraction: float = 0.05,
    level_db: float | None = None,
    window: Window = "blackmanharris",
    amplitude: float = 1.0,
    lead_s: float = 0.0,
    tail_s: float | None = None,
) -> BeatDesign:
    """Return the beat whose main lobe is as wide as the drive point's peak (Pacini section 3.1, rule 2).

    The peak is the band around the natural frequency in which the imaginary part of the drive-point accelerance
    exceeds a fraction of its value at the mode; it ends at the middle between two modes at the latest.

    Args:
        modes: the linear modes.
        mode: number of the mode to excite, from 1.
        drive_point: the sensor at which the shaker acts.
        response: measured response to a force at the drive point; that of the linear modes where left out.
        fraction: fraction of the peak of the imaginary part at which the band ends.
        level_db: level at which the main lobe is as wide as the band, dB; between its first minima where None.
        window: the window of the beat, see `SineBeat`.
        amplitude: peak of the window, V.
        lead_s: quiet time before the window, s.
        tail_s: quiet time after the window, s; where left out, the time in which the mode decays to 1e-4.

    Raises:
        InputError: a rigid-body mode, one that does not move at the drive point, a response to another drive point or
            too coarse for the peak, or a beat shorter than three periods.

    >>> modes = LinearModes([100.0], [0.004], [[0.5]], ("a",))
    >>> beat = beat_over_drive_point_peak(modes, 1, "a").beat
    >>> round(main_lobe_width_hz(beat.window, beat.duration_s), 2)  # 2 sqrt(19) zeta f
    3.49
    """
    _require_elastic(modes, mode)
    if not 0 < fraction < 1:
        raise InputError(f"fraction is {fraction}: give a number between 0 and 1, e.g. 0.05")
    low, high = _find_peak_band(modes, mode, drive_point, response, fraction)
    width = high - low
    duration = main_lobe_width_hz(window, 1.0, level_db=level_db) / width
    part = "between its first minima" if level_db is None else f"at {level_db:g} dB"
    reason = (
        f"main lobe ({part}) of {width:.4g} Hz: there the imaginary part at {drive_point!r} exceeds "
        f"{100 * fraction:g} % of its value at mode {mode}"
    )
    beat = _make_beat(modes, mode, duration, window, amplitude, lead_s, tail_s, reason)
    return BeatDesign(beat, first_minimum_hz(window, duration), reason)


def shaped_sweep(
    frequency_hz: ArrayLike,
    amplitude: ArrayLike,
    *,
    start_hz: float,
    stop_hz: float,
    duration_s: float,
    fs: float,
    kind: SweepKind = "linear",
    fade_s: float = 0.0,
) -> FloatArray:
    """Return a sine sweep whose amplitude follows its frequency, (n,) V.

    Args:
        frequency_hz: (n_points,) increasing frequencies at which the amplitude is given, Hz.
        amplitude: (n_points,) V; straight lines between the points, constant beyond them.
        start_hz: frequency at the beginning, Hz.
        stop_hz: frequency at the end, Hz; below `start_hz` for a sweep downwards.
        duration_s: length, s.
        fs: sampling rate, Hz.
        kind: "linear" for a constant number of hertz a second, "logarithmic" for one of octaves a second.
        fade_s: time in which the amplitude rises at the beginning and falls at the end, as a half cosine, s.

    Raises:
        InputError: points that do not increase or do not match, frequencies that are not positive or too high for the
            rate, an unknown kind, or fades longer than the sweep.

    >>> sweep = shaped_sweep([10, 50], [1.0, 3.0], start_hz=10, stop_hz=50, duration_s=4.0, fs=512.0, fade_s=0.2)
    >>> sweep.size, round(float(np.abs(sweep[1000:1050]).max()), 1)
    (2048, 2.0)
    """
    from scipy.signal import chirp

    points, heights = np.asarray(frequency_hz, dtype=np.float64), np.asarray(amplitude, dtype=np.float64)
    _check_points(points, heights)
    for name, value in (("start_hz", start_hz), ("stop_hz", stop_hz), ("duration_s", duration_s)):
        require_positive(name, value)
    _require_rate(max(start_hz, stop_hz), fs, "the sweep")
    if kind not in get_args(SweepKind):
        raise InputError(f"there is no sweep of kind {kind!r}: give 'linear' or 'logarithmic'")
    if not 0 <= fade_s <= duration_s / 2:
        raise InputError(f"fade_s is {fade_s} s in a sweep of {duration_s} s: give 0 to half of the sweep")
    n_samples = round(duration_s * fs)
    if n_samples < 2:
        raise InputError(f"{duration_s} s at {fs} Hz make {n_samples} sample(s): at least two are needed")
    time_s = np.arange(n_samples) / fs
    part = time_s / duration_s
    sweeps = {"linear": start_hz + (stop_hz - start_hz) * part, "logarithmic": start_hz * (stop_hz / start_hz) ** part}
    sweep = np.interp(sweeps[kind], points, heights) * chirp(
        time_s, start_hz, duration_s, stop_hz, method=kind, phi=-90
    )
    if fade_s > 0:
        edge = np.clip(np.minimum(time_s, duration_s - 1 / fs - time_s) / fade_s, 0, 1)
        sweep *= (1 - np.cos(np.pi * edge)) / 2
    return sweep


def _check_points(points: FloatArray, heights: FloatArray) -> None:
    """Refuse amplitudes over frequency that do not match or do not increase in frequency."""
    if points.ndim != 1 or points.shape != heights.shape or points.size == 0:
        raise InputError(
            f"frequency_hz has shape {points.shape} and amplitude {heights.shape}: give one amplitude for each "
            "frequency"
        )
    if not (np.isfinite(points).all() and np.isfinite(heights).all() and (np.diff(points) > 0).all()):
        raise InputError(
            "the points of the amplitude must be finite and increase in frequency, and these do not: sort them"
        )


def first_minimum_hz(window: Window, duration_s: float) -> float:
    """Return the distance from the centre of a beat's spectrum to its first minima, Hz: 4/T for Blackman-Harris.

    >>> round(first_minimum_hz("blackmanharris", 2.0), 6)
    2.0
    """
    from scipy import optimize

    require_positive("duration_s", duration_s)
    finer = 32  # lines within 1/T; the first 96/T are searched
    value = np.abs(np.fft.rfft(_sample_finely(window), finer * N_FINE)[: 96 * finer])
    falls = np.diff(value)
    turns = np.flatnonzero((falls[:-1] < 0) & (falls[1:] >= 0))
    if not turns.size:
        raise InputError(f"the spectrum of the window {window!r} has no minimum: take another window")
    bounds = turns[0] / finer, (turns[0] + 2) / finer
    height = _make_spectrum(window)
    found = optimize.minimize_scalar(height, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    return float(found.x) / duration_s


def main_lobe_width_hz(window: Window, duration_s: float, *, level_db: float | None = None) -> float:
    """Return the width, Hz, of the main lobe of a beat's spectrum, between its first minima or at a level, dB.

    >>> round(main_lobe_width_hz("hann", 1.0), 6), round(main_lobe_width_hz("hann", 1.0, level_db=-3.0), 2)
    (4.0, 1.44)
    """
    from scipy import optimize

    minimum = first_minimum_hz(window, 1.0)
    if level_db is None:
        return 2 * minimum / duration_s
    if not (np.isfinite(level_db) and level_db < 0):
        raise InputError(f"level_db is {level_db}: give a negative number of decibels, e.g. -20")
    level, height = 10 ** (level_db / 20), _make_spectrum(window)
    if height(minimum) >= level:
        raise InputError(f"the main lobe of {window!r} ends above {level_db:g} dB: give a level nearer to 0")
    return 2 * float(optimize.brentq(lambda distance: height(distance) - level, 0, minimum)) / duration_s


def _sample_finely(window: Window) -> FloatArray:
    shape = _sample_window(window, N_FINE + 1)
    shape[[0, -1]] /= 2  # the trapezoidal rule, exact for sums of cosines
    return shape


def _make_spectrum(window: Window) -> Callable[[float], float]:
    """Return the magnitude of a window's spectrum over that at its centre, as a function of the distance in 1/T."""
    shape, position = _sample_finely(window), np.arange(N_FINE + 1) / N_FINE - 0.5
    return lambda distance: float(abs(np.exp(-2j * np.pi * distance * position) @ shape) / abs(shape.sum()))


def _sample_window(window: Window, n_samples: int) -> FloatArray:
    """Return the samples of a window, both ends included."""
    from scipy import signal

    name = window if isinstance(window, str) else window[0]
    if name in COUNTS_SAMPLES:
        raise InputError(
            f"the width of the window {name!r} counts samples: take one that scales with time, e.g. 'hann'"
        )
    try:
        return np.asarray(signal.get_window(window, n_samples, fftbins=False), dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise InputError(
            f"scipy does not make the window {window!r} ({error}): give a name like 'blackmanharris', or a tuple like "
            "('kaiser', 14.0)"
        ) from None


def _make_beat(
    modes: LinearModes,
    mode: int,
    duration: float,
    window: Window,
    amplitude: float,
    lead_s: float,
    tail_s: float | None,
    reason: str,
) -> SineBeat:
    tail = quiet_s(modes, mode) if tail_s is None else tail_s
    try:
        return SineBeat(_require_elastic(modes, mode), duration, window, amplitude, lead_s, tail)
    except InputError as error:
        raise InputError(f"{error} (the rule that designed it: {reason})") from None


def _find_peak_band(
    modes: LinearModes, mode: int, drive_point: str, response: FrequencyResponse | None, fraction: float
) -> tuple[float, float]:
    """Return the band around a mode where the imaginary part of the drive point's response is large, Hz."""
    index = modes.index(mode)
    centre = float(modes.frequency_hz[index])
    if abs(modes.row(drive_point)[index]) < 1e-6 * np.abs(modes.shapes[:, index]).max():
        raise InputError(f"mode {mode} does not move at {drive_point!r}: choose another drive point")
    below, above = modes.neighbours_hz(mode)
    lowest = (centre + below) / 2 if below else 0.1 * centre
    highest = (centre + above) / 2 if np.isfinite(above) else 1.9 * centre
    if response is None:
        width = modes.damping_ratio[index] * centre
        if width == 0:
            raise InputError(f"mode {mode} has no damping: its peak has no width, give its damping ratio")
        # The lines are as fine as the peak, and coarser away from it.
        steps = width * np.sinh(np.linspace(0, np.arcsinh(max(highest - centre, centre - lowest) / width), 2000))
        response = resynthesised(modes, np.concatenate([centre - steps[:0:-1], centre + steps]).clip(0), drive_point)
    if response.drive_point != drive_point or drive_point not in response.sensors:
        raise InputError(
            f"the response belongs to a force at {response.drive_point!r} with {len(response.sensors)} sensor(s): give "
            f"one to a force at {drive_point!r}, with the acceleration there"
        )
    frequency = response.frequency_hz
    inside = (frequency >= lowest) & (frequency <= highest)
    line, height = frequency[inside], np.abs(response.value[inside, response.sensors.index(drive_point)].imag)
    if line.size < 5:
        raise InputError(f"the response has {line.size} line(s) around mode {mode}: give one with finer lines")
    peak = int(np.nanargmin(np.abs(line - centre)))
    near = slice(max(0, peak - 2), peak + 3)  # the mode may lie between two lines
    level = fraction * float(np.nanmax(height[near]))
    low, high = (
        _find_crossing(line[peak::-1], height[peak::-1], level),
        _find_crossing(line[peak:], height[peak:], level),
    )
    if np.count_nonzero((line > low) & (line < high)) < 3:
        raise InputError(f"the peak of mode {mode} is narrower than the lines of the response: give a longer record")
    return low, high


def _find_crossing(line: FloatArray, height: FloatArray, level: float) -> float:
    """Return where the height first falls below a level, between two lines; the last line if it never does."""
    under = np.flatnonzero(~(height[1:] >= level))
    if not under.size:
        return float(line[-1])
    at = int(under[0]) + 1
    if not np.isfinite(height[at]) or height[at - 1] <= level:
        return float(line[at])
    part = (height[at - 1] - level) / (height[at - 1] - height[at])
    return float(line[at - 1] + part * (line[at] - line[at - 1]))


def _require_elastic(modes: LinearModes, mode: int) -> float:
    frequency = float(modes.frequency_hz[modes.index(mode)])
    if frequency == 0:
        raise InputError(f"mode {mode} is a rigid-body mode (0 Hz): a beat excites elastic modes")
    return frequency


def _require_rate(highest_hz: float, fs: float, what: str) -> None:
    require_positive("fs", fs)
    if highest_hz > HIGHEST_RATE * fs:
        raise InputError(
            f"{what} goes up to {highest_hz:.5g} Hz and a rate of {fs:g} Hz records up to {HIGHEST_RATE * fs:.5g} Hz "
            f"(fs / 2.56): sample at {highest_hz / HIGHEST_RATE:.5g} Hz or more"
        )
