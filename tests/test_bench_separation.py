"""Parts of a law that the record does not separate have no interval, and the whole force has one."""

import numpy as np
from scipy import signal

from opid.mechanics.laws.law import law
from opid.suspensions.bench.intervals import find_inseparable
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.record import Bench
from opid.suspensions.bench.settings import DEFAULTS

FS = 500.0
CUBIC = law("cubic_stiffness", stiffness_n_per_m3=4e7)
FRICTION = law("arctan_velocity", amplitude_n=20.0, scale_m_per_s=0.02)
ARM = law("maxwell_arm", stiffness_n_per_m=1e4, relaxation_s=0.05)
AGAINST = law("arctan_displacement", amplitude_n=-6.2e4, scale_m=0.06)
"""-6.6e5 N/m at rest."""


def bench_of(z, v, force):
    return Bench(z, v, force, FS, 0.0, "recorded", None, {"force": "F", "travel": "z", "velocity": "v"}, ())


def random_motion(rng, n=4000):
    sections = signal.butter(3, 8.0, fs=FS, output="sos")
    z = signal.sosfiltfilt(sections, rng.standard_normal(n + 2000))[1000:-1000]
    z *= 0.005 / z.std()
    return z, np.gradient(z, 1 / FS)


def find(stiffness, beside, *, damping=100.0, testable=True, offset_m=0.0):
    z, v = random_motion(np.random.default_rng(0))
    bench = bench_of(z + offset_m, v, z)
    return find_inseparable(bench, stiffness, damping, beside, memory_is_testable=testable, settings=DEFAULTS)


def test_a_spring_that_a_term_cancels_is_told_and_the_damper_beside_it_is_kept():
    found = find(7e5, AGAINST + FRICTION)
    (reason,) = found.reasons
    assert reason.startswith("K alone would make")
    assert "which arctan_displacement cancels: the motion shows their sum" in reason
    assert (found.of_travel, found.of_velocity) == (True, False)
    assert [term.name for term in (AGAINST + FRICTION + ARM).terms if found.holds(term)] == [
        "arctan_displacement",
        "maxwell_arm",
    ]


def test_springs_side_by_side_and_two_wells_are_told_apart():
    side_by_side = law("arctan_displacement", amplitude_n=400.0, scale_m=0.05)
    for stiffness, beside in ((2e4, side_by_side), (-2e3, CUBIC), (2e4, CUBIC + ARM)):
        assert find(stiffness, beside).reasons == ()


def test_a_term_without_a_slope_at_rest_cancels_a_spring_on_one_side():
    one_sided = law("asymmetric_stiffness", stiffness_n_per_m=-6.8e5)
    assert find(7e5, one_sided, offset_m=0.03).of_travel


def test_a_damper_that_friction_cancels_leaves_the_spring():
    found = find(2e2, law("arctan_velocity", amplitude_n=-3e4, scale_m_per_s=2.0), damping=1e4)
    assert (found.of_travel, found.of_velocity) == (False, True)


def test_a_memory_that_one_cycle_cannot_show_is_told():
    found = find(2e4, ARM, testable=False)
    assert found.reasons[0].startswith("the memory of maxwell_arm may stand for a law without memory")
    assert found.of_cycle  # the motion is no sine
    assert found.of_travel
    assert found.of_velocity
    assert find(2e4, CUBIC, testable=False).reasons == ()


def test_a_travel_sensor_that_is_not_linear_makes_no_stiffness_of_its_own():
    """1 % of third harmonic: an arctangent with a slope of -670 kN/m beside a spring of 690 kN/m fits best."""
    rng = np.random.default_rng(0)
    z, v = random_motion(rng)
    force = 2e4 * z + 150.0 * v + 4e7 * z**3
    read = z * (1 + 0.01 * (z / np.abs(z).max()) ** 2) + 2e-6 * rng.standard_normal(z.size)
    found = law_of_bench(
        bench_of(read, v, force + 0.3 * rng.standard_normal(z.size)), candidates=("arctan_displacement",)
    )
    assert found.parameters.stiffness_n_per_m.value > 1e5
    assert found.parameters.stiffness_n_per_m.interval95 is None
    assert any(each.startswith("K alone would make") for each in found.warnings)
    assert found.parameters.damping_n_s_per_m.holds(150.0)
    assert found.cycle.area_j.interval95 is not None
