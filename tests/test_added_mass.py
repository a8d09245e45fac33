"""The paper's Table 3, peak matching, and the absolute scale."""

from dataclasses import replace

import numpy as np
import pytest

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.laws.law import Law
from opid.signals.spectra import CrossSpectra, Transmissibility
from opid.suspensions.paper.added_mass import absolute_parameters, match_peaks, two_peak_mass
from opid.suspensions.paper.spectral_equation import equation_lines, fit_equation
from opid.suspensions.paper.transmissibility import (
    Peak,
    complex_least_squares,
    errors_in_variables,
    mass_over_stiffness,
    suspension_transmissibility,
)
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

# restored peaks of the paper's Table 3: heavy, light, and the mass ratio that they give
TABLE_3 = [
    (Peak(0.125, 0.872), Peak(0.938, 0.21), 0.83),
    (Peak(1.812, 0.490), Peak(6.406, 0.122), 8.6),
    (Peak(15.625, 0.247), Peak(19.531, 0.200), 7.8),
]


@pytest.mark.parametrize(("heavy", "light", "ratio"), TABLE_3)
def test_the_papers_table_3(heavy, light, ratio):
    # T(0) = 0.7 gives the factor 1.428 (printed with three decimals)
    result = two_peak_mass(heavy, light, mass_change_kg=-220.0, static_transmissibility=1 / 1.428)
    np.testing.assert_allclose(result.mass_ratio, ratio, atol=0.05 if ratio > 1 else 0.005)
    np.testing.assert_allclose(result.sprung_mass_kg, 220 * result.mass_ratio)
    np.testing.assert_allclose(result.ground_stiffness_n_per_m, 0.428 * result.stiffness_n_per_m)


def test_none_of_the_papers_matches_is_credible_as_one_peak_moved_by_mass():
    for heavy, light, _ in TABLE_3[:2]:
        match = match_peaks([heavy], [light], mass_change_kg=-220.0)[0]
        assert not match.credible
        assert "would have to be removed" in match.reason


def test_the_papers_stiffness_is_negative_at_its_valid_peaks():
    for heavy, light, _ in TABLE_3[1:]:
        assert mass_over_stiffness(heavy) < 0
        assert mass_over_stiffness(light) < 0
        assert mass_over_stiffness(heavy, restore_sign=True) > 0


def test_ignoring_damping_biases_the_mass_as_in_the_notes():
    frequency_hz = np.linspace(0.2, 8, 400_001)
    for zeta, noted in ((0.05, 1766), (0.1, 1693), (0.2, 1583), (0.3, 1512), (0.5, 1435)):
        peaks = []
        for mass in (1850.0, 1630.0):
            T = suspension_transmissibility(
                frequency_hz,
                stiffness_per_mass=3.9e5 / mass,
                damping_per_mass=2 * zeta * np.sqrt(3.9e5 * 1850) / mass,
            )
            top = int(np.argmax(np.abs(T)))
            peaks.append(Peak(float(frequency_hz[top]), float(np.abs(T[top]))))
        printed, restored = (
            two_peak_mass(*peaks, mass_change_kg=-220.0, static_transmissibility=1.0, restore_sign=sign)
            for sign in (False, True)
        )
        np.testing.assert_allclose(printed.sprung_mass_kg, noted, atol=1.0)
        # the sign mends the stiffness, not the mass: now it errs upwards
        assert restored.sprung_mass_kg > 1850 * (1 + 0.8 * zeta)


@pytest.mark.parametrize(
    ("reference", "changed", "change", "credible", "said"),
    [
        (2.17, 2.31, -220.0, True, "12 %"),
        (2.31, 2.17, 220.0, True, "%"),
        (2.17, 2.05, -220.0, False, "removing mass cannot"),
        (2.17, 6.4, -220.0, False, "would have to be removed"),
        (2.17, 2.172, -220.0, False, "spacing of the lines"),
        (2.17, 2.31, 0.0, False, "same mass"),
    ],
)
def test_a_match_is_judged_with_a_reason(reference, changed, change, credible, said):
    match = match_peaks(
        [Peak(reference, 2.0, resolution_hz=0.03)],
        [Peak(changed, 2.0, resolution_hz=0.03)],
        mass_change_kg=change,
    )[0]
    assert match.credible is credible
    assert said in match.reason


def test_peaks_are_paired_one_to_one():
    heavy, light = [Peak(1.8, 2.0), Peak(15.0, 0.3)], [Peak(15.4, 0.3), Peak(1.92, 2.0), Peak(9.0, 0.1)]
    matches = match_peaks(heavy, light, mass_change_kg=-220.0)
    assert [(m.reference.frequency_hz, m.changed.frequency_hz) for m in matches] == [
        (1.8, 1.92),
        (15.0, 15.4),
    ]
    assert match_peaks([], light, mass_change_kg=-1.0) == ()


def _exact(mass, zeta=0.2, ground=0.0):
    frequency_hz = np.arange(0, 20, 0.1)
    value = suspension_transmissibility(
        frequency_hz,
        stiffness_per_mass=3.9e5 / mass,
        damping_per_mass=2 * zeta * np.sqrt(3.9e5 * 1850) / mass,
        ground_stiffness_per_mass=ground / mass,
    )
    spectra = CrossSpectra(frequency_hz, np.zeros((200, 2, 2), complex), 10, 10.0, "hann", 10, 5, 40.0)
    return Transmissibility(frequency_hz, value, np.full(200, 0.999), "H1", spectra)


@pytest.mark.parametrize("ground", [0.0, 1.67e5])
@pytest.mark.parametrize("zeta", [0.05, 0.3, 0.8])
def test_complex_least_squares_is_exact_at_every_damping(zeta, ground):
    direct = complex_least_squares(_exact(1850.0, zeta, ground))
    expected = [3.9e5 / 1850, 2 * zeta * np.sqrt(3.9e5 / 1850), ground / 1850]
    np.testing.assert_allclose(direct.value, expected, rtol=1e-8, atol=1e-6)
    np.testing.assert_allclose(direct.static_transmissibility, 3.9e5 / (3.9e5 + ground), rtol=1e-8)


def _lines(seed=0, removed=220.0, told=None, duration_s=30):
    test = taxi_test(
        LandingGear(law=Law()),
        rng=np.random.default_rng(seed),
        mass_removed_kg=removed,
        duration_s=duration_s,
        fs=256,
    )
    changes = (0.0, -removed if told is None else told)
    return [
        equation_lines(
            run.recording.channel("lower_z"), run.recording.channel("upper_z"), fs=256, mass_change_kg=change
        )
        for run, change in zip((test.heavy, test.light), changes, strict=True)
    ]


def _fit(lines, mass=1500.0):
    return fit_equation(lines, Law(), stiffness_per_mass=200, damping_per_mass=3, inverse_mass=1 / mass)


def test_one_run_gives_ratios_and_two_the_scale():
    lines = _lines()
    start = complex_least_squares(_exact(1700.0))
    alone = errors_in_variables(lines[0], Law(), start=start)
    np.testing.assert_array_less(np.abs(alone.value - [3.9e5 / 1850, 6e3 / 1850, 0.0]), 5 * alone.std)
    found = absolute_parameters(_fit(lines), [0.0, -220.0])
    truth = [1850, 3.9e5, 6e3, 0]
    np.testing.assert_array_less(np.abs(found.value - truth), 5 * found.std)
    assert found.std[0] < 0.01 * 1850


def test_the_reported_mass_is_the_one_at_no_change_even_if_never_flown():
    lines = _lines()
    # both runs said to be 500 kg heavier than the reference
    shifted = [replace(line, mass_change_kg=line.mass_change_kg + 500.0) for line in lines]
    found = absolute_parameters(_fit(shifted, 1000.0), [500.0, 280.0])
    np.testing.assert_allclose(found.sprung_mass_kg, 1350, rtol=0.01)
    np.testing.assert_allclose(found.slopes[0], 3.9e5, rtol=0.01)


def test_a_mass_change_that_did_not_happen_is_seen():
    with pytest.raises(NotDeterminedError, match=r"does not show|opposite") as caught:
        absolute_parameters(_fit(_lines(removed=0.0, told=-220.0)), [0.0, -220.0])
    assert caught.value.partial is not None


def test_a_mass_change_of_the_wrong_sign_is_seen():
    with pytest.raises(NotDeterminedError, match="sign of the mass change"):
        absolute_parameters(_fit(_lines(told=220.0)), [0.0, 220.0])


def test_bad_input_is_named():
    with pytest.raises(InputError, match="ratios only"):
        two_peak_mass(Peak(1, 1), Peak(1.1, 1), mass_change_kg=0.0)
    with pytest.raises(InputError, match="must be positive"):
        mass_over_stiffness(Peak(0.0, 1.0))
    with pytest.raises(InputError, match="usable lines"):
        complex_least_squares(_exact(1850.0), band_hz=(3.0, 3.2))
    lines = _lines()[:1]
    fit = fit_equation(lines, Law(), stiffness_per_mass=200, damping_per_mass=3)
    with pytest.raises(InputError, match="no free mass"):
        absolute_parameters(fit, [0.0])
