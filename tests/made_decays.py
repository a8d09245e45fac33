"""Decays with known laws that tests and benchmarks share."""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Structure, iwan
from opid.modal.linear.modes import LinearModes, modal_test
from opid.signals.recording import recording_from_arrays

SENSED_FS, SENSED_OMEGA, SENSED_LEVEL = 1024.0, 2.0 * np.pi * 40.0, 1e-3
SENSED_K3 = 0.08 * SENSED_OMEGA**2 / SENSED_LEVEL**2
RUNG_FS, RUNG_OMEGA, RUNG_LEVEL, RUNG_S = 2048.0, 2.0 * np.pi * 60.0, 1e-3, 3.0


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


@cache
def hardening_mode():
    """Return times and accelerations of a mode with the stiffness SENSED_OMEGA^2 and SENSED_K3."""
    time = np.arange(6144) / SENSED_FS

    def force(q, v):
        return 0.008 * SENSED_OMEGA * v + SENSED_OMEGA**2 * q + SENSED_K3 * q**3

    found = solve_ivp(
        lambda _, y: [y[1], -force(*y)], (0.0, time[-1]), [SENSED_LEVEL, 0.0], "DOP853", time, rtol=1e-9, atol=1e-14
    )
    return time, -force(*found.y)


def decay_at_sensors(seed, *, n_sensors=6, wrong_gain=1.0, shape_error=0.0):
    """Return a test with a hardening mode at 40 Hz and one at 63 Hz at sensors, one of which has a wrong gain.

    The name of that sensor is returned, too. The first mode is `hardening_mode`; `shape_error` is that of the shapes
    that are told, over their rms.
    """
    rng = np.random.default_rng(seed)
    time, first = hardening_mode()
    second = first.std() * np.exp(-0.005 * 2 * np.pi * 63 * time) * np.cos(2 * np.pi * 63 * time + rng.uniform(0, 6))
    shapes = 0.5 * rng.standard_normal((n_sensors, 2))
    wrong = int(rng.integers(n_sensors))
    gains = np.where(np.arange(n_sensors) == wrong, wrong_gain, 1.0)
    motion = np.vstack([np.zeros((400, n_sensors)), np.column_stack([first, second]) @ shapes.T]) * gains
    motion += 1e-3 * motion.std() * rng.standard_normal(motion.shape)
    told = shapes + 0.5 * shape_error * rng.standard_normal(shapes.shape)
    names = tuple(f"s{index}" for index in range(n_sensors))
    modes = LinearModes([40.0, 63.0], [0.004, 0.005], told, names)
    recording = recording_from_arrays(list(motion.T), names, fs=SENSED_FS, unit="m/s^2")
    return modal_test(recording, modes, name="ring"), names[wrong]


def two_close_modes(seed, *, apart_hz=0.1, noise=0.003, fs=1024.0):
    """Return the sum of two linear modes at 60 Hz and a little above, 6 s long, after 500 samples of rest."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(6.0 * fs)) / fs
    first, second = 2 * np.pi * 60.0, 2 * np.pi * (60.0 + apart_hz)
    signal = np.exp(-0.003 * first * time) * np.cos(first * time)
    signal += 0.7 * np.exp(-0.0035 * second * time) * np.cos(second * time + rng.uniform(0, 2 * np.pi))
    whole = np.concatenate([np.zeros(500), signal])
    return whole + noise * whole.std() * rng.standard_normal(whole.size)


def ring_with_state(kind, force, travel, *, c0, exponent=2.0):
    """Return the acceleration of a mode whose joint carries force h, where travel h' is a function of h and q'.

    With the joint the mode has the stiffness RUNG_OMEGA^2 at rest, and it begins with RUNG_OMEGA RUNG_LEVEL.

    Args:
        kind: "dahl" or "bouc_wen", which has the shape 1/2.
        force: largest force of the joint per unit mass.
        travel: its force over its stiffness at rest.
        c0: viscous damping per unit mass.
        exponent: that of Bouc and Wen.
    """
    time = np.arange(round(RUNG_S * RUNG_FS)) / RUNG_FS
    beside = RUNG_OMEGA**2 - force / travel

    def rate(h, v):
        if kind == "dahl":
            return v - abs(v) * h
        return v * (1.0 - abs(h) ** exponent * (0.5 + 0.5 * np.sign(v * h)))

    def move(_, y):
        return [y[1], -c0 * y[1] - beside * y[0] - force * y[2], rate(y[2], y[1]) / travel]

    start, small = [0.0, RUNG_OMEGA * RUNG_LEVEL, 0.0], np.array([1e-12, 1e-10, 1e-9])
    found = solve_ivp(move, (0.0, time[-1]), start, "LSODA", time, rtol=1e-8, atol=small, max_step=1.0 / RUNG_FS)
    return -c0 * found.y[1] - beside * found.y[0] - force * found.y[2]


def ring_with_sliders(sliders, *, c0):
    """Return the acceleration of such a mode whose joint is sliders side by side."""
    beside = RUNG_OMEGA**2 - sliders.tangent_n_per_m
    structure = Structure([[1.0]], [[c0]], [[beside]], (Joint("bolt", np.array([1.0]), sliders=sliders),))
    found = time_response(
        structure,
        lambda t: np.zeros((t.size, 1)),
        fs=RUNG_FS,
        duration_s=RUNG_S,
        initial_velocity=[RUNG_OMEGA * RUNG_LEVEL],
        steps_per_sample=8,
    )
    return found.acceleration[:, 0]


def bolt(force, stiffness, chi, beta):
    """Return the sliders of an Iwan joint that slides as a whole, per unit mass."""
    return iwan(stiffness_n_per_m=stiffness, slip_force_n=force, chi=chi, beta=beta, n=80)


def bolt_values(force, stiffness, chi, beta):
    """Return the values that `iwan_friction` has for such a bolt.

    The force of the sliders that slip one by one is (chi + 1) / (chi + 2) of that of all at the last travel, and that
    of those that slip there at once is beta.
    """
    gradual = (chi + 1.0) / (chi + 2.0)
    travel = force * (1.0 + beta) / (stiffness * (beta + gradual))
    return {"amplitude": force, "scale": travel, "spread": 1.0 / (chi + 2.0), "jump": beta / gradual}
