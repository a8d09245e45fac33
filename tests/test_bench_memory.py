"""Laws that remember on a test bench: found from forces of solve_ivp, told in words, and static laws still static."""

from dataclasses import replace

import numpy as np
import pytest
from measured_data import measured
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import opid
from opid.estimate import Estimate
from opid.mechanics.laws.law import Law, default_law, law
from opid.mechanics.memory import Motion, gradient_along, recorded_motion
from opid.suspensions.bench.intervals import cycle_of
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.record import Bench
from opid.suspensions.fitting.least_squares import _solve_linear, fit_separable, start_laws

FS, N = 500.0, 4000
STIFFNESS, DAMPING = 2e4, 500.0
TRUTHS = {
    "dahl_friction": law("dahl_friction", amplitude_n=400.0, scale_m=0.002),
    "bouc_wen": law("bouc_wen", amplitude_n=400.0, scale_m=0.003, exponent=2.0, shape=0.5),
    "lugre_friction": law(
        "lugre_friction",
        amplitude_n=400.0,
        scale_m=0.001,
        breakaway_ratio=1.6,
        stribeck_m_per_s=0.05,
        bristle_lag_s=1e-3,
    ),
    "maxwell_arm": law("maxwell_arm", stiffness_n_per_m=3e4, relaxation_s=0.05),
}


def motion(seed, n=N):
    """Time, travel of 10 mm rms up to 3 Hz from zero on, and its exact rate."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(n) / FS
    frequency_hz, phase = rng.uniform(0.2, 3.0, 30), rng.uniform(0, 2 * np.pi, 30)
    angles = 2 * np.pi * np.outer(time_s, frequency_hz) + phase
    z, v = np.sin(angles).sum(axis=1), np.cos(angles) @ (2 * np.pi * frequency_hz)
    return time_s, 0.01 / z.std() * z, 0.01 / z.std() * v


def remembered(truth, time_s, v):
    """Force of the literature's equations."""
    rate_of, (amplitude, *inner) = CubicSpline(time_s, v), truth.vector.tolist()

    def rate(t, h):
        now = rate_of(t)
        if truth.name == "dahl_friction":
            return (now - abs(now) * h) / inner[0]
        if truth.name == "bouc_wen":
            s, n, c = inner
            return now * (1 - abs(h) ** n * (c + 0.5 * np.sign(now * h))) / s
        if truth.name == "lugre_friction":
            s, b, w, _ = inner
            return (now - abs(now) * h / (1 + (b - 1) * np.exp(-((now / w) ** 2)))) / s
        return now - h / inner[0]

    h = solve_ivp(rate, time_s[[0, -1]], [0.0], t_eval=time_s, rtol=1e-7, atol=1e-9, max_step=1 / FS).y[0]
    lag = inner[3] if truth.name == "lugre_friction" else 0.0
    return amplitude * (h + lag * np.array([rate(t, each) for t, each in zip(time_s, h, strict=True)]))


def bench_of(z, v, force, seed=0):
    noise = 0.01 * force.std() * np.random.default_rng(seed).standard_normal(z.size)
    names = {"force": "F", "travel": "z", "velocity": "v"}
    return Bench(z, v, force + noise, FS, 0.0, "recorded", None, names, ())


@pytest.mark.slow
@pytest.mark.parametrize("name", TRUTHS)
def test_a_law_that_remembers_is_found(name):
    time_s, z, v = motion(1)
    own = remembered(TRUTHS[name], time_s, v)
    found = law_of_bench(bench_of(z, v, STIFFNESS * z + DAMPING * v + own))
    assert found.law.name == name
    assert found.not_determined is None
    fitted = recorded_motion(z, v, FS).force(found.law)
    np.testing.assert_allclose(fitted, own, atol=0.03 * np.abs(own).max())
    np.testing.assert_allclose(found.law.vector[:2], TRUTHS[name].vector[:2], rtol=0.05)
    # the memory is told to be in the law, and none is left
    assert not found.memory.seen
    assert found.memory.r2_at_most < found.r2_left_out < found.memory.r2_with_law + 1e-3
    assert f"with the memory of {name}" in found.memory.statement
    assert "no other memory is seen" in found.memory.statement
    assert not any("library" in warning for warning in found.warnings)


@pytest.mark.parametrize("name", ["dahl_friction", "bouc_wen", "maxwell_arm"])
def test_a_record_may_begin_in_the_middle_of_a_motion(name):
    """What is remembered there nobody knows."""
    truth = TRUTHS[name].with_vector(TRUTHS[name].vector * np.array([1.0, 3.0, 1.0, 1.0])[: TRUTHS[name].vector.size])
    _, z, v = motion(6)
    force = STIFFNESS * z + DAMPING * v + recorded_motion(z, v, FS).force(truth)
    found = law_of_bench(bench_of(*(each[N // 2 + 130 :] for each in (z, v, force))), candidates=TRUTHS)
    assert found.law.name == name
    assert found.r2_left_out > 0.999
    np.testing.assert_allclose(found.law.vector[:2], truth.vector[:2], rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("begin", [0, 1137], ids=["from rest", "in mid-motion"])
@pytest.mark.parametrize(
    "truth",
    [
        law("iwan_friction", amplitude_n=400.0, scale_m=0.006, spread=0.5, jump=0.5),
        law("bouc_wen", amplitude_n=400.0, scale_m=0.02, exponent=2.0, shape=0.5),
    ],
    ids=lambda each: each.name,
)
def test_intervals_hold_whatever_was_remembered_at_first(truth, begin):
    """The sliders of a joint are each somewhere; what is held fades, or no interval is told."""
    held = []
    for seed in range(5):
        _, z, v = motion(seed, 3000)
        force = STIFFNESS * z + DAMPING * v + recorded_motion(z, v, FS).force(truth)
        found = law_of_bench(bench_of(*(each[begin:] for each in (z, v, force)), seed), candidates=(truth.name,))
        if found.law.name != truth.name:
            continue
        estimates = [each for _, each in found.parameters.items()] + [*found.law_estimates[truth.name].values()]
        pairs = zip(estimates, [STIFFNESS, DAMPING, 0.0, *truth.vector], strict=True)
        held += [estimate.holds(true) for estimate, true in pairs if estimate.interval95 is not None]
    assert len(held) >= 7
    assert np.mean(held) > 0.85


def test_sliders_that_never_slip_are_springs():
    truth = law("iwan_friction", amplitude_n=400.0, scale_m=0.04, spread=0.5, jump=0.5)
    _, z, v = motion(1, 3000)
    force = STIFFNESS * z + DAMPING * v + recorded_motion(z, v, FS).force(truth)
    found = law_of_bench(bench_of(z, v, force), candidates=("iwan_friction",))
    assert found.law.name == "iwan_friction"
    assert found.parameters.stiffness_n_per_m.interval95 is None
    assert any("is a spring as K until it does" in warning for warning in found.warnings)


@pytest.mark.parametrize("name", ["dahl_friction", "maxwell_arm"])
def test_the_loop_area_is_known(name):
    truth = TRUTHS[name]
    held = []
    for seed in range(8):
        _, z, v = motion(seed, 2000)
        bench = bench_of(z, v, STIFFNESS * z + DAMPING * v + recorded_motion(z, v, FS).force(truth), seed)
        found = law_of_bench(bench, candidates=(name,))
        size, pace = np.sqrt(2) * z.std(), v.std() / z.std()
        assert found.loop.travel_amplitude_m == pytest.approx(size)
        assert found.loop.frequency_hz == pytest.approx(pace / (2 * np.pi))
        if name == "maxwell_arm":
            stiffness, lag = truth.vector * np.array([1.0, pace])
            true = np.pi * size**2 * stiffness * lag / (1 + lag**2)
        else:
            # four amplitudes of sliding, less the bending at both ends
            true = 400 * 4 * (size - 0.002)
        assert found.loop.area_j.value == pytest.approx(true, rel=0.03)
        held.append(found.loop.area_j.holds(true))
    assert sum(held) >= 6
    assert found.to_dict()["loop"]["area_j"]["value"] == found.loop.area_j.value
    assert "loop area" in opid.text(found)


@pytest.mark.parametrize(
    "truth",
    [
        law("coulomb_friction", amplitude_n=400.0, scale_m_per_s=0.03),
        law("arctan_velocity", amplitude_n=400.0, scale_m_per_s=0.03),
        law("cubic_stiffness", stiffness_n_per_m3=2e8),
        law("quadratic_damping", damping_n_s2_per_m2=4e3),
    ],
    ids=lambda each: each.name,
)
def test_a_static_law_is_told_from_memories(truth):
    _, z, v = motion(2)
    found = law_of_bench(bench_of(z, v, STIFFNESS * z + DAMPING * v + truth.force(z, v)))
    assert found.law.name == truth.name
    assert found.loop is None
    assert found.to_dict()["loop"] is None
    assert "no memory is seen" in found.memory.statement
    assert found.memory.r2_with_law == found.memory.r2_at_most
    assert "loop area" not in opid.text(found)


def test_what_no_law_remembers_is_told_beside_what_one_does():
    """Friction that remembers on moving parts: the law takes the one, the other is named."""
    _, z, v = motion(3)
    own = recorded_motion(z, v, FS).force(TRUTHS["dahl_friction"])
    force = STIFFNESS * z + DAMPING * v + own + 60.0 * np.gradient(v, 1 / FS)
    found = law_of_bench(bench_of(z, v, force), candidates=("dahl_friction", "cubic_stiffness"))
    assert "dahl_friction" in found.law.name
    assert found.memory.cause == "inertia"
    assert found.memory.moving_mass_kg == pytest.approx(60, rel=0.1)
    assert "which no law that was tried explains" in found.memory.statement
    assert found.memory.r2_at_most < found.memory.r2_with_law < found.memory.r2_with_past


# ---- a motion at samples of a record ---------------------------------------------------------------


@pytest.mark.parametrize("name", ["dahl_friction", "bouc_wen+cubic_stiffness", "arctan_velocity+maxwell_arm"])
def test_samples_of_a_record_remember_all_of_it(name):
    _, z, v = motion(4, 1000)
    subject, chosen = default_law(name), np.array([3, 500, 999])
    gradient = gradient_along(subject, z, v, FS)
    samples = recorded_motion(z, v, FS).part(chosen)
    # the second time it is kept
    for _ in range(2):
        np.testing.assert_allclose(samples.parameter_gradient(subject), gradient[chosen], rtol=1e-12)
    assert samples.start_columns(subject).shape == (3, 1)
    # far from the beginning none of it is left
    assert abs(samples.start_columns(subject)[2, 0]) < 1e-3 * abs(samples.start_columns(subject)[0, 0])
    one = samples.part(np.array([False, True, False]))
    np.testing.assert_allclose(one.parameter_gradient(subject), gradient[chosen[1:2]], rtol=1e-12)
    whole = recorded_motion(z, v, FS).force(subject)
    np.testing.assert_allclose(samples.force(subject), whole[chosen], rtol=1e-12)


@pytest.mark.parametrize("name", TRUTHS)
def test_a_fit_finds_every_inner_parameter(name):
    """From generic starts, a shape below zero among them."""
    _, z, v = motion(5, 2000)
    truth = TRUTHS[name]
    if name == "bouc_wen":
        truth = law(name, amplitude_n=400.0, scale_m=0.003, exponent=1.5, shape=-0.2)
    samples = recorded_motion(z, v, FS)
    straight = np.stack([z, v], axis=1)
    y = straight @ np.array([STIFFNESS, DAMPING]) + samples.force(truth)
    starts = start_laws(default_law(name), samples)
    fit = fit_separable(straight, default_law(name), samples, y, starts=starts, free_exponents=True)
    np.testing.assert_allclose(fit.law.vector, truth.vector, rtol=1e-3)
    assert not any(fit.at_bound)


def test_points_without_a_record_have_the_force_of_a_slow_motion():
    found = Motion(np.zeros(2), np.array([-0.1, 0.2])).force(TRUTHS["dahl_friction"])
    assert found.tolist() == [-400.0, 400.0]


# ---- real records ----------------------------------------------------------------------------------


def test_a_friction_damper_is_a_joint_that_yields():
    records = np.load(measured("friction_damper_brfd/brfd.npz"))
    table = next(records[name] for name in records if "0.5Hz30lbtension1amplitude" in name).astype(float)
    travel, velocity, force = table[:, 1] * 0.0254, table[:, 3] * 0.0254, table[:, 2] * 4448.2
    bench = Bench(travel, velocity, force, 1024.0, 0.0, "recorded", None, {}, ())
    found = law_of_bench(bench, candidates=("coulomb_friction", "arctan_mixed", "dahl_friction", "bouc_wen"))
    assert found.law.has_memory
    assert found.r2_left_out > 0.96 > found.memory.r2_at_most


def test_an_energy_that_the_force_could_not_take_is_not_told():
    """A standard deviation of C far beyond what this force over this travel allows."""
    _, z, v = motion(4)
    names = {"force": "F", "travel": "z", "velocity": "v"}
    bench = Bench(z, v, DAMPING * v + STIFFNESS * z, FS, 0.0, "recorded", None, names, ())
    found = law_of_bench(bench, candidates=("cubic_stiffness",))
    sharp, vague = (cycle_of(Law(()), DAMPING, np.array([[std**2]]), bench, student=2.0) for std in (3.0, 3e6))
    assert sharp.area_j.holds(2 * np.pi * DAMPING * z.std() * v.std())
    assert vague.area_j == Estimate()
    told = replace(found, cycle=vague)
    assert "does not determine the energy of a cycle" in " ".join(opid.text(told).split())
    assert told.to_dict()["cycle"]["area_j"]["value"] is None


def test_a_start_that_no_counted_sample_remembers_has_no_force_in_the_others():
    """Rounding gave a column of zeros a weight of 1e287, which the other samples of the record showed."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        basis = rng.standard_normal((300, 6))
        basis[:, 3] = 0.0
        basis[:, 4] = 0.9 * basis[:, 2] + 0.1 * basis[:, 4]
        _, weights = _solve_linear(basis, rng.standard_normal(300))
        assert abs(weights[3]) < 1e-9


def test_a_start_is_forgotten_where_it_has_faded():
    v = np.full(1000, 0.05)
    whole = recorded_motion(np.cumsum(v) / FS, v, FS)
    friction = law("dahl_friction", amplitude_n=1.0, scale_m=1e-3)
    assert np.abs(whole.start_columns(friction)).max() > 0.1
    # after 300 samples 30 scales are covered
    assert not np.any(whole.part(np.arange(300, 1000)).start_columns(friction))
