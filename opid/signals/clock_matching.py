"""Offset and drift of one recorder's clock against another's, from a motion that both recorded.

The two sides of a suspension share a motion, so their cross-correlation has a sharp peak at the offset of the clocks,
seconds or minutes away. A delay that grows with time shows in windows of some seconds as a lag that grows. The transfer
between the sides has a phase of its own, which is removed as that of a suspension: near its resonance a body comes some
ten milliseconds after its wheel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from opid.errors import InputError
from opid.signals.recording import FloatArray, Recording
from opid.signals.resampling import resampled
from opid.signals.spectra import ComplexArray


@dataclass(frozen=True, kw_only=True)
class ClockMatchSettings:
    """How clocks are matched.

    Args:
        band_hz: band in which both sides of a suspension move and sensors of any kind read.
        rate_hz: rate of the comparison; the band needs no more.
        window_s: length of the windows whose lags show the drift: some periods of the slowest motion of the band.
        least_overlap_s: least common time of the two records, s.
        least_peak: a peak of the correlation below this many times its rms is chance: the largest of 10^5 values of
            noise is 4.5 times, that of two sides of a suspension 15 to 40 times.
        lobe_s: peaks within this time of the best one belong to the same oscillation.
        ambiguous: a motion is periodic if its own whitened correlation comes back to this fraction of its peak.
        shared: least fraction of the lines of the band that both records share, with a coherence of at least a half.
        coherent: a window whose phases agree less than this with those of all windows shows no lag.
        least_windows: least number of windows that show a lag, and the fraction of all windows that do.
        transfer_s: standard deviation by which the phase of the transfer biases the offset, s: it is taken as that of a
            linear suspension, and that of a nonlinear one changes with the amplitude. Over eight runs of random gears
            the offset was wrong by 0.1 to 1.8 ms.
        transfer_drift_s: the same for the growth of the lag over the run, s: 0 to 6 ms in the same runs, which brake
            from 18 m/s to rest.
        jump_s: a jump of the lag by more than this, s, which explains most of what a straight line leaves, is one of
            the clock: a suspension changes its phase gradually, and by 1 ms (rms). If a straight line leaves more than
            this (rms) in any other way, the drift changes.
        jump_explains: the fraction that it explains.
        far_s: a part of the record whose own correlation has its peak farther than this from the common offset, s, is
            on the other side of a longer jump, where windows show no lag. The phase of the transfer moves it less.
    """

    band_hz: tuple[float, float] = (0.5, 40.0)
    rate_hz: float = 200.0
    window_s: float = 4.0
    least_overlap_s: float = 10.0
    least_peak: float = 6.5
    lobe_s: float = 0.5
    ambiguous: float = 0.6
    shared: float = 0.1
    coherent: float = 0.3
    least_windows: tuple[int, float] = (5, 0.6)
    transfer_s: float = 0.002
    transfer_drift_s: float = 0.004
    jump_s: float = 0.005
    jump_explains: float = 0.7
    far_s: float = 0.05


MATCHING = ClockMatchSettings()


@dataclass(frozen=True, eq=False)
class ClockMatch:
    """The clock of one recorder against that of another, the reference.

    The reference clock reads `stamp + offset_s + 1e-6 drift_ppm (stamp - middle_s)` where the other one reads `stamp`.

    Args:
        channels: channels of the other recorder.
        pair: channel of the reference and channel of the other recorder that were compared.
        offset_s: time to add in the middle of the run, s.
        offset_std_s: its standard deviation, s.
        drift_ppm: growth of the offset over time, parts per million.
        drift_std_ppm: its standard deviation, parts per million.
        middle_s: time of the middle of the common part on the clock of the other recorder, s.
        coherence: median coherence of the pair in the band, after the clocks were matched.
        at_s: (n_windows,) times of the windows on the reference clock, s.
        lag_s: (n_windows,) what the straight line leaves of the lag in each window, s.
    """

    channels: tuple[str, ...]
    pair: tuple[str, str]
    offset_s: float
    offset_std_s: float
    drift_ppm: float
    drift_std_ppm: float
    middle_s: float
    coherence: float
    at_s: FloatArray
    lag_s: FloatArray

    def to_reference(self, stamp_s: float) -> float:
        """Return the time of the reference clock, s.

        Args:
            stamp_s: time of the other clock, s.
        """
        return stamp_s + self.offset_s + 1e-6 * self.drift_ppm * (stamp_s - self.middle_s)

    def from_reference(self, time_s: float) -> float:
        """Return the time of the other clock, s.

        Args:
            time_s: time of the reference clock, s.
        """
        drift = 1e-6 * self.drift_ppm
        return (time_s - self.offset_s + drift * self.middle_s) / (1 + drift)

    @property
    def sentence(self) -> str:
        """What was found, in a sentence."""
        return (
            f"the clock of {', '.join(self.channels)} was matched to that of {self.pair[0]}: {self.offset_s:+.4f} s "
            f"(standard deviation {1e3 * self.offset_std_s:.1f} ms), {self.drift_ppm:+.0f} ppm "
            f"({self.drift_std_ppm:.0f} ppm), at a coherence of {self.coherence:.2f}"
        )


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two channels at one rate, each from its own time on."""

    names: tuple[str, str]
    first: FloatArray
    second: FloatArray
    fs: float
    starts_s: tuple[float, float]


def match_clocks(
    reference: Recording,
    other: Recording,
    *,
    offset_std_s: float = 60.0,
    drift_std_ppm: float = 100.0,
    settings: ClockMatchSettings = MATCHING,
) -> ClockMatch:
    """Return offset and drift of the clock of one recording against that of another.

    The offset is the peak of the generalised cross-correlation (Knapp & Carter 1976), whitened by both spectra, of the
    two channels that share most; the drift is the straight line through the lags of windows, weighted by coherence.

    Args:
        reference: recording whose clock counts; its channels are accelerations of the same machine.
        other: recording with the other clock.
        offset_std_s: offsets within three of these standard deviations are searched, s.
        drift_std_ppm: drifts within three of these standard deviations are searched, parts per million.
        settings: how clocks are matched.

    Raises:
        InputError: recordings that share no motion or too little time, a periodic motion, which leaves the offset
            ambiguous, or a clock that jumps.

    >>> from opid.signals.recording import recording_from_arrays
    >>> motion = np.convolve(np.random.default_rng(0).standard_normal(8000), np.hanning(9), "same")
    >>> one = recording_from_arrays([motion], ["hub"], fs=200.0)
    >>> two = recording_from_arrays([motion[300:7000]], ["seat"], fs=200.0)
    >>> match = match_clocks(one, two)
    >>> round(match.offset_s, 3), abs(round(match.drift_ppm))
    (1.5, 0)
    """
    pairs = [
        _make_pair(reference, other, names, settings)
        for names in product(reference.names, other.names)
        if reference.unit(names[0]) == other.unit(names[1])
    ]
    if not pairs:
        raise InputError(
            f"{_list(reference)} and {_list(other)} have no unit in common, so their clocks cannot be matched: state "
            "shift_s, or let both recorders hold an acceleration"
        )
    found = [(_find_offset(pair, offset_std_s, drift_std_ppm, settings), pair) for pair in pairs]
    (offset_s, drift, peak), pair = max(found, key=lambda each: each[0][2])
    period_s = _find_period(pair, settings)
    if period_s is not None:
        raise InputError(
            f"the offset between the clocks of {pair.names[0]!r} and {pair.names[1]!r} is ambiguous: {offset_s:.3f} s "
            f"and {period_s:.3f} s more or less fit nearly as well, because the motion is periodic: give start_s and "
            "stop_s of a part that is not, or state shift_s and shift_tolerance_s = 0"
        )
    windows = _Windows(pair, settings)
    coherence = windows.coherence(offset_s, drift)
    if peak < settings.least_peak or np.mean(coherence > 0.5) < settings.shared:
        low_hz, high_hz = settings.band_hz
        raise InputError(
            f"the clocks of {pair.names[0]!r} and {pair.names[1]!r} cannot be matched: at the best of all offsets, "
            f"{offset_s:.3f} s, their median coherence from {low_hz:g} to {high_hz:g} Hz is "
            f"{np.median(coherence):.2f}, above a half on {np.mean(coherence > 0.5):.0%} of the lines "
            f"({settings.shared:.0%} are needed), and the peak of their correlation is {peak:.1f} times its rms "
            f"({settings.least_peak:g} are needed): check that both files are of this run, or state a larger "
            "drift_tolerance_ppm, or shift_s and shift_tolerance_s = 0"
        )
    return windows.match(offset_s, drift, other.names)


def _list(recording: Recording) -> str:
    return ", ".join(recording.names)


def _make_pair(one: Recording, other: Recording, names: tuple[str, str], settings: ClockMatchSettings) -> _Pair:
    fs = min(settings.rate_hz, one.fs, other.fs)
    sides = []
    for recording, name in zip((one, other), names, strict=True):
        column = [recording.index(name)]
        alone = Recording(recording.samples[:, column], recording.fs, (recording.channels[column[0]],))
        samples = resampled(alone, fs).samples[:, 0]
        sides.append(samples - samples.mean())
    return _Pair(names, sides[0], sides[1], fs, (one.start_s, other.start_s))


def _find_offset(
    pair: _Pair, offset_std_s: float, drift_std_ppm: float, settings: ClockMatchSettings
) -> tuple[float, float, float]:
    """Return offset, s, drift, and the peak of the correlation over its rms.

    A drift smears the peak, so that the correlation is computed for several.
    """
    from scipy import fft, interpolate

    fs, n_first, n_second = pair.fs, pair.first.size, pair.second.size
    n = fft.next_fast_len(n_first + 2 * n_second, real=True)
    lead_s, steps = pair.starts_s[0] - pair.starts_s[1], np.arange(n)
    lags_s = np.where(steps < n / 2, steps, steps - n) / fs  # by which the second record is moved later
    overlap_s = np.minimum(n_first / fs, lags_s + n_second / fs) - np.maximum(0.0, lags_s)
    allowed = (np.abs(lags_s + lead_s) <= 3 * offset_std_s) & (overlap_s >= settings.least_overlap_s)
    if not allowed.any():
        raise InputError(
            f"{pair.names[0]!r} and {pair.names[1]!r} have less than {settings.least_overlap_s:g} s in common for any "
            f"offset up to {3 * offset_std_s:g} s: check that both files are of this run, or state shift_s"
        )
    one, reach = _whiten(pair.first, n, fs, settings), 3e-6 * drift_std_ppm
    # Between two drifts the ends of the record move by half a period of the middle of the band.
    step, middle = fs / (sum(settings.band_hz) * n_second), 0.5 * (n_second - 1)
    spline = interpolate.make_interp_spline(np.arange(n_second), pair.second, k=3)
    tried = []
    for drift in np.arange(-np.ceil(reach / step), np.ceil(reach / step) + 1) * step:
        samples = spline(np.clip(middle + (np.arange(n_second) - middle) / (1 + drift), 0, 2 * middle))
        correlation = fft.irfft(one * np.conj(_whiten(samples, n, fs, settings)), n)
        # The rms is that at full overlap.
        rms = np.sqrt(np.sum(correlation**2) * min(n_first, n_second) / (float(n_first) * n_second))
        size = np.where(allowed, np.abs(correlation), 0.0) / max(rms, 1e-300)
        top = int(size.argmax())
        tried.append((float(lags_s[top] + lead_s), float(drift), float(size[top])))
    return max(tried, key=lambda each: each[2])


def _find_period(pair: _Pair, settings: ClockMatchSettings) -> float | None:
    """Return the period of the motion of the reference, s; None if it is not periodic."""
    from scipy import fft, signal

    n_lags = pair.first.size // 2
    n = fft.next_fast_len(2 * pair.first.size, real=True)
    own = fft.irfft(np.abs(_whiten(pair.first, n, pair.fs, settings)) ** 2, n)[:n_lags]
    own *= 1 / (own[0] * (1 - np.arange(n_lags) / pair.first.size))
    own[: round(settings.lobe_s * pair.fs)] = 0.0
    if own.max() <= settings.ambiguous:
        return None
    return float(signal.find_peaks(own, height=0.9 * own.max())[0][0]) / pair.fs


def _whiten(samples: FloatArray, n: int, fs: float, settings: ClockMatchSettings) -> ComplexArray:
    """Return the transform of n samples, divided by the square root of the density in the band and 0 outside."""
    from scipy import fft, signal

    size = min(samples.size, round(settings.window_s * fs))
    # The ends of the records are no motion that both share.
    faded = samples * signal.windows.tukey(samples.size, min(1.0, size / samples.size))
    frequency_hz = fft.rfftfreq(n, 1 / fs)
    inside = (frequency_hz >= settings.band_hz[0]) & (frequency_hz <= min(settings.band_hz[1], 0.4 * fs))
    f, density = signal.welch(samples, fs, nperseg=size)
    # Where a tone leaves little else, the remainder is its leakage.
    known = np.interp(frequency_hz, f, density + 1e-4 * density.max())
    return np.asarray(fft.rfft(faded, n) * inside / np.sqrt(known + 1e-300))


class _Windows:
    """The lags of two channels in windows, relative to the transfer that all windows have in common."""

    def __init__(self, pair: _Pair, settings: ClockMatchSettings) -> None:
        from scipy import interpolate

        self.pair, self.settings, fs = pair, settings, pair.fs
        self.times_s = pair.starts_s[0] + np.arange(pair.first.size) / fs
        self.stamps_s = (pair.starts_s[1], pair.starts_s[1] + (pair.second.size - 1) / fs)
        self._second = interpolate.make_interp_spline(np.arange(pair.second.size), pair.second, k=5)
        self.middle_s = 0.5 * sum(self.stamps_s)

    def _align(self, offset_s: float, drift: float) -> tuple[np.ndarray, FloatArray]:
        """Return the common samples of the first channel, and the second channel at their times."""
        stamps_s = (self.times_s - offset_s + drift * self.middle_s) / (1 + drift)
        inside = np.flatnonzero((stamps_s >= self.stamps_s[0]) & (stamps_s <= self.stamps_s[1]))
        return inside, self._second((stamps_s[inside] - self.stamps_s[0]) * self.pair.fs)

    def _transform(self, offset_s: float, drift: float) -> tuple[FloatArray, FloatArray, ComplexArray, ComplexArray]:
        """Return the middles of the windows, s, the lines, Hz, and both transforms, (n_windows, n_lines)."""
        fs, settings = self.pair.fs, self.settings
        inside, second = self._align(offset_s, drift)
        size = round(settings.window_s * fs)
        if inside.size < max(size, settings.least_overlap_s * fs):
            raise InputError(
                f"{self.pair.names[0]!r} and {self.pair.names[1]!r} have {inside.size / fs:.3g} s in common, "
                f"{settings.least_overlap_s:g} s are needed to match their clocks: give longer records or state shift_s"
            )
        starts = np.arange(0, inside.size - size + 1, size // 2)
        cut = [np.stack([each[k : k + size] for k in starts]) for each in (self.pair.first[inside], second)]
        one, other = (np.fft.rfft((each - each.mean(axis=1, keepdims=True)) * np.hanning(size)) for each in cut)
        frequency_hz = np.fft.rfftfreq(size, 1 / fs)
        high_hz = min(settings.band_hz[1], 0.4 * fs)
        lines = (frequency_hz >= settings.band_hz[0]) & (frequency_hz <= high_hz)
        at_s = np.asarray(self.times_s[inside[0] + starts] + 0.5 * size / fs, dtype=np.float64)
        return at_s, np.asarray(frequency_hz[lines], dtype=np.float64), one[:, lines], other[:, lines]

    def coherence(self, offset_s: float, drift: float) -> FloatArray:
        """Return the coherence of the lines of the band, without what chance adds."""
        _, _, one, other = self._transform(offset_s, drift)
        return _compute_coherence(one, other)

    def match(self, offset_s: float, drift: float, channels: tuple[str, ...]) -> ClockMatch:
        """Return the match, refined from a first offset and drift."""
        settings = self.settings
        for _ in range(4):
            at_s, frequency_hz, one, other = self._transform(offset_s, drift)
            coherence = _compute_coherence(one, other)
            transfer = np.sum(np.conj(one) * other, axis=0)
            lag_s, agree = _find_lags(frequency_hz, one, other, coherence, transfer)
            good = agree >= settings.coherent
            least, fraction = settings.least_windows
            if good.sum() < max(least, fraction * good.size):
                raise InputError(
                    f"the clocks of {self.pair.names[0]!r} and {self.pair.names[1]!r} go together in only "
                    f"{good.sum()} of {good.size} windows of {settings.window_s:g} s, at a coherence of "
                    f"{np.median(coherence):.2f}: a clock jumps, or the sensors share their motion only at times; give "
                    "start_s and stop_s of a part in which they do"
                )
            at_s, lag_s = at_s[good], lag_s[good]
            slope, middle = np.polyfit(at_s - at_s.mean(), lag_s, 1)
            # The window's lag is that of the other channel: its clock is to be moved earlier.
            drift -= slope * (1 + drift)
            offset_s -= middle + slope * (self.middle_s + offset_s - at_s.mean())
        left_s = lag_s - middle - slope * (at_s - at_s.mean())
        self._require_no_jump(at_s, left_s)
        self._require_no_long_jump(offset_s, drift)
        delay_s, phase = _find_delay_of_suspension(frequency_hz, transfer, coherence)
        scatter_s = float(np.std(left_s)) * np.sqrt(2.0)  # windows overlap by half
        length_s = float(at_s[-1] - at_s[0]) + settings.window_s
        slope_std = scatter_s * np.sqrt(12.0 / at_s.size) / length_s
        offset_std_s = np.hypot(max(settings.transfer_s, phase / (2 * np.pi * 10.0)), scatter_s / np.sqrt(at_s.size))
        return ClockMatch(
            channels=channels,
            pair=self.pair.names,
            offset_s=float(offset_s - delay_s),
            offset_std_s=float(offset_std_s),
            drift_ppm=1e6 * float(drift),
            drift_std_ppm=1e6 * float(np.hypot(slope_std, settings.transfer_drift_s / length_s)),
            middle_s=self.middle_s,
            coherence=float(np.median(coherence)),
            at_s=at_s,
            lag_s=left_s,
        )

    def _require_no_long_jump(self, offset_s: float, drift: float) -> None:
        """Raise an error if a part of the record alone has another offset."""
        settings, fs = self.settings, self.pair.fs
        inside, second = self._align(offset_s, drift)
        n_parts = min(4, int(inside.size / fs / settings.least_overlap_s))
        for one, other in zip(np.array_split(inside, n_parts), np.array_split(second, n_parts), strict=True):
            begin_s, end_s = float(self.times_s[one[0]]), float(self.times_s[one[-1]])
            part = _Pair(self.pair.names, self.pair.first[one], other, fs, (begin_s, begin_s))
            shift_s, _, peak = _find_offset(part, settings.least_overlap_s, 0.0, replace(settings, least_overlap_s=0.0))
            if peak > settings.least_peak and abs(shift_s) > settings.far_s:
                raise InputError(
                    f"the clock of {self.pair.names[0]!r} or {self.pair.names[1]!r} jumps: from {begin_s:.0f} s to "
                    f"{end_s:.0f} s the offset between them differs by {shift_s:+.3f} s from that of the whole record: "
                    "give start_s and stop_s of a part on one side of the jump"
                )

    def _require_no_jump(self, at_s: FloatArray, left_s: FloatArray) -> None:
        """Raise an error if a jump explains most of what a straight line leaves of the lags."""
        settings, total = self.settings, float(left_s @ left_s)
        basis = np.stack([np.ones_like(at_s), at_s - at_s.mean()], axis=1)
        for k in range(2, at_s.size - 1):
            columns = np.column_stack([basis, np.arange(at_s.size) >= k])
            values = np.linalg.lstsq(columns, left_s, rcond=None)[0]
            rest = float(np.sum((left_s - columns @ values) ** 2))
            if abs(values[2]) > settings.jump_s and rest < (1 - settings.jump_explains) * total:
                raise InputError(
                    f"the clock of {self.pair.names[0]!r} or {self.pair.names[1]!r} jumps by about "
                    f"{1e3 * abs(values[2]):.0f} ms near {0.5 * (at_s[k - 1] + at_s[k]):.0f} s, and no straight line "
                    "matches them: give start_s and stop_s of a part on one side of the jump"
                )
        if np.std(left_s) > settings.jump_s:
            raise InputError(
                f"the clocks of {self.pair.names[0]!r} and {self.pair.names[1]!r} drift apart in no straight line: the "
                f"lags of windows stray by {1e3 * np.std(left_s):.0f} ms (rms) from it, {1e3 * settings.jump_s:g} ms "
                "are accepted: give start_s and stop_s of a shorter part"
            )


def _compute_coherence(one: ComplexArray, other: ComplexArray) -> FloatArray:
    """Return the coherence of each line, without what chance adds; windows overlap by half."""
    power = np.sum(np.abs(one) ** 2, axis=0) * np.sum(np.abs(other) ** 2, axis=0)
    coherence = np.abs(np.sum(np.conj(one) * other, axis=0)) ** 2 / np.maximum(power, 1e-300)
    by_chance = 1 / (0.5 * len(one) + 0.5)
    return np.clip((coherence - by_chance) / (1 - by_chance), 0.0, 0.999)


def _find_lags(
    frequency_hz: FloatArray, one: ComplexArray, other: ComplexArray, coherence: FloatArray, transfer: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """Return the lag of the second channel in each window, s, and by how much its phases agree, up to 1.

    Phases are weighted by the inverse of their variance, which is proportional to (1 - c)/c (Bendat & Piersol, 9.3).
    """
    omega, weight = 2 * np.pi * frequency_hz, coherence / (1 - coherence)
    usual = transfer / np.maximum(np.abs(transfer), 1e-300)
    size = np.sqrt(np.mean(np.abs(one) ** 2, axis=0) * np.mean(np.abs(other) ** 2, axis=0))
    turned = weight * np.conj(one) * other * np.conj(usual) / np.maximum(size, 1e-300)
    lag_s = np.zeros(len(one))
    for _ in range(4):
        now = turned * np.exp(1j * np.outer(lag_s, omega))
        lag_s -= (now.imag @ omega) / np.maximum(np.abs(now) @ omega**2, 1e-300)
    now = turned * np.exp(1j * np.outer(lag_s, omega))
    return lag_s, now.real.sum(axis=1) / np.maximum(np.abs(now).sum(axis=1), 1e-300)


def _find_delay_of_suspension(
    frequency_hz: FloatArray, transfer: ComplexArray, coherence: FloatArray
) -> tuple[float, float]:
    """Return the delay that a suspension's phase leaves of a transfer, s, and the rms phase that both leave, rad.

    The phase is that of (1 + 2 i d r)/(1 - r^2 + 2 i d r) with r = f/f_0; places on one rigid body have a large f_0.
    """
    from scipy import optimize

    weight = np.sqrt(np.minimum(coherence / (1 - coherence), 9.0))
    weight /= np.sqrt(np.mean(weight**2)) + 1e-300

    def leave(values: FloatArray, turned: complex) -> FloatArray:
        ratio, damping = frequency_hz / np.exp(values[0]), np.exp(values[1])
        suspension = (1 + 2j * damping * ratio) / (1 - ratio**2 + 2j * damping * ratio)
        delayed = np.exp(2j * np.pi * frequency_hz * values[2])
        return np.asarray(np.angle(turned * transfer * np.conj(suspension) * delayed) * weight)

    starts = [
        (turned, np.array([np.log(f0_hz), np.log(damping), delay_s]))
        for turned in (1.0, -1.0)  # a sensor may be upside down
        for f0_hz in (*np.geomspace(0.8, 30.0, 13), 60.0)
        for damping in (0.01, 0.05, 0.25, 0.6)
        for delay_s in np.arange(-0.03, 0.031, 0.003)
    ]
    starts.sort(key=lambda each: float(np.sum(np.abs(leave(each[1], each[0])))))
    bounds = ([*np.log([0.3, 0.005]), -0.1], [*np.log([100.0, 2.0]), 0.1])
    fits = [
        optimize.least_squares(leave, start, args=(turned,), bounds=bounds, loss="soft_l1", x_scale=(0.1, 0.1, 1e-3))
        for turned, start in starts[:5]
    ]
    best = min(fits, key=lambda fit: fit.cost)
    return float(best.x[2]), float(np.sqrt(np.mean(best.fun**2)))
