"""Bodies that tell the force by their acceleration (benchmarks/real_bodies.py): what holds over all records."""

from contextlib import suppress

import numpy as np
import pytest
from measured_data import DATA, needs_data
from scripts import script

from opid.errors import InputError
from opid.signals.recording import recording_from_arrays
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.record import BenchStudy

real_bodies = script("benchmarks/real_bodies.py")
real_records = script("examples/real_records.py")


def laws_of(name):
    """The study of each record of a set that is long enough, with its law."""
    studies = {}
    for each in real_records.records_in(name, DATA):
        with suppress(InputError):
            studies[each] = real_records.read_set(name, DATA, (each,))
    return {each: (study, law_of_bench(study)) for each, study in studies.items()}


@pytest.fixture(scope="module")
def frame():
    """All records of the frame, and the laws of those that slide."""
    laws = {name: found for name, (_, found) in laws_of("sliding_isolators_bench").items()}
    return real_records.sliding_records(DATA / "sliding_isolators"), laws


@needs_data("sliding_isolators")
def test_only_the_isolated_frame_slides(frame):
    records, laws = frame
    assert {name[:2] for name in laws} == {"fp"}
    for name in records.keys() - laws.keys():
        if name.startswith("fb"):
            assert not records[name].slides.any()


@needs_data("sliding_isolators")
def test_the_isolators_rub_alike_in_every_record(frame):
    records, laws = frame
    assert np.all(real_records.mass_fractions(tuple(records.values())) > 0.1)
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
    records, laws = frame
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
    return laws_of("water_impact")


@pytest.mark.slow
@needs_data("water_impact")
def test_free_fall_says_that_the_sensors_fit_the_masses(falls):
    for name in falls:
        scale, late_s = real_records.free_fall(*real_records.falling(DATA / "water_impact", name))
        assert scale == pytest.approx(1, abs=0.02)
        assert late_s == pytest.approx(0.27e-3, abs=0.1e-3)


@pytest.mark.slow
@needs_data("water_impact")
def test_a_programmed_spring_is_found(falls):
    """Undamped springs: the soft one within 4 % of the slow test; the stiff one repeats and lies within 6 % of it."""
    tests = real_bodies.static_tests(DATA / "water_impact")
    repeated = []
    for name, (study, found) in falls.items():
        programmed, threshold, _ = real_records.programmed(name)
        if "damping" in name or (threshold is not None and found.law.name != "linear"):
            continue
        assert found.law.name == "linear"
        stiffness = found.parameters.stiffness_n_per_m
        static = real_bodies.static_stiffness(
            tests[f"{programmed / 1e3:.0f}npmm"], study.recording.channel("travel").max()
        )
        if programmed == 5e3:
            assert stiffness.value == pytest.approx(static, rel=0.04)
            assert stiffness.interval95[0] < static < stiffness.interval95[1]
        else:
            repeated.append(stiffness.value)
            assert stiffness.value == pytest.approx(static, rel=0.06)
    assert np.ptp(repeated) < 0.03 * np.mean(repeated)


@pytest.mark.slow
@needs_data("water_impact")
def test_a_spring_saturates_where_it_was_programmed_to(falls):
    reached = 0
    for name, (_, found) in falls.items():
        _, threshold, _ = real_records.programmed(name)
        force = real_bodies.saturation_n(found)
        if threshold is None:
            assert force.value is None
        elif force.value is not None:
            reached += 1
            assert force.value == pytest.approx(threshold, rel=0.03)
            assert force.interval95[0] < threshold < force.interval95[1]
    assert reached >= 3


@pytest.mark.slow
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
    t = np.arange(1500) / real_records.IMPACT_HZ

    def swing(at):
        return np.exp(-20 * at) * np.sin(2 * np.pi * 40 * at)

    late = t - 0.4e-3
    second = (swing(late + 1e-5) - 2 * swing(late) + swing(late - 1e-5)) / 1e-10
    reading = 1.03 * real_records.NOSE_FRACTION * 1e-3 * second + 0.9
    scale, late_s = real_records.free_fall(1e-3 * swing(t), reading)
    assert scale == pytest.approx(1.03, abs=0.005)
    assert late_s == pytest.approx(0.4e-3, abs=0.03e-3)


def test_fractions_of_a_mass_come_from_how_it_slides():
    """A frame of known fractions whose floors swing by themselves, while the base slides."""
    rng = np.random.default_rng(0)
    n, fractions = 4000, np.array([0.4, 0.3, 0.2, 0.1])
    t = np.arange(n) / real_records.FRAME_HZ
    travel = 0.04 * np.sin(2 * np.pi * 0.6 * t)
    velocity = np.gradient(travel, 1 / real_records.FRAME_HZ)
    force = 12.0 * travel + 0.6 * np.sign(velocity)
    swings = rng.standard_normal((3, n))
    base = -force - fractions[1:] @ swings
    record = real_records.Sliding(travel, velocity, np.stack([base, *(base + swings)]))
    np.testing.assert_allclose(real_records.mass_fractions((record,)), fractions, atol=1e-9)
    columns = [fractions @ record.floors, travel, velocity]
    recording = recording_from_arrays(columns, ["a", "z", "v"], fs=real_records.FRAME_HZ, unit=["m/s^2", "m", "m/s"])
    study = BenchStudy("", recording, "a", "z", "v", mass_kg=1.0, candidates=("coulomb_friction",))
    found = law_of_bench(study)
    assert real_bodies.period_s(found).value == pytest.approx(2 * np.pi / np.sqrt(12.0), rel=1e-3)
    assert real_bodies.friction_coefficient(found, 0.15) == pytest.approx(0.6 / real_records.G, rel=0.01)
