"""Backbones as single-point forcing finds them: one sensor in quadrature with the force, level after level.

The module has the records of a measurement, and computes the same curves by harmonic balance of the damped, forced
structure. The phase of a sensor and either an amplitude or the force are prescribed, so that response curves follow
from the same equations (`response_curves`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from opid.errors import InputError
from opid.mechanics.backbones.family import laws_of_joints, require_amplitudes
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.law import FloatArray, Law
from opid.mechanics.rig import Shaker
from opid.mechanics.structure import ComplexArray

_SAMPLES = 128
# rate of a joint at which its damping is linear, m/s
_SLOW = 1e-9
# number of frequencies among which quadrature of the linear structure is searched
_N_SCANNED = 6001
# fraction of the largest extension by which a solution may differ from its prediction
_FROM_PREDICTION = 0.05
# smallest step of what is prescribed, as a fraction of it
_LEAST_STEP = 1 / 64

HARMONICS = (1, 3, 5, 7)
"""The harmonics that are balanced where none are named."""

_Prescribed = Literal["amplitude", "force_n", "phase_error_rad"]


@dataclass(frozen=True, eq=False)
class Specimen:
    """A structure with damped modes and nonlinear joints, and a shaker at one of its sensors.

    Args:
        system: the modes of the structure, as its sensors and joints see them.
        laws: one law for each joint; a single `Law` counts for all.
        damping_ratio: (n_modes,) zeta of each mode, or one number for all.
        drive: name of the sensor at which the force acts.
        shaker: None for a force that acts directly; otherwise the feedback moves its armature, and the force is that in
            its stinger. Its amplifier is taken as linear.

    Raises:
        InputError: counts that do not match, damping that is not positive, an unknown sensor, or a shaker that
            distorts.
    """

    system: JointedModes
    laws: Law | Sequence[Law]
    damping_ratio: ArrayLike
    drive: str
    shaker: Shaker | None = None

    def __post_init__(self) -> None:
        n_modes = self.system.n_modes
        damping = np.asarray(self.damping_ratio, dtype=np.float64)
        if damping.shape not in ((), (n_modes,)) or not ((damping > 0.0) & (damping < 1.0)).all():
            raise InputError(
                f"damping_ratio is {self.damping_ratio!r}: give one number between 0 and 1, or {n_modes}, one for each "
                "mode"
            )
        laws_of_joints(self.laws, self.system)
        self.system.sensor(self.drive)
        if self.shaker is not None and self.shaker.second_harmonic:
            raise InputError("the shaker distorts: the feedback takes it as linear, set its second_harmonic to 0")

    @property
    def joint_laws(self) -> tuple[Law, ...]:
        """One law for each joint."""
        return laws_of_joints(self.laws, self.system)

    @cached_property
    def joints_of_laws(self) -> dict[Law, list[int]]:
        """The numbers of the joints that have each law, from 0."""
        return {law: [k for k, own in enumerate(self.joint_laws) if own == law] for law in self.joint_laws}

    @property
    def zeta(self) -> FloatArray:
        """(n_modes,) damping ratios."""
        return np.broadcast_to(np.asarray(self.damping_ratio, dtype=np.float64), (self.system.n_modes,))

    @property
    def modal_damping(self) -> FloatArray:
        """(n_modes,) 2 zeta_i omega_i, 1/s."""
        return 2.0 * self.zeta * np.sqrt(np.maximum(self.system.eigenvalue, 0.0))

    def find_linear_response(self, frequency_hz: ArrayLike) -> ComplexArray:
        """Return the modal coordinates for a unit force at small motions, (..., n_modes), for frequencies (...)."""
        omega = 2.0 * np.pi * np.asarray(frequency_hz, dtype=np.float64)[..., None]
        receptance = 1.0 / (self.system.eigenvalue - omega**2 + 1j * omega * self.modal_damping)
        slow = np.array([law.force(0.0, _SLOW) / _SLOW for law in self.joint_laws])
        damped = np.flatnonzero(slow)
        free = np.asarray(receptance * self.drive_row, dtype=np.complex128)
        if not damped.size:
            return free
        # The dampers of the joints pull back on the motion of the modes without them.
        psi = self.system.at_joints[damped]
        between = np.einsum("ji,...i,ki->...jk", psi, receptance, psi)
        resisting = 1j * omega[..., None] * slow[damped][:, None]
        pulled = resisting * (free @ psi.T)[..., None]
        force = np.linalg.solve(np.eye(damped.size) + resisting * between, pulled)
        return np.asarray(free - receptance * (force[..., 0] @ psi), dtype=np.complex128)

    @property
    def drive_row(self) -> FloatArray:
        """(n_modes,) motion of the drive point for a unit of each modal coordinate, kg^-1/2."""
        return self.system.at_sensors[self.system.sensor(self.drive)]


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
        x = np.asarray(optimize.root(there.residual, predicted, tol=1e-12).x)
        off = np.abs(x - predicted)[:-2].max() / np.abs(predicted[:-2]).max()
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


def solve_linear_start(specimen: Specimen, mode: int, controlled_sensor: str) -> tuple[FloatArray, float]:
    """Return the extension of each joint of `specimen` and the force, N, for 1 m at `controlled_sensor`, linearly.

    Raises:
        InputError: no such mode or sensor, or one of rigid motion, or one without motion there or at the drive point.
    """
    system, column = specimen.system, specimen.system.index(mode)
    row, drive = system.at_sensors[system.sensor(controlled_sensor), column], specimen.drive_row[column]
    eigenvalue = system.eigenvalue[column]
    if eigenvalue <= 0.0:
        raise InputError(f"mode {mode} has {system.frequency_hz[column]:g} Hz: give the number of an elastic mode")
    largest = np.abs(system.at_sensors[:, column]).max()
    for name, value in ((controlled_sensor, row), (specimen.drive, drive)):
        if abs(value) <= 1e-9 * largest:
            raise InputError(f"the sensor {name!r} does not move in mode {mode}: take another one")
    force = specimen.modal_damping[column] * np.sqrt(eigenvalue) / abs(row * drive)
    return system.at_joints[:, column] / abs(row) * np.sign(drive), float(force)


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
        z, ratio, stiffness = self.unpack(x)
        system, specimen = self.specimen.system, self.specimen
        amplitude = self.find_amplitude(x)
        omega = 2.0 * np.pi * self.frequency_hz * ratio * np.array(self.numbers)[:, None]
        held = self._transform_joint_force(amplitude * z, omega[:, 0])
        modal = -held @ system.at_joints
        force = stiffness * self.force_n_per_m * amplitude
        modal[self.numbers.index(1)] += force * specimen.drive_row
        q = modal / (system.eigenvalue - omega**2 + 1j * omega * specimen.modal_damping) / amplitude
        return z - q @ system.at_joints.T, q @ system.at_sensors.T, force

    def _transform_joint_force(self, z: ComplexArray, omega: FloatArray) -> ComplexArray:
        """Return harmonics of the joints' forces, (n_harmonics, n_joints), by sampling one period."""
        wave, weight = _make_waves(self.numbers)
        extension, rate = (wave @ z).real, (wave @ (1j * omega[:, None] * z)).real
        force = np.empty_like(extension)
        for law, joints in self.specimen.joints_of_laws.items():
            force[:, joints] = law.force(extension[:, joints], rate[:, joints])
        return np.asarray(weight @ force, dtype=np.complex128)

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
