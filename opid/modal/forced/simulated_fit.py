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

from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft, stats

from opid.errors import InputError
from opid.mechanics.response import time_response
from opid.mechanics.structure import ComplexArray
from opid.modal.couplings import Product, expand_joint
from opid.modal.forced.equation import Powers, find_noise_power, find_quiet_lines
from opid.modal.forced.restoring_fit import sum_lagged_products
from opid.modal.joint_terms import JointTerms, ModalJoint
from opid.modal.linear.modes import LinearModes, ModalTest
from opid.modal.model import NonlinearModalModel
from opid.modal.power_laws import power_law
from opid.modal.settings import MODAL, SIMULATED
from opid.signals.recording import FloatArray, recording_from_arrays
from opid.signals.resampling import resampled

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class ModeTerms:
    """The terms that a mode has by itself.

    Args:
        powers: powers of displacement and velocity; 1 is the correction of k0 and c0.
        has_friction: whether there is dry friction.
        has_slip: whether there is an Iwan joint.
    """

    powers: Powers
    has_friction: bool = False
    has_slip: bool = False

    @property
    def size(self) -> int:
        """The number of coefficients."""
        return len(self.powers.k) + len(self.powers.c) + self.has_friction + 2 * self.has_slip


@dataclass(frozen=True)
class SystemForm:
    """The terms of some modes together; a vector of coefficients holds them in this order.

    Args:
        own: the terms of each mode, by its number.
        products: products by which the modes drive each other, each with its own coefficient.
        joint: terms of a joint that all modes stretch, as (of_velocity, degree); its direction is 1 for the first mode.
        has_scales: whether the measured motion of every mode but the first has an unknown scale.
    """

    own: Mapping[int, ModeTerms]
    products: tuple[Product, ...] = ()
    joint: tuple[tuple[bool, int], ...] = ()
    has_scales: bool = False

    @property
    def modes(self) -> tuple[int, ...]:
        """The modes, in the order of the vector."""
        return tuple(self.own)

    @property
    def size(self) -> int:
        """The number of coefficients."""
        of_joint = len(self.joint) + len(self.own) - 1 if self.joint else 0
        of_scales = (len(self.own) - 1) * self.has_scales
        return sum(each.size for each in self.own.values()) + len(self.products) + of_joint + of_scales


@dataclass(frozen=True)
class OwnValues:
    """The coefficients of one mode: k_n and c_n by their power, and its joint."""

    stiffness: Mapping[int, float]
    damping: Mapping[int, float]
    joint: JointTerms

    def flatten(self) -> list[float]:
        """Return all values in one list."""
        joint = self.joint
        return [*self.stiffness.values(), *self.damping.values(), joint.friction, joint.slip, joint.exponent]


@dataclass(frozen=True)
class SystemValues:
    """The coefficients of some modes together, in SI.

    `ratios` is the direction of their joint, where there is one, and `scales` the measured over the true motion of all
    modes but the first, where that is asked.
    """

    own: Mapping[int, OwnValues]
    couplings: Mapping[Product, float]
    ratios: Mapping[int, float]
    scales: Mapping[int, float]

    @property
    def labels(self) -> list[Hashable]:
        """What each value of `flatten` is, alike in all forms that have it."""
        found: list[Hashable] = []
        for mode, each in self.own.items():
            found += [("k", mode, n) for n in each.stiffness] + [("c", mode, n) for n in each.damping]
            found += [(name, mode) for name in ("friction", "slip", "exponent")]
        return [*found, *self.couplings, *(("ratio", mode) for mode in self.ratios)]

    def flatten(self) -> FloatArray:
        """Return all values in one vector."""
        of_modes = [value for each in self.own.values() for value in each.flatten()]
        return np.array([*of_modes, *self.couplings.values(), *self.ratios.values(), *self.scales.values()])


@dataclass(frozen=True, eq=False)
class System:
    """Some modes in the tests that move them, ready to be simulated.

    Args:
        modes: linear modes with only the shapes of the system.
        numbers: numbers of these modes in the structure, from 1.
        largest: (n_modes,) largest displacement of each mode, m kg^1/2.
        tests: the tests.
    """

    modes: LinearModes
    numbers: tuple[int, ...]
    largest: FloatArray
    tests: tuple[SystemTest, ...]

    def convert(self, form: SystemForm, vector: FloatArray) -> SystemValues:
        """Return the coefficients in SI of a vector, whose numbers are of the order of 1.

        Every term is counted in the force 2 zeta k0 a that the mode's damping takes at its largest displacement a.
        """
        given = iter(vector.tolist())
        own = {}
        for index, terms in enumerate(form.own.values()):
            a, force = self.largest[index], self.damping_force(index)
            stiffness = {n: next(given) * force / a**n for n in terms.powers.k}
            damping = {n: next(given) * force / self.top_speed(index) ** n for n in terms.powers.c}
            friction = next(given) * force if terms.has_friction else 0.0
            slip, exponent = (next(given), next(given)) if terms.has_slip else (0.0, 0.0)
            joint = JointTerms(friction, slip * force / a ** (2 + exponent), exponent)
            own[form.modes[index]] = OwnValues(stiffness, damping, joint)
        at = {number: index for index, number in enumerate(self.numbers)}
        couplings = {product: next(given) * self.measure_product(product) for product in form.products}
        ratios: dict[int, float] = {}
        if form.joint:
            amounts = [next(given) for _ in form.joint]
            ratios = {number: next(given) * self.largest[0] / self.largest[at[number]] for number in self.numbers[1:]}
            for (of_velocity, degree), amount in zip(form.joint, amounts, strict=True):
                scale = self.measure_product(Product((self.numbers[0],) * degree, of_velocity))
                direction = {self.numbers[0]: 1.0} | ratios
                couplings |= expand_joint(direction, amount * scale / degree, degree, of_velocity=of_velocity)
        scales = {number: next(given) for number in self.numbers[1:]} if form.has_scales else {}
        return SystemValues(own, couplings, ratios, scales)

    def top_speed(self, index: int) -> float:
        """Return the velocity of a mode at its largest displacement and natural frequency, m/s kg^1/2."""
        return float(self.largest[index] * np.sqrt(self.modes.stiffness()[index]))

    def damping_force(self, index: int) -> float:
        """Return the force of the linear damping at that velocity, N/kg^1/2."""
        return float(self.modes.damping()[index]) * self.top_speed(index)

    def measure_product(self, product: Product) -> float:
        """Return the coefficient at which a product has the energy, or power, of the first mode's damping force."""
        force, velocity = self.damping_force(0), product.of_velocity
        sizes = [
            self.top_speed(index) if velocity else float(self.largest[index]) for index in range(len(self.numbers))
        ]
        factors = [sizes[self.numbers.index(mode)] for mode in product.modes]
        return force * sizes[0] / float(np.prod(factors))

    def make_model(self, values: SystemValues) -> NonlinearModalModel:
        """Return the model of these modes alone, which are numbered from 1.

        Raises:
            InputError: a frequency that is no longer positive.
        """
        at = {number: index + 1 for index, number in enumerate(self.numbers)}
        laws, joints = {}, {}
        modes = correct_modes(
            self.modes,
            {at[number]: (each.stiffness.get(1, 0.0), each.damping.get(1, 0.0)) for number, each in values.own.items()},
        )
        for number, each in values.own.items():
            higher = [{n: value for n, value in powers.items() if n > 1} for powers in (each.stiffness, each.damping)]
            laws[at[number]] = power_law(*higher)
            joints[at[number]] = ModalJoint(each.joint, float(self.largest[at[number] - 1]))
        couplings = {
            Product(tuple(at[mode] for mode in product.modes), product.of_velocity): value
            for product, value in values.couplings.items()
        }
        return NonlinearModalModel(modes, laws, joints, couplings)


@dataclass(frozen=True, eq=False)
class SystemTest:
    """One test of a system: its modal forces at half steps, and the lines of the measured accelerations.

    Args:
        name: the name of the test.
        fs: sampling rate, Hz.
        n_samples: number of samples.
        steps_per_sample: steps of the simulation from one sample to the next.
        forces: (n_half_steps, n_modes) modal forces, N/kg^1/2.
        lines: indices of the lines of each mode's band.
        measured: transforms of the measured accelerations on these lines.
        noise: standard deviation of a line (complex) by the sensors' noise, of each mode.
        reach: lines over which errors are correlated, for the motion is short.
    """

    name: str
    fs: float
    n_samples: int
    steps_per_sample: int
    forces: FloatArray
    lines: tuple[Indices, ...]
    measured: tuple[ComplexArray, ...]
    noise: tuple[float, ...]
    reach: int

    def simulate(self, model: NonlinearModalModel) -> list[ComplexArray]:
        """Return the lines of the simulated accelerations of each mode.

        Raises:
            InputError: a motion that grows without bound.
        """
        motion = time_response(
            model.structure(),
            self.forces,
            fs=self.fs,
            duration_s=self.n_samples / self.fs,
            steps_per_sample=self.steps_per_sample,
        )
        spectrum = fft.rfft(motion.acceleration, axis=0)
        return [spectrum[lines, index] for index, lines in enumerate(self.lines)]


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
        errors: (n_folds,) misfit of what was left out in turn, over the motion (rms of the modes).
        missed: misfit over the motion, rms over all tests, of each mode.
        minimum: where the search ended.
    """

    form: SystemForm
    values: SystemValues
    covariance: FloatArray
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

    @property
    def std(self) -> FloatArray:
        """Standard deviations of `values`, flattened."""
        return np.sqrt(np.diag(self.covariance))


def make_system(
    tests: Sequence[ModalTest],
    bands_hz: Mapping[int, tuple[float, float]],
    largest: Mapping[int, float],
    *,
    step_rad: float,
) -> System:
    """Return the modes with these bands, in tests that have one set of linear modes.

    Args:
        tests: tests with forces that begin at rest.
        bands_hz: the band of each mode of the system, Hz, by its number.
        largest: the largest displacement of each mode in the tests, m kg^1/2.
        step_rad: largest step of the simulation, in rad of the fastest mode.
    """
    numbers = tuple(bands_hz)
    indices = [tests[0].modes.index(number) for number in numbers]
    modes = select_modes(tests[0].modes, numbers)
    highest = 2 * np.pi * float(modes.frequency_hz.max())
    ready = []
    for test in tests:
        steps = max(1, int(np.ceil(highest / test.fs / step_rad)))
        n = len(test.acceleration)
        forces = [test.modal_force(number) for number in numbers]
        series = recording_from_arrays(forces, [f"mode {number}" for number in numbers], fs=test.fs, unit="N")
        half = resampled(series, 2 * steps * test.fs).samples[: 2 * (n - 1) * steps + 1]
        frequency = fft.rfftfreq(n, 1 / test.fs)
        spectrum = fft.rfft(test.acceleration[:, indices], axis=0)
        noise = np.sqrt(find_noise_power(spectrum[find_quiet_lines(test.modes, frequency)]))
        lines = [
            np.flatnonzero((frequency >= low) & (frequency <= high)).astype(np.int64) for low, high in bands_hz.values()
        ]
        size = np.sum(test.acceleration[:, indices[0]] ** 2)
        lasting = size**2 / max(float(np.sum(test.acceleration[:, indices[0]] ** 4)), 1e-300)
        ready.append(
            SystemTest(
                test.name, test.fs, n, steps, half, tuple(lines),
                tuple(spectrum[own, index] for index, own in enumerate(lines)),
                tuple(noise.tolist()), int(np.ceil(2 * n / max(float(lasting), 1.0))),
            )
        )  # fmt: skip
    return System(modes, numbers, np.array([largest[number] for number in numbers]), tuple(ready))


def select_modes(modes: LinearModes, numbers: Sequence[int]) -> LinearModes:
    """Return some of the modes, in the given order."""
    indices = [modes.index(number) for number in numbers]
    return replace(
        modes,
        frequency_hz=modes.frequency_hz[indices],
        damping_ratio=modes.damping_ratio[indices],
        shapes=modes.shapes[:, indices],
    )


def correct_modes(modes: LinearModes, corrections: Mapping[int, tuple[float, float]]) -> LinearModes:
    """Return the modes with k0 and c0 of some of them changed by these values, 1/s^2 and 1/s, by their numbers."""
    stiffness, damping = modes.stiffness(), modes.damping()
    for mode, (of_stiffness, of_damping) in corrections.items():
        stiffness[modes.index(mode)] += of_stiffness
        damping[modes.index(mode)] += of_damping
    omega = np.sqrt(np.maximum(stiffness, 0.0))
    ratio = np.where(omega > 0, damping / np.maximum(2 * omega, np.finfo(float).tiny), modes.damping_ratio)
    return replace(modes, frequency_hz=omega / (2 * np.pi), damping_ratio=ratio)


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
        x_scale=np.maximum(np.abs(start), 0.1),
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
        if terms.has_slip:
            low[first] = 0.0
            low[first + 1], high[first + 1] = MODAL.slip_exponents
            first += 2
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
    spread = [np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, each, slopes), 0.0)) for each in (by_noise, by_part)]
    std = np.maximum(spread[0], spread[1] * float(stats.t.ppf(0.975, n - 1)) / 1.96)
    missed = [
        float(np.sqrt(sum(np.sum(np.abs(left[index]) ** 2) for left in found.left) / sum(s[index] ** 2 for s in size)))
        for index in range(n_modes)
    ]
    folds = _choose_folds(system, np.array(errors))
    scale = std / np.maximum(spread[0], np.finfo(float).tiny)
    covariance = np.einsum("ij,jk,lk->il", slopes, by_noise, slopes) * np.outer(scale, scale)
    return FittedForm(form, values, covariance, folds, np.array(missed), found)


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
    """Return the (m, p) derivatives of a function by central differences."""
    columns = []
    for index, value in enumerate(at):
        step = np.zeros_like(at)
        step[index] = 1e-5 * max(abs(value), 0.1)
        columns.append((function(at + step) - function(at - step)) / (2 * step[index]))
    return np.stack(columns, axis=1)
