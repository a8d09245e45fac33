"""Higher harmonics that sensors recorded along the backbones, compared with what the best class predicts of them.

They tell of the law's shape and of the modes that they meet, and were used by no likelihood.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise

import numpy as np

from opid.mechanics.backbones.dissipation import PlacedTerm, find_higher_harmonics
from opid.mechanics.backbones.family import BackboneFamily
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, ModeData
from opid.updating.likelihood.curves import make_solver
from opid.updating.likelihood.interactions import find_system
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import ModelClass
from opid.updating.prediction import find_band
from opid.updating.result import HarmonicBand
from opid.updating.settings import UPDATING

# ---- bands -----------------------------------------------------------------------------------------


def predict_harmonics(
    data: BackboneData,
    model_class: ModelClass,
    theta: FloatArray,
    measured: Sequence[MeasuredBackbone],
    *,
    rng: np.random.Generator,
) -> tuple[HarmonicBand, ...]:
    """Return the 95 % bands of all higher harmonics that were measured, at their own points.

    Joints move as along the smooth backbone at the measured amplitude, and the modes answer to the harmonics of their
    forces at the measured frequency. The bands hold the parameters of the class, the error of every linear frequency
    (`linear_error`) and of the shapes (`linear_shape_error`), the damping of the modes, the calibration of each sensor
    at each harmonic (`harmonic_error`), and the noise of a point (`harmonic_noise`). They are nan where the model
    converges for less than half of the draws.

    Args:
        data: the backbones, from `backbone_data`; with a structure for the factors of the class.
        model_class: the class that predicts, with these factors where there are any.
        theta: (n, n_parameters) draws of its parameters.
        measured: the same backbones.
        rng: source of chance.
    """
    bands = []
    for mode in data.modes:
        # All curves have the same draws, so that a band runs smoothly through the points of several.
        seed = int(rng.integers(2**63))
        points: dict[tuple[int, str, str], list[tuple[FloatArray, FloatArray]]] = {}
        curves = [one for one in measured if one.mode == mode.mode and one.harmonics]
        for curve, answer in _solve(data, mode, model_class, theta, curves):
            predicted = _predict_curve(data, answer, curve, np.random.default_rng(seed))
            for each, (band, part) in zip(curve.harmonics, predicted, strict=True):
                rows = np.vstack([curve.controlled_amplitude, each.amplitude, band])
                points.setdefault((each.order, each.sensor, curve.controlled_sensor), []).append((rows, part))
        for order, sensor, controlled in sorted(points, key=lambda key: (key[0], *map(data.system.sensor, key[1:]))):
            rows_of, parts = zip(*points[order, sensor, controlled], strict=True)
            amplitude, seen, low, middle, high = (found := np.hstack(rows_of))[:, np.argsort(found[0], kind="stable")]
            inside = ((seen >= low) & (seen <= high))[np.isfinite(low)]
            coverage = float(inside.mean()) if inside.size else float("nan")
            met = _find_met_mode(data, mode, order, np.max(parts, axis=0))
            bands.append(
                HarmonicBand(mode.mode, order, sensor, controlled, amplitude, seen, middle, low, high, coverage, met)
            )
    return tuple(bands)


@dataclass(frozen=True, eq=False)
class _Answer:
    """Backbones at the points of one curve, and the linear structures that answer to the forces of the joints."""

    found: BackboneFamily
    springs: list[PlacedTerm]
    eigenvalue: FloatArray  # (n or 1, n_modes) of each structure; 1 where all draws have the same one
    shapes: FloatArray  # (n or 1, n_sensors, n_modes)
    extensions: FloatArray  # (n or 1, n_joints, n_modes)


def _solve(
    data: BackboneData, mode: ModeData, model_class: ModelClass, theta: FloatArray, curves: Sequence[MeasuredBackbone]
) -> Iterator[tuple[MeasuredBackbone, _Answer]]:
    """Yield each curve of a mode with its model; those with the same controlled sensor are solved at once."""
    # Factors of the stiffness among the parameters give each draw a structure of its own.
    structures = [find_system(data, model_class, row) for row in (theta[:1] if data.structure is None else theta)]
    modes = [np.array([getattr(each, key) for each in structures]) for key in ("eigenvalue", "at_sensors", "at_joints")]
    for sensor in dict.fromkeys(one.controlled_sensor for one in curves):
        own = [one for one in curves if one.controlled_sensor == sensor]
        amplitude = np.concatenate([one.controlled_amplitude for one in own])
        solve = make_solver(data, model_class, mode, sensor, amplitude)
        found, springs = solve(theta), solve.place_terms(theta)[0]
        ends = np.cumsum([0, *(one.frequency_hz.size for one in own)])
        for curve, (first, last) in zip(own, pairwise(ends), strict=True):
            parts = {name: getattr(found, name)[:, first:last] for name in ("eigenvalue", "shapes", "extension")}
            here = replace(found, amplitude=amplitude[first:last], converged=found.converged[:, first:last], **parts)
            yield curve, _Answer(here, springs, *modes)


def _find_met_mode(data: BackboneData, mode: ModeData, order: int, part: FloatArray) -> int | None:
    """Return the mode near a harmonic with the largest part in it, (n_modes,), if that is large among all."""
    low, high = (order**2 * end(mode.eigenvalue) for end in (np.min, np.max))
    own = np.maximum(data.system.eigenvalue, 1e-12 * low)
    apart = np.maximum(np.sqrt(low / own), np.sqrt(own / high)) - 1
    near = np.where(apart < UPDATING.harmonic_reach, part, 0.0)
    near[data.system.index(mode.mode)] = 0.0
    return int(np.argmax(near)) + 1 if near.max() > UPDATING.least_part * part.max() else None


def _predict_curve(
    data: BackboneData, answer: _Answer, curve: MeasuredBackbone, rng: np.random.Generator
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield for each harmonic of one curve lower end, median and upper end, (3, n_points), and the part of each mode.

    The parts are the largest motions that single modes, (n_modes,), make of the sensor.
    """
    noise, n = data.noise, len(answer.found.eigenvalue)
    orders = sorted({each.order for each in curve.harmonics})
    detuning = 1 + noise.linear_error * rng.standard_normal((n, answer.eigenvalue.shape[1]))
    if data.met_damping is None:
        ratio = UPDATING.unknown_damping * np.abs(rng.standard_normal(n))
    else:
        ratio = data.met_damping * (1 + UPDATING.damping_error) ** rng.standard_normal(n)
    coordinates = find_higher_harmonics(
        answer.found, answer.springs, orders, at=curve.eigenvalue, eigenvalue=answer.eigenvalue * detuning**2,
        at_joints=np.broadcast_to(answer.extensions, (n, *answer.extensions.shape[1:])), damping_ratio=ratio,
    )  # fmt: skip
    motion = coordinates @ np.swapaxes(answer.shapes, 1, 2)[:, None]
    # What a harmonic makes of the sensors is a shape with the error of the linear ones.
    errors = noise.linear_shape_error * rng.standard_normal((n, 1, *motion.shape[2:]))
    motion += np.linalg.norm(motion, axis=3, keepdims=True) * errors
    motion *= 1 + noise.harmonic_error * rng.standard_normal(errors.shape)
    level = noise.harmonic_noise * np.abs(curve.amplitude).max(axis=1)[:, None, None]
    motion += level * rng.standard_normal(motion.shape)
    largest = np.median(np.abs(np.nan_to_num(coordinates)), axis=0).max(axis=0)
    for each in curve.harmonics:
        order, sensor = orders.index(each.order), data.system.sensor(each.sensor)
        yield find_band(motion[:, :, order, sensor]), largest[order] * np.abs(answer.shapes[0, sensor])


# ---- contradictions --------------------------------------------------------------------------------


def warn_of_harmonics(bands: Sequence[HarmonicBand], data: BackboneData) -> Iterator[str]:
    """Yield a sentence for each mode and higher harmonic that contradicts the model, with a likely reason.

    Args:
        bands: the bands, from `predict_harmonics`.
        data: the backbones.
    """
    for (mode, order), group in groupby(bands, key=lambda band: (band.mode, band.order)):
        far = {band.sensor: (_find_far_fraction(band), band) for band in group}
        wrong = {sensor: each for sensor, each in far.items() if each[0] > UPDATING.most_far}
        if not wrong:
            continue
        fraction, worst = max(wrong.values(), key=lambda each: each[0])
        others = f", and at {len(wrong) - 1} of {len(far) - 1} others" if len(wrong) > 1 else ""
        reason = _explain(worst, [each for _, each in wrong.values()], data)
        yield (
            f"mode {mode}: harmonic {order} of sensor {worst.sensor!r} lies far from what the class predicts at "
            f"{100 * fraction:.0f} % of its points{others}: {reason}"
        )


def _find_far_fraction(band: HarmonicBand) -> float:
    """Return the fraction of the points that contradict the band; 0 where it has none."""
    apart = band.measured - band.predicted
    allowed = UPDATING.far_from_band * np.where(apart > 0, band.high - band.predicted, band.predicted - band.low)
    there = np.isfinite(allowed)
    return float((np.abs(apart) > allowed)[there].mean()) if there.any() else 0.0


def _is_explained(bands: Sequence[HarmonicBand], factor: float) -> bool:
    """Return whether measured points times a factor lie within the bands, where these exclude 0."""
    inside = []
    for band in bands:
        known = band.low * band.high > 0
        values = factor * band.measured[known]
        inside.append((values >= band.low[known]) & (values <= band.high[known]))
    held = np.concatenate(inside)
    return bool(held.size and held.mean() > UPDATING.explained)


def _explain(worst: HarmonicBand, wrong: Sequence[HarmonicBand], data: BackboneData) -> str:
    """Return a likely reason why a harmonic contradicts the model, most at one sensor, and what to do."""
    if not (worst.low * worst.high > 0).any():
        return (
            "the class makes none that could be told from noise: its laws have another symmetry, the shaker distorts, "
            "or harmonic_noise is larger than stated"
        )
    square = worst.order**2
    if _is_explained([worst], -1.0):
        return "it has the opposite sign: turn that of its column, or that of its first harmonic"
    for factor, reason in (
        (1e-3, "the measured values are a thousand times as large: correct the unit of the columns"),
        (1e3, "the measured values are a thousandth of that: correct the unit of the columns"),
        (
            1 / square,
            f"the measured values are {square} times as large: divide accelerations by (2 pi h f)^2, h the harmonic",
        ),
        (
            square,
            f"the measured values are 1/{square} of that: accelerations are divided by (2 pi h f)^2 when they are read",
        ),
    ):
        if _is_explained(wrong, factor):
            return reason
    law = "the joints have another law than the class"
    if worst.met_mode is not None:
        hz = data.system.frequency_hz[worst.met_mode - 1]
        return f"mode {worst.met_mode}, which it nears, is not at {hz:.4g} Hz as in the structure, or {law}"
    return f"{law}, or the sensor is wrong at that frequency"
