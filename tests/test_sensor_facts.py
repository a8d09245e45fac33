"""What is known of the sensors beforehand: what is refused, and what of it a fit has to find out."""

import numpy as np
import pytest

from opid.errors import InputError
from opid.suspensions.sensor_facts import IDEAL_PAIR, Leak, Nuisance, SensorFacts, SensorPair, nuisance_values

LOOSE = SensorFacts(gain_tolerance=0.03, corner_hz=0.4, corner_tolerance=0.3, lag_tolerance_s=3e-3)


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"gain_tolerance": -0.01}, "gain_tolerance is -0.01: give zero or a positive number"),
        ({"corner_hz": np.inf}, "corner_hz is inf: give zero or a positive number"),
        ({"corner_tolerance": np.nan}, "corner_tolerance is nan: give zero or a positive number"),
        ({"lag_tolerance_s": -1e-3}, "lag_tolerance_s is -0.001: give zero or a positive number"),
        ({"noise_m_per_s2": 0.0}, "noise_m_per_s2 is 0.0: give a positive number, or leave it out"),
        ({"noise_m_per_s2": np.nan}, "noise_m_per_s2 is nan: give a positive number, or leave it out"),
        ({"gain_tolerance": 3.0}, r"gain_tolerance is 3.0: it is relative, give at most 0.5 \(50 %\)"),
        ({"corner_hz": 0.3, "corner_tolerance": 30}, r"corner_tolerance is 30: it is relative, give at most 0.5"),
        ({"corner_tolerance": 0.3}, "corner_tolerance is given without corner_hz: give the nominal corner"),
    ],
)
def test_facts_that_cannot_be_are_refused(facts, words):
    with pytest.raises(InputError, match=words):
        SensorFacts(**facts)


@pytest.mark.parametrize(
    ("leak", "words"),
    [
        ({"into": "wing"}, "a leak goes into 'wing': give 'sprung' or 'unsprung'"),
        ({"into": "sprung", "tolerance": 0.0}, "the tolerance of a leak is 0.0: give a share between 0 and 1"),
        ({"into": "sprung", "tolerance": 5.0}, "the tolerance of a leak is 5.0: give a share between 0 and 1"),
        ({"into": "sprung", "tolerance": np.nan}, "the tolerance of a leak is nan: give a share"),
    ],
)
def test_leaks_that_cannot_be_are_refused(leak, words):
    with pytest.raises(InputError, match=words):
        Leak("lower_x", **leak)


def test_nothing_of_an_ideal_pair_is_fitted():
    assert IDEAL_PAIR.nuisances == ()
    # a corner that is known, and noise, are no unknowns
    known = SensorFacts(noise_m_per_s2=5e-3, corner_hz=0.3)
    assert SensorPair(known, known).nuisances == ()


def test_every_tolerance_is_one_unknown_and_the_two_lags_are_one():
    pair = SensorPair(LOOSE, SensorFacts(gain_tolerance=0.01, lag_tolerance_s=4e-3), (Leak("lower_x", "unsprung"),))
    assert pair.nuisances == (
        Nuisance("gain_unsprung", "gain", "unsprung", 1.0, 0.03),
        Nuisance("corner_unsprung_hz", "corner", "unsprung", 0.4, 0.3 * 0.4),
        Nuisance("gain_sprung", "gain", "sprung", 1.0, 0.01),
        Nuisance("lag_s", "lag", "sprung", 0.0, 5e-3),
        Nuisance("leak[0]", "leak", "unsprung", 0.0, 0.05, 0),
    )


def test_values_are_the_fitted_ones_and_else_nominal():
    pair = SensorPair(LOOSE, leaks=(Leak("upper_x", "sprung"),))
    values = nuisance_values(["stiffness_per_mass", "gain_unsprung", "leak[0]"], np.array([210.0, 1.02, 0.03]), pair)
    assert values == {"gain_unsprung": 1.02, "corner_unsprung_hz": 0.4, "lag_s": 0.0, "leak[0]": 0.03}
    with pytest.raises(ValueError, match=r"shorter|longer"):
        nuisance_values(["gain_unsprung"], [1.0, 2.0], pair)
