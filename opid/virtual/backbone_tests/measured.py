"""Virtual measurements of backbones: by control-based continuation in time, or quickly with stated errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.backbones.dissipation import PlacedTerm, find_higher_harmonics
from opid.mechanics.backbones.family import Backbone, BackboneFamily, backbone
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.backbones.quadrature_curves import MeasuredCurve
from opid.mechanics.backbones.specimen import Specimen
from opid.mechanics.laws.law import TermSet
from opid.signals.recording import FloatArray
from opid.updating.measured import LEAST_POINTS, MeasuredBackbone, SensorHarmonic
from opid.updating.model_class import ModelClass
from opid.virtual.backbone_tests.control_based_continuation import ContinuationSettings, ReadingNoise, measured_curve

BENDING_MODES = (7, 8)
"""The modes of the wing-engine structure in which the pylons bend; six modes on its suspension lie below them."""

CONTROLLED = "10"
"""The sensor whose amplitude is prescribed."""

AMPLITUDE_M = ((2e-4, 4e-3), (2e-4, 2.5e-3))
"""Smallest and largest amplitude of that sensor in each mode (Song et al. 2021, Figs. 4 and 5)."""

BENCH_NOISE = ReadingNoise(acceleration_m_per_s2=5e-3, force_n=5e-3, control_n=1e-2)
"""Noise of each of 64 samples in a period: 0.5 mg, 5 mN, and 10 mN with which the feedback shakes the structure."""

# number of points of the curve that is interpolated; its third derivative is small, ...
_N_GRID = 40
_N_GRID_OF_SLIP = 200  # ... but not where all sliders of a joint slip

# damping ratio of the modes that a higher harmonic meets, without which one would move without end
_DAMPING_RATIO = 0.003


def virtual_backbones(
    specimen: Specimen,
    *,
    rng: np.random.Generator,
    modes: Sequence[int] = BENDING_MODES,
    amplitude_m: Sequence[tuple[float, float]] = AMPLITUDE_M,
    n_points: int = 20,
    controlled_sensor: str = CONTROLLED,
    sensors: Sequence[str] | None = None,
    settings: ContinuationSettings | None = None,
    noise: ReadingNoise = BENCH_NOISE,
    least_fraction: float = 0.9,
    recorded: Sequence[int] = (),
    progress: Callable[[int, int], None] | None = None,
) -> tuple[MeasuredBackbone, ...]:
    """Return backbones measured by control-based continuation, one for each mode and sensor that reaches quadrature.

    A curve that does not reach quadrature at most of its levels is left out, as in the paper, where 14 sensors reach it
    in the first mode and 5 in the second. `measured_curve` gives the reason.

    Args:
        specimen: the structure with its shaker.
        rng: source of the noise.
        modes: numbers of the modes, from 1.
        amplitude_m: smallest and largest amplitude of the controlled sensor for each mode, m.
        n_points: number of levels of a curve, equally far apart.
        controlled_sensor: the sensor whose amplitude grows from level to level.
        sensors: the sensors whose quadrature is held, one after the other; all if left out.
        settings: settings of the continuation; the usual ones where left out.
        noise: noise of the readings; that of a usual bench if left out, `ReadingNoise()` for none.
        least_fraction: fraction of its levels at which a curve must have converged.
        recorded: numbers of the higher harmonics that the backbones have, those of the settings at most.
        progress: a function that is called with the number of curves done and the number of all.

    Raises:
        InputError: counts that do not match, or what `measured_curve` refuses.
        NotDeterminedError: no curve reaches quadrature; `partial` holds the curves.
    """
    ranges = _check_ranges(amplitude_m, modes, n_points)
    held = specimen.system.sensors if sensors is None else tuple(sensors)
    curves: list[MeasuredCurve] = []
    for mode, (least, most) in zip(modes, ranges, strict=True):
        for sensor in held:
            curve = measured_curve(
                specimen,
                mode=mode,
                sensor=sensor,
                controlled_sensor=controlled_sensor,
                amplitude=np.linspace(least, most, n_points),
                rng=rng,
                settings=settings,
                noise=noise,
            )
            curves.append(curve)
            if progress:
                progress(len(curves), len(modes) * len(held))
    whole = [curve for curve in curves if curve.converged.sum() >= max(LEAST_POINTS, least_fraction * n_points)]
    if not whole:
        raise NotDeterminedError(
            f"none of {len(curves)} curves reaches quadrature ({curves[0].reason or 'they are too short'}): "
            "drive the structure where the mode moves more, or with less damping",
            tuple(curves),
        )
    return tuple(convert_curve(curve, specimen.drive, recorded) for curve in whole)


def convert_curve(curve: MeasuredCurve, drive: str, recorded: Sequence[int] = ()) -> MeasuredBackbone:
    """Return the levels of a curve that converged, as data for updating.

    Args:
        curve: the curve.
        drive: the sensor at which the force acts.
        recorded: numbers of the higher harmonics to take, of all sensors.

    Raises:
        InputError: too few levels converged, or a harmonic that the curve does not have.
    """
    for order in recorded:
        if order not in range(2, curve.harmonics.shape[2] + 1):
            raise InputError(
                f"harmonic {order} is to be recorded: give numbers from 2 to {curve.harmonics.shape[2]}, or more "
                "harmonics in the settings"
            )
    kept = np.flatnonzero(curve.converged)
    if kept.size:
        # The amplitude is met within a tolerance, so levels that lie close could cross.
        held = curve.controlled_amplitude[kept]
        kept = kept[held > np.concatenate([[0.0], np.maximum.accumulate(held)[:-1]])]
    return MeasuredBackbone(
        name=f"mode {curve.mode}, quadrature at {curve.sensor}",
        mode=curve.mode,
        controlled_sensor=curve.controlled_sensor,
        frequency_hz=curve.frequency_hz[kept],
        amplitude=curve.amplitude[kept],
        sensors=curve.sensors,
        drive=drive,
        force_n=_find_working_force(curve, drive)[kept],
        harmonics=tuple(
            SensorHarmonic(sensor, order, values[kept])
            for order in recorded
            for sensor, values in zip(curve.sensors, _take_in_phase(curve, order).T, strict=True)
        ),
    )


def _take_in_phase(curve: MeasuredCurve, order: int) -> FloatArray:
    """Return the part of a harmonic, (n, n_sensors), that is largest where the controlled sensor's first one is."""
    phase = np.angle(curve.harmonics[:, curve.sensors.index(curve.controlled_sensor), 0])
    return np.asarray((curve.harmonics[:, :, order - 1] * np.exp(-1j * order * phase)[:, None]).real)


def _find_working_force(curve: MeasuredCurve, drive: str) -> FloatArray:
    """Return the work of the force in a cycle over pi times the amplitude of the drive point, (n,), N."""
    row = curve.sensors.index(drive)
    work = np.abs((curve.force[:, 0] * curve.harmonics[:, row, 0].conj()).imag)
    return np.asarray(work / np.abs(curve.amplitude[:, row]))


def synthetic_backbones(
    system: JointedModes,
    model_class: ModelClass,
    theta: Sequence[float] | FloatArray,
    *,
    rng: np.random.Generator,
    modes: Sequence[int] = BENDING_MODES,
    n_curves: Sequence[int] = (14, 5),
    amplitude_m: Sequence[tuple[float, float]] = AMPLITUDE_M,
    n_points: int = 20,
    controlled_sensor: str = CONTROLLED,
    harmonics: Sequence[int] = (1, 3, 5, 7),
    offset_fraction: float | Sequence[float] = (8e-4, 1.5e-3),
    point_noise: float | Sequence[float] = 1e-4,
    shape_noise: float | Sequence[float] = (0.005, 0.025),
    linear_error: float | Sequence[float] = 0.004,
    amplitude_jitter: float = 0.2,
    recorded: Sequence[int] = (),
    harmonic_error: float = 0.01,
    harmonic_noise: float = 5e-5,
) -> tuple[MeasuredBackbone, ...]:
    """Return sets of backbones by harmonic balance, with all errors drawn: quick, for studies of coverage.

    All errors are normal numbers of these standard deviations. With a draw e_m for each mode, o_c for each curve and
    n_k for each point,

        f = f_HB(A; eigenvalue of the mode (1 + e_m)^2) (1 + o_c) (1 + n_k),   x = x_HB(A) + |x_HB(A)| s.

    The controlled sensor has no noise, as its amplitude is prescribed. The default offsets are as large as those of
    `virtual_backbones` on the wing-engine structure with 0.3 % modal damping; there an offset is a systematic error of
    one curve, it changes along the curve, points scatter by 1e-5 only, and shapes are 0.5 % off in both modes.

    Args:
        system: the structure by its modes, as the model knows it.
        model_class: the class whose laws the joints follow.
        theta: (n_parameters,) true parameters of that class.
        rng: source of all errors.
        modes: numbers of the modes, from 1.
        n_curves: number of curves of each mode.
        amplitude_m: smallest and largest amplitude of the controlled sensor for each mode, m.
        n_points: number of points of each curve, from the smallest amplitude to the largest.
        controlled_sensor: the sensor whose amplitude is prescribed.
        harmonics: harmonics of the motion.
        offset_fraction: relative error o of all points of a curve, as single-point forcing makes it. It is one number
            or one for each mode, like the next three.
        point_noise: relative error n of each point.
        shape_noise: error s of each sensor and point, over the length of the shape over all sensors.
        linear_error: relative error e of all curves of a mode: difference of the measured linear structure from the one
            that the model knows.
        amplitude_jitter: largest shift of an amplitude within a curve, over the distance of two points.
        recorded: numbers of the higher harmonics that the backbones have. Their noise is drawn from a generator of its
            own, so that everything else stays what it is without them; so are errors of the frequencies of all other
            modes, as large as `linear_error`.
        harmonic_error: relative error of a higher harmonic of a sensor that all curves have in common.
        harmonic_noise: error of a higher harmonic at each point, over the largest motion of a sensor.

    Raises:
        InputError: counts that do not match, deviations below 0, jitter beyond 0.45, or what `backbone` refuses.
        NotDeterminedError: harmonic balance fails within the amplitudes; `partial` is its curve.
    """
    ranges = _check_ranges(amplitude_m, modes, n_points)
    if len(n_curves) != len(modes) or min(n_curves, default=0) < 1:
        raise InputError(f"n_curves is {tuple(n_curves)} for the modes {tuple(modes)}: give 1 or more for each mode")
    if not 0.0 <= amplitude_jitter <= 0.45:
        raise InputError(
            f"amplitude_jitter is {amplitude_jitter}: give a fraction from 0 to 0.45, so that points do not cross"
        )
    offset, point, shape, linear = (
        _check_deviations(name, given, len(modes))
        for name, given in (
            ("offset_fraction", offset_fraction),
            ("point_noise", point_noise),
            ("shape_noise", shape_noise),
            ("linear_error", linear_error),
        )
    )
    laws, column = tuple(model_class.laws(system.joints, theta).values()), system.sensor(controlled_sensor)
    record = _Recorder.of(system, laws, recorded, (harmonic_error, harmonic_noise), rng) if recorded else None
    curves = []
    for m, (mode, (least, most)) in enumerate(zip(modes, ranges, strict=True)):
        shifted = _shift_mode(system, mode, linear[m] * rng.standard_normal())
        grid = np.linspace(least, most, _N_GRID_OF_SLIP if model_class.slips else _N_GRID)
        true = backbone(shifted, laws, mode=mode, sensor=controlled_sensor, amplitude=grid, harmonics=harmonics)
        for number in range(1, n_curves[m] + 1):
            amplitude = _draw_amplitudes(least, most, n_points, amplitude_jitter, rng)
            frequency, shapes = _interpolate(true, amplitude)
            frequency *= (1.0 + offset[m] * rng.standard_normal()) * (1.0 + point[m] * rng.standard_normal(n_points))
            noise = shape[m] * rng.standard_normal(shapes.shape)
            noise[:, column] = 0.0
            shapes += np.linalg.norm(shapes, axis=1, keepdims=True) * noise
            name = f"mode {mode}, curve {number}"
            higher = record.take(true, shifted, linear[m], amplitude, frequency, shapes) if record else ()
            curves.append(
                MeasuredBackbone(name, mode, controlled_sensor, frequency, shapes, system.sensors, harmonics=higher)
            )
    return tuple(curves)


@dataclass(frozen=True, eq=False)
class _Recorder:
    """The higher harmonics of synthetic backbones, with their errors."""

    springs: tuple[PlacedTerm, ...]
    orders: tuple[int, ...]
    detuning: FloatArray  # (n_modes,) errors of the linear frequencies of other modes, in units of their deviation
    gain: FloatArray  # (n_orders, n_sensors) what each sensor makes of each harmonic
    noise: float
    rng: np.random.Generator

    @staticmethod
    def of(
        system: JointedModes,
        laws: Sequence[TermSet],
        orders: Sequence[int],
        errors: tuple[float, float],
        rng: np.random.Generator,
    ) -> _Recorder:
        """Return a recorder with the relative error of the harmonics of a sensor, and the noise of a point."""
        error, noise = (
            float(_check_deviations(*each, 1)[0])
            for each in zip(("harmonic_error", "harmonic_noise"), errors, strict=True)
        )
        springs = [
            PlacedTerm(term.name, np.array([term.values]), np.arange(len(laws)) == joint)
            for joint, law in enumerate(laws)
            for term in law.terms
        ]
        (own,) = rng.spawn(1)
        detuning = own.standard_normal(system.n_modes)
        gain = 1 + error * own.standard_normal((len(orders), len(system.sensors)))
        return _Recorder(tuple(springs), tuple(orders), detuning, gain, noise, own)

    def take(
        self,
        true: Backbone,
        shifted: JointedModes,
        linear: float,
        amplitude: FloatArray,
        frequency_hz: FloatArray,
        shapes: FloatArray,
    ) -> tuple[SensorHarmonic, ...]:
        """Return the harmonics of a test of the true backbone at amplitudes of the controlled sensor, (n_points,).

        The modes answer at the frequencies of the test, (n_points,). `shapes` are its first harmonics, (n_points,
        n_sensors), and `linear` is the deviation of the relative error of a linear frequency.
        """
        from scipy.interpolate import CubicSpline

        extension = CubicSpline(true.amplitude, true.extension.reshape(true.amplitude.size, -1))(amplitude)
        at = (2 * np.pi * frequency_hz) ** 2
        found = BackboneFamily(
            true.mode, true.sensor, amplitude, true.harmonics, at[None], shapes[None], np.isfinite(at)[None],
            extension[None],
        )  # fmt: skip
        detuning = 1 + linear * self.detuning
        detuning[shifted.index(true.mode)] = 1.0  # The mode itself is shifted already.
        motion = find_higher_harmonics(
            found, self.springs, self.orders, at=at, eigenvalue=(shifted.eigenvalue * detuning**2)[None],
            at_joints=shifted.at_joints[None], damping_ratio=np.full(1, _DAMPING_RATIO),
        )[0] @ shifted.at_sensors.T  # fmt: skip
        level = self.noise * np.abs(shapes).max(axis=1)[:, None, None]
        motion = self.gain * motion + level * self.rng.standard_normal(motion.shape)
        return tuple(
            SensorHarmonic(sensor, order, motion[:, k, s])
            for k, order in enumerate(self.orders)
            for s, sensor in enumerate(shifted.sensors)
        )


def _check_ranges(amplitude_m: Sequence[tuple[float, float]], modes: Sequence[int], n_points: int) -> FloatArray:
    ranges = np.asarray(amplitude_m, dtype=np.float64)
    fine = ranges.shape == (len(modes), 2) and ranges.size > 0
    if not fine or not (ranges[:, 0] > 0.0).all() or not (ranges[:, 0] < ranges[:, 1]).all():
        raise InputError(
            f"amplitude_m is {amplitude_m!r} for the modes {tuple(modes)}: give a smallest and a largest amplitude, m, "
            "for each mode"
        )
    if n_points != int(n_points) or n_points < LEAST_POINTS:
        raise InputError(f"n_points is {n_points}: give a whole number, {LEAST_POINTS} or more")
    return ranges


def _check_deviations(name: str, given: ArrayLike, n_modes: int) -> FloatArray:
    values = np.asarray(given, dtype=np.float64)
    if values.shape not in ((), (n_modes,)) or not ((values >= 0.0) & np.isfinite(values)).all():
        raise InputError(f"{name} is {given!r}: give 0 or more, as one number or as {n_modes}, one for each mode")
    return np.broadcast_to(values, n_modes)


def _shift_mode(system: JointedModes, mode: int, fraction: float) -> JointedModes:
    """Return the structure with the frequency of one mode off by a fraction."""
    eigenvalue = system.eigenvalue.copy()
    eigenvalue[system.index(mode)] *= (1.0 + fraction) ** 2
    return replace(system, eigenvalue=eigenvalue)


def _draw_amplitudes(least: float, most: float, n_points: int, jitter: float, rng: np.random.Generator) -> FloatArray:
    """Draw growing amplitudes, the first and the last within the range."""
    amplitude = np.linspace(least, most, n_points)
    moved = amplitude + jitter * (amplitude[1] - amplitude[0]) * rng.uniform(-1.0, 1.0, n_points)
    return np.clip(moved, least, most)


def _interpolate(true: Backbone, amplitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return frequency (n,) and shapes (n, n_sensors) at other amplitudes."""
    from scipy.interpolate import CubicSpline

    if not true.converged.all():
        raise NotDeterminedError(f"the true backbone of mode {true.mode} has gaps: {true.reason}", true)
    spline = CubicSpline(true.amplitude, np.column_stack([true.frequency_hz, true.shapes]))(amplitude)
    return spline[:, 0], spline[:, 1:]
