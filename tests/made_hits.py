"""Hits of a structure with three elastic modes, as a hammer and four sensors record them."""

import numpy as np

from opid.modal.linear.frequency_response import forced_record, resynthesised
from opid.modal.linear.modes import LinearModes
from opid.signals.recording import Channel, Recording

SENSORS = ("tip", "middle", "root", "side")
MODES = LinearModes(
    np.array([0.0, 40.0, 63.0, 91.0]),
    np.array([0.0, 0.006, 0.004, 0.009]),
    np.array([[0.3, 0.5, -0.4, 0.3], [0.3, -0.2, 0.5, 0.4], [0.3, 0.1, 0.2, -0.6], [0.3, -0.4, -0.3, 0.1]]),
    SENSORS,
)


def ring(seed, fs=512.0, duration_s=30.0, modes=MODES, height=None):
    """Return the record of a hit at the tip, from the responses of the modes; the height is a random one if None."""
    rng, n = np.random.default_rng(seed), round(fs * duration_s)
    time_s = np.arange(n) / fs
    force = (
        100
        * (rng.uniform(0.5, 1) if height is None else height)
        * np.where((time_s > 0.05) & (time_s < 0.06), np.sin(np.pi * (time_s - 0.05) / 0.01), 0)
    )
    lines_hz = np.fft.rfftfreq(n, 1 / fs)
    response = np.zeros((lines_hz.size, 4), dtype=complex)
    response[1:] = resynthesised(modes, lines_hz[1:], "tip").value
    motion = np.fft.irfft(np.fft.rfft(force)[:, np.newaxis] * response, n, axis=0)
    samples = np.column_stack([motion, force])
    samples += 1e-3 * samples.std(axis=0) * rng.standard_normal(samples.shape)
    channels = (*(Channel(name, "m/s^2") for name in SENSORS), Channel("hammer", "N"))
    return Recording(samples, fs, channels)


def hit(recording, drive="tip"):
    """Return the record as that of a structure of which nothing is known but where it was hit."""
    return forced_record(recording, name="hit", force="hammer", drive_point=drive)
