"""Free periodic motions in the time domain by shooting: what harmonic balance is verified against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.backbones.continuation import ContinuedBackbone
from opid.mechanics.backbones.family import Backbone, laws_of_joints
from opid.mechanics.backbones.harmonic_balance import is_odd, joint_harmonics, period_transform
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.law import FloatArray, Law

MOST_ITERATIONS = 12


@dataclass(frozen=True, eq=False)
class PeriodicMotion:
    """A free motion that repeats itself, from rest at its largest extension.

    Attributes:
        frequency_hz: Hz.
        amplitude: first-harmonic amplitude of the sensor, m.
        displacement: (n_modes,) modal coordinates at the start, m kg^1/2; all velocities are zero there.
        mismatch: what is missing to a motion that repeats itself, as a fraction of its size.
        iterations: of Newton's method.
    """

    frequency_hz: float
    amplitude: float
    displacement: FloatArray
    mismatch: float
    iterations: int


def shoot(
    system: JointedModes,
    law: Law | Sequence[Law],
    curve: Backbone | ContinuedBackbone,
    *,
    point: int,
    relative_tolerance: float = 1e-12,
) -> PeriodicMotion:
    """Return the periodic motion that has the amplitude of one point of a backbone.

    The modal equations are integrated from rest by the Dormand-Prince method of order 8, together with their
    derivatives by the start, over half a period, at whose end all velocities are zero again; under odd laws over a
    quarter, at whose end all displacements are zero. Start and period are moved by Newton's method until this holds and
    the first harmonic of the sensor is the amplitude.

    Args:
        system: the linear structure by its modes.
        law: of all joints, or one for each; springs only.
        curve: the backbone, by harmonic balance, that shooting starts from.
        point: its place in the curve, from 0.
        relative_tolerance: of the integration.

    Raises:
        InputError: a point that is not in the curve or has no solution there.
        NotDeterminedError: Newton's method does not converge from there; `partial` is the last motion.

    >>> from opid.mechanics.backbones.family import backbone
    >>> from opid.mechanics.laws.law import law
    >>> one = JointedModes([100.0], [[1.0]], [[1.0]], ("mass",), ("spring",))
    >>> cubic = law("cubic_stiffness", stiffness_n_per_m3=4e6)
    >>> curve = backbone(one, cubic, mode=1, sensor="mass", amplitude=[2e-3], harmonics=(1, 3, 5, 7, 9))
    >>> bool(abs(shoot(one, cubic, curve, point=0).frequency_hz / curve.frequency_hz[0] - 1.0) < 1e-9)
    True
    """
    if point not in range(curve.amplitude.size) or not curve.converged[point]:
        raise InputError(f"point {point} is not among the converged ones of the {curve.amplitude.size} points")
    laws = laws_of_joints(law, system)
    odd = is_odd([term for each in laws for term in each.terms])
    start, frequency_hz = _start(system, laws, curve, point), float(curve.frequency_hz[point])
    a, target = system.sensor(curve.sensor), float(curve.amplitude[point])
    span_s = (0.25 if odd else 0.5) / frequency_hz
    mismatch, iterations = np.inf, 0
    while iterations < MOST_ITERATIONS:
        iterations += 1
        flight = _fly(system, laws, a, start, span_s, odd, relative_tolerance)
        missing = np.append(flight.missing, flight.amplitude - target)
        jacobian = np.block([
            [flight.by_start, flight.by_span[:, np.newaxis]],
            [flight.amplitude_by_start, flight.amplitude_by_span],
        ])  # fmt: skip
        step = np.linalg.solve(jacobian, missing)
        start, span_s = start - step[:-1], span_s - step[-1]
        before, mismatch = mismatch, float(max(np.abs(step[:-1]).max() / np.abs(start).max(), abs(step[-1]) / span_s))
        # the integration's own error is all that is left
        if mismatch < 1e-12 or (mismatch < 1e-8 and mismatch > 0.1 * before):
            break
    frequency_hz = (0.25 if odd else 0.5) / span_s
    motion = PeriodicMotion(frequency_hz, flight.amplitude, start, mismatch, iterations)
    if not mismatch < 1e-8:
        raise NotDeterminedError(
            f"shooting does not converge from point {point}, {curve.frequency_hz[point]:.5g} Hz and {target:.3g} m: "
            "take a backbone with more harmonics, or a point with a smaller amplitude",
            motion,
        )
    return motion


def _start(system: JointedModes, laws: Sequence[Law], curve: Backbone | ContinuedBackbone, point: int) -> FloatArray:
    """Modal coordinates at time zero of a point of a backbone, the sum of their harmonics."""
    terms = [term for each in laws for term in each.terms]
    force, _ = joint_harmonics(laws, period_transform(terms, curve.harmonics), curve.extension[point])
    at = np.square(curve.harmonics)[:, np.newaxis] * (2 * np.pi * curve.frequency_hz[point]) ** 2
    away = system.eigenvalue - at
    m, a, first = system.index(curve.mode), system.sensor(curve.sensor), curve.harmonics.index(1)
    # the mode itself, near its own resonance, from what the others leave to the sensor
    away[first, m] = np.inf
    motion = np.divide(-force @ system.at_joints, away, out=np.zeros(away.shape), where=away != 0.0)
    motion[first, m] = (curve.amplitude[point] - system.at_sensors[a] @ motion[first]) / system.at_sensors[a, m]
    return motion.sum(axis=0)


@dataclass(frozen=True, eq=False)
class _Flight:
    """What is missing at the end of a quarter or half period, the amplitude, and the derivatives of both."""

    missing: FloatArray
    by_start: FloatArray
    by_span: FloatArray
    amplitude: float
    amplitude_by_start: FloatArray
    amplitude_by_span: float


def _fly(
    system: JointedModes, laws: Sequence[Law], a: int, start: FloatArray, span_s: float, odd: bool, tolerance: float
) -> _Flight:
    from scipy.integrate import solve_ivp

    n, seen = system.n_modes, system.at_sensors[a]
    # displacements are zero at the end of a quarter, velocities over an angular frequency at that of a half
    turn = np.pi / 2 if odd else np.pi
    scale = np.abs(start).max()

    def forces(q: FloatArray) -> tuple[FloatArray, FloatArray]:
        z = system.at_joints @ q
        each = [(one.force(at, 0.0), one.gradient(at, 0.0)[0]) for one, at in zip(laws, z, strict=True)]
        force, slope = np.array(each).reshape(-1, 2).T
        return system.at_joints.T @ force, system.at_joints.T @ (slope[:, np.newaxis] * system.at_joints)

    def rate(tau: float, state: FloatArray) -> FloatArray:
        """By tau = t / span: q, v span, their derivatives by the start, the first harmonic and its derivatives."""
        moved, cosine = state[: 2 * n * (n + 1)].reshape(2, n, n + 1), np.cos(turn * tau)
        force, stiffness = forces(moved[0, :, 0])
        stiffness[np.diag_indices(n)] += system.eigenvalue
        acceleration = -(stiffness @ moved[0])
        acceleration[:, 0] = -system.eigenvalue * moved[0, :, 0] - force
        harmonic = np.append(seen @ moved[0], tau * (seen @ moved[1, :, 0])) * cosine
        return np.concatenate([moved[1].ravel(), span_s**2 * acceleration.ravel(), harmonic])

    first = np.zeros((2, n, n + 1))
    first[0] = np.column_stack([start, np.eye(n) * scale])
    state = np.concatenate([first.ravel(), np.zeros(n + 2)])
    end = solve_ivp(rate, (0.0, 1.0), state, "DOP853", rtol=tolerance, atol=1e-3 * tolerance * scale).y[:, -1]
    moved, harmonic = end[: 2 * n * (n + 1)].reshape(2, n, n + 1), 2.0 * end[2 * n * (n + 1) :]
    force, _ = forces(moved[0, :, 0])
    acceleration = -system.eigenvalue * moved[0, :, 0] - force
    which = 0 if odd else 1
    by_span = moved[1, :, 0] / span_s if odd else span_s * acceleration
    return _Flight(
        missing=moved[which, :, 0],
        by_start=moved[which, :, 1:] / scale,
        by_span=by_span,
        amplitude=float(harmonic[0]),
        amplitude_by_start=harmonic[1 : n + 1] / scale,
        amplitude_by_span=float(harmonic[-1] / span_s),
    )
