"""Decays with known laws that tests and benchmarks share."""

import numpy as np


def decay_with_friction(*, fs, duration_s, k0, c0, friction, amplitude):
    """Return the acceleration of q'' + c0 q' + k0 q + F sgn q' = 0 from rest, piece by piece in closed form."""
    time = np.arange(round(duration_s * fs)) / fs
    acceleration = np.zeros(time.size)
    delta, omega = c0 / 2, np.sqrt(k0 - c0**2 / 4)
    start, place, sign = 0.0, amplitude, 1.0
    while abs(place) * k0 > friction and start <= time[-1]:
        inside = (time >= start) & (time < start + np.pi / omega)
        since, about = time[inside] - start, sign * friction / k0
        fall = (place - about) * np.exp(-delta * since)
        q = fall * (np.cos(omega * since) + delta / omega * np.sin(omega * since))
        v = -fall * k0 / omega * np.sin(omega * since)
        acceleration[inside] = -k0 * q - c0 * v
        place = about - (place - about) * np.exp(-delta * np.pi / omega)
        start, sign = start + np.pi / omega, -sign
    return acceleration


def noisy_after_rest(signal, rng, fraction):
    """Return a signal after 500 samples of rest, in noise of a fraction of the rms of its first 1000 samples."""
    whole = np.concatenate([np.zeros(500), signal])
    return whole + fraction * signal[:1000].std() * rng.standard_normal(whole.size)
