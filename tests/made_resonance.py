"""A short force appropriation of the virtual structure with a cubic mode, and worlds in which an assumption fails."""

from dataclasses import replace
from functools import cache

import numpy as np

from opid.mechanics.rig import FORCE
from opid.modal.linear.modes import modal_test
from opid.modal.study import StudyTest
from opid.virtual.modal_tests.resonance_logs import resonance_study
from opid.virtual.modal_tests.series import CUBIC_DAMPING, CUBIC_MODE, CUBIC_STIFFNESS, virtual_series

K3, C2, MODE = CUBIC_STIFFNESS[3], CUBIC_DAMPING[2], CUBIC_MODE


@cache
def held_study(seed=0, n_levels=12, phase_error_deg=0.0):
    """The study of a test that meets every assumption, but for the phase at which the loop holds it."""
    rng = np.random.default_rng(seed)
    return resonance_study(virtual_series("cubic"), rng=rng, n_levels=n_levels, phase_error_deg=phase_error_deg)


def with_samples(study, change, modes=None):
    """Return the study with `change(samples, recording)` in place of its samples, read with other modes perhaps."""
    (given,) = study.tests
    record, linear = given.test.recording, modes or study.modes
    changed = replace(record, samples=change(record.samples.copy(), record))
    test = modal_test(changed, linear, name=given.test.name, force=FORCE, drive_point=study.drive_point)
    mode = given.mode if modes is None else int(np.argmin(np.abs(linear.frequency_hz - 120.0))) + 1
    return replace(study, modes=linear, nonlinear=(mode,), tests=(StudyTest(test, "resonance", mode),))


def with_force_turned(study, degrees):
    """Return the study with the force ahead of the accelerations, as a filter in one channel makes it."""

    def turn(samples, record):
        column = record.index(FORCE)
        spectrum = np.fft.rfft(samples[:, column]) * np.exp(1j * np.radians(degrees))
        samples[:, column] = np.fft.irfft(spectrum, len(samples))
        return samples

    return with_samples(study, turn)


def with_polarity_reversed(study):
    """Return the study with a force of the opposite sign."""

    def reverse(samples, record):
        samples[:, record.index(FORCE)] *= -1.0
        return samples

    return with_samples(study, reverse)


def with_sensor_clipped(study, fraction=0.6):
    """Return the study with a sensor whose range ends at a fraction of its largest value."""

    def clip(samples, record):
        column = record.index("board_x")
        limit = fraction * np.abs(samples[:, column]).max()
        samples[:, column] = np.clip(samples[:, column], -limit, limit)
        return samples

    return with_samples(study, clip)


def with_mode_unknown(study, mode=2):
    """Return the study without the shape of a neighbour of the mode that is held."""
    kept = np.delete(np.arange(study.modes.n_modes), mode - 1)
    known = replace(
        study.modes,
        frequency_hz=study.modes.frequency_hz[kept],
        damping_ratio=study.modes.damping_ratio[kept],
        shapes=study.modes.shapes[:, kept],
    )
    return with_samples(study, lambda samples, record: samples, known)
