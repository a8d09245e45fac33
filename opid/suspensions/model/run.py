"""One run in the form of the model: the drive of the body, the readings on it, and their corrections for sensor faults.

A sensor with gain g, AC-coupling corner f_c and a delay records s; l_k are further axes that leak in. The corrected
reading is ((s + w_c S) - sum_k a_k (l_k + w_c L_k)) / g at t + delay, with w_c = 2 pi f_c and S, L_k the integrals.
The delay of a sensor with a clock of its own is a straight line over the time of the run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, integrate, interpolate, ndimage

from opid.errors import InputError
from opid.mechanics.driven import half_steps
from opid.signals.recording import FloatArray
from opid.signals.resampling import design_low_pass
from opid.signals.spectra import ComplexArray, coherent_fraction
from opid.suspensions.sensor_facts import Sensors, Side
from opid.suspensions.settings import RunSettings

_LAGS = ("lag", "lag of the run")
"""Delays that add up: that of a sensor in all runs, and that of its recorder in one run."""

_GAINS = ("gain", "gain of the run")
"""Gains that multiply: that of a sensor in all runs, and its departure in one run."""


@dataclass(frozen=True, eq=False)
class BandLines:
    """Lines of a band.

    Args:
        n_samples: number of samples of the record that are used.
        omega: (n_lines,) angular frequencies, rad/s.
        finer: factor by which the record is sampled finer, so that a step of the model is short enough.
    """

    n_samples: int
    omega: FloatArray
    finer: int

    def prepare(self, samples: FloatArray) -> FloatArray:
        """Return a record that is cut, without its mean, and sampled finer if needed."""
        centred = samples[: self.n_samples] - samples[: self.n_samples].mean(axis=0)
        return centred if self.finer == 1 else sample_finer(centred, self.finer)


def band_lines(
    n_samples: int, *, fs: float, band_hz: tuple[float, float] | None = None, settings: RunSettings | None = None
) -> BandLines:
    """Return the lines of a band of a record.

    Args:
        n_samples: number of samples of the record.
        fs: sampling rate, Hz.
        band_hz: lowest and highest line, Hz, cut at 0.4 fs; that of the settings if left out.
        settings: how runs are prepared.

    Raises:
        InputError: an invalid band, or one with fewer than 20 lines.

    >>> band_lines(1000, fs=100.0, band_hz=(1.0, 5.0)).omega.size
    41
    """
    settings = settings or RunSettings()
    band_hz = band_hz or settings.band_hz
    n = fft.prev_fast_len(n_samples, real=True)
    frequency_hz = fft.rfftfreq(n, 1 / fs)
    if not 0 < band_hz[0] < band_hz[1]:
        raise InputError(f"band_hz is ({band_hz[0]:g}, {band_hz[1]:g}): give 0 < low < high, Hz")
    low, high = float(band_hz[0]), min(float(band_hz[1]), settings.highest_fraction * fs)
    if low >= high:
        raise InputError(
            f"the band {band_hz[0]:g} to {band_hz[1]:g} Hz lies above {high:g} Hz, {settings.highest_fraction:g} of "
            f"the rate of {fs:g} Hz, where the filters of loggers begin: give a band below it"
        )
    keep = np.flatnonzero((frequency_hz >= low) & (frequency_hz <= high) & (frequency_hz > 0))
    if keep.size < settings.least_lines:
        raise InputError(
            f"the band {low:g} to {high:g} Hz holds {keep.size} lines of a run of {n_samples / fs:.3g} s: give a "
            "longer run or a wider band"
        )
    finer = int(np.ceil(lowest_rate_hz(float(band_hz[1]), settings) / fs))
    return BandLines(n, 2 * np.pi * frequency_hz[keep], max(1, finer))


def lowest_rate_hz(highest_hz: float, settings: RunSettings) -> float:
    """Return the lowest step rate of the model for lines up to a highest one, Hz."""
    return min(settings.lowest_rate_hz, settings.rate_over_band * highest_hz)


def band_indices(omega: FloatArray, per_octave: float, least_lines: int) -> NDArray[np.int64]:
    """Return the number of the band of each line; bands are fractions of octaves with at least `least_lines` lines.

    The lines ascend; the last band may hold fewer.

    >>> band_indices(np.arange(1.0, 9.0), 1.0, 2)
    array([0, 0, 1, 1, 2, 2, 2, 3])
    """
    octave = np.floor(per_octave * np.log2(omega / omega[0]) + 1e-9)
    found, count = np.zeros(omega.size, dtype=np.int64), 1
    for k in range(1, omega.size):
        ends = octave[k] != octave[k - count] and count >= least_lines
        found[k] = found[k - 1] + ends
        count = 1 if ends else count + 1
    return found


def sample_finer(samples: FloatArray, by: int) -> FloatArray:
    """Return a record with more samples, band-limited between the given ones."""
    from scipy import signal

    return np.asarray(signal.resample_poly(samples, by, 1, axis=0, padtype="line"))


def find_lines(omega: FloatArray, n_samples: int, fs: float) -> slice:
    """Return the indices of the lines of a band among all lines of the transform."""
    first = round(float(omega[0]) / (2 * np.pi) * n_samples / fs)
    return slice(first, first + omega.size)


def transform_lines(samples: FloatArray, omega: FloatArray, fs: float) -> ComplexArray:
    """Return Fourier lines along the last axis, scaled so that unit white noise has unit parts."""
    n = samples.shape[-1]
    return fft.rfft(samples)[..., find_lines(omega, n, fs)] / np.sqrt(n / 2)


@dataclass(frozen=True, eq=False)
class Corrected:
    """The channels of one side, corrected for the faults of their sensors.

    Args:
        value: (m, n_channels) accelerations, m/s^2; at half steps below the suspensions.
        by: derivatives by the faults: name, number of the channel, (m,) column.
    """

    value: FloatArray
    by: tuple[tuple[str, int, FloatArray], ...]

    def directions(self, n_attachments: int) -> FloatArray | None:
        """Return the derivatives for the predictor, (m, n_faults, n_attachments); None if there are none."""
        if not self.by:
            return None
        found = np.zeros((len(self.value), len(self.by), n_attachments))
        for index, (_, channel, column) in enumerate(self.by):
            found[:, index, channel] = column
        return found


@dataclass(frozen=True, eq=False)
class DrivenRun:
    """One run, ready for the model.

    Args:
        unsprung: (n, n_interfaces) accelerations below the suspensions, mean removed, m/s^2.
        sprung: (n, n_sensors) accelerations of the body, mean removed, m/s^2.
        leaks: (n, n_leaks) further axes that leak in, mean removed, m/s^2.
        omega: (n_lines,) lines of the residual that are compared, rad/s.
        recorded_fs: rate of these arrays, Hz.
        loading: (n_dof, n_dof) mass matrix of what this run carries more than the reference, kg.
        finer: factor by which the arrays are sampled finer than recorded, so that a step of the model is short enough.
        stride: number of samples from one step of the model to the next: 1, or more at a coarse rate.
        settings: settings of the preparation.
        error_level: size of the errors of this run relative to the others, for a wrong model. They are weighted by its
            inverse, so that no run dominates the others by its strength.
        number: number of the run in the study: clocks of recorders are known run by run.
        n_strut: number of the last columns on the body that read a strut itself, its travel or its force.
        drive_step_m_per_s2: rms step of an unmeasured drive from sample to sample of these arrays, a random walk that
            begins at zero, m/s^2; `unsprung` is then derived from the travel and drives only the free motion. 0 for a
            measured drive.
        after_middle_s: time of the first sample after the middle of the run, s; drifts are counted from the middle.
    """

    unsprung: FloatArray
    sprung: FloatArray
    leaks: FloatArray
    omega: FloatArray
    recorded_fs: float
    loading: FloatArray
    finer: int
    stride: int
    settings: RunSettings
    error_level: float = 1.0
    number: int = 0
    n_strut: int = 0
    drive_step_m_per_s2: float = 0.0
    after_middle_s: float = 0.0
    # stored results for these records
    _sides: dict[Side, FloatArray] = field(init=False, default_factory=dict)
    _parts: dict[tuple[Side, tuple[str, int], int], FloatArray] = field(init=False, default_factory=dict)
    _splines: dict[tuple[Side, tuple[str, int], int], tuple[FloatArray, FloatArray | None]] = field(
        init=False, default_factory=dict
    )

    @property
    def fs(self) -> float:
        """Steps of the model per second, Hz."""
        return self.recorded_fs / self.stride

    @cached_property
    def shared_fraction(self) -> float:
        """Fraction of the power of the body's first sensor, in the band, that is coherent with the first one below."""
        block = int(min(4 * np.pi * self.recorded_fs / self.omega[0], len(self.sprung) / 4))
        return self._measure_coherence(self.sprung[:, :1], self.unsprung[:, :1], self.recorded_fs, block)

    def coherent_fraction(self, samples: FloatArray) -> float:
        """Return the fraction of the power of samples of the model, in the band, that is coherent with the drive.

        NaN if the run is too short.

        Args:
            samples: (n_samples, n_channels).
        """
        drive = self.unsprung[:: self.stride][: self.n_samples]
        return self._measure_coherence(
            samples, drive, self.fs, min(round(self.settings.coherence_s * self.fs), self.n_samples)
        )

    def _measure_coherence(self, samples: FloatArray, others: FloatArray, fs: float, block: int) -> float:
        band_hz = (float(self.omega[0]) / (2 * np.pi), float(self.omega[-1]) / (2 * np.pi))
        return coherent_fraction(samples, others, fs=fs, band_hz=band_hz, nperseg=block)

    @cached_property
    def n_samples(self) -> int:
        """Number of steps."""
        n = -(-len(self.sprung) // self.stride)
        return n if self.stride == 1 else int(fft.prev_fast_len(n, real=True))

    @cached_property
    def coarse(self) -> DrivenRun:
        """The run at about the lowest rate that its lines allow, for fits in a fraction of the time.

        Fewer readings are compared, without a filter, so that model and sensors still refer to the same instants. Below
        the suspensions the samples between them give the half steps, after a filter against aliasing into the band.
        """
        highest_hz = float(self.omega[-1]) / (2 * np.pi)
        lowest_hz = max(
            lowest_rate_hz(self.settings.band_hz[1], self.settings), highest_hz / self.settings.highest_fraction
        )
        by = int(self.fs / (2 * lowest_hz))
        if by < 1:
            return self
        fs, low_hz = self.fs / (2 * by), float(self.omega[0]) / (2 * np.pi)
        lines = band_lines(
            -(-len(self.sprung) // (2 * by)), fs=fs, band_hz=(low_hz, highest_hz), settings=self.settings
        )
        return replace(self, omega=lines.omega, stride=2 * by)

    def sample_finer(self, by: int) -> DrivenRun:
        """Return the run with more steps of the model, for friction that turns over within one of its steps."""
        return replace(
            self,
            unsprung=sample_finer(self.unsprung, by),
            sprung=sample_finer(self.sprung, by),
            leaks=sample_finer(self.leaks, by) if self.leaks.size else np.empty((by * len(self.leaks), 0)),
            recorded_fs=by * self.recorded_fs,
            finer=by * self.finer,
            drive_step_m_per_s2=self.drive_step_m_per_s2 / np.sqrt(by),
        )

    def split(self, n_pieces: int) -> tuple[DrivenRun, ...]:
        """Return pieces of the run of about the same length, each with the lines that it has in the band."""
        low_hz, high_hz = (float(self.omega[k]) / (2 * np.pi) for k in (0, -1))
        size, found = len(self.sprung) // n_pieces, []
        for first in range(0, n_pieces * size, size):
            n_steps = -(-size // self.stride)
            lines = band_lines(n_steps, fs=self.fs, band_hz=(low_hz, high_hz * (1 + 1e-9)), settings=self.settings)
            own = slice(first, first + lines.n_samples * self.stride)
            sides = [each[own] - each[own].mean(axis=0) for each in (self.unsprung, self.sprung, self.leaks)]
            later_s = self.after_middle_s + first / self.recorded_fs
            piece = replace(self, unsprung=sides[0], sprung=sides[1], leaks=sides[2], omega=lines.omega)
            found.append(replace(piece, after_middle_s=later_s))
        return tuple(found)

    def strongest_piece(self, length_s: float) -> DrivenRun:
        """Return the piece of about this length in which the body moves most.

        A piece lasts at least four periods of the lowest line. The run itself is returned if it has fewer than two
        pieces, or if the band is too narrow for a piece.

        Args:
            length_s: length of the piece, s.
        """
        length_s = max(length_s, 4 * 2 * np.pi / float(self.omega[0]))
        n_pieces = int(self.n_samples / self.fs / length_s)
        if n_pieces < 2:
            return self
        try:
            pieces = self.split(n_pieces)
        except InputError:
            return self
        return max(pieces, key=lambda piece: float(np.sum(piece.sprung**2)))

    @cached_property
    def ground_at_start(self) -> tuple[FloatArray, FloatArray]:
        """Position, velocity and offset of the ground below each suspension at the first sample, and their covariance.

        The measured acceleration, integrated twice from there, gives a path that stays near its mean height. Its
        standard deviation about it follows from the settings and from what a parabola leaves of the path.

        Returns:
            (3, n_interfaces) in m, m/s and m/s^2; and (n_interfaces, 3, 3).
        """
        time = np.arange(len(self.unsprung)) / self.recorded_fs
        path = self.unsprung
        for _ in range(2):
            path = integrate.cumulative_trapezoid(path, dx=1 / self.recorded_fs, initial=0.0, axis=0)
        basis = np.stack([np.ones_like(time), time, time**2 / 2], axis=1)
        start = -np.linalg.lstsq(basis, path, rcond=None)[0]
        left_m = (path + basis @ start).std(axis=0)
        drift_m = np.hypot(self.settings.ground_drift_m, self.settings.ground_drift_paths * left_m)
        unit = np.linalg.inv(basis.T @ basis / time.size)
        return np.asarray(start), np.asarray(np.multiply.outer(drift_m**2, unit))

    @property
    def step_of_unmeasured_drive(self) -> float:
        """Rms step of an unmeasured drive from one step of the model to the next, m/s^2; 0 for a measured drive."""
        return self.drive_step_m_per_s2 * float(np.sqrt(self.stride))

    def density_of_unmeasured_drive(self) -> FloatArray:
        """Return the spectral density of an unmeasured drive on the lines, (n_lines,), in the unit of `transform`."""
        steps = np.abs(1.0 - np.exp(-1j * self.omega / self.fs)) ** 2
        return np.asarray(self.step_of_unmeasured_drive**2 / steps)

    @property
    def lines(self) -> slice:
        """Indices of the lines of the band among all lines of the transform."""
        return find_lines(self.omega, self.n_samples, self.fs)

    def transform(self, samples: FloatArray) -> ComplexArray:
        """Fourier lines of the band along the last axis, scaled so that unit white noise has unit parts."""
        return transform_lines(samples, self.omega, self.fs)

    def correct(self, side: Side, sensors: Sensors, faults: Mapping[str, float]) -> Corrected:
        """Return the accelerations of a side, corrected for the faults of the sensors, whose values are given by name.

        At half steps, (2 n - 1, n_interfaces), below the suspensions; at steps, (n, n_sensors), on the body. A drive
        that was not measured is zero.
        """
        if side == "unsprung" and self.drive_step_m_per_s2:
            return Corrected(np.zeros((2 * self.n_samples - 1, self.unsprung.shape[1])), ())
        mine: dict[int, dict[str, tuple[str, int]]] = {}
        for fault in sensors.faults:
            if fault.side == side and fault.run in (None, self.number):
                what = f"leak {fault.leak}" if fault.kind == "leak" else fault.kind
                what = f"{what} of the run" if what in ("lag", "gain") and fault.run is not None else what
                mine.setdefault(fault.channel, {})[what] = (fault.name, fault.leak)
        facts = sensors.facts(side)
        touched = sorted({*mine, *(k for k, each in enumerate(facts) if each.corner_hz)})
        whole = self._sample_side(side)
        if not touched:
            return Corrected(whole, ())
        value, by = whole.copy(), []
        for channel in touched:
            own = mine.get(channel, {})
            column, slopes = self._correct_channel(side, channel, facts[channel].corner_hz, own, faults)
            value[:, channel] = column
            by += [(own[what][0], channel, slope) for what, slope in slopes.items()]
        return Corrected(value, tuple(by))

    def _correct_channel(
        self,
        side: Side,
        channel: int,
        corner_hz: float,
        own: Mapping[str, tuple[str, int]],
        faults: Mapping[str, float],
    ) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Return one corrected channel, and its derivatives by its own faults."""
        gains = {what: faults[own[what][0]] for what in _GAINS if what in own}
        gain = math.prod(gains.values())
        lag_s = sum(faults[own[what][0]] for what in _LAGS if what in own)
        drift = faults[own["drift"][0]] if "drift" in own else 0.0
        omega_c = 2 * np.pi * (faults[own["corner"][0]] if "corner" in own else corner_hz)

        def undo_coupling(source: tuple[str, int], order: int = 0) -> FloatArray:
            part = self._sample_part(side, source, 0, lag_s, drift, order)
            return part + omega_c * self._sample_part(side, source, 1, lag_s, drift, order) if omega_c else part

        signal_of = (side, channel)
        leaking = {what: ("leaks", index) for what, (_, index) in own.items() if what.startswith("leak")}
        leaked = {what: faults[own[what][0]] for what in leaking}

        def total(order: int = 0) -> FloatArray:
            leaks = sum(leaked[what] * undo_coupling(leak, order) for what, leak in leaking.items())
            return (undo_coupling(signal_of, order) - leaks) / gain

        value, by = total(), {}
        for what, leak in leaking.items():
            by[what] = -undo_coupling(leak) / gain
        by |= {what: -value / each for what, each in gains.items()}
        if "corner" in own:
            integral = self._sample_part(side, signal_of, 1, lag_s, drift, 0)
            for what, leak in leaking.items():
                integral = integral - leaked[what] * self._sample_part(side, leak, 1, lag_s, drift, 0)
            by["corner"] = 2 * np.pi * integral / gain
        by |= {what: total(order=1) for what in _LAGS if what in own}
        if "drift" in own:
            by["drift"] = total(order=1) * self._times(side)
        return value, by

    def _times(self, side: Side) -> FloatArray:
        """Return the times of the samples of the model on a side after the middle of the run, s."""
        steps = np.arange(2 * self.n_samples - 1) / 2 if side == "unsprung" else np.arange(self.n_samples)
        return self.after_middle_s + steps / self.fs

    def _sample_part(
        self, side: Side, source: tuple[str, int], integrals: int, lag_s: float, drift: float, order: int
    ) -> FloatArray:
        """Return a recorded column or its integral at the samples of a side, delayed or differentiated in time."""
        if lag_s == drift == 0.0 and order == 0:
            key = (side, source, integrals)
            if key not in self._parts:
                self._parts[key] = self._resample(side, self._take_column(source, integrals))
            return self._parts[key]
        key = (side, source, integrals)
        if key not in self._splines:
            slow, fast = self._split_by_rate(side, self._take_column(source, integrals))
            self._splines[key] = ndimage.spline_filter1d(slow, 5, mode="mirror"), fast
        (coefficients, fast), steps = self._splines[key], lag_s * self.recorded_fs
        if drift:
            after_middle = np.arange(coefficients.size) + self.after_middle_s * self.recorded_fs
            samples = _evaluate_spline(coefficients, np.arange(coefficients.size) + steps + drift * after_middle, order)
        else:
            samples = _shift_spline(coefficients, steps, order)
        samples = samples * self.recorded_fs**order
        return self._resample(side, samples if order or fast is None else samples + fast)

    def _split_by_rate(self, side: Side, column: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the part of a column that a delay moves, and the rest; None if all of it is moved.

        Interpolation between samples averages their noise. At a coarse rate the readings on the body are thinned
        without a filter, so that noise of every frequency falls into the band: a delay by half a sample would lower
        the error by a tenth, and laws that make up for a delay would be taken. There only the slow part, which holds
        the compared lines, is moved, and the noise that is left does not depend on the delay.
        """
        if side == "unsprung" or self.stride == 1:
            return column, None
        highest_hz = float(self.omega[-1]) / (2 * np.pi)
        taps = design_low_pass(highest_hz, self.fs - highest_hz, fs=self.recorded_fs, stop_db=self.settings.stop_db)
        slow = np.asarray(ndimage.convolve1d(column, taps, mode="mirror"))
        return slow, column - slow

    def _take_column(self, source: tuple[str, int], integrals: int) -> FloatArray:
        name, index = source
        column = {"unsprung": self.unsprung, "sprung": self.sprung, "leaks": self.leaks}[name][:, index]
        if not integrals:
            return column
        integral = integrate.cumulative_trapezoid(column, dx=1 / self.recorded_fs, initial=0.0)
        return np.asarray(integral - self._fit_drift(integral))

    def _fit_drift(self, acceleration: FloatArray) -> FloatArray:
        """Return the straight line in an acceleration without which its double integral is nearest to a straight line.

        When an AC coupling is undone, the mean that was removed from the reading, and the unknown initial state of the
        coupling's filter, become such a line: of 0.3 m/s^2 in 40 s for a body that moved by 1 m/s^2.
        """
        time = np.linspace(-1.0, 1.0, acceleration.size)
        path = acceleration
        for _ in range(2):
            path = integrate.cumulative_trapezoid(path, dx=time[1] - time[0], initial=0.0)
        basis = np.stack([np.ones_like(time), time, time**2 / 2, time**3 / 6], axis=1)
        _, _, offset, slope = np.linalg.lstsq(basis, path, rcond=None)[0]
        return np.asarray(offset + slope * time)

    def _sample_side(self, side: Side) -> FloatArray:
        """Return all columns of a side as they were recorded, at the samples of the model."""
        if side not in self._sides:
            self._sides[side] = self._resample(side, self.unsprung if side == "unsprung" else self.sprung)
        return self._sides[side]

    def _resample(self, side: Side, samples: FloatArray) -> FloatArray:
        """Return the samples of the model on a side: at half steps below the suspensions, at steps on the body."""
        if side == "sprung":
            return np.ascontiguousarray(samples[:: self.stride][: self.n_samples])
        if self.stride == 1:
            return half_steps(samples)
        highest_hz, width_hz = float(self.omega[-1]) / (2 * np.pi), self.settings.stop_width * self.fs
        stop_hz = self.fs - highest_hz
        taps = design_low_pass(stop_hz - width_hz, stop_hz, fs=self.recorded_fs, stop_db=self.settings.stop_db)
        smooth = ndimage.convolve1d(samples, taps, axis=0, mode="nearest")
        return np.ascontiguousarray(smooth[:: self.stride // 2][: 2 * self.n_samples - 1])


def driven_run(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    *,
    fs: float,
    loading: ArrayLike = 0.0,
    leaks: ArrayLike | None = None,
    band_hz: tuple[float, float] | None = None,
    number: int = 0,
    n_strut: int = 0,
    is_driven: bool = True,
    settings: RunSettings | None = None,
) -> DrivenRun:
    """Prepare one run for the model.

    Only the residual is restricted to the band. The drive keeps its slow motion: a nonlinear law needs it.

    Args:
        unsprung: (n, n_interfaces) accelerations below the suspensions, m/s^2; (n,) for one.
        sprung: (n, n_sensors) accelerations of the body, m/s^2; (n,) for one.
        fs: sampling rate, Hz.
        loading: (n_dof, n_dof) mass matrix of what this run carries more than the reference, kg; a number for one gear.
        leaks: (n, n_leaks) further axes that leak into the sensors, m/s^2.
        band_hz: lowest and highest line to compare, Hz, cut at 0.4 fs; that of the settings if left out.
        number: number of the run in the study.
        n_strut: number of the last columns of `sprung` that read a strut itself: a travel or a force, scaled to the
            size of an acceleration.
        is_driven: whether `unsprung` was measured; otherwise it was derived from a travel that is read on the body, and
            the drive of the model is a random walk.
        settings: how runs are prepared.

    Raises:
        InputError: arrays of different lengths, an invalid band, or one with fewer than 20 lines.
    """
    settings = settings or RunSettings()
    if not is_driven:
        by = settings.finer_without_drive
        settings = replace(
            settings, lowest_rate_hz=by * settings.lowest_rate_hz, rate_over_band=by * settings.rate_over_band
        )
    lower, upper = (_stack_columns(samples) for samples in (unsprung, sprung))
    across = np.empty((len(lower), 0)) if leaks is None else _stack_columns(leaks)
    if not len(lower) == len(upper) == len(across):
        raise InputError(
            f"unsprung has shape {lower.shape}, sprung {upper.shape} and leaks {across.shape}: give runs of one length"
        )
    lines = band_lines(len(lower), fs=fs, band_hz=band_hz, settings=settings)
    below = lines.prepare(lower)
    step = 0.0 if is_driven else settings.drive_steps * float(np.sqrt(np.mean(np.diff(below, axis=0) ** 2)))
    return DrivenRun(
        unsprung=below,
        sprung=lines.prepare(upper),
        leaks=lines.prepare(across) if across.size else np.empty((lines.n_samples * lines.finer, 0)),
        omega=lines.omega,
        recorded_fs=float(fs) * lines.finer,
        loading=np.atleast_2d(np.asarray(loading, dtype=np.float64)),
        finer=lines.finer,
        stride=1,
        settings=settings,
        number=number,
        n_strut=n_strut,
        drive_step_m_per_s2=step,
        after_middle_s=-0.5 * len(lower) / fs,
    )


def _shift_spline(coefficients: FloatArray, steps: float, order: int) -> FloatArray:
    """Return a quintic spline, or its derivative, shifted by some steps; beyond its ends it is constant."""
    n, piece = coefficients.size, interpolate.BSpline.basis_element(np.arange(-3, 4), extrapolate=False)
    near = np.arange(-2, 4)

    def at(index: NDArray[np.int64], fraction: float, order: int) -> FloatArray:
        # The spline is mirrored at both ends, as for the computation of the coefficients.
        taken = np.abs(n - 1 - np.abs(n - 1 - np.abs(index[:, np.newaxis] + near)))
        return np.asarray(coefficients[taken] @ piece(fraction - near, order))

    whole = int(np.floor(steps))
    samples = at(np.arange(n) + whole, steps - whole, order)
    index = np.arange(n) + steps
    for outside, end in ((index < 0, 0), (index > n - 1, n - 1)):
        samples[outside] = 0.0 if order else at(np.array([end]), 0.0, 0)
    return samples


def _evaluate_spline(coefficients: FloatArray, positions: FloatArray, order: int) -> FloatArray:
    """Return a quintic spline, or its derivative, at some positions in samples; beyond its ends it is constant."""
    inside = np.clip(positions, 0, coefficients.size - 1)
    if not order:
        return np.asarray(ndimage.map_coordinates(coefficients, [inside], order=5, mode="mirror", prefilter=False))
    n, piece = coefficients.size, interpolate.BSpline.basis_element(np.arange(-3, 4), extrapolate=False)
    whole = np.floor(inside).astype(np.int64)
    near = np.arange(-2, 4)
    taken = np.abs(n - 1 - np.abs(n - 1 - np.abs(whole[:, np.newaxis] + near)))
    weights = piece.derivative(order)((inside - whole)[:, np.newaxis] - near)
    return np.where(inside == positions, np.sum(coefficients[taken] * weights, axis=1), 0.0)


def _stack_columns(samples: ArrayLike) -> FloatArray:
    array = np.asarray(samples, dtype=np.float64)
    return array[:, np.newaxis] if array.ndim == 1 else array
