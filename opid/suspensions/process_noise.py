"""What moves the body and no sensor measured, as noise of a level and a colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.mean_slopes import Straight
from opid.suspensions.run import DrivenRun


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
