"""Measured backbones by mode, with everything of their likelihood that does not depend on the law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError, nearest
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.signals.recording import FloatArray
from opid.updating.checks import day_faults, joint_fault
from opid.updating.likelihood.force import ForceData
from opid.updating.likelihood.noise import CurveNoise, NoiseSettings, curve_noise, draw_set
from opid.updating.measured import MeasuredBackbone, by_mode, list_sensors, spread_sensors
from opid.updating.settings import UPDATING
from opid.updating.structure.factored_modes import FactoredModes

Form = Literal["paper", "literal", "recommended", "independent"]
FORMS: tuple[Form, ...] = get_args(Form)

IntArray = NDArray[np.int64]

N_NODES = 12  # amplitudes at which the model is solved for one mode; between them its curve is a polynomial, ...
N_NODES_OF_SLIP = 40  # ... which follows the bend where all sliders of a joint slip within 1e-5 of lambda (rms)
LEAST_APART = 1.7  # eigenvalue over the measured one above which a mode does not meet the first harmonic
FAR_AWAY = 1e3  # factor of the eigenvalue of a mode that is out of the reach of all harmonics


@dataclass(frozen=True, eq=False)
class ErrorGrowth:
    """How errors of the linear structure grow along the curves of a mode, while the nonlinearity doubles lambda.

    Args:
        frequency: growth of the error of lambda, in units of 2 `linear_error`.
        shape: growth of the error of a shape, in units of `linear_shape_error`.
        patterns: (n_points, n) errors of lambda that do not grow with lambda, in the first unit.
        detuning: (n_met,) most probable relative errors of the frequencies of the modes that a harmonic meets, over
            `linear_error`; None where they are not looked for.
    """

    frequency: float
    shape: float
    patterns: FloatArray | None = None
    detuning: FloatArray | None = None

    def with_patterns(self, patterns: FloatArray) -> ErrorGrowth:
        """Return these errors and those of further patterns, (n_points, n)."""
        known = np.empty((len(patterns), 0)) if self.patterns is None else self.patterns
        return replace(self, patterns=np.column_stack([known, patterns]))

    @staticmethod
    def of(noise: NoiseSettings) -> ErrorGrowth:
        """Return the growth that is stated, or that is usual where it is not known."""
        return ErrorGrowth(noise.growth_of_linear_error, noise.growth_of_linear_error)


@dataclass(frozen=True, eq=False)
class ShapeSet:
    """The curves of a mode that have the same sensors.

    Args:
        points: (n_points,) whether each point of the mode is one of theirs.
        columns: (n_own,) columns of their sensors among all of the mode.
        free: (n_own - 1,) places of the sensors among these, without that of the largest entry, which the unit length
            fixes.
        is_all: whether these are all sensors of the mode.
        noise: noise model of the free entries of the shapes; None where shapes are not used.
    """

    points: NDArray[np.bool_]
    columns: IntArray
    free: IntArray
    is_all: bool
    noise: CurveNoise | None = None

    def find_length(self, shapes: FloatArray) -> FloatArray:
        """Return the length of the part that the set sees, (..., 1), of shapes (..., n_sensors)."""
        return np.asarray(np.linalg.norm(shapes[..., self.columns], axis=-1, keepdims=True))

    def take(self, shapes: FloatArray) -> FloatArray:
        """Return what the set sees, with unit length, (..., n_own), of unit shapes of all sensors (..., n_sensors)."""
        return shapes if self.is_all else shapes[..., self.columns] / self.find_length(shapes)


@dataclass(frozen=True, eq=False)
class ModeData:
    """The curves of one mode, ready to be compared with a model that is solved at a few amplitudes."""

    mode: int  # number of the mode, from 1
    # each controlled sensor, and (n_nodes,) amplitudes, m, at which the model is solved for it
    parts: tuple[tuple[str, FloatArray], ...]
    between: FloatArray  # (n_points, n_nodes of all parts) matrix that takes values at the nodes to the measured points
    curve: IntArray  # (n_points,) number of the curve of each point, from 0
    day: IntArray | None  # (n_points,) number of the test day of each point, from 0; None where no day is known
    eigenvalue: FloatArray  # (n_points,) measured lambda, 1/s^2
    sensor: NDArray[np.str_]  # (n_points,) name of the controlled sensor of each point
    amplitude: FloatArray  # (n_points,) amplitude of that sensor, m
    # (n_points,) amplitude of the controlled sensor over the largest of all curves with the same sensor
    relative_amplitude: FloatArray
    # (n_points,) growth of lambda / linear from the lowest point, smoothed over the amplitude
    growth: FloatArray
    shapes: FloatArray  # (n_points, n_sensors) measured shapes of unit length, 0 where a curve lacks the sensor
    shape_sets: tuple[ShapeSet, ...]  # the curves by their sensors
    rows: IntArray  # (n_sensors,) rows of these sensors in the system
    linear: float  # lambda of the mode without nonlinearity, 1/s^2
    cov: float  # coefficient of variation of lambda over the curves; nan where it is not known
    frequency_noise: CurveNoise | None  # noise model of lambda / linear, for the recommended form
    errors: ErrorGrowth | None  # growth of the errors of the linear structure in these noise models

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(n_points, n_sensors) whether the curve of a point has the sensor."""
        found = np.zeros(self.shapes.shape, dtype=bool)
        for each in self.shape_sets:
            found[np.ix_(each.points, each.columns)] = True
        return found


@dataclass(frozen=True, eq=False)
class BackboneData:
    """All measured backbones, ready for `likelihood_function`.

    Args:
        system: the linear structure with its joints.
        modes: the data of each mode.
        form: form of the likelihood.
        harmonics: harmonics of the model.
        noise: settings for the errors.
        structure: the same structure as a function of the factors of its stiffness, for classes whose parameters they
            are; None where it is known.
        force: the work of the force, which tells the damping; None where it is not used.
        met_damping: damping ratio of the modes that a harmonic meets, with which points in an interaction are compared;
            None where the model leaves interactions out.
    """

    system: JointedModes
    modes: tuple[ModeData, ...]
    form: Form
    harmonics: tuple[int, ...]
    noise: NoiseSettings
    structure: FactoredModes | None = None
    force: ForceData | None = None
    met_damping: float | None = None


def backbone_data(
    system: JointedModes,
    measured: Sequence[MeasuredBackbone],
    *,
    form: Form = "recommended",
    harmonics: Sequence[int] = (1, 3),
    noise: NoiseSettings | None = None,
    growth: Mapping[int, float] | None = None,
    slips: bool = False,
) -> BackboneData:
    """Return measured backbones grouped by mode, with everything that does not depend on the law.

    Args:
        system: the linear structure with its joints.
        measured: the backbones; those of one mode are tests of the same structure.
        form: "paper" is Song eqs. (10) to (12) with the mean of squares of each curve; "literal" eq. (12) as printed,
            which squares the mean, so that errors cancel; "independent" takes every point as a measurement of its own
            (eqs. 7 and 8); "recommended" has curves with offsets of their own (`opid.updating.likelihood.noise`).
        harmonics: harmonics of the model.
        noise: settings for the errors.
        growth: `linear_error_growth` of some modes, by their number; that of `noise` for the others.
        slips: whether joints of a class slip: their curves bend where all sliders do, and need more amplitudes.

    Raises:
        InputError: no backbone, an unknown form, sensors that the system does not have, a mode of which only some
            curves have a day, one that extends no joint, or one whose coefficient of variation is needed and follows
            neither from the curves nor from `noise`.
    """
    noise = noise or NoiseSettings()
    if form not in FORMS:
        raise InputError(f"there is no likelihood {form!r}: {nearest(form, FORMS)}")
    if not measured:
        raise InputError("there is no measured backbone: give at least one")
    for fault in day_faults(measured):
        raise InputError(fault)
    modes = []
    for mode, curves in by_mode(measured).items():
        cov = (noise.cov or {}).get(mode) or coefficient_of_variation(curves)
        own = replace(noise, linear_error_growth=(growth or {}).get(mode, noise.linear_error_growth))
        modes.append(_make_mode_data(system, curves, own, cov, form, N_NODES_OF_SLIP if slips else N_NODES))
    for each in modes if form != "recommended" else ():
        if not each.cov > 0:
            raise InputError(scatter_fault(each.mode))
    return BackboneData(system, tuple(modes), form, tuple(int(h) for h in harmonics), noise)


def with_amplitudes(data: BackboneData, sensor: str, factor: float) -> BackboneData:
    """Return the backbones as they are if all amplitudes of a controlled sensor are `factor` times as large."""
    modes = []
    for mode in data.modes:
        scaled = tuple((name, nodes * factor if name == sensor else nodes) for name, nodes in mode.parts)
        modes.append(replace(mode, parts=scaled))
    return replace(data, modes=tuple(modes))


def scatter_fault(mode: int) -> str:
    """Return the clause on a mode whose curves do not show how lambda varies, which the paper's forms need."""
    return (
        f"the curves of mode {mode} do not show how lambda varies (there is only one, they are equal, or they have no "
        f'amplitudes in common): give cov of mode {mode}, or take form = "recommended"'
    )


def coefficient_of_variation(curves: Sequence[MeasuredBackbone]) -> float:
    """Return standard deviation over mean of lambda across curves of one mode, averaged over amplitudes.

    It is that of Song et al. below eqs. (5) and (12), over the amplitude of a sensor that all have; nan for a single
    curve, or where the curves have no range of amplitude in common.
    """
    first = curves[0].controlled_sensor
    columns = [np.abs(one.amplitude[:, one.sensors.index(first)]) for one in curves if first in one.sensors]
    if len(columns) < max(2, len(curves)):
        return float("nan")
    low, high = max(column.min() for column in columns), min(column.max() for column in columns)
    if low >= high:
        return float("nan")
    amplitude = np.linspace(low, high, 20)
    order = [np.argsort(column) for column in columns]
    values = np.array(
        [np.interp(amplitude, c[k], one.eigenvalue[k]) for one, c, k in zip(curves, columns, order, strict=True)]
    )
    return float(np.mean(values.std(axis=0, ddof=1) / values.mean(axis=0)))


def _make_mode_data(
    system: JointedModes, curves: Sequence[MeasuredBackbone], noise: NoiseSettings, cov: float, form: Form, n_nodes: int
) -> ModeData:
    mode = curves[0].mode
    linear = float(system.eigenvalue[system.index(mode)])
    if linear <= 0:
        raise InputError(f"mode {mode} has no stiffness (0 Hz): a backbone needs an elastic mode")
    for fault in joint_fault(system, mode):
        raise InputError(fault)
    sensors = list_sensors(curves)
    rows = np.array([system.sensor(name) for name in sensors])
    shapes = np.concatenate([spread_sensors(one.amplitude, one.sensors, sensors) for one in curves])
    shapes = shapes / np.linalg.norm(shapes, axis=1, keepdims=True)
    parts, blocks = [], []
    controlled = [one.controlled_sensor for one in curves]
    names = np.repeat(controlled, [one.frequency_hz.size for one in curves])
    amplitude = np.concatenate([one.controlled_amplitude for one in curves])
    for sensor in dict.fromkeys(controlled):
        system.sensor(sensor)
        mine = names == sensor
        nodes, block = _place_nodes(amplitude[mine], n_nodes)
        rows_of_all = np.zeros((mine.size, nodes.size))
        rows_of_all[mine] = block
        parts.append((sensor, nodes))
        blocks.append(rows_of_all)
    between = np.concatenate(blocks, axis=1)
    curve = np.repeat(np.arange(len(curves)), [one.frequency_hz.size for one in curves])
    eigenvalue = np.concatenate([one.eigenvalue for one in curves])
    relative, growth = _find_growth(names, amplitude, eigenvalue / linear)
    days = [one.day for one in curves]
    day = np.unique(days, return_inverse=True)[1][curve] if any(days) else None
    found = ModeData(
        mode, tuple(parts), between, curve, day, eigenvalue, names, amplitude, relative, growth, shapes,
        _find_sets(shapes, curve, [[name in one.sensors for name in sensors] for one in curves]), rows, linear, cov,
        None, None,
    )  # fmt: skip
    return with_noise(found, noise, ErrorGrowth.of(noise)) if form == "recommended" else found


def with_noise(mode: ModeData, noise: NoiseSettings, errors: ErrorGrowth) -> ModeData:
    """Return the curves of a mode with the noise models of the recommended form.

    Args:
        mode: the curves.
        noise: the settings of their errors.
        errors: the growth of the errors of the linear structure.
    """
    place: Any = (mode.between, mode.curve, mode.growth)
    # An error of the structure that several sets see is taken as one of each, which together tell as much as one.
    often = float(np.sqrt(len(mode.shape_sets)))
    sets = []
    for each in mode.shape_sets:
        values = each.take(mode.shapes[each.points])[:, each.free]
        own = shape_noise_of(mode, each.points, values, noise, errors, often) if values.size and noise.shapes else None
        sets.append(replace(each, noise=own))
    frequency_noise = curve_noise(
        (mode.eigenvalue / mode.linear)[:, None], *place, common_std=2 * noise.linear_error,
        offset=2 * noise.curve_offset, expected=2 * noise.point_noise, common_growth=errors.frequency,
        own_growth=noise.curve_growth, patterns=errors.patterns, day=mode.day, day_std=2 * noise.day_offset,
    )  # fmt: skip
    return replace(mode, frequency_noise=frequency_noise, shape_sets=tuple(sets), errors=errors)


def shape_noise_of(
    mode: ModeData,
    points: NDArray[np.bool_],
    values: FloatArray,
    noise: NoiseSettings,
    errors: ErrorGrowth,
    often: float = 1.0,
) -> CurveNoise:
    """Return the noise model of quantities whose errors are those of entries of a shape of unit length.

    Args:
        mode: the curves.
        points: (n_points,) whether a point has these quantities.
        values: (n_kept, n_channels) these quantities as they were measured there.
        noise: the settings of their errors.
        errors: the growth of the errors of the linear structure.
        often: factor of the error of the linear structure.
    """
    return curve_noise(
        values, mode.between[points], _number(mode.curve[points]), mode.growth[points],
        common_std=often * noise.linear_shape_error, offset=noise.shape_offset, expected=noise.shape_noise,
        common_growth=errors.shape, own_growth=noise.curve_growth,
    )  # fmt: skip


def _number(names: IntArray) -> IntArray:
    """Return numbers from 0 in the place of larger ones with gaps."""
    return np.asarray(np.unique(names, return_inverse=True)[1], dtype=np.int64)


def _find_sets(shapes: FloatArray, curve: IntArray, sensed: Sequence[Sequence[bool]]) -> tuple[ShapeSet, ...]:
    """Return the curves by their sensors; `sensed` tells of each curve which sensors of the mode it has."""
    kinds, kind = np.unique(np.array(sensed), axis=0, return_inverse=True)
    sets = []
    for number, has in enumerate(kinds):
        points, columns = kind.ravel()[curve] == number, np.flatnonzero(has)
        largest = int(np.argmax(np.abs(shapes[points][:, columns]).mean(axis=0)))
        free = np.delete(np.arange(columns.size), largest)
        sets.append(ShapeSet(points, columns, free, columns.size == shapes.shape[1]))
    return tuple(sets)


def without_curve(mode: ModeData, curve: int, noise: NoiseSettings) -> ModeData:
    """Return the curves of a mode, which have noise models, without one of them.

    Args:
        mode: the curves.
        curve: number of the curve that is left out, from 0.
        noise: the settings of their errors.
    """
    assert mode.errors is not None  # The recommended form has noise models.
    kept, patterns = mode.curve != curve, mode.errors.patterns
    per_point = ("between", "eigenvalue", "sensor", "amplitude", "relative_amplitude", "growth", "shapes")
    left = {name: getattr(mode, name)[kept] for name in per_point}
    left["day"] = None if mode.day is None else _number(mode.day[kept])
    sets = tuple(replace(each, points=each.points[kept]) for each in mode.shape_sets if each.points[kept].any())
    errors = replace(mode.errors, patterns=None if patterns is None else patterns[kept])
    return with_noise(replace(mode, curve=_number(mode.curve[kept]), shape_sets=sets, **left), noise, errors)


def draw_curves(mode: ModeData, eigenvalue: FloatArray, shapes: FloatArray, rng: np.random.Generator) -> ModeData:
    """Return curves of a mode as they might have been measured, with errors like those that the measured ones have.

    Args:
        mode: the measured curves, which have noise models.
        eigenvalue: (n_nodes,) lambda of the true law at the nodes.
        shapes: (n_nodes, n_sensors) unit shapes of the true law there.
        rng: source of chance.
    """
    assert mode.frequency_noise is not None  # The recommended form has noise models.
    place: Any = (mode.between, mode.curve, mode.growth, rng)
    relative = draw_set(mode.frequency_noise, (eigenvalue / mode.linear)[:, None], *place)[:, 0]
    seen = np.zeros(mode.shapes.shape)
    for each in mode.shape_sets:
        model, points = each.take(shapes), each.points
        own = mode.between[points] @ model
        if each.noise is not None:
            where: Any = (mode.between[points], _number(mode.curve[points]), mode.growth[points], rng)
            own[:, each.free] = draw_set(each.noise, model[:, each.free], *where)
            largest = np.setdiff1d(np.arange(own.shape[1]), each.free)
            left = np.maximum(1.0 - np.sum(own[:, each.free] ** 2, axis=1), 0.0)
            own[:, largest] = np.sign(own[:, largest]) * np.sqrt(left)[:, None]
        seen[np.ix_(points, each.columns)] = own
    amplitude, growth = _find_growth(mode.sensor, mode.amplitude, relative)
    return replace(mode, eigenvalue=mode.linear * relative, shapes=seen, relative_amplitude=amplitude, growth=growth)


def _find_growth(names: NDArray[np.str_], amplitude: FloatArray, grown: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the amplitude of each point relative to the largest, and the growth of lambda there.

    The growth is smoothed by a cubic: if it held the noise of the points, a slope of the error would fit that noise.
    """
    relative, smooth = np.empty_like(grown), np.empty_like(grown)
    for name in np.unique(names):
        mine = names == name
        relative[mine] = amplitude[mine] / amplitude[mine].max()
        powers = np.vander(relative[mine], 1 + min(3, max(1, int(mine.sum()) // 4)))
        smooth[mine] = powers @ np.linalg.lstsq(powers, grown[mine], rcond=None)[0]
    return relative, smooth - smooth.min()


def _place_nodes(amplitude: FloatArray, n_nodes: int) -> tuple[FloatArray, FloatArray]:
    """Return amplitudes to solve at, Chebyshev nodes or the few given ones, and the matrix that interpolates them."""
    unique, index = np.unique(amplitude, return_inverse=True)
    if unique.size <= n_nodes:
        return unique, np.eye(unique.size)[index]
    from scipy.interpolate import BarycentricInterpolator

    low, high = unique[0], unique[-1]
    nodes = (low + high) / 2 - (high - low) / 2 * np.cos(np.pi * np.arange(n_nodes) / (n_nodes - 1))
    # The weights of Chebyshev nodes (Berrut & Trefethen 2004, eq. 5.4) are stated, for scipy's depend on chance.
    weights = (-1.0) ** np.arange(n_nodes)
    weights[[0, -1]] /= 2
    return nodes, BarycentricInterpolator(nodes, np.eye(n_nodes), wi=weights)(amplitude)


# ---- modes that a harmonic meets ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class MetModes:
    """Modes that a harmonic of one backbone meets, which get a residual flexibility in their place.

    Such a mode keeps its contribution to the first harmonic, psi_i psi_i^T / (l_i - l) at the mean measured l, but has
    no resonance: the backbone runs smoothly and has no loop there. Loops are narrow; an error of the linear structure
    of a few tenths of a per cent moves them to other amplitudes than the measured ones. The effect of the resonance
    beside the loop is left out, too: relative to the frequencies of the wing-engine structure it is 2.5e-5 at a
    distance of two per cent, and 1.2e-4 at half a per cent.
    """

    columns: IntArray  # their columns
    middle: float  # mean measured l, 1/s^2

    def remove_from(self, system: JointedModes) -> JointedModes:
        """Return the structure with residual flexibility in place of these modes."""
        if not self.columns.size:
            return system
        eigenvalue, scale = system.eigenvalue.copy(), self.scale_of(system)
        eigenvalue[self.columns] *= FAR_AWAY
        return JointedModes(
            eigenvalue, scale * system.at_sensors, scale * system.at_joints, system.sensors, system.joints
        )

    def scale_of(self, system: JointedModes) -> FloatArray:
        """Return by what the shape of each mode is multiplied, (n_modes,)."""
        scale, own = np.ones(system.n_modes), system.eigenvalue[self.columns]
        scale[self.columns] = np.sqrt((FAR_AWAY * own - self.middle) / (own - self.middle))
        return scale


def find_met_modes(data: BackboneData, mode: ModeData) -> MetModes:
    """Return the modes that a harmonic of the model may meet, near any measured frequency."""
    measured = np.sqrt(mode.eigenvalue)
    low, high = (1 - UPDATING.interaction_reach) * measured.min(), (1 + UPDATING.interaction_reach) * measured.max()
    own = np.sqrt(np.maximum(data.system.eigenvalue, 0.0))
    near = np.zeros(own.size, dtype=bool)
    for harmonic in data.harmonics:
        if harmonic > 1:
            near |= (own > harmonic * low) & (own < harmonic * high)
    # Modes that are nearer meet the first harmonic.
    return MetModes(np.flatnonzero(near & (own > LEAST_APART**0.5 * high)), float(mode.eigenvalue.mean()))
