"""Other modes that answer at multiples of the frequency under test: what a nonlinear modal model cannot hold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import fft

from opid.modal.linear.modes import ModalTest, force_projection
from opid.signals.recording import FloatArray

MULTIPLES = (2, 3)

LEAST_SHARE = 0.3
"""Of the motion of the mode under test, rms of modal accelerations: what another mode must reach to be told."""

MOST_DRIVEN = 0.3
"""Of what is observed: what the force may have driven by itself (the shaker has harmonics, too)."""


def doubts_of_other_modes(test: ModalTest, mode: int, band_hz: tuple[float, float]) -> Iterator[str]:
    """Yield the modes that move at twice or three times the band of a mode, more than the force can have moved them.

    A modal model takes its modes to be uncoupled; such motion shows that they are not (Pacini, section 4.2.2, where
    force appropriation gives the proof: `opid.modal.modal_interaction`).

    Args:
        test: with a force, of the mode under test.
        mode: number of that mode, from 1.
        band_hz: in which it moves, Hz.
    """
    place = test.modes.index(mode)
    frequency = fft.rfftfreq(test.acceleration.shape[0], 1 / test.fs)
    spectra = fft.rfft(test.acceleration, axis=0)
    driven = _driven(test, frequency)
    target = _rms(spectra[:, place], frequency, band_hz)
    for multiple in MULTIPLES:
        band = (multiple * band_hz[0], multiple * band_hz[1])
        seen = np.array([_rms(each, frequency, band) for each in spectra.T])
        own = np.array([_rms(each, frequency, band) for each in driven.T])
        telling = (seen > LEAST_SHARE * target) & (own < MOST_DRIVEN * seen) & test.modes.elastic
        telling[place] = False
        if telling.any():
            other = int(np.argmax(np.where(telling, seen, 0.0)))
            by_force = 100 * own[other] / seen[other]
            yield (
                f"mode {other + 1} moves at {multiple} times the frequency of mode {mode} in test {test.name!r}, "
                f"{seen[other] / target:.2f} times as much, of which the force explains {by_force:.0f} %: the modes "
                f"interact, and where mode {other + 1} moves this model is wrong; force appropriation would show it"
            )


def _driven(test: ModalTest, frequency: FloatArray) -> np.ndarray:
    """Transforms of the modal accelerations that the force alone gives linear modes."""
    if test.force is None or test.drive_point is None:
        return np.zeros((frequency.size, test.modes.n_modes), dtype=np.complex128)
    omega = 2 * np.pi * frequency[:, None]
    stiffness = test.modes.stiffness() - omega**2 + 1j * omega * test.modes.damping()
    forces = force_projection(test.modes, test.drive_point) * fft.rfft(test.force)[:, None]
    return -(omega**2) * forces / np.where(stiffness == 0, 1.0, stiffness)


def _rms(spectrum: np.ndarray, frequency: FloatArray, band_hz: tuple[float, float]) -> float:
    inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    return float(np.sqrt(np.sum(np.abs(spectrum[inside]) ** 2)))
