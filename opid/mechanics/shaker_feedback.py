"""A shaker under feedback: what the control reads, its gains, and the structure with the loop closed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from opid.errors import InputError
from opid.mechanics.laws import FloatArray
from opid.mechanics.quadrature_curves import Specimen
from opid.mechanics.response import Assembled, assembled
from opid.mechanics.shaker import on_shaker
from opid.mechanics.structure import Joint, Structure, linear_matrices

# of a weight on a sensor, against damping of other modes: keeps the weights from growing for nothing
_WEIGHT_PRICE = 1e-3


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A structure under the feedback u = p (x* - x) + d (x*' - x'), as the time step takes it.

    Its degrees of freedom are the modal coordinates, then the armature of the shaker, if there is one. The feedback is
    a joint; the input of the structure is p x* + d x*'.

    Args:
        ready: the structure with the feedback.
        sensors: (n_sensors, n_dof) what the sensors read.
        reading: (n_dof,) what the feedback reads, x.
        gains: p, N/m, and d, N s/m.
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


def closed_loop(
    specimen: Specimen,
    mode: int,
    *,
    damping_ratio: float,
    proportional_n_per_m: float = 0.0,
    modal_filter: bool = True,
) -> ClosedLoop:
    """Return a structure on its shaker under feedback.

    Args:
        specimen: the structure with its shaker.
        mode: that is to be held, from 1.
        damping_ratio: that the gain on the velocity adds to the mode.
        proportional_n_per_m: gain on the displacement, N/m.
        modal_filter: whether the feedback reads the mode through `modal_reading`, or the drive point.

    Raises:
        InputError: a feedback under which the linear structure is unstable.
    """
    system, point, place = specimen.system, specimen.drive_row, specimen.system.place(mode)
    n = system.n_modes
    pairs = zip(system.joints, system.at_joints, specimen.joint_laws, strict=True)
    joints = tuple(Joint(name, row, law=law) for name, row, law in pairs)
    structure = Structure(np.eye(n), np.diag(specimen.modal_damping), np.diag(system.eigenvalue), joints)
    reading = modal_reading(specimen, mode) if modal_filter else point
    gains = proportional_n_per_m, _derivative_gain(specimen, place, reading, damping_ratio, modal_filter)
    acting, sensors, force = point, system.at_sensors, None
    if specimen.shaker is not None:
        structure = on_shaker(structure, specimen.shaker, point)
        stinger = structure.joints[-1]
        force = (stinger.stiffness_n_per_m * stinger.direction, stinger.damping_n_s_per_m * stinger.direction)
        acting = np.append(np.zeros(n), 1.0)
        reading, sensors = np.append(reading, 0.0), np.pad(sensors, ((0, 0), (0, 1)))
    poles = _poles(structure, acting, reading, gains)
    if poles.real.max() > 0.0:
        at_hz = np.abs(poles[np.argmax(poles.real)]) / (2.0 * np.pi)
        raise InputError(
            f"the feedback makes the structure unstable, near {at_hz:.3g} Hz: make it weaker than a damping ratio of "
            f"{damping_ratio:g} and {proportional_n_per_m:g} N/m"
        )
    looped = replace(structure, joints=(*structure.joints, Joint("feedback", reading, *gains)))
    ready = _acting_at(assembled(looped, acting[:, None]), np.linalg.inv(structure.mass) @ acting)
    return ClosedLoop(ready, sensors, reading, gains, force, float(np.abs(poles).max()))


def modal_reading(specimen: Specimen, mode: int) -> FloatArray:
    """Return what a filter over all sensors reads for a unit of each modal coordinate, (n_modes,) kg^-1/2.

    It reads the drive point's motion in the mode, moves with the drive point in every other one (else the feedback
    would stir that mode up), and adds as little damping to them as it can with weights that are not too large: a linear
    programme. The drive point alone is one of its candidates, so there is always an answer.

    Args:
        specimen: the structure.
        mode: to be read, from 1.
    """
    shapes, row, place = specimen.system.at_sensors, specimen.drive_row, specimen.system.place(mode)
    damped = np.delete(shapes * row, place, axis=1) / row[place] ** 2
    both = np.concatenate([damped, -damped])
    found = optimize.linprog(
        both.sum(axis=1) + _WEIGHT_PRICE * np.abs(shapes[:, place]).max() / abs(row[place]),
        A_ub=-both.T,
        b_ub=np.zeros(both.shape[1]),
        A_eq=np.concatenate([shapes[:, place], -shapes[:, place]])[None, :],
        b_eq=[row[place]],
    )
    if not found.success:
        return row
    plus, minus = found.x.reshape(2, -1)
    return (plus - minus) @ shapes


def _derivative_gain(
    specimen: Specimen, place: int, reading: FloatArray, damping_ratio: float, modal_filter: bool
) -> float:
    """The gain on the velocity that adds the wanted damping to the mode.

    At the drive point itself the residual receptance R of the other modes turns the feedback k = j w d into
    k / (1 + k R) on the mode: beyond |k R| = 1 it would hold the point like a support, and damp less.
    """
    system, row = specimen.system, specimen.drive_row
    omega = 2.0 * np.pi * system.frequency_hz[place]
    gain = 2.0 * damping_ratio * omega / (row[place] * reading[place])
    if not modal_filter:
        others = np.delete(np.arange(system.n_modes), place)
        residual = np.abs(np.sum(row[others] ** 2 / (system.eigenvalue[others] - omega**2)))
        gain = min(gain, 1.0 / (omega * max(residual, np.finfo(float).tiny)))
    return float(gain)


def _poles(structure: Structure, acting: FloatArray, reading: FloatArray, gains: tuple[float, float]) -> FloatArray:
    """Poles of the linear structure with a feedback that acts on one place and reads another, rad/s."""
    mass, damping, stiffness = linear_matrices(structure)
    stiffness, damping = (m + g * np.outer(acting, reading) for m, g in zip((stiffness, damping), gains, strict=True))
    lower = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    return np.linalg.eigvals(np.vstack([np.hstack([np.zeros_like(mass), np.eye(len(mass))]), lower]))


def _acting_at(ready: Assembled, load: FloatArray) -> Assembled:
    """The last joint, the feedback, acts on the drive point instead of where it is read."""
    directions, spans, linear, loads, *rest = ready.joints
    spans, loads = spans.copy(), loads.copy()
    loads[-1], spans[-1, 2:4] = load, (0, load.size)
    return replace(ready, joints=(directions, spans, linear, loads, *rest))
