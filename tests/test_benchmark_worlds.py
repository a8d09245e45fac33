"""What the benchmarks simulate by themselves: gears whose struts remember, and laws of every kind."""

import numpy as np
import pytest
from scipy import signal
from scripts import script

import opid
from opid.mechanics.laws.kinds import LAWS
from opid.mechanics.response import time_response
from opid.signals.recording import recording_from_arrays
from opid.suspensions.sensor_facts import SensorFacts, SensorPair
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear, airframe_structure


@pytest.fixture(scope="module")
def worlds():
    return script("benchmarks/worlds.py")


@pytest.fixture(scope="module")
def drawn_laws():
    return script("benchmarks/drawn_laws.py")


def force_along(memory, parameters, rate, *, step_s=1e-5):
    """Force of a strut that is moved at a rate, and its travel, each (n,); the midpoint rule."""
    h, z, forces, travels = 0.0, 0.0, [], []
    for v in rate:
        middle = h + 0.5 * step_s * memory.py_func(h, z, v, parameters)[0]
        h += step_s * memory.py_func(middle, z, v, parameters)[0]
        z += step_s * v
        forces.append(memory.py_func(h, z, v, parameters)[1])
        travels.append(z)
    return np.array(forces), np.array(travels)


def there_and_back(n=20000):
    return np.concatenate([np.full(n, 0.02), np.full(n, -0.02)])


def test_dahl_friction_is_its_closed_form(worlds):
    stiffness, slip = worlds.DAHL
    force, travel = force_along(worlds.dahl, worlds.DAHL, there_and_back())
    out, back = slice(0, 20000), slice(20000, None)
    expected = slip * (1.0 - np.exp(-stiffness * travel[out] / slip))
    np.testing.assert_allclose(force[out], expected, atol=1e-3 * slip)
    # on the way back it starts from full slip the other way
    gone = travel[out][-1] - travel[back]
    expected = -slip + (slip + force[19999]) * np.exp(-stiffness * gone / slip)
    np.testing.assert_allclose(force[back], expected, atol=1e-3 * slip)


def test_a_bushing_of_bouc_and_wen_is_a_spring_that_yields_and_leaves_a_loop(worlds):
    stiffness, yielding, _, _ = worlds.BOUC_WEN
    force, travel = force_along(worlds.bouc_wen, worlds.BOUC_WEN, there_and_back(40000))
    small = travel[:40000] < 0.05 * yielding
    np.testing.assert_allclose(force[:40000][small], stiffness * travel[:40000][small], rtol=5e-3)
    assert force[39999] == pytest.approx(stiffness * yielding, rel=1e-3)
    # the way out and back encloses what is lost: two yield forces times the way, but for the springing back
    lost = np.sum(np.diff(travel) * 0.5 * (force[1:] + force[:-1]))
    assert 1.2 < lost / (stiffness * yielding * travel.max()) < 2.0


@pytest.mark.parametrize("speed", [0.002, 0.02, 0.2])
def test_lugre_slides_with_the_stribeck_curve(worlds, speed):
    _, _, slip, sticking, stribeck = worlds.LUGRE
    force, _ = force_along(worlds.lugre, worlds.LUGRE, np.full(int(0.0025 / speed / 1e-5) + 1000, speed))
    assert force[-1] == pytest.approx(slip + (sticking - slip) * np.exp(-((speed / stribeck) ** 2)), rel=1e-3)


def test_the_integrator_of_the_worlds_agrees_with_the_time_response(worlds):
    gear = LandingGear()
    n = 1025
    rng = np.random.default_rng(4)
    knots = np.cumsum(rng.standard_normal((2, 2 * n - 1)), axis=1)
    under, aside = 1e3 * knots[0], 30.0 * knots[1]
    numbers = (105.0, 1850.0, 6.2e5, 1.5e3, 3.9e5, 6e3)
    own = worlds._integrated(worlds.arctan_friction, (400.0, 0.02), numbers, under, aside, 1.0 / 4096.0)
    theirs = time_response(
        airframe_structure(gear.airframe), np.stack([aside, under], axis=1), fs=4096.0, duration_s=n / 4096.0
    )
    accelerations = own[:, :2]
    np.testing.assert_allclose(
        accelerations, theirs.acceleration[:, ::-1], rtol=1e-9, atol=1e-9 * np.abs(accelerations).max()
    )
    # the airframe is the first degree of freedom of theirs
    for column, moved in ((2, theirs.displacement), (3, theirs.velocity)):
        travel = moved[:, 0] - moved[:, 1]
        np.testing.assert_allclose(own[:, column], travel, rtol=1e-9, atol=1e-9 * np.abs(travel).max())
    # what the strut does to the airframe and what pushes it accelerate it
    np.testing.assert_allclose(aside[::2] - own[:, 4], 1850.0 * own[:, 1], rtol=1e-9, atol=1e-6)


def test_a_bump_stop_of_the_worlds_pushes_beyond_its_gap_alone(worlds):
    stiffness, gap = worlds.STOP
    force, travel = force_along(worlds.bump_stop, worlds.STOP, np.repeat([-0.02, 0.02], 50000))
    np.testing.assert_allclose(force, -stiffness * np.maximum(-travel - gap, 0.0), atol=1e-9 * stiffness)
    assert force.min() < -0.5 * stiffness * gap


def test_a_push_of_three_per_cent_moves_the_airframe_by_about_that(worlds):
    plain, _ = worlds._two_runs("plain", worlds.arctan_friction, worlds.FRICTION, 1)
    pushed, mass_kg = worlds.pushed(1)
    assert mass_kg == 1850.0
    moved, road = (np.std(each) for each in (
        pushed.runs[0].recording.channel("upper_z") - plain.runs[0].recording.channel("upper_z"),
        plain.runs[0].recording.channel("upper_z"),
    ))  # fmt: skip
    assert 0.01 < moved / road < 0.1


def test_the_straight_suspension_of_friction_is_its_describing_function():
    """Coulomb friction A under a sine of amplitude a: 4 A/(pi a omega) of damping and no stiffness."""
    equivalents = script("benchmarks/equivalents.py")
    friction, amplitude, omega, mass = 400.0, 0.01, 2 * np.pi * 2.0, 1850.0
    phase = omega * (np.arange(100000) + 0.5) / 10000.0
    travel, velocity = amplitude * np.sin(phase), amplitude * omega * np.cos(phase)
    force = 3.9e5 * travel + 6e3 * velocity + friction * np.sign(velocity)
    recording = recording_from_arrays([np.zeros(5120)] * 2, ["lower_z", "upper_z"], fs=512.0)
    rolled = equivalents.Rolled(recording, travel, velocity, force)
    stiffness, damping = 3.9e5, 6e3 + 4 * friction / (np.pi * amplitude * omega)
    expected = [
        stiffness / mass,
        damping / mass,
        np.sqrt(stiffness / mass) / (2 * np.pi),
        damping / (2 * np.sqrt(stiffness * mass)),
    ]
    np.testing.assert_allclose(equivalents.straight(rolled, mass), expected, rtol=1e-6)
    # harmonics of the friction lie outside this band, in which nothing else is
    np.testing.assert_allclose(equivalents.straight(rolled, mass, (1.0, 3.0)), expected, rtol=1e-4)


def test_the_chain_beside_a_benchmark_counts_what_is_not_told():
    chain = script("benchmarks/paper_chain.py")
    errors = [chain.ChainErrors(-0.5, np.nan), chain.ChainErrors(0.1, np.nan), chain.ChainErrors(np.nan, np.nan)]
    assert chain.chain_cells(errors) == "0.30 / 0.50 (2 of 3 answered) | - (0 of 3 answered)"


def test_the_chain_beside_a_benchmark_finds_the_mass_of_a_gear_and_refuses_one_that_remembers(worlds):
    chain = script("benchmarks/paper_chain.py")
    nominal, _ = worlds.nominal(0)
    assert abs(chain.chain_errors(worlds.GEAR, nominal).mended) < 1.0
    remembers, _ = worlds.WORLDS["Bouc-Wen"].study(0)
    assert np.isnan(chain.chain_errors(worlds.GEAR, remembers).mended)


def test_every_kind_that_is_searched_by_its_scales_is_drawn(drawn_laws):
    of_scales = {
        name
        for name, kind in LAWS.items()
        if kind.searched
        and kind.memory is None
        and all(each.role in ("amplitude", "scale") or each.known for each in kind.parameters)
    }
    assert set(drawn_laws.ALL_KINDS) == of_scales | {"arctan_mixed"}


def test_drawn_laws_leave_damping_and_stiffness_positive(drawn_laws):
    gear, motion = LandingGear(), drawn_laws.Motion(4e-3, 0.06)
    travel, rate = (each.ravel() for each in np.meshgrid(np.linspace(-0.03, 0.03, 61), np.linspace(-0.4, 0.4, 81)))
    rng = np.random.default_rng(2)
    for kind in drawn_laws.ALL_KINDS:
        for _ in range(20):
            law = drawn_laws.law_of_kind(kind, gear, motion, rng)
            assert law.name == kind
            by_travel = np.diff(law.force(travel, rate).reshape(81, 61), axis=1) / 1e-3
            by_rate = np.diff(law.force(travel, rate).reshape(81, 61), axis=0) / 1e-2
            assert (by_travel + gear.suspension_stiffness_n_per_m > 0.0).all(), kind
            assert (by_rate + gear.suspension_damping_n_s_per_m > 0.0).all(), kind


def test_a_kind_without_ranges_is_refused(drawn_laws):
    with pytest.raises(ValueError, match="no range is given for the kind 'quartic_damping'"):
        drawn_laws.law_of_kind(
            "quartic_damping", LandingGear(), drawn_laws.Motion(4e-3, 0.06), np.random.default_rng(1)
        )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_force_that_follows_the_road_is_taken_for_a_spring_below_zero_and_nothing_is_told_with_an_interval(
    worlds, seed
):
    study, _ = worlds.WORLDS["followed 10 %"].study(seed)
    result = opid.identify(study, law="arctan_velocity")
    assert "a stiffness cannot be negative" in result.not_determined
    assert result.per_mass
    assert result.parameters.sprung_mass_kg.value is None
    estimates = [*vars(result.ratios).values(), *result.law_estimates["arctan_velocity"].values()]
    estimates += [each.natural_frequency_hz for each in result.equivalents]
    assert estimates
    assert all(each.interval95 is None for each in estimates)


@pytest.mark.parametrize("kind", [name for name, kind in LAWS.items() if kind.searched])
def test_a_record_of_every_searched_kind_is_drawn_for_the_bench(kind):
    bench, truth = script("benchmarks/bench_laws.py").record_of((kind,), "random", 0, 400, 0.01)
    assert truth.name == kind
    assert np.isfinite(bench.force).all()


def test_a_spring_so_hard_that_its_free_motion_leaves_the_measured_one_is_identified():
    """The motion of gear 32 depends on its start forever: followed reading by reading it leaves noise, freely 80 %."""
    flights = script("benchmarks/unlike_flights.py")
    outcome = flights.run(flights.Job("alike", 32, True, 2))
    assert outcome.mass.holds
    assert abs(outcome.mass.error) < 0.1


def test_noise_alone_is_no_motion_that_is_followed():
    assert script("benchmarks/refusals.py").outcome("noise", 0).refused


@pytest.mark.slow
@pytest.mark.parametrize("stated", [0.005, 0.2])
def test_smooth_motions_that_have_nothing_in_common_are_refused_whatever_noise_is_stated(stated):
    """The next sample of a slow motion is easily guessed, above all by a filter that is told of much noise."""
    rng, fs, runs = np.random.default_rng(0), 256.0, []
    for name, change in (("heavy", 0.0), ("light", -220.0)):
        slow = signal.sosfilt(signal.butter(4, 1.0, fs=fs, output="sos"), rng.standard_normal((2, 5120)))
        samples = 5.0 * slow / slow.std() + 0.005 * rng.standard_normal(slow.shape)
        runs.append(Run(name, recording_from_arrays(samples, ["lower_z", "upper_z"], fs=fs), change))
    facts = SensorPair(SensorFacts(noise_m_per_s2=stated), SensorFacts(noise_m_per_s2=stated))
    study = study_of_gear("slow", sprung="upper_z", unsprung="lower_z", runs=runs, sensors=facts)
    assert opid.identify(study).is_refused
