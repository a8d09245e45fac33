"""A run of a model with the mean slopes of its laws: what passes from below the suspensions to the sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.mechanics.laws import Law
from opid.mechanics.memory import force_along
from opid.mechanics.prediction import Prediction
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.body import Mobility
from opid.suspensions.run import DrivenRun
from opid.suspensions.unknowns import Unknowns


@dataclass(frozen=True, eq=False)
class Straight:
    """A run with the mean slopes of its laws, on the lines that are compared.

    Args:
        omega: of the lines, rad/s.
        moved: what forces do to the body.
        spring: (n_lines, n_slots) force on the body by travel, with the mean slopes of the laws.
        ground: (n_slots,) stiffness of the springs to the ground.
        system: (n_lines, n_slots, n_slots) what gives the travel from accelerations.
    """

    omega: FloatArray
    moved: Mobility
    spring: ComplexArray
    ground: FloatArray
    system: ComplexArray


def straighten(unknowns: Unknowns, theta: FloatArray, place: int, prediction: Prediction) -> Straight:
    """Return a run with the mean slopes of the laws along its predicted motion."""
    omega = unknowns.runs[place].omega
    slots = unknowns.resting_interfaces(theta, place)
    moved = unknowns.mobility(theta, place)
    spring = np.zeros((omega.size, len(slots)), dtype=np.complex128)
    ground = np.array([slot.ground_stiffness for slot in slots])
    for k, slot in enumerate(slots):
        assert isinstance(slot.law, Law)  # without candidates
        z, v = prediction.travel[:, k], prediction.velocity[:, k]
        by_z, by_v = slot.law.gradient(z, v)
        spring[:, k] = slot.stiffness + by_z.mean() + 1j * omega * (slot.damping + by_v.mean())
        if slot.law.has_memory:
            stiffness, damping = _of_memories(slot.law, z, v, unknowns.runs[place].fs)
            spring[:, k] += stiffness + 1j * omega * damping
    square = (omega**2)[:, np.newaxis, np.newaxis]
    # z'' = -A F - u, F = spring z + ground (z + x1), x1 = -u / omega^2
    system = moved.accelerance * (spring + ground)[:, np.newaxis, :] - square * np.eye(len(slots))
    return Straight(omega, moved, spring, ground, system)


def transmissibility(unknowns: Unknowns, straight: Straight) -> ComplexArray:
    """Return the acceleration of each sensor over that below each suspension, with the mean slopes of the laws.

    Returns:
        (n_lines, n_sensors, n_interfaces).
    """
    moved, ground, n = straight.moved, straight.ground, unknowns.body.n_interfaces
    square = (straight.omega**2)[:, np.newaxis, np.newaxis]
    driven = -np.eye(len(ground)) + moved.accelerance * ground / square
    travel = np.asarray(np.linalg.solve(straight.system, driven[:, :, :n]), dtype=np.complex128)
    force = (straight.spring + ground)[:, :, np.newaxis] * travel - (np.diag(ground) / square)[:, :, :n]
    read = moved.reading @ force
    return -read[:, : len(unknowns.sensors.sprung)]


def _of_memories(law: Law, z: FloatArray, v: FloatArray, fs: float) -> tuple[float, float]:
    """Stiffness and damping that come nearest to what the terms with memory do along a motion."""
    remembering = Law(tuple(term for term in law.terms if term.kind.memory is not None))
    columns, force = np.stack([z - z.mean(), v, np.ones_like(z)], axis=1), force_along(remembering, z, v, fs)
    # a memory that turns over too fast to be followed is none that holds
    found = np.linalg.lstsq(columns, np.where(np.isfinite(force), force, 0.0), rcond=None)[0]
    return float(found[0]), float(found[1])


@dataclass(frozen=True, eq=False)
class ProcessNoise:
    """What moves the body and no sensor measured: forces of others, and motion that the model does not know.

    Args:
        fraction: its rms acceleration over that of the readings of a run; 0 for none.
        corner_hz: above this frequency its spectral density falls, Hz.
        levels: of each run (n_sensors, n_lines) how large the errors are, band by band; empty where all are 1.
    """

    fraction: float = 0.0
    corner_hz: float = 10.0
    levels: tuple[FloatArray, ...] = ()

    def acceleration_rms(self, run: DrivenRun) -> FloatArray:
        """Return its rms acceleration at each sensor on the body in a run, m/s^2."""
        return self.fraction * run.sprung.std(axis=0)


NO_PROCESS_NOISE = ProcessNoise()


def spectral_density(process: ProcessNoise, run: DrivenRun, straight: Straight) -> ComplexArray:
    """Return what unmeasured forces make of the density of the readings, (n_lines, n_sensors, n_sensors)."""
    rms, omega, ground = process.acceleration_rms(run), straight.omega, straight.ground
    n = rms.size
    travel = np.linalg.solve(straight.system, np.broadcast_to(np.eye(len(ground))[:, :n], (omega.size, len(ground), n)))
    read = np.eye(len(ground))[:, :n] - straight.moved.reading @ ((straight.spring + ground)[:, :, np.newaxis] * travel)
    decay = np.exp(-2 * np.pi * process.corner_hz / run.fs)
    shape = (1 - decay**2) / np.abs(1 - decay * np.exp(-1j * omega / run.fs)) ** 2
    density = (read[:, :n] * rms**2) @ read[:, :n].conj().transpose(0, 2, 1)
    return np.asarray(shape[:, np.newaxis, np.newaxis] * density, dtype=np.complex128)
