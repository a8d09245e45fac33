"""A virtual force appropriation as a laboratory records it: stepped voltage, one log, levels with their transients.

The phase-locked loop finds the frequency of each level; the log is then recorded at a constant rate while voltage and
frequency step from level to level.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError
from opid.mechanics.rig import FORCE, rig_run
from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.resonance.appropriation import appropriate_force, levels_for
from opid.modal.study import ModalStudy, StudyTest
from opid.progress import Say
from opid.signals.recording import Channel, FloatArray, Recording
from opid.virtual.modal_tests.response_curves import drive_curves
from opid.virtual.modal_tests.series import VirtualSeries

SETTLING = 4.0
"""Time constants 1 / (zeta omega) for which a level settles before what counts of it: 2 % of the step are left."""

RECORDED_PERIODS = 100
"""Periods of a level after that."""


def resonance_study(
    series: VirtualSeries,
    *,
    rng: np.random.Generator,
    mode: int | None = None,
    n_levels: int = 70,
    n_curves: int = 0,
    noise_fraction: float = 0.01,
    phase_error_deg: float = 0.0,
    given: LinearModes | None = None,
    progress: Say | None = None,
) -> ModalStudy:
    """Hold a mode of a virtual structure at phase resonance, level after level, and return the study with the log.

    Args:
        series: the structure, and how far its modes are to be driven.
        rng: source of the noise.
        mode: number of the mode, from 1; the first nonlinear one where left out.
        n_levels: number of levels, two or more.
        n_curves: number of stepped-sine response curves beside them, see `drive_curves`.
        noise_fraction: standard deviation of the noise over the rms of each channel, in each level.
        phase_error_deg: phase by which the loop holds every level off quadrature, below 45 degrees.
        given: linear modes that the study states; the true ones where left out.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a phase out of range, or what `appropriate_force` refuses.
        NotDeterminedError: the loop does not lock.
    """
    if not abs(phase_error_deg) < 45.0:
        raise InputError(f"phase_error_deg is {phase_error_deg}: give less than 45 degrees to either side")
    say, case = progress or (lambda step: None), series.case
    number = case.nonlinear_modes[0] if mode is None else mode
    index = case.modes.index(number)
    top = _find_top(series, index)
    say("the voltages")
    shared: dict[str, Any] = {"drive_point": case.drive_point, "noise_fraction": noise_fraction}
    voltages = levels_for(case.rig, case.modes, number, top_m_per_s2=top, rng=rng, n_levels=n_levels, **shared)
    say("phase resonance")
    held = appropriate_force(case.rig, case.modes, number, levels_v=voltages, rng=rng, **shared)
    zeta = np.maximum(held.damping_ratio, case.modes.damping_ratio[index])
    hz = held.frequency_hz * (1.0 - zeta * np.tan(np.radians(phase_error_deg)))
    say("the log")
    fs = series.fs
    seconds = SETTLING / (2.0 * np.pi * zeta * hz) + RECORDED_PERIODS / hz
    counts = np.round(seconds * fs).astype(int)
    phase = 2.0 * np.pi * np.cumsum(_follow_steps(hz, counts, 2.0 * np.pi * zeta * hz / fs)) / fs
    drive = np.repeat(voltages, counts) * np.sin(phase)
    run = rig_run(case.rig, drive, fs=fs, rng=rng, noise_fraction=0.0)
    recording = _add_noise(run.clean, np.repeat(np.arange(counts.size), counts), noise_fraction, rng)
    samples = np.column_stack([recording.samples, drive])
    recording = replace(recording, samples=samples, channels=(*recording.channels, Channel("voltage", "V")))
    modes = case.modes if given is None else given
    test = modal_test(recording, modes, name=f"levels_mode_{number}", force=FORCE, drive_point=case.drive_point)
    say("the response curves")
    curves = drive_curves(case.rig, held, n_curves=n_curves, rng=rng, noise_fraction=noise_fraction)
    tests = (StudyTest(test, "resonance", number),)
    return ModalStudy(series.title, modes, (number,), tests, case.drive_point, curves=curves)


def _find_top(series: VirtualSeries, index: int) -> float:
    """Return the amplitude of the drive point at the highest level of a mode, m/s^2."""
    modes = series.case.modes
    row = np.abs(modes.shapes[:, index]).max() if series.top_sensor is None else modes.row(series.top_sensor)[index]
    return series.top_m_per_s2 * abs(float(modes.row(series.case.drive_point)[index] / row))


def _follow_steps(hz: FloatArray, counts: NDArray[np.int64], rate: FloatArray) -> FloatArray:
    """Return the frequency of each sample: a loop follows each step with the time constant of the mode."""
    before = np.concatenate([hz[:1], hz[:-1]])
    parts = zip(before, hz, counts, rate, strict=True)
    return np.concatenate([end + (start - end) * np.exp(-each * np.arange(n)) for start, end, n, each in parts])


def _add_noise(clean: Recording, level: np.ndarray, noise_fraction: float, rng: np.random.Generator) -> Recording:
    """Return a recording with white noise of a fraction of the rms of each channel in each level."""
    n_levels = int(level[-1]) + 1
    counts = np.bincount(level, minlength=n_levels)
    squares = [np.bincount(level, weights=channel**2, minlength=n_levels) / counts for channel in clean.samples.T]
    rms = np.sqrt(np.stack(squares, axis=1))[level]
    noisy = clean.samples + noise_fraction * rms * rng.standard_normal(clean.samples.shape)
    return replace(clean, samples=noisy, history=(*clean.history, f"noise of {noise_fraction:g} rms of each level"))
