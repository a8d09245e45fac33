"""A damped structure with nonlinear joints and a shaker, and its linear response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.backbones.family import laws_of_joints
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.law import FloatArray, TermSet
from opid.mechanics.rig import Shaker
from opid.mechanics.structure import ComplexArray

# rate of a joint at which its damping is linear, m/s
_SLOW = 1e-9


@dataclass(frozen=True, eq=False)
class Specimen:
    """A structure with damped modes and nonlinear joints, and a shaker at one of its sensors.

    Args:
        system: the modes of the structure, as its sensors and joints see them.
        laws: one law for each joint; a single one counts for all.
        damping_ratio: (n_modes,) zeta of each mode, or one number for all.
        drive: name of the sensor at which the force acts.
        shaker: None for a force that acts directly; otherwise the feedback moves its armature, and the force is that in
            its stinger. Its amplifier is taken as linear.

    Raises:
        InputError: counts that do not match, damping that is not positive, an unknown sensor, a law with memory, or a
            shaker that distorts.
    """

    system: JointedModes
    laws: TermSet | Sequence[TermSet]
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
        for term in (term for law in laws_of_joints(self.laws, self.system) for term in law.terms):
            if term.kind.memory is not None:
                raise InputError(f"a joint has {term.name}, which has a memory: give springs and dampers")
        self.system.sensor(self.drive)
        if self.shaker is not None and self.shaker.second_harmonic:
            raise InputError("the shaker distorts: the feedback takes it as linear, set its second_harmonic to 0")

    @property
    def joint_laws(self) -> tuple[TermSet, ...]:
        """One law for each joint."""
        return laws_of_joints(self.laws, self.system)

    @cached_property
    def joints_of_laws(self) -> dict[TermSet, list[int]]:
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
