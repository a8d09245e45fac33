"""Transmissibility beneath a nonlinear force, and peaks."""

import numpy as np
import pytest
from scipy import signal

from opid.errors import InputError
from opid.signals.spectra import transmissibility
from opid.suspensions.paper.transmissibility import (
    _find_prominent_maxima,
    suspension_transmissibility,
    transmissibility_peaks,
    transmissibility_without_force,
)
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_run


@pytest.fixture(scope="module")
def run():
    return taxi_run(LandingGear(), rng=np.random.default_rng(0), duration_s=120, fs=256, speed_m_per_s=(8, 8))


def _true(T, gear):
    return suspension_transmissibility(
        T.frequency_hz,
        stiffness_per_mass=gear.suspension_stiffness_n_per_m / gear.sprung_mass_kg,
        damping_per_mass=gear.suspension_damping_n_s_per_m / gear.sprung_mass_kg,
    )


def test_conditioning_finds_the_linear_suspension_and_subtraction_does_not(run):
    x1, x2 = run.truth.channel("lower_z"), run.truth.channel("upper_z")
    force = run.gear.law.force(run.truth.channel("travel"), run.truth.channel("travel_velocity"))
    force = force / run.gear.sprung_mass_kg
    settings = {"fs": 256, "nperseg": 256 * 16}
    error = {}
    for method in ("conditioned", "subtracted"):
        T = transmissibility_without_force(x1, x2, force, method=method, **settings)
        inside = (T.frequency_hz > 1) & (T.frequency_hz < 8)
        error[method] = np.median(np.abs(T.value - _true(T, run.gear))[inside] / np.abs(_true(T, run.gear))[inside])
    raw = transmissibility(x1, x2, **settings)
    error["raw"] = np.median(np.abs(raw.value - _true(raw, run.gear))[inside] / np.abs(_true(raw, run.gear))[inside])
    assert error["conditioned"] < 0.02
    assert error["subtracted"] > 0.05
    assert error["raw"] > 0.05


def test_no_force_is_the_plain_transmissibility(run):
    x1, x2 = run.truth.channel("lower_z"), run.truth.channel("upper_z")
    plain = transmissibility(x1, x2, fs=256, nperseg=1024)
    np.testing.assert_array_equal(
        transmissibility_without_force(x1, x2, np.zeros(x1.size), fs=256, nperseg=1024).value, plain.value
    )


def test_a_suspension_has_one_peak_and_it_is_found(run):
    force = run.gear.law.force(run.truth.channel("travel"), run.truth.channel("travel_velocity"))
    T = transmissibility_without_force(
        run.truth.channel("lower_z"),
        run.truth.channel("upper_z"),
        force / run.gear.sprung_mass_kg,
        fs=256,
        nperseg=256 * 16,
    )
    peaks = transmissibility_peaks(T, band_hz=(0.5, 10))
    strongest = max(peaks, key=lambda peak: peak.magnitude)
    true = _true(T, run.gear)
    expected = T.frequency_hz[np.argmax(np.abs(true))]
    assert abs(strongest.frequency_hz - expected) < 0.15
    # blocks of 16 s blunt a peak that is half a hertz wide, they never sharpen it
    assert 0.75 < strongest.magnitude / np.abs(true).max() < 1.02


@pytest.mark.parametrize("seed", range(20))
def test_prominent_maxima_are_those_of_scipy(seed):
    rng = np.random.default_rng(seed)
    height, least = rng.standard_normal(200).cumsum(), rng.uniform(0.1, 5, 200)
    expected, _ = signal.find_peaks(height, prominence=least)
    assert _find_prominent_maxima(height, least) == expected.tolist()
    assert expected.size > 3


def test_white_noise_has_no_peaks():
    rng = np.random.default_rng(7)
    found = sum(
        len(transmissibility_peaks(transmissibility(*rng.standard_normal((2, 8192)), fs=256, nperseg=512)))
        for _ in range(10)
    )
    assert found <= 30  # in 500 lines of pure chance


def test_bad_input_is_named():
    with pytest.raises(InputError, match="one length"):
        transmissibility_without_force(np.zeros(10), np.zeros(10), np.zeros(11), fs=1.0)
    with pytest.raises(InputError, match="'conditioned' or 'subtracted'"):
        transmissibility_without_force(*np.zeros((3, 100)), fs=1.0, method="minus")
