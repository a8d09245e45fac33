"""A structure: mass, damping and stiffness matrices, and joints that carry nonlinear laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from opid.errors import InputError, nearest
from opid.mechanics.hysteresis import Sliders
from opid.mechanics.laws.law import LINEAR, FloatArray, Law

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Joint:
    """A spring-damper between degrees of freedom with a restoring-force law beside its linear part.

    The joint force K z + C z' + f(z, z') + that of its sliders, z = direction . x, pulls the structure by -direction
    times it.

    Args:
        name: what the joint is called.
        direction: (n_dof,), the extension of the joint for a unit of each displacement, e.g. (-1, 1).
        stiffness_n_per_m: linear stiffness K, N/m.
        damping_n_s_per_m: linear damping C, N s/m.
        law: nonlinear force f(z, z'), N.
        sliders: elements that slip, beside the rest; None for none.
    """

    name: str
    direction: FloatArray
    stiffness_n_per_m: float = 0.0
    damping_n_s_per_m: float = 0.0
    law: Law = LINEAR
    sliders: Sliders | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", _read_only(self.direction))


@dataclass(frozen=True, eq=False)
class Structure:
    """M x'' + C x' + K x + sum over joints of d (K_j z + C_j z' + f_j(z, z') + sliders_j) = force(t), z = d . x.

    Args:
        mass: (n_dof, n_dof) M, kg; symmetric and positive definite.
        damping: (n_dof, n_dof) C, N s/m, of everything that is no joint; symmetric.
        stiffness: (n_dof, n_dof) K, N/m, of everything that is no joint; symmetric.
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
            object.__setattr__(self, name, _symmetric(name, getattr(self, name)))
        n_dof = self.mass.shape[0]
        for name in ("damping", "stiffness"):
            shape = getattr(self, name).shape
            if shape != (n_dof, n_dof):
                raise InputError(f"the {name} matrix has shape {shape}, the mass matrix {self.mass.shape}")
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
            raise InputError(f"names are {names}: give {n_dof} different names, one a degree of freedom")
        object.__setattr__(self, "names", names)

    @property
    def n_dof(self) -> int:
        """Number of degrees of freedom."""
        return self.mass.shape[0]

    def index(self, name: str) -> int:
        """Index of the degree of freedom called `name`; InputError names the nearest one."""
        if name not in self.names:
            raise InputError(f"there is no degree of freedom {name!r}: {nearest(name, self.names)}")
        return self.names.index(name)


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of the undamped linear structure, lowest frequency first.

    Attributes:
        frequency_hz: (n_dof,) natural frequencies.
        zeta: (n_dof,) modal damping ratios phi^T C phi / (2 omega), nan for a rigid-body mode.
        shapes: (n_dof, n_dof), one mass-normalised shape a column.
    """

    frequency_hz: FloatArray
    zeta: FloatArray
    shapes: FloatArray


def linear_matrices(structure: Structure) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return M, C, K of a structure with the linear part of its joints, the laws left out, each (n_dof, n_dof).

    Sliders count as springs: they are stuck at small amplitudes.
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
    # rounding leaves the zero of a rigid-body mode slightly on either side
    zero = 1e-12 * max(abs(squares[0]), abs(squares[-1]))
    if squares[0] < -zero:
        raise InputError("the stiffness matrix is negative along some motion: the linear structure is unstable")
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
        raise InputError("an undamped resonance falls on a frequency asked for: add damping or shift it") from None
    return receptance


def linear_transmissibility(
    structure: Structure, frequency_hz: ArrayLike, *, response: str, reference: str, load: str
) -> ComplexArray:
    """Return T = X_response / X_reference of the linear structure under a force on `load`, (n,).

    Args:
        structure: the structure; its nonlinear laws are left out.
        frequency_hz: (n,) frequencies, Hz.
        response: name of the degree of freedom in the numerator.
        reference: name of the degree of freedom in the denominator.
        load: name of the degree of freedom on which the only force acts.

    >>> free = Structure(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), (Joint("strut", (-1, 1), 40.0, 1.0),))
    >>> T = linear_transmissibility(free, [0.001], response="x2", reference="x1", load="x1")
    >>> abs(T).round(4)
    array([1.])
    """
    receptance = frequency_response(structure, frequency_hz)[:, :, structure.index(load)]
    return receptance[:, structure.index(response)] / receptance[:, structure.index(reference)]


def _read_only(array: ArrayLike | Sequence[float]) -> FloatArray:
    copy = np.array(array, dtype=np.float64)
    copy.flags.writeable = False
    return copy


def _symmetric(name: str, matrix: ArrayLike) -> FloatArray:
    array = _read_only(matrix)
    if array.ndim != 2 or array.shape[0] != array.shape[1]:
        raise InputError(f"the {name} matrix has shape {array.shape}: give a square matrix")
    if not np.isfinite(array).all() or np.abs(array - array.T).max(initial=0.0) > 1e-9 * np.abs(array).max(initial=0.0):
        raise InputError(f"the {name} matrix is not symmetric and finite: mend it or split off what is not a spring")
    return array
