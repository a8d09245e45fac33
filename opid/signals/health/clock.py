"""Checks of a clock, block by block: its rate, jitter, gaps, stamps that repeat or go back, and what to do."""

from __future__ import annotations

import numpy as np

from opid.signals.clock import (
    COARSE_STAMPS,
    GAP,
    line_without_stalls,
    longest_usual_step,
    plain_number,
    require_step,
    resolution_of,
    sum_bins,
)
from opid.signals.health.chunks import LARGEST, rows_of_a_bin
from opid.signals.health.result import ClockHealth, Sentences, Stretch
from opid.signals.health.settings import HEALTH
from opid.signals.recording import FloatArray
from opid.signals.stamps import STAMPS

USUAL_STAMPS = 4096
"""Number of stamps at the beginning that show the usual period."""

MOST_SHOWN = 100
"""Stretches of each kind that the result keeps, at the most."""


class ClockCheck:
    """The check of the stamps of a track: of a stated rate and start, or by its usual (first) stamps.

    `setting` is what the user states of the stamps, as in `LogSettings`.

    Raises:
        ClockError: the usual step is that of no recorder.
    """

    def __init__(self, *, fs: float | None, start_s: float, setting: str, usual: FloatArray, n_channels: int) -> None:
        self.is_stated, self.is_reconstructed = fs is not None, setting == "reconstructed"
        self.is_judged = setting == "auto"
        self._start_s, self.n, self._previous = start_s, 0, np.nan
        self.is_crowded = False
        self._period, self._longest, self._noise = (1 / fs, np.inf, 0.0) if fs else self._find_usual(usual)
        require_step(self._period)
        self.bin_rows = rows_of_a_bin(self.fs, n_channels)
        self._good = np.zeros(3)  # number of steps that are no gap; sum and sum of squares of step - period
        self._bins: list[FloatArray] = []  # sums of rows and stamps, where the rows are assumed to be equally spaced
        self._line: tuple[int, float, float, np.ndarray] = (0, 0.0, 0.0, np.empty(0, dtype=bool))
        self.repeated, self.backward, self.unreadable = 0, 0, 0
        self.first_repeated_s = self.first_backward_s = np.nan
        self._gaps: list[tuple[int, float, float]] = []
        self.n_gaps, self._lost_s, self.n_bridged = 0, 0.0, 0
        self._jumps: list[np.ndarray] = []
        self._knots: list[np.ndarray] = []
        self._last = np.empty(0)

    @property
    def fs(self) -> float:
        """The stated rate, or that of the first stamps, Hz."""
        return 1 / self._period

    def jumps(self) -> np.ndarray:
        """Return the rows before which the clock jumps, without those that a host stamped late."""
        every = np.concatenate(self._jumps) if self._jumps else np.empty(0, dtype=np.int64)
        return every[~np.isin(every, [row for row, _, _ in self.stalls()])]

    def stalls(self) -> list[tuple[int, float, float]]:
        """Return row, start and end of each long step that lost no samples: the host stalled, and the rows catch up."""
        if not self._has_equal_steps or not self._gaps:
            return []
        bins = np.concatenate(self._bins)
        firsts, (period, start, on_line) = bins[:, 1] / bins[:, 0], self._fit()
        ends = [*(gap[0] for gap in self._gaps[1:]), self.n]
        return [
            (row, begin, stop)
            for (row, begin, stop), end in zip(self._gaps, ends, strict=True)
            if abs(begin - self._start_s - start - period * (row - 1)) <= self._longest
            and on_line[(firsts >= row) & (firsts < end)].any()
        ]

    def add(self, stamps: FloatArray | None, n: int) -> np.ndarray:
        """Take the next n rows and return those before which the clock jumps."""
        first, self.n = self.n, self.n + n
        if self.is_stated or stamps is None:
            return np.empty(0, dtype=np.int64)
        time_s = self._mend_stamps(stamps)
        if first == 0:
            self._start_s = float(time_s[0])
        steps = np.diff(time_s, prepend=self._previous if first else time_s[0] - self._period)
        self._previous = float(time_s[-1])
        self._last = np.concatenate([self._last, time_s])[-2000:]
        self._count_faults(time_s, steps)
        jumps = (steps > self._longest) | (steps < -self._noise)
        own = steps if self.is_crowded or not jumps.any() else steps[~jumps]
        knots = np.flatnonzero(jumps)
        if self.is_judged and not self._has_equal_steps:
            lost = np.round(steps / self._period) - 1
            bridged = jumps & (steps > 0) & (lost <= STAMPS.most_bridged)
            self.n_bridged += int(lost[bridged].sum())
            jumps &= ~bridged
            if float(np.median(np.abs(steps - self._period))) <= STAMPS.regular * self._period:
                # A row that was written twice among regular stamps makes its surroundings unsound.
                jumps |= steps == 0
        off = own - self._period
        self._good += np.array([off.size, off.sum(), off @ off])
        rows = np.arange(first, first + n, dtype=np.float64)
        if self._has_equal_steps:
            self._bins.append(sum_bins(first, time_s - self._start_s, self._period, self.bin_rows))
        indices = np.flatnonzero(jumps)
        self._keep_gaps(first, time_s, steps, indices)
        self._keep_knots(rows, time_s, knots)
        bins = (first + indices) // self.bin_rows
        # one jump suffices to make a bin unsound
        self._jumps.append((first + indices)[np.unique(bins, return_index=True)[1]])
        return first + indices

    def seconds(self, rows: np.ndarray) -> FloatArray:
        """Return the time of rows, s: by the stamps, or at equal steps where the stamps are not used."""
        if self.is_stated or self._has_equal_steps or not self._knots:
            start_s = self._find_origin()
            return start_s + np.asarray(rows, dtype=np.float64) / self.rate()
        knots = np.concatenate(self._knots, axis=1)
        order = np.argsort(knots[0], kind="stable")
        at = np.asarray(rows, dtype=np.float64)
        beyond = np.maximum(at - (self.n - 1), 0) * self._period  # the row after the last one is its end
        return np.interp(at, knots[0][order], knots[1][order]) + beyond

    def rate(self) -> float:
        """Return the rate of all rows without the gaps, Hz."""
        if self.is_stated:
            return 1 / self._period
        if self._has_equal_steps:
            slope = self._fit()[0]
            return 1 / slope if slope > 0 else 1 / self._period
        n, off, squares = self._good
        # the step before the first row is not measured: it was set to the period
        period = self._period + (off / (n - 1) if n > 1 else 0.0)
        period = period if period > 0 else self._period
        spread = np.sqrt(squares / n) if n else 0.0
        uncertainty = 4 * self._noise if spread < 1e-6 * period else self.resolution_s + 4 * self._noise
        relative = 1e-10 + uncertainty / max((n - 1) * period, period)
        return plain_number(1 / period, relative / period)

    @property
    def resolution_s(self) -> float:
        """The step to which the last stamps are rounded, s."""
        return 0.0 if self.is_stated or self._last.size < 2 else float(resolution_of(self._last))

    @property
    def stray_s(self) -> float:
        """The largest distance of the stamps from equal steps, s."""
        if not self._bins:
            return 0.0
        n, row, *_, low, high = np.concatenate(self._bins).T
        rows, period = row / n, 1 / self.rate()
        tilt = self._start_s + rows * self._period - (self._find_origin() + rows * period)
        return float(max(np.abs(low + tilt).max(), np.abs(high + tilt).max()))

    @property
    def _has_equal_steps(self) -> bool:
        return self.is_reconstructed or self.is_crowded

    def result(self, track: str, channels: tuple[str, ...]) -> ClockHealth:
        """Return the figures of the clock, after the last row."""
        fs, (n, off, squares) = self.rate(), self._good
        variance = max(squares / n - (off / n) ** 2, 0.0) if n else 0.0
        length_s = self.n / fs
        if not self.is_stated and not self._has_equal_steps:
            length_s = self._previous - self._start_s + 1 / fs
        stalls = self.stalls()
        lost_s = self._lost_s - sum(end - begin - self._period for _, begin, end in stalls)
        gaps = tuple(Stretch("gap", *gap[1:]) for gap in self._gaps if gap not in stalls)
        return ClockHealth(
            track=track,
            channels=channels,
            fs=fs,
            stated=self.is_stated,
            start_s=self._find_origin(),
            duration_s=length_s,
            n_samples=self.n,
            jitter=float(np.sqrt(variance)) * fs,
            resolution_s=self.resolution_s,
            repeated=self.repeated,
            backward=self.backward,
            gaps=gaps,
            n_gaps=self.n_gaps - len(stalls),
            n_lost=round(lost_s * fs),
        )

    def _find_usual(self, stamps: FloatArray) -> tuple[float, float, float]:
        """Return the period, the longest step that is no gap, and the rounding of floating point, s."""
        time_s = stamps[np.abs(stamps) < LARGEST]
        steps = np.diff(time_s)
        if not (steps > 0).any():
            return 1.0, np.inf, 0.0
        noise = 4 * float(np.spacing(np.abs(time_s).max()))
        self.is_crowded = bool((steps == 0).mean() > HEALTH.crowded)
        if self.is_crowded:
            period = float(steps[steps > 0].sum() / steps.size)
            return period, longest_usual_step(steps, period), noise
        # the median over some steps withstands gaps, coarse rounding, and stamps that repeat or go back
        stride = min(8, steps.size)
        period = float(np.median(time_s[stride:] - time_s[:-stride])) / stride
        period = period if period > 0 else float(np.median(steps[steps > 0]))
        spread = 1.4826 * float(np.median(np.abs(steps - period)))
        rounding = resolution_of(time_s) if time_s.size > 2 else 0.0
        rounding = rounding if rounding < COARSE_STAMPS * period else 0.0
        return period, max(GAP * period, period + 6 * spread, period + 1.01 * rounding) + noise, noise

    def _mend_stamps(self, stamps: FloatArray) -> FloatArray:
        good = np.abs(stamps) < LARGEST  # their squares are summed
        if good.all():
            return stamps.copy()
        self.unreadable += int((~good).sum())
        rows = np.arange(stamps.size)
        if not good.any():
            before = self._previous if np.isfinite(self._previous) else -self._period
            return np.asarray(before + self._period * (rows + 1.0), dtype=np.float64)
        return np.asarray(np.interp(rows, rows[good], stamps[good]), dtype=np.float64)

    def _count_faults(self, time_s: FloatArray, steps: FloatArray) -> None:
        same, back = steps == 0, steps < 0
        if same.any():
            self.first_repeated_s = time_s[same.argmax()] if not self.repeated else self.first_repeated_s
            self.repeated += int(same.sum())
        if back.any():
            self.first_backward_s = time_s[back.argmax()] if not self.backward else self.first_backward_s
            self.backward += int(back.sum())

    def _keep_gaps(self, first: int, time_s: FloatArray, steps: FloatArray, indices: np.ndarray) -> None:
        gaps = indices[steps[indices] > 0]
        self.n_gaps += gaps.size
        self._lost_s += float((steps[gaps] - self._period).sum())
        for k in gaps[: MOST_SHOWN - len(self._gaps)]:
            self._gaps.append((first + int(k), float(time_s[k] - steps[k]), float(time_s[k])))

    def _keep_knots(self, rows: FloatArray, time_s: FloatArray, indices: np.ndarray) -> None:
        """Keep the time of the first row of each bin, and of the rows on both sides of a jump."""
        regular = np.arange(-int(rows[0]) % self.bin_rows, rows.size, self.bin_rows)
        most = max(1, rows.size // self.bin_rows) * 16
        near = np.concatenate([regular, [0, rows.size - 1], indices[:most], np.maximum(indices[:most] - 1, 0)])
        near = np.unique(near.astype(np.int64))
        self._knots.append(np.stack([rows[near], time_s[near]]))

    def _fit(self) -> tuple[float, float, np.ndarray]:
        """Return the period, distance of the line at row 0 from the first stamp, and the bins of rows on that line."""
        if self._line[0] != self.n and self._bins:
            self._line = self.n, *line_without_stalls(np.concatenate(self._bins), self._period, self._longest)
        return self._line[1:]

    def _find_origin(self) -> float:
        if self.is_stated or not self._has_equal_steps or self._fit()[0] <= 0:
            return self._start_s
        return self._start_s + self._fit()[1]


# ---- sentences -------------------------------------------------------------------------------------


def describe_clock(check: ClockCheck, health: ClockHealth) -> Sentences:
    """Yield what is wrong with a clock."""
    of_track = f" of {health.track!r}" if health.track else ""
    if not HEALTH.least_fs_hz <= health.fs <= HEALTH.most_fs_hz:
        cause = (
            "check the stated rate (fs_hz in [log])"
            if health.stated
            else "check their unit (time_unit in [log], --time-unit)"
        )
        source = "is stated" if health.stated else "follows from the time stamps"
        yield "warning", "implausible_rate", f"a rate of {health.fs:.6g} Hz{of_track} {source}: {cause}"
    if check.unreadable:
        yield (
            "fault",
            "unreadable_stamps",
            f"{check.unreadable} time stamp(s){of_track} are no number: mend the log there",
        )
    if check.backward:
        yield (
            "fault",
            "time_goes_back",
            f"the time{of_track} goes back {check.backward} time(s), the first to {check.first_backward_s:.9g} s: "
            "put the samples in order, or split the log there if two were joined",
        )
    yield from _describe_spacing(check, health, of_track)
    if stalls := check.stalls():
        _, begin, end = max(stalls, key=lambda each: each[2] - each[1])
        yield (
            "note",
            "host_stalls",
            f"the stamps{of_track} stand still {len(stalls)} time(s), the longest for {end - begin:.3g} s "
            f"at {begin:.6g} s, and the rows then catch up: the host stalled, and no sample counts as lost",
        )
    if health.n_gaps:
        gap = health.gaps[0]
        yield (
            "warning",
            "gaps",
            f"the time{of_track} jumps from {gap.start_s:.9g} s to {gap.stop_s:.9g} s where steps of "
            f"{1 / health.fs:.6g} s are usual ({health.n_gaps} gap(s), about {health.n_lost} sample(s) lost): choose a "
            "stretch without gaps (start_s, stop_s); `identify` leaves them out by itself",
        )
    if check.n_bridged:
        yield (
            "note",
            "bridged_rows",
            f"{check.n_bridged} row(s){of_track} were lost one or two at a time: they are interpolated when the log is "
            "read, so there is nothing to do",
        )
    usual = max(0.02, 0.5 * health.resolution_s * health.fs)
    if not (check.is_crowded or check.is_reconstructed or health.n_gaps or check.backward) and health.jitter > usual:
        words = f"the steps between time stamps{of_track} scatter by {health.jitter:.0%} of the period: "
        if check.is_judged:
            words += (
                "when the log is read the samples show whether they were taken at these times or only stamped late, "
                'unless `clock = "own_times"` or "reconstructed" in [log] states it'
            )
        else:
            words += (
                'if the recorder samples at equal steps and only stamps late, write `clock = "reconstructed"` in [log]'
            )
        yield "note" if check.is_judged else "warning", "uneven_steps", words


def _describe_spacing(check: ClockCheck, health: ClockHealth, of_track: str) -> Sentences:
    if check.is_reconstructed and not health.stated:
        yield (
            "note",
            "rows_equally_spaced",
            f"the rows{of_track} are assumed to be equally spaced at {health.fs:.6g} Hz, the stamps lie up to "
            f"{check.stray_s:.2g} s off: nothing to do unless samples were lost",
        )
    elif health.repeated == health.n_samples - 1 and health.n_samples > 1:
        yield (
            "fault",
            "no_clock",
            f"all {health.n_samples} time stamps{of_track} are {health.start_s:.9g} s, which is no clock: state the "
            "rate (fs_hz in [log])",
        )
    elif check.is_crowded:
        rows = health.n_samples / (health.n_samples - health.repeated)
        words = (
            f"about {rows:.1f} rows{of_track} share a time stamp, as if a host empties a buffer or rounds its stamps: "
        )
        if check.is_judged:
            words += (
                f"they are taken as equally spaced at {health.fs:.6g} Hz; samples that were lost would go unnoticed"
            )
        else:
            words += (
                f'write `clock = "reconstructed"` in [log], which assumes equally spaced rows at {health.fs:.6g} Hz'
            )
        yield "warning" if check.is_judged else "fault", "shared_stamps", words
    elif check.repeated and not (check.is_judged and health.jitter > STAMPS.regular):
        yield (
            "fault",
            "repeated_stamps",
            f"{check.repeated} time stamp(s){of_track} stand twice in a row, the first at "
            f"{check.first_repeated_s:.9g} s: remove the repeated samples, write the time with more digits, or write "
            '`clock = "reconstructed"` in [log] if the rows are equally spaced',
        )
