"""Some modes together, ready to be simulated: terms of their law, its coefficients, and the tests that move them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from opid.errors import InputError
from opid.mechanics.response import time_response
from opid.mechanics.structure import ComplexArray
from opid.modal.couplings import Product, expand_joint
from opid.modal.forced.equation import Powers, find_noise_power, find_quiet_lines, transform_noise
from opid.modal.joint_terms import JointKind, JointTerms, ModalJoint, Values
from opid.modal.linear.modes import LinearModes, ModalTest
from opid.modal.model import NonlinearModalModel
from opid.modal.power_laws import power_law
from opid.modal.settings import SIMULATED
from opid.signals.recording import FloatArray, recording_from_arrays
from opid.signals.resampling import resampled

Indices = NDArray[np.int64]
T = TypeVar("T")


@dataclass(frozen=True)
class ModeTerms:
    """The terms that a mode has by itself.

    Args:
        powers: powers of displacement and velocity; 1 is the correction of k0 and c0.
        has_friction: whether there is dry friction.
        memory: the joint with memory; None where there is none.
    """

    powers: Powers
    has_friction: bool = False
    memory: JointKind | None = None

    @property
    def n_powers(self) -> int:
        """The number of powers."""
        return len(self.powers.k) + len(self.powers.c)

    @property
    def size(self) -> int:
        """The number of coefficients."""
        return self.n_powers + self.has_friction + (self.memory.n_fitted if self.memory else 0)

    def split(self, values: Sequence[T]) -> tuple[dict[int, T], dict[int, T], tuple[T, ...], tuple[T, ...]]:
        """Return k_n and c_n by their power, friction where there is any, and the values of the joint with memory."""
        n_k, n = len(self.powers.k), self.n_powers + self.has_friction
        stiffness, damping = (
            dict(zip(powers, own, strict=False))
            for powers, own in ((self.powers.k, values), (self.powers.c, values[n_k:]))
        )
        return stiffness, damping, tuple(values[self.n_powers : n]), tuple(values[n : self.size])


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
    """The coefficients of one mode: k_n and c_n by their power, friction, and the values of a joint with memory."""

    stiffness: Mapping[int, float]
    damping: Mapping[int, float]
    friction: Values = ()
    kind: JointKind | None = None
    values: Values = ()

    @classmethod
    def of(cls, terms: ModeTerms, values: Sequence[float]) -> OwnValues:
        """Return values of some terms."""
        stiffness, damping, friction, memory = terms.split(values)
        return cls(stiffness, damping, friction, terms.memory, memory)

    @property
    def joint(self) -> JointTerms:
        """Friction and the joint with memory."""
        return JointTerms.of_kind(sum(self.friction), self.kind, self.values)

    def flatten(self) -> list[float]:
        """Return all values in one list."""
        return [*self.stiffness.values(), *self.damping.values(), *self.friction, *self.values]

    def list_labels(self, mode: int) -> list[Hashable]:
        """Return what each of these values is, of a mode."""
        joint = [(self.kind.name if self.kind else "", mode, index) for index in range(len(self.values))]
        powers = [("k", mode, n) for n in self.stiffness] + [("c", mode, n) for n in self.damping]
        return [*powers, *(("friction", mode) for _ in self.friction), *joint]


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
        own = [label for mode, each in self.own.items() for label in each.list_labels(mode)]
        return [*own, *self.couplings, *(("ratio", mode) for mode in self.ratios)]

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
            values = [next(given) for _ in range(terms.size)]
            factors = self.find_factors(index, terms, values)
            scaled = [value * factor for value, factor in zip(values, factors, strict=True)]
            own[form.modes[index]] = OwnValues.of(terms, scaled)
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

    def find_factors(self, index: int, terms: ModeTerms, values: Sequence[float]) -> list[float]:
        """Return what leads from the values of a mode in the units of the system to SI units."""
        a, v, force = float(self.largest[index]), self.top_speed(index), self.damping_force(index)
        of_powers = [force / a**n for n in terms.powers.k] + [force / v**n for n in terms.powers.c]
        of_memory = terms.memory.find_factors(terms.split(values)[3], force, a) if terms.memory else ()
        return [*of_powers, *[force] * terms.has_friction, *of_memory]

    def delay_forces(self, delay_s: float) -> System:
        """Return the system with forces that come later by a time, s; both ends of the forces should be quiet."""
        return replace(self, tests=tuple(each.delay_forces(delay_s) for each in self.tests)) if delay_s else self

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
    """One test of a system: its modal forces, and the lines of the measured accelerations.

    Args:
        name: the name of the test.
        fs: sampling rate, Hz.
        n_samples: number of samples.
        steps_per_sample: steps of the simulation from one sample to the next.
        forces: (n_samples, n_modes) modal forces, N/kg^1/2.
        lines: indices of the lines of each mode's band.
        measured: transforms of the measured accelerations on these lines.
        noise: standard deviation of a line (complex) by the sensors' noise, of each mode.
        moved: the same by the motion that the noise of the forces would cause.
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
    moved: tuple[float, ...]
    reach: int
    _between: dict[int, FloatArray] = field(init=False, repr=False, default_factory=dict)

    def delay_forces(self, delay_s: float) -> SystemTest:
        """Return the test with forces that come later by a time, s."""
        turn = np.exp(-2j * np.pi * fft.rfftfreq(self.n_samples, 1 / self.fs) * delay_s)
        return replace(self, forces=fft.irfft(turn[:, None] * fft.rfft(self.forces, axis=0), self.n_samples, axis=0))

    def find_forces(self, steps: int) -> FloatArray:
        """Return the modal forces at half steps, (n_half_steps, n_modes), for a number of steps in each sample."""
        if steps not in self._between:
            names = [f"force {number + 1}" for number in range(self.forces.shape[1])]
            series = recording_from_arrays(list(self.forces.T), names, fs=self.fs, unit="N")
            between = resampled(series, 2 * steps * self.fs).samples
            self._between[steps] = between[: 2 * (self.n_samples - 1) * steps + 1]
        return self._between[steps]

    def simulate(self, model: NonlinearModalModel) -> list[ComplexArray]:
        """Return the lines of the simulated accelerations of each mode.

        Raises:
            InputError: a motion that grows without bound, or a joint whose memory changes too fast to be followed.
        """
        finer = model.count_steps(self.fs, np.inf) / self.steps_per_sample
        if finer > SIMULATED.most_finer:
            raise InputError(f"the memory of a joint needs {finer:.3g} times shorter steps: give it a longer travel")
        # In powers of 2 the steps stay alike while a search moves on.
        steps = self.steps_per_sample * 2 ** max(0, int(np.ceil(np.log2(finer))))
        motion = time_response(
            model.structure(),
            self.find_forces(steps),
            fs=self.fs,
            duration_s=self.n_samples / self.fs,
            steps_per_sample=steps,
        )
        if np.abs(motion.acceleration).max() > SIMULATED.boundless:
            raise InputError("the motion grows without bound")
        spectrum = fft.rfft(motion.acceleration, axis=0)
        return [spectrum[lines, index] for index, lines in enumerate(self.lines)]


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
        forces = np.stack([test.modal_force(number) for number in numbers], axis=1)
        frequency = fft.rfftfreq(n, 1 / test.fs)
        spectrum = fft.rfft(test.acceleration[:, indices], axis=0)
        noise = [float(np.sqrt(find_noise_power(transform_noise(test, number)))) for number in numbers]
        lines = [
            np.flatnonzero((frequency >= low) & (frequency <= high)).astype(np.int64) for low, high in bands_hz.values()
        ]
        of_force, quiet = fft.rfft(forces, axis=0), find_quiet_lines(test.modes, frequency)
        force_noise = np.sqrt(find_noise_power(of_force[quiet]))
        gains = [
            np.linalg.norm(spectrum[own, index]) / max(float(np.linalg.norm(of_force[own, index])), 1e-300)
            for index, own in enumerate(lines)
        ]
        moved = [float(each) for each in force_noise * gains]
        size = np.sum(test.acceleration[:, indices[0]] ** 2)
        lasting = size**2 / max(float(np.sum(test.acceleration[:, indices[0]] ** 4)), 1e-300)
        ready.append(
            SystemTest(
                test.name, test.fs, n, steps, forces, tuple(lines),
                tuple(spectrum[own, index] for index, own in enumerate(lines)),
                tuple(noise), tuple(moved), int(np.ceil(2 * n / max(float(lasting), 1.0))),
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
    ratio = np.divide(damping, 2 * omega, out=modes.damping_ratio.copy(), where=omega > 0)
    return replace(modes, frequency_hz=omega / (2 * np.pi), damping_ratio=ratio)
