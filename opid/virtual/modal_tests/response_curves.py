"""Virtual stepped-sine tests: the fundamental of a sensor over frequency, at several levels of the force."""

from __future__ import annotations

import numpy as np

from opid.mechanics.rig import Rig, drive, find_harmonics, open_rig
from opid.modal.resonance.appropriation import Appropriation
from opid.modal.resonance.curves import ResponseCurve
from opid.signals.recording import FloatArray

N_POINTS = 25
"""Frequencies of a curve."""

SETTLING = 7.0
"""Time constants 1 / (zeta omega) at a frequency before it is measured: 0.1 % of a step is left."""

RECORDED_PERIODS = 20
SAMPLES_PER_PERIOD = 64

LARGEST_ANGLE = 0.2
"""Turn of the highest natural frequency in a time step, rad; the mode itself turns by half as much at most."""

REACH = (3.0, 2.0)
"""Where a curve begins and ends beyond the resonances of its level and of small amplitudes, in half bandwidths."""


def drive_curves(
    rig: Rig,
    held: Appropriation,
    *,
    n_curves: int,
    rng: np.random.Generator,
    noise_fraction: float = 0.01,
    settling: float = SETTLING,
) -> tuple[ResponseCurve, ...]:
    """Step a sine through the resonance of a mode at several of the levels at which it was held, and return the curves.

    Each curve is driven towards the resonance of its level, where the mode stays on the branch of large motion, and at
    constant voltage.

    Args:
        rig: the structure with its sensors and its shaker.
        held: levels at phase resonance, whose frequencies say where each curve lies.
        n_curves: number of curves, from the highest level down at equal ratios of the voltage.
        rng: source of the noise.
        noise_fraction: standard deviation of force and motion at each point, over their size.
        settling: time constants that the motion gets at each frequency; with fewer it lags.

    Raises:
        InputError: what `open_rig` refuses.
    """
    modes, index = held.modes, held.modes.index(held.mode)
    sensor = modes.sensors[int(np.argmax(np.abs(modes.shapes[:, index])))]
    volts = held.voltage_v
    wanted = volts.max() * np.geomspace(max(0.1, float(volts.min() / volts.max())), 1.0, n_curves)
    chosen = [int(np.argmin(np.abs(np.log(volts / each)))) for each in wanted]
    curves = []
    for number, at in enumerate(chosen, start=1):
        hz = _list_frequencies(float(held.frequency_hz[at]), float(modes.frequency_hz[index]), held.damping_ratio[at])
        force, motion = _drive_curve(rig, hz, float(volts[at]), held, sensor, settling)
        noise = noise_fraction * rng.standard_normal((3, hz.size))
        motion = motion * (1.0 + noise[0] + 1j * noise[1]) / force * np.abs(force)
        curves.append(
            ResponseCurve(
                name=f"curve_{number}",
                sensor=sensor,
                frequency_hz=hz,
                amplitude=np.abs(motion),
                phase_deg=np.degrees(np.angle(motion)),
                force_n=np.abs(force) * (1.0 + noise[2]),
                mode=held.mode,
                error_fraction=max(noise_fraction, 1e-4),
            )
        )
    return tuple(curves)


def _list_frequencies(held_hz: float, linear_hz: float, zeta: float) -> FloatArray:
    """Return the frequencies of a curve, Hz: towards the frequency to which large motion moves the resonance."""
    direction = np.sign(held_hz - linear_hz) or 1.0
    half = zeta * linear_hz
    return np.linspace(linear_hz - direction * REACH[0] * half, held_hz + direction * REACH[1] * half, N_POINTS)


def _drive_curve(
    rig: Rig, hz: FloatArray, voltage_v: float, held: Appropriation, sensor: str, settling: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the complex fundamentals of force and acceleration at each frequency, (n,) each."""
    opened = open_rig(rig, SAMPLES_PER_PERIOD * float(hz.min()), largest_angle_rad=LARGEST_ANGLE)
    column = rig.sensor_names.index(sensor)
    zeta = float(held.modes.damping_ratio[held.modes.index(held.mode)])
    state, found = opened.start, []
    for each in hz:
        # Whole periods follow each other, so the voltage has no step where the frequency has one.
        n_waiting = max(1, round(settling / (2.0 * np.pi * zeta)))
        n = (n_waiting + RECORDED_PERIODS) * SAMPLES_PER_PERIOD
        half_steps = np.arange(2 * n * opened.steps_per_sample + 1)
        voltage = voltage_v * np.sin(np.pi / (SAMPLES_PER_PERIOD * opened.steps_per_sample) * half_steps)
        readings, state = drive(opened, state, voltage, fs=SAMPLES_PER_PERIOD * float(each))
        both = np.column_stack([readings.force, readings.acceleration[:, column]])
        recorded = both[-RECORDED_PERIODS * SAMPLES_PER_PERIOD - 1 : -1]
        found.append(find_harmonics(recorded, 1, n_periods=RECORDED_PERIODS)[1])
    force, motion = np.array(found).T
    return force, motion
