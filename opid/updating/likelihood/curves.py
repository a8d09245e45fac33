"""The model of measured backbones at a few amplitudes, and the likelihood of the curves given a class and its theta.

The model's curves run smoothly past interactions of modes, and gaps in them are interpolated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import NotDeterminedError
from opid.mechanics.backbones.dissipation import PlacedTerm, find_loss
from opid.mechanics.backbones.family import (
    BackboneFamily,
    FamilyEvaluator,
    family_evaluator,
    join_families,
    take_samples,
)
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import (
    LEAST_APART,
    BackboneData,
    MetModes,
    ModeData,
    ShapeSet,
    find_met_modes,
)
from opid.updating.likelihood.noise import log_marginal, log_marginal_slopes
from opid.updating.model_class import ModelClass
from opid.updating.settings import UPDATING

MOST_NAMED = 4  # largest number of points that a sentence names
LOSS_STEP = 1e-4  # relative step of the differences of losses: its square and what the solver leaves are far below 1e-4
LEAST_THETA = 1e-2  # theta below which that step shrinks no more: scales make theta about 1

BoolArray = NDArray[np.bool_]

Likelihood = Callable[[ArrayLike], tuple[FloatArray, int]]
"""theta (n, d) -> log p(D | theta) (n,), and the number of points of the model that did not converge."""

LikelihoodSlopes = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""theta (n, d) -> log p(D | theta) (n,), and its derivatives (n, d), 0 where the logarithm is -inf."""


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
        losses = []
        for mode, curves in models:
            found = curves.solve(rows)
            eigenvalue, shapes, missing, lost = curves.complete(found)
            if data.force is not None:
                losses.append(curves.find_losses(rows, found))
            if data.form == "recommended":
                total += weigh_as_recommended(mode, eigenvalue, shapes)
            else:
                total += _weigh_as_in_paper(data, mode, eigenvalue, shapes)
            impossible |= lost
            failed += int(missing.sum())
        if data.force is not None:
            lost_energy = np.concatenate(losses, axis=1)
            impossible |= np.isnan(lost_energy).any(axis=1)
            total += log_marginal(data.force.noise, np.nan_to_num(lost_energy)[..., None])
        return np.where(impossible, -np.inf, total), failed

    return likelihood


def slopes_function(data: BackboneData, model_class: ModelClass) -> LikelihoodSlopes:
    """Return theta (n, d) -> log p(D | theta), (n,), as `likelihood_function` does, and its derivatives, (n, d).

    The derivatives follow by the chain rule from those of the backbones, by implicit differentiation, those of the
    force, by differences, and those of the noise model of the recommended form; the others have none.

    Args:
        data: the backbones, from `backbone_data`, in the recommended form.
        model_class: the law.
    """
    models = [(mode, make_curves(data, mode, model_class)) for mode in data.modes]

    def slopes(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        total, gradient, impossible = np.zeros(len(theta)), np.zeros(theta.shape), np.zeros(len(theta), dtype=bool)
        losses = []
        for mode, curves in models:
            if data.force is not None:
                losses.append(curves.find_loss_slopes(theta))
            (eigenvalue, shapes, _, lost), by_value, by_shape = curves.find_slopes(theta)
            assert mode.frequency_noise is not None  # The recommended form has noise models.
            value, of_nodes = log_marginal_slopes(mode.frequency_noise, eigenvalue[..., None] / mode.linear)
            total += value
            gradient += np.einsum("nk,nkd->nd", of_nodes[..., 0], by_value) / mode.linear
            for each in mode.shape_sets:
                if each.noise is not None:
                    value, of_nodes = log_marginal_slopes(each.noise, each.take(shapes)[..., each.free])
                    total += value
                    gradient += np.einsum("nks,nksd->nd", of_nodes, _take_slopes(each, shapes, by_shape))
            impossible |= lost
        if data.force is not None:
            lost_energy, by_theta = (np.concatenate(each, axis=1) for each in zip(*losses, strict=True))
            impossible |= np.isnan(lost_energy).any(axis=1)
            value, of_nodes = log_marginal_slopes(data.force.noise, np.nan_to_num(lost_energy)[..., None])
            total += value
            gradient += np.einsum("nk,nkd->nd", of_nodes[..., 0], by_theta)
        impossible |= ~np.isfinite(gradient).all(axis=1)
        return np.where(impossible, -np.inf, total), np.where(impossible[:, None], 0.0, gradient)

    return slopes


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
    for each in mode.shape_sets:
        if each.noise is not None:
            total = total + log_marginal(each.noise, each.take(shapes)[..., each.free])
    return total


def _take_slopes(each: ShapeSet, shapes: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the derivatives, (..., n_free, d), of the free entries that a set sees of unit shapes."""
    if not each.is_all:
        slopes = normalise_slopes(each.take(shapes), slopes[..., each.columns, :] / each.find_length(shapes)[..., None])
    return slopes[..., each.free, :]


def residuals(mode: ModeData, eigenvalue: FloatArray) -> FloatArray:
    """Return e_lambda of every point, with the r_m of its curve (Song eq. 10): (n, n_nodes) -> (n, n_points)."""
    first = np.unique(mode.curve, return_index=True)[1]
    r_m = (mode.linear - mode.eigenvalue[first])[mode.curve]
    return mode.eigenvalue - eigenvalue @ mode.between.T + r_m


def _weigh_as_in_paper(data: BackboneData, mode: ModeData, eigenvalue: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return the log likelihood of one mode by eqs. (12) and (17), with one of three sums over points."""
    noise, weight_of_mode = data.noise, data.noise.weight_of(mode.mode)
    sigma = weight_of_mode * mode.cov * mode.eigenvalue
    n_sensors = mode.seen.sum(axis=1)
    factor = noise.shape_factor if noise.shape_factor is not None else np.sqrt(n_sensors)
    sigma_phi = np.broadcast_to(factor * weight_of_mode * mode.cov, sigma.shape)
    score = residuals(mode, eigenvalue) / sigma
    of_curve = np.eye(mode.curve[-1] + 1)[mode.curve]
    weight = of_curve / (1.0 if data.form == "independent" else of_curve.sum(axis=0))
    misfit = ((score @ weight) ** 2 if data.form == "literal" else score**2 @ weight).sum(axis=1)
    n_errors, log_sigmas = sigma.size, np.log(sigma).sum()
    if noise.shapes and n_sensors.max() > 1:
        misfit = misfit + (_find_shape_misfit(mode, shapes) / sigma_phi**2 @ weight).sum(axis=1)
        # The unit length fixes one entry of a shape.
        n_free = n_sensors - 1
        n_errors, log_sigmas = n_errors + n_free.sum(), log_sigmas + n_free @ np.log(sigma_phi)
    return -0.5 * n_errors * np.log(2 * np.pi) - log_sigmas - 0.5 * misfit


def _find_shape_misfit(mode: ModeData, shapes: FloatArray) -> FloatArray:
    """Return e_phi^T e_phi of every point, which is exactly 1 - MAC (Song eq. 11)."""
    model = np.einsum("jk,nks->njs", mode.between, shapes, optimize=True)
    model = np.where(mode.seen, model, 0.0)
    return 1 - np.einsum("njs,js->nj", model, mode.shapes) ** 2 / np.einsum("njs,njs->nj", model, model)


# ---- the model's curves ----------------------------------------------------------------------------


Curves = tuple[FloatArray, FloatArray, BoolArray, BoolArray]
"""lambda (n, n_nodes), shapes of unit length (n, n_nodes, n_sensors), nodes without a solution (n, n_nodes), and
whether a theta has no curve (n,) because too many nodes are missing."""


def make_curves(data: BackboneData, mode: ModeData, model_class: ModelClass) -> ModeCurves:
    """Return theta -> the model of one mode at its nodes.

    A point where Newton's method fails, as in an interaction with another mode, is interpolated by a polynomial through
    the others, so that the remainder of the curve still counts. There is no curve where too many points fail, or where
    the others span too little of the range (`UpdatingThresholds`). The curve has no loops where a harmonic meets
    another mode (`MetModes`), for one node on a loop would bend the whole polynomial.
    """
    solvers = tuple(make_solver(data, model_class, mode, sensor, amplitude) for sensor, amplitude in mode.parts)
    return ModeCurves(mode, solvers)


@dataclass(frozen=True, eq=False)
class ModeCurves:
    """theta (n, d) -> the model of one mode at its nodes, see `make_curves`."""

    mode: ModeData
    solvers: tuple[ClassSolver, ...]  # one for each controlled sensor

    def __call__(self, theta: FloatArray) -> Curves:
        """Return the curves for each row of theta."""
        return self.complete(self.solve(theta))

    def solve(self, theta: FloatArray) -> list[BackboneFamily]:
        """Return the backbones at the nodes of each controlled sensor, which may have gaps."""
        return [solve(theta) for solve in self.solvers]

    def complete(self, found: list[BackboneFamily]) -> Curves:
        """Return the curves of backbones that were found, with their gaps bridged."""
        return self._complete(found, [_join(each.eigenvalue, each.shapes[..., self.mode.rows]) for each in found])[0]

    def find_losses(self, theta: FloatArray, found: list[BackboneFamily]) -> FloatArray:
        """Return the logarithm of the work of the force over pi A^2, N/m, at all nodes, (n, n_nodes).

        A is the amplitude of the controlled sensor. It is nan where dampers feed energy in, and along a curve that
        cannot be bridged.
        """
        parts = []
        for solve, each in zip(self.solvers, found, strict=True):
            stiffness = solve.find_loss(theta, each)[0] / (np.pi * each.amplitude**2)
            values = np.log(np.where(stiffness > 0, stiffness, np.nan))
            for row in np.flatnonzero(~each.converged.all(axis=1)):
                bridged = _bridge_gaps(values[row][:, None], each.amplitude, each.converged[row])
                values[row] = np.nan if bridged is None else bridged[:, 0]
            parts.append(values)
        return np.concatenate(parts, axis=1)

    def find_loss_slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the logarithms of `find_losses`, (n, n_nodes), and their derivatives by theta, (n, n_nodes, d).

        These are central differences. Dampers and damping ratios leave the backbones as they are, which are solved anew
        only for springs and factors of the stiffness.
        """
        model_class, (n, d) = self.solvers[0].model_class, theta.shape
        steps = LOSS_STEP * np.maximum(np.abs(theta), LEAST_THETA)
        # All rows are solved in one call: those of theta, then up and down by the step of each parameter.
        moved = theta + np.concatenate([np.zeros((1, 1, d)), *np.eye(d)[:, None, None] * [[[1.0]], [[-1.0]]]]) * steps
        idle = np.zeros(d, dtype=bool)
        idle[model_class.n_spring_parameters : model_class.n_parameters - len(model_class.factors)] = True
        solved = np.append(True, np.repeat(~idle, 2))
        place = np.where(solved, np.cumsum(solved) - 1, 0)
        rows = np.concatenate([at * n + np.arange(n) for at in place])
        found = [take_samples(each, rows) for each in self.solve(moved[solved].reshape(-1, d))]
        losses = self.find_losses(moved.reshape(-1, d), found).reshape(1 + 2 * d, n, -1)
        slopes = (losses[1::2] - losses[2::2]) / (2.0 * steps.T[..., np.newaxis])
        return losses[0], np.moveaxis(slopes, 0, -1)

    def find_slopes(self, theta: FloatArray) -> tuple[Curves, FloatArray, FloatArray]:
        """Return the curves, and their derivatives (n, n_nodes, d) and (n, n_nodes, n_sensors, d) by theta."""
        found, slopes = [], []
        for solve in self.solvers:
            family, by_value, by_shape = solve.find_slopes(theta)
            found.append(family)
            slopes.append(_join(by_value, by_shape[:, :, self.mode.rows]))
        values = [_join(each.eigenvalue, each.shapes[..., self.mode.rows]) for each in found]
        curves, length = self._complete(found, values)
        for each, slope in zip(found, slopes, strict=True):
            for row in np.flatnonzero(~each.converged.all(axis=1)):
                # What bridges a gap is linear in the values beside it.
                flat = slope[row].reshape(len(each.amplitude), -1)
                bridged = _bridge_gaps(flat, each.amplitude, each.converged[row])
                slope[row] = 0.0 if bridged is None else bridged.reshape(slope[row].shape)
        moved = np.concatenate(slopes, axis=1)
        return curves, moved[:, :, 0], normalise_slopes(curves[1], moved[:, :, 1:] / length[..., None, None])

    def _complete(self, found: list[BackboneFamily], parts: list[FloatArray]) -> tuple[Curves, FloatArray]:
        """Return the curves without gaps, and what divides their shapes, (n, n_nodes), negative where they turn."""
        middle = self.mode.shapes.mean(axis=0)
        lost = np.zeros(len(parts[0]), dtype=bool)
        for each, values in zip(found, parts, strict=True):
            for row in np.flatnonzero(~each.converged.all(axis=1)):
                bridged = _bridge_gaps(values[row], each.amplitude, each.converged[row])
                lost[row] |= bridged is None
                # A curve that is lost may hold any finite numbers.
                values[row] = np.append(self.mode.linear, middle) if bridged is None else bridged
        values = np.concatenate(parts, axis=1)
        shapes = values[..., 1:]
        # The shapes get the sign of the measured ones.
        length = np.sqrt(np.einsum("nks,nks->nk", shapes, shapes)) * np.where(shapes @ middle < 0, -1.0, 1.0)
        missing = ~np.concatenate([each.converged for each in found], axis=1)
        return (values[..., 0], shapes / length[..., None], missing, lost), length


def _join(values: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return one array (n, n_nodes, 1 + n_sensors, ...) of (n, n_nodes, ...) and (n, n_nodes, n_sensors, ...)."""
    return np.concatenate([values[:, :, np.newaxis], shapes], axis=2)


def normalise_slopes(unit: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the derivatives, (..., n_sensors, d), of shapes that keep unit length.

    Args:
        unit: (..., n_sensors) shapes of unit length.
        slopes: (..., n_sensors, d) derivatives of the motion over its length.
    """
    shapes = unit[..., None]
    return np.asarray(slopes - shapes * np.sum(shapes * slopes, axis=-2, keepdims=True))


@dataclass(frozen=True, eq=False)
class ClassSolver:
    """theta (n, n_parameters) -> the backbones of one mode with the parameters of a class.

    Where factors of the stiffness are among these, each row has a linear structure of its own.
    """

    model_class: ModelClass
    evaluate: FamilyEvaluator
    data: BackboneData
    met: MetModes  # what is left out of the structure

    def __call__(self, theta: FloatArray) -> BackboneFamily:
        """Return the backbones for each row of theta."""
        coefficients = self._find_spring_coefficients(theta)
        if self.data.structure is None:
            return self.evaluate(coefficients)
        families = []
        for factors, row in zip(self._split_off_factors(theta), coefficients, strict=True):
            placed = self._place(factors)
            families.append(self.evaluate.without_solution() if placed is None else placed[0](row[np.newaxis]))
        return join_families(families)

    def find_loss(self, theta: FloatArray, found: BackboneFamily) -> tuple[FloatArray, FloatArray]:
        """Return what the structure loses in a cycle of backbones that were found, and its kinetic energy, J.

        Both have the shape (n, n_points).
        """
        springs, dampers = self.place_terms(theta)
        ratio = self.find_ratio(theta)
        if self.data.structure is None:
            return find_loss(found, self.evaluate.system, springs, dampers, ratio)
        rows: list[tuple[FloatArray, FloatArray]] = []
        for row, factors in enumerate(self._split_off_factors(theta)):
            placed, one = self._place(factors), [row]
            if placed is None:
                rows.append((np.full((1, found.amplitude.size), np.nan),) * 2)
                continue
            of_row = [[replace(term, values=term.values[one]) for term in terms] for terms in (springs, dampers)]
            rows.append(find_loss(take_samples(found, one), placed[0].system, of_row[0], of_row[1], ratio[one]))
        lost, energy = zip(*rows, strict=True)
        return np.concatenate(lost), np.concatenate(energy)

    def place_terms(self, theta: FloatArray) -> tuple[list[PlacedTerm], list[PlacedTerm]]:
        """Return springs and dampers with their parameters, for each row of theta."""
        values, first = self.model_class.coefficients(theta), 0
        placed = []
        for term in self.model_class.terms:
            last = first + len(term.scales)
            is_there = np.array([term.acts_at(joint) for joint in self.evaluate.system.joints])
            placed.append(PlacedTerm(term.kind, values[:, first:last], is_there))
            first = last
        n_springs = len(self.model_class.springs)
        return placed[:n_springs], placed[n_springs:]

    def find_ratio(self, theta: FloatArray) -> FloatArray:
        """Return the damping ratio of the modes for each row of theta, (n,)."""
        mode, first = self.evaluate.mode, len(self.model_class.law_parameters)
        for number, each in enumerate(self.model_class.ratios, start=first):
            if each.mode == mode:
                return theta[:, number]
        assert self.data.force is not None
        # The losses of a mode without a force are compared with nothing.
        return np.full(len(theta), self.data.force.known_ratios.get(mode, 1.0))

    def find_slopes(
        self, theta: FloatArray, couplings: FloatArray | None = None
    ) -> tuple[BackboneFamily, FloatArray, FloatArray]:
        """Return the backbones and their derivatives, see `FamilyEvaluator.find_slopes`.

        These are (n, n_points, n_parameters) and (n, n_points, n_sensors, n_parameters), by theta and then by the
        linear parameters of `couplings`.
        """
        if self.data.structure is None:
            return self._find_slopes(self.evaluate, theta, couplings)
        parts: list[tuple[BackboneFamily, FloatArray, FloatArray]] = []
        for row, factors in zip(theta, self._split_off_factors(theta), strict=True):
            placed, extra = self._place(factors), () if couplings is None else couplings
            if placed is None:
                nothing = self.evaluate.without_solution()
                lost = np.full((*nothing.shapes.shape, row.size + len(extra)), np.nan)
                found = nothing, lost[:, :, 0], lost
            else:
                every = np.concatenate([placed[1], *([] if couplings is None else [couplings])])
                found = self._find_slopes(placed[0], row[np.newaxis], every)
            parts.append(found)
        families, by_value, by_shape = zip(*parts, strict=True)
        return join_families(families), np.concatenate(by_value), np.concatenate(by_shape)

    def _find_slopes(
        self, evaluate: FamilyEvaluator, theta: FloatArray, couplings: FloatArray | None
    ) -> tuple[BackboneFamily, FloatArray, FloatArray]:
        coefficients, n_linear = self._find_spring_coefficients(theta), 0 if couplings is None else len(couplings)
        found = evaluate(coefficients)
        slopes = evaluate.find_slopes(coefficients, found, () if couplings is None else couplings)
        n_coefficients, n_springs = coefficients.shape[1], self.model_class.n_spring_parameters
        kept = np.append(self.model_class.is_unknown[:n_coefficients], np.ones(n_linear, dtype=bool))
        scales = np.append(self.model_class.scales[:n_springs], np.ones(n_linear))
        # Dampers and damping ratios move no backbone.
        idle = np.zeros(self.model_class.n_parameters - n_springs - len(self.model_class.factors))
        by_value, by_shape = (
            np.insert(each[..., kept] * scales, [n_springs] * idle.size, 0.0, axis=-1) for each in slopes
        )
        return found, by_value, by_shape

    def _find_spring_coefficients(self, theta: FloatArray) -> FloatArray:
        n_columns = sum(len(each.scales) for each in self.model_class.springs)
        return self.model_class.coefficients(theta)[:, :n_columns]

    def _split_off_factors(self, theta: FloatArray) -> FloatArray:
        return theta[:, theta.shape[1] - len(self.model_class.factors) :]

    def _place(self, factors: FloatArray) -> tuple[FamilyEvaluator, FloatArray] | None:
        """Return the evaluator of the structure with these factors, and what each of them couples.

        None where the factors are so far off that other modes are met than those that were left out.
        """
        assert self.data.structure is not None
        system, couplings = self.data.structure.at(factors)
        if self.met.columns.size and system.eigenvalue[self.met.columns].min() < LEAST_APART * self.met.middle:
            return None
        turned = self.met.scale_of(system)
        couplings = couplings * turned[:, np.newaxis] * turned
        return self.evaluate.with_system(self.met.remove_from(system)), couplings


def make_solver(
    data: BackboneData,
    model_class: ModelClass,
    mode: ModeData | int,
    sensor: str,
    amplitude: FloatArray,
    *,
    is_whole: bool = False,
) -> ClassSolver:
    """Return the solver of a mode at amplitudes of a sensor, with the parameters of a class.

    Args:
        data: the backbones with the linear structure.
        model_class: the class.
        mode: the curves of the mode, or the number of a mode without curves.
        sensor: name of the sensor whose amplitude is prescribed.
        amplitude: (n,) amplitudes, m.
        is_whole: whether the modes stay that a harmonic meets; without curves they do.
    """
    number = mode if isinstance(mode, int) else mode.mode
    met = MetModes(np.empty(0, dtype=np.int64), 0.0)
    if not (is_whole or isinstance(mode, int)):
        met = find_met_modes(data, mode)
    evaluate = family_evaluator(
        met.remove_from(data.system), model_class.kinds, mode=number, sensor=sensor, amplitude=amplitude,
        harmonics=data.harmonics, joints=model_class.joints,
    )  # fmt: skip
    return ClassSolver(model_class, evaluate, data, met)


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
    return f"{describe_span(amplitude[chosen])} mm of sensor {sensor!r} ({points})"


def describe_span(amplitude: FloatArray) -> str:
    """Return the smallest and the largest amplitude in mm."""
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
