from dataclasses import replace

import numpy as np
import pytest
from made_beats import C2, FOUR, FREQUENCY, FS, K3, OMEGA, ONE, ZETA, beat, beats, measured, softening

from opid.errors import InputError
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.modal.forced.equation import mode_lines
from opid.modal.forced.mode_fit import fit_mode
from opid.modal.forced.restoring_fit import fit_coefficients, fit_modal_mass, fit_unweighted
from opid.modal.linear.modes import LinearModes
from opid.modal.model import NonlinearModalModel

BAND = (100.0, 140.0)
CUBIC = {"stiffness_order": 3, "damping_order": 3}


@pytest.fixture(scope="module")
def clean():
    return beats(softening(), None)


@pytest.fixture(scope="module")
def noisy():
    return [beats(softening(), np.random.default_rng(seed)) for seed in range(6)]


def lines_of(tests, band=BAND, mode=1):
    return [mode_lines(test, mode, band) for test in tests]


def test_the_law_comes_back_without_noise(clean):
    found = fit_coefficients(lines_of(clean), **CUBIC)
    np.testing.assert_allclose(found.stiffness()[3].value, K3, rtol=3e-4)
    np.testing.assert_allclose(found.damping()[2].value, C2, rtol=1e-3)


def test_intervals_hold_the_law(noisy):
    held = []
    for tests in noisy:
        found = fit_coefficients(lines_of(tests), **CUBIC)
        assert abs(found.stiffness()[3].value / K3 - 1) < 0.003
        assert abs(found.damping()[2].value / C2 - 1) < 0.025
        for estimate, truth in ((found.stiffness()[3], K3), (found.damping()[2], C2), (found.stiffness()[2], 0.0)):
            held.append(abs(estimate.value - truth) < 3 * estimate.std)
    assert np.mean(held) > 0.9


def test_weights_sharpen_the_damping(noisy):
    weighted, printed = (
        np.std([fit(lines_of(tests), **CUBIC).damping()[2].value for tests in noisy])
        for fit in (fit_coefficients, fit_unweighted)
    )
    assert weighted < 0.75 * printed


def test_the_band_hardly_matters_with_weights(noisy):
    narrow, wide = (
        fit_coefficients(lines_of(noisy[0], band), **CUBIC, free_linear=True).stiffness()[3].value
        for band in ((110.0, 130.0), (60.0, 240.0))
    )
    assert abs(narrow / wide - 1) < 0.004


def test_free_linear_corrections_mend_wrong_linear_modes(noisy):
    off = LinearModes([FREQUENCY * 1.001], [ZETA * 1.05], [[0.5]], ("a",))
    tests = [replace(test, modes=off) for test in noisy[0]]
    fixed = fit_mode(tests, 1, **CUBIC, free_linear=False)
    free = fit_mode(tests, 1, **CUBIC)
    assert free.free_linear
    assert abs(fixed.stiffness[3].value / K3 - 1) > 0.03
    assert abs(free.stiffness[3].value / K3 - 1) < 0.01
    k1_true = OMEGA**2 - (1.001 * OMEGA) ** 2
    assert abs(free.stiffness[1].value / k1_true - 1) < 0.05


def test_columns_are_scaled(clean):
    found = fit_coefficients(lines_of(clean), stiffness_order=5, damping_order=5)
    assert found.condition_raw > 1e12
    assert found.condition_scaled < 2e3


def test_a_record_cut_off_is_refused_and_can_be_tapered(noisy):
    force = beat(44.0, whole_s=6.0)
    whole = measured(softening(), force, np.random.default_rng(1))
    cut = replace(
        whole,
        recording=whole.recording.section(0.0, 1.1),
        acceleration=whole.acceleration[: round(1.1 * FS)],
        forces=(replace(whole.forces[0], samples=whole.force[: round(1.1 * FS)]),),
    )
    with pytest.raises(InputError, match=r"ends with \d+\.\d % of its largest motion in mode 1: record from rest"):
        fit_mode([cut], 1, **CUBIC)
    tapered = fit_mode([cut], 1, **CUBIC, free_linear=False, band_hz=(95.0, 145.0), taper_s=0.1)
    assert abs(tapered.stiffness[3].value / K3 - 1) < 0.05


def test_modal_mass_is_one_and_shows_wrong_shapes_and_units(noisy):
    mass = fit_modal_mass(lines_of(noisy[0]))
    assert abs(mass.value - 1) < 4 * mass.std + 1e-3
    unit_norm = LinearModes([FREQUENCY], [ZETA], [[1.0]], ("a",))
    tests = [
        replace(test, modes=unit_norm, acceleration=test.acceleration * 0.5) for test in noisy[0]
    ]  # q halves as the shape doubles
    with pytest.raises(InputError, match=r"modal mass of 4 where .* multiply the shape of mode 1 by 0.5"):
        fit_mode(tests, 1, **CUBIC)
    tests = [replace(test, forces=(replace(test.forces[0], samples=test.force * 0.2248),)) for test in noisy[0]]
    with pytest.raises(InputError, match=r"modal mass of 0\.225 .*lbf taken for N"):
        fit_mode(tests, 1, **CUBIC)


def test_what_cannot_be_fitted_is_said(noisy):
    tests = noisy[0]
    with pytest.raises(InputError, match="the order is 6: give 1"):
        fit_mode(tests, 1, stiffness_order=6, damping_order=1)
    with pytest.raises(InputError, match="moves mode 1 more than the other modes"):
        fit_mode([], 1)
    with pytest.raises(InputError, match=r"puts no energy into 300 to 330 Hz"):
        fit_mode(tests, 1, band_hz=(300.0, 330.0), **CUBIC)
    with pytest.raises(InputError, match="give a longer record or a wider band"):
        fit_mode(tests, 1, band_hz=(119.9, 120.1), **CUBIC)
    one_short = lines_of(tests[:1], (118.0, 121.0))
    with pytest.raises(InputError, match="lower stiffness_order"):
        fit_coefficients(one_short, stiffness_order=5, damping_order=5)


def test_curves_hold_the_truth_and_start_at_zero(noisy):
    fit = fit_mode(noisy[0], 1, stiffness_order=5, damping_order=5, free_linear=False)
    q = fit.stiffness_curve.position
    inside = (fit.stiffness_curve.low - 2 <= K3 * q**3) & (fit.stiffness_curve.high + 2 >= K3 * q**3)
    assert inside.mean() > 0.9
    assert fit.stiffness_curve.force[0] == 0
    natural = np.sqrt(OMEGA**2 + first_harmonic_factor(3) * K3 * q**2) / (2 * np.pi)
    np.testing.assert_allclose(fit.frequency_at_hz, natural, rtol=2e-3)


def test_a_linear_mode_gets_no_law():
    tests = beats(NonlinearModalModel(ONE), np.random.default_rng(3))
    fit = fit_mode(tests, 1)
    assert (fit.stiffness_order, fit.damping_order) == (1, 1)
    assert not fit.law.terms


def test_orders_are_found(noisy):
    fit = fit_mode(noisy[0], 1)
    assert fit.stiffness_order == 3
    assert fit.damping_order >= 2
    assert sum(rung.chosen for rung in fit.orders) == 1


def test_other_modes_do_not_spoil_the_fit():
    model = softening(FOUR, mode=3)
    tests = beats(model, np.random.default_rng(5), levels=(5.0, 16.0, 33.0, 55.0))
    fit = fit_mode(tests, 3, **CUBIC)
    assert abs(fit.stiffness[3].value / K3 - 1) < 0.003
    assert abs(fit.damping[2].value / C2 - 1) < 0.025


def test_a_time_shift_changes_nothing(clean):
    shifted = replace(
        clean[-1],
        acceleration=np.roll(clean[-1].acceleration, 100, axis=0),
        forces=(replace(clean[-1].forces[0], samples=np.roll(clean[-1].force, 100)),),
    )
    one, other = (fit_coefficients(lines_of([test]), **CUBIC).value for test in (clean[-1], shifted))
    np.testing.assert_allclose(one, other, rtol=1e-6)
