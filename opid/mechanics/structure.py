"""A structure: mass, damping and stiffness matrices, and joints that carry nonlinear laws or elements that slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from opid.errors import InputError, nearest
from opid.mechanics.laws.law import LINEAR, FloatArray, TermSet


def read_only(array: ArrayLike | Sequence[float]) -> FloatArray:
    """Return a copy of an array that cannot be written to."""
    copy = np.array(array, dtype=np.float64)
    copy.flags.writeable = False
    return copy


@dataclass(frozen=True, eq=False)
class Sliders:
    """Jenkins elements in parallel: f = sum_i clip(k_i (z - s_i), -slip_i, slip_i).

    The slider at s_i stands still while its spring carries less than slip_i, and is dragged along when it would carry
    more. A joint with sliders has a memory: its force depends on its motion before.

    Args:
        stiffness_n_per_m: (n,) stiffness k of each spring, N/m, positive.
        slip_force_n: (n,) force at which each slider slips, N, positive.

    Raises:
        InputError: counts that differ, none at all, or a value that is not positive and finite.

    >>> pair = Sliders([1e6, 2e6], [5.0, 30.0])
    >>> pair.n, pair.tangent_n_per_m
    (2, 3000000.0)
    """

    stiffness_n_per_m: FloatArray
    slip_force_n: FloatArray

    def __post_init__(self) -> None:
        for name in ("stiffness_n_per_m", "slip_force_n"):
            array = read_only(getattr(self, name))
            if array.ndim != 1 or array.size == 0 or not (np.isfinite(array) & (array > 0.0)).all():
                raise InputError(f"{name} of the sliders is {array}: give one positive number for each of them")
            object.__setattr__(self, name, array)
        if self.stiffness_n_per_m.size != self.slip_force_n.size:
            raise InputError(
                f"there are {self.stiffness_n_per_m.size} stiffnesses and {self.slip_force_n.size} slip forces of "
                "sliders: give one of each for each slider"
            )

    @property
    def n(self) -> int:
        """Number of elements."""
        return self.stiffness_n_per_m.size

    @property
    def tangent_n_per_m(self) -> float:
        """Stiffness with every slider stuck, as at small amplitudes, N/m."""
        return float(self.stiffness_n_per_m.sum())


def force_of(sliders: Sliders, extension: ArrayLike, start: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
    """Return the force (m,) N of sliders through a history of extension, and their positions after it, (n,) m.

    Between two values the extension is taken to move in one direction: give every turning point.

    Args:
        sliders: the elements.
        extension: (m,) history of the extension z, m.
        start: (n,) positions of the sliders before it, m; 0 where left out.

    Raises:
        InputError: a history or positions of the wrong shape.

    >>> force, _ = force_of(Sliders([1e6], [5.0]), [0.0, 4e-6, 1e-5, 8e-6, 0.0])
    >>> force.round(9) + 0.0
    array([ 0.,  4.,  5.,  3., -5.])
    """
    history = np.asarray(extension, dtype=np.float64)
    position = np.zeros(sliders.n) if start is None else np.array(start, dtype=np.float64)
    if history.ndim != 1 or position.shape != (sliders.n,):
        raise InputError(
            f"the extension has shape {history.shape}, the start {position.shape}: give (m,) and ({sliders.n},)"
        )
    force = np.empty(history.size)
    reach = sliders.slip_force_n / sliders.stiffness_n_per_m
    for k, z in enumerate(history):
        position = np.clip(position, z - reach, z + reach)
        force[k] = sliders.stiffness_n_per_m @ (z - position)
    return force, position


def iwan(
    *,
    stiffness_n_per_m: float,
    slip_force_n: float,
    chi: float = -0.5,
    beta: float = 1.0,
    n: int = 40,
    smallest_fraction: float = 1e-3,
) -> Sliders:
    """Return the four-parameter Iwan model of a bolted joint (Segalman, J. Appl. Mech. 72, 2005, pp. 752-760).

    The stiffness of the elements that slip at the displacement phi has the density

        rho(phi) = R phi^chi for 0 < phi < phi_max, plus S delta(phi - phi_max),

    with K_T = (1 + beta) R phi_max^(chi + 1) / (chi + 1), beta = S (chi + 1) / (R phi_max^(chi + 1)) and
    F_S = phi_max K_T (beta + (chi + 1) / (chi + 2)) / (1 + beta). Hence, up to phi_max, the first loading and the
    energy of a cycle of amplitude u

        F(u) = K_T u - R u^(chi + 2) / ((chi + 1) (chi + 2)),   D(u) = 4 R u^(chi + 3) / ((chi + 2) (chi + 3)).

    The density is cut into ranges of equal ratio, and each range becomes one element with the stiffness and the slip
    force of the range. K_T and F_S are therefore exact, and F(u) is exact at the limits of the ranges; D(u) is 1 % off
    at 0.006 of the displacement at which all elements slip, and less above.

    Args:
        stiffness_n_per_m: K_T, with everything stuck, N/m.
        slip_force_n: F_S, at which the whole joint slips, N.
        chi: exponent of the density, above -1 and at most 0; the energy of a cycle grows with the power 3 + chi.
        beta: jump of the slope of F(u) at phi_max, as a fraction of the part of the power law; 0 or more.
        n: number of elements; the last one stands for the delta.
        smallest_fraction: fraction of phi_max below which all slip displacements belong to one element.

    Raises:
        InputError: a value out of range.

    >>> joint = iwan(stiffness_n_per_m=1e7, slip_force_n=800.0)
    >>> round(joint.tangent_n_per_m), round(joint.slip_force_n.sum())
    (10000000, 800)
    """
    if not (0.0 < stiffness_n_per_m < np.inf and 0.0 < slip_force_n < np.inf):
        raise InputError(
            f"the joint has stiffness {stiffness_n_per_m} N/m and slip force {slip_force_n} N: give positive numbers"
        )
    if not (-1.0 < chi <= 0.0 and 0.0 <= beta < np.inf):
        raise InputError(f"chi is {chi}, beta {beta}: give chi above -1 and at most 0, and beta of 0 or more")
    n_ranges = n - (beta > 0.0)
    if n_ranges < 2 or not 0.0 < smallest_fraction < 1.0:
        raise InputError(
            f"n is {n}, smallest_fraction {smallest_fraction}: give 3 elements or more, and a fraction below 1"
        )
    carried = stiffness_n_per_m / (1.0 + beta)
    phi_max = slip_force_n * (1.0 + beta) / (stiffness_n_per_m * (beta + (chi + 1.0) / (chi + 2.0)))
    edges = np.concatenate([[0.0], np.geomspace(smallest_fraction, 1.0, n_ranges)])
    stiffness = carried * np.diff(edges ** (chi + 1.0))
    slip = carried * phi_max * (chi + 1.0) / (chi + 2.0) * np.diff(edges ** (chi + 2.0))
    if beta > 0.0:
        stiffness = np.append(stiffness, beta * carried)
        slip = np.append(slip, beta * carried * phi_max)
    return Sliders(stiffness, slip)


ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Joint:
    """A spring-damper between degrees of freedom with a restoring-force law beside its linear part.

    Its force K z + C z' + f(z, z') plus that of its sliders, z = direction . x, acts on the structure along -direction.

    Args:
        name: the name of the joint.
        direction: (n_dof,) extension of the joint for a unit of each displacement, e.g. (-1, 1).
        stiffness_n_per_m: linear stiffness K, N/m.
        damping_n_s_per_m: linear damping C, N s/m.
        law: nonlinear force f(z, z'), N.
        sliders: elements that slip, beside the law; None if there are none.
    """

    name: str
    direction: FloatArray
    stiffness_n_per_m: float = 0.0
    damping_n_s_per_m: float = 0.0
    law: TermSet = LINEAR
    sliders: Sliders | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", read_only(self.direction))


@dataclass(frozen=True, eq=False)
class Structure:
    """M x'' + C x' + K x + sum over joints of d (K_j z + C_j z' + f_j(z, z') + sliders_j) = force(t), z = d . x.

    Args:
        mass: (n_dof, n_dof) M, kg; symmetric and positive definite.
        damping: (n_dof, n_dof) C without the joints, N s/m; symmetric.
        stiffness: (n_dof, n_dof) K without the joints, N/m; symmetric.
        joints: the joints.
        names: one name for each degree of freedom; "x1", "x2", ... where left out.

    Raises:
        InputError: shapes that do not match, a matrix that is not symmetric, a mass that is not positive.

    >>> pendulum = Structure([[2.0]], [[0.0]], [[8.0]])
    >>> natural_frequencies(pendulum).frequency_hz.round(4)
    array([0.3183])
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    joints: tuple[Joint, ...] = ()
    names: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        for name in ("mass", "damping", "stiffness"):
            object.__setattr__(self, name, _require_symmetric(name, getattr(self, name)))
        n_dof = self.mass.shape[0]
        for name in ("damping", "stiffness"):
            shape = getattr(self, name).shape
            if shape != (n_dof, n_dof):
                raise InputError(
                    f"the {name} matrix has shape {shape}, the mass matrix {self.mass.shape}: give both the same shape"
                )
        if n_dof == 0 or np.linalg.eigvalsh(self.mass)[0] <= 0.0:
            raise InputError("the mass matrix is not positive definite: every motion needs a positive mass")
        object.__setattr__(self, "joints", tuple(self.joints))
        for joint in self.joints:
            if joint.direction.shape != (n_dof,):
                raise InputError(
                    f"the direction of joint {joint.name!r} has shape {joint.direction.shape}: "
                    f"give one number for each of the {n_dof} degrees of freedom"
                )
        names = tuple(self.names) or tuple(f"x{k + 1}" for k in range(n_dof))
        if len(names) != n_dof or len(set(names)) != n_dof:
            raise InputError(f"names are {names}: give {n_dof} different names, one for each degree of freedom")
        object.__setattr__(self, "names", names)

    @property
    def n_dof(self) -> int:
        """Number of degrees of freedom."""
        return self.mass.shape[0]

    def index(self, name: str) -> int:
        """Return the index of the degree of freedom called `name`; InputError names the nearest one."""
        if name not in self.names:
            raise InputError(f"there is no degree of freedom {name!r}: {nearest(name, self.names)}")
        return self.names.index(name)


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of the undamped linear structure, lowest frequency first.

    Attributes:
        frequency_hz: (n_dof,) natural frequencies.
        zeta: (n_dof,) modal damping ratios phi^T C phi / (2 omega), nan for a rigid-body mode.
        shapes: (n_dof, n_dof) mass-normalised shapes, one in each column.
    """

    frequency_hz: FloatArray
    zeta: FloatArray
    shapes: FloatArray


def linear_matrices(structure: Structure) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return M, C, K of a structure with the linear part of its joints, the laws left out, each (n_dof, n_dof).

    Sliders count as springs, because they are stuck at small amplitudes.
    """
    damping, stiffness = structure.damping.copy(), structure.stiffness.copy()
    for joint in structure.joints:
        along = np.outer(joint.direction, joint.direction)
        damping += joint.damping_n_s_per_m * along
        stuck = joint.sliders.tangent_n_per_m if joint.sliders else 0.0
        stiffness += (joint.stiffness_n_per_m + stuck) * along
    return structure.mass.copy(), damping, stiffness


def natural_frequencies(structure: Structure) -> Modes:
    """Return natural frequencies, damping ratios and shapes of the linear structure: (K - omega^2 M) phi = 0.

    Args:
        structure: the structure; its nonlinear laws are left out.

    Raises:
        InputError: a stiffness that is negative along some motion.

    >>> modes = natural_frequencies(Structure(np.eye(2), np.zeros((2, 2)), [[2.0, -1.0], [-1.0, 2.0]]))
    >>> (2 * np.pi * modes.frequency_hz) ** 2
    array([1., 3.])
    """
    mass, damping, stiffness = linear_matrices(structure)
    squares, shapes = linalg.eigh(stiffness, mass)
    # Rounding may put the zero of a rigid-body mode slightly on either side.
    zero = 1e-12 * max(abs(squares[0]), abs(squares[-1]))
    if squares[0] < -zero:
        raise InputError(
            "the stiffness matrix is negative along some motion, so the linear structure is unstable: check its signs"
        )
    omega = np.sqrt(np.where(squares > zero, squares, 0.0))
    modal_damping = np.einsum("ik,ij,jk->k", shapes, damping, shapes)
    zeta = np.full(omega.shape, np.nan)
    np.divide(modal_damping, 2.0 * omega, out=zeta, where=omega > 0.0)
    return Modes(frequency_hz=omega / (2.0 * np.pi), zeta=zeta, shapes=shapes)


def frequency_response(structure: Structure, frequency_hz: ArrayLike) -> ComplexArray:
    """Return the receptance of the linear structure, H = (K + j omega C - omega^2 M)^-1.

    Args:
        structure: the structure; its nonlinear laws are left out.
        frequency_hz: (n,) frequencies, Hz.

    Returns:
        (n, n_dof, n_dof), displacement of the row for unit force on the column, m/N.

    Raises:
        InputError: an undamped resonance falls on one of the frequencies.
    """
    mass, damping, stiffness = linear_matrices(structure)
    omega = 2.0 * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))[:, None, None]
    dynamic_stiffness = stiffness - omega**2 * mass + 1j * omega * damping
    try:
        receptance: ComplexArray = np.linalg.inv(dynamic_stiffness)  # type: ignore[assignment]
    except np.linalg.LinAlgError:
        raise InputError(
            "an undamped resonance falls on one of the frequencies: add damping, or shift the frequency"
        ) from None
    return receptance


def modal_assurance(shapes: ArrayLike, others: ArrayLike | None = None) -> FloatArray:
    """Return the modal assurance criterion |a^H b|^2 / (a^H a b^H b), (n, m), of columns against columns.

    Args:
        shapes: (n_sensors, n), or one shape (n_sensors,); real or complex.
        others: (n_sensors, m) or (n_sensors,); the same as `shapes` where left out (the auto-MAC).

    Raises:
        InputError: another number of sensors.

    >>> modal_assurance([[1.0, 1.0], [1.0, -1.0]]).round(12).tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """
    given = (shapes, shapes if others is None else others)
    first, second = (np.atleast_2d(np.asarray(each).T).T for each in given)
    if first.shape[0] != second.shape[0]:
        raise InputError(
            f"the shapes have {first.shape[0]} and {second.shape[0]} sensors: give both at the same sensors"
        )
    norms = np.outer(np.sum(np.abs(first) ** 2, axis=0), np.sum(np.abs(second) ** 2, axis=0))
    # A shape that is zero has a MAC of 0 with every other.
    return np.abs(first.conj().T @ second) ** 2 / np.where(norms > 0, norms, 1.0)


def _require_symmetric(name: str, matrix: ArrayLike) -> FloatArray:
    array = read_only(matrix)
    if array.ndim != 2 or array.shape[0] != array.shape[1]:
        raise InputError(f"the {name} matrix has shape {array.shape}: give a square matrix")
    if not np.isfinite(array).all() or np.abs(array - array.T).max(initial=0.0) > 1e-9 * np.abs(array).max(initial=0.0):
        raise InputError(
            f"the {name} matrix is not symmetric and finite: correct it, or leave out the parts that are not springs"
        )
    return array
