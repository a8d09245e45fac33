"""Measurements that contradict the others, or the structure, by more than their stated errors: one sentence for each.

A curve in another unit, a sensor with a wrong gain or in the place of another one, a structure with another frequency
and a changed structure all leave a law that fits tolerably and intervals that are narrow. What is left of the data with
the best parameters of a class tells them from chance.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, ModeData, with_amplitudes
from opid.updating.likelihood.curves import BoolArray, make_curves
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.measured import MeasuredBackbone, by_mode
from opid.updating.model_class import ModelClass
from opid.updating.settings import UPDATING

_STEP = 0.01  # Lambda of the model is differentiated over this to either side, in the logarithm of the amplitude.


@dataclass(frozen=True, eq=False)
class _CurveFit:
    """How one curve differs from the model: as if its frequencies and its amplitudes were off by a factor each.

    Args:
        curve: the curve.
        offset: relative error of its frequencies at small amplitudes.
        log_amplitude: error of the logarithm of its amplitudes; nan where lambda hardly grows.
        log_amplitude_std: standard deviation of that by the scatter of the points.
    """

    curve: MeasuredBackbone
    offset: float
    log_amplitude: float
    log_amplitude_std: float


@dataclass(frozen=True)
class Contradiction:
    """What contradicts the other measurements or the structure.

    Args:
        sentence: the contradiction in a sentence.
        spoils_theta: whether theta is wrong by more than its interval tells, if the sentence is right.
    """

    sentence: str
    spoils_theta: bool = True


def find_contradictions(
    data: BackboneData,
    model_class: ModelClass,
    best: FloatArray,
    backbones: Sequence[MeasuredBackbone],
    *,
    unfit: Container[int] = (),
) -> Iterator[Contradiction]:
    """Yield what contradicts the other measurements or the structure by more than the stated errors.

    Args:
        data: the backbones in the recommended form; other forms have no stated errors.
        model_class: the class that explains them best.
        best: (n_parameters,) its best parameters.
        backbones: the measured backbones.
        unfit: numbers of the modes that the class does not fit, whose offsets are errors of the law.
    """
    if data.form != "recommended":
        return
    fits: list[_CurveFit] = []
    for mode, curves in zip(data.modes, by_mode(backbones).values(), strict=True):
        own = _fit_curves(data, mode, curves, model_class, best)
        if mode.mode not in unfit:  # The extrapolation of a wrong law to small amplitudes has an error of its own.
            yield from map(Contradiction, _warn_of_frequency(mode, own, data.noise))
        # A day has an offset of its own, which changes no growth.
        yield from (Contradiction(each, spoils_theta=False) for each in _warn_of_days(mode, own, data.noise))
        fits += own
    # A curve in another unit spoils the model, and a sensor in the place of the controlled one all amplitudes.
    yield from (
        [*map(Contradiction, _warn_of_scales(backbones, data.noise))]
        or [*_find_wrong_sensors(data, model_class, best)]
        or map(Contradiction, _warn_of_amplitudes(fits))
    )


# ---- frequencies and amplitudes of curves -----------------------------------------------------------


def _fit_curves(
    data: BackboneData, mode: ModeData, curves: Sequence[MeasuredBackbone], model_class: ModelClass, best: FloatArray
) -> list[_CurveFit]:
    """Return how each curve of a mode differs from the model; none where the model has no curve."""
    at_points = []
    for factor in (1.0, np.exp(_STEP), np.exp(-_STEP)):
        scaled = data
        for sensor, _ in mode.parts:
            scaled = with_amplitudes(scaled, sensor, factor)
        own = next(each for each in scaled.modes if each.mode == mode.mode)
        eigenvalue, _, _, lost = make_curves(scaled, own, model_class)(best[np.newaxis])
        if lost[0]:
            return []
        at_points.append(mode.between @ eigenvalue[0] / mode.linear)
    error, slope = mode.eigenvalue / mode.linear - at_points[0], (at_points[1] - at_points[2]) / (2 * _STEP)
    fits = []
    for number, curve in enumerate(curves):
        mine = mode.curve == number
        if np.ptp(slope[mine]) < UPDATING.least_growth or mine.sum() < 4:
            fits.append(_CurveFit(curve, float(error[mine].mean()) / 2, np.nan, np.nan))
            continue
        start, factor, std = _fit_line(slope[mine], error[mine], 2 * data.noise.point_noise)
        # Amplitudes that are (1 + 2 e)^1/2 times as large make the growth about 1 + 2 e times as large.
        grown = max(1 + 2 * factor, UPDATING.least_grown)
        fits.append(_CurveFit(curve, start / 2, float(np.log(grown)) / 2, std / grown))
    return fits


def _warn_of_frequency(mode: ModeData, fits: Sequence[_CurveFit], noise: NoiseSettings) -> Iterator[str]:
    """Yield at most one sentence, on a structure whose frequency is off by more than `linear_error` allows."""
    if not fits:
        return
    offsets = np.array([each.offset for each in fits])
    scatter = max(noise.curve_offset, float(offsets.std(ddof=1)) if offsets.size > 1 else 0.0)
    expected = float(np.hypot(noise.linear_error, scatter / np.sqrt(offsets.size)))
    off = float(offsets.mean())
    if abs(off) > UPDATING.missed_sigma * expected:
        yield (
            f"the curves of mode {mode.mode} lie {100 * abs(off):.1f} % {'above' if off > 0 else 'below'} the linear "
            f"frequency of the structure, {mode.linear**0.5 / (2 * np.pi):.4g} Hz, where linear_error allows "
            f"{100 * noise.linear_error:.2g} %: the shape and the growth of this mode may be as wrong, so update the "
            "structure, or state its error"
        )


def _warn_of_days(mode: ModeData, fits: Sequence[_CurveFit], noise: NoiseSettings) -> Iterator[str]:
    """Yield at most one sentence, on a test day whose frequencies are off by more than `day_offset` allows."""
    days = list(dict.fromkeys(each.curve.day for each in fits if each.curve.day))
    of_day = [np.array([each.offset for each in fits if each.curve.day == day]) for day in days]
    if len(days) < 2:
        return
    centred = np.concatenate([each - each.mean() for each in of_day])
    freedom = centred.size - len(days)
    scatter = float(np.sqrt(centred @ centred / freedom)) if freedom else 0.0
    scatter = max(scatter, noise.curve_offset if freedom < UPDATING.few_sets else 0.0)
    for day, own in zip(days, of_day, strict=True):
        others = np.concatenate([each for name, each in zip(days, of_day, strict=True) if name != day])
        off = float(own.mean() - others.mean())
        expected = np.sqrt(
            noise.day_offset**2 * (1 + 1 / (len(days) - 1)) + scatter**2 * (1 / own.size + 1 / others.size)
        )
        if abs(off) > UPDATING.contradicting_sigma * expected:
            yield (
                f"the frequencies of mode {mode.mode} on day {day!r} are {100 * abs(off):.2g} % "
                f"{'above' if off > 0 else 'below'} those of the other days, where day_offset allows "
                f"{100 * noise.day_offset:.2g} %: the structure changed between the tests; state a larger day_offset, "
                "or update each day by itself"
            )
            return


def _warn_of_amplitudes(fits: Sequence[_CurveFit]) -> Iterator[str]:
    """Yield at most one sentence, on curves whose amplitudes contradict those of the others.

    Curves are divided by day, by the controlled sensor, by mode, and each from the others of its mode; the division
    that explains most is told.
    """
    known = [each for each in fits if np.isfinite(each.log_amplitude)]
    if len(known) < 2:
        return
    value = np.array([each.log_amplitude for each in known])
    own_std = np.array([each.log_amplitude_std for each in known])
    modes = [each.curve.mode for each in known]
    divisions: list[tuple[str, list[bool], list[bool]]] = []  # words, curves that they mean, and the others
    for day in dict.fromkeys(each.curve.day for each in known if each.curve.day):
        there = [each.curve.day == day for each in known]
        divisions.append((f"the curves of day {day!r}", there, [not each for each in there]))
    for sensor in dict.fromkeys(each.curve.controlled_sensor for each in known):
        there = [each.curve.controlled_sensor == sensor for each in known]
        divisions.append((f"the curves over the amplitude of sensor {sensor!r}", there, [not each for each in there]))
    for mode in dict.fromkeys(modes):
        there = [each == mode for each in modes]
        divisions.append((f"the curves of mode {mode}", there, [not each for each in there]))
    for number, each in enumerate(known):
        there = [other == number for other in range(len(known))]
        beside = [mode == each.curve.mode and other != number for other, mode in enumerate(modes)]
        divisions.append((f"curve {each.curve.name!r}", there, beside))
    found = []
    for words, there, beside in divisions:
        one, other = np.flatnonzero(there), np.flatnonzero(beside)
        if not (one.size and other.size):
            continue
        # The median of the others leaves out a second odd curve among them.
        off = float(value[one].mean() - np.median(value[other]))
        left = np.concatenate([value[one] - value[one].mean(), value[other] - np.median(value[other])])
        freedom = max(left.size - 2, 1)
        # The scatter between curves, and what their own points tell of each.
        variance = left @ left / freedom * (1 / one.size + 1 / other.size)
        variance += sum(float(np.mean(own_std[each] ** 2)) / each.size for each in (one, other))
        score = abs(off) / np.sqrt(variance)
        if abs(off) > UPDATING.least_apart and score > UPDATING.contradicting_sigma:
            found.append((score, off, words))
    if found:
        _, off, words = max(found)
        yield (
            f"the amplitudes of {words} contradict those of the others, with which they agree if they are multiplied "
            f"by {np.exp(off):.2g}: check their unit and the gain of their sensor; theta is a compromise between them"
        )


def _warn_of_scales(backbones: Sequence[MeasuredBackbone], noise: NoiseSettings) -> Iterator[str]:
    """Yield a sentence for each curve that has grown as far as the others at amplitudes of another unit.

    It needs no model, which such a curve can spoil: curves of a mode over one sensor that begin at small amplitudes
    have grown by the same fraction at the same amplitude. Curves that begin at larger ones are not compared.
    """
    alike: dict[tuple[int, str], list[MeasuredBackbone]] = {}
    for curve in backbones:
        alike.setdefault((curve.mode, curve.controlled_sensor), []).append(curve)
    for curves in alike.values():
        growths = [np.abs(each.eigenvalue / each.eigenvalue[0] - 1) for each in curves]
        common, found = min(float(each.max()) for each in growths), []
        for curve, growth in zip(curves, growths, strict=True):
            near = growth <= common
            size, grown = curve.controlled_amplitude[near], growth[near]
            if size.size < 4 or np.ptp(grown) < UPDATING.least_growth or size[0] > UPDATING.small_start * size[-1]:
                continue
            _, slope, std = _fit_line(size**2, grown, 2 * noise.point_noise)
            if slope > 0.0:
                # Amplitudes that are s times as large make this slope 1 / s^2 times as large.
                found.append((curve, -np.log(slope) / 2, std / slope / 2))
        if len(found) < UPDATING.fewest_alike:
            continue
        middle, error = (float(np.median([each[column] for each in found])) for column in (1, 2))
        for curve, own, std in found:
            off = own - middle
            if abs(off) > max(np.log(UPDATING.another_unit), UPDATING.contradicting_sigma * np.hypot(std, error)):
                yield (
                    f"curve {curve.name!r} has grown as far as the other curves of mode {curve.mode} at "
                    f"{np.exp(off):.2g} times their amplitudes: check its unit, and whether it is peak, rms or peak "
                    "to peak; it spoils theta"
                )


def _fit_line(x: FloatArray, y: FloatArray, least_noise: float) -> tuple[float, float, float]:
    """Return start and slope of a line, and the standard deviation of the slope by the scatter of the points."""
    size = float(np.abs(x).max())
    terms = np.column_stack([np.ones_like(x), x / size])
    (start, slope), left, *_ = np.linalg.lstsq(terms, y, rcond=None)
    variance = max(float(left.sum()) / (x.size - 2), least_noise**2)
    std = float(np.sqrt(variance * np.linalg.inv(terms.T @ terms)[1, 1]))
    return float(start), float(slope) / size, std / size


# ---- sensors ----------------------------------------------------------------------------------------


def _find_wrong_sensors(data: BackboneData, model_class: ModelClass, best: FloatArray) -> Iterator[Contradiction]:
    """Yield at most one contradiction: two sensors in each other's place, or one with another gain or sign."""
    shapes = _compare_shapes(data, model_class, best)
    if shapes is None:
        return
    (measured, model), names, std = shapes, data.system.sensors, _find_shape_std(data.noise)
    controlled = {sensor for mode in data.modes for sensor, _ in mode.parts}
    seen = np.isfinite(measured)

    def find_misfit(shapes: FloatArray) -> float:
        # Each mode has the length that fits the model best, by the sensors that agree.
        told = _find_moving(model) & (shapes != 0.0)
        told[~told.any(axis=1)] = shapes[~told.any(axis=1)] != 0.0
        scale = np.nanmedian(np.where(told, model / np.where(told, shapes, 1.0), np.nan), axis=1)
        error = np.where(seen, shapes * scale[:, np.newaxis] - model, 0.0) / std
        return float(np.sum(np.minimum(error**2, UPDATING.most_misfit**2)))

    as_given = find_misfit(measured)
    exchanged = []
    for one, other in combinations(range(len(names)), 2):
        if seen[:, [one, other]].all():
            swapped = measured.copy()
            swapped[:, [one, other]] = measured[:, [other, one]]
            exchanged.append((find_misfit(swapped), one, other))
    if exchanged:
        left, one, other = min(exchanged)
        if as_given - left > UPDATING.contradicting_sigma**2 and left < UPDATING.better_exchanged * as_given:
            yield Contradiction(
                f"sensors {names[one]!r} and {names[other]!r} seem to be exchanged: the measured shapes are nearer to "
                f"the structure then (misfit {left:.0f} instead of {as_given:.0f}); check the order of the columns",
                spoils_theta=not controlled.isdisjoint({names[one], names[other]}),
            )
            return
    gains = _estimate_gains(names, measured, model, std)
    found = [each for each in gains if each.score > UPDATING.contradicting_sigma and each.apart > UPDATING.least_apart]
    if found:
        worst = max(found, key=lambda each: each.score)
        yield Contradiction(
            f"sensor {worst.name!r} reads {worst.gain:.2g} times what the structure and the other sensors say, in all "
            "modes in which it moves: check its unit, its gain and its sign; where it is the controlled sensor, theta "
            "is wrong",
            spoils_theta=worst.name in controlled,
        )


def find_motion_errors(data: BackboneData, model_class: ModelClass, best: FloatArray) -> dict[str, float]:
    """Return the relative standard deviation of the amplitudes of each controlled sensor, by its name.

    It is `motion_error`, and more where the shapes say that the sensor reads another multiple of its motion than the
    others by more than chance: the variance that this takes is added.
    """
    stated = data.noise.motion_error
    errors = {sensor: stated for mode in data.modes for sensor, _ in mode.parts}
    shapes = _compare_shapes(data, model_class, best) if stated else None
    for each in _estimate_gains(data.system.sensors, *shapes, _find_shape_std(data.noise)) if shapes else ():
        if each.name in errors:
            beyond = max(each.apart**2 - (UPDATING.odd_gain_sigma * each.std) ** 2, 0.0)
            errors[each.name] = float(np.sqrt(stated**2 + beyond))
    return errors


def _compare_shapes(
    data: BackboneData, model_class: ModelClass, best: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the measured shapes and those of the model, (n_modes, n_sensors); None where they are not used."""
    pairs = [pair for mode in data.modes if (pair := _find_shapes(data, mode, model_class, best)) is not None]
    if not pairs or not data.noise.shapes:
        return None
    measured, model = (np.array(each) for each in zip(*pairs, strict=True))
    return measured, model


def _find_shape_std(noise: NoiseSettings) -> float:
    return float(np.hypot(noise.linear_shape_error, noise.shape_offset))


@dataclass(frozen=True)
class _Gain:
    """The motion of a sensor in all modes over what the structure and the other sensors say."""

    name: str
    gain: float
    std: float  # by the errors of the shapes

    @property
    def apart(self) -> float:
        return abs(self.gain - 1.0)

    @property
    def score(self) -> float:
        return self.apart / self.std


def _estimate_gains(names: Sequence[str], measured: FloatArray, model: FloatArray, std: float) -> list[_Gain]:
    """Return the gain of each sensor that moves enough and has the same one in all modes."""
    # Of two sensors nobody knows which one is wrong.
    kept = _find_moving(model).sum(axis=1) >= UPDATING.fewest_alike
    moves = _find_moving(model) & kept[:, np.newaxis]
    ratio = np.where(moves, measured / np.where(moves, model, 1.0), np.nan)
    # A mode in which most sensors are dead tells no gain.
    kept[kept] = np.nanmedian(ratio[kept], axis=1) != 0.0
    if not kept.any():
        return []
    model, moves, ratio = model[kept], moves[kept], ratio[kept] / np.nanmedian(ratio[kept], axis=1, keepdims=True)
    found = []
    for column, name in enumerate(names):
        own, weight = ratio[moves[:, column], column], (model[moves[:, column], column] / std) ** 2
        if not own.size:
            continue
        gain = _Gain(name, float(weight @ own / weight.sum()), float(np.sqrt(1 / weight.sum())))
        # A gain is the same in all modes; an error of a shape is not.
        if np.sqrt(weight @ (own - gain.gain) ** 2 / own.size) < gain.score / 2:
            found.append(gain)
    return found


def _find_moving(model: FloatArray) -> BoolArray:
    """Return which sensors move enough to tell their gain, (n_modes, n_sensors); not those that a curve lacks."""
    size = np.nan_to_num(np.abs(model))
    return np.asarray(size > UPDATING.least_motion * size.max(axis=1, keepdims=True))


def _find_shapes(
    data: BackboneData, mode: ModeData, model_class: ModelClass, best: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the mean measured shape of a mode and that of the model, (n_sensors,) each, nan where a sensor lacks.

    They are means over the points, in the unit of the model's shapes of unit length. None where the model has no curve.
    """
    _, shapes, _, lost = make_curves(data, mode, model_class)(best[np.newaxis])
    if lost[0]:
        return None
    expected, n = mode.between @ shapes[0], len(data.system.sensors)
    own = np.where(np.sum(mode.shapes * expected, axis=1, keepdims=True) < 0, -mode.shapes, mode.shapes)
    with_sensor = np.zeros(own.shape, dtype=bool)
    for each in mode.shape_sets:
        # A measured shape has unit length over the sensors of its curve; one sensor has no shape.
        if each.columns.size > 1:
            own[each.points] *= each.find_length(expected[each.points])
            with_sensor[np.ix_(each.points, each.columns)] = True
    measured, model = np.full(n, np.nan), np.full(n, np.nan)
    there, counts = with_sensor.any(axis=0), np.maximum(with_sensor.sum(axis=0), 1)
    measured[mode.rows[there]] = (np.where(with_sensor, own, 0.0).sum(axis=0) / counts)[there]
    model[mode.rows[there]] = (np.where(with_sensor, expected, 0.0).sum(axis=0) / counts)[there]
    return (measured, model) if there.any() else None
