"""Worlds of `opid update`: units, copies, gains, signs, numbers of modes, laws and structures that are not so."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import made_backbones as made
import numpy as np
from judged_worlds import Answer, World

from opid.errors import refuse
from opid.estimate import Estimate
from opid.mechanics.backbones.family import backbone
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.updating.checks import backbone_faults
from opid.updating.identification import update_study
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.result import Updating
from opid.updating.study import UpdatingStudy
from opid.virtual.backbone_tests.measured import synthetic_backbones

Curves = tuple[MeasuredBackbone, ...]

LINEAR_ERROR = 0.004
"""Standard deviation of the linear frequencies of the true structure about those that the model knows."""

SOFTENING = ModelClass("softening", (UncertainTerm("cubic_stiffness", (-6.8e7,), (Prior("uniform", 0.0, 10.0),)),))
"""The law of a joint that opens; a study with hardening classes alone does not have it."""


def draw_structure(seed: int, known: JointedModes) -> JointedModes:
    """Return a structure whose linear frequencies differ from the known ones by chance."""
    error = LINEAR_ERROR * np.random.default_rng([seed, 3]).standard_normal(known.n_modes)
    return replace(known, eigenvalue=known.eigenvalue * (1 + error) ** 2)


def measure_curves(true: JointedModes, law: ModelClass, seed: int) -> Curves:
    """Return six curves of the second mode and four of the third, with offsets and noise."""
    return synthetic_backbones(
        true, law, (made.TRUTH,), rng=np.random.default_rng([seed, 4]), modes=made.MODES, n_curves=(6, 4), n_points=12,
        amplitude_m=made.AMPLITUDE_M, controlled_sensor="left", harmonics=(1,), offset_fraction=0.003,
        point_noise=0.001, linear_error=0.0,
    )  # fmt: skip


def find_frequency(true: JointedModes, law: ModelClass, theta: float, mode: int, amplitude_m: float) -> float:
    """Return the true frequency of a mode at an amplitude of the controlled sensor, Hz."""
    laws = tuple(law.laws(true.joints, (theta,)).values())
    grid = np.linspace(amplitude_m / 10, amplitude_m, 10)
    return float(backbone(true, laws, mode=mode, sensor="left", amplitude=grid, harmonics=(1,)).frequency_hz[-1])


def list_bands(found: Updating, true: JointedModes, law: ModelClass, theta: float) -> list[tuple[str, Estimate, float]]:
    """Return the frequency of each measured mode at three quarters of its largest amplitude, with the true one."""
    pairs = []
    for band in (each for each in found.prediction if each.is_measured):
        index = int(0.75 * band.amplitude.size)
        low, middle, high = (float(each[index]) for each in (band.low_hz, band.frequency_hz, band.high_hz))
        truth = find_frequency(true, law, theta, band.mode, float(band.amplitude[index]))
        estimate = Estimate.normal(middle, (high - low) / 3.92) if np.isfinite([low, high]).all() else Estimate(middle)
        pairs.append((f"frequency of mode {band.mode}", estimate, truth))
    return pairs


def updating_world(
    fails: str,
    spoil: Callable[[Curves], Sequence[MeasuredBackbone]] = lambda curves: curves,
    *,
    law: ModelClass = made.CUBIC,
    known: Callable[[], JointedModes] = made.system,
    with_bands: bool = False,
    must_say: str = "",
    unseen: str = "",
) -> World:
    """Return the world of two arms with a cubic law, of which the backbones or the known modes are spoiled.

    `with_bands` adds the predicted frequencies to the answer, where the amplitudes of the curves are the true ones.
    """

    def ask(seed: int) -> Answer:
        true = draw_structure(seed, made.system())
        curves = tuple(spoil(measure_curves(true, law, seed)))
        structure = known()
        refuse(list(backbone_faults(structure, curves)), None)
        found = update_study(
            UpdatingStudy("two arms", structure, curves, (made.CUBIC,), harmonics=(1,), n_samples=1000, seed=seed)
        )
        theta = made.TRUTH if law is made.CUBIC else -made.TRUTH
        pairs = [("theta_1", found.classes[0].estimates["theta_1"], theta)]
        pairs += list_bands(found, true, law, made.TRUTH) if with_bands else []
        return Answer(tuple(pairs), found.warnings)

    return World("update", fails, ask, must_say, unseen)


def scale(factor: float, chosen: Callable[[int], bool] = lambda number: True) -> Callable[[Curves], Curves]:
    """Return what multiplies all amplitudes of the curves that are chosen by their number."""
    return lambda curves: tuple(
        replace(one, amplitude=factor * one.amplitude) if chosen(number) else one for number, one in enumerate(curves)
    )


def read_sensor(sensor: str, gain: float) -> Callable[[Curves], Curves]:
    """Return what multiplies the amplitudes of one sensor in all curves."""
    row = np.where(np.array(made.SENSORS) == sensor, gain, 1.0)
    return lambda curves: tuple(replace(one, amplitude=one.amplitude * row) for one in curves)


def exchange_sensors(one: str, other: str) -> Callable[[Curves], Curves]:
    """Return what exchanges the names of two sensors in all curves."""
    names = {one: other, other: one}
    sensors = tuple(names.get(each, each) for each in made.SENSORS)
    return lambda curves: tuple(replace(each, sensors=sensors) for each in curves)


def number_modes(numbers: dict[int, int], chosen: Callable[[int], bool] = lambda number: True):
    """Return what gives the chosen curves other numbers of their modes."""
    return lambda curves: tuple(
        replace(one, mode=numbers.get(one.mode, one.mode)) if chosen(number) else one
        for number, one in enumerate(curves)
    )


def copy_curves(n_copies: int, *, has_digits: bool = True) -> Callable[[Curves], list[MeasuredBackbone]]:
    """Return what hands in every curve several times, with a few digits less where `has_digits` is False."""

    def copy(curves: Curves) -> list[MeasuredBackbone]:
        found = list(curves)
        for number in range(n_copies):
            for one in curves:
                hz = one.frequency_hz if has_digits else np.round(one.frequency_hz, 3)
                found.append(replace(one, name=f"{one.name}, again {number}", frequency_hz=hz))
        return found

    return copy


def put_points(curves: Curves) -> Curves:
    """Return curves of mode 2 whose last four points are those of mode 3, as after a jump."""
    other = next(one for one in curves if one.mode == 3)

    def like_other(one: MeasuredBackbone) -> np.ndarray:
        return one.amplitude[:, [3]] / other.amplitude[:, [3]] * other.amplitude

    return tuple(
        replace(
            one,
            frequency_hz=np.concatenate([one.frequency_hz[:8], other.frequency_hz[8:]]),
            amplitude=np.concatenate([one.amplitude[:8], like_other(one)[8:]]),
        )
        if one.mode == 2
        else one
        for one in curves
    )


def drift(curves: Curves, *, has_days: bool = False, fraction: float = 0.005) -> Curves:
    """Return curves of which every other one is of a second day, whose frequencies are higher."""
    return tuple(
        replace(
            one,
            frequency_hz=one.frequency_hz * (1 + fraction * (number % 2)),
            day=str(1 + number % 2) if has_days else "",
        )
        for number, one in enumerate(curves)
    )


def cut_lowest(curves: Curves) -> Curves:
    """Return the upper half of each curve."""
    return tuple(replace(one, frequency_hz=one.frequency_hz[6:], amplitude=one.amplitude[6:]) for one in curves)


def clip(sensor: str | None) -> Callable[[Curves], Curves]:
    """Return what limits the amplitudes of one sensor, or of the controlled one, at two thirds of their largest."""

    def limit(one: MeasuredBackbone) -> MeasuredBackbone:
        size = np.abs(one.amplitude)
        top = size.max(axis=0) * 2 / 3
        chosen = np.array([name == (sensor or one.controlled_sensor) for name in one.sensors])
        clipped = np.sign(one.amplitude) * np.minimum(size, top)
        if sensor is None:
            # The first harmonic of a clipped sine still grows a little: 4/pi times its height is the limit.
            x = np.maximum(size / top, 1.0)
            clipped = np.sign(one.amplitude) * size * (2 / np.pi) * (np.arcsin(1 / x) + np.sqrt(1 - 1 / x**2) / x)
        return replace(one, amplitude=np.where(chosen, clipped, one.amplitude))

    return lambda curves: tuple(map(limit, curves))


def turn_joint(has_sum: bool) -> JointedModes:
    """Return the known modes with the row of the first joint turned, or with the sum of its two motions."""
    known = made.system()
    tip = known.at_sensors[made.SENSORS.index("left")]
    row = 2 * tip - known.at_joints[0] if has_sum else -known.at_joints[0]
    return replace(known, at_joints=np.stack([row, known.at_joints[1]]))


FACTORS = {"plate": 1.08, "leaves": 0.95}
"""Stiffness factors of the true structure, which phase I is to find."""


def linear_world(
    fails: str, spoil: Callable[[Curves], Sequence[MeasuredBackbone]] = lambda curves: curves, *, must_say: str = ""
) -> World:
    """Return the world of the same structure by its matrices, whose stiffness phase I updates by the lowest points."""

    def ask(seed: int) -> Answer:
        true = draw_structure(seed, made.system(**FACTORS))
        structure, curves = made.structure(), tuple(spoil(measure_curves(true, made.CUBIC, seed)))
        refuse(list(backbone_faults(structure, curves)), None)
        found = update_study(
            UpdatingStudy(
                "two arms", structure, curves, (made.CUBIC,), harmonics=(1,), n_samples=1000, seed=seed,
                parameters={name: Prior("lognormal", 1.0, 0.3) for name in FACTORS},
            )
        )  # fmt: skip
        pairs = [("theta_1", found.classes[0].estimates["theta_1"], made.TRUTH)]
        assert found.linear is not None
        pairs += [(name, found.linear.estimates[name], factor) for name, factor in FACTORS.items()]
        return Answer(tuple(pairs), found.warnings)

    return World("update", f"{fails}, phase I", ask, must_say)


UPDATING_WORLDS = [
    updating_world("none", with_bands=True),
    updating_world("one curve in half its unit", scale(2.0, lambda number: number == 2), must_say="grown as far as"),
    updating_world("one curve is rms", scale(0.5**0.5, lambda number: number == 2), must_say="contradict"),
    updating_world("one curve in inches", scale(1 / 25.4, lambda number: number == 7), must_say="grown as far as"),
    updating_world("curves of a mode are rms", scale(0.5**0.5, lambda number: number > 5), must_say="does not fit"),
    updating_world(
        "all curves are rms",
        scale(0.5**0.5),
        unseen="lambda of a cubic spring depends on theta A^2 alone: with A / 2^0.5 the likelihood of 2 theta is that "
        "of theta, and the shapes have no unit",
    ),
    updating_world("all curves in millimetres", scale(1e3), must_say="check the unit of the amplitudes"),
    updating_world("all curves in kilometres", scale(1e-3), must_say="check the unit of the amplitudes"),
    updating_world("gain of the controlled sensor 2 % off", read_sensor("left", 1.02)),
    updating_world("gain of the controlled sensor 10 % off", read_sensor("left", 1.1)),
    updating_world("gain of the controlled sensor 20 % off", read_sensor("left", 1.2), must_say="sensor 'left' reads"),
    updating_world("gain of another sensor 2 % off", read_sensor("right", 1.02)),
    updating_world("gain of another sensor 50 % off", read_sensor("right", 1.5), must_say="sensor 'right' reads"),
    updating_world("sign of the controlled sensor", read_sensor("left", -1.0), must_say="sensor"),
    updating_world("sign of another sensor", read_sensor("right", -1.0), must_say="sensor"),
    updating_world("controlled sensor exchanged", exchange_sensors("left", "right")),
    updating_world("other sensors exchanged", exchange_sensors("plate", "bend"), must_say="seem to be exchanged"),
    updating_world("each curve four times", copy_curves(3), must_say="one measurement"),
    updating_world("each curve four times, rounded", copy_curves(3, has_digits=False), must_say="one measurement"),
    updating_world("softening, hardening classes", law=SOFTENING, with_bands=True, must_say="does not fit"),
    updating_world("modes exchanged", number_modes({2: 3, 3: 2}), must_say="check the number of the mode"),
    updating_world("modes counted without the rigid one", number_modes({2: 1, 3: 2}), must_say="modes are counted"),
    updating_world("modes one too high", number_modes({2: 3, 3: 4}), must_say="check the number of the mode"),
    updating_world(
        "number of one curve is that of the other mode",
        number_modes({2: 3}, lambda number: number == 1),
        must_say="check the number of the mode",
    ),
    updating_world("points of another mode", put_points, must_say="jumped to it"),
    updating_world("drift of 0.5 %", drift, with_bands=True),
    updating_world("drift of 0.5 %, days stated", lambda curves: drift(curves, has_days=True), with_bands=True),
    updating_world("drift of 2 %", lambda curves: drift(curves, fraction=0.02)),
    updating_world("controlled sensor clipped", clip(None), must_say="no interval of it holds"),
    updating_world("another sensor clipped", clip("right")),
    updating_world("structure 5 % off, plate", known=lambda: made.system(plate=1.05)),
    updating_world("structure 5 % off, leaves", known=lambda: made.system(leaves=1.05)),
    updating_world("structure 10 % off", known=lambda: made.system(plate=0.9), must_say="linear frequency of the"),
    updating_world("sign of a joint's row", known=lambda: turn_joint(has_sum=False)),
    updating_world("sign of one end of a joint", known=lambda: turn_joint(has_sum=True), must_say="does not fit"),
    linear_world("none"),
    linear_world("mode 3 is missing", lambda curves: curves[:6]),
    linear_world("mode 2 is missing", lambda curves: curves[6:]),
    linear_world("drift of 0.5 %", drift),
    linear_world("lowest points are missing", cut_lowest, must_say="lowest points of mode"),
    linear_world("sign of another sensor", read_sensor("right", -1.0), must_say="the shape"),
    linear_world("one curve in half its unit", scale(2.0, lambda number: number == 2), must_say="grown as far as"),
]
