"""Record of a test bench: force, travel and velocity of one damper or spring, and the study of such a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, NotDeterminedError, nearest, require_fraction
from opid.mechanics.laws.law import default_law
from opid.mechanics.memory import RecordedMotion, recorded_motion
from opid.provenance import ReadFile
from opid.signals.health.result import Finding
from opid.signals.recording import FloatArray, Recording
from opid.suspensions.bench.settings import DEFAULTS, RecordSettings
from opid.suspensions.sensor_facts import USUAL_GAIN_TOLERANCE
from opid.suspensions.study import area_faults

_NEEDED = {"force": ("N", "N, kN or lbf"), "travel": ("m", "m, mm or in"), "velocity": ("m/s", "m/s, mm/s or in/s")}
_ACCELERATION = ("m/s^2", "m/s^2 or g")


@dataclass(frozen=True)
class BenchTolerances:
    """How well the channels of a test bench are calibrated, as standard deviations of what nobody knows exactly.

    Args:
        gain_tolerance: of the gains of force, travel and velocity, each as a fraction, and of how far they drift until
            the end of the record; 0 for exact ones.
        lag_tolerance_s: of the time by which the force comes after the motion, s; None for the usual one, see
            `CalibrationSettings`; 0 if the channels have one phase, without a high-pass filter.
        mass_tolerance_kg: of the mass of what moves between the force cell and the specimen, kg; None for the usual
            one, likewise.

    Raises:
        InputError: a number that is negative, or a gain that is not below 1.
    """

    gain_tolerance: float = USUAL_GAIN_TOLERANCE
    lag_tolerance_s: float | None = None
    mass_tolerance_kg: float | None = None

    def __post_init__(self) -> None:
        require_fraction("gain_tolerance", self.gain_tolerance)
        for name in ("lag_tolerance_s", "mass_tolerance_kg"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < np.inf:
                raise InputError(f"{name} is {value}: give 0 or more")


@dataclass(frozen=True, eq=False)
class Bench:
    """What a test bench recorded, in SI units.

    Args:
        travel: (n,) z, m, counted from `travel_zero_m` of the record.
        velocity: (n,) z', m/s.
        force: (n,) N.
        fs: sampling rate, Hz.
        travel_zero_m: value of the record's travel from which z is counted, m.
        velocity_from: source of the velocity, in words.
        velocity_band_hz: highest frequency of a differentiated travel, Hz; None for a recorded velocity.
        channels: names of the columns, {"force": ..., "travel": ..., "velocity": ... or None}.
        warnings: what limits the record, one sentence each.
        acceleration: (n,) z'', m/s^2, if parts of unknown mass move with the specimen; otherwise None.
        counted: (n,) whether the law holds for a sample, None for all. While a valve or a voltage is in another state,
            the motion is followed and not fitted.
        is_quasi_static: whether time has no meaning: `fs` is then samples per metre of the path, and `velocity` the
            direction, 1 or -1.
        mass_kg: mass of the body whose acceleration was measured in place of the force, see `bench_from_recording`;
            None if a force was measured.
        piston_area_m2: area that the gas of a strut pushes on; None if it is not known, or if no gas carries it.
        tolerances: how well the channels are calibrated.
        log: the file that it was read from without a study file; None if it came otherwise.
        source: the study file; None if there is none.
        files: the files that it was read from.
    """

    travel: FloatArray
    velocity: FloatArray
    force: FloatArray
    fs: float
    travel_zero_m: float
    velocity_from: str
    velocity_band_hz: float | None
    channels: dict[str, str | None]
    warnings: tuple[str, ...]
    acceleration: FloatArray | None = None
    counted: NDArray[np.bool_] | None = None
    is_quasi_static: bool = False
    mass_kg: float | None = None
    piston_area_m2: float | None = None
    tolerances: BenchTolerances = BenchTolerances()
    log: Path | None = None
    source: Path | None = None
    files: tuple[ReadFile, ...] = ()

    @property
    def samples(self) -> NDArray[np.int64]:
        """(m,) indices of the samples that count."""
        return np.arange(self.force.size) if self.counted is None else np.flatnonzero(self.counted)

    @property
    def motion(self) -> RecordedMotion:
        """The motion of all samples, in the form for laws."""
        return recorded_motion(self.travel, self.velocity, self.fs)

    @property
    def columns(self) -> FloatArray:
        """Columns that enter the force linearly: travel, velocity and one, (n, 3), and acceleration of moving parts.

        A quasi-static test has travel and one, (n, 2).
        """
        moving = [] if self.acceleration is None else [self.acceleration]
        velocity = [] if self.is_quasi_static else [self.velocity]
        return np.stack([self.travel, *velocity, np.ones_like(self.travel), *moving], axis=1)


def bench_from_recording(
    recording: Recording,
    *,
    force: str,
    travel: str,
    velocity: str | None = None,
    moving_mass: bool = False,
    mass_kg: float | None = None,
    counted: ArrayLike | None = None,
    settings: RecordSettings = DEFAULTS.record,
) -> Bench:
    """Take force and motion from a recording.

    If no force was measured, it follows from the acceleration a of a body that only the specimen holds: F = -m a
    (d'Alembert), with a positive if the travel grows when the body moves. Gravity and an accelerometer's offset are
    constant and belong to the offset of the law; with a mass of 1 kg all forces are forces per kilogram.

    If no velocity was recorded, it is `rate_of` the travel. Travel is counted as recorded, or from its mean if the
    record never comes near its zero: a law of the travel needs a zero that the motion passes.

    Args:
        recording: recording of the bench, in SI units.
        force: name of the channel of the force, or with `mass_kg` of the acceleration.
        travel: name of the channel of the travel (extension).
        velocity: name of the channel of its rate, or None.
        moving_mass: whether parts of unknown mass move between the force and the specimen. Their acceleration is the
            rate of the velocity.
        mass_kg: mass of a body that only the specimen holds; None if a force was measured.
        counted: (n,) whether the law holds for a sample; None for all. Memories are followed through the other samples,
            too.
        settings: thresholds for warnings about a record.

    Raises:
        InputError: an unknown channel, one in the wrong unit or named twice, too few samples, a mass that is no
            positive number or is given with a moving mass, or samples that do not count together with a moving mass,
            whose motion is simulated without a gap.
        NotDeterminedError: a travel or a force that never changes.

    >>> from opid.signals.recording import Channel
    >>> t = np.arange(4000) / 500
    >>> samples = np.stack([np.sin(9 * t), 0.01 * np.sin(9 * t)], axis=1)
    >>> record = Recording(samples, fs=500.0, channels=(Channel("pull", "N"), Channel("stroke", "m")))
    >>> bench = bench_from_recording(record, force="pull", travel="stroke")
    >>> bool(np.abs(bench.velocity - 0.09 * np.cos(9 * t))[200:-200].max() < 1e-4)
    True
    """
    is_number = isinstance(mass_kg, Real) and not isinstance(mass_kg, bool)
    if mass_kg is not None and not (is_number and np.isfinite(mass_kg) and mass_kg > 0):
        raise InputError(f"mass_kg is {mass_kg!r}: give the mass of the body, a number of more than 0 kg")
    if mass_kg is not None and moving_mass:
        raise InputError(
            "mass_kg beside moving_mass: the force of a known mass is that of its acceleration, beside which a part of "
            "unknown mass is not determined; leave one of them out"
        )
    y, raw, zero, warnings = _read_force_and_travel(recording, force, travel, velocity, settings, mass_kg)
    rate, band_hz = rate_of(raw, fs=recording.fs, settings=settings, force=y)
    if velocity is None:
        v, origin = rate, f"{travel!r} differentiated up to {band_hz:.3g} Hz"
    else:
        v, origin = recording.channel(velocity), f"recorded, {velocity!r}"
        warnings += _warn_of_rate(v, rate, travel, velocity, settings)
    return Bench(
        travel=raw - zero,
        velocity=v,
        force=y,
        fs=recording.fs,
        travel_zero_m=zero,
        velocity_from=origin,
        velocity_band_hz=band_hz if velocity is None else None,
        channels={"force": force, "travel": travel, "velocity": velocity},
        warnings=tuple(warnings),
        acceleration=rate_of(v, fs=recording.fs, settings=settings)[0] if moving_mass else None,
        counted=None if counted is None else _check_counted(counted, recording.n_samples, moving_mass, settings),
        mass_kg=mass_kg,
        files=recording.files,
    )


def quasi_static_bench(
    recording: Recording, *, force: str, travel: str, settings: RecordSettings = DEFAULTS.record
) -> Bench:
    """Take force and travel from a test so slow that time has no meaning; the recording may have any rate.

    The path is divided into equal steps, and the length along it replaces time. Laws and memories of travel do not
    depend on the pace. The samples that count are those nearest to the recorded ones.

    Args:
        recording: recording of the test, in SI units.
        force: name of the channel of the force.
        travel: name of the channel of the travel (extension).
        settings: thresholds for warnings about a record.

    Raises:
        InputError: an unknown channel, one in the wrong unit or named twice, or too few samples.
        NotDeterminedError: a travel or a force that never changes.

    >>> from opid.signals.recording import Channel
    >>> turns = np.interp(np.arange(400), [0, 100, 300, 400], [0.0, 0.01, -0.01, 0.0])
    >>> samples = np.stack([1e4 * turns, turns], axis=1)
    >>> record = Recording(samples, fs=1.0, channels=(Channel("pull", "N"), Channel("stroke", "m")))
    >>> bench = quasi_static_bench(record, force="pull", travel="stroke")
    >>> sorted(set(bench.velocity.tolist())), round(bench.force.size / bench.fs, 3)
    ([-1.0, 1.0], 0.04)
    """
    recorded_y, raw, zero, warnings = _read_force_and_travel(recording, force, travel, None, settings)
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(raw)))])
    n = settings.path_steps * raw.size
    step = float(path[-1]) / (n - 1)
    along = np.arange(n) * step
    # The direction of each point is that of its segment.
    moves = np.flatnonzero(np.diff(path) > 0)
    segment = moves[np.minimum(np.searchsorted(path[moves + 1], along), moves.size - 1)]
    direction = np.sign(raw[segment + 1] - raw[segment])
    counted = np.zeros(n, dtype=bool)
    counted[np.round(path / step).astype(np.int64)] = True
    if counted.sum() < settings.least_samples:
        raise InputError(
            f"the travel {travel!r} has {counted.sum()} different places along its path of {recording.n_samples} "
            f"samples, and a quasi-static test needs {settings.least_samples}: record finer, or more cycles"
        )
    last = np.append(moves, raw.size - 1)
    z, y = (np.interp(along, path[last], each[last]) for each in (raw - zero, recorded_y))
    names: dict[str, str | None] = {"force": force, "travel": travel, "velocity": None}
    bench = Bench(z, direction, y, 1.0 / step, zero, "none, a quasi-static test", None, names, tuple(warnings))
    return replace(bench, counted=counted, is_quasi_static=True, files=recording.files)


def _read_force_and_travel(
    recording: Recording,
    force: str,
    travel: str,
    velocity: str | None,
    settings: RecordSettings,
    mass_kg: float | None = None,
) -> tuple[FloatArray, FloatArray, float, list[str]]:
    """Return force and travel as recorded, the value of the travel that counts as zero, and warnings."""
    names = {"force": force, "travel": travel} | ({} if velocity is None else {"velocity": velocity})
    for role, name in names.items():
        _check_channel(recording, role, name, names, is_acceleration=role == "force" and mass_kg is not None)
    if recording.n_samples < settings.least_samples:
        raise InputError(f"the record has {recording.n_samples} samples: at least {settings.least_samples} are needed")
    y, raw = recording.channel(force), recording.channel(travel)
    if mass_kg is not None:
        y = -mass_kg * y
    for role, values, (least, most), unit in (
        ("travel", raw, settings.span_m, "m"),
        ("force", y, settings.span_n, "N"),
    ):
        largest = np.abs(values).max()
        if largest > most or 0.0 < largest < least:
            and_mass = " and the mass" * (role == "force" and mass_kg is not None)
            raise InputError(
                f"the {role} {names[role]!r} reaches {largest:.2g} {unit}, and that of a bench is {least:g} to "
                f"{most:g} {unit}: check its unit{and_mass}"
            )
        if np.ptp(values) <= 1e-9 * np.abs(values).max():
            what = "moves: a law needs motion" if role == "travel" else "changes: a law has nothing to explain"
            raise NotDeterminedError(f"the {role} {names[role]!r} never {what}")
    warnings = []
    if _count_turns(raw, settings.turn * float(np.ptp(raw))) < 2:
        warnings.append(
            f"the travel {travel!r} turns round less than twice: friction cannot be distinguished from the offset, nor "
            "a law with memory from one without; record several cycles"
        )
    zero = 0.0
    if np.abs(raw.mean()) > np.ptp(raw):
        zero = float(raw.mean())
        warnings.append(
            f"the travel {travel!r} never comes near its zero: it is counted from its mean, {1e3 * zero:.4g} mm"
        )
    return y, raw, zero, warnings


def _count_turns(travel: FloatArray, least_m: float) -> int:
    """Return how often a travel turns round and goes back by more than `least_m`."""
    count, direction, extreme = 0, 0, float(travel[0])
    for value in travel.tolist():
        if direction * (value - extreme) > 0 or (direction == 0 and abs(value - extreme) > least_m):
            direction = direction or (1 if value > extreme else -1)
            extreme = value
        elif direction and abs(value - extreme) > least_m:
            count, direction, extreme = count + 1, -direction, value
    return count


def _check_counted(counted: ArrayLike, n_samples: int, moving_mass: bool, settings: RecordSettings) -> np.ndarray:
    which = np.asarray(counted)
    if which.dtype != np.bool_ or which.shape != (n_samples,):
        raise InputError(
            f"counted has type {which.dtype} and shape {which.shape}: give one truth value a sample, {n_samples}"
        )
    if which.sum() < settings.least_samples:
        remedy = (
            "take a longer record"
            if which.any()
            else "no sample counts, so the law never holds in this record; take a record in which it does"
        )
        raise InputError(f"{which.sum()} samples count: at least {settings.least_samples} are needed; {remedy}")
    if moving_mass and not which.all():
        raise InputError(
            "counted beside moving_mass: the motion is simulated without a gap, give a stretch of the record"
        )
    return which


def rate_of(
    samples: FloatArray, *, fs: float, settings: RecordSettings = DEFAULTS.record, force: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Differentiate a signal in the band in which it exceeds its noise.

    The Fourier transform is multiplied by j omega / (1 + (f/f_c)^8), zero phase, on a record continued at both ends by
    its point reflection, which keeps value and slope. f_c lies half above the frequency at which the motion ends: where
    the Welch spectrum last stands `above_floor` times above its floor (the median of the top fifth), or before that
    where the spectrum of the rate is lowest, if all above it holds less than `left_above` of the rate's power. A line
    above it is a motion if the force has it, too: hum of a travel sensor makes no force.

    Args:
        samples: (n,) the signal.
        fs: sampling frequency, Hz.
        settings: the tuned numbers.
        force: (n,) the force that the signal makes as a motion, N; None if it is not known.

    Returns:
        (n,) the rate, in the unit of the signal per second, and f_c, Hz.

    >>> t = np.arange(5000) / 500
    >>> noisy = np.sin(9 * t) + 1e-3 * np.random.default_rng(0).standard_normal(t.size)
    >>> rate, band_hz = rate_of(noisy, fs=500.0)
    >>> bool(np.std(rate - 9 * np.cos(9 * t)) < 0.05 < np.std(np.gradient(noisy, t) - 9 * np.cos(9 * t)))
    True
    """
    from scipy import fft, signal

    n = samples.size
    line = np.linspace(samples[0], samples[-1], n)
    bent = samples - line
    n_segment = min(n, max(256, n // 8))
    frequency, power = signal.welch(bent, fs, nperseg=n_segment)
    of_force = None if force is None else signal.welch(force, fs, nperseg=n_segment)[1]
    # The margin of half an octave keeps the filter from weakening the last strong line.
    band_hz = float(np.clip(1.5 * _find_end_of_motion(frequency, power, of_force, settings), 8 * fs / n, fs / 2))
    # Both ends of `bent` are zero, so the point reflection is the odd continuation.
    extended = np.concatenate([-bent[:0:-1], bent, -bent[-2::-1]])
    n_fft = fft.next_fast_len(extended.size, real=True)
    f = fft.rfftfreq(n_fft, 1 / fs)
    rate = fft.irfft(fft.rfft(extended, n_fft) * 1j * gain_of_rate(f, band_hz), n_fft)[n - 1 : 2 * n - 1]
    return rate + (samples[-1] - samples[0]) / (n - 1) * fs, band_hz


def gain_of_rate(frequency_hz: FloatArray, band_hz: float) -> FloatArray:
    """Return the gain, 1/s, with which `rate_of` differentiates at each frequency, for a band f_c."""
    return np.asarray(2 * np.pi * frequency_hz / (1 + (frequency_hz / band_hz) ** 8))


def smooth_floor(power: FloatArray, settings: RecordSettings) -> FloatArray:
    """Return the middle power around each frequency of a spectrum (n,), which no line raises."""
    from scipy import ndimage

    return np.asarray(ndimage.median_filter(power, settings.line_width, mode="reflect"))


def _find_end_of_motion(
    frequency: FloatArray, power: FloatArray, of_force: FloatArray | None, settings: RecordSettings
) -> float:
    """Return the frequency above which a spectrum holds noise, Hz; the spectrum of the force tells lines from hum."""
    floor = float(np.median(power[-max(1, power.size // 5) :]))
    above = np.flatnonzero(power > settings.above_floor * floor)
    end = int(above[-1]) if above.size else power.size - 1
    # If the noise is not white, the spectrum of the rate falls to a minimum between the motion and the noise.
    rate = frequency**2 * power
    edges = np.unique(np.geomspace(1, power.size, 40).astype(int))
    thirds = np.add.reduceat(rate, edges[:-1]) / np.diff(edges)
    peak = int(np.argmax(thirds))
    valley = int(edges[peak + int(np.argmin(thirds[peak:]))])
    if np.sum(rate[valley:]) < settings.left_above * np.sum(rate):
        spectra = () if of_force is None else (power, of_force)
        lines = [set(np.flatnonzero(each > settings.line * smooth_floor(each, settings)).tolist()) for each in spectra]
        end = min(end, max([valley, *set.intersection(*lines)])) if lines else min(end, valley)
    return float(frequency[end])


def _check_channel(
    recording: Recording, role: str, name: str, names: dict[str, str], *, is_acceleration: bool = False
) -> None:
    if name not in recording.names:
        raise InputError(f"there is no column {name!r} for the {role}: {nearest(name, recording.names)}")
    others = [other for other in names if other != role and names[other] == name]
    if others:
        raise InputError(f"the column {name!r} is given for both {role} and {others[0]}: each needs its own")
    unit, usual = _ACCELERATION if is_acceleration else _NEEDED[role]
    found = recording.unit(name)
    if found == unit:
        return
    hint = next((other for other in names if other != role and recording.unit(names[other]) == unit), None)
    if hint is not None:
        remedy = f"{names[hint]!r} is in {unit}: are {role} and {hint} swapped?"
    elif is_acceleration and found == "N":
        remedy = "it is a force already: leave the mass out"
    elif role == "force" and found == _ACCELERATION[0]:
        remedy = "give the mass of the body that it accelerates (--mass), if the specimen alone holds it"
    elif role == "force" and found == "kg":
        remedy = f"give {usual} in the header, or as unit in [channels] of a study (lb is a mass, lbf a force)"
    else:
        fitting = [channel.name for channel in recording.channels if channel.unit == unit]
        remedy = (
            f"in {unit} there is {', '.join(map(repr, fitting))}"
            if fitting
            else f"give {usual} in the header, or as unit in [channels] of a study"
        )
    what = "an acceleration" if is_acceleration else f"a {role}"
    raise InputError(f"the column {name!r} is in {found}, {what} is in {unit}: {remedy}")


def _warn_of_rate(v: FloatArray, rate: FloatArray, travel: str, velocity: str, settings: RecordSettings) -> list[str]:
    """Compare a recorded velocity with the rate of the travel."""
    spread = float(np.std(v) * np.std(rate))
    correlation = float(np.mean((v - v.mean()) * (rate - rate.mean()))) / spread if spread > 0 else 0.0
    if correlation < -settings.rate_correlation:
        return [f"the velocity {velocity!r} has the opposite sign of the rate of the travel {travel!r}: turn one round"]
    factor = float(np.std(v) / max(float(np.std(rate)), 1e-300))
    least, most = settings.rate_factor
    if correlation < settings.rate_correlation or not least <= factor <= most:
        return [
            f"the velocity {velocity!r} is not the rate of the travel {travel!r} ({factor:.3g} times it, correlation "
            f"{correlation:.2f}): check columns and units, or leave the velocity out"
        ]
    return []


@dataclass(frozen=True, eq=False)
class BenchStudy:
    """A study of a record of a test bench, for `law_of_bench`.

    Args:
        title: title of the study.
        recording: the recording, in SI units.
        force: name of the channel of the force, or with `mass_kg` of the acceleration.
        travel: name of the channel of the travel (extension).
        velocity: name of the channel of its rate; the travel is differentiated if it is left out.
        mass_kg: mass of a body that only the specimen holds; None if a force was measured.
        moving_mass: whether parts of unknown mass move between the force and the specimen.
        quasi_static: whether the test was so slow that time has no meaning.
        counted: name of a channel that is 0 where the law does not hold: such samples are followed and not fitted.
        candidates: kinds that the law may consist of; None for every kind that is searched.
        most_terms: most terms of the law; None for the value of the settings.
        piston_area_m2: area that the gas of a strut pushes on, with which its pressure and volume are reported; None if
            it is not known, or if no gas carries it.
        gain_tolerance: as in `BenchTolerances`, like the next two.
        lag_tolerance_s: standard deviation of the time by which the force comes after the motion, s.
        mass_tolerance_kg: standard deviation of the mass between force cell and specimen, kg.
        findings: findings of the health check of the log.
        source: the study file; None if there is none.
        log: the file that it was read from without a study file; None if it came otherwise.

    Raises:
        InputError: an unknown kind, an invalid piston area or tolerance, a quasi-static test with a velocity, a mass, a
            moving mass, a lag or samples that do not count, or as for `bench_from_recording`.
        NotDeterminedError: a travel or a force that never changes.
    """

    title: str
    recording: Recording
    force: str
    travel: str
    velocity: str | None = None
    mass_kg: float | None = None
    moving_mass: bool = False
    quasi_static: bool = False
    counted: str | None = None
    candidates: Sequence[str] | None = None
    most_terms: int | None = None
    piston_area_m2: float | None = None
    gain_tolerance: float = USUAL_GAIN_TOLERANCE
    lag_tolerance_s: float | None = None
    mass_tolerance_kg: float | None = None
    findings: tuple[Finding, ...] = ()
    source: Path | None = None
    log: Path | None = None

    def __post_init__(self) -> None:
        for kind in self.candidates or ():
            default_law(kind)  # refuses an unknown kind
        if self.most_terms is not None and self.most_terms < 0:
            raise InputError(f"most_terms is {self.most_terms}: give 0 or more")
        for fault in area_faults(self.piston_area_m2):
            raise InputError(fault)
        timed = [
            name
            for name in ("velocity", "mass_kg", "moving_mass", "counted", "lag_tolerance_s", "mass_tolerance_kg")
            if getattr(self, name)
        ]
        if self.quasi_static and timed:
            raise InputError(
                f"quasi_static beside {' and '.join(timed)}: a test without a time scale has none; leave it out"
            )
        assert self.bench  # refuses a wrong record

    @cached_property
    def bench(self) -> Bench:
        """The record in SI units."""
        if self.quasi_static:
            found = quasi_static_bench(self.recording, force=self.force, travel=self.travel)
        else:
            found = bench_from_recording(
                self.recording,
                force=self.force,
                travel=self.travel,
                velocity=self.velocity,
                moving_mass=self.moving_mass,
                mass_kg=self.mass_kg,
                counted=None if self.counted is None else self.recording.channel(self.counted) != 0,
            )
        of_log = (f"{each.channel}: " * bool(each.channel) + each.message for each in self.findings)
        return replace(
            found,
            warnings=(*found.warnings, *of_log),
            piston_area_m2=self.piston_area_m2,
            tolerances=BenchTolerances(self.gain_tolerance, self.lag_tolerance_s, self.mass_tolerance_kg),
            source=self.source,
            log=self.log,
        )
