"""An electrodynamic shaker with a voltage amplifier, and a structure hung on it by a stinger."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.laws.law import FloatArray
from opid.mechanics.structure import Joint, Structure

ARMATURE, STINGER = "armature", "stinger"


@dataclass(frozen=True)
class Shaker:
    """A modal shaker with a voltage amplifier; by default one of 450 N (100 lbf).

    The coil's current (V - Bl v) / R makes the force (Bl/R) V - (Bl)^2/R v on the armature, v its velocity: seen from
    the structure the amplifier's voltage is a force, and the back-EMF a damper. The coil's inductance is left out (it
    matters above some kHz). The amplifier and the flux distort the voltage,

        F = (Bl/R) (V + 2 h V^2 / V_full),

    so that a sine of amplitude V_full has a second harmonic of h times its fundamental, and one of half the amplitude
    half that fraction: distortion grows with the amplitude, whatever hangs on the shaker.

    Args:
        armature_kg: moving mass, kg.
        suspension_n_per_m: stiffness that centres the armature, N/m.
        suspension_n_s_per_m: its damping, N s/m.
        back_emf_n_s_per_m: (Bl)^2 / R, N s/m.
        force_per_volt_n: Bl / R, N/V.
        stinger_n_per_m: axial stiffness of the stinger with the force cell, N/m.
        stinger_n_s_per_m: its damping, N s/m.
        second_harmonic: h, fraction of the second harmonic at the full voltage; 0 for none.
        full_voltage_v: V_full, amplitude of the voltage at full force, V.

    Raises:
        InputError: a mass, stinger, gain or full voltage that is not positive, or another value below 0.
    """

    armature_kg: float = 0.45
    suspension_n_per_m: float = 6e3
    suspension_n_s_per_m: float = 10.0
    back_emf_n_s_per_m: float = 250.0
    force_per_volt_n: float = 16.0
    stinger_n_per_m: float = 1.5e7
    stinger_n_s_per_m: float = 50.0
    second_harmonic: float = 0.0
    full_voltage_v: float = 28.0

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            positive = each.name in ("armature_kg", "force_per_volt_n", "stinger_n_per_m", "full_voltage_v")
            if not (0.0 <= value < np.inf and (value > 0.0 or not positive)):
                needed = "a positive number" if positive else "0 or more"
                raise InputError(f"{each.name} of the shaker is {value}: give {needed}")


def armature_force(shaker: Shaker, voltage: ArrayLike) -> FloatArray:
    """Return the force on an armature that is held, N, of the shape of the voltage.

    >>> armature_force(Shaker(second_harmonic=0.05, full_voltage_v=10.0), [-10.0, 10.0])
    array([-144.,  176.])
    """
    volts = np.asarray(voltage, dtype=np.float64)
    distorted = volts + 2.0 * shaker.second_harmonic / shaker.full_voltage_v * volts**2
    return shaker.force_per_volt_n * distorted


def on_shaker(structure: Structure, shaker: Shaker, direction: ArrayLike) -> Structure:
    """Return a structure with the armature as one more degree of freedom, the last one, "armature".

    The stinger is the last joint, "stinger": its force is what the force cell reads, and acts on the structure along
    `direction`.

    Args:
        structure: the structure alone.
        shaker: the shaker; its body stands on the ground.
        direction: (n_dof,), the drive point moves by direction . x; in modal coordinates the row of its shapes.

    Raises:
        InputError: a direction of the wrong shape or without any motion, or a structure that is on a shaker already.

    >>> block = Structure([[20.0]], [[0.0]], [[0.0]])
    >>> on_shaker(block, Shaker(), [1.0]).names
    ('x1', 'armature')
    """
    point = np.asarray(direction, dtype=np.float64)
    if point.shape != (structure.n_dof,) or not np.isfinite(point).all() or not point.any():
        raise InputError(
            f"the drive point has the direction {direction!r}: give {structure.n_dof} finite number(s), not all zero"
        )
    if ARMATURE in structure.names or any(joint.name == STINGER for joint in structure.joints):
        raise InputError("the structure has an armature or a stinger already: one shaker can drive it")
    stinger = Joint(STINGER, np.append(-point, 1.0), shaker.stinger_n_per_m, shaker.stinger_n_s_per_m)
    return Structure(
        _border(structure.mass, shaker.armature_kg),
        _border(structure.damping, shaker.suspension_n_s_per_m + shaker.back_emf_n_s_per_m),
        _border(structure.stiffness, shaker.suspension_n_per_m),
        (*(replace(joint, direction=np.append(joint.direction, 0.0)) for joint in structure.joints), stinger),
        names=(*structure.names, ARMATURE),
    )


def _border(matrix: FloatArray, corner: float) -> FloatArray:
    bordered = np.zeros((matrix.shape[0] + 1, matrix.shape[0] + 1))
    bordered[:-1, :-1] = matrix
    bordered[-1, -1] = corner
    return bordered
