"""Samples with irregular time stamps at equal steps: at their own times, or as if they had been equally spaced.

Stamps scatter for one of two reasons: the samples were taken at these times, or a host stamped equally spaced samples
late. The samples show which. If they were taken at t_k + j_k, where j_k is the scatter of the stamps, they hold
j_k x'(t_k) beside the motion x: noise above the band of the motion that is known except for its factor, 1 or 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from opid.signals.clock import (
    GAP,
    Clock,
    ClockError,
    line_without_stalls,
    longest_usual_step,
    plain_number,
    require_clock,
    resolution_of,
    sum_bins,
)
from opid.signals.recording import FloatArray
from opid.signals.resampling import interpolate_at

Taken = Literal["own times", "equal steps"]


@dataclass(frozen=True, kw_only=True)
class StampSettings:
    """How irregular stamps are judged.

    Args:
        least_rows: fewer rows decide nothing, and their stamps must be uniform.
        crowded: if fewer of the stamps than this fraction repeat, and the others are regular, rows were written twice,
            and the log is wrong.
        regular: the median distance of a step from the usual one, over the period, up to which stamps are regular.
        negligible: scatter of the stamps over the period (rms) that is not worth a question: a sample at a tenth of the
            rate is then off by 0.3 % of its amplitude.
        most_bridged: most rows of a gap that are interpolated: a motion below a quarter of the rate is known between
            them.
        bridged_fraction: most bridged rows over all rows.
        around: number of rows on either side of a long step whose stamps show whether rows were lost: a host that
            stalled catches up.
        sure_std: 0 or 1 is excluded at this many standard deviations of the factor.
        own_term: a line of the spectrum counts if the scatter brings this many times more power to it than it changes
            of the power that is there; in the band of the motion no scatter is seen.
        block_s: length of the blocks of the spectra, s.
        slow_s: scatter that is slower than this is no noise, but a change of the rate, s.
        plain_rate: the rate is rounded within this fraction, because the samples are interpolated anyway.
        rounds: number of corrections of the interpolation; each reduces its error by the scatter over the period.
    """

    least_rows: int = 1000
    crowded: float = 0.01
    regular: float = 0.02
    negligible: float = 0.005
    most_bridged: int = 2
    bridged_fraction: float = 0.02
    around: int = 25
    sure_std: float = 4.0
    own_term: float = 10.0
    block_s: float = 4.0
    slow_s: float = 1.0
    plain_rate: float = 1e-3
    rounds: int = 4


STAMPS = StampSettings()


@dataclass(frozen=True)
class StampEvidence:
    """What the samples of a log show about irregular stamps.

    Args:
        taken: whether the samples were resampled at their own times, or count as equally spaced.
        is_stated: whether the user stated it.
        is_sure: whether the samples decide it; if it was stated, whether they do not contradict.
        scatter_s: rms distance of the stamps from equal steps, s.
        period_s: the usual step, s.
        factor: fraction of the fast scatter that the samples show: 1 if they were taken at these times, 0 if they were
            equally spaced.
        factor_std: its standard deviation.
        repeats: whether stamps repeat, so that they cannot be the times of the samples.
        bridged: number of rows that were lost and interpolated.
        error: rms error of the samples if the choice is wrong, over their rms.
    """

    taken: Taken
    is_stated: bool
    is_sure: bool
    scatter_s: float
    period_s: float
    factor: float
    factor_std: float
    repeats: bool
    bridged: int
    error: float

    @property
    def sentence(self) -> str:
        """What was decided and why, in a sentence."""
        bridged = f"; {self.bridged} lost row(s) were interpolated" if self.bridged else ""
        if self.scatter_s < STAMPS.negligible * self.period_s:
            return f"the stamps are those of equal steps{bridged}"
        scatter = (
            f"the stamps lie {1e3 * self.scatter_s:.3g} ms (rms, {self.scatter_s / self.period_s:.2g} periods) off "
            "equal steps"
        )
        shown = f"the samples show {self.factor:.2f} of it (standard deviation {self.factor_std:.2g})"
        chosen = "resampled at their own times" if self.taken == "own times" else "taken as equally spaced"
        if self.is_stated:
            return f"{scatter}: as stated, the rows are {chosen}, and {shown}{bridged}"
        if self.repeats:
            return f"{scatter}, some stand twice, and {shown}: the rows are {chosen}{bridged}"
        if self.is_sure:
            return f"{scatter}, and {shown}, so they were {chosen}{bridged}"
        return (
            f"{scatter}, but {shown}, which decides nothing: they were {chosen}, and if that is wrong they are off by "
            f"{self.error:.2g} of their rms{bridged}; state `clock` in [log] if you know how the recorder stamps"
        )


def at_equal_steps(
    samples: FloatArray, stamps: FloatArray, *, taken: Taken | None = None, settings: StampSettings = STAMPS
) -> tuple[FloatArray, Clock, StampEvidence]:
    """Return samples with irregular stamps at equal steps, their clock, and why they were treated so.

    Args:
        samples: (n, n_channels) samples, in any units.
        stamps: (n,) time stamps, s, which may repeat but not decrease.
        taken: how the samples were taken, if it is known.
        settings: how the stamps are judged.

    Raises:
        ClockError: as `require_clock`, or a gap of more than two rows.

    >>> rng = np.random.default_rng(0)
    >>> times = np.arange(4000) / 200 + 2e-4 * rng.standard_normal(4000)
    >>> motion = lambda t: np.stack([np.sin(2 * np.pi * 3 * t) + np.sin(2 * np.pi * 7.3 * t)], axis=1)
    >>> _, _, of_true_stamps = at_equal_steps(motion(times) + 1e-3 * rng.standard_normal((4000, 1)), times)
    >>> _, _, of_late_stamps = at_equal_steps(motion(np.arange(4000) / 200), times)
    >>> of_true_stamps.taken, of_late_stamps.taken
    ('own times', 'equal steps')
    """
    time_s = np.asarray(stamps, dtype=np.float64)
    require_clock(time_s, may_repeat=True)
    steps = np.diff(time_s)
    rows = _count_rows(time_s, settings)
    n_rows = int(rows[-1]) + 1
    bridged = n_rows - rows.size
    has_twins = bool((steps == 0).any())
    period, first_s = _fit_line(rows, time_s)
    scatter = time_s - first_s - period * rows
    scatter_s = float(np.std(scatter))
    factor, factor_std = _weigh(samples, scatter, 1 / period, settings)
    rms = samples.std(axis=0)
    slope = np.gradient(samples, period, axis=0).std(axis=0)
    error = scatter_s * float(np.max(slope / np.maximum(rms, 1e-300)))
    is_regular = scatter_s < settings.negligible * period
    far = settings.sure_std * factor_std
    is_decided = (abs(factor) > far) != (abs(factor - 1) > far)
    is_own = not (is_regular or has_twins) and (abs(factor - 1) < abs(factor) or not is_decided)
    is_sure = is_regular or has_twins or is_decided
    if taken is not None:
        is_sure = not is_decided or is_own == (taken == "own times")
        is_own = taken == "own times" and not has_twins
    evidence = StampEvidence(
        "own times" if is_own else "equal steps",
        taken is not None,
        is_sure,
        scatter_s,
        period,
        factor,
        factor_std,
        has_twins,
        bridged,
        error,
    )
    if not is_own:
        clock = Clock(1 / period, first_s, 1 / period, float(np.abs(scatter).max()))
        if not bridged:
            return samples, clock, evidence
        return interpolate_at(samples, rows.astype(np.float64), n_rows, rounds=settings.rounds), clock, evidence
    fs = plain_number(1 / period, settings.plain_rate / period)
    positions = (time_s - time_s[0]) * fs
    n_new = int(np.floor(positions[-1])) + 1
    clock = Clock(fs, float(time_s[0]), 1 / period, float(np.abs(scatter).max()))
    return interpolate_at(samples, positions, n_new, rounds=settings.rounds), clock, evidence


def may_be_irregular(stamps: FloatArray, settings: StampSettings = STAMPS) -> bool:
    """Return whether irregular stamps are enough for a decision, and not due to rows that were written twice.

    Args:
        stamps: (n,) time stamps, s.
        settings: how the stamps are judged.
    """
    if stamps.size < settings.least_rows:
        return False
    steps = np.diff(stamps)
    n_twins, usual = int((steps == 0).sum()), float(np.median(steps))
    is_regular = float(np.median(np.abs(steps - usual))) <= settings.regular * usual
    return n_twins == 0 or n_twins > settings.crowded * stamps.size or not is_regular


def is_uniform(time_s: FloatArray, clock: Clock, settings: StampSettings = STAMPS) -> bool:
    """Return whether stamps lie as near to a uniform clock as their rounding allows.

    Args:
        time_s: (n,) time stamps, s.
        clock: the clock.
        settings: how the stamps are judged.
    """
    off = time_s - clock.start_s - np.arange(time_s.size) / clock.fs_as_written
    # Rounding to q scatters by q/sqrt(12).
    usual = np.hypot(settings.negligible / clock.fs, 0.35 * resolution_of(time_s))
    return float(np.std(off)) <= usual


def _count_rows(time_s: FloatArray, settings: StampSettings) -> np.ndarray:
    """Return the number of each row, with the rows that were lost before it.

    A host that stalls stamps some rows late and then catches up; after lost rows the stamps stay late.

    Raises:
        ClockError: a gap of more rows than are interpolated, or too many gaps.
    """
    steps = np.diff(time_s)
    stride = min(8, steps.size)
    period = float(np.median(time_s[stride:] - time_s[:-stride])) / stride
    if period <= 0:
        period = float(time_s[-1] - time_s[0]) / steps.size
    off = time_s - period * np.arange(time_s.size)
    # A stall shows in the steps, a burst in their repetition.
    longest_s = longest_usual_step(steps, period) if (steps == 0).any() else GAP * period
    lost = np.zeros(time_s.size, dtype=np.int64)
    around = settings.around
    for row in (np.flatnonzero(steps > longest_s) + 1).tolist():
        # A fifth of the rows after a stall are in time again.
        before, behind = (np.quantile(each, 0.2) for each in (off[max(0, row - around) : row], off[row : row + around]))
        after = float(behind - before)
        lost[row] = max(0, round(after / period))
        if lost[row] > settings.most_bridged:
            raise ClockError(
                f"the time jumps from {time_s[row - 1]:.9g} s to {time_s[row]:.9g} s where steps of {period:.6g} s are "
                f"usual (about {lost[row]} sample(s) lost, and {settings.most_bridged} are interpolated at the most): "
                "split the log at the gap, or choose a stretch without it (start_s, stop_s)",
                row,
            )
    if lost.sum() > settings.bridged_fraction * lost.size:
        row = int(np.flatnonzero(lost)[0])
        raise ClockError(
            f"{lost.sum()} rows were lost one or two at a time, the first before {time_s[row]:.9g} s, which is more "
            f"than {settings.bridged_fraction:.0%} of all: record without losses, or choose a stretch with fewer",
            row,
        )
    return np.asarray(np.arange(lost.size) + np.cumsum(lost))


def _fit_line(rows: np.ndarray, time_s: FloatArray) -> tuple[float, float]:
    """Return the period and the stamp of row 0 by least squares, without rows that a host stamped late."""
    if rows[-1] == rows.size - 1:
        usual = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
        bins = sum_bins(0, time_s - time_s[0], usual, max(1, time_s.size // 1000))
        period, first_s, _ = line_without_stalls(bins, usual, longest_usual_step(np.diff(time_s), usual))
        return period, float(time_s[0]) + first_s
    slope, start = np.polyfit(rows, time_s - time_s[0], 1)
    return float(slope), float(time_s[0] + start)


def _weigh(samples: FloatArray, scatter_s: FloatArray, fs: float, settings: StampSettings) -> tuple[float, float]:
    """Return which fraction of the fast scatter of the stamps the samples show, and its standard deviation.

    The samples y are compared with j y', both whitened by the spectrum of y, on lines where the motion is weak.
    """
    from scipy import ndimage, signal

    n, along = len(samples), 0.0
    fast = scatter_s - ndimage.uniform_filter1d(scatter_s, max(3, round(settings.slow_s * fs)), mode="nearest")
    frequency_hz = np.fft.rfftfreq(n, 1 / fs)
    omega, size = 2 * np.pi * frequency_hz, min(n, round(settings.block_s * fs))
    window = signal.windows.blackmanharris(n)  # the noise may lie 80 dB below the motion
    scale, weight = fs / 2 * float(np.sum(window**2)), 0.0

    def find_density(values: FloatArray) -> FloatArray:
        f, density = signal.welch(values, fs, window="blackmanharris", nperseg=size)
        return np.asarray(np.interp(frequency_hz, f, density) * scale)

    for column in samples.T:
        centred = column - column.mean()
        if not centred.any():
            continue
        density = find_density(centred)
        inside = (frequency_hz > 0) & (frequency_hz < 0.45 * fs)
        floor = float(np.quantile(density[inside], 0.1))
        motion = np.clip(1 - 2 * floor / np.maximum(density, 1e-300), 0.0, 1.0)
        brought = fast * np.fft.irfft(1j * omega * motion * np.fft.rfft(centred), n)
        of_brought = find_density(brought)
        own = settings.own_term * np.var(fast) * omega**2 * motion * density
        inside &= (of_brought > own) & (density > 0)
        lines, other = (np.fft.rfft(window * each)[inside] for each in (centred, brought))
        along += float(np.sum((np.conj(other) * lines).real / density[inside]))
        weight += float(np.sum(np.abs(other) ** 2 / density[inside]))
    if weight <= 0:
        return 0.5, np.inf
    # Neighbouring lines under the window are not independent.
    return along / weight, float(np.sqrt(np.sum(window**4) / n) / np.mean(window**2) / np.sqrt(2 * weight))
