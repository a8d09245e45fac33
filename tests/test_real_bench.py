"""Measured dampers and structures on the bench (benchmarks/real_bench.py): what holds over all records of a set."""

import numpy as np
import pytest
from measured_data import DATA, needs_data
from scripts import script

from opid.signals.recording import recording_from_arrays
from opid.suspensions.bench.law import law_of_bench

# of all kinds it takes five times as long
REMEMBERING = ("dahl_friction", "bouc_wen", "iwan_friction", "arctan_velocity")


@pytest.fixture(scope="module")
def real_bench():
    return script("benchmarks/real_bench.py")


@pytest.fixture(scope="module")
def dampers(real_bench):
    """Laws of the friction damper by frequency, tension of its band and amplitude."""
    studies = real_bench.studies_of("friction_damper_brfd", DATA)
    named = {real_bench.tested(name): study for name, study in studies.items()}
    return {test: law_of_bench(study, candidates=REMEMBERING) for test, study in named.items() if test is not None}


@pytest.mark.slow
@needs_data("friction_damper_brfd")
def test_a_friction_damper_remembers_at_every_tension(dampers):
    for (_, tension, _), found in dampers.items():
        assert found.not_determined is None
        assert found.law.has_memory
        assert found.memory.r2_at_most < found.memory.r2_with_law
        if tension >= 30:
            assert found.r2_left_out > 0.8
        # what follows the acceleration of such a bench is no mass of tons
        assert found.memory.moving_mass_kg is None or found.memory.moving_mass_kg < 1000


@pytest.mark.slow
@needs_data("friction_damper_brfd")
def test_its_friction_grows_with_the_tension(dampers):
    ends = {test: found.cycle.friction_n.interval95 for test, found in dampers.items()}
    # of a joint whose last slider hardly slips in a record no number has an interval
    told = {test: each for test, each in ends.items() if each is not None}
    assert len(told) >= 0.95 * len(ends)
    tensions = sorted({tension for _, tension, _ in told})
    assert len(tensions) >= 2
    for frequency, tension, amplitude in told:
        for each in tensions:
            if each > tension and (frequency, each, amplitude) in told:
                assert told[frequency, tension, amplitude][1] < told[frequency, each, amplitude][0]


@pytest.mark.slow
@needs_data("friction_damper_brfd")
def test_its_friction_hardly_depends_on_the_frequency(dampers):
    """A viscous damper would take eight times the force at eight times the frequency."""
    for tension, amplitude in {(tension, amplitude) for _, tension, amplitude in dampers if tension >= 30}:
        forces = [found.cycle.friction_n.value for key, found in dampers.items() if key[1:] == (tension, amplitude)]
        assert max(forces) < 1.4 * min(forces)


@pytest.mark.slow
@needs_data("friction_damper_brfd")
def test_its_friction_grows_little_with_the_amplitude(dampers):
    """Backlash is a part of the way, and a smaller one of a longer way; a spring would take three times the force."""
    for frequency, tension in {(frequency, tension) for frequency, tension, _ in dampers if tension >= 30}:
        forces = [found.cycle.friction_n.value for key, found in dampers.items() if key[:2] == (frequency, tension)]
        assert max(forces) < 1.8 * min(forces)


@needs_data("mr_damper")
def test_a_magnetorheological_damper_has_a_law_for_each_voltage(real_bench):
    """Friction grows with the voltage; held, a law explains what it cannot where the voltage is not told."""
    records = real_bench.studies_of("mr_damper", DATA)
    kinds = ("arctan_velocity", "coulomb_friction", "signed_power_damping", "dahl_friction")
    on, off, mixed = (
        law_of_bench(records[name], candidates=kinds) for name in ("voltage_on", "voltage_off", "voltage_not_told")
    )
    assert on.r2_left_out > 0.95
    assert off.r2_left_out > 0.9
    assert mixed.r2_left_out < 0.9
    assert mixed.memory.r2_with_law < 0.9
    low, high = off.cycle.friction_n, on.cycle.friction_n
    assert high.interval95[0] > 2 * low.interval95[1]
    # the voltage that is not told lies between
    assert low.value < mixed.cycle.friction_n.value < high.value


@needs_data("cyclic_tests")
def test_cyclic_tests_need_no_time_and_remember(real_bench):
    for found in map(law_of_bench_of_travel, real_bench.cyclic_records(DATA).values()):
        assert found.law.has_memory
        assert found.parameters.damping_n_s_per_m.value is None
        assert found.memory.r2_with_law > found.memory.r2_at_most + 0.02
        assert found.cycle.area_j.interval95[0] > 0
        assert found.memory.cause in (None, "hysteresis")


def law_of_bench_of_travel(bench):
    return law_of_bench(bench, candidates=("dahl_friction", "arctan_displacement", "cubic_stiffness"))


@needs_data("cyclic_tests")
def test_the_pace_of_a_quasi_static_test_means_nothing(real_bench):
    bench = real_bench.cyclic_records(DATA)["gill"]
    force, travel = bench.force[bench.counted], bench.travel[bench.counted]
    found = []
    for times in (1, 2):
        # every second stretch of the record passed slowly
        n = force.size
        places = np.sort(np.concatenate([np.arange(n), *[np.arange(n // 2) + 0.5] * (times - 1)]))
        columns = [np.interp(places, np.arange(n), each) for each in (force, travel)]
        record = recording_from_arrays(columns, ["F", "z"], fs=1.0, unit=["N", "m"])
        found.append(law_of_bench_of_travel(real_bench.quasi_static_bench(record, force="F", travel="z")))
    assert found[0].law.name == found[1].law.name
    assert found[1].cycle.friction_n.value == pytest.approx(found[0].cycle.friction_n.value, rel=0.1)


@needs_data("rack_and_pinion")
def test_one_stroke_tells_neither_friction_nor_memory(real_bench):
    (bench,) = real_bench.rack_records(DATA).values()
    found = law_of_bench(bench, candidates=REMEMBERING)
    assert not found.memory.testable
    assert any("turns round less than twice" in warning for warning in found.warnings)


@needs_data("rack_and_pinion")
def test_no_energy_is_told_that_is_larger_than_the_force_could_take(real_bench):
    """Of one stroke the law of all kinds, whose offset and friction stand for each other."""
    (bench,) = real_bench.rack_records(DATA).values()
    found = law_of_bench(bench)
    ends = found.cycle.area_j.interval95
    most_j = 4 * found.cycle.travel_amplitude_m * np.abs(bench.force).max()
    assert ends is None or ends[1] - ends[0] < 2 * most_j
