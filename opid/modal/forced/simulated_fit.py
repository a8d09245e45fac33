"""Fit the laws of one mode, or of several that drive each other, by simulating the tests.

The equation of motion is linear in powers (`restoring_fit`), but it needs the motion at every moment. Friction and slip
have a memory, and modes that drive each other also move where no accelerometer shows it: a product q_i^2 q_j shifts the
mean of mode j, which shifts its frequency. A simulation has all of that. So the measured modal forces of the tests
drive the model, and its modal accelerations are fitted to the measured ones, on the lines of the bands of the modes, by
nonlinear least squares (an output-error fit; Ljung 1999, System Identification, section 4.3).

Every line of a mode and test is divided by the rms of what that fit leaves there. The intervals hold what noise
leaves, with correlated neighbouring lines, and what changes when a test is left out: a law that is wrong at some level
shows there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.structure import ComplexArray
from opid.modal.forced.mode_fit import ForceCurve, ModeFit, warn_of_fit
from opid.modal.forced.restoring_fit import linearised, sum_lagged_products
from opid.modal.forced.system import ModeTerms, OwnValues, System, SystemForm, SystemValues
from opid.modal.joint_terms import ABSENT, JointEstimates
from opid.modal.power_laws import read_linear
from opid.modal.settings import MODAL, SIMULATED
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a search ended.

    Args:
        vector: (p,) the coefficients in the units of the system.
        left: lines of the measured less the simulated accelerations, of each test and mode.
        jacobian: derivatives of `left` by the coefficients, (n_lines, p) each.
        is_converged: whether the search came to an end.
    """

    vector: FloatArray
    left: list[list[ComplexArray]]
    jacobian: list[list[ComplexArray]]
    is_converged: bool


@dataclass(frozen=True, eq=False)
class FittedForm:
    """A form of the law with its coefficients, and what it leaves of the tests.

    Args:
        form: the terms.
        values: their coefficients, in SI.
        covariance: covariance of `values`, flattened.
        vector_std: (p,) standard deviations of the coefficients in the units of the system.
        errors: (n_folds,) misfit of what was left out in turn, over the motion (rms of the modes).
        missed: misfit over the motion, rms over all tests, of each mode.
        minimum: where the search ended.
    """

    form: SystemForm
    values: SystemValues
    covariance: FloatArray
    vector_std: FloatArray
    errors: FloatArray
    missed: FloatArray
    minimum: Minimum

    @property
    def vector(self) -> FloatArray:
        """(p,) the coefficients in the units of the system."""
        return self.minimum.vector

    @property
    def score(self) -> float:
        """Minus twice the logarithm of the likelihood; the noise of each test and mode is the rms of what is left."""
        left = [each for row in self.minimum.left for each in row]
        return sum(2.0 * each.size * float(np.log(np.mean(np.abs(each) ** 2))) for each in left)

    def find_excess(self, system: System) -> float:
        """Return the misfit of all tests together over that by the noise of their accelerations and forces.

        So tests with the largest motion count most: one that hardly moves shows how friction sticks, which no law has.
        """
        missed = sum(float(np.sum(np.abs(own) ** 2)) for row in self.minimum.left for own in row)
        by_noise = sum(
            lines.size * (noise**2 + moved**2)
            for test in system.tests
            for lines, noise, moved in zip(test.lines, test.noise, test.moved, strict=True)
        )
        return float(np.sqrt(missed / max(by_noise, 1e-300)))

    @property
    def std(self) -> FloatArray:
        """Standard deviations of `values`, flattened."""
        return np.sqrt(np.diag(self.covariance))


def fit_form(system: System, form: SystemForm, start: FloatArray, *, is_near: bool = False) -> FittedForm:
    """Fit the coefficients of a form to all tests, from a start, well enough to compare it with other forms.

    A form whose start is not near the end is first fitted to the quieter half of the tests, where nonlinear terms are
    small.

    Raises:
        InputError: the start cannot be simulated.
    """
    loudness = [float(np.sum(np.abs(test.measured[0]) ** 2)) for test in system.tests]
    quiet = sorted(range(len(loudness)), key=lambda index: loudness[index])[: max(2, len(loudness) // 2)]
    if len(loudness) > 2 and not is_near:
        few = replace(system, tests=tuple(system.tests[index] for index in quiet))
        start = _minimise(few, form, start, _first_weights(few)).vector
    found = _minimise(system, form, start, _first_weights(system))
    return _describe(system, form, found, _weights_of(system, found))


def refine_form(system: System, rough: FittedForm) -> FittedForm:
    """Fit the coefficients of a form to convergence, with the weights that follow from its misfit."""
    found = rough.minimum
    for _ in range(2):
        found = _minimise(system, rough.form, found.vector, _weights_of(system, found), is_last=True)
    return _describe(system, rough.form, found, _weights_of(system, found))


def fit_force(system: System, found: FittedForm) -> tuple[Estimate, Estimate]:
    """Return the modal mass of the mode under test that the tests show beside a law, and the delay of its motion, s.

    They are the factor by which the forces are too large for the motion, and the time by which the accelerations come
    after them, to the first order (see `fit_modal_mass` and `fit_delay`). A rough standard deviation is enough, so what
    the law leaves is taken as white; that of the delay is at least what the answers without each test show (jackknife).
    With fewer than three tests no delay is stated.
    """
    step, late_s, weights = 1e-3, 1e-3 / float(np.sqrt(system.modes.stiffness()[0])), _weights_of(system, found.minimum)
    scaled = replace(system, tests=tuple(replace(each, forces=each.forces / (1.0 + step)) for each in system.tests))
    more = [(_subtract(scaled, found.form, found.vector), step)]
    if len(system.tests) > 2:
        more += [(_subtract(system.delay_forces(late_s), found.form, found.vector), late_s)]
    left = [_as_real(row, own) for row, own in zip(found.minimum.left, weights, strict=True)]
    slopes = [_as_real(row, own) for row, own in zip(found.minimum.jacobian, weights, strict=True)]
    moved = [
        np.stack([(_as_real(rows[at], own) - left[at]) / by for rows, by in more], axis=1)
        for at, own in enumerate(weights)
    ]
    columns = [np.column_stack(both) for both in zip(slopes, moved, strict=True)]
    (off, *late), (off_std, *late_std) = _solve_steps(columns, left, len(more))
    if not late:
        return Estimate.normal(1.0 + off, off_std), Estimate()
    without = [
        _solve_steps(columns[:at] + columns[at + 1 :], left[:at] + left[at + 1 :], len(more))[0][-1]
        for at in range(len(left))
    ]
    delay_std = max(float(late_std[0]), float(np.sqrt((len(left) - 1) * np.var(without))))
    return Estimate.normal(1.0 + off, off_std), Estimate.normal(late[0], delay_std)


def _solve_steps(columns: Sequence[FloatArray], left: Sequence[FloatArray], n: int) -> tuple[list[float], list[float]]:
    """Return the last n of the steps that make up for what is left, and their standard deviations by white errors."""
    matrix, errors = np.concatenate(columns), np.concatenate(left)
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    inverse = np.linalg.pinv(matrix / scale)
    step = -inverse @ errors
    rms = float(np.sqrt(np.mean((errors + matrix / scale @ step) ** 2)))
    std = rms * np.linalg.norm(inverse, axis=1) / scale
    return (step / scale)[-n:].tolist(), std[-n:].tolist()


Weights = list[list[float]]
"""Standard deviation of a line (complex), of each test and mode."""


def find_misfit(system: System, form: SystemForm, vector: FloatArray) -> float:
    """Return the misfit of a form over the motion, rms over tests and modes; infinite where it is unbounded."""
    try:
        left = _subtract(system, form, vector)
    except InputError:
        return np.inf
    ratios = [
        float(np.linalg.norm(each) / np.linalg.norm(own))
        for row, test in zip(left, system.tests, strict=True)
        for each, own in zip(row, test.measured, strict=True)
    ]
    return float(np.sqrt(np.mean(np.square(ratios))))


def _first_weights(system: System) -> Weights:
    return [[0.01 * float(np.sqrt(np.mean(np.abs(own) ** 2))) for own in test.measured] for test in system.tests]


def _weights_of(system: System, found: Minimum) -> Weights:
    return [
        [max(float(np.sqrt(np.mean(np.abs(own) ** 2))), noise) for own, noise in zip(left, test.noise, strict=True)]
        for left, test in zip(found.left, system.tests, strict=True)
    ]


def _minimise(
    system: System, form: SystemForm, start: FloatArray, weights: Weights, *, is_last: bool = False
) -> Minimum:
    """Return the least squares over the weights, by scipy's trust region within the bounds of the form."""
    from scipy.optimize import least_squares

    worst = np.concatenate([_as_real([own], [w]) for t, row in zip(system.tests, weights, strict=True)
                            for own, w in zip(t.measured, row, strict=True)])  # fmt: skip

    def find_errors(vector: FloatArray) -> FloatArray:
        try:
            left = _subtract(system, form, vector)
        except InputError:  # It grows without bound or has lost its stiffness: farther off than no motion at all.
            return SIMULATED.unbounded * worst
        return np.concatenate([_as_real(each, row) for each, row in zip(left, weights, strict=True)])

    low, high = find_bounds(form)
    start = np.clip(start, low + 1e-9, high - 1e-9)
    found = least_squares(
        find_errors,
        start,
        bounds=(low, high),
        x_scale=np.maximum(np.abs(start), SIMULATED.least_size),
        max_nfev=SIMULATED.most_steps if is_last else SIMULATED.first_steps,
        ftol=SIMULATED.converged if is_last else SIMULATED.first_converged,
        xtol=SIMULATED.converged if is_last else SIMULATED.first_converged,
    )
    left = _subtract(system, form, found.x)
    return Minimum(found.x, left, _split_jacobian(system, found.jac, weights), found.status > 0)


def find_bounds(form: SystemForm) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest vector of a form: friction and slip take energy out, exponents have a range."""
    low, high = np.full(form.size, -np.inf), np.full(form.size, np.inf)
    first = 0
    for terms in form.own.values():
        first += len(terms.powers.k) + len(terms.powers.c)
        if terms.has_friction:
            low[first] = 0.0
            first += 1
        ranges = terms.memory.ranges if terms.memory else ()
        for low[first], high[first] in ranges:
            first += 1
    return low, high


def _subtract(system: System, form: SystemForm, vector: FloatArray) -> list[list[ComplexArray]]:
    values = system.convert(form, vector)
    model = system.make_model(values)
    scales = [values.scales.get(number, 1.0) for number in system.numbers]
    with ThreadPoolExecutor() as pool:
        simulated = list(pool.map(lambda test: test.simulate(model), system.tests))
    return [
        [own - scale * each for own, scale, each in zip(test.measured, scales, lines, strict=True)]
        for test, lines in zip(system.tests, simulated, strict=True)
    ]


def _as_real(parts: Sequence[ComplexArray], weights: Sequence[float]) -> FloatArray:
    whole = np.concatenate([part / weight for part, weight in zip(parts, weights, strict=True)])
    return np.concatenate([whole.real, whole.imag])


def _split_jacobian(system: System, jacobian: FloatArray, weights: Weights) -> list[list[ComplexArray]]:
    """Return the derivatives of each test and mode, without weights, from those of the stacked real errors."""
    found, first = [], 0
    for test, row in zip(system.tests, weights, strict=True):
        sizes = [lines.size for lines in test.lines]
        n = sum(sizes)
        both: ComplexArray = jacobian[first : first + n] + 1j * jacobian[first + n : first + 2 * n]
        first += 2 * n
        ends = np.cumsum(sizes)
        parts = [both[end - size : end] for end, size in zip(ends, sizes, strict=True)]
        found.append([np.asarray(w * part, dtype=np.complex128) for part, w in zip(parts, row, strict=True)])
    return found


def _describe(system: System, form: SystemForm, found: Minimum, weights: Weights) -> FittedForm:
    """Return the fit with the covariance of its values, and its errors where parts of the tests are left out."""
    parts = [
        (each / w, of_each / w)
        for left, jacobian, row in zip(found.left, found.jacobian, weights, strict=True)
        for each, of_each, w in zip(left, jacobian, row, strict=True)
    ]
    n_modes = len(system.numbers)
    size = [[float(np.linalg.norm(own)) for own in test.measured] for test in system.tests]
    curvature = [(of_each.conj().T @ of_each).real for _, of_each in parts]
    total = sum(curvature, np.zeros((form.size, form.size)))
    inverse = np.linalg.pinv(total, hermitian=True)
    meat = np.zeros_like(total)
    for index, (left, of_left) in enumerate(parts):
        reach = system.tests[index // n_modes].reach
        meat += sum_lagged_products((of_left.conj() * left[:, None]).real, reach)
    moved, errors = [], []
    for fold in _make_folds(system):
        kept = [np.ones(left.size, dtype=bool) for left, _ in parts]
        for index, out in fold.items():
            kept[index] = ~out
        less = sum(
            ((of_left[own].conj().T @ of_left[own]).real for (_, of_left), own in zip(parts, kept, strict=True)),
            np.zeros_like(total),
        )
        score = sum(
            ((of_left[own].conj().T @ left[own]).real for (left, of_left), own in zip(parts, kept, strict=True)),
            np.zeros(form.size),
        )
        # A step of Gauss and Newton on what is kept shows the coefficients without what is left out.
        step = -np.linalg.pinv(less, hermitian=True) @ score
        moved.append(step)
        squares = []
        for index, out in fold.items():
            left, of_left = parts[index]
            whole = size[index // n_modes][index % n_modes] * np.sqrt(out.mean())
            weight = weights[index // n_modes][index % n_modes]
            squares.append(np.sum(np.abs(weight * (left[out] + of_left[out] @ step)) ** 2) / max(whole, 1e-300) ** 2)
        errors.append(float(np.sqrt(np.mean(squares))))
    by_noise = inverse @ meat @ inverse
    steps = np.array(moved) - np.mean(moved, axis=0)
    n = len(steps)
    by_part = (n - 1) / n * steps.T @ steps
    values = system.convert(form, found.vector)
    slopes = differentiate(lambda vector: system.convert(form, vector).flatten(), found.vector)
    n_values = len(slopes)
    slopes = np.vstack([slopes, np.eye(form.size)])
    spread = [np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, each, slopes), 0.0)) for each in (by_noise, by_part)]
    std = np.maximum(spread[0], spread[1] * float(stats.t.ppf(0.975, n - 1)) / 1.96)
    missed = [
        float(np.sqrt(sum(np.sum(np.abs(left[index]) ** 2) for left in found.left) / sum(s[index] ** 2 for s in size)))
        for index in range(n_modes)
    ]
    folds = _choose_folds(system, np.array(errors))
    scale, of_values = (std / np.maximum(spread[0], 1e-100))[:n_values], slopes[:n_values]
    covariance = np.einsum("ij,jk,lk->il", of_values, by_noise, of_values) * np.outer(scale, scale)
    return FittedForm(form, values, covariance, std[n_values:], folds, np.array(missed), found)


def _make_folds(system: System) -> list[dict[int, NDArray[np.bool_]]]:
    """Return what is left out in turn, as masks of lines by the index of test and mode.

    That is each test, or interleaved blocks of lines where there are fewer than three tests.
    """
    n_modes, n_tests = len(system.numbers), len(system.tests)
    sizes = [lines.size for test in system.tests for lines in test.lines]
    if n_tests >= 3:
        return [
            {n_modes * test + mode: np.ones(sizes[n_modes * test + mode], dtype=bool) for mode in range(n_modes)}
            for test in range(n_tests)
        ]
    return [
        {index: np.arange(size) // 3 % MODAL.n_blocks == block for index, size in enumerate(sizes)}
        for block in range(MODAL.n_blocks)
    ]


def _choose_folds(system: System, errors: FloatArray) -> FloatArray:
    """Return the errors that count: not that of the test with the largest motion, to which laws are extrapolated."""
    if len(system.tests) < 3:
        return errors
    loudest = int(np.argmax([float(np.sum(np.abs(test.measured[0]) ** 2)) for test in system.tests]))
    return np.delete(errors, loudest)


def differentiate(function: Callable[[FloatArray], FloatArray], at: FloatArray) -> FloatArray:
    """Return the (m, p) derivatives of a function by central differences; p is 0 for a law without coefficients."""
    columns = []
    for index, value in enumerate(at):
        step = np.zeros_like(at)
        step[index] = 1e-5 * max(abs(value), SIMULATED.least_size)
        columns.append((function(at + step) - function(at - step)) / (2 * step[index]))
    return np.stack(columns, axis=1) if columns else np.zeros((function(at).size, 0))


def estimate_joint(terms: ModeTerms, estimates: Sequence[Estimate]) -> JointEstimates:
    """Return what was estimated of the joint of a mode, from the estimates of all its terms."""
    friction, memory = terms.split(estimates)[2:]
    return JointEstimates(friction[0] if friction else ABSENT, terms.memory, memory)


def update_mode_fit(
    fit: ModeFit, found: FittedForm, estimates: list[Estimate], *, misfit: float, mass: Estimate, delay_s: Estimate
) -> ModeFit:
    """Return the fit of the mode under test with the law by simulation, its misfit over noise, and what it shows else.

    That is the modal mass and the delay of the accelerations, s.
    """
    terms, values = found.form.own[fit.mode], found.values.own[fit.mode]
    explained = {mode for each in found.values.couplings for mode in each.modes}
    k, c, amplitude = terms.powers.k, terms.powers.c, fit.stiffness_curve.position
    stiffness, damping_powers = terms.split(estimates)[:2]
    omega = _find_natural(fit, terms, values)
    viscous = 4 * np.pi * fit.damping_ratio * fit.frequency_hz
    damping = viscous + linearised(c, values.damping.values(), omega * amplitude)
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = damping + np.where(amplitude > 0, values.joint.find_damping(amplitude) / omega, 0.0)
    curves = _make_curves(fit, terms, values, found.covariance[: terms.size, : terms.size])
    updated = replace(
        fit,
        stiffness_order=terms.powers.orders[0],
        damping_order=terms.powers.orders[1],
        free_linear=1 in k,
        residual_fraction=float(found.missed[0]),
        misfit=misfit,
        modal_mass=mass,
        delay_s=delay_s,
        stiffness=stiffness,
        damping=damping_powers,
        joint_estimates=estimate_joint(terms, estimates),
        stiffness_curve=curves[0],
        damping_curve=curves[1],
        frequency_at_hz=omega / (2 * np.pi),
        damping_at=damping / np.maximum(2 * omega, 1e-300),
        interactions=tuple(each for each in fit.interactions if each.other not in explained),
    )
    outdated = {*warn_of_fit(fit), *(each.sentence for each in fit.interactions if each.other in explained)}
    kept = [text for text in fit.warnings if text not in outdated]
    return replace(updated, warnings=(*kept, *warn_of_fit(updated)))


def _find_natural(fit: ModeFit, terms: ModeTerms, values: OwnValues) -> FloatArray:
    """Return the natural frequency of the mode under test at the amplitudes of its stiffness curve, rad/s."""
    amplitude = fit.stiffness_curve.position
    square = (2 * np.pi * fit.frequency_hz) ** 2 + linearised(terms.powers.k, values.stiffness.values(), amplitude)
    return np.sqrt(np.maximum(square - values.joint.find_softening(amplitude), 0.0))


def _make_curves(fit: ModeFit, terms: ModeTerms, values: OwnValues, covariance: FloatArray) -> list[ForceCurve]:
    """Return the nonlinear stiffness and damping forces, with bands by the covariance of the values of the mode."""
    amplitude = fit.stiffness_curve.position
    vector = np.array(values.flatten())
    pace = np.maximum(_find_natural(fit, terms, values), 2 * np.pi * MODAL.widest_band[0] * fit.frequency_hz)

    def stiffness_force(at: FloatArray, own: FloatArray) -> FloatArray:
        its = OwnValues.of(terms, own.tolist())
        powers = (value * at**power for power, value in its.stiffness.items() if power > 1)
        return sum(powers, -its.joint.find_slip_force(at))

    def damping_force(at: FloatArray, own: FloatArray) -> FloatArray:
        its = OwnValues.of(terms, own.tolist())
        powers = (value * at**power for power, value in its.damping.items() if power > 1)
        reached = at / np.interp(at, pace * amplitude, pace)
        return sum(powers, its.joint.find_loss_force(reached))

    curves = []
    for curve, force, corrected in (
        (fit.stiffness_curve, stiffness_force, values.stiffness.get(1, 0.0) - read_linear(fit.stiffness)),
        (fit.damping_curve, damping_force, values.damping.get(1, 0.0) - read_linear(fit.damping)),
    ):
        at = curve.position
        slopes = differentiate(lambda own, at=at, force=force: force(at, own), vector)  # type: ignore[misc]
        half = 1.96 * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))
        middle = force(at, vector)
        linear = curve.linear + corrected * at
        curves.append(replace(curve, force=middle, low=middle - half, high=middle + half, linear=linear))
    return curves
