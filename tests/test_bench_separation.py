"""Parts of a law that the record does not separate have no interval, and the whole force has one."""

import numpy as np
import pytest
from scipy import signal

from opid.estimate import Estimate
from opid.mechanics.laws.law import LINEAR, law
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.record import Bench
from opid.suspensions.bench.separation import explain_inseparable, list_sharing, withhold_below_zero
from opid.suspensions.bench.settings import DEFAULTS

FS = 500.0
ARCTAN = law("arctan_displacement", amplitude_n=400.0, scale_m=0.05)
ARM = law("maxwell_arm", stiffness_n_per_m=1e4, relaxation_s=0.05)
CUBIC = law("cubic_stiffness", stiffness_n_per_m3=4e7)


def bench_of(z, v, force):
    return Bench(z, v, force, FS, 0.0, "recorded", None, {"force": "F", "travel": "z", "velocity": "v"}, ())


def random_motion(rng, n=4000):
    sections = signal.butter(3, 8.0, fs=FS, output="sos")
    z = signal.sosfiltfilt(sections, rng.standard_normal(n + 2000))[1000:-1000]
    z *= 0.005 / z.std()
    return z, np.gradient(z, 1 / FS)


@pytest.mark.parametrize(
    ("of_law", "by_travel", "by_velocity"), [(LINEAR, 0, 0), (ARCTAN, 1, 0), (CUBIC, 0, 0), (ARM, 1, 1)]
)
def test_which_terms_share_the_slope_at_rest(of_law, by_travel, by_velocity):
    assert tuple(map(len, list_sharing(of_law))) == (by_travel, by_velocity)


def explain(stiffness, beside, *, testable=True):
    z, v = random_motion(np.random.default_rng(0))
    bench = bench_of(z, v, z)
    return list(explain_inseparable(bench, stiffness, 100.0, beside, memory_is_testable=testable, settings=DEFAULTS))


def test_a_spring_that_a_term_cancels_is_told():
    against = law("arctan_displacement", amplitude_n=-6.2e4, scale_m=0.06)
    (sentence,) = explain(7e5, against)
    assert sentence.startswith("K alone would make")
    assert "arctan_displacement cancels: the motion shows their sum" in sentence
    assert explain(7e5, ARCTAN) == []  # side by side
    assert explain(-2e4, CUBIC) == []  # two wells: K is the slope at rest


def test_a_memory_that_one_cycle_cannot_show_is_told():
    (sentence,) = explain(2e4, ARM, testable=False)
    assert sentence.startswith("on a motion that repeats one cycle maxwell_arm may stand for a law without memory")
    assert explain(2e4, ARM) == []
    assert explain(2e4, CUBIC, testable=False) == []


def test_a_slope_below_zero_beside_a_slope_has_no_interval():
    both = Estimate.normal(-5e3, 100.0), Estimate.normal(-10.0, 1.0)
    found, sentences = withhold_below_zero(both, ARCTAN)
    assert found == [both[0].without_interval(), both[1]]
    assert [each[:15] for each in sentences] == ["K is below zero", "C is below zero"]
    assert "no interval" in sentences[0]
    assert "the slope of the law at rest" in sentences[1]
    assert withhold_below_zero(both, LINEAR) == (list(both), [])
    wide = Estimate.normal(-5e3, 1e5), Estimate()
    assert withhold_below_zero(wide, ARCTAN) == (list(wide), [])


def test_a_travel_sensor_that_is_not_linear_makes_no_stiffness_of_its_own():
    """1 % of third harmonic: an arctangent with a slope of -670 kN/m beside a spring of 690 kN/m fits best."""
    rng = np.random.default_rng(0)
    z, v = random_motion(rng)
    force = 2e4 * z + 150.0 * v + 4e7 * z**3
    read = z * (1 + 0.01 * (z / np.abs(z).max()) ** 2) + 2e-6 * rng.standard_normal(z.size)
    found = law_of_bench(bench_of(read, v, force + 0.3 * rng.standard_normal(z.size)))
    assert found.parameters.stiffness_n_per_m.value > 1e5
    assert found.parameters.stiffness_n_per_m.interval95 is None
    assert any(each.startswith("K alone would make") for each in found.warnings)
    assert found.cycle.area_j.interval95 is not None
