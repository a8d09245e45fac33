"""The calibration of a bench: what is believed of it, what the record tells of it, and how far it moves the parameters.

The calibration u is the gains and their drift, the lag of the force, the mass between force cell and specimen, and
high-pass filters. A gain moves each parameter as its unit says. The others add a force u c(t), which moves the
least-squares parameters of the slopes J by pinv(J) c u. What is left of c beside the slopes, above noise and away from
the ends of the record, shows u itself in the residual; belief and record are combined by their precisions (Gelman et
al., Bayesian Data Analysis, 2013, 2.5).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from opid.estimate import Estimate
from opid.mechanics.laws.law import FloatArray, Law
from opid.suspensions.bench.problem import all_points
from opid.suspensions.bench.record import Bench, gain_of_rate, rate_of, smooth_floor
from opid.suspensions.bench.settings import BenchSettings, CalibrationSettings, RecordSettings
from opid.suspensions.bench.simulation import SimulatedFit
from opid.suspensions.fitting.least_squares import SeparableFit, clustered_covariance
from opid.suspensions.sensor_facts import USUAL_LAG_TOLERANCE_S


class CalibrationName(StrEnum):
    """What nobody knows exactly about the channels of a bench."""

    FORCE_GAIN = "force gain"
    TRAVEL_GAIN = "travel gain"
    VELOCITY_GAIN = "velocity gain"
    LAG = "lag"
    MASS = "mass"
    FORCE_DRIFT = "drift of the force gain"
    TRAVEL_DRIFT = "drift of the travel gain"
    FORCE_CORNER = "high-pass corner of the force"
    TRAVEL_CORNER = "high-pass corner of the travel"


@dataclass(frozen=True)
class CalibrationError:
    """One thing that nobody knows exactly about the channels of a bench.

    Args:
        name: a gain or by how much it grows from the middle to the end of the record, the lag of the force, the mass
            between force cell and specimen, or the corner of a high-pass filter of a channel.
        unit: its unit, "1" for a fraction.
        tolerance: its standard deviation as it was stated.
        found: what the tolerance and the record tell of it together; it is not corrected.
    """

    name: CalibrationName
    unit: str
    tolerance: float
    found: Estimate


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is known of the calibration of a bench.

    Args:
        errors: each thing that is not exact, with what belief and record tell of it.
        covariance: covariance that they make of the parameters, in the order of the slopes.
        imitated_lag_s: the lag of the force with which a law that does not lag explains as much; 0 if none does.
    """

    errors: tuple[CalibrationError, ...]
    covariance: FloatArray
    imitated_lag_s: float


def find_calibration(
    bench: Bench,
    fit: SeparableFit,
    refined: SimulatedFit | None,
    data: tuple[FloatArray, FloatArray, NDArray[np.int64]],
    settings: BenchSettings,
    *,
    without_lag: SeparableFit | None = None,
) -> Calibration:
    """Return what is known of the calibration.

    Args:
        bench: the record.
        fit: the law that was fitted to it.
        refined: the same law by simulation; None where there is none.
        data: the slopes of the fit, its residual, and the cell of each sample, then those of prior knowledge.
        settings: the tuned numbers.
        without_lag: where a term of the law lags behind the motion, the fit of the best law without such a term: if it
            explains the force as well once the force is shifted, the shift is believed possible.
    """
    unknowns, imitated_lag_s = _list_unknowns(bench, fit, refined, settings), 0.0
    if without_lag is not None and unknowns and unknowns[0].column_at is not None:
        cells = data[2][: without_lag.residual.size]
        imitated_lag_s = _find_imitated_lag(bench, unknowns[0], fit, without_lag, cells, settings.calibration)
        unknowns[0] = replace(unknowns[0], imitated=imitated_lag_s)
    return Calibration(*_combine(bench, fit, unknowns, data, settings.calibration), imitated_lag_s)


STRAIGHT_UNITS = {"stiffness": "N/m", "damping": "N s/m", "offset": "N", "mass": "kg"}


def _combine(
    bench: Bench,
    fit: SeparableFit,
    unknowns: list[_Unknown],
    data: tuple[FloatArray, FloatArray, NDArray[np.int64]],
    known: CalibrationSettings,
) -> tuple[tuple[CalibrationError, ...], FloatArray]:
    """Return what is known of the calibration, and the covariance of the parameters that it makes.

    `data` are those of `find_calibration`.
    """
    tolerances, errors = bench.tolerances, list[CalibrationError]()
    n_values = data[0].shape[1]
    covariance = np.zeros((n_values, n_values))
    for name, powers in _count_powers(bench, fit).items():
        std = tolerances.gain_tolerance
        errors.append(CalibrationError(name, "1", std, Estimate.normal(0.0, std)))
        values = np.zeros(n_values)
        values[: powers.size] = powers * np.concatenate([fit.weights, fit.law.vector])
        covariance += std**2 * np.outer(values, values)
    calibration, by_unknowns = _tell_unknowns(_settle_lag(unknowns, data, known), data, known)
    if unknowns and not calibration[0].found.value:
        calibration, by_unknowns = _tell_unknowns(unknowns, data, known)
    return (*errors, *calibration), covariance + by_unknowns


def _settle_lag(
    unknowns: Sequence[_Unknown], data: tuple[FloatArray, FloatArray, NDArray[np.int64]], known: CalibrationSettings
) -> Sequence[_Unknown]:
    """Return the unknowns, and what a lag adds at the lag that was found with it: it is not proportional to the lag."""
    previous, at = 0.0, unknowns[0].column_at if unknowns else None
    if at is None:
        return unknowns
    for _ in range(known.most_lag_passes):
        lag = _tell_unknowns(unknowns, data, known)[0][0].found
        if not lag.value or abs(lag.value - previous) <= known.lag_moves * (lag.std or 0.0):
            break
        previous = lag.value
        unknowns = [replace(unknowns[0], column=at(previous)), *unknowns[1:]]
    return unknowns


def _tell_unknowns(
    unknowns: Sequence[_Unknown], data: tuple[FloatArray, FloatArray, NDArray[np.int64]], known: CalibrationSettings
) -> tuple[tuple[CalibrationError, ...], FloatArray]:
    """Return what belief and record tell of the unknowns, and the covariance of the parameters that they make."""
    slopes, residual, cells = data
    if not unknowns:
        return (), np.zeros((slopes.shape[1], slopes.shape[1]))
    n, columns = unknowns[0].column.size, np.zeros((residual.size, len(unknowns)))
    columns[:n] = np.stack([each.column for each in unknowns], axis=1)
    moves = _project(slopes, columns)
    beside = columns - slopes @ moves
    for k, each in enumerate(unknowns):
        if each.is_end is not None:
            beside[: each.is_end.size][each.is_end, k] = 0.0
    # What a column holds of the noise of the force looks like a remainder that the law cannot imitate.
    noise = np.sqrt(n) * np.array([each.noise for each in unknowns])
    size = np.maximum(known.above_noise * noise, known.least_seen * np.linalg.norm(columns, axis=0))
    seen = np.linalg.norm(beside, axis=0) > size
    seen &= [each.imitated == 0.0 for each in unknowns]
    believed = np.array(
        [
            _widen_tolerance(each, beside[:, k], residual, cells, known)
            if seen[k]
            else max(each.tolerance, abs(each.imitated))
            for k, each in enumerate(unknowns)
        ]
    )
    # Counted in tolerances, which may be as small as one likes, the prior is the standard normal.
    mean, posterior = np.zeros(len(unknowns)), np.eye(len(unknowns))
    if seen.any():
        # Of several unknowns only the sums are told that stand above what noise would make of them.
        scaled = beside[:, seen] / size[seen]
        _, heights, axes = np.linalg.svd(scaled, full_matrices=False)
        kept = axes[heights > 1.0]
        of_sums = scaled @ kept.T
        told = np.linalg.lstsq(of_sums, residual, rcond=None)[0]
        covariance_of_told = clustered_covariance(of_sums, residual - of_sums @ told, cells)
        sums, precision_of_told = kept * (size * believed)[seen], np.linalg.pinv(covariance_of_told, hermitian=True)
        precision, axes = np.linalg.eigh(sums.T @ precision_of_told @ sums)
        shown = np.maximum(precision, 0.0)
        own = np.ix_(seen, seen)
        posterior[own] = (axes / (1.0 + shown)) @ axes.T
        mean[seen] = posterior[own] @ (sums.T @ (precision_of_told @ told))
    mean, posterior = believed * mean, posterior * np.outer(believed, believed)
    errors = tuple(
        CalibrationError(each.name, each.unit, each.tolerance, Estimate.normal(value, std))
        for each, value, std in zip(unknowns, mean.tolist(), np.sqrt(np.diag(posterior)).tolist(), strict=True)
    )
    # The parameters stay those of the fit, so the mean is an error of theirs, too, and so is each cause by itself.
    alone = np.diag(
        [
            value**2 if value > each.tolerance and not each.imitated else 0.0
            for value, each in zip(believed.tolist(), unknowns, strict=True)
        ]
    )
    squares, axes = np.linalg.eigh(posterior + np.outer(mean, mean) + alone)
    moved = moves @ axes * np.sqrt(np.maximum(squares, 0.0))
    return errors, moved @ moved.T


def _widen_tolerance(
    unknown: _Unknown, column: FloatArray, residual: FloatArray, cells: NDArray[np.int64], known: CalibrationSettings
) -> float:
    """Return the tolerance of an unknown, or, where the record contradicts it, what the record shows of it alone.

    `column` is what it adds to the force beside the slopes.
    """
    value = float(column @ residual / (column @ column))
    std = float(np.sqrt(clustered_covariance(column[:, np.newaxis], residual - value * column, cells)[0, 0]))
    is_contradicted = abs(value) > known.told_sigma * np.hypot(std, unknown.tolerance)
    return abs(value) if is_contradicted else unknown.tolerance


def _norms(columns: FloatArray) -> FloatArray:
    return np.maximum(np.linalg.norm(columns, axis=0), 1e-300)


@dataclass(frozen=True, eq=False)
class _Unknown:
    """An unknown of the calibration.

    Args:
        name: what it is.
        unit: its unit.
        tolerance: what is believed of it.
        column: (n,) what it adds to the force for each unit, N.
        column_at: returns the column where the unknown has a value that is not small; None if it adds in proportion.
        noise: rms of what the column is made of noise, N for each unit.
        is_end: (n,) whether a sample is so near to an end of the record that its rate is not exact there: what the
            column is there beside the law tells nothing. None if it needs no rate.
        imitated: the value at which it would explain the record as well as a term of the law does, in whose place the
            record then tells nothing of it; 0 if there is none.
    """

    name: CalibrationName
    unit: str
    tolerance: float
    column: FloatArray
    column_at: Callable[[float], FloatArray] | None = None
    noise: float = 0.0
    is_end: NDArray[np.bool_] | None = None
    imitated: float = 0.0


def _list_unknowns(
    bench: Bench, fit: SeparableFit, refined: SimulatedFit | None, settings: BenchSettings
) -> list[_Unknown]:
    """Return what is not exact and adds a force, where the test has it; the lag is the first."""
    tolerances, samples, known = bench.tolerances, bench.samples, settings.calibration
    if bench.is_quasi_static:
        # A specimen that wears in a slow test drifts as a gain does, so that the record tells nothing of the gain.
        return [replace(each, noise=np.inf) for each in _list_drifts(bench, fit) if each.tolerance > 0.0]
    believed_s, mass_kg = tolerances.lag_tolerance_s, tolerances.mass_tolerance_kg
    if believed_s is None:
        believed_s = float(np.hypot(USUAL_LAG_TOLERANCE_S, known.samples_of_lag / bench.fs))
    if mass_kg is None:
        mass_kg = known.mass_per_force * float(np.abs(bench.force[samples] - np.mean(bench.force[samples])).max())
    # A motion that is simulated from a late force is late itself.
    if refined is None:
        found = [_late_force(bench, believed_s, fit.residual, settings)]
    else:
        found = [_Unknown(CalibrationName.LAG, "s", believed_s, bench.velocity[samples])]
    if refined is None and bench.mass_kg is None:
        found.append(_moving_mass(bench, mass_kg, fit.residual, settings))
    if refined is None:
        found += [*_list_drifts(bench, fit), *_list_corners(bench, fit, known)]
    return [each for each in found if each.tolerance > 0.0]


def has_lag(law: Law) -> bool:
    """Return whether a term of a law lags behind its motion, as the whole force would if it were late."""
    return any(parameter.role == "lag" for parameter in law.parameter_list)


def _late_force(bench: Bench, tolerance_s: float, residual: FloatArray, settings: BenchSettings) -> _Unknown:
    """Return the lag of the force, which adds its lag times minus the mean rate of the force until so late.

    >>> time = np.arange(400) / 100.0
    >>> bench = Bench(time, np.ones(400), np.sin(2 * time), 100.0, 0.0, "recorded", None, {}, ())
    >>> added = 0.1 * _late_force(bench, 1e-3, bench.force, BenchSettings()).column_at(0.1)
    >>> bool(np.abs(added - np.sin(2 * time) + np.sin(2 * (time + 0.1)))[50:-50].max() < 0.002)
    True
    """
    from scipy.interpolate import CubicSpline

    time = np.arange(bench.force.size) / bench.fs
    record = replace(settings.record, left_above=settings.calibration.left_above)
    rate, band_hz = rate_of(bench.force, fs=bench.fs, settings=record)
    total = CubicSpline(time, rate).antiderivative()

    def add(lag_s: float) -> FloatArray:
        mean = (total(np.clip(time + lag_s, 0.0, time[-1])) - total(time)) / lag_s
        return np.asarray(-mean[bench.samples])

    return _Unknown(
        CalibrationName.LAG,
        "s",
        tolerance_s,
        -rate[bench.samples],
        add,
        _find_noise([bench.force, residual], bench.fs, (band_hz,), record),
        _find_ends(bench, band_hz, settings.calibration),
    )


def _moving_mass(bench: Bench, tolerance_kg: float, residual: FloatArray, settings: BenchSettings) -> _Unknown:
    """Return the mass between force cell and specimen."""
    acceleration, band_hz = rate_of(bench.velocity, fs=bench.fs, settings=settings.record)
    motion, bands_hz = bench.velocity, [band_hz]
    if bench.velocity_band_hz is not None:  # it was differentiated from the travel
        motion, bands_hz = bench.travel, [band_hz, bench.velocity_band_hz]
    samples = bench.samples
    # The noise of the motion is in the residual, too, as the force that the specimen makes of it.
    of_residual = residual * float(np.std(motion[samples]) / np.std(bench.force[samples]))
    noise = _find_noise([motion, of_residual], bench.fs, bands_hz, settings.record)
    is_end = _find_ends(bench, min(bands_hz), settings.calibration)
    return _Unknown(CalibrationName.MASS, "kg", tolerance_kg, acceleration[samples], None, noise, is_end)


def _find_ends(bench: Bench, band_hz: float, known: CalibrationSettings) -> NDArray[np.bool_]:
    """Return which samples that count lie within the ringing of the filter of a rate from an end of the record."""
    n = bench.force.size
    reach = min(known.ringing * bench.fs / band_hz, known.longest_end * n)
    return np.asarray(np.minimum(bench.samples, n - 1 - bench.samples) < reach)


def _find_noise(bounds: Sequence[FloatArray], fs: float, bands_hz: Sequence[float], settings: RecordSettings) -> float:
    """Return the rms that the noise of a signal has at most after a rate of each of these bands, Hz.

    `bounds` are signals that hold the noise: at each frequency it is at most the floor of each around that frequency,
    and at most the middle power of each.

    >>> rng, time = np.random.default_rng(0), np.arange(4000) / 500
    >>> noisy = np.sin(50 * time) + 0.1 * rng.standard_normal(time.size)
    >>> round(_find_noise([noisy], 500.0, [], RecordSettings()), 2)
    0.1
    >>> round(_find_noise([noisy], 500.0, [20.0], RecordSettings()))
    2
    """
    from scipy import signal

    n, least = min(256, *(each.size for each in bounds)), np.inf
    for each in bounds:
        frequency, power = signal.welch(each, fs, nperseg=n)
        least = np.minimum(least, np.minimum(smooth_floor(power, settings), np.median(power)))
    gain = np.prod([gain_of_rate(frequency, band) for band in bands_hz], axis=0)
    return float(np.sqrt(0.5 * fs * np.mean(least * gain**2)))


def _find_imitated_lag(
    bench: Bench,
    late: _Unknown,
    fit: SeparableFit,
    without_lag: SeparableFit,
    cells: NDArray[np.int64],
    known: CalibrationSettings,
) -> float:
    """Return the lag of the force with which a law that does not lag explains as much as one that does, s; else 0."""
    slopes = all_points(bench).slopes(without_lag.law)
    calibration, _ = _combine(bench, without_lag, [late], (slopes, without_lag.residual, cells), known)
    lag_s, std = calibration[-1].found.value or 0.0, calibration[-1].found.std or 0.0
    if late.column_at is None or abs(lag_s) <= known.told_sigma * std:
        return 0.0
    added = lag_s * late.column_at(lag_s)
    left = without_lag.residual - added + slopes @ _project(slopes, added)
    more, beyond = np.sum(left**2) / np.sum(fit.residual**2), np.sum(left**2) - np.sum(fit.residual**2)
    # A delay that the tolerance does not hold need not be one of all frequencies, as that of a filter is not.
    is_near = abs(lag_s) > late.tolerance and beyond < known.nearly * left.size * np.var(bench.force[bench.samples])
    return lag_s if more < known.as_well or is_near else 0.0


def _project(slopes: FloatArray, columns: FloatArray) -> FloatArray:
    """Return by how much each parameter would take columns for its own."""
    norms = _norms(slopes)
    return np.asarray((np.linalg.lstsq(slopes / norms, columns, rcond=1e-12)[0].T / norms).T)


def _list_drifts(bench: Bench, fit: SeparableFit) -> list[_Unknown]:
    """Return the drifts of the gains from the middle of the record to its end; a preload drifts with the force."""
    late, gain = np.linspace(-1.0, 1.0, bench.force.size), bench.tolerances.gain_tolerance
    stiffness, damping, away = _find_tangents(bench, fit)
    columns = (
        (CalibrationName.FORCE_DRIFT, late * bench.force),
        (CalibrationName.TRAVEL_DRIFT, -late * (stiffness * away + damping * bench.velocity)),
    )
    return [_Unknown(name, "1", gain, column[bench.samples]) for name, column in columns]


def _list_corners(bench: Bench, fit: SeparableFit, known: CalibrationSettings) -> list[_Unknown]:
    """Return the high-pass filters of first order of the channels.

    What is read as y behind such a filter of corner b is y + b int y dt before it.
    """
    force = bench.force - np.mean(bench.force[bench.samples])
    stiffness, damping, away = _find_tangents(bench, fit)
    corner = 0.0 if bench.tolerances.lag_tolerance_s == 0.0 else known.corner_per_s
    columns = (
        (CalibrationName.FORCE_CORNER, -np.cumsum(force) / bench.fs),
        (CalibrationName.TRAVEL_CORNER, stiffness * np.cumsum(away) / bench.fs + damping * away),
    )
    return [_Unknown(name, "1/s", corner, column[bench.samples]) for name, column in columns]


def _find_tangents(bench: Bench, fit: SeparableFit) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return tangent stiffness, N/m, and damping, N s/m, and the travel from its mean, m, of every sample."""
    by_travel, by_velocity = fit.law.gradient(bench.travel, bench.velocity)
    damping = 0.0 if bench.is_quasi_static else fit.weights[1]
    return fit.weights[0] + by_travel, damping + by_velocity, bench.travel - np.mean(bench.travel)


def _count_powers(bench: Bench, fit: SeparableFit) -> dict[CalibrationName, FloatArray]:
    """Return by which power each parameter goes with the gain of force, travel and velocity, from its unit.

    A velocity that was differentiated has the gain of the travel. The values of memories at the start are left out.
    """
    names = [name for name in STRAIGHT_UNITS if not (bench.is_quasi_static and name == "damping")]
    powers = [_read_powers(STRAIGHT_UNITS[name], 1.0) for name in names[: fit.weights.size]]
    for term in fit.law.terms:
        own = {p.name: value for p, value in zip(term.kind.parameters, term.values, strict=True)}
        powers += [_read_powers(parameter.unit, own.get("exponent", 1.0)) for parameter in term.kind.parameters]
    table = np.array(powers)
    force, travel, velocity = table.T
    if bench.channels.get("velocity") is None:
        return {CalibrationName.FORCE_GAIN: force, CalibrationName.TRAVEL_GAIN: travel + velocity}
    return {
        CalibrationName.FORCE_GAIN: force,
        CalibrationName.TRAVEL_GAIN: travel,
        CalibrationName.VELOCITY_GAIN: velocity,
    }


def _read_powers(unit: str, exponent: float) -> tuple[float, float, float]:
    """Return the powers of force, travel and velocity in a unit like "N s^n/m^n", n the exponent.

    >>> _read_powers("N s^2/m^2", 1.0), _read_powers("N/m^n", 2.5), _read_powers("m/s", 1.0), _read_powers("kg", 1.0)
    ((1.0, 0.0, -2.0), (1.0, -2.5, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, -1.0))
    """
    if unit == "kg":  # force over the rate of the velocity
        return 1.0, 0.0, -1.0
    powers = dict.fromkeys(("N", "m", "s"), 0.0)
    above, _, below = unit.partition("/")
    for part, sign in ((above, 1.0), (below, -1.0)):
        for word in part.split():
            symbol, _, power = word.partition("^")
            if symbol in powers:
                powers[symbol] += sign * (exponent if power == "n" else float(power or 1.0))
    return powers["N"], powers["m"] + powers["s"], 0.0 - powers["s"]


_DRIFT = (
    "the gain of the {what} grows by {{value:.2g}} (standard deviation {{std:.1g}}), as a fraction, from the middle of "
    "the record to its end, or the specimen changes so: the intervals allow for it, and no value is corrected; record "
    "when sensors and specimen are warm, or give a shorter stretch"
)
_CORNER = (
    "the {what} lacks slow motion, as behind a high-pass filter with a corner of {{value:.2g}} rad/s (standard "
    "deviation {{std:.1g}} rad/s): the intervals allow for it, and no value is corrected; record it with DC coupling"
)


def warn_of_calibration(calibration: Sequence[CalibrationError], known: CalibrationSettings) -> Iterator[str]:
    """Yield a sentence for a lag and for a mass that the record shows beyond what was believed of it."""
    remedies = {
        CalibrationName.LAG: "the force comes {size:.2g} s {after} the motion (standard deviation {std:.1g} s): the "
        "intervals allow for it, and no value is corrected; " + _SHIFT,
        CalibrationName.MASS: "the force follows the acceleration like that of {value:.2g} kg (standard deviation "
        "{std:.1g} kg) between force cell and specimen: the intervals allow for it, and no value is corrected; give "
        "moving_mass = true (--moving-mass), by which the mass is found",
        CalibrationName.FORCE_DRIFT: _DRIFT.format(what="force"),
        CalibrationName.TRAVEL_DRIFT: _DRIFT.format(what="travel"),
        CalibrationName.FORCE_CORNER: _CORNER.format(what="force"),
        CalibrationName.TRAVEL_CORNER: _CORNER.format(what="travel"),
    }
    for each in calibration:
        value, std = each.found.value, each.found.std
        if value is None or std is None or each.name not in remedies:
            continue
        if abs(value) > max(known.told_sigma * std, known.told_of_tolerance * each.tolerance):
            yield remedies[each.name].format(value=value, std=std, size=abs(value), after=_after(value))


def warn_of_imitated_lag(law: Law, without_lag: Law, lag_s: float) -> Iterator[str]:
    """Yield that what lags in a law may be the force.

    Args:
        law: the law that was found, with a term that lags.
        without_lag: a law that does not lag, and ...
        lag_s: ... the lag of the force with which it explains as much, s; 0 if it does not.
    """
    if lag_s:
        yield (
            f"the law {law.name} lags behind the motion, but a law that does not ({without_lag.name}) and a force that "
            f"comes {abs(lag_s):.2g} s {_after(lag_s)} the motion explain this record as well: the intervals allow for "
            f"it; {_SHIFT}"
        )


_SHIFT = "sample both channels at once with the same filters, or shift the force"


def _after(lag_s: float) -> str:
    return "after" if lag_s > 0 else "before"
