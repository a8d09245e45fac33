"""What is known of the sensors beforehand: what is refused, and what of it a fit has to find out."""

import numpy as np
import pytest

from opid.errors import InputError, NotDeterminedError
from opid.suspensions.sensor_facts import IDEAL, Fault, Leak, SensorFacts, Sensors, ideal_sensors

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
        ({"into": "sprung", "tolerance": 0.0}, "the tolerance of a leak is 0.0: give a fraction between 0 and 1"),
        ({"into": "sprung", "tolerance": 5.0}, "the tolerance of a leak is 5.0: give a fraction between 0 and 1"),
        ({"into": "sprung", "tolerance": np.nan}, "the tolerance of a leak is nan: give a fraction"),
    ],
)
def test_leaks_that_cannot_be_are_refused(leak, words):
    with pytest.raises(InputError, match=words):
        Leak("lower_x", **leak)


def test_nothing_of_ideal_sensors_is_fitted():
    assert ideal_sensors(3, 4).faults == ()
    # a corner that is known, and noise, are no unknowns
    known = SensorFacts(noise_m_per_s2=5e-3, corner_hz=0.3)
    assert Sensors((known,), (known,), ("",)).faults == ()


def test_every_tolerance_is_one_unknown_and_the_two_lags_of_an_interface_are_one():
    above = SensorFacts(gain_tolerance=0.01, lag_tolerance_s=4e-3)
    one = Sensors((LOOSE,), (above,), ("",), (("unsprung", 0, 0.05),))
    expected = (
        Fault("gain_unsprung", "gain", "unsprung", 0, 1.0, 0.03),
        Fault("corner_unsprung_hz", "corner", "unsprung", 0, 0.4, 0.3 * 0.4),
        Fault("gain_sprung", "gain", "sprung", 0, 1.0, 0.01),
        Fault("lag_s", "lag", "sprung", 0, 0.0, 5e-3),
        Fault("leak[0]", "leak", "unsprung", 0, 0.0, 0.05, 0),
    )
    assert one.faults == expected
    # of several interfaces and a further sensor each fault is named after its place
    several = Sensors((IDEAL, LOOSE), (IDEAL, above, above), ("nose", "left", "tail"), (("sprung", 1, 0.02),))
    assert [(fault.name, fault.side, fault.channel) for fault in several.faults] == [
        ("gain_unsprung[left]", "unsprung", 1),
        ("corner_unsprung_hz[left]", "unsprung", 1),
        ("gain_sprung[left]", "sprung", 1),
        ("gain_sprung[tail]", "sprung", 2),
        ("lag_s[left]", "sprung", 1),
        ("lag_s[tail]", "sprung", 2),
        ("leak[0]", "sprung", 1),
    ]
    assert several.faults[5].std == 4e-3


def test_a_changed_fact_is_of_one_sensor():
    sensors = ideal_sensors(2, 3).changed("sprung", 1, gain_tolerance=0.02)
    assert [facts.gain_tolerance for facts in sensors.sprung] == [0.0, 0.02, 0.0]
    assert sensors.unsprung == (IDEAL, IDEAL)


def test_the_mean_of_a_pair_errs_less_and_keeps_its_corner_and_leaks():
    coupled = SensorFacts(4e-3, gain_tolerance=0.03, corner_hz=0.3, corner_tolerance=0.1, lag_tolerance_s=3e-3)
    other = SensorFacts(3e-3, gain_tolerance=0.04, corner_hz=0.34, corner_tolerance=0.1, lag_tolerance_s=4e-3)
    leaks = (("sprung", 2, 0.05), ("unsprung", 0, 0.02), ("sprung", 3, 0.01), ("sprung", 1, 0.03))
    sensors = Sensors((IDEAL, coupled, other), (LOOSE, IDEAL, IDEAL, IDEAL), ("nose", "left", "right", "tail"), leaks)
    mean = sensors.mean_of((1, 2))
    (below,) = mean.unsprung
    assert mean.sprung == (IDEAL,)
    np.testing.assert_allclose(
        [below.noise_m_per_s2, below.gain_tolerance, below.corner_hz, below.lag_tolerance_s],
        [2.5e-3, 0.025, 0.32, 2.5e-3],
    )
    np.testing.assert_allclose(below.corner_tolerance * below.corner_hz, np.hypot(0.03, 0.034) / 2)
    assert sensors.leaks_into((1, 2)) == [0, 3]
    assert mean.leaks == (("sprung", 0, 0.05), ("sprung", 0, 0.03))
    # one gear keeps its facts as they are
    assert sensors.mean_of((0,)) == Sensors((IDEAL,), (LOOSE,), ("",), (("unsprung", 0, 0.02),))


def test_unlike_corners_have_no_mean():
    sensors = Sensors((IDEAL, IDEAL), (SensorFacts(corner_hz=0.33, corner_tolerance=0.2), IDEAL), ("left", "right"))
    with pytest.raises(NotDeterminedError, match=r"sprung sensors have different corners .*\(0.33 and none, in Hz\)"):
        sensors.mean_of((0, 1))
