"""Harmonic balance: harmonics of forces over a period, and the equations of a backbone, regular at resonances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gamma

from opid.errors import InputError
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.law import FloatArray, Term, TermSet

# power p of the kinds c |z|^(p-1) z; -1 where it is an inner parameter
POWERS = {
    "quadratic_stiffness": 2,
    "cubic_stiffness": 3,
    "quartic_stiffness": 4,
    "quintic_stiffness": 5,
    "signed_power_stiffness": -1,
}
# power of the kinds that are polynomials, whose harmonics a finite sum gives exactly
POLYNOMIALS = {"even_quadratic_stiffness": 2, "cubic_stiffness": 3, "quintic_stiffness": 5}
# extensions at which a law is tried for its symmetry, m
TRIED_M = np.geomspace(1e-6, 1e-1, 21)
# rates at which it is tried for its damping, m/s: a valve may open at high ones only
TRIED_M_PER_S = (0.1, 10.0, 1e3)
# number of times in half a period for laws whose corners may lie anywhere
MANY_TIMES = 256


# ---- harmonics over a period ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Transform:
    """The transform from cosine coefficients to times of a period and back.

    Attributes:
        cosines: (n_harmonics, n_times) cos(h theta).
        weights: (n_harmonics, n_times) weights with which values over time sum up to cosine coefficients.
        angle: (n_times,) angle theta, rad.
    """

    cosines: FloatArray
    weights: FloatArray
    angle: FloatArray


def first_harmonic_factor(power: ArrayLike) -> FloatArray:
    """Return beta_p: the first harmonic of |z|^(p-1) z for z = A cos is beta_p A^p.

    beta_p = 2 / sqrt(pi) Gamma((p + 2) / 2) / Gamma((p + 3) / 2).

    Args:
        power: power p, of any shape.

    >>> first_harmonic_factor([1, 3, 5]).round(12).tolist()
    [1.0, 0.75, 0.625]
    """
    p = np.asarray(power, dtype=np.float64)
    return 2.0 / np.sqrt(np.pi) * gamma((p + 2.0) / 2.0) / gamma((p + 3.0) / 2.0)


def is_odd(terms: Sequence[Term]) -> bool:
    """Return whether every term is an odd function of the extension."""
    at_rest = np.zeros(TRIED_M.size)
    return all(
        np.allclose(term.evaluate(-TRIED_M, at_rest)[0], -term.evaluate(TRIED_M, at_rest)[0], rtol=1e-9, atol=0.0)
        for term in terms
    )


def depends_on_rate(term: Term) -> bool:
    """Return whether the force of a term depends on the rate of the extension."""
    at_rest, *moving = (
        term.evaluate(TRIED_M, np.full(TRIED_M.size, rate))[0] + 0.0 * TRIED_M for rate in (0.0, *TRIED_M_PER_S)
    )
    return not all(np.array_equal(at_rest, each) for each in moving)


def refuse_velocity(terms: Sequence[Term], *, cycles: bool = False) -> None:
    """Refuse terms that are not springs, because a backbone is a free motion that neither grows nor decays.

    Args:
        terms: the terms.
        cycles: whether kinds with memory are taken, by the mean of both directions of their steady cycle.

    Raises:
        InputError: a term depends on the rate.
    """
    for term in terms:
        if cycles and term.kind.cycle is not None:
            continue
        if depends_on_rate(term):
            raise InputError(f"{term.name} depends on the rate of the extension: give springs, which backbones need")


def refuse_held_free_modes(system: JointedModes) -> None:
    """Refuse rigid-body modes that joints extend, because the linear springs do not determine their mean position.

    Raises:
        InputError: there is such a mode.
    """
    size = np.linalg.norm(system.at_joints, axis=0)
    free = np.abs(system.eigenvalue) <= 1e-9 * np.abs(system.eigenvalue).max()
    held = free & (size > 1e-9 * size.max(initial=0.0))
    if held.any():
        raise InputError(
            f"mode {int(np.argmax(held)) + 1} is only held by the laws of the joints, which are not odd, so its mean "
            "position is not known: give the joints some linear stiffness"
        )


def harmonics_of(terms: Sequence[Term], harmonics: Sequence[int]) -> tuple[int, ...]:
    """Return the harmonics in order; where all `terms` are odd, the even ones are zero and left out.

    Raises:
        InputError: harmonics that are not whole numbers, twice the same, without 1, or without 0 for a law that is not
            odd; a kind with memory in such a law.
    """
    asked = tuple(harmonics)
    if not asked or any(h != int(h) or h < 0 for h in asked) or len(set(asked)) < len(asked) or 1 not in asked:
        raise InputError(f"the harmonics are {asked}: give different whole numbers from 0 up, 1 among them")
    ordered = tuple(sorted(int(h) for h in asked))
    if is_odd(terms):
        return tuple(h for h in ordered if h % 2)
    names = "+".join(dict.fromkeys(term.name for term in terms))
    if any(term.kind.memory is not None for term in terms):
        raise InputError(
            f"{names} is not odd and has a memory, whose cycle about a mean is not known: give odd laws beside it"
        )
    if 0 not in ordered:
        raise InputError(
            f"{names} is not odd, so its force has a mean and even harmonics: give harmonics such as (0, 1, 2)"
        )
    return ordered


def period_transform(terms: Sequence[Term], harmonics: tuple[int, ...]) -> Transform:
    """Return times and weights with which polynomials are transformed exactly, and |z| z nearly so.

    A motion of odd harmonics under odd laws repeats itself in every quarter of the period, and its extensions are zero
    where quarters meet, so Gauss points in a quarter are as good for |z| z as for polynomials.
    """
    names = {term.name for term in terms}
    powers = [POLYNOMIALS.get(name, POWERS.get(name, 3)) for name in names]
    highest = (max(powers, default=1) + 1) * max(harmonics)
    polynomial = names <= set(POLYNOMIALS)
    if 0 in harmonics:
        n = highest // 2 + 1 if polynomial else MANY_TIMES + 4 * max(harmonics)
        angle, weight = np.pi * (np.arange(n) + 0.5) / n, np.full(n, 1.0 / n)
    elif polynomial:
        n = highest // 4 + 1
        angle, weight = np.pi / 2 * (np.arange(n) + 0.5) / n, np.full(n, 1.0 / n)
    else:
        smooth = set(POWERS) - {"signed_power_stiffness"}
        bent = {term.name for term in terms if term.kind.cycle is not None or term.name == "late_cubic_stiffness"}
        # Where all sliders slip, and at a knot, the force bends without a step: with twenty points more the error of
        # the eigenvalue is a few millionths.
        n = int(0.4 * highest) + (10 if names <= smooth else 20 if names <= smooth | bent else 64)
        node, weight = np.polynomial.legendre.leggauss(n)
        angle, weight = np.pi / 4 * (node + 1.0), weight / 2.0
    return transform_at(angle, weight, harmonics)


def transform_at(angle: FloatArray, weight: FloatArray, harmonics: tuple[int, ...]) -> Transform:
    """Return the transform with given times, `angle`; a sum over them with `weight` is the mean over a period."""
    cosines = np.cos(np.outer(harmonics, angle))
    double = np.where(np.array(harmonics) == 0, 1.0, 2.0)
    return Transform(cosines, double[:, np.newaxis] * weight * cosines, angle)


def joint_harmonics(
    laws: Sequence[TermSet], transform: Transform, extension: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the harmonics of the joints' forces, (n_harmonics, n_joints) N, and their slopes.

    The slopes by the harmonics of the extensions are (n_joints, n_harmonics, n_harmonics), N/m.

    Args:
        laws: one law for each joint.
        transform: transform from harmonics to times of a period.
        extension: (n_harmonics, n_joints) cosine coefficients of the extensions, m.
    """
    z = transform.cosines.T @ extension
    force, stiffness = np.empty(z.shape), np.empty(z.shape)
    for each in dict.fromkeys(laws):
        its = [joint for joint, one in enumerate(laws) if one == each]
        force[:, its], stiffness[:, its] = each.force(z[:, its], 0.0), each.gradient(z[:, its], 0.0)[0]
    slopes = np.einsum("ht,tj,gt->jhg", transform.weights, stiffness, transform.cosines)
    return transform.weights @ force, slopes


# ---- the equations of a backbone -----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Balance:
    """The equations of a backbone with the extensions z_h, some modal coordinates and the eigenvalue as unknowns.

    Modes near resonance in a harmonic keep their coordinate in that harmonic, (l_i - h^2 l) q_ih + psi_i^T F_h = 0, so
    that the equations stay regular where l = l_i / h^2; all others are condensed on the joints.

    Attributes:
        system: the linear structure by its modes.
        laws: one law for each joint.
        harmonics: harmonics of the motion.
        transform: transform from harmonics to times of a period.
        mode: column of the mode.
        sensor: row of the sensor.
        explicit: (n_harmonics, n_modes) whether a mode keeps its coordinate in a harmonic.
    """

    system: JointedModes
    laws: tuple[TermSet, ...]
    harmonics: tuple[int, ...]
    transform: Transform
    mode: int
    sensor: int
    explicit: NDArray[np.bool_]

    @property
    def n_joint_unknowns(self) -> int:
        """Number of harmonics of all extensions, which are the first unknowns."""
        return len(self.harmonics) * len(self.laws)

    @property
    def size(self) -> int:
        """Number of unknowns: the extensions, harmonic by harmonic, the coordinates kept, the eigenvalue."""
        return self.n_joint_unknowns + int(self.explicit.sum()) + 1


def balance(
    system: JointedModes, laws: Sequence[TermSet], *, mode: int, sensor: str, harmonics: Sequence[int]
) -> Balance:
    """Return the equations of the backbone of a mode at prescribed amplitudes of a sensor.

    Args:
        system: the linear structure by its modes.
        laws: one law for each joint; springs only.
        mode: number of the mode, from 1.
        sensor: name of the sensor.
        harmonics: harmonics of the motion, see `harmonics_of`.

    Raises:
        InputError: an unknown mode or sensor, impossible harmonics, or a law of the rate.
    """
    terms = [term for each in laws for term in each.terms]
    refuse_velocity(terms)
    used = harmonics_of(terms, harmonics)
    m = system.index(mode)
    moved = np.abs(system.at_joints).max(axis=0, initial=0.0) > 1e-9 * np.abs(system.at_joints).max(initial=0.0)
    at = np.square(used)[:, np.newaxis] * system.eigenvalue[m]
    # Near modes lie within an octave of the harmonic; in harmonic 0 the rigid-body modes are near.
    near = (system.eigenvalue > at / 4.0) & (system.eigenvalue < 4.0 * at)
    free = (np.array(used) == 0)[:, np.newaxis] & (np.abs(system.eigenvalue) <= 1e-9 * system.eigenvalue.max())
    explicit = (near | free) & moved
    explicit[used.index(1), m] = True
    return Balance(system, tuple(laws), used, period_transform(terms, used), m, system.sensor(sensor), explicit)


def linear_unknowns(equations: Balance, amplitude: float) -> FloatArray:
    """Return the unknowns of `equations` in the linear mode, at an `amplitude` of the sensor, m."""
    system, m, first = equations.system, equations.mode, equations.harmonics.index(1)
    q = amplitude / system.at_sensors[equations.sensor, m]
    extension = np.zeros((len(equations.harmonics), len(equations.laws)))
    extension[first] = system.at_joints[:, m] * q
    coordinates = np.zeros(equations.explicit.shape)
    coordinates[first, m] = q
    return np.concatenate([extension.ravel(), coordinates[equations.explicit], system.eigenvalue[[m]]])


def residual(equations: Balance, unknowns: FloatArray, amplitude: float) -> tuple[FloatArray, FloatArray]:
    """Return the values of `equations` and their exact Jacobian, (size,) and (size, size); the last is the sensor's.

    They are those for `unknowns`, (size,), at an `amplitude` of the sensor, m, by which the last equation has the slope
    -1, the others 0.
    """
    system, n = equations.system, equations.n_joint_unknowns
    n_joints, at = len(equations.laws), unknowns[-1]
    extension = unknowns[:n].reshape(-1, n_joints)
    force, slopes = joint_harmonics(equations.laws, equations.transform, extension)
    value, jacobian = np.zeros(equations.size), np.zeros((equations.size, equations.size))
    value[:n], jacobian[:n, :n] = unknowns[:n], np.eye(n)
    value[-1] = -amplitude
    first = n
    for k, h in enumerate(equations.harmonics):
        rows = slice(k * n_joints, (k + 1) * n_joints)
        kept = equations.explicit[k]
        own = slice(first, first + int(kept.sum()))
        first = own.stop
        psi, away = system.at_joints[:, kept], system.eigenvalue[kept] - h**2 * at
        others, seen = system.at_joints[:, ~kept], system.at_sensors[equations.sensor]
        receptance = 1.0 / (system.eigenvalue[~kept] - h**2 * at)
        # These matrices take forces of this harmonic to its extensions, coordinates (over the eigenvalue) and sensor.
        condensed, pushed, sensed = (others * receptance) @ others.T, psi.T / at, -(seen[~kept] * receptance) @ others.T
        value[rows] += condensed @ force[k] - psi @ unknowns[own]
        value[own] = away / at * unknowns[own] + pushed @ force[k]
        jacobian[rows, own], jacobian[own, own] = -psi, np.diag(away / at)
        jacobian[rows, -1] = (others * h**2 * receptance**2) @ (others.T @ force[k])
        jacobian[own, -1] = -system.eigenvalue[kept] / at**2 * unknowns[own] - pushed @ force[k] / at
        for g in range(len(equations.harmonics)):
            columns = slice(g * n_joints, (g + 1) * n_joints)
            jacobian[rows, columns] += condensed * slopes[:, k, g]
            jacobian[own, columns] = pushed * slopes[:, k, g]
            if h == 1:
                jacobian[-1, columns] = sensed * slopes[:, k, g]
        if h == 1:
            value[-1] += seen[kept] @ unknowns[own] + sensed @ force[k]
            jacobian[-1, own] = seen[kept]
            jacobian[-1, -1] = -(seen[~kept] * receptance**2) @ (others.T @ force[k])
    return value, jacobian


def modal_motion(equations: Balance, unknowns: FloatArray) -> FloatArray:
    """Return the cosine coefficients of all modal coordinates, (n_harmonics, n_modes) m kg^1/2."""
    system, n = equations.system, equations.n_joint_unknowns
    force, _ = joint_harmonics(equations.laws, equations.transform, unknowns[:n].reshape(-1, len(equations.laws)))
    away = system.eigenvalue - np.square(equations.harmonics)[:, np.newaxis] * unknowns[-1]
    # A rigid-body mode that no joint moves stands still in harmonic 0.
    motion = np.divide(-force @ system.at_joints, away, out=np.zeros(away.shape), where=away != 0.0)
    motion[equations.explicit] = unknowns[n:-1]
    return motion


def solve_at(equations: Balance, start: FloatArray, amplitude: float) -> FloatArray | None:
    """Return the unknowns of `equations` at a prescribed `amplitude`, m, by Newton's method from a `start`, (size,).

    None where it does not converge.
    """
    unknowns = start.copy()
    for _ in range(15):
        value, jacobian = residual(equations, unknowns, amplitude)
        try:
            step = np.linalg.solve(jacobian, value)
        except np.linalg.LinAlgError:
            return None
        unknowns -= step
        if not 0.0 < unknowns[-1] < 10.0 * start[-1]:
            return None
        small = 1e-9 * np.abs(unknowns[:-1]).max()
        if np.abs(step[:-1]).max() <= small and abs(step[-1]) <= 1e-9 * unknowns[-1]:
            return unknowns
    return None
