"""Sine beats of small structures whose modal laws are known, with noise, for the tests of the modal wing."""

import numpy as np
from scipy.signal.windows import blackmanharris

from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.model import NonlinearModalModel, simulate
from opid.modal.power_laws import power_law
from opid.signals.recording import Channel, Recording

FS = 2048.0
FREQUENCY, ZETA, LARGEST = 120.0, 0.004, 1e-3
OMEGA = 2 * np.pi * FREQUENCY
# -3 % of frequency and twice the damping at the displacement LARGEST
K3 = -0.06 * 4 / 3 * OMEGA**2 / LARGEST**2
C2 = 2 * ZETA * OMEGA * 3 * np.pi / 8 / (OMEGA * LARGEST)

ONE = LinearModes([FREQUENCY], [ZETA], [[0.5]], ("a",))
# a rigid-body mode and three elastic ones at five sensors
SHAPES = [
    [0.30, 0.5, 0.4, 0.3],
    [0.30, 0.3, -0.2, -0.5],
    [0.30, 0.0, -0.5, 0.1],
    [0.30, -0.3, -0.1, 0.5],
    [0.30, -0.5, 0.4, -0.4],
]
FOUR = LinearModes([0.0, 90.0, FREQUENCY, 210.0], [0.0, 0.005, ZETA, 0.003], SHAPES, ("a", "b", "c", "d", "e"))


def beat(peak_n, *, frequency_hz=FREQUENCY, fs=FS, beat_s=0.75, whole_s=6.0):
    """Return a Blackman-Harris beat with the quiet time after it, N."""
    n, within = round(whole_s * fs), round(beat_s * fs)
    force = np.zeros(n)
    force[:within] = peak_n * blackmanharris(within) * np.sin(2 * np.pi * frequency_hz * np.arange(within) / fs)
    return force


def measured(model, force, rng=None, *, noise=0.01, name="beat", drive_point="a", fs=FS):
    """Return the modal test of a model under a force, with noise of a fraction of each channel's rms."""
    response = simulate(model, force, fs=fs, drive_point=drive_point)
    samples = np.column_stack([force, response.samples])
    if rng is not None:
        samples = samples + noise * samples.std(axis=0) * rng.standard_normal(samples.shape)
    recording = Recording(samples, fs=fs, channels=(Channel("force", "N"), *response.channels))
    return modal_test(recording, model.modes, name=name, force="force", drive_point=drive_point)


def softening(modes=ONE, mode=1):
    """Return the model with the cubic softening and the quadratic damping on one mode."""
    return NonlinearModalModel(modes, {mode: power_law({3: K3}, {2: C2})})


def beats(model, rng, levels=(4.0, 13.0, 26.0, 44.0), **settings):
    """Return tests at several levels, peak force in N."""
    rate = settings.get("fs", FS)
    return [measured(model, beat(level, fs=rate), rng, name=f"{level:g} N", **settings) for level in levels]
