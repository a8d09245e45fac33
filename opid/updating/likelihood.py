"""The likelihood of measured backbones given the coefficients of a law, in the paper's forms and a recommended one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, NotDeterminedError, nearest
from opid.mechanics.backbones import family_evaluator
from opid.mechanics.jointed_modes import JointedModes
from opid.signals.recording import FloatArray
from opid.updating.curve_noise import CurveNoise, curve_noise, log_marginal
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import ModelClass
from opid.updating.noise_settings import NoiseSettings

Form = Literal["paper", "literal", "recommended", "independent"]
FORMS: tuple[Form, ...] = get_args(Form)

__all__ = [
    "FORMS",
    "BackboneData",
    "Form",
    "ModeData",
    "NoiseSettings",
    "backbone_data",
    "coefficient_of_variation",
    "curves_of",
    "likelihood_function",
    "log_likelihood",
    "residuals",
]

IntArray = NDArray[np.int64]

N_NODES = 12
"""Amplitudes at which the model is solved for one mode; between them its curve is a polynomial."""


@dataclass(frozen=True, eq=False)
class ModeData:
    """The curves of one mode, ready to be compared with a model that is solved at a few amplitudes.

    Args:
        mode: its number, from 1.
        parts: controlled sensor and (n_nodes,) amplitudes, m, at which the model is solved for it.
        between: (n_points, n_nodes of all parts) what takes values at the nodes to the measured points.
        curve: (n_points,) number of the curve of each point, from 0.
        eigenvalue: (n_points,) measured lambda, 1/s^2.
        shapes: (n_points, n_sensors) measured shapes of unit length.
        rows: (n_sensors,) rows of these sensors in the system.
        linear: lambda of the mode without nonlinearity, 1/s^2.
        cov: coefficient of variation of lambda over the curves; nan where nothing tells.
        frequency_noise: noise model of lambda / linear, for the recommended form.
        shape_noise: noise model of the shapes.
    """

    mode: int
    parts: tuple[tuple[str, FloatArray], ...]
    between: FloatArray
    curve: IntArray
    eigenvalue: FloatArray
    shapes: FloatArray
    rows: IntArray
    linear: float
    cov: float
    frequency_noise: CurveNoise | None
    shape_noise: CurveNoise | None


@dataclass(frozen=True, eq=False)
class BackboneData:
    """All measured backbones, ready for `log_likelihood`.

    Args:
        system: the linear structure with its joints.
        modes: one entry a mode.
        form: of the likelihood.
        harmonics: of the model.
        noise: settings.
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
    n_nodes: int = N_NODES,
) -> BackboneData:
    """Return measured backbones grouped by mode, with all that does not depend on the law worked out.

    Args:
        system: the linear structure with its joints.
        measured: the backbones; those of one mode are tests of the same structure.
        form: "paper" is Song eqs. (10) to (12) with the mean of squares of each curve; "literal" eq. (12) as printed,
            which squares the mean, so that errors cancel; "independent" takes every point as a measurement of its own
            (eqs. 7 and 8); "recommended" has curves with offsets of their own (`opid.updating.curve_noise`).
        harmonics: of the model.
        noise: what is known of the errors.
        n_nodes: amplitudes at which the model is solved for each mode and controlled sensor; at all measured ones where
            there are fewer.

    Raises:
        InputError: no backbone, an unknown form, sensors that the system does not have, curves of one mode without a
            common sensor, or a mode whose coefficient of variation neither the curves nor `noise` tell.
    """
    noise = noise or NoiseSettings()
    if form not in FORMS:
        raise InputError(f"there is no likelihood {form!r}: {nearest(form, FORMS)}")
    if not measured:
        raise InputError("there is no measured backbone: give at least one")
    modes = []
    for mode in sorted({one.mode for one in measured}):
        curves = [one for one in measured if one.mode == mode]
        cov = (noise.cov or {}).get(mode) or coefficient_of_variation(curves)
        modes.append(_mode_data(system, curves, noise, cov, form, n_nodes))
    if form != "recommended":
        for each in modes:
            if not each.cov > 0:
                raise InputError(
                    f"mode {each.mode} has one curve, which does not tell how lambda varies: give cov of the mode, or "
                    'take form = "recommended"'
                )
    return BackboneData(system, tuple(modes), form, tuple(int(h) for h in harmonics), noise)


def coefficient_of_variation(curves: Sequence[MeasuredBackbone]) -> float:
    """Return standard deviation over mean of lambda across curves, averaged over amplitudes (Song below eqs. 5, 12).

    Args:
        curves: of one mode; compared over the amplitude of a sensor that all have. nan for a single curve, or where
            the curves share no range of amplitude.
    """
    first = curves[0].controlled_sensor
    columns = [np.abs(one.amplitude[:, one.sensors.index(first)]) for one in curves if first in one.sensors]
    if len(columns) < max(2, len(curves)):
        return float("nan")
    low, high = max(column.min() for column in columns), min(column.max() for column in columns)
    if low >= high:
        return float("nan")
    levels = np.linspace(low, high, 20)
    order = [np.argsort(column) for column in columns]
    values = np.array(
        [np.interp(levels, c[k], one.eigenvalue[k]) for one, c, k in zip(curves, columns, order, strict=True)]
    )
    return float(np.mean(values.std(axis=0, ddof=1) / values.mean(axis=0)))


def _mode_data(
    system: JointedModes,
    curves: Sequence[MeasuredBackbone],
    noise: NoiseSettings,
    cov: float,
    form: Form,
    n_nodes: int,
) -> ModeData:
    mode = curves[0].mode
    linear = float(system.eigenvalue[system.place(mode)])
    if linear <= 0:
        raise InputError(f"mode {mode} has no stiffness (0 Hz): a backbone needs an elastic mode")
    sensors = [name for name in curves[0].sensors if all(name in one.sensors for one in curves)]
    if not sensors:
        raise InputError(f"the curves of mode {mode} have no sensor in common: give those that all of them measured")
    rows = np.array([system.sensor(name) for name in sensors])
    shapes = np.concatenate([one.amplitude[:, [one.sensors.index(name) for name in sensors]] for one in curves])
    shapes = shapes / np.linalg.norm(shapes, axis=1, keepdims=True)
    parts, blocks = [], []
    controlled = [one.controlled_sensor for one in curves]
    for sensor in dict.fromkeys(controlled):
        system.sensor(sensor)
        amplitude = [one.controlled_amplitude if one.controlled_sensor == sensor else np.zeros(0) for one in curves]
        nodes, block = _nodes(np.concatenate(amplitude), n_nodes)
        mine = np.repeat([name == sensor for name in controlled], [one.frequency_hz.size for one in curves])
        rows_of_all = np.zeros((mine.size, nodes.size))
        rows_of_all[mine] = block
        parts.append((sensor, nodes))
        blocks.append(rows_of_all)
    between = np.concatenate(blocks, axis=1)
    curve = np.repeat(np.arange(len(curves)), [one.frequency_hz.size for one in curves])
    eigenvalue = np.concatenate([one.eigenvalue for one in curves])
    growth = _growth(curves, eigenvalue / linear)
    models: tuple[CurveNoise | None, CurveNoise | None] = (None, None)
    if form == "recommended":
        models = _noise_models(noise, between, curve, growth, eigenvalue / linear, shapes)
    return ModeData(
        mode, tuple(parts), between, curve, eigenvalue, shapes, rows, linear, cov, *models
    )  # fmt: skip


def _growth(curves: Sequence[MeasuredBackbone], relative: FloatArray) -> FloatArray:
    """How far lambda has grown at each point: a cubic over the amplitude, without the noise of the points.

    With that noise in it, a slope of the error would take the noise up.
    """
    amplitude = np.concatenate([one.controlled_amplitude for one in curves])
    names = np.repeat([one.controlled_sensor for one in curves], [one.frequency_hz.size for one in curves])
    smooth = np.empty_like(relative)
    for name in np.unique(names):
        mine = names == name
        scaled = amplitude[mine] / amplitude[mine].max()
        powers = np.vander(scaled, 1 + min(3, max(1, scaled.size // 4)))
        smooth[mine] = powers @ np.linalg.lstsq(powers, relative[mine], rcond=None)[0]
    return smooth - smooth.min()


def _noise_models(
    noise: NoiseSettings,
    between: FloatArray,
    curve: IntArray,
    growth: FloatArray,
    relative: FloatArray,
    shapes: FloatArray,
) -> tuple[CurveNoise, CurveNoise | None]:
    frequency = curve_noise(
        relative[:, None],
        between,
        curve,
        growth,
        common_std=2 * noise.linear_error,
        common_growth=noise.linear_error_growth,
        own_growth=noise.curve_growth,
        offset=2 * noise.curve_offset,
        expected=2 * noise.point_noise,
    )
    if not noise.shapes or shapes.shape[1] < 2:
        return frequency, None
    shape = curve_noise(
        shapes,
        between,
        curve,
        growth,
        common_std=noise.linear_shape_error,
        common_growth=noise.linear_error_growth,
        own_growth=noise.curve_growth,
        offset=noise.shape_offset,
        expected=noise.shape_noise,
    )
    return frequency, shape


def _nodes(amplitude: FloatArray, n_nodes: int) -> tuple[FloatArray, FloatArray]:
    """Amplitudes to solve at, and what takes values there to `amplitude`: Chebyshev, or the amplitudes themselves."""
    unique, place = np.unique(amplitude, return_inverse=True)
    if unique.size <= n_nodes:
        return unique, np.eye(unique.size)[place]
    from scipy.interpolate import BarycentricInterpolator

    low, high = unique[0], unique[-1]
    nodes = (low + high) / 2 - (high - low) / 2 * np.cos(np.pi * np.arange(n_nodes) / (n_nodes - 1))
    return nodes, BarycentricInterpolator(nodes, np.eye(n_nodes))(amplitude)


Curves = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""theta (n, d) -> lambda (n, n_nodes), shapes of unit length (n, n_nodes, n_sensors), points that failed (n,)."""

Likelihood = Callable[[ArrayLike], tuple[FloatArray, int]]
"""theta (n, d) -> log p(D | theta) (n,), and how many points of the model did not converge."""


def curves_of(data: BackboneData, mode: ModeData, model_class: ModelClass) -> Curves:
    """Return theta -> the model of one mode at its nodes.

    Args:
        data: the backbones.
        mode: one entry of its modes.
        model_class: the law.
    """
    solvers = [
        family_evaluator(
            data.system, model_class.kinds, mode=mode.mode, sensor=sensor, amplitude=amplitude, harmonics=data.harmonics
        )
        for sensor, amplitude in mode.parts
    ]
    middle = mode.shapes.mean(axis=0)

    def curves(theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        found = [solve(model_class.coefficients(theta)) for solve in solvers]
        eigenvalue = np.concatenate([each.eigenvalue for each in found], axis=1)
        converged = np.concatenate([each.converged for each in found], axis=1)
        shapes = np.concatenate([each.shapes[..., mode.rows] for each in found], axis=1)
        eigenvalue = np.where(converged, eigenvalue, mode.linear)
        shapes = np.where(converged[..., None], shapes, 1.0)
        # the sign of a shape is that of the measured ones
        size = np.sqrt(np.einsum("nks,nks->nk", shapes, shapes)) * np.where(shapes @ middle < 0, -1.0, 1.0)
        return eigenvalue, shapes / size[..., None], (~converged).sum(axis=1)

    return curves


def likelihood_function(data: BackboneData, model_class: ModelClass) -> Likelihood:
    """Return theta (n, d) -> logarithm of p(D | theta), (n,), and how many points of the model did not converge.

    Every form carries its normalising constant (Song eq. 17; eq. 7 misprints it). A theta for which a point of the
    model did not converge has the logarithm -inf.

    Args:
        data: from `backbone_data`, which names the form.
        model_class: the law.
    """
    models = [(mode, curves_of(data, mode, model_class)) for mode in data.modes]

    def likelihood(theta: ArrayLike) -> tuple[FloatArray, int]:
        rows = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        total, failed = np.zeros(len(rows)), np.zeros(len(rows), dtype=int)
        for mode, curves in models:
            eigenvalue, shapes, missing = curves(rows)
            if data.form == "recommended":
                total += _recommended(mode, eigenvalue, shapes)
            else:
                total += _papers(data, mode, eigenvalue, shapes)
            failed += missing
        return np.where(failed > 0, -np.inf, total), int(failed.sum())

    return likelihood


def log_likelihood(data: BackboneData, model_class: ModelClass, theta: ArrayLike) -> FloatArray:
    """Return the logarithm of p(D | theta), (n,); see `likelihood_function`, which is quicker when called often.

    Args:
        data: from `backbone_data`.
        model_class: the law.
        theta: (n, n_parameters).
    """
    return likelihood_function(data, model_class)(theta)[0]


def _recommended(mode: ModeData, eigenvalue: FloatArray, shapes: FloatArray) -> FloatArray:
    if mode.frequency_noise is None:
        raise NotDeterminedError("the backbones were not prepared for the recommended form: call backbone_data with it")
    total = log_marginal(mode.frequency_noise, eigenvalue[..., None] / mode.linear)
    if mode.shape_noise is not None:
        total = total + log_marginal(mode.shape_noise, shapes)
    return total


def residuals(mode: ModeData, eigenvalue: FloatArray) -> FloatArray:
    """Return e_lambda of every point with r_m of its curve, (n, n_points) (Song eq. 10).

    Args:
        mode: its data.
        eigenvalue: (n, n_nodes) of the model.
    """
    first = np.unique(mode.curve, return_index=True)[1]
    r_m = (mode.linear - mode.eigenvalue[first])[mode.curve]
    return mode.eigenvalue - eigenvalue @ mode.between.T + r_m


def _papers(data: BackboneData, mode: ModeData, eigenvalue: FloatArray, shapes: FloatArray) -> FloatArray:
    """Eqs. (12) and (17) of one mode, with one of the three ways to add points up."""
    noise, n_sensors = data.noise, mode.rows.size
    sigma = noise.weight * mode.cov * mode.eigenvalue
    factor = noise.shape_factor if noise.shape_factor is not None else np.sqrt(n_sensors)
    sigma_phi = factor * noise.weight * mode.cov
    score = residuals(mode, eigenvalue) / sigma
    of_curve = np.eye(mode.curve[-1] + 1)[mode.curve]
    share = of_curve / (1.0 if data.form == "independent" else of_curve.sum(axis=0))
    misfit = ((score @ share) ** 2 if data.form == "literal" else score**2 @ share).sum(axis=1)
    n_errors, log_sigmas = sigma.size, np.log(sigma).sum()
    if noise.shapes and n_sensors > 1:
        misfit = misfit + (_one_less_mac(mode, shapes) @ share).sum(axis=1) / sigma_phi**2
        n_errors, log_sigmas = n_errors + mode.shapes.size, log_sigmas + mode.shapes.size * np.log(sigma_phi)
    return -0.5 * n_errors * np.log(2 * np.pi) - log_sigmas - 0.5 * misfit


def _one_less_mac(mode: ModeData, shapes: FloatArray) -> FloatArray:
    """e_phi^T e_phi of every point, which is 1 - MAC exactly (Song eq. 11)."""
    model = np.einsum("jk,nks->njs", mode.between, shapes, optimize=True)
    return 1 - np.einsum("njs,js->nj", model, mode.shapes) ** 2 / np.einsum("njs,njs->nj", model, model)
