"""A short force appropriation of the virtual structure with a cubic mode, and worlds in which an assumption fails."""

from dataclasses import replace
from functools import cache

import numpy as np

from opid.mechanics.rig import FORCE
from opid.modal.linear.modes import modal_test
from opid.modal.resonance.appropriation import appropriate_force
from opid.modal.study import StudyTest
from opid.signals.units import STANDARD_GRAVITY
from opid.virtual.modal_tests.resonance_logs import resonance_study
from opid.virtual.modal_tests.response_curves import drive_curves
from opid.virtual.modal_tests.series import CUBIC_DAMPING, CUBIC_MODE, CUBIC_STIFFNESS, virtual_series

K3, C2, MODE = CUBIC_STIFFNESS[3], CUBIC_DAMPING[2], CUBIC_MODE


@cache
def held_study(seed=0, n_levels=12, phase_error_deg=0.0, n_curves=0):
    """The study of a test that meets every assumption, but for the phase at which the loop holds it."""
    return resonance_study(
        virtual_series("cubic"),
        rng=np.random.default_rng(seed),
        n_levels=n_levels,
        n_curves=n_curves,
        phase_error_deg=phase_error_deg,
    )


def true_curves(amplitude):
    """Return frequency and damping ratio of the mode by harmonic linearisation of its true law."""
    modes = virtual_series("cubic").case.modes
    k0, c0 = (float(each[MODE - 1]) for each in (modes.stiffness(), modes.damping()))
    omega = np.sqrt(k0 + 0.75 * K3 * amplitude**2)
    return omega / (2 * np.pi), (c0 + C2 * 8 / (3 * np.pi) * omega * amplitude) / (2 * omega)


def requires_truth_inside(law):
    """Require that a law holds the truth: k3 in its interval, frequency and damping within three deviations."""
    hz, zeta = true_curves(law.amplitude)
    assert 3 not in law.stiffness or law.stiffness[3].holds(K3)
    assert (np.abs(law.frequency_hz - hz) < 3 * law.frequency_std_hz).all()
    assert (np.abs(law.damping_ratio - zeta) < 3 * law.damping_std).all()


def curves_study(seed=0, n_curves=4):
    """Return the study of response curves alone."""
    return replace(held_study(seed, n_curves=n_curves), tests=())


def two_modes(seed=0):
    """A study of which one log holds the cubic mode and another a linear one."""
    cubic, series = held_study(seed), virtual_series("cubic")
    linear = resonance_study(series, rng=np.random.default_rng(seed), mode=2, n_levels=8)
    return replace(cubic, nonlinear=(2, MODE), tests=(*cubic.tests, *linear.tests))


def hurried_study(seed=0, settling=0.3):
    """Return a study of response curves whose frequency moves on before the mode has settled."""
    rng, series = np.random.default_rng(seed), virtual_series("cubic")
    case = series.case
    volts = np.geomspace(0.35, 17.6, 12)
    held = appropriate_force(case.rig, case.modes, MODE, levels_v=volts, rng=rng, drive_point=case.drive_point)
    curves = drive_curves(case.rig, held, n_curves=4, rng=rng, settling=settling)
    return replace(curves_study(), curves=curves)


def with_shapes_scaled(study, factor=1.3):
    """Return the study with shapes that are not mass-normalised: all are too large by a factor."""
    return replace(study, modes=replace(study.modes, shapes=factor * study.modes.shapes))


def with_curves(study, change):
    """Return the study with `change(curve)` in place of the fields of each curve."""
    return replace(study, curves=tuple(replace(each, **change(each)) for each in study.curves))


def with_amplitudes_in_g(study):
    """Return the study with amplitudes in g that are stated to be in m/s^2."""
    return with_curves(study, lambda curve: {"amplitude": curve.amplitude / STANDARD_GRAVITY})


def with_phases_turned(study, degrees):
    """Return the study with a force that is ahead of the motion of its curves, as a filter makes it."""
    return with_curves(study, lambda curve: {"phase_deg": curve.phase_deg - degrees})


def with_softer_curves(study, fraction=0.003):
    """Return the study with curves of another state of the structure than its levels."""
    return with_curves(study, lambda curve: {"frequency_hz": curve.frequency_hz * (1.0 - fraction)})


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
