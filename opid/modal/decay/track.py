"""Amplitude and phase of a free decay over time, by local least squares instead of a filter.

In each window the record is modelled as a smooth reference oscillation times a complex line (1 + alpha) + beta t, and
an offset, a trend, the harmonics 2 and 3 and the strongest neighbouring peaks. The reference comes from the round
before. No window reaches across the start of the decay, and no filter has to settle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import NotDeterminedError
from opid.modal.decay.stretch import Hum, Stretch, find_phasor, find_spectrum_peaks
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class Track:
    """The fundamental of a free decay, B(t) cos phi(t), at the centres of n windows."""

    time_s: FloatArray  # (n,) s from the first sample of the record
    amplitude: FloatArray  # (n,) B, unit of the record
    phase: FloatArray  # (n,) phi, rad
    omega: FloatArray  # (n,) phi', rad/s
    rate: FloatArray  # (n,) -B'/B, 1/s
    chirp: FloatArray  # (n,) phi'' of the smooth reference, rad/s^2
    omega_std: FloatArray  # (n,) standard deviation, rad/s
    rate_std: FloatArray  # (n,) standard deviation, 1/s
    covariance: FloatArray  # (2n, 2n) covariance of log B, then phi; neighbouring windows overlap and are correlated
    neighbours_hz: tuple[float, ...]  # frequencies that were fitted beside the mode, Hz
    unresolved_hz: tuple[float, ...]  # frequencies too close to the mode to be separated from it, Hz
    residual_fraction: float  # rms of the residual over that of the record, in the stretch used
    start_s: float  # first sample of the first window, s from the first of the record
    stop_s: float  # last sample of the last


@dataclass(frozen=True, eq=False)
class _Reference:
    """A smooth guess of the fundamental at every sample: logarithm of its amplitude, phase, rad, and their rates.

    The phase grows by `omega`, rad/s, and the logarithm falls by `rate`, 1/s.
    """

    log_amplitude: FloatArray
    phase: FloatArray
    omega: FloatArray
    rate: FloatArray


@dataclass(frozen=True, eq=False)
class _Window:
    """The fundamental in one window: the reference times value exp(slope (t - centre)).

    The window begins at the sample `first` of the stretch. Value and slope are 1 and 0 where the reference is right;
    at the time `centre`, s, they are uncorrelated. The imaginary part of the slope is that of the frequency, rad/s.
    `by_value` is the derivative of the logarithm of the value by each sample, `slope_std` holds for samples with noise
    of standard deviation 1, and `noise` is the standard deviation of white noise of the level that is seen near the
    mode. `fitted` are the samples as fitted with `weight`.
    """

    first: int
    centre: float
    value: complex
    slope: complex
    by_value: FloatArray
    slope_std: complex
    noise: float
    fitted: FloatArray
    weight: FloatArray

    @property
    def value_std(self) -> float:
        """Standard deviation of the value's real or imaginary part."""
        return self.noise * float(np.linalg.norm(self.by_value)) / np.sqrt(2.0)


def track_decay(samples: FloatArray, stretch: Stretch, *, fs: float) -> Track:
    """Follow the fundamental of a free decay from its start until it meets the noise.

    Raises:
        NotDeterminedError: a signal that does not decay, or that stands out of the noise in too few windows.
    """
    part = samples[stretch.start : stretch.stop]
    part = part - np.median(part[-max(8, part.size // 4) :])
    return _make_track(part, *_follow_best(part, stretch, fs), stretch, fs)


_Followed = tuple[list[_Window], _Reference, FloatArray, FloatArray]
"""The windows and the reference of the last round, the neighbours that were fitted and those too close."""


def widen_by_hum(track: Track, hum: Hum) -> Track:
    """Return a track whose covariance holds the error of a line that was subtracted, which all windows share."""
    turned = np.exp(1j * (2.0 * np.pi * hum.frequency_hz * track.time_s - track.phase)) / track.amplitude
    by_real, by_imaginary = (np.concatenate([each.real, each.imag]) for each in (turned, 1j * turned))
    more = 0.5 * (MODAL.hum_error * hum.std) ** 2 * (np.outer(by_real, by_real) + np.outer(by_imaginary, by_imaginary))
    return replace(track, covariance=track.covariance + more)


def _follow_best(part: FloatArray, stretch: Stretch, fs: float) -> _Followed:
    """Return what explains most of the record, of first references with one frequency and with one that glides."""
    steady, gliding, none = _guess_steady(part, stretch, fs), _guess_gliding(part, stretch, fs), np.empty(0)
    found: _Followed | None = None
    failed: NotDeterminedError | None = None
    try:
        found = _follow(part, stretch, steady, none, fs)
    except NotDeterminedError as why:
        failed = why
    most = MODAL.most_residual if found is None else MODAL.glide_gain * _find_unexplained(part, found[0])
    try:
        glided = _follow(part, stretch, gliding, none, fs)
        found = glided if _find_unexplained(part, glided[0]) < most else found
    except NotDeterminedError as why:
        failed = failed or why
    if found is not None:
        return found
    # A strong neighbour may spoil the first rounds, so those in the spectrum are now fitted from the beginning.
    strong = _find_strong_neighbours(part[: stretch.sure_stop - stretch.start], stretch, fs)
    if not strong.size:
        raise failed or NotDeterminedError("the decay cannot be followed: give near_hz, start_s and stop_s")
    try:
        return _follow(part, stretch, steady, strong, fs)
    except NotDeterminedError:
        raise NotDeterminedError(
            f"what lies at {stretch.frequency_hz:.4g} and {strong[0]:.4g} Hz cannot be separated in one signal: if "
            "these are modes that beat, separate them with several sensors (a modal filter); if it is one mode whose "
            "frequency moves fast, begin later with start_s; if it is noise, give another stretch"
        ) from None


def _guess_steady(part: FloatArray, stretch: Stretch, fs: float) -> _Reference:
    """Return the first reference: one frequency and one rate."""
    omega = 2.0 * np.pi * stretch.frequency_hz
    rate = max(stretch.rate, 1e-4 * omega)
    time = np.arange(part.size) / fs
    amplitude = np.sqrt(2.0) * float(part[: max(8, round(fs * 2 * np.pi / omega))].std()) + 1e-300
    return _Reference(
        np.log(amplitude) - rate * time, omega * time, np.full(time.size, omega), np.full(time.size, rate)
    )


def _guess_gliding(part: FloatArray, stretch: Stretch, fs: float) -> _Reference:
    """Return a first reference whose frequency moves with the amplitude, both from the phase of a short kernel.

    A window in which the frequency moves by a cycle follows no reference of one frequency.
    """
    from scipy.integrate import cumulative_trapezoid

    n, time = stretch.sure_stop - stretch.start, np.arange(part.size) / fs
    turned = find_phasor(part[:n], fs=fs, frequency_hz=stretch.frequency_hz)
    height = np.abs(turned)
    edge = min(round(0.5 * MODAL.kernel_cycles * fs / stretch.frequency_hz), n // 4)
    inside = slice(edge, n - edge)
    omega = 2.0 * np.pi * stretch.frequency_hz + np.gradient(np.unwrap(np.angle(turned)), 1.0 / fs)
    log_of = np.polynomial.Polynomial.fit(
        time[inside], np.log(height[inside] + 1e-300), 5, w=np.sqrt(height[inside]), domain=[0.0, n / fs]
    )
    ahead = max(stretch.rate, 1e-4 * omega[edge])
    rate = np.clip(-log_of.deriv()(time), 0.2 * ahead, 20.0 * ahead)
    rate[n:] = ahead
    log_amplitude = -cumulative_trapezoid(rate, dx=1.0 / fs, initial=0.0)
    root = np.exp(0.5 * log_amplitude)
    weight, powers = height[inside, None], np.arange(4)
    by_root = np.linalg.lstsq(weight * root[inside, None] ** powers, weight[:, 0] * omega[inside], rcond=1e-12)[0]
    middle = float(np.median(omega[inside]))
    moved = np.clip(root[:, None] ** powers @ by_root, 0.8 * middle, 1.25 * middle)
    return _Reference(
        log_amplitude + float(log_of(time[edge])) - log_amplitude[edge],
        cumulative_trapezoid(moved, dx=1.0 / fs, initial=0.0),
        moved,
        rate,
    )


def _follow(part: FloatArray, stretch: Stretch, reference: _Reference, neighbours: FloatArray, fs: float) -> _Followed:
    """Return what a first reference leads to."""
    n_sure = stretch.sure_stop - stretch.start

    def fit_early(reference: _Reference, neighbours: FloatArray) -> list[_Window]:
        return _fit_windows(part[:n_sure], reference, neighbours, fs=fs, until_noise=False)

    for _ in range(2):  # with the round that makes `windows`, three rounds come before the search for neighbours
        reference = _renew_reference(fit_early(reference, neighbours), reference, fs)
    windows = fit_early(reference, neighbours)
    close: list[float] = []
    own: list[float] = []
    for _ in range(MODAL.most_neighbours):
        found, resolved = _find_next_neighbour(part[:n_sure], reference, windows, [*neighbours, *close, *own], fs)
        if found is None:
            break
        if not resolved:
            close.append(found)
            continue
        more = np.append(neighbours, found)
        renewed = _renew_reference(fit_early(reference, more), reference, fs)
        refitted = fit_early(renewed, more)
        # A line that explains nothing is what the fit left of a mode whose frequency moves.
        if _find_unexplained(part, refitted) > _find_unexplained(part, windows):
            own.append(found)
        else:
            neighbours, reference, windows = more, renewed, refitted
    reference = _renew_reference(windows, reference, fs)
    for _ in range(2):  # further rounds no longer change the reference
        reference = _renew_reference(_fit_windows(part, reference, neighbours, fs=fs, until_noise=True), reference, fs)
    return _fit_windows(part, reference, neighbours, fs=fs, until_noise=True), reference, neighbours, np.array(close)


def _find_strong_neighbours(part: FloatArray, stretch: Stretch, fs: float) -> FloatArray:
    own = stretch.frequency_hz
    frequency, height, _ = find_spectrum_peaks(part, fs=fs, low_hz=0.75 * own, high_hz=min(1.33 * own, 0.48 * fs))
    if not height.size:
        return frequency
    return frequency[(np.abs(frequency - own) > 2.0 * fs / part.size) & (height > 0.1 * height[0])][:2]


def _fit_windows(
    part: FloatArray, reference: _Reference, neighbours: FloatArray, *, fs: float, until_noise: bool
) -> list[_Window]:
    """Return windows that overlap by half, from the start until the decay reaches the noise."""
    windows: list[_Window] = []
    shortest_hop = max(1, part.size // MODAL.most_windows)
    first, weak, whole = 0, 0, float(np.ptp(part))
    while first < part.size:
        length = _choose_length(part.size, reference, first, neighbours, fs)
        if first + length > part.size or np.ptp(part[first : first + length]) <= 1e-9 * whole:
            break
        if first == 0:
            # The start gets half a window, which is highest at its first sample.
            shortest = round(MODAL.fewest_window_cycles / 1.5 * fs * 2 * np.pi / reference.omega[0])
            short = max(length // 2, min(length, shortest))
            falling = 0.5 * (1.0 + np.cos(np.pi * (np.arange(short) + 0.5) / short))
            windows.append(_fit_window(part, 0, falling, reference, neighbours, fs))
        hann = np.hanning(length + 2)[1:-1]
        windows.append(_fit_window(part, first, hann, reference, neighbours, fs))
        last = windows[-1]
        signal = abs(last.value) * np.exp(reference.log_amplitude[min(part.size - 1, round(last.centre * fs))])
        spread = last.value_std * signal / max(abs(last.value), 1e-300)
        weak = weak + 1 if signal < MODAL.smallest_signal * spread else 0
        if weak >= 2 and until_noise:
            del windows[-2:]
            break
        first += max(length // 2, shortest_hop)
    if len(windows) < 3:
        raise NotDeterminedError(
            "no decaying oscillation of one mode stands out of the noise: give a frequency at which a mode rings "
            "(near_hz), or the times of its decay (start_s, stop_s); where two modes beat, separate them with several "
            "sensors"
        )
    return windows


def _choose_length(n: int, reference: _Reference, first: int, neighbours: FloatArray, fs: float) -> int:
    cycle = 2.0 * np.pi / reference.omega[first]
    wanted = MODAL.window_decay / max(reference.rate[first], 1e-9)
    fewest = MODAL.fewest_window_cycles * cycle
    if neighbours.size:
        distance = float(np.min(np.abs(neighbours - reference.omega[first] / (2 * np.pi))))
        fewest = max(fewest, MODAL.resolved / max(distance, 1e-9))
    most = n / fs / 5.0
    least = max(min(fewest, n / fs / 2.5), MODAL.fewest_window_cycles / 1.5 * cycle)
    return int(max(min(max(wanted, fewest), most), least) * fs)


def _renew_reference(windows: list[_Window], reference: _Reference, fs: float) -> _Reference:
    """Return a smooth reference: frequency and rate as polynomials in the root of the amplitude, by all windows."""
    from scipy.integrate import cumulative_trapezoid

    time = np.arange(reference.phase.size) / fs
    centres = np.array([w.centre for w in windows])
    seen = np.log(np.maximum(np.abs([w.value for w in windows]), 1e-300))
    log_seen = np.interp(centres, time, reference.log_amplitude) + seen
    omega = np.interp(centres, time, reference.omega) + np.imag([w.slope for w in windows])
    rate = np.interp(centres, time, reference.rate) - np.real([w.slope for w in windows])
    # All windows have one noise level: where it seems larger at the start, the reference is wrong there.
    noise = max(float(np.median([w.noise for w in windows])), 1e-300)
    if not np.median(rate) > 0.0:
        raise NotDeterminedError(
            "the signal does not decay in the stretch given: give start_s and stop_s of a free decay"
        )
    if np.median(rate) > MODAL.most_followed * np.median(omega):
        raise NotDeterminedError(
            f"what decays in the stretch given has a damping ratio above {MODAL.most_followed:g}, which is no "
            "oscillation: give near_hz, or start_s and stop_s of a free decay"
        )
    root = np.exp(0.5 * (log_seen - log_seen.max()))
    degree = min(4, max(0, len(windows) // 5))
    by_omega = _fit_smooth(root, omega, np.array([w.slope_std.imag for w in windows]) * noise, degree)
    by_rate = _fit_smooth(
        root, rate, np.array([w.slope_std.real for w in windows]) * noise, degree, may_have_friction=True
    )
    # The amplitude follows its own rate, sample by sample, and meets those of the windows on average.
    order = np.argsort(centres)
    log_of = np.interp(time, centres[order], np.minimum.accumulate(log_seen[order]))
    ahead = max(float(np.median(rate)), 1e-6)
    at_start = float(np.clip(rate[order[0]], ahead, 3.0 * ahead))
    log_of = log_of + np.maximum(centres.min() - time, 0.0) * at_start - np.maximum(time - centres.max(), 0.0) * ahead
    # A rate that is far off grows without an end before the first window.
    inside = np.clip(np.exp(np.minimum(0.5 * (log_of - log_seen.max()), 1.0)), root.min(), 1.3)
    new_rate = np.maximum(by_rate(inside), 0.2 * ahead)
    new_omega = np.clip(by_omega(inside), 0.8 * np.median(omega), 1.25 * np.median(omega))
    log_amplitude = -cumulative_trapezoid(new_rate, dx=1.0 / fs, initial=0.0)
    weight = 1.0 / np.maximum([w.value_std for w in windows], 1e-9) ** 2
    log_amplitude += np.sum(weight * (log_seen - np.interp(centres, time, log_amplitude))) / weight.sum()
    # The logarithm is limited far outside the amplitudes that were seen, so that nothing overflows.
    log_amplitude = np.clip(log_amplitude, log_seen.max() - 40.0, log_seen.max() + 10.0)
    return _Reference(log_amplitude, cumulative_trapezoid(new_omega, dx=1.0 / fs, initial=0.0), new_omega, new_rate)


def _fit_smooth(
    x: FloatArray, y: FloatArray, std: FloatArray, degree: int, *, may_have_friction: bool = False
) -> Callable[[FloatArray], FloatArray]:
    """Return the curve with the least Bayesian criterion, fitted without outliers.

    It is a polynomial in x, the root of the amplitude; that of a rate may have a term 1 / x^2, which is dry friction.
    """
    std = np.maximum(std, 1e-9 * np.median(np.abs(y)) + 1e-300)
    keep = np.ones(x.size, dtype=bool)
    best: tuple[float, list[int], FloatArray] = (np.inf, [0], np.array([np.median(y)]))
    forms = [[*range(power + 1)] for power in range(degree + 1)]
    forms += [[*powers, -2] for powers in forms if may_have_friction and degree > 0]

    def predict(powers: list[int], values: FloatArray, at: FloatArray) -> FloatArray:
        return np.asarray(at[:, None] ** np.array(powers, dtype=np.float64) @ values)

    for _ in range(2):
        best = (np.inf, *best[1:])
        n = int(keep.sum())
        for powers in forms:
            columns = x[keep, None] ** np.array(powers, dtype=np.float64)
            values = np.linalg.lstsq(columns / std[keep, None], y[keep] / std[keep], rcond=1e-12)[0]
            misfit = float(np.sum(((y[keep] - columns @ values) / std[keep]) ** 2))
            score = float(n * np.log(max(misfit / n, 0.1)) + len(powers) * np.log(n))
            if powers[-1] < 0:
                score = score + MODAL.joint_evidence if values[-1] > 0.0 else np.inf
            if score < best[0]:
                best = (score, powers, np.asarray(values, dtype=np.float64))
        departure = np.abs(y - predict(*best[1:], x)) / std
        keep = departure <= max(5.0 * float(np.median(departure)), 5.0)
        if keep.sum() < degree + 3:
            break
    return lambda at: predict(*best[1:], at)


def _find_next_neighbour(
    part: FloatArray, reference: _Reference, windows: list[_Window], known: list[float], fs: float
) -> tuple[float | None, bool]:
    """Return the strongest frequency beside the mode that is not known yet, Hz, and whether it can be separated."""
    size, time = part.size, np.arange(part.size) / fs
    main = np.exp(reference.log_amplitude[:size] + 1j * reference.phase[:size])
    windows = sorted(windows, key=lambda window: window.centre)
    centres, values = np.array([w.centre for w in windows]), np.array([w.value for w in windows])
    logs = np.log(np.maximum(np.abs(values), 1e-6)) + 1j * np.unwrap(np.angle(values))
    trust = np.exp(reference.log_amplitude[np.minimum(size - 1, np.round(centres * fs).astype(np.int64))])
    # The curve is slow, for one that follows every window would take up the beat with a neighbour.
    degree = min(3, len(windows) // 4)
    # Where the first reference runs away, hardly any window is trusted: least squares then take the smallest curve.
    powers, at = (np.vander(each / time[-1], degree + 1) for each in (centres, time))
    weighed = trust[:, None] * powers
    unit = np.maximum(np.linalg.norm(weighed, axis=0), 1e-300)
    slow = [np.linalg.lstsq(weighed / unit, trust * each, rcond=None)[0] for each in (logs.real, logs.imag)]
    shift = [at @ (each / unit) for each in slow]
    shift[0] = np.clip(shift[0], logs.real.min(), logs.real.max())
    remainder = part - (main * np.exp(shift[0] + 1j * shift[1])).real
    own = float(np.median(reference.omega)) / (2.0 * np.pi)
    highest = min(MODAL.highest_neighbour * own, 0.48 * fs)
    frequency, height, floor = find_spectrum_peaks(remainder, fs=fs, low_hz=0.3 * own, high_hz=highest)
    largest = float(find_spectrum_peaks(part, fs=fs, low_hz=0.9 * own, high_hz=1.1 * own)[1].max(initial=0.0))
    swept = reference.omega[:size] / (2.0 * np.pi)
    rate = float(np.median(reference.rate))
    width = 3.0 * max(1.0 / (size / fs), rate / (2.0 * np.pi), 0.004 * own)
    apart = (frequency < swept.min() - width) | (frequency > swept.max() + width)
    # The harmonics of the mode are in the remainder, and glide with it.
    for harmonic in (2, 3):
        below, above = harmonic * swept.min() - 0.06 * own, harmonic * swept.max() + 0.06 * own
        apart &= (frequency < below) | (frequency > above)
    apart &= np.min(np.abs(frequency[:, None] - np.array(known)), axis=1, initial=np.inf) > width
    apart &= height > max(MODAL.smallest_neighbour * largest, 6.0 * floor)
    # A window that is longer than the decay itself separates nothing.
    longest = min(size / fs / 2.5, MODAL.longest_decay / max(rate, 1e-9))
    resolved = np.abs(frequency - own) * longest > MODAL.resolved
    # A close and weak peak may be a residual of the mode itself.
    found = np.flatnonzero(apart & (resolved | (height > MODAL.unresolved * largest)))
    return (float(frequency[found[0]]), bool(resolved[found[0]])) if found.size else (None, False)


def _make_track(
    part: FloatArray,
    windows: list[_Window],
    reference: _Reference,
    neighbours: FloatArray,
    close: FloatArray,
    stretch: Stretch,
    fs: float,
) -> Track:
    windows = sorted(windows, key=lambda window: window.centre)
    if len(windows) < MODAL.fewest_windows:
        raise NotDeterminedError(
            f"the decay stands out of the noise in {len(windows)} windows of {MODAL.fewest_window_cycles:g} cycles or "
            f"more: at least {MODAL.fewest_windows} are needed; record with less noise or a stronger impact"
        )
    time = np.arange(part.size) / fs
    centres = np.array([window.centre for window in windows])
    values = np.array([window.value for window in windows])
    slopes = np.array([window.slope for window in windows])
    noise = _pool_noise(np.array([window.noise for window in windows]))
    spreads = np.array([window.slope_std for window in windows])
    rate = np.interp(centres, time, reference.rate) - slopes.real
    return Track(
        time_s=stretch.start / fs + centres,
        amplitude=np.exp(np.interp(centres, time, reference.log_amplitude)) * np.abs(values),
        phase=np.interp(centres, time, reference.phase) + np.unwrap(np.angle(values)),
        omega=np.interp(centres, time, reference.omega) + slopes.imag,
        rate=rate,
        chirp=np.interp(centres, time, np.gradient(reference.omega, 1.0 / fs)),
        omega_std=noise * spreads.imag,
        rate_std=noise * spreads.real,
        covariance=_find_covariance(windows, noise),
        neighbours_hz=tuple(neighbours.tolist()),
        unresolved_hz=tuple(close.tolist()),
        residual_fraction=_find_unexplained(part, windows),
        start_s=stretch.start / fs,
        stop_s=(stretch.start + max(window.first + window.weight.size for window in windows) - 1) / fs,
    )


def _pool_noise(noise: FloatArray) -> FloatArray:
    """Return a running rms over seven windows: the noise is steady, but its estimate from eight numbers is not."""
    return np.array([np.sqrt(np.mean(noise[max(0, k - 3) : k + 4] ** 2)) for k in range(noise.size)])


def _find_covariance(windows: list[_Window], noise: FloatArray) -> FloatArray:
    n = len(windows)
    covariance = np.zeros((2 * n, 2 * n))
    parts = [np.stack([window.by_value.real, window.by_value.imag]) for window in windows]
    for i, one in enumerate(windows):
        for j, other in enumerate(windows[i:], start=i):
            low = max(one.first, other.first)
            high = min(one.first + one.by_value.size, other.first + other.by_value.size)
            if low < high:
                a, b = (
                    parts[i][:, low - one.first : high - one.first],
                    parts[j][:, low - other.first : high - other.first],
                )
                block = noise[i] * noise[j] * a @ b.T
                covariance[np.ix_((i, n + i), (j, n + j))] = block
                covariance[np.ix_((j, n + j), (i, n + i))] = block.T
    return covariance


def _find_unexplained(part: FloatArray, windows: list[_Window]) -> float:
    """Return the rms of the residual over that of the record, both weighted as in the windows."""
    left = whole = 0.0
    for window in windows:
        y = part[window.first : window.first + window.weight.size]
        left += float(window.weight @ (y - window.fitted) ** 2)
        whole += float(window.weight @ y**2)
    return float(np.sqrt(left / whole)) if whole > 0.0 else 0.0


def _fit_window(
    part: FloatArray, first: int, weight: FloatArray, reference: _Reference, neighbours: FloatArray, fs: float
) -> _Window:
    """Fit one window, which begins at the sample `first`, by weighted least squares."""
    inside = slice(first, first + weight.size)
    y = part[inside]
    time = (first + np.arange(weight.size)) / fs
    height = np.exp(reference.log_amplitude[inside])
    # About the centre of the information alpha and beta are uncorrelated.
    centre = float(np.sum(weight * height**2 * time) / np.sum(weight * height**2))
    since = (time - centre) / (weight.size / fs)
    phase = reference.phase[inside]
    turning = height * np.exp(1j * phase)
    main = np.column_stack([turning.real, -turning.imag, since * turning.real, -since * turning.imag])
    columns = [main, np.ones((weight.size, 1)) * height.max(), since[:, None] * height.max()]
    omega = float(reference.omega[first])
    for harmonic in (2, 3):
        if harmonic * omega < 0.9 * np.pi * fs:
            over = height**harmonic / height.max() ** (harmonic - 1) * np.exp(1j * harmonic * phase)
            columns.append(np.column_stack([over.real, over.imag]))
    for frequency in neighbours:
        turn = height.max() * np.exp(2j * np.pi * frequency * (time - centre))
        columns.append(np.column_stack([turn.real, turn.imag, since * turn.real, since * turn.imag]))
    x = np.column_stack(columns)
    scale = np.sqrt(weight @ x**2)
    x = x / scale
    weighted = weight[:, None] * x
    solve = np.linalg.pinv(x.T @ weighted, rcond=1e-10, hermitian=True) @ weighted.T
    solution = solve @ y
    fitted = x @ solution
    residual = y - fitted
    functional = solve[:4] / scale[:4, None]
    alpha_r, alpha_i, beta_r, beta_i = (solution[:4] / scale[:4]).tolist()
    value, slope = complex(alpha_r, alpha_i) or 1e-12 + 0j, complex(beta_r, beta_i)
    # The weight comes from the reference and not from the value found: noise that makes the value small must not also
    # lower its weight.
    turn_back = np.exp(-1j * np.angle(value))
    by_value = (functional[0] + 1j * functional[1]) * turn_back
    by_slope = (functional[2] + 1j * functional[3]) * turn_back - (slope / value) * by_value
    span = weight.size / fs
    spread = complex(float(np.linalg.norm(by_slope.real)), float(np.linalg.norm(by_slope.imag))) / span
    return _Window(
        first=first,
        centre=centre,
        value=value,
        slope=slope / value / span,
        by_value=by_value,
        slope_std=spread,
        noise=_find_noise(x, solve, weight, residual, since, turning),
        fitted=fitted,
        weight=weight,
    )


def _find_noise(
    x: FloatArray, solve: FloatArray, weight: FloatArray, residual: FloatArray, since: FloatArray, turning: FloatArray
) -> float:
    """Return the standard deviation of the samples if their noise near the mode were white.

    It is estimated from the part of the residual that the mode times the powers 2 to 5 of time would explain: these lie
    in the band of the mode. Errors of the reference count as noise.
    """
    powers = [turning * (2.0 * since) ** 2]
    for _ in range(3):
        powers.append(powers[-1] * (2.0 * since))
    more = np.column_stack([part for each in powers for part in (each.real, each.imag)])
    more = more - x @ (solve @ more)
    gram = more.T @ (weight[:, None] * more)
    values, vectors = np.linalg.eigh(gram)
    keep = values > 1e-8 * values[-1]
    basis = (more @ vectors[:, keep]) / np.sqrt(values[keep])
    taken = basis.T @ (weight * residual)
    expected = float(np.sum((weight[:, None] * basis) ** 2))
    return float(np.sqrt(taken @ taken / max(expected, 1e-300)))
