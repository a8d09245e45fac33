"""Bodies that tell the force by their acceleration (benchmarks/real_bodies.py): what holds over all records."""

import numpy as np
import pytest
from measured_data import DATA, needs_data
from scripts import script

real_bodies = script("benchmarks/real_bodies.py")


@pytest.fixture(scope="module")
def frame():
    """The records that slide, with their law, and those that do not."""
    records = real_bodies.sliding_records(DATA)
    sliding = {name: each for name, each in records.items() if each.slides.sum() >= real_bodies.LEAST_SAMPLES}
    fractions = real_bodies.mass_fractions(sliding)
    laws = {name: real_bodies.law_of_sliding(each, fractions) for name, each in sliding.items()}
    return records, fractions, laws


@needs_data("sliding_isolators")
def test_only_the_isolated_frame_slides(frame):
    records, _, laws = frame
    assert {name[:2] for name in laws} == {"fp"}
    for name in records.keys() - laws.keys():
        if name.startswith("fb"):
            assert not records[name].slides.any()


@needs_data("sliding_isolators")
def test_the_isolators_rub_alike_in_every_record(frame):
    _, fractions, laws = frame
    assert np.all(fractions > 0.1)
    at_speed = [real_bodies.friction_coefficient(found, 0.15) for found in laws.values()]
    assert np.ptp(at_speed) < 0.2 * np.mean(at_speed)
    for found in laws.values():
        # friction of a polymer on steel grows with the speed
        slow, fast = (real_bodies.friction_coefficient(found, speed) for speed in real_bodies.SPEEDS_M_S)
        assert slow < fast
        assert found.r2_left_out > 0.95


@needs_data("sliding_isolators")
def test_the_pendulum_has_one_period(frame):
    """Records that slide far agree within 3 %; the intervals of all of them meet."""
    records, _, laws = frame
    periods = {name: real_bodies.period_s(found) for name, found in laws.items()}
    far = [period.value for name, period in periods.items() if np.abs(records[name].travel).max() > 0.05]
    assert len(far) >= 3
    assert np.ptp(far) < 0.06 * np.mean(far)
    ends = [period.interval95 for period in periods.values() if period.interval95 is not None]
    assert max(low for low, _ in ends) < min(high for _, high in ends)
    assert all(low < np.mean(far) < high for low, high in ends)


@pytest.fixture(scope="module")
def falls():
    """Impacts that last long enough, with their laws."""
    impacts = real_bodies.impact_records(DATA)
    return {name: (each, real_bodies.law_of_impact(each)) for name, each in impacts.items() if each.is_long_enough}


@needs_data("water_impact")
def test_free_fall_says_that_the_sensors_fit_the_masses(falls):
    for impact, _ in falls.values():
        assert impact.scale == pytest.approx(1, abs=0.02)
        assert impact.late_s == pytest.approx(0.27e-3, abs=0.1e-3)


@needs_data("water_impact")
def test_a_programmed_spring_is_found(falls):
    """Undamped springs: the soft one within 4 % of the slow test; the stiff one repeats but lies 2 to 6 % above it."""
    tests = real_bodies.static_tests(DATA)
    repeated = []
    for name, (impact, found) in falls.items():
        programmed, threshold, _ = real_bodies.programmed(name)
        if "damping" in name or (threshold is not None and found.law.name != "linear"):
            continue
        assert found.law.name == "linear"
        stiffness = found.parameters.stiffness_n_per_m
        static = real_bodies.static_stiffness(
            tests[f"{programmed / 1e3:.0f}npmm"], impact.travel[impact.after_impact].max()
        )
        if programmed == 5e3:
            assert stiffness.value == pytest.approx(static, rel=0.04)
            assert stiffness.interval95[0] < static < stiffness.interval95[1]
        else:
            repeated.append(stiffness.value)
            assert 1.02 < stiffness.value / static < 1.06
    assert np.ptp(repeated) < 0.03 * np.mean(repeated)


@needs_data("water_impact")
def test_a_spring_saturates_where_it_was_programmed_to(falls):
    reached = 0
    for name, (_, found) in falls.items():
        _, threshold, _ = real_bodies.programmed(name)
        force = real_bodies.saturation_n(found)
        if threshold is None:
            assert force.value is None
        elif force.value is not None:
            reached += 1
            assert force.value == pytest.approx(threshold, rel=0.03)
            assert force.interval95[0] < threshold < force.interval95[1]
    assert reached >= 3


@needs_data("water_impact")
def test_a_programmed_damper_is_told_from_none(falls):
    for name, (_, found) in falls.items():
        damping = found.parameters.damping_n_s_per_m.value
        if "_05damping" in name:
            assert 40 < damping < 60
        elif "_025damping" in name:
            assert 20 < damping < 30
        elif "npmm" in name:
            assert 0 < damping < 5


def test_a_fall_has_its_scale_and_its_lateness():
    """Both sides of a spring swing; the accelerometer is 0.4 ms late and reads 3 % too much."""
    t = np.arange(1500) / real_bodies.IMPACT_HZ

    def swing(at):
        return np.exp(-20 * at) * np.sin(2 * np.pi * 40 * at)

    late = t - 0.4e-3
    second = (swing(late + 1e-5) - 2 * swing(late) + swing(late - 1e-5)) / 1e-10
    reading = 1.03 * real_bodies.NOSE_FRACTION * 1e-3 * second + 0.9
    scale, late_s = real_bodies.free_fall(1e-3 * swing(t), reading)
    assert scale == pytest.approx(1.03, abs=0.005)
    assert late_s == pytest.approx(0.4e-3, abs=0.03e-3)


def test_fractions_of_a_mass_come_from_how_it_slides():
    """A frame of known fractions whose floors swing by themselves, while the base slides."""
    rng = np.random.default_rng(0)
    n, fractions = 4000, np.array([0.4, 0.3, 0.2, 0.1])
    t = np.arange(n) / real_bodies.FRAME_HZ
    travel = 0.04 * np.sin(2 * np.pi * 0.6 * t)
    velocity = np.gradient(travel, 1 / real_bodies.FRAME_HZ)
    force = 12.0 * travel + 0.6 * np.sign(velocity)
    swings = rng.standard_normal((3, n))
    base = -force - fractions[1:] @ swings
    record = real_bodies.Sliding(travel, velocity, np.stack([base, *(base + swings)]))
    np.testing.assert_allclose(real_bodies.mass_fractions({"one": record}), fractions, atol=1e-9)
    found = real_bodies.law_of_sliding(record, fractions)
    assert real_bodies.period_s(found).value == pytest.approx(2 * np.pi / np.sqrt(12.0), rel=1e-3)
    assert real_bodies.friction_coefficient(found, 0.15) == pytest.approx(0.6 / real_bodies.G, rel=0.01)
