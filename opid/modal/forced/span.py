"""Whether the shapes explain what the sensors saw: a swapped row, a wrong sign, a missing mode show without a force."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import fft

from opid.modal.linear.modes import ModalTest, with_sensors
from opid.signals.recording import FloatArray

WARNED_SHARE, MOST_SHARE = 0.1, 0.5
"""Of the motion in the band, rms, outside of what the shapes can do: told, and refused."""


def outside_shapes(test: ModalTest, band_hz: tuple[float, float]) -> tuple[float, str]:
    """Return the share of the motion that no sum of the shapes can make, and what would lower it most.

    |x - Phi pinv(Phi) x| / |x| over the lines of a band, the share of the sensors' noise taken out.

    Args:
        test: any test.
        band_hz: lower and upper end, Hz.

    Returns:
        The share (0 where there are no more sensors than modes, and nothing can be told), and a clause that names the
        sensor whose sign or whose row is the likeliest cause, "" where none stands out.
    """
    sensors = [sensor for sensor in test.modes.sensors if sensor in test.recording.names]
    shapes = with_sensors(test.modes, sensors).shapes
    n_sensors, n_modes = shapes.shape
    if n_sensors <= n_modes:
        return 0.0, ""
    lines, noise = _lines(test, sensors, band_hz)
    share = _outside(shapes, lines, noise)
    if share <= WARNED_SHARE:
        return share, ""
    signs = np.where(np.eye(n_sensors, dtype=bool), -1.0, 1.0)
    flipped = [_outside(shapes * sign[:, None], lines, noise) for sign in signs]
    best = int(np.argmin(flipped))
    if flipped[best] < 0.3 * share:
        return share, f"with the sign of {sensors[best]!r} turned it would be {100 * flipped[best]:.0f} %"
    swaps = {}
    for one in range(n_sensors):
        for other in range(one):
            order = np.arange(n_sensors)
            order[[one, other]] = other, one
            swaps[one, other] = _outside(shapes[order], lines, noise)
    one, other = min(swaps, key=lambda pair: swaps[pair])
    if swaps[one, other] < 0.3 * share:
        pair = f"{sensors[other]!r} and {sensors[one]!r}"
        return share, f"with {pair} exchanged it would be {100 * swaps[one, other]:.0f} %"
    return share, ""


def faults_of_shapes(test: ModalTest, mode: int, band_hz: tuple[float, float]) -> Iterator[str]:
    """Yield that a test does not move in the shapes, as a fault.

    Args:
        test: the test.
        mode: whose band it is, from 1.
        band_hz: the band, Hz.
    """
    share, cause = outside_shapes(test, band_hz)
    if share > MOST_SHARE:
        yield _told(test, mode, share, cause)


def doubts_of_shapes(test: ModalTest, mode: int, band_hz: tuple[float, float]) -> Iterator[str]:
    """Yield that a test moves partly outside of the shapes.

    Args:
        test: the test.
        mode: whose band it is, from 1.
        band_hz: the band, Hz.
    """
    share, cause = outside_shapes(test, band_hz)
    if WARNED_SHARE < share <= MOST_SHARE:
        yield _told(test, mode, share, cause)


def _told(test: ModalTest, mode: int, share: float, cause: str) -> str:
    hint = cause or "check the order, signs and units of the sensors, and whether a mode is missing"
    motion = f"{100 * share:.0f} % of the motion of test {test.name!r} about mode {mode}"
    return f"{motion} cannot be made of the shapes: {hint}"


def _lines(test: ModalTest, sensors: list[str], band_hz: tuple[float, float]) -> tuple[np.ndarray, float]:
    """Transforms of the sensors in the band, (m, n_sensors), and the mean square of a line that is noise."""
    samples = test.recording.samples[:, [test.recording.index(sensor) for sensor in sensors]]
    spectrum = fft.rfft(samples, axis=0)
    frequency = fft.rfftfreq(len(samples), 1 / test.fs)
    inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    above = frequency > 1.3 * test.modes.frequency_hz.max()
    quiet = np.abs(spectrum[above if above.sum() >= 50 else slice(1, None)]) ** 2
    return spectrum[inside], float(np.mean(np.median(quiet, axis=0)) / np.log(2))


def _outside(shapes: FloatArray, lines: np.ndarray, noise: float) -> float:
    rest = lines - lines @ np.linalg.pinv(shapes).T @ shapes.T
    free = shapes.shape[0] - shapes.shape[1]
    excess = float(np.sum(np.abs(rest) ** 2)) - noise * free * len(lines)
    return float(np.sqrt(max(excess, 0.0) / max(float(np.sum(np.abs(lines) ** 2)), 1e-300)))
