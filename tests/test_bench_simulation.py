"""Parts of unknown mass on a bench: the law whose simulated motion is the recorded one, with the mass."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import opid
from opid.mechanics.laws.law import LINEAR, law
from opid.signals.recording import Channel, Recording
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.record import bench_from_recording
from opid.suspensions.bench.simulation import MovingPart

FS, N = 500.0, 5000
STRAIGHT = np.array([2e4, 60.0, 3.0, 4.0])
HARDENING = law("cubic_stiffness", stiffness_n_per_m3=2e8)
YIELDING = law("dahl_friction", amplitude_n=40.0, scale_m=0.002)


def force_of(seed, rms_n=120.0):
    """Random force up to 20 Hz."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(N) / FS
    frequency_hz, phase = rng.uniform(1.0, 20.0, 40), rng.uniform(0, 2 * np.pi, 40)
    force = np.sin(2 * np.pi * np.outer(time_s, frequency_hz) + phase).sum(axis=1)
    return rms_n / force.std() * force


def integrated(force, own):
    """Travel from rest by an independent integration of a law of travel and velocity."""
    time_s, (stiffness, damping, offset, mass) = np.arange(N) / FS, STRAIGHT
    driven = CubicSpline(time_s, force)

    def rate(t, state):
        z, v = state
        return v, (driven(t) - stiffness * z - damping * v - offset - float(own.force(z, v))) / mass

    return solve_ivp(rate, time_s[[0, -1]], [0.0, 0.0], t_eval=time_s, rtol=1e-9, atol=1e-12, max_step=1 / FS).y[0]


def bench_of(force, travel, **options):
    channels = (Channel("F", "N"), Channel("z", "m"))
    record = Recording(np.stack([force, travel], axis=1), fs=FS, channels=channels)
    return bench_from_recording(record, force="F", travel="z", moving_mass=True, **options)


@pytest.fixture(scope="module")
def shaken():
    force = force_of(0)
    return force, integrated(force, HARDENING)


def test_a_part_moves_as_an_independent_integration_says(shaken):
    force, travel = shaken
    part = MovingPart(STRAIGHT, HARDENING, np.zeros(2))
    simulated = part.travel(force, fs=FS, steps_per_sample=4)
    np.testing.assert_allclose(simulated, travel, atol=1e-3 * travel.std())


def test_mass_and_law_are_found_beside_each_other(shaken):
    force, travel = shaken
    noise = 0.01 * travel.std() * np.random.default_rng(1).standard_normal(N)
    found = law_of_bench(bench_of(force, travel + noise), candidates=("cubic_stiffness", "quadratic_damping"))
    assert found.law.name == "cubic_stiffness"
    estimates = [each for _, each in found.parameters.items()]
    estimates += found.law_estimates["cubic_stiffness"].values()
    for estimate, true in zip(estimates, [*STRAIGHT, *HARDENING.vector], strict=True):
        assert abs(estimate.value - true) < 4 * estimate.std
    assert found.parameters.moving_mass_kg.value == pytest.approx(4, rel=0.005)
    # the noise is left of the travel, and nothing else
    assert found.simulation.error_rms_m == pytest.approx(0.01 * travel.std(), rel=0.05)
    np.testing.assert_allclose(found.simulation.travel, travel, atol=2e-3 * np.abs(travel).max())
    told = found.to_dict()
    assert told["parameters"]["moving_mass_kg"]["value"] == found.parameters.moving_mass_kg.value
    assert told["simulation"]["tried"]["cubic_stiffness"] == found.simulation.error_rms_m
    text = opid.text(found)
    assert "moving mass m" in text
    assert "F = F0 + m z'' + K z" in text
    assert "simulated from the force alone" in text


def test_intervals_hold_and_the_noise_of_the_acceleration_does_not_bias_the_mass():
    held, masses = [], []
    for seed in range(10):
        force = force_of(seed)
        travel = MovingPart(STRAIGHT, YIELDING, np.zeros(3)).travel(force, fs=FS, steps_per_sample=8)
        noise = 0.02 * travel.std() * np.random.default_rng(100 + seed).standard_normal(N)
        found = law_of_bench(bench_of(force, travel + noise), candidates=("dahl_friction",))
        estimates = [*found.parameters.items(), *found.law_estimates["dahl_friction"].items()]
        held += [each.holds(true) for (_, each), true in zip(estimates, [*STRAIGHT, 40.0, 0.002], strict=True)]
        masses.append(found.parameters.moving_mass_kg.value)
    # 60 intervals of 95 %: three standard deviations below
    assert np.mean(held) > 0.86
    assert np.mean(masses) == pytest.approx(4, rel=0.003)


def test_an_imposed_motion_has_its_mass_from_the_force():
    """The force cell is noisy, the motion is not: no simulation explains more than the law of the force."""
    rng = np.random.default_rng(3)
    travel = integrated(force_of(3), LINEAR)
    bench = bench_of(travel, travel)
    clean = STRAIGHT[0] * travel + STRAIGHT[1] * bench.velocity + STRAIGHT[3] * bench.acceleration
    found = law_of_bench(bench_of(clean + 0.05 * clean.std() * rng.standard_normal(N), travel), candidates=())
    assert found.parameters.moving_mass_kg.value == pytest.approx(4, rel=0.02)
    assert found.memory.cause is None


def test_a_mass_that_noise_may_have_made_smaller_has_no_interval():
    """Without a spring the simulated motion drifts off; noise of motion and force look alike."""
    rng = np.random.default_rng(4)
    travel = integrated(force_of(4), LINEAR)
    velocity = np.gradient(travel, 1 / FS)
    pulled = 500.0 * velocity + STRAIGHT[3] * np.gradient(velocity, 1 / FS) + 5.0 * rng.standard_normal(N)
    found = law_of_bench(bench_of(pulled, travel + 0.1 * travel.std() * rng.standard_normal(N)), candidates=())
    assert found.simulation is None
    assert 3 < found.parameters.moving_mass_kg.value < 4
    assert [each.interval95 for _, each in found.parameters.items()] == [None] * 4
    assert any("noise biases it and the other" in warning for warning in found.warnings)


@pytest.mark.parametrize("seed", range(4))
def test_a_motion_that_runs_away_ends_no_search(seed):
    """Noise is no force of this motion: a part that it would move takes the travel to 1e107 m, or has no bound."""
    rng, time_s = np.random.default_rng(seed), np.arange(3000) / FS
    travel = 0.01 * np.sin(9 * time_s) + 0.002 * np.sin(31 * time_s)
    samples = np.stack([100 * rng.standard_normal(3000), travel], axis=1)
    recording = Recording(samples, fs=FS, channels=(Channel("pull", "N"), Channel("stroke", "m")))
    found = law_of_bench(bench_from_recording(recording, force="pull", travel="stroke", moving_mass=True))
    assert found.not_determined
    assert found.simulation is None or found.simulation.error_rms_m < travel.std()
