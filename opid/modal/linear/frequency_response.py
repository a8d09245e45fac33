"""Frequency responses of sensors to a force, measured or made from the linear modes, and a mode indicator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from opid.errors import InputError, nearest
from opid.mechanics.structure import ComplexArray
from opid.modal.linear.modes import (
    ACCELERATION,
    READINGS,
    LinearModes,
    ModalTest,
    check_force,
    check_reading,
    weigh_sensors,
    with_accelerations,
)
from opid.modal.settings import MODAL
from opid.provenance import ReadFile
from opid.signals.health.inspection import clipped_fractions
from opid.signals.recording import FloatArray, Recording
from opid.signals.spectra import Window, cross_spectra


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Accelerations per force at one drive point over frequency.

    Args:
        frequency_hz: (n,) lines, Hz.
        value: (n, n_sensors) complex accelerance, m/s^2/N, or strain/s^2/N of a strain gauge; nan at a line without any
            force.
        sensors: names of the columns.
        drive_point: the sensor where and in whose direction the force acts.
        n_averages: independent records or blocks that were averaged; 1 for one record, 0 for a response made of modes.
        coherence: (n, n_sensors) coherence, 0 .. 1; None where nothing was averaged, as it would be 1 by construction.
        left_at_end: motion at the end of the records that were transformed whole, over the largest one, rms.
        level_ratio: largest peak of the force in a record over the smallest.
        units: unit of the second derivative of each sensor's reading; all are "m/s^2" where empty.
        clipped_sensors: sensors that are clipped in a record.
        has_clipped_force: whether the force is clipped in a record.
    """

    frequency_hz: FloatArray
    value: ComplexArray
    sensors: tuple[str, ...]
    drive_point: str
    n_averages: float = 1.0
    coherence: FloatArray | None = None
    left_at_end: float = 0.0
    level_ratio: float = 1.0
    units: tuple[str, ...] = ()
    clipped_sensors: tuple[str, ...] = ()
    has_clipped_force: bool = False


@dataclass(frozen=True, eq=False)
class ForcedRecord:
    """The record of a structure that was driven at one point, of whose modes nothing is known yet.

    Args:
        name: the name of the test.
        fs: sampling rate, Hz.
        force: (n,) force at the drive point, N.
        at_sensors: (n, n_sensors) accelerations, m/s^2, and second derivatives of strains, strain/s^2.
        units: their units.
        sensors: names of their columns.
        drive_point: the sensor where and in whose direction the force acts.
        files: the files that it was read from.
        clipped_sensors: sensors that are clipped.
        has_clipped_force: whether the force is clipped.
    """

    name: str
    fs: float
    force: FloatArray
    at_sensors: FloatArray
    units: tuple[str, ...]
    sensors: tuple[str, ...]
    drive_point: str
    files: tuple[ReadFile, ...] = ()
    clipped_sensors: tuple[str, ...] = ()
    has_clipped_force: bool = False

    def padded_to(self, n_samples: int) -> ForcedRecord:
        """Return the record followed by rest, of so many samples."""
        more = n_samples - self.force.size
        return replace(
            self, force=np.pad(self.force, (0, more)), at_sensors=np.pad(self.at_sensors, ((0, more), (0, 0)))
        )


def forced_record(recording: Recording, *, name: str, force: str, drive_point: str) -> ForcedRecord:
    """Return a recording as that of a structure driven at one point; all channels that read a motion are its sensors.

    Strain gauges are sensors, too.

    Args:
        recording: a recording with the force in N and accelerations in m/s^2; velocities are differentiated once,
            displacements and strains twice.
        name: the name of the test.
        force: channel of the force.
        drive_point: the sensor where and in whose direction the force acts.

    Raises:
        InputError: no such channel, a force in another unit or none, no sensor, a strain gauge as drive point, or a
            strain that no structure bears.
    """
    sensors = [each for each in recording.names if recording.unit(each) in READINGS]
    for what, wanted, known in (("force", force, recording.names), ("sensor", drive_point, sensors)):
        if wanted not in known:
            raise InputError(f"test {name!r} has no {what} {wanted!r}: {nearest(wanted, known)}")
    check_force(recording, force, name)
    for each in sensors:
        check_reading(recording, each, name)
    accelerations = with_accelerations(recording, sensors)
    if accelerations.unit(drive_point) != ACCELERATION:
        raise InputError(
            f"the force of test {name!r} acts at {drive_point!r}, which reads a strain: name a sensor that reads the "
            "motion there, which gives the modal masses"
        )
    columns = [accelerations.index(each) for each in sensors]
    clipped = clipped_fractions(recording)
    return ForcedRecord(
        name,
        recording.fs,
        recording.channel(force),
        accelerations.samples[:, columns],
        tuple(accelerations.unit(each) for each in sensors),
        tuple(sensors),
        drive_point,
        recording.files,
        tuple(each for each in sensors if each in clipped),
        force in clipped,
    )


@dataclass(frozen=True, eq=False)
class ModeIndicator:
    """The complex mode indicator function: how many modes respond at a line, and how strongly.

    Args:
        frequency_hz: (n,) lines, Hz.
        value: (n, n_values) singular values of the sensors x drive points matrix, largest first, m/s^2/N.
    """

    frequency_hz: FloatArray
    value: FloatArray


def measured_response(
    tests: Sequence[ModalTest | ForcedRecord], *, nperseg: int | None = None, window: Window = "hann"
) -> FrequencyResponse:
    """Return the frequency response that tests with one drive point show, H1 = sum X conj(F) / sum |F|^2.

    Each record is transformed whole and without a window, which is right for a transient that begins at rest and has
    decayed at its end. No exponential or force window is applied.

    Args:
        tests: tests of one drive point and rate; shorter records count as followed by rest.
        nperseg: samples of a block for stationary excitation: the records are cut into blocks that overlap by half.
        window: window of these blocks, see scipy.signal.get_window; not used without `nperseg`.

    Raises:
        InputError: no test, one without a force or given twice, or tests of several drive points, rates or sets of
            sensors.

    >>> from opid.modal.linear.modes import modal_test
    >>> from opid.signals.recording import Channel, Recording
    >>> modes = LinearModes([0.0], [0.0], [[0.5]], ("a",))
    >>> samples = np.outer([0.0, 4.0, 0.0, 0.0], [0.25, 1.0])
    >>> hit = Recording(samples, fs=8.0, channels=(Channel("a", "m/s^2"), Channel("force", "N")))
    >>> response = measured_response([modal_test(hit, modes, name="hit", force="force", drive_point="a")])
    >>> response.value[:, 0].real.tolist()
    [0.25, 0.25, 0.25]
    """
    sensors, drive_point = _require_alike(tests)
    records = [(np.asarray(test.force), test.at_sensors) for test in tests]
    frequency_hz, cross, force_power, output_power, n_averages = (
        _average_records(records, tests[0].fs)
        if nperseg is None
        else _average_blocks(records, tests[0].fs, nperseg, window)
    )
    coherence = None
    if n_averages > 1:
        both = force_power[:, None] * output_power
        coherence = np.clip(_divide(np.abs(cross) ** 2, both), 0, 1)
    value = _divide(cross, force_power[:, None])
    left = 0.0 if nperseg is not None else max(_measure_end(motion) for _, motion in records)
    peaks = [float(np.abs(force).max()) for force, _ in records]
    ratio = max(peaks) / max(min(peaks), 1e-300)
    clipped = {name for test in tests for name in test.clipped_sensors}
    return FrequencyResponse(
        frequency_hz,
        value,
        sensors,
        drive_point,
        n_averages,
        coherence,
        left,
        ratio,
        tests[0].units,
        tuple(name for name in sensors if name in clipped),
        any(test.has_clipped_force for test in tests),
    )


def _measure_end(motion: FloatArray) -> float:
    """Return the rms of the last part of a record over that of the part with the largest motion."""
    power = [float(np.mean(part**2)) for part in np.array_split(motion, min(MODAL.parts_of_record, len(motion)))]
    return float(np.sqrt(power[-1] / max(power))) if max(power) > 0.0 else 0.0


def resynthesised(modes: LinearModes, frequency_hz: ArrayLike, drive_point: str) -> FrequencyResponse:
    """Return the accelerance of the linear modes, A = sum phi phi_d (-omega^2) / (k0 + j omega c0 - omega^2).

    A rigid-body mode gives the constant phi phi_d.

    Args:
        modes: the linear modes.
        frequency_hz: (n,) lines, Hz.
        drive_point: the sensor where and in whose direction the force acts.

    Raises:
        InputError: no such sensor, lines that are not finite numbers from 0 up, or one on the resonance of an undamped
            mode.

    >>> modes = LinearModes([0.0, 10.0], [0.0, 0.01], [[0.5, 0.3], [0.5, -0.3]], ("left", "right"))
    >>> resynthesised(modes, [0.0, 10.0], "left").value[:, 0].round(6).tolist()
    [(0.25+0j), (0.25+4.5j)]
    """
    lines = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    if lines.ndim != 1 or lines.size == 0 or not (np.isfinite(lines) & (lines >= 0)).all():
        raise InputError(f"frequency_hz has shape {lines.shape}: give one row of finite frequencies from 0 up, Hz")
    single = accelerance(modes, lines)
    if np.isinf(single).any():
        line, mode = np.argwhere(np.isinf(single))[0]
        raise InputError(
            f"mode {mode + 1} has no damping and its resonance falls on {lines[line]:g} Hz: give it damping, or "
            "leave out the line"
        )
    value = (single * modes.row(drive_point)) @ modes.shapes.T
    return FrequencyResponse(lines, value, modes.sensors, drive_point, n_averages=0, units=modes.units)


def weigh_response(response: FrequencyResponse, modes: LinearModes) -> FrequencyResponse:
    """Return a response whose strains have the weights by which the modal filter of some modes takes them for motions.

    Args:
        response: a response.
        modes: modes that have its sensors.
    """
    weights = dict(zip(modes.sensors, weigh_sensors(modes), strict=True))
    return replace(response, value=response.value * np.array([weights[sensor] for sensor in response.sensors]))


def accelerance(modes: LinearModes, frequency_hz: FloatArray) -> ComplexArray:
    """Return q''/f_q of each mode alone, (n, n_modes): -omega^2 / (k0 + j omega c0 - omega^2), 1 for a rigid-body mode.

    It is infinite on the resonance of a mode without damping.
    """
    omega = 2 * np.pi * frequency_hz[:, None]
    dynamic = modes.stiffness() + 1j * omega * modes.damping() - omega**2
    found = np.where(modes.elastic, np.inf, np.ones(dynamic.shape, dtype=np.complex128))
    np.divide(-(omega**2), dynamic, out=found, where=modes.elastic & (dynamic != 0))
    return found


def cmif(responses: Sequence[FrequencyResponse]) -> ModeIndicator:
    """Return the complex mode indicator function: singular values of the responses (sensors x drive points), by line.

    A mode shows as a peak of the largest singular value. With two drive points or more, two modes at nearly one
    frequency show as peaks of two values (Shih et al., Mechanical Systems and Signal Processing 2, 1988). Strains count
    like motions if `weigh_response` has weighted them.

    Args:
        responses: one response for each drive point, at the same lines and sensors.

    Raises:
        InputError: no response, or responses of other lines or sensors.

    >>> modes = LinearModes([10.0], [0.01], [[0.3], [0.4]], ("a", "b"))
    >>> cmif([resynthesised(modes, [10.0], "a")]).value.round(6).tolist()
    [[7.5]]
    """
    if not responses:
        raise InputError("there is no response: give one for each drive point")
    first = responses[0]
    for each in responses[1:]:
        if each.sensors != first.sensors:
            raise InputError(
                f"the responses to {each.drive_point!r} and {first.drive_point!r} have different sensors: give both at "
                "the same sensors"
            )
        same = each.frequency_hz.shape == first.frequency_hz.shape
        if not same or not np.allclose(each.frequency_hz, first.frequency_hz, rtol=1e-9, atol=0):
            raise InputError(
                f"the responses to {each.drive_point!r} and {first.drive_point!r} have different lines: use records of "
                "one length and rate"
            )
    matrix = np.stack([each.value for each in responses], axis=-1)
    value = np.full((matrix.shape[0], min(matrix.shape[1:])), np.nan)
    known = np.isfinite(matrix).all(axis=(1, 2))
    value[known] = np.linalg.svd(matrix[known], compute_uv=False)
    return ModeIndicator(first.frequency_hz, value)


def _require_alike(tests: Sequence[ModalTest | ForcedRecord]) -> tuple[tuple[str, ...], str]:
    """Return the sensors and the drive point that all tests have in common."""
    if not tests:
        raise InputError("there is no test: give one or several with a force at one drive point")
    first = tests[0]
    for test in tests:
        if test.force is None:
            raise InputError(
                f"test {test.name!r} has no force: a frequency response needs one, so name the force channel"
            )
        if test.drive_point != first.drive_point:
            raise InputError(
                f"test {test.name!r} is driven at {test.drive_point!r} and {first.name!r} at {first.drive_point!r}: "
                "average tests of one drive point"
            )
        if abs(test.fs / first.fs - 1) > 1e-9:
            raise InputError(
                f"test {test.name!r} has {test.fs:g} Hz and {first.name!r} {first.fs:g} Hz: resample them to one rate"
            )
        if test.sensors != first.sensors:
            raise InputError(
                f"tests {test.name!r} and {first.name!r} have different sensors: average tests with the same"
            )
    for one, other in combinations(tests, 2):
        is_same_force = np.array_equal(np.asarray(one.force), np.asarray(other.force))
        if is_same_force and np.array_equal(one.at_sensors, other.at_sensors):
            raise InputError(
                f"tests {one.name!r} and {other.name!r} hold the same samples, and a record is no repeat of itself: "
                "give each once"
            )
    return first.sensors, str(first.drive_point)


Records = Sequence[tuple[FloatArray, FloatArray]]
"""Force and accelerations of each test."""

Averages = tuple[FloatArray, ComplexArray, FloatArray, FloatArray, float]
"""Lines, sum of X conj(F), of |F|^2 and of |X|^2, number of averages."""


def _average_records(records: Records, fs: float) -> Averages:
    n_samples = max(force.size for force, _ in records)
    pairs = [(fft.rfft(f, n_samples), fft.rfft(x, n_samples, axis=0)) for f, x in records]
    cross = np.sum([x * f.conj()[:, None] for f, x in pairs], axis=0)
    force_power = np.sum([np.abs(f) ** 2 for f, _ in pairs], axis=0)
    output_power = np.sum([np.abs(x) ** 2 for _, x in pairs], axis=0)
    return fft.rfftfreq(n_samples, 1 / fs), cross, force_power, output_power, float(len(records))


def _average_blocks(records: Records, fs: float, nperseg: int, window: Window) -> Averages:
    shape = (nperseg // 2 + 1, records[0][1].shape[1])
    cross, output_power = np.zeros(shape, dtype=np.complex128), np.zeros(shape)
    force_power, n_averages = np.zeros(shape[0]), 0.0
    for force, accelerations in records:
        # The loop takes one sensor at a time, for spectra between sensors are not needed.
        for sensor, acceleration in enumerate(accelerations.T):
            found = cross_spectra(np.stack([force, acceleration], axis=1), fs=fs, window=window, nperseg=nperseg)
            cross[:, sensor] += found.n_blocks * found.density[:, 0, 1]
            output_power[:, sensor] += found.n_blocks * found.density[:, 1, 1].real
        force_power += found.n_blocks * found.density[:, 0, 0].real
        n_averages += found.n_averages
    return fft.rfftfreq(nperseg, 1 / fs), cross, force_power, output_power, n_averages


def _divide(numerator: np.ndarray, denominator: FloatArray) -> np.ndarray:
    """Return a quotient that is nan where the denominator is 0."""
    found = np.full_like(numerator, np.nan)
    return np.divide(numerator, denominator, out=found, where=np.broadcast_to(denominator != 0, numerator.shape))
