"""What is wrong with a recording, channel by channel, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.signals.recording import FloatArray, Recording
from opid.signals.units import STANDARD_GRAVITY

Severity = Literal["note", "warning", "fault"]

MUTE_VALUES = 3
"""A channel of so few distinct values is mute: a constant, or the last bit of a converter."""

CLIP_RUN = 3
"""Samples in a row at the extreme value that make a clipped peak: a smooth peak has one, by chance two."""

CLIP_CROWDING = 4.0
"""How much fuller than the next level the extreme level of a quantised, clipped signal is. The rounded top of
a coarsely quantised sine is about twice as full."""

FLAT_S = 0.1
"""A value held for so long is no vibration of a machine in operation."""

SPIKE_SIGMA = 10.0
"""Robust standard deviations by which a spike departs from its neighbours; Gaussian noise never does."""

SPIKE_BLOCK_S = 1.0
"""Stretch over which the usual departure is taken, lest a braking run's loud start be called spiky."""

COARSE_STEPS = 5.0
"""Quantisation steps an rms should have: at 5 the rounding, step/sqrt(12), is 6 % of the signal."""

OFFSET_RMS = 0.5
"""An offset beyond this part of the rms is worth a note: integrated twice it would hide the motion."""

GRAVITY_TOLERANCE = 0.05
"""How far from 1 g (relative) a mean still looks like gravity: a tilt of 18 degrees, or sensor offset."""

HIGH_FREQUENCY_HZ = 5.0
"""Above the bounce of a vehicle (1 to 3 Hz), where the suspension isolates the sprung side."""

MUTE_RATIO = 1e-3
"""A sensor of a pair this much quieter than the other is mute: no suspension takes 60 dB off the rms."""

QUIET_RATIO = 0.02
"""A sensor of a pair this much quieter than the other may show only its noise."""

SWAP_RATIO = 0.9
"""How much quieter than the airframe the spindle may be above 5 Hz before the two look swapped: a strut
locked by friction makes them nearly equal."""

_SEVERITIES: tuple[Severity, ...] = ("fault", "warning", "note")


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong or noteworthy.

    Args:
        severity: "fault" (unusable), "warning" (may spoil the result) or "note" (good to know).
        channel: the channel it concerns, empty for the whole recording.
        message: what was found and what to do.
    """

    severity: Severity
    channel: str
    message: str


@dataclass(frozen=True)
class ChannelHealth:
    """Figures of one channel, in its SI unit.

    Args:
        name: of the channel.
        unit: its SI unit.
        mean: the offset.
        rms: root mean square about the mean.
        peak: largest distance from the mean.
        crest_factor: peak over rms, 0 for a mute channel.
        high_frequency_rms: rms of the part above 5 Hz.
        quantisation_step: the step of which the values are multiples, None where none is visible.
        clipped_fraction: part of the samples that sit at an extreme value, three or more in a row.
        longest_flat_s: longest time for which the value does not change, s.
        spikes: single samples that depart from both neighbours by 10 robust standard deviations.
        mute: whether the channel shows nothing.
    """

    name: str
    unit: str
    mean: float
    rms: float
    peak: float
    crest_factor: float
    high_frequency_rms: float
    quantisation_step: float | None
    clipped_fraction: float
    longest_flat_s: float
    spikes: int
    mute: bool


@dataclass(frozen=True)
class Health:
    """What `inspect` found in a recording.

    Args:
        fs: sampling rate, Hz.
        duration_s: length, s.
        n_samples: samples a channel.
        channels: figures of each channel.
        looks_unsprung: the acceleration channel that looks like the wheel's side, None if there is no choice.
        findings: what is wrong, faults first.
    """

    fs: float
    duration_s: float
    n_samples: int
    channels: tuple[ChannelHealth, ...]
    looks_unsprung: str | None
    findings: tuple[Finding, ...]


def inspect(recording: Recording) -> Health:
    """Return the health of a recording: figures of every channel, and findings with what to do.

    Args:
        recording: at least two samples of one or more channels.

    >>> rng = np.random.default_rng(0)
    >>> samples = np.clip(rng.standard_normal((2000, 1)).cumsum(axis=0), -20, 20)
    >>> from opid.signals.recording import Channel
    >>> health = inspect(Recording(samples, fs=100.0, channels=(Channel("upper_z", "m/s^2"),)))
    >>> health.findings[0].severity, health.findings[0].channel
    ('warning', 'upper_z')
    """
    channels: list[ChannelHealth] = []
    findings: list[Finding] = []
    for name in recording.names:
        samples = recording.channel(name)
        channel = _channel_health(name, recording.unit(name), samples, recording.fs)
        channels.append(channel)
        findings += _findings(channel, samples, recording)
    findings.sort(key=lambda finding: _SEVERITIES.index(finding.severity))
    return Health(
        fs=recording.fs,
        duration_s=recording.duration_s,
        n_samples=recording.n_samples,
        channels=tuple(channels),
        looks_unsprung=looks_unsprung(recording),
        findings=tuple(findings),
    )


def looks_unsprung(recording: Recording, names: Sequence[str] | None = None) -> str | None:
    """Return the acceleration channel with the largest rms above 5 Hz, which a suspension would take away.

    Args:
        recording: the log.
        names: the channels to choose from; all accelerations if left out.

    Returns:
        Its name, or None if there are fewer than two to choose from.
    """
    chosen = names or [channel.name for channel in recording.channels if channel.unit == "m/s^2"]
    if len(chosen) < 2:
        return None
    return max(chosen, key=lambda name: _rms_above(recording.channel(name), recording.fs, HIGH_FREQUENCY_HZ))


def check_pair(unsprung: ArrayLike, sprung: ArrayLike, *, fs: float, names: tuple[str, str]) -> tuple[Finding, ...]:
    """Return what speaks against two accelerations being those of a spindle and the airframe above it.

    Args:
        unsprung: (n_samples,) acceleration of the spindle, m/s^2.
        sprung: (n_samples,) acceleration of the airframe, m/s^2.
        fs: sampling rate, Hz.
        names: of the unsprung and the sprung channel, for the messages.

    Raises:
        InputError: a mute channel, or twice the same one.

    >>> rng = np.random.default_rng(0)
    >>> wheel = rng.standard_normal(4096)
    >>> body = np.convolve(wheel, np.ones(20) / 20, "same")
    >>> check_pair(wheel, body, fs=256.0, names=("lower_z", "upper_z"))
    ()
    >>> check_pair(body, wheel, fs=256.0, names=("lower_z", "upper_z"))[0].severity
    'fault'
    """
    lower, upper = np.asarray(unsprung, dtype=np.float64), np.asarray(sprung, dtype=np.float64)
    if np.array_equal(lower, upper):
        raise InputError(f"the channels {names[0]!r} and {names[1]!r} are the same signal: name two sensors")
    pair = (lower, upper)
    rms = [float(np.std(samples)) for samples in pair]
    for name, samples, own, other in zip(names, pair, rms, rms[::-1], strict=True):
        if _is_mute(samples) or own < MUTE_RATIO * other:
            raise InputError(
                f"the channel {name!r} is mute ({own:.3g} m/s^2 rms): check the sensor, its cable and range"
            )
    findings: list[Finding] = []
    quiet = int(np.argmin(rms))
    if rms[quiet] < QUIET_RATIO * rms[1 - quiet]:
        message = (
            f"{rms[quiet]:.3g} m/s^2 rms beside {rms[1 - quiet]:.3g} at {names[1 - quiet]!r}: "
            "this may be the sensor's noise alone; check its cable, its range and the units"
        )
        findings.append(Finding("warning", names[quiet], message))
    high = [_rms_above(without_spikes(samples, fs=fs)[0], fs, HIGH_FREQUENCY_HZ) for samples in pair]
    if high[0] < SWAP_RATIO * high[1]:
        message = (
            f"the spindle ({names[0]!r}, {high[0]:.3g} m/s^2 rms above {HIGH_FREQUENCY_HZ:g} Hz) is quieter "
            f"than the airframe ({names[1]!r}, {high[1]:.3g}): if swapped, exchange sprung and unsprung"
        )
        findings.append(Finding("fault", names[0], message))
    return tuple(findings)


# ---- figures -------------------------------------------------------------------------------------


def _channel_health(name: str, unit: str, samples: FloatArray, fs: float) -> ChannelHealth:
    mean, mute = float(samples.mean()), _is_mute(samples)
    rms, peak = float(samples.std()), float(np.abs(samples - mean).max())
    step = None if mute else _quantisation_step(samples)
    _, lengths = _runs(samples)
    return ChannelHealth(
        name=name,
        unit=unit,
        mean=mean,
        rms=rms,
        peak=peak,
        crest_factor=0.0 if mute else peak / rms,
        high_frequency_rms=_rms_above(samples, fs, HIGH_FREQUENCY_HZ),
        quantisation_step=step,
        clipped_fraction=0.0 if mute else _clipped(samples, step) / samples.size,
        longest_flat_s=float(lengths.max() - 1) / fs,
        spikes=0 if mute else _spikes(samples, fs, step).size,
        mute=mute,
    )


def _is_mute(samples: FloatArray) -> bool:
    # the first samples settle it for nearly every channel, without sorting them all
    return np.unique(samples[:1000]).size <= MUTE_VALUES and np.unique(samples).size <= MUTE_VALUES


def _runs(samples: FloatArray) -> tuple[np.ndarray, np.ndarray]:
    """Return where each run of equal values starts, and how many samples it has."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(samples)) + 1])
    return starts, np.diff(np.concatenate([starts, [samples.size]]))


def _longest_flat(samples: FloatArray, fs: float, step: float | None) -> tuple[float, bool]:
    """Return when the longest run of one value begins, s, and whether there is motion just beside it."""
    starts, lengths = _runs(samples)
    begin, end = int(starts[lengths.argmax()]), int((starts + lengths)[lengths.argmax()])
    beside = round(0.5 * fs)
    around = np.concatenate([samples[max(0, begin - beside) : begin], samples[end : end + beside]])
    return begin / fs, around.size > 0 and float(around.std()) > COARSE_STEPS * (step or 0.0)


def _quantisation_step(samples: FloatArray) -> float | None:
    """Return the smallest distance between values if most neighbouring values are 1 to 10 of it apart."""
    values = np.unique(samples)
    distances = np.diff(values)
    # two values that conversion to SI has rounded apart are one level
    distances = distances[distances > 1e-9 * (values[-1] - values[0])]
    smallest = distances.min()
    step = float(distances[distances < 1.5 * smallest].mean())
    multiples = distances / step
    regular = (multiples < 10.5) & (np.abs(multiples - np.round(multiples)) < 0.1)
    return step if regular.mean() > 0.5 else None


def _clipped(samples: FloatArray, step: float | None) -> int:
    """Count the samples held at the largest or smallest value, unless the levels next to it are as full."""
    starts, lengths = _runs(samples)
    count = 0
    for below in (samples.max() - samples, samples - samples.min()):
        held = int(lengths[(below[starts] == 0) & (lengths >= CLIP_RUN)].sum())
        if step is not None:
            next_levels = np.count_nonzero((below > 0.5 * step) & (below < 2.5 * step)) / 2
            # the one keeps a single rounded peak of few samples from passing for a clipped one
            held = held if held > CLIP_CROWDING * (next_levels + 1) else 0
        count += held
    return count


def without_spikes(samples: ArrayLike, *, fs: float) -> tuple[FloatArray, np.ndarray]:
    """Replace single samples that stand far out by the cubic through their four neighbours.

    Args:
        samples: (n,) one channel.
        fs: sampling rate, Hz.

    Returns:
        The mended samples, (n,), and the places that were mended.

    >>> signal = np.sin(np.arange(2000) / 20.0)
    >>> signal[700] += 30.0
    >>> mended, places = without_spikes(signal, fs=500.0)
    >>> places.tolist(), bool(abs(mended[700] - np.sin(35.0)) < 0.01)
    ([700], True)
    """
    mended = np.array(samples, dtype=np.float64)
    places = _spikes(mended, fs, None)
    near, far = mended[places - 1] + mended[places + 1], mended[places - 2] + mended[places + 2]
    mended[places] = (4 * near - far) / 6
    return mended, places


def _spikes(samples: FloatArray, fs: float, step: float | None) -> np.ndarray:
    """Return the indices of single samples far from both neighbours, while those are close to each other.

    The departure from the neighbours' mean, d_k = x_k - (x_{k-1} + x_{k+1})/2, of a spike of height s is
    -s/2, s, -s/2; an impact that rings makes departures of one sign.
    """
    departure = samples[1:-1] - 0.5 * (samples[:-2] + samples[2:])
    block = max(16, round(SPIKE_BLOCK_S * fs))
    if departure.size < block:
        return np.empty(0, dtype=np.intp)
    size = np.abs(departure)
    n_blocks = departure.size // block
    usual = np.median(size[: n_blocks * block].reshape(n_blocks, block), axis=1)
    # a standstill has hardly any departure: the whole run and the resolution set a floor
    usual = np.maximum(usual, max(0.1 * float(np.median(size)), 0.5 * (step or 0.0)))
    limit = SPIKE_SIGMA * 1.4826 * usual[np.minimum(np.arange(departure.size) // block, n_blocks - 1)]
    left, centre, right = departure[:-2], departure[1:-1], departure[2:]
    alone = np.maximum(np.sign(centre) * left, np.sign(centre) * right) < -0.25 * np.abs(centre)
    return np.flatnonzero((np.abs(centre) > limit[1:-1]) & alone) + 2


def _rms_above(samples: FloatArray, fs: float, frequency_hz: float) -> float:
    """Return the rms above a frequency, by Parseval under a Hann window (the whole rms if fs is too low)."""
    window = np.hanning(samples.size + 1)[:-1] if samples.size > 2 else np.ones(samples.size)
    spectrum = np.fft.rfft((samples - samples.mean()) * window)
    first = int(np.ceil(frequency_hz * samples.size / fs)) if frequency_hz < 0.5 * fs else 1
    power = 2 * np.sum(np.abs(spectrum[first:]) ** 2)
    return float(np.sqrt(power / (samples.size * np.sum(window**2))))


# ---- findings ------------------------------------------------------------------------------------


def _findings(channel: ChannelHealth, samples: FloatArray, recording: Recording) -> Iterator[Finding]:
    def finding(severity: Severity, message: str) -> Finding:
        return Finding(severity, channel.name, message)

    if channel.mute:
        value = f"{channel.mean:.4g} {channel.unit}"
        yield finding("fault", f"mute, all samples lie at {value}: check the sensor and its cable")
        return
    step = channel.quantisation_step
    if channel.clipped_fraction > 0:
        ends = f"{samples.min():.4g} or {samples.max():.4g} {channel.unit}"
        part = f"{channel.clipped_fraction:.2%} of the samples"
        yield finding("warning", f"{part} are clipped at {ends}: measure again with a larger range")
    elif channel.longest_flat_s >= FLAT_S:
        begin_s, moving = _longest_flat(samples, recording.fs, step)
        if moving:
            when = f"for {channel.longest_flat_s:.3g} s from {recording.start_s + begin_s:.3f} s"
            yield finding("warning", f"one value is held {when}: leave this dropout out with start_s and stop_s")
    if channel.spikes:
        first = recording.start_s + _spikes(samples, recording.fs, step)[0] / recording.fs
        where = f"{channel.spikes} spike(s) of one sample, the first at {first:.4f} s"
        yield finding("warning", f"{where}: check the cable, or leave them out with start_s and stop_s")
    if step is not None and channel.rms < COARSE_STEPS * step:
        steps = f"the rms is only {channel.rms / step:.1f} steps of the resolution ({step:.3g} {channel.unit})"
        yield finding("warning", f"{steps}: measure with a smaller range or more bits")
    if channel.unit == "m/s^2":
        if abs(abs(channel.mean) / STANDARD_GRAVITY - 1) < GRAVITY_TOLERANCE:
            yield finding(
                "note", f"the mean, {channel.mean:.3f} m/s^2, is gravity: nothing to do, `identify` takes it off"
            )
        elif abs(abs(channel.mean) - 1) < GRAVITY_TOLERANCE:
            yield finding("note", f"the mean, {channel.mean:.3f} m/s^2, would be gravity in g: check the unit")
        elif abs(channel.mean) > OFFSET_RMS * channel.rms:
            offset = f"the offset, {channel.mean:.3g} m/s^2, is large beside the rms, {channel.rms:.3g} m/s^2"
            yield finding("note", f"{offset}: nothing to do, `identify` takes it off")
