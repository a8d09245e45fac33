"""A shaker under feedback: the signal that the feedback reads, its gains, the closed loop, and its records."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy import optimize

from opid.errors import InputError
from opid.mechanics.backbones.specimen import Specimen
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.response import Assembled, State, advance, assemble
from opid.mechanics.rig import find_harmonics, on_shaker
from opid.mechanics.structure import ComplexArray, Joint, Structure, linear_matrices

STEP = 2.0
"""Phase of the fastest pole in a time step, rad: Runge-Kutta 4 stays bounded below 2.8, and exact for slow motion."""

# price of a weight on a sensor beside that of damping in other modes; it keeps the weights small
_WEIGHT_PRICE = 1e-3


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A structure under the feedback u = p (x* - x) + d (x*' - x'), ready for time steps.

    Its degrees of freedom are the modal coordinates, then the armature of the shaker, if there is one. The feedback is
    a joint; the input of the structure is p x* + d x*'.

    Args:
        ready: the structure with the feedback.
        sensors: (n_sensors, n_dof) readings of the sensors for a unit of each coordinate.
        reading: (n_dof,) reading x of the feedback for a unit of each coordinate.
        gains: gains p, N/m, and d, N s/m.
        force: (n_dof,) stiffness and damping rows of the stinger, whose force acts on the structure; None where the
            control is that force.
        fastest_rad_s: magnitude of the fastest pole, rad/s.
    """

    ready: Assembled
    sensors: FloatArray
    reading: FloatArray
    gains: tuple[float, float]
    force: tuple[FloatArray, FloatArray] | None
    fastest_rad_s: float


@dataclass(frozen=True)
class ReadingNoise:
    """White noise, independent in each sample and channel; by default none.

    Args:
        acceleration_m_per_s2: rms of the accelerometers, m/s^2.
        force_n: rms of the force cell, N.
        control_n: rms of the force that the feedback's own noise adds, N; it shakes the structure.

    Raises:
        InputError: a number below 0.
    """

    acceleration_m_per_s2: float = 0.0
    force_n: float = 0.0
    control_n: float = 0.0

    def __post_init__(self) -> None:
        for each in fields(self):
            if not 0.0 <= getattr(self, each.name) < np.inf:
                raise InputError(f"{each.name} of the noise is {getattr(self, each.name)}: give 0 or more")


@dataclass(frozen=True, eq=False)
class Record:
    """Harmonics of the mean of some periods.

    Args:
        force: (n,) harmonics of the force on the structure, N.
        sensors: (n_sensors, n) harmonics of the displacements, m.
        control: (n + 1,) harmonics of the control, its mean first, N.
        n_periods: number of periods that were averaged.
    """

    force: ComplexArray
    sensors: ComplexArray
    control: ComplexArray
    n_periods: int


def close_loop(
    specimen: Specimen, mode: int, *, damping_ratio: float, stiffness_fraction: float = 0.0, modal_filter: bool = True
) -> ClosedLoop:
    """Return a structure on its shaker under a feedback that holds one mode.

    The gain on the velocity adds the damping ratio to the mode, and that on the displacement raises its frequency by
    the fraction; the feedback reads the mode through `design_reading`, or the drive point alone. InputError: the linear
    structure is unstable under it.
    """
    system, point, column = specimen.system, specimen.drive_row, specimen.system.index(mode)
    n = system.n_modes
    pairs = zip(system.joints, system.at_joints, specimen.joint_laws, strict=True)
    joints = tuple(Joint(name, row, law=law) for name, row, law in pairs)
    structure = Structure(np.eye(n), np.diag(specimen.modal_damping), np.diag(system.eigenvalue), joints)
    reading = design_reading(specimen, mode) if modal_filter else point
    gains = _choose_gains(specimen, column, reading, damping_ratio, stiffness_fraction, modal_filter)
    acting, sensors, force = point, system.at_sensors, None
    if specimen.shaker is not None:
        structure = on_shaker(structure, specimen.shaker, point)
        stinger = structure.joints[-1]
        force = (stinger.stiffness_n_per_m * stinger.direction, stinger.damping_n_s_per_m * stinger.direction)
        acting = np.append(np.zeros(n), 1.0)
        reading, sensors = np.append(reading, 0.0), np.pad(sensors, ((0, 0), (0, 1)))
    poles = _find_poles(structure, acting, reading, gains)
    if poles.real.max() > 0.0:
        at_hz = np.abs(poles[np.argmax(poles.real)]) / (2.0 * np.pi)
        raise InputError(
            f"the feedback makes the structure unstable, near {at_hz:.3g} Hz: make it weaker than a damping ratio of "
            f"{damping_ratio:g} and {stiffness_fraction:.2%} of its frequency"
        )
    looped = replace(structure, joints=(*structure.joints, Joint("feedback", reading, *gains)))
    ready = _act_at(assemble(looped, acting[:, None]), np.linalg.inv(structure.mass) @ acting)
    return ClosedLoop(ready, sensors, reading, gains, force, float(np.abs(poles).max()))


def design_reading(specimen: Specimen, mode: int) -> FloatArray:
    """Return the reading of a filter over all sensors for a unit of each modal coordinate, (n_modes,) kg^-1/2.

    The filter reads the drive point's motion in the mode, moves with the drive point in every other mode (otherwise the
    feedback would excite that mode), and adds as little damping to them as it can with weights that are not too large:
    a linear programme. The drive point alone is one of its candidates, so there is always an answer.
    """
    shapes, row, column = specimen.system.at_sensors, specimen.drive_row, specimen.system.index(mode)
    damped = np.delete(shapes * row, column, axis=1) / row[column] ** 2
    both = np.concatenate([damped, -damped])
    found = optimize.linprog(
        both.sum(axis=1) + _WEIGHT_PRICE * np.abs(shapes[:, column]).max() / abs(row[column]),
        A_ub=-both.T,
        b_ub=np.zeros(both.shape[1]),
        A_eq=np.concatenate([shapes[:, column], -shapes[:, column]])[None, :],
        b_eq=[row[column]],
    )
    if not found.success:
        return row
    plus, minus = found.x.reshape(2, -1)
    return (plus - minus) @ shapes


def record_periods(
    loop: ClosedLoop,
    state: State,
    target: ComplexArray,
    *,
    frequency_hz: float,
    n_periods: int,
    samples_per_period: int,
    noise: ReadingNoise,
    rng: np.random.Generator,
) -> tuple[Record, State]:
    """Run whole periods of the drive, each from phase zero; return their mean and the state after them.

    The target holds harmonics of the reading of the feedback, (n_harmonics + 1,) m, the mean first. The bench is
    sampled in step with its drive. InputError: the motion grows beyond bounds.
    """
    n, omega = samples_per_period, 2.0 * np.pi * frequency_hz
    fs = n * frequency_hz
    steps = int(np.ceil(loop.fastest_rad_s / (STEP * fs)))
    p, d = loop.gains
    h = np.arange(target.size)
    half_steps = np.exp(2j * np.pi / (2 * n * steps) * np.outer(np.arange(2 * n * steps), h))
    wave = (half_steps @ ((p + 1j * h * omega * d) * target)).real
    drive = np.append(np.tile(wave, n_periods), wave[0])
    if noise.control_n:
        drive[:-1] += noise.control_n * np.repeat(rng.standard_normal(n * n_periods), 2 * steps)
    motion, after = advance(loop.ready, state, drive[:, None], fs=fs, steps_per_sample=steps)

    def average(series: FloatArray) -> FloatArray:
        return series[:-1].reshape(n_periods, n, -1).mean(axis=0)

    x, v, a = average(motion.displacement), average(motion.velocity), average(motion.acceleration)
    control = average(drive[:: 2 * steps, None])[:, 0] - p * (x @ loop.reading) - d * (v @ loop.reading)
    force = control if loop.force is None else x @ loop.force[0] + v @ loop.force[1]
    # The mean over the periods has less noise than each sample.
    shrunk = 1.0 / np.sqrt(n_periods)
    force = force + shrunk * noise.force_n * rng.standard_normal(n)
    acceleration = a @ loop.sensors.T
    acceleration += shrunk * noise.acceleration_m_per_s2 * rng.standard_normal(acceleration.shape)
    displacement = -find_harmonics(acceleration, target.size - 1)[1:] / (h[1:, None] * omega) ** 2
    found = find_harmonics(np.column_stack([force, control]), target.size - 1)
    return Record(found[1:, 0], displacement.T, found[:, 1], n_periods), after


def compute_phase_noise(
    record: Record, column: int, noise: ReadingNoise, frequency_hz: float, samples_per_period: int
) -> float:
    """Return the standard deviation of the phase between force and the sensor of a column in a record, radians.

    The noise of the control counts like that of the force, as the response lags behind it.

    >>> record = Record(np.array([1.0]), np.array([[1e-3]]), np.zeros(2), 50)
    >>> round(compute_phase_noise(record, 0, ReadingNoise(force_n=0.1), 15.0, 64), 5)
    0.0025
    """
    of_motion = noise.acceleration_m_per_s2 / ((2.0 * np.pi * frequency_hz) ** 2 * abs(record.sensors[column, 0]))
    of_force = np.hypot(noise.force_n, noise.control_n) / abs(record.force[0])
    return float(np.hypot(of_motion, of_force) * np.sqrt(2.0 / (record.n_periods * samples_per_period)))


def _choose_gains(
    specimen: Specimen,
    column: int,
    reading: FloatArray,
    damping_ratio: float,
    stiffness_fraction: float,
    modal_filter: bool,
) -> tuple[float, float]:
    """Return the gains on displacement, N/m, and velocity, N s/m, that add stiffness and damping to the mode.

    At the drive point itself the residual receptance R of the other modes turns the feedback k = p + j w d into
    k / (1 + k R) on the mode: beyond |k R| = 1 it would hold the point like a support, and damp less.
    """
    system, row = specimen.system, specimen.drive_row
    omega = 2.0 * np.pi * system.frequency_hz[column]
    modal = omega / (row[column] * reading[column])
    gains = 2.0 * stiffness_fraction * omega * modal, 2.0 * damping_ratio * modal
    if not modal_filter:
        others = np.delete(np.arange(system.n_modes), column)
        residual = np.abs(np.sum(row[others] ** 2 / (system.eigenvalue[others] - omega**2)))
        most = 1.0 / max(residual, np.finfo(float).tiny)
        gains = min(gains[0], most), min(gains[1], most / omega)
    return float(gains[0]), float(gains[1])


def _find_poles(
    structure: Structure, acting: FloatArray, reading: FloatArray, gains: tuple[float, float]
) -> FloatArray:
    """Return the poles of the linear structure with a feedback that acts at one point and reads another, rad/s."""
    mass, damping, stiffness = linear_matrices(structure)
    stiffness, damping = (m + g * np.outer(acting, reading) for m, g in zip((stiffness, damping), gains, strict=True))
    lower = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    return np.linalg.eigvals(np.vstack([np.hstack([np.zeros_like(mass), np.eye(len(mass))]), lower]))


def _act_at(ready: Assembled, load: FloatArray) -> Assembled:
    """Let the last joint, the feedback, act on the drive point instead of the point that it reads."""
    directions, spans, linear, loads, *others = ready.joints
    spans, loads = spans.copy(), loads.copy()
    loads[-1], spans[-1, 2:4] = load, (0, load.size)
    return replace(ready, joints=(directions, spans, linear, loads, *others))
