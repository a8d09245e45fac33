"""Backbones as single-point forcing finds them: one sensor in quadrature with the force, level after level.

The module has the records of a measurement, and computes the same curves by harmonic balance of the damped, forced
structure. The phase of a sensor and either an amplitude or the force are prescribed, so that response curves follow
from the same equations (`response_curves`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from opid.errors import InputError
from opid.mechanics.backbones.family import require_amplitudes
from opid.mechanics.backbones.specimen import Specimen, solve_linear_start
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.structure import ComplexArray

_SAMPLES = 128
# number of frequencies among which quadrature of the linear structure is searched
_N_SCANNED = 6001
# fraction of the largest extension, and of the frequency, by which a solution may differ from its prediction
_FROM_PREDICTION = 0.05
# smallest step of what is prescribed, as a fraction of it
_LEAST_STEP = 1 / 64

HARMONICS = (1, 3, 5, 7)
"""The harmonics that are balanced where none are named."""

_Prescribed = Literal["amplitude", "force_n", "phase_error_rad"]


@dataclass(frozen=True, eq=False)
class ContinuationLevel:
    """One amplitude that was held at phase quadrature, and the record of it.

    Harmonics are complex amplitudes by the number of the harmonic less one, x(t) = Re sum_h X_h exp(j h omega t).

    Args:
        frequency_hz: frequency of the record, Hz.
        force: (n_harmonics,) harmonics of the force on the structure, N.
        sensors: (n_sensors, n_harmonics) harmonics of the displacements, m.
        phase_error_rad: phase of the sensor against the force, off quadrature, radians.
        invasiveness: rms of the control's harmonics above the first over its first.
        converged: whether phase, control and amplitude are within their tolerance.
        n_records: number of records of this level.
        periods: number of periods of the drive at this level.
        reason: the reason why it has not converged, "" if it has.
    """

    frequency_hz: float
    force: ComplexArray
    sensors: ComplexArray
    phase_error_rad: float
    invasiveness: float
    converged: bool
    n_records: int
    periods: int
    reason: str


@dataclass(frozen=True, eq=False)
class MeasuredCurve:
    """A backbone as single-point forcing finds it: one sensor in quadrature, level after level.

    Args:
        mode: number of the mode, from 1.
        sensor: the sensor whose quadrature was held.
        controlled_sensor: the sensor whose amplitude grows from level to level.
        sensors: names of all sensors, in the order of the levels' rows.
        levels: the levels in the order in which they were driven; after several failures the curve ends.
    """

    mode: int
    sensor: str
    controlled_sensor: str
    sensors: tuple[str, ...]
    levels: tuple[ContinuationLevel, ...]

    @property
    def converged(self) -> NDArray[np.bool_]:
        """(n,) whether each level converged."""
        return np.array([level.converged for level in self.levels])

    @property
    def frequency_hz(self) -> FloatArray:
        """(n,) frequency of quadrature, Hz."""
        return np.array([level.frequency_hz for level in self.levels])

    @property
    def harmonics(self) -> ComplexArray:
        """(n, n_sensors, n_harmonics) harmonics of the displacements, m."""
        return np.stack([level.sensors for level in self.levels])

    @property
    def force(self) -> ComplexArray:
        """(n, n_harmonics) harmonics of the force, N."""
        return np.stack([level.force for level in self.levels])

    @property
    def phase_error_rad(self) -> FloatArray:
        """(n,) phase error from quadrature, radians."""
        return np.array([level.phase_error_rad for level in self.levels])

    @property
    def amplitude(self) -> FloatArray:
        """(n, n_sensors) part of the first harmonic that is in phase with the controlled sensor, m.

        At resonance a mode lags the force by a quarter of a period; other motion is out of phase with it.
        """
        first = self.harmonics[:, :, 0]
        held = first[:, [self.sensors.index(self.controlled_sensor)]]
        return np.asarray(np.real(first * held.conj()) / np.abs(held))

    @property
    def controlled_amplitude(self) -> FloatArray:
        """(n,) amplitude of the first harmonic of the controlled sensor, m."""
        return np.abs(self.harmonics[:, self.sensors.index(self.controlled_sensor), 0])

    @property
    def reason(self) -> str:
        """The reason why the curve is incomplete, that of the first level that failed; "" if none did."""
        return next((level.reason for level in self.levels if level.reason), "")


def quadrature_curve(
    specimen: Specimen,
    *,
    mode: int,
    sensor: str,
    controlled_sensor: str,
    amplitude: ArrayLike,
    harmonics: Sequence[int] = HARMONICS,
    widest_fraction: float = 0.03,
) -> MeasuredCurve:
    """Return the curve to which single-point forcing tends, by harmonic balance, without simulating a measurement.

    A sensor may be in quadrature more than once. The curve begins at the linear quadrature that is nearest to the mode
    and keeps to its branch by secants over the amplitude, with steps between the levels where they need them.

    With R the receptance of the damped linear modes and f, real, the only harmonic of the force,

        z_h + R_jj(h w) F_h(z) - R_jd(h w) f delta_h1 = 0,  Re X_s1 = 0,  |X_c1| = A

    are solved for the extensions z of the joints, w and f at each amplitude A. The control is zero and does not appear.

    Args:
        specimen: the structure; its shaker is left out, and the force acts directly.
        mode: number of the mode, from 1.
        sensor: the sensor whose quadrature is held.
        controlled_sensor: the sensor whose amplitude grows from level to level.
        amplitude: (n,) growing amplitudes of its first harmonic, m.
        harmonics: harmonics that are balanced, 1 among them; 0 and the even ones, too, where a law is not odd.
        widest_fraction: fraction by which the frequency may move from level to level.

    Raises:
        InputError: no such mode or sensor, amplitudes that are not positive and growing, harmonics without the first,
            or a mode in which the drive point or the controlled sensor does not move.
    """
    wanted = require_growing_amplitudes(amplitude)
    balance, branch = begin_curve(specimen, mode, (sensor, controlled_sensor), harmonics, widest_fraction)
    if branch is None:
        here = replace(balance, amplitude=float(wanted[0]))
        levels = [here.make_level(here.linear_motion(), here.say_miss(1.0, widest_fraction))]
    else:
        levels, _ = sweep(balance, branch, "amplitude", wanted, widest_fraction)
    return MeasuredCurve(mode, sensor, controlled_sensor, specimen.system.sensors, tuple(levels))


def begin_curve(
    specimen: Specimen, mode: int, sensors: tuple[str, str], harmonics: Sequence[int], widest_fraction: float
) -> tuple[_Balance, _Branch | None]:
    """Return the equations at zero amplitude with their solution; None where the linear sensor has no quadrature."""
    numbers = tuple(sorted({int(number) for number in harmonics}))
    if 1 not in numbers or numbers[0] < 0:
        raise InputError(f"harmonics are {tuple(harmonics)}: give whole numbers from 0 on, with 1 among them")
    _, force_n_per_m = solve_linear_start(specimen, mode, sensors[1])
    system = specimen.system
    columns = system.sensor(sensors[0]), system.sensor(sensors[1])
    linear_hz = float(system.frequency_hz[system.index(mode)])
    found = _find_linear_quadrature(specimen, linear_hz, columns[0], widest_fraction)
    balance = _Balance(specimen, numbers, columns, found or linear_hz, force_n_per_m)
    return balance, _Branch(0.0, balance.linear_motion()) if found else None


@dataclass(frozen=True, eq=False)
class _Branch:
    """A solution x at one value of what is prescribed, in its unit, and its slope over it."""

    at: float
    x: FloatArray
    slope: FloatArray | float = 0.0


def sweep(
    balance: _Balance, branch: _Branch, name: _Prescribed, values: FloatArray, widest_fraction: float
) -> tuple[list[ContinuationLevel], _Branch]:
    """Return a level for each value of what is prescribed, and the last solution; a level that fails is the last."""
    last, levels = float(branch.x[-2]), []
    for value in map(float, values):
        followed = _follow(balance, branch, name, value)
        branch, here = followed or branch, balance.prescribe(name, value)
        _, ratio, force = here.unpack(branch.x)
        is_lost = followed is None or abs(ratio / last - 1.0) > widest_fraction or force <= 0.0
        levels.append(here.make_level(branch.x, here.say_miss(last, widest_fraction) if is_lost else ""))
        if is_lost:
            break
        last = ratio
    return levels, branch


def _follow(balance: _Balance, branch: _Branch, name: _Prescribed, value: float) -> _Branch | None:
    """Return the solution at a value that is farther from 0 on the same branch, by secants; None where there is none.

    `name` is that of the field of the balance to which the value belongs.
    """
    goal = value
    while branch.at != value:
        step = goal - branch.at
        predicted = branch.x + step * branch.slope
        there = balance.prescribe(name, goal)
        x = np.asarray(optimize.root(there.residual, predicted, jac=there.find_slopes, tol=1e-12).x)
        off = max(np.abs(x - predicted)[:-2].max() / np.abs(predicted[:-2]).max(), abs(x[-2] / predicted[-2] - 1.0))
        # A sensor may have two quadratures close to each other: a solution far from the prediction is the other one.
        if np.abs(there.residual(x)).max() < 1e-8 and off < _FROM_PREDICTION:
            branch, goal = _Branch(goal, x, (x - branch.x) / step), value
        elif abs(step) > _LEAST_STEP * abs(value):
            goal = branch.at + 0.5 * step
        else:
            return None
    return branch


def _find_linear_quadrature(specimen: Specimen, linear_hz: float, column: int, widest_fraction: float) -> float | None:
    """Return the linear frequency of quadrature of a sensor, Hz, that is nearest to a mode; None without one."""
    shape = specimen.system.at_sensors[column]

    def in_phase(shift: ArrayLike) -> FloatArray:
        response = specimen.find_linear_response(linear_hz * (1.0 + np.asarray(shift)))
        return np.asarray((response @ shape).real)

    shifts = np.linspace(-widest_fraction, widest_fraction, _N_SCANNED)
    values = in_phase(shifts)
    turns = np.flatnonzero(np.signbit(values[1:]) != np.signbit(values[:-1]))
    if not turns.size:
        return None
    nearest = turns[np.argmin(np.abs(shifts[turns]))]
    return linear_hz * (1.0 + float(optimize.brentq(in_phase, shifts[nearest], shifts[nearest + 1], xtol=1e-14)))


def require_growing_amplitudes(amplitude: ArrayLike) -> FloatArray:
    """Return `amplitude` as an array (n,).

    Raises:
        InputError: unless they are positive and growing.
    """
    wanted = require_amplitudes(amplitude)
    if (np.diff(wanted) <= 0.0).any():
        raise InputError(f"the amplitudes are {amplitude!r}: give them from small to large, m")
    return wanted


@dataclass(frozen=True, eq=False)
class _Balance:
    """The equations of one level; unknowns are scaled by the amplitude, a frequency, and the force for 1 m, N/m.

    The amplitude is prescribed, unless the force is: the force over the amplitude is unknown in both cases.
    """

    specimen: Specimen
    numbers: tuple[int, ...]
    columns: tuple[int, int]  # of the sensor whose phase is prescribed, and of that whose amplitude is
    frequency_hz: float
    force_n_per_m: float
    amplitude: float = 0.0
    force_n: float | None = None
    phase_error_rad: float = 0.0  # off quadrature, see `find_quadrature_error`

    def prescribe(self, name: _Prescribed, value: float) -> _Balance:
        """Return the equations with another value of what is prescribed."""
        changed: dict[str, Any] = {name: value}
        return replace(self, **changed)

    def linear_motion(self) -> FloatArray:
        """Return the unknowns in the limit of zero amplitude, where only the force moves the structure."""
        system, q = self.specimen.system, self.specimen.find_linear_response(self.frequency_hz)
        stiffness = 1.0 / abs(q @ system.at_sensors[self.columns[1]])
        z = np.zeros((len(self.numbers), len(system.joints)), dtype=complex)
        z[self.numbers.index(1)] = system.at_joints @ q * stiffness
        return np.concatenate([z.real.ravel(), z.imag.ravel(), [1.0, stiffness / self.force_n_per_m]])

    def unpack(self, x: FloatArray) -> tuple[ComplexArray, float, float]:
        """Return extensions (n_harmonics, n_joints) over the amplitude, frequency and force over their scales."""
        parts = x[:-2].reshape(2, len(self.numbers), -1)
        return parts[0] + 1j * parts[1], float(x[-2]), float(x[-1])

    def find_amplitude(self, x: FloatArray) -> float:
        """Return the amplitude of the controlled sensor, m."""
        return self.amplitude if self.force_n is None else self.force_n / (float(x[-1]) * self.force_n_per_m)

    def motion(self, x: FloatArray) -> tuple[ComplexArray, ComplexArray, float]:
        """Return the misfit of the joints (n_harmonics, n_joints) and the sensors (n_harmonics, n_sensors), over A."""
        z, _, stiffness = self.unpack(x)
        system, q = self.specimen.system, self._find_coordinates(x)
        force = stiffness * self.force_n_per_m * self.find_amplitude(x)
        return z - q @ system.at_joints.T, q @ system.at_sensors.T, force

    def _find_coordinates(self, x: FloatArray) -> ComplexArray:
        """Return the modal coordinates over A, (n_harmonics, n_modes)."""
        held = self._find_joint_motion(x)
        force = np.empty_like(held[0])
        for law, joints in self.specimen.joints_of_laws.items():
            force[:, joints] = law.force(held[0][:, joints], held[1][:, joints])
        modal = -(_make_waves(self.numbers)[1] @ force) @ self.specimen.system.at_joints / self.find_amplitude(x)
        modal[self.numbers.index(1)] += float(x[-1]) * self.force_n_per_m * self.specimen.drive_row
        return np.asarray(modal / self._find_stiffness(x), dtype=np.complex128)

    def _find_joint_motion(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the extensions of the joints, m, and their rates, m/s, over a period, (n_samples, n_joints) each."""
        z, wave = self.find_amplitude(x) * self.unpack(x)[0], _make_waves(self.numbers)[0]
        return (wave @ z).real, (wave @ (1j * self._find_omega(x) * z)).real

    def _find_omega(self, x: FloatArray) -> FloatArray:
        return 2.0 * np.pi * self.frequency_hz * float(x[-2]) * np.array(self.numbers)[:, None]

    def _find_stiffness(self, x: FloatArray) -> ComplexArray:
        """Return the dynamic stiffness of the modes, (n_harmonics, n_modes), 1/s^2."""
        omega = self._find_omega(x)
        return np.asarray(self.specimen.system.eigenvalue - omega**2 + 1j * omega * self.specimen.modal_damping)

    def find_slopes(self, x: FloatArray) -> FloatArray:
        """Return the derivatives of `residual` by each unknown, (n_unknowns, n_unknowns), with those in the columns."""
        (z, ratio, stiffness), q, system = self.unpack(x), self._find_coordinates(x), self.specimen.system
        (wave, weight), amplitude, omega = _make_waves(self.numbers), self.find_amplitude(x), self._find_omega(x)
        held, dynamic, first = self._find_joint_motion(x), self._find_stiffness(x), self.numbers.index(1)
        by_extension, by_rate = np.empty((2, *held[0].shape))
        for law, joints in self.specimen.joints_of_laws.items():
            by_extension[:, joints], by_rate[:, joints] = law.gradient(held[0][:, joints], held[1][:, joints])
        # The first axis of what follows has an entry for each unknown.
        parts = np.eye(x.size)[:, :-2].reshape(-1, 2, *z.shape)
        by_z = parts[:, 0] + 1j * parts[:, 1]
        moved = amplitude * by_z
        if self.force_n is not None:
            moved[-1] = -amplitude / stiffness * z
        turned = 1j * omega * moved
        turned[-2] = 1j * omega / ratio * amplitude * z
        force = weight @ (by_extension * (wave @ moved).real + by_rate * (wave @ turned).real)
        by_modal = -force @ system.at_joints / amplitude
        by_modal[-2] -= q * (-2.0 * omega + 1j * self.specimen.modal_damping) * omega / ratio
        if self.force_n is None:
            by_modal[-1, first] += self.force_n_per_m * self.specimen.drive_row
        else:
            by_modal[-1] += q * dynamic / stiffness
        by_q = by_modal / dynamic
        misfit = (by_z - by_q @ system.at_joints.T).reshape(x.size, -1)
        shapes = system.at_sensors[[*self.columns]]
        phased, controlled = shapes @ q[first]
        by_phased, by_controlled = shapes @ by_q[:, first].T
        turn = np.exp(-1j * self.phase_error_rad)
        grown = (by_controlled * np.conj(controlled)).real / np.abs(controlled)
        across = (by_phased * turn).real - (phased * turn).real * (by_phased / phased).real
        return np.vstack([misfit.real.T, misfit.imag.T, grown, across / np.abs(phased)])

    def residual(self, x: FloatArray) -> FloatArray:
        """Return the (n_unknowns,) values of the equations, all zero at the phase and the amplitude or force."""
        misfit, sensors, _ = self.motion(x)
        first = sensors[self.numbers.index(1)]
        held, turned = np.abs(first[self.columns[1]]), first[self.columns[0]] * np.exp(-1j * self.phase_error_rad)
        size = max(abs(turned), 1e-12)
        return np.concatenate([misfit.real.ravel(), misfit.imag.ravel(), [held - 1.0, turned.real / size]])

    def say_miss(self, ratio: float, widest_fraction: float) -> str:
        """Return the clause on a phase that is not reached near a frequency, over its scale."""
        sensor, near_hz = self.specimen.system.sensors[self.columns[0]], ratio * self.frequency_hz
        lag = 90.0 - np.degrees(self.phase_error_rad)
        phase = f"a lag of {lag:.3g} degrees" if self.phase_error_rad else "quadrature"
        within = f"within {widest_fraction:.0%} of" if np.isfinite(widest_fraction) else "beyond"
        return f"{sensor!r} does not reach {phase} {within} {near_hz:.3f} Hz"

    def make_level(self, x: FloatArray, reason: str) -> ContinuationLevel:
        """Return the record of a solution."""
        _, sensors, force = self.motion(x)
        kept = max(self.numbers)
        displacement = np.zeros((sensors.shape[1], kept), dtype=complex)
        for number, row in zip(self.numbers, self.find_amplitude(x) * sensors, strict=True):
            if number:
                displacement[:, number - 1] = row
        forces = np.zeros(kept, dtype=complex)
        forces[0] = force
        error = find_quadrature_error(forces[0], displacement[self.columns[0], 0])
        frequency = self.frequency_hz * self.unpack(x)[1]
        return ContinuationLevel(frequency, forces, displacement, error, 0.0, not reason, 1, 0, reason)


@cache
def _make_waves(numbers: tuple[int, ...]) -> tuple[ComplexArray, ComplexArray]:
    """Return what takes harmonics to the samples of a period, and what takes real samples to harmonics."""
    wave = np.exp(1j * np.outer(np.arange(_SAMPLES) * (2.0 * np.pi / _SAMPLES), numbers))
    weight = np.where(np.array(numbers) == 0, 1.0, 2.0)[:, None] / _SAMPLES
    return np.asarray(wave, dtype=np.complex128), np.asarray(weight * wave.conj().T, dtype=np.complex128)


def find_quadrature_error(force: complex, displacement: complex) -> float:
    """Return the phase of a displacement off quadrature with a force, radians, within pi / 2 on either side.

    It is positive below resonance. A sensor that moves against the drive point counts as one that moves with it.

    >>> round(find_quadrature_error(1.0, 0.1 - 1j), 4)
    0.0997
    """
    ratio = force / displacement
    return float(np.arctan2(ratio.real, abs(ratio.imag)) * np.sign(ratio.imag or 1.0)) if displacement else np.pi / 2
