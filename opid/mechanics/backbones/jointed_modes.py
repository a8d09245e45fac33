"""A linear undamped structure by its modes, as its sensors and its nonlinear joints see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from opid.errors import InputError, nearest
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.structure import read_only


@dataclass(frozen=True, eq=False)
class JointedModes:
    """Mass-normalised modes q_i'' + lambda_i q_i + psi_i^T F = 0, x = Phi q at the sensors, z = Psi q at the joints.

    Args:
        eigenvalue: (n_modes,) lambda_i = omega_i^2, 1/s^2, ascending.
        at_sensors: (n_sensors, n_modes) shapes at the sensors, kg^-1/2.
        at_joints: (n_joints, n_modes) extension of each joint for a unit of each modal coordinate, kg^-1/2.
        sensors: names of the sensors.
        joints: names of the joints.

    Raises:
        InputError: counts that do not match, values that are not finite, or a name given twice.
    """

    eigenvalue: FloatArray
    at_sensors: FloatArray
    at_joints: FloatArray
    sensors: tuple[str, ...]
    joints: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in ("eigenvalue", "at_sensors", "at_joints"):
            array = read_only(getattr(self, name))
            if not np.isfinite(array).all():
                raise InputError(f"{name} has values that are not finite: correct the matrices from which they come")
            object.__setattr__(self, name, array)
        for name in ("sensors", "joints"):
            names = tuple(getattr(self, name))
            object.__setattr__(self, name, names)
            if len(set(names)) < len(names):
                raise InputError(f"{name} are {names}: give each a name of its own")
            shape = getattr(self, f"at_{name}").shape
            if shape != (len(names), self.eigenvalue.size):
                raise InputError(
                    f"at_{name} has shape {shape}: give {(len(names), self.eigenvalue.size)}, one row for each of the "
                    f"{len(names)} {name} and one column for each of the {self.eigenvalue.size} modes"
                )

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return self.eigenvalue.size

    @property
    def frequency_hz(self) -> FloatArray:
        """(n_modes,) natural frequencies, Hz."""
        return np.sqrt(np.maximum(self.eigenvalue, 0.0)) / (2 * np.pi)

    def sensor(self, name: str) -> int:
        """Return the row of the sensor called `name`; InputError names the nearest one."""
        if name not in self.sensors:
            raise InputError(f"there is no sensor {name!r}: {nearest(name, self.sensors)}")
        return self.sensors.index(name)

    def index(self, mode: int) -> int:
        """Return the index of a mode, which users count from 1; InputError outside the modes."""
        if mode not in range(1, self.n_modes + 1):
            raise InputError(f"there is no mode {mode}: give a number from 1 to {self.n_modes}")
        return int(mode) - 1

    def extension_over(self, mode: int, sensor: str) -> float:
        """Return the largest extension of a joint in a linear mode over the motion of a sensor; inf where it rests."""
        column = self.index(mode)
        moved = abs(float(self.at_sensors[self.sensor(sensor), column]))
        extended = float(np.abs(self.at_joints[:, column]).max(initial=0.0))
        return extended / moved if moved > 0 else np.inf


def jointed_modes(
    mass: ArrayLike,
    stiffness: ArrayLike,
    *,
    sensor_rows: ArrayLike,
    joint_rows: ArrayLike,
    sensors: tuple[str, ...],
    joints: tuple[str, ...],
) -> JointedModes:
    """Return all modes of a small structure (a reduced one), (K - lambda M) phi = 0.

    Args:
        mass: (n_dof, n_dof) mass matrix, kg, symmetric and positive definite.
        stiffness: (n_dof, n_dof) stiffness matrix, N/m, symmetric, with the joints' linear part.
        sensor_rows: (n_sensors, n_dof) reading of each sensor for unit motion of each degree of freedom.
        joint_rows: (n_joints, n_dof) extension of each joint for unit motion of each degree of freedom.
        sensors: names of the sensors.
        joints: names of the joints.

    Raises:
        InputError: a mass that is not positive definite, or anything that `JointedModes` refuses.

    >>> two = jointed_modes(np.eye(2), [[2.0, -1.0], [-1.0, 2.0]], sensor_rows=np.eye(2), joint_rows=[[-1.0, 1.0]],
    ...                     sensors=("a", "b"), joints=("link",))
    >>> two.eigenvalue.round(12).tolist()
    [1.0, 3.0]
    """
    try:
        eigenvalue, shapes = linalg.eigh(np.asarray(stiffness, dtype=np.float64), np.asarray(mass, dtype=np.float64))
    except linalg.LinAlgError:
        raise InputError("the mass matrix is not positive definite: every motion needs a positive mass") from None
    return JointedModes(eigenvalue, np.asarray(sensor_rows) @ shapes, np.asarray(joint_rows) @ shapes, sensors, joints)
