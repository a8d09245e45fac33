"""The likelihood of measured backbones given the coefficients of a law, in the paper's forms and a recommended one.

The model's curves run smoothly past interactions of modes, and gaps in them are interpolated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, NotDeterminedError, nearest
from opid.mechanics.backbones.family import BackboneFamily, FamilyEvaluator, family_evaluator
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.signals.recording import FloatArray
from opid.updating.checks import joint_fault, sensor_faults
from opid.updating.likelihood.noise import CurveNoise, NoiseSettings, curve_noise, draw_set, log_marginal
from opid.updating.measured import MeasuredBackbone, by_mode
from opid.updating.model_class import ModelClass
from opid.updating.settings import UPDATING

Form = Literal["paper", "literal", "recommended", "independent"]
FORMS: tuple[Form, ...] = get_args(Form)

IntArray = NDArray[np.int64]

N_NODES = 12  # amplitudes at which the model is solved for one mode; between them its curve is a polynomial


@dataclass(frozen=True, eq=False)
class ErrorGrowth:
    """How errors of the linear structure grow along the curves of a mode, while the nonlinearity doubles lambda.

    Args:
        frequency: growth of the error of lambda, in units of 2 `linear_error`.
        shape: growth of the error of a shape, in units of `linear_shape_error`.
        patterns: (n_points, n) errors of lambda that do not grow with lambda, in the first unit.
    """

    frequency: float
    shape: float
    patterns: FloatArray | None = None

    @staticmethod
    def of(noise: NoiseSettings) -> ErrorGrowth:
        """Return the growth that is stated, or that is usual where it is not known."""
        return ErrorGrowth(noise.growth_of_linear_error, noise.growth_of_linear_error)


@dataclass(frozen=True, eq=False)
class ModeData:
    """The curves of one mode, ready to be compared with a model that is solved at a few amplitudes."""

    mode: int  # number of the mode, from 1
    # each controlled sensor, and (n_nodes,) amplitudes, m, at which the model is solved for it
    parts: tuple[tuple[str, FloatArray], ...]
    between: FloatArray  # (n_points, n_nodes of all parts) matrix that takes values at the nodes to the measured points
    curve: IntArray  # (n_points,) number of the curve of each point, from 0
    eigenvalue: FloatArray  # (n_points,) measured lambda, 1/s^2
    sensor: NDArray[np.str_]  # (n_points,) name of the controlled sensor of each point
    amplitude: FloatArray  # (n_points,) amplitude of that sensor, m
    # (n_points,) amplitude of the controlled sensor over the largest of all curves with the same sensor
    relative_amplitude: FloatArray
    # (n_points,) growth of lambda / linear from the lowest point, smoothed over the amplitude
    growth: FloatArray
    shapes: FloatArray  # (n_points, n_sensors) measured shapes of unit length
    # (n_sensors - 1,) columns of the shapes without that of the largest entry, which the unit length fixes
    free: IntArray
    rows: IntArray  # (n_sensors,) rows of these sensors in the system
    linear: float  # lambda of the mode without nonlinearity, 1/s^2
    cov: float  # coefficient of variation of lambda over the curves; nan where it is not known
    frequency_noise: CurveNoise | None  # noise model of lambda / linear, for the recommended form
    shape_noise: CurveNoise | None  # noise model of the free entries of the shapes
    errors: ErrorGrowth | None  # growth of the errors of the linear structure in these noise models


@dataclass(frozen=True, eq=False)
class BackboneData:
    """All measured backbones, ready for `likelihood_function`.

    Args:
        system: the linear structure with its joints.
        modes: the data of each mode.
        form: form of the likelihood.
        harmonics: harmonics of the model.
        noise: settings for the errors.
    """

    system: JointedModes
    modes: tuple[ModeData, ...]
    form: Form
    harmonics: tuple[int, ...]
    noise: NoiseSettings


def backbone_data(
    system: JointedModes,
    measured: Sequence[MeasuredBackbone],
    *,
    form: Form = "recommended",
    harmonics: Sequence[int] = (1, 3),
    noise: NoiseSettings | None = None,
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

    Raises:
        InputError: no backbone, an unknown form, sensors that the system does not have, curves of one mode with
            different sensors, a mode that extends no joint, or one whose coefficient of variation is needed and follows
            neither from the curves nor from `noise`.
    """
    noise = noise or NoiseSettings()
    if form not in FORMS:
        raise InputError(f"there is no likelihood {form!r}: {nearest(form, FORMS)}")
    if not measured:
        raise InputError("there is no measured backbone: give at least one")
    for fault in sensor_faults(measured):
        raise InputError(fault)
    modes = []
    for mode, curves in by_mode(measured).items():
        cov = (noise.cov or {}).get(mode) or coefficient_of_variation(curves)
        modes.append(_make_mode_data(system, curves, noise, cov, form))
    for each in modes if form != "recommended" else ():
        if not each.cov > 0:
            raise InputError(scatter_fault(each.mode))
    return BackboneData(system, tuple(modes), form, tuple(int(h) for h in harmonics), noise)


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
    system: JointedModes, curves: Sequence[MeasuredBackbone], noise: NoiseSettings, cov: float, form: Form
) -> ModeData:
    mode = curves[0].mode
    linear = float(system.eigenvalue[system.index(mode)])
    if linear <= 0:
        raise InputError(f"mode {mode} has no stiffness (0 Hz): a backbone needs an elastic mode")
    for fault in joint_fault(system, mode):
        raise InputError(fault)
    sensors = curves[0].sensors
    rows = np.array([system.sensor(name) for name in sensors])
    shapes = np.concatenate([one.amplitude[:, [one.sensors.index(name) for name in sensors]] for one in curves])
    shapes = shapes / np.linalg.norm(shapes, axis=1, keepdims=True)
    parts, blocks = [], []
    controlled = [one.controlled_sensor for one in curves]
    names = np.repeat(controlled, [one.frequency_hz.size for one in curves])
    amplitude = np.concatenate([one.controlled_amplitude for one in curves])
    for sensor in dict.fromkeys(controlled):
        system.sensor(sensor)
        mine = names == sensor
        nodes, block = _place_nodes(amplitude[mine])
        rows_of_all = np.zeros((mine.size, nodes.size))
        rows_of_all[mine] = block
        parts.append((sensor, nodes))
        blocks.append(rows_of_all)
    between = np.concatenate(blocks, axis=1)
    curve = np.repeat(np.arange(len(curves)), [one.frequency_hz.size for one in curves])
    eigenvalue = np.concatenate([one.eigenvalue for one in curves])
    relative, growth = _find_growth(names, amplitude, eigenvalue / linear)
    free = np.delete(np.arange(len(sensors)), np.argmax(np.abs(shapes).mean(axis=0)))
    found = ModeData(
        mode, tuple(parts), between, curve, eigenvalue, names, amplitude, relative, growth, shapes, free, rows, linear,
        cov, None, None, None,
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
    frequency_noise = curve_noise(
        (mode.eigenvalue / mode.linear)[:, None], *place, common_std=2 * noise.linear_error,
        offset=2 * noise.curve_offset, expected=2 * noise.point_noise, common_growth=errors.frequency,
        own_growth=noise.curve_growth, patterns=errors.patterns,
    )  # fmt: skip
    shape_noise = None
    if noise.shapes and mode.free.size:
        shape_noise = curve_noise(
            mode.shapes[:, mode.free], *place, common_std=noise.linear_shape_error, offset=noise.shape_offset,
            expected=noise.shape_noise, common_growth=errors.shape, own_growth=noise.curve_growth,
        )  # fmt: skip
    return replace(mode, frequency_noise=frequency_noise, shape_noise=shape_noise, errors=errors)


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
    numbers = np.unique(mode.curve[kept], return_inverse=True)[1]
    errors = replace(mode.errors, patterns=None if patterns is None else patterns[kept])
    return with_noise(replace(mode, curve=numbers, **left), noise, errors)


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
    seen = mode.between @ shapes
    if mode.shape_noise is not None:
        seen[:, mode.free] = draw_set(mode.shape_noise, shapes[:, mode.free], *place)
        largest = np.setdiff1d(np.arange(seen.shape[1]), mode.free)
        left = np.maximum(1.0 - np.sum(seen[:, mode.free] ** 2, axis=1), 0.0)
        seen[:, largest] = np.sign(seen[:, largest]) * np.sqrt(left)[:, None]
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


def _place_nodes(amplitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return amplitudes to solve at, Chebyshev nodes or the few given ones, and the matrix that interpolates them."""
    unique, index = np.unique(amplitude, return_inverse=True)
    if unique.size <= N_NODES:
        return unique, np.eye(unique.size)[index]
    from scipy.interpolate import BarycentricInterpolator

    low, high = unique[0], unique[-1]
    nodes = (low + high) / 2 - (high - low) / 2 * np.cos(np.pi * np.arange(N_NODES) / (N_NODES - 1))
    # The weights of Chebyshev nodes (Berrut & Trefethen 2004, eq. 5.4) are stated, for scipy's depend on chance.
    weights = (-1.0) ** np.arange(N_NODES)
    weights[[0, -1]] /= 2
    return nodes, BarycentricInterpolator(nodes, np.eye(N_NODES), wi=weights)(amplitude)


MOST_NAMED = 4  # largest number of points that a sentence names

BoolArray = NDArray[np.bool_]

Curves = Callable[[FloatArray], tuple[FloatArray, FloatArray, BoolArray, BoolArray]]
"""theta (n, d) -> lambda (n, n_nodes), shapes of unit length (n, n_nodes, n_sensors), nodes without a solution
(n, n_nodes), and whether a theta has no curve (n,) because too many nodes are missing."""

Likelihood = Callable[[ArrayLike], tuple[FloatArray, int]]
"""theta (n, d) -> log p(D | theta) (n,), and the number of points of the model that did not converge."""


def likelihood_function(data: BackboneData, model_class: ModelClass) -> Likelihood:
    """Return theta (n, d) -> log p(D | theta), (n,), and the number of points of the model that did not converge.

    Every form has its normalising constant (Song eq. 17; eq. 7 misprints it). Points of the model that did not converge
    are interpolated; a theta for which too many are missing (see `make_curves`) has the logarithm -inf.

    Args:
        data: the backbones, from `backbone_data`, which names the form.
        model_class: the law.
    """
    models = [(mode, make_curves(data, mode, model_class)) for mode in data.modes]

    def likelihood(theta: ArrayLike) -> tuple[FloatArray, int]:
        rows = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        total, impossible, failed = np.zeros(len(rows)), np.zeros(len(rows), dtype=bool), 0
        for mode, curves in models:
            eigenvalue, shapes, missing, lost = curves(rows)
            if data.form == "recommended":
                total += weigh_as_recommended(mode, eigenvalue, shapes)
            else:
                total += _weigh_as_in_paper(data, mode, eigenvalue, shapes)
            impossible |= lost
            failed += int(missing.sum())
        return np.where(impossible, -np.inf, total), failed

    return likelihood


def weigh_as_recommended(mode: ModeData, eigenvalue: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return the log likelihood of one mode in the recommended form, (n,).

    Args:
        mode: the curves.
        eigenvalue: (n, n_nodes) lambda of the model at its nodes.
        shapes: (n, n_nodes, n_sensors) unit shapes there.
    """
    if mode.frequency_noise is None:
        raise NotDeterminedError("the backbones were not prepared for the recommended form: call backbone_data with it")
    total = log_marginal(mode.frequency_noise, eigenvalue[..., None] / mode.linear)
    if mode.shape_noise is not None:
        total = total + log_marginal(mode.shape_noise, shapes[..., mode.free])
    return total


def residuals(mode: ModeData, eigenvalue: FloatArray) -> FloatArray:
    """Return e_lambda of every point, with the r_m of its curve (Song eq. 10): (n, n_nodes) -> (n, n_points)."""
    first = np.unique(mode.curve, return_index=True)[1]
    r_m = (mode.linear - mode.eigenvalue[first])[mode.curve]
    return mode.eigenvalue - eigenvalue @ mode.between.T + r_m


def _weigh_as_in_paper(data: BackboneData, mode: ModeData, eigenvalue: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return the log likelihood of one mode by eqs. (12) and (17), with one of three sums over points."""
    noise, n_sensors = data.noise, mode.rows.size
    sigma = noise.weight * mode.cov * mode.eigenvalue
    factor = noise.shape_factor if noise.shape_factor is not None else np.sqrt(n_sensors)
    sigma_phi = factor * noise.weight * mode.cov
    score = residuals(mode, eigenvalue) / sigma
    of_curve = np.eye(mode.curve[-1] + 1)[mode.curve]
    weight = of_curve / (1.0 if data.form == "independent" else of_curve.sum(axis=0))
    misfit = ((score @ weight) ** 2 if data.form == "literal" else score**2 @ weight).sum(axis=1)
    n_errors, log_sigmas = sigma.size, np.log(sigma).sum()
    if noise.shapes and n_sensors > 1:
        misfit = misfit + (_find_shape_misfit(mode, shapes) @ weight).sum(axis=1) / sigma_phi**2
        # The unit length fixes one entry of a shape.
        n_free = len(mode.shapes) * (n_sensors - 1)
        n_errors, log_sigmas = n_errors + n_free, log_sigmas + n_free * np.log(sigma_phi)
    return -0.5 * n_errors * np.log(2 * np.pi) - log_sigmas - 0.5 * misfit


def _find_shape_misfit(mode: ModeData, shapes: FloatArray) -> FloatArray:
    """Return e_phi^T e_phi of every point, which is exactly 1 - MAC (Song eq. 11)."""
    model = np.einsum("jk,nks->njs", mode.between, shapes, optimize=True)
    return 1 - np.einsum("njs,js->nj", model, mode.shapes) ** 2 / np.einsum("njs,njs->nj", model, model)


# ---- the model's curves ----------------------------------------------------------------------------


def make_curves(data: BackboneData, mode: ModeData, model_class: ModelClass) -> Curves:
    """Return theta -> the model of one mode at its nodes.

    A point where Newton's method fails, as in an interaction with another mode, is interpolated by a polynomial through
    the others, so that the remainder of the curve still counts. There is no curve where too many points fail, or where
    the others span too little of the range (`UpdatingThresholds`). The curve has no loops where a harmonic meets
    another mode (`without_interactions`), for one node on a loop would bend the whole polynomial.
    """
    system = without_interactions(data, mode)
    solvers = [make_solver(data, model_class, system, mode.mode, sensor, amplitude) for sensor, amplitude in mode.parts]
    middle = mode.shapes.mean(axis=0)

    def curves(theta: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
        found = [solve(theta) for solve in solvers]
        lost = np.zeros(len(theta), dtype=bool)
        whole = []
        for each in found:
            values = np.concatenate([each.eigenvalue[..., None], each.shapes[..., mode.rows]], axis=2)
            for row in np.flatnonzero(~each.converged.all(axis=1)):
                bridged = _bridge_gaps(values[row], each.amplitude, each.converged[row])
                lost[row] |= bridged is None
                # A curve that is lost may hold any finite numbers.
                values[row] = np.append(mode.linear, middle) if bridged is None else bridged
            whole.append(values)
        values = np.concatenate(whole, axis=1)
        shapes = values[..., 1:]
        # The shapes get the sign of the measured ones.
        size = np.sqrt(np.einsum("nks,nks->nk", shapes, shapes)) * np.where(shapes @ middle < 0, -1.0, 1.0)
        missing = ~np.concatenate([each.converged for each in found], axis=1)
        return values[..., 0], shapes / size[..., None], missing, lost

    return curves


@dataclass(frozen=True, eq=False)
class ClassSolver:
    """theta (n, n_parameters) -> the backbones of one mode with the laws of a class at the joints."""

    model_class: ModelClass
    evaluate: FamilyEvaluator

    def __call__(self, theta: FloatArray) -> BackboneFamily:
        """Return the backbones for each row of theta."""
        return self.evaluate(self.model_class.coefficients(theta))

    def find_slopes(
        self, theta: FloatArray, found: BackboneFamily, couplings: ArrayLike = ()
    ) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of the backbones that were `found`, see `FamilyEvaluator.find_slopes`.

        They are (n, n_points, n_parameters) and (n, n_points, n_sensors, n_parameters), by theta and then by the linear
        parameters of `couplings`.
        """
        slopes = self.evaluate.find_slopes(self.model_class.coefficients(theta), found, couplings)
        unknown, scales = self.model_class.is_unknown, [each.scale for each in self.model_class.parameters]
        n_linear = slopes[0].shape[-1] - unknown.size
        kept = np.append(unknown, np.ones(n_linear, dtype=bool))
        by_value, by_shape = (each[..., kept] * np.append(scales, np.ones(n_linear)) for each in slopes)
        return by_value, by_shape


def make_solver(
    data: BackboneData, model_class: ModelClass, system: JointedModes, mode: int, sensor: str, amplitude: FloatArray
) -> ClassSolver:
    """Return the solver of a mode of `system` at amplitudes of a sensor, with the laws of a class at its joints."""
    evaluate = family_evaluator(
        system, model_class.kinds, mode=mode, sensor=sensor, amplitude=amplitude, harmonics=data.harmonics,
        joints=model_class.joints,
    )  # fmt: skip
    return ClassSolver(model_class, evaluate)


def find_met_modes(data: BackboneData, mode: ModeData) -> IntArray:
    """Return the columns of the modes that a harmonic of the model may meet, near any measured frequency."""
    measured = np.sqrt(mode.eigenvalue)
    low, high = (1 - UPDATING.interaction_reach) * measured.min(), (1 + UPDATING.interaction_reach) * measured.max()
    own = np.sqrt(np.maximum(data.system.eigenvalue, 0.0))
    near = np.zeros(own.size, dtype=bool)
    for harmonic in data.harmonics:
        if harmonic > 1:
            near |= (own > harmonic * low) & (own < harmonic * high)
    # Modes that are nearer meet the first harmonic.
    return np.flatnonzero(near & (own > 1.3 * high))


def without_interactions(data: BackboneData, mode: ModeData) -> JointedModes:
    """Return the structure with residual flexibility in place of the modes that a harmonic of one backbone meets.

    Such a mode keeps its contribution to the first harmonic, psi_i psi_i^T / (l_i - l) at the mean measured l, but has
    no resonance: the backbone runs smoothly and has no loop there. Loops are narrow; an error of the linear structure
    of a few tenths of a per cent moves them to other amplitudes than the measured ones. The effect of the resonance
    beside the loop is left out, too: relative to the frequencies of the wing-engine structure it is 2.5e-5 at a
    distance of two per cent, and 1.2e-4 at half a per cent.
    """
    met, system = find_met_modes(data, mode), data.system
    if not met.size:
        return system
    eigenvalue, middle = system.eigenvalue.copy(), float(mode.eigenvalue.mean())
    eigenvalue[met] *= 1e3  # out of the reach of all harmonics
    scale = np.ones(system.n_modes)
    scale[met] = np.sqrt((eigenvalue[met] - middle) / (system.eigenvalue[met] - middle))
    return JointedModes(eigenvalue, scale * system.at_sensors, scale * system.at_joints, system.sensors, system.joints)


def describe_interactions(data: BackboneData, model_class: ModelClass, theta: ArrayLike) -> list[str]:
    """Return one clause for each mode and controlled sensor, on the measured points where a harmonic meets a mode.

    Such points may lie off the model's smooth curve. They are those where the model with the interaction has no
    solution for theta, (n_parameters,), or one that differs by more than the expected noise of a point (`point_noise`).
    """
    one = np.asarray(theta, dtype=np.float64)[np.newaxis]
    clauses = []
    for mode in data.modes:
        met = find_met_modes(data, mode)
        if not met.size:
            continue
        for sensor, _ in mode.parts:
            amplitude = np.unique(mode.amplitude[mode.sensor == sensor])
            whole, smooth = (
                make_solver(data, model_class, system, mode.mode, sensor, amplitude)(one).frequency_hz[0]
                for system in (data.system, without_interactions(data, mode))
            )
            off = np.isfinite(smooth) & ~(np.abs(whole / smooth - 1) <= data.noise.point_noise)
            if off.any():
                clauses.append(
                    f"mode {mode.mode} at {_describe_span(amplitude[off])} mm of sensor {sensor!r} ({off.sum()} of "
                    f"{amplitude.size} measured amplitudes) {_describe_meeting(data, met, smooth[off])}"
                )
    return clauses


def _describe_meeting(data: BackboneData, met: IntArray, frequency_hz: FloatArray) -> str:
    orders = np.array([h for h in data.harmonics if h > 1])
    own = data.system.frequency_hz[met]
    apart = np.abs(orders[:, None, None] * frequency_hz / own[:, None] - 1).min(axis=2)
    order, nearest = np.unravel_index(np.argmin(apart), apart.shape)
    return f"harmonic {orders[order]} meets mode {met[nearest] + 1} at {own[nearest]:.4g} Hz"


def describe_failures(
    data: BackboneData, model_class: ModelClass, theta: ArrayLike, *, lost: bool = False
) -> list[str]:
    """Return one clause for each mode, on the points where Newton's method fails for some theta, (n, n_parameters).

    With `lost` only those theta count that have no curve.
    """
    rows = np.atleast_2d(np.asarray(theta, dtype=np.float64))
    clauses = []
    for mode in data.modes:
        _, _, missing, gone = make_curves(data, mode, model_class)(rows)
        if lost:
            missing = missing[gone]
        ends = np.cumsum([0, *(amplitude.size for _, amplitude in mode.parts)])
        for (sensor, amplitude), (first, last) in zip(mode.parts, pairwise(ends), strict=True):
            often = missing[:, first:last].sum(axis=0)
            if often.any():
                percent = 100 * missing[:, first:last].any(axis=1).sum() / len(rows)
                clauses.append(
                    f"mode {mode.mode} at {describe_points(amplitude, often > 0, sensor)} for "
                    f"{percent:.{0 if percent >= 1 else 1}f} %"
                )
    return clauses


def describe_points(amplitude: FloatArray, chosen: BoolArray, sensor: str) -> str:
    """Return the chosen points of a curve, (n,), as words, with their amplitude in mm.

    >>> describe_points(np.array([1e-3, 2e-3, 3e-3]), np.array([False, True, True]), "tip")
    "2 to 3 mm of sensor 'tip' (points 2 and 3 of 3)"
    """
    numbers = [str(index + 1) for index in np.flatnonzero(chosen)]
    if len(numbers) > MOST_NAMED:
        numbers = [*numbers[: MOST_NAMED - 1], f"{len(numbers) - MOST_NAMED + 1} more"]
    listed = numbers[0] if len(numbers) == 1 else f"{', '.join(numbers[:-1])} and {numbers[-1]}"
    points = f"point{'s' * (len(numbers) > 1)} {listed} of {amplitude.size}"
    return f"{_describe_span(amplitude[chosen])} mm of sensor {sensor!r} ({points})"


def _describe_span(amplitude: FloatArray) -> str:
    low, high = (f"{1e3 * value:.3g}" for value in (amplitude.min(), amplitude.max()))
    return low if low == high else f"{low} to {high}"


def _bridge_gaps(values: FloatArray, amplitude: FloatArray, converged: BoolArray) -> FloatArray | None:
    """Return values (n_nodes, n) with gaps filled by a polynomial over the amplitude; None if too much is missing."""
    n_found = int(converged.sum())
    if n_found < 4 or n_found < (1 - UPDATING.most_missing) * converged.size:
        return None
    known = amplitude[converged]
    if np.ptp(known) < UPDATING.least_span * np.ptp(amplitude):
        return None
    powers = np.polynomial.chebyshev.chebvander(
        2 * (amplitude - amplitude.min()) / np.ptp(amplitude) - 1, min(6, n_found - 2)
    )
    smooth = powers @ np.linalg.lstsq(powers[converged], values[converged], rcond=None)[0]
    return np.where(converged[:, None], values, smooth)
