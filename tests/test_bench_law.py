"""A law from measured force against motion: known laws come back, memory is told, and intervals hold the truth."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from measured_data import measured
from scipy import signal

import opid
from opid.errors import InputError, NotDeterminedError
from opid.mechanics.laws.law import LAWS, LINEAR, law
from opid.report.writing import build_document
from opid.signals.recording import Channel, Recording
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.memory import play
from opid.suspensions.bench.problem import BenchLaws, thin_record
from opid.suspensions.bench.record import Bench, BenchTolerances, bench_from_recording, quasi_static_bench, rate_of
from opid.suspensions.bench.settings import DEFAULTS

FS = 500.0
STIFFNESS, DAMPING, OFFSET = 2e4, 500.0, 12.0
# a library of every shape, small enough for a quick search
LIBRARY = (
    "arctan_velocity",
    "coulomb_friction",
    "quadratic_damping",
    "cubic_damping",
    "cubic_stiffness",
)
TRUTHS = [
    LINEAR,
    law("arctan_velocity", amplitude_n=400.0, scale_m_per_s=0.03),
    law("coulomb_friction", amplitude_n=400.0, scale_m_per_s=0.03),
    law("quadratic_damping", damping_n_s2_per_m2=4e3),
    law("cubic_stiffness", stiffness_n_per_m3=2e8),
    law("coulomb_friction", amplitude_n=400.0, scale_m_per_s=0.03) + law("cubic_stiffness", stiffness_n_per_m3=2e8),
]


def random_motion(rng, n=3000, rms_m=0.01, band_hz=4.0):
    sections = signal.butter(3, band_hz, fs=FS, output="sos")
    z = signal.sosfiltfilt(sections, rng.standard_normal(n + 2000))[1000:-1000]
    z *= rms_m / z.std()
    return z, np.gradient(z, 1 / FS)


def coloured(rng, n, correlation):
    """First-order noise of unit variance."""
    drive = np.sqrt(1 - correlation**2) * rng.standard_normal(n + 500)
    return signal.lfilter([1.0], [1.0, -correlation], drive)[500:]


def bench_of(z, v, force):
    return Bench(z, v, force, FS, 0.0, "recorded", None, {"force": "F", "travel": "z", "velocity": "v"}, ())


def simulated(nonlinear, seed=0, n=3000, noise_n=30.0, correlation=0.0):
    rng = np.random.default_rng(seed)
    z, v = random_motion(rng, n)
    force = OFFSET + STIFFNESS * z + DAMPING * v + nonlinear.force(z, v)
    return bench_of(z, v, force + noise_n * coloured(rng, n, correlation))


def bouc_wen(z, yield_n=400.0, stiffness=1e5):
    """x' = k z' (1 - |x/x_y| (1 + sgn(x z'))/2), in steps of the travel."""
    fraction = np.zeros_like(z)
    for i, step in enumerate(np.diff(z)):
        turned = 0.5 * (1 + np.sign(step * fraction[i]))
        fraction[i + 1] = fraction[i] + step * stiffness / yield_n * (1 - abs(fraction[i]) * turned)
    return yield_n * fraction


# ---- which law -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("truth", "correlation"),
    [*zip(TRUTHS, (0.9, 0.0, 0.9, 0.0, 0.9, 0.9), strict=True)],
    ids=lambda each: getattr(each, "name", str(each)),
)
def test_the_true_law_is_found(truth, correlation):
    found = law_of_bench(simulated(truth, seed=3, n=2000, correlation=correlation), candidates=LIBRARY, most_terms=3)
    assert found.law.name == truth.name
    assert found.not_determined is None
    assert not found.memory.seen
    for (_, estimate), true in zip(found.parameters.items(), (STIFFNESS, DAMPING, OFFSET), strict=True):
        assert abs(estimate.value - true) < 4 * estimate.std
    np.testing.assert_allclose(found.law.vector, truth.vector, rtol=0.25)
    # what is left is the noise, and stretches that were left out are predicted almost as well
    np.testing.assert_allclose(found.residual_rms, 30, rtol=0.1)
    assert found.r2 - 0.01 < found.r2_left_out <= found.r2


def test_intervals_hold_the_truth_as_often_as_they_say():
    truth = TRUTHS[1]
    held = []
    for seed in range(24):
        found = law_of_bench(simulated(truth, seed, n=1500, correlation=0.8), candidates=(truth.name,))
        estimates = [*dict(found.parameters.items()).values(), *found.law_estimates[truth.name].values()]
        true = [STIFFNESS, DAMPING, OFFSET, *truth.vector]
        held += [estimate.holds(value) for estimate, value in zip(estimates, true, strict=True)]
    # 120 intervals of 95 %: three standard deviations below
    assert len(held) == 120
    assert np.mean(held) > 0.88


def test_a_stop_is_found_where_it_was_reached_and_else_withheld():
    kinds = (*LIBRARY, "bump_stop", "rebound_stop")
    stop = law("rebound_stop", stiffness_n_per_m=3e5, gap_m=0.015)
    found = law_of_bench(simulated(stop), candidates=kinds)
    assert found.law.name == "rebound_stop"
    gap, stiffness = (found.law_estimates["rebound_stop"][name] for name in ("gap_m", "stiffness_n_per_m"))
    assert gap.holds(0.015)
    assert stiffness.holds(3e5)
    far = simulated(law("rebound_stop", stiffness_n_per_m=3e5, gap_m=0.06))
    assert law_of_bench(far, candidates=kinds).law.name == "linear"


def gas_bench(seed, stroke_m, length_m=0.1, n=2500):
    """A gas spring of 18 kN under a sine and a sweep, read with noise of 1 % of the force."""
    rng = np.random.default_rng(seed)
    time_s, phases = np.arange(n) / FS, rng.uniform(0, 2 * np.pi, 2)
    sweep = 2 * np.pi * (0.3 * time_s + 3.7 * time_s**2 * FS / n / 2)
    z = stroke_m * (0.6 * np.sin(2 * np.pi * 0.7 * time_s + phases[0]) + 0.4 * np.sin(sweep + phases[1]))
    v = np.gradient(z, 1 / FS)
    gas = law("gas_column", static_force_n=1.8e4, gas_length_m=length_m, exponent=1.27)
    force = 2e4 * z + 2e3 * v + gas.force(z, v)
    return bench_of(z, v, force + 0.01 * force.std() * rng.standard_normal(n))


def test_on_a_bench_gas_has_a_usual_exponent_before_any_measurement():
    """A stroke of 4 mm of a column of 100 mm tells no exponent: what is told is what was known of it."""
    mean, std = LAWS["gas_column"].parameters[2].known
    found = law_of_bench(gas_bench(1, 0.004), candidates=("gas_column",))
    exponent = found.law_estimates["gas_column"]["exponent"]
    assert exponent.value == pytest.approx(mean, abs=0.5 * std)
    assert exponent.std == pytest.approx(std, rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize(("stroke_m", "within"), [(0.01, 0.4), (0.02, 0.15), (0.03, 0.08), (0.04, 0.08)])
def test_a_gas_column_is_found_with_its_load_and_its_length(stroke_m, within):
    held = []
    for seed in range(12):
        found = law_of_bench(gas_bench(seed, stroke_m), candidates=("gas_column",))
        load, length, _ = found.law_estimates["gas_column"].values()
        np.testing.assert_allclose([length.value, load.value], [0.1, 1.8e4], rtol=within)
        held += [length.holds(0.1), load.holds(1.8e4)]
    # 24 intervals of 95 %, two by two of one record
    assert sum(held) >= 20


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("stroke_m", [0.001, 0.003, 0.005])
def test_a_gas_column_that_hardly_moves_has_a_wide_interval_or_none(stroke_m, seed):
    found = law_of_bench(gas_bench(seed, stroke_m), candidates=("gas_column",))
    if found.law.name == "linear":
        return
    load, length, _ = found.law_estimates["gas_column"].values()
    # the parabola is determined all the same
    np.testing.assert_allclose(load.value / length.value**2, 1.8e6, rtol=1e-3 / stroke_m)
    if length.interval95 is None:
        assert load.interval95 is None
        assert any("static_force_n / gas_length_m^2 = " in warning for warning in found.warnings)
    else:
        assert 0 < length.interval95[0] < length.value < length.interval95[1]
        assert length.interval95[1] / length.interval95[0] > 1.5
        assert 0.5 * length.interval95[0] < 0.1 < 2 * length.interval95[1]


def test_the_ladder_tells_what_was_tried():
    found = law_of_bench(simulated(TRUTHS[4]), candidates=LIBRARY, most_terms=2)
    ladder = found.to_dict()["ladder"]
    assert ladder[0]["law"] == "linear"
    assert sum(rung["chosen"] for rung in ladder) == 1
    chosen = next(rung for rung in ladder if rung["chosen"])
    assert (chosen["law"], chosen["kept"]) == ("cubic_stiffness", True)
    assert chosen["bic"] < ladder[0]["bic"] - 10
    assert {rung["law"] for rung in ladder} >= set(LIBRARY)


def test_a_term_that_the_motion_does_not_bend_is_told_from_no_other():
    # friction of a scale far above the velocities: its cubic part is all that is seen of it
    soft = law("arctan_velocity", amplitude_n=4e3, scale_m_per_s=0.35)
    found = law_of_bench(simulated(soft, noise_n=60.0), candidates=LIBRARY, most_terms=1)
    assert any("cannot be distinguished from" in warning for warning in found.warnings)


def test_a_long_record_is_thinned_for_the_search_and_fitted_whole():
    # a sine whose period is the step of an even thinning would be seen at one phase only
    t = np.arange(200_000) / FS
    z, v = 0.01 * np.sin(2 * np.pi * 12.5 * t), 0.01 * 2 * np.pi * 12.5 * np.cos(2 * np.pi * 12.5 * t)
    force = STIFFNESS * z + DAMPING * v + 30 * np.random.default_rng(0).standard_normal(t.size)
    exact = replace(bench_of(z, v, force), tolerances=BenchTolerances(0.0, 0.0, 0.0))
    found = law_of_bench(exact, candidates=("cubic_stiffness",))
    assert found.n_search_samples <= 5000
    assert found.residual.size == t.size
    assert found.parameters.stiffness_n_per_m.holds(STIFFNESS)
    # the interval is that of all samples: 30 N over the root of sum z^2
    assert found.parameters.stiffness_n_per_m.std == pytest.approx(30 / np.sqrt(np.sum(z**2)), rel=0.2)


def test_the_columns_of_candidates_foretell_what_a_fit_will_leave():
    bench = simulated(TRUTHS[5], seed=2)
    problem = BenchLaws(thin_record(bench, DEFAULTS), LIBRARY, DEFAULTS)
    linear = problem.linear_fit()
    proposals = problem.dictionaries(linear, LIBRARY)[""].proposals()
    assert {proposal.law.name for proposal in proposals} == set(LIBRARY)
    for proposal in proposals:
        fit = problem.refit(linear, {"": proposal.law})
        np.testing.assert_allclose(proposal.bic, fit.bic - linear.bic, rtol=0.02, atol=2)
    # the best of them is the law with the larger part of the force, and stretches left out confirm it
    best = problem.refit(linear, {"": proposals[0].law})
    assert best.law_name in TRUTHS[5].name.split("+")
    assert problem.confirms(best, linear)
    assert not problem.confirms(linear, best)


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_criteria_count_independent_samples_whatever_law_is_missing(correlation):
    bench = simulated(TRUTHS[5], n=5000, correlation=correlation)
    problem = BenchLaws(thin_record(bench, DEFAULTS), LIBRARY, DEFAULTS)
    # of first-order noise one sample in (1 + c) / (1 - c) is independent
    expected = 5000 * (1 - correlation) / (1 + correlation)
    assert 0.7 * expected < problem.n_independent < 1.4 * expected
    assert problem.linear_fit().n_data == round(problem.n_independent)


@pytest.mark.parametrize(
    "truth",
    [
        law("signed_power_damping", damping_n_sn_per_mn=800.0, exponent=0.5),
        law("signed_power_stiffness", stiffness_n_per_mn=4e4, exponent=1.5),
        law("arctan_mixed", amplitude_n=400.0, scale_m=0.006, lag_s=0.05),
    ],
    ids=lambda each: each.name,
)
def test_kinds_with_exponents_and_lags_are_searched_too(truth):
    found = law_of_bench(simulated(truth, noise_n=2.0), candidates=(*LIBRARY, truth.name), most_terms=2)
    assert found.law.name == truth.name
    for estimate, value in zip(found.law_estimates[truth.name].values(), truth.vector, strict=True):
        assert abs(estimate.value - value) < 4 * estimate.std


def test_a_number_that_is_changed_is_used_and_told():
    settings = replace(DEFAULTS, n_search=600, search=replace(DEFAULTS.search, bic_margin=1e9))
    found = law_of_bench(simulated(TRUTHS[4]), candidates=LIBRARY, settings=settings)
    assert found.law.name == "linear"
    assert found.n_search_samples <= 600
    told = found.to_dict()["settings"]
    assert (told["bic_margin"], told["search"]["bic_margin"], told["n_search"]) == (1e9, 1e9, 600)


def test_exact_data_give_the_exact_law():
    found = law_of_bench(simulated(TRUTHS[4], noise_n=0.0), candidates=LIBRARY, most_terms=3)
    assert found.law.name == "cubic_stiffness"
    np.testing.assert_allclose(found.law.vector, TRUTHS[4].vector, rtol=1e-6)


# ---- memory ----------------------------------------------------------------------------------------


def test_play_is_the_recursion_it_is_defined_by():
    z = np.cumsum(np.random.default_rng(0).standard_normal(777))
    widths = np.array([0.0, 0.5, 3.0, 100.0])
    expected = np.empty((z.size, widths.size))
    state = np.full(widths.size, z[0])
    for i, value in enumerate(z):
        state = np.minimum(value + widths, np.maximum(value - widths, state))
        expected[i] = state
    np.testing.assert_array_equal(play(z, widths), expected)


HYSTERETIC = {
    "bouc_wen": bouc_wen,
    # Jenkins elements in parallel (Iwan): springs in series with sliders
    "iwan": lambda z: (z[:, np.newaxis] - play(z, np.array([0.002, 0.006, 0.015]))) @ np.array([6e4, 3e4, 2e4]),
    "backlash": lambda z: 4e4 * play(z, np.array([0.005])).ravel(),
}


@pytest.mark.parametrize("kind", HYSTERETIC)
def test_hysteresis_is_told(kind):
    z, v = random_motion(np.random.default_rng(1))
    memory_force = HYSTERETIC[kind](z)
    force = 5e3 * z + 200 * v + memory_force + 5 * np.random.default_rng(2).standard_normal(z.size)
    found = law_of_bench(bench_of(z, v, force), candidates=("coulomb_friction", "cubic_stiffness"))
    assert found.memory.cause == "hysteresis"
    assert found.memory.r2_with_past > found.memory.r2_at_most + 0.02
    assert found.r2_left_out <= found.memory.r2_at_most
    assert "remembers the past (hysteresis or backlash), which no law that was tried explains" in found.memory.statement
    assert found.warnings[0].startswith(found.memory.statement)


def test_a_maxwell_element_and_a_moving_mass_are_no_hysteresis():
    z, v = random_motion(np.random.default_rng(1))
    noise = 5 * np.random.default_rng(2).standard_normal(z.size)
    lagged = signal.lfilter([1 - np.exp(-1 / 50)], [1, -np.exp(-1 / 50)], v)
    slow = law_of_bench(bench_of(z, v, 2e4 * z + 3e3 * lagged + noise), candidates=())
    assert slow.memory.cause == "relaxation"
    heavy = law_of_bench(bench_of(z, v, 2e4 * z + 500 * v + 40 * np.gradient(v, 1 / FS) + noise), candidates=())
    assert heavy.memory.cause == "inertia"
    assert heavy.memory.moving_mass_kg == pytest.approx(40, rel=0.1)


def test_what_follows_the_acceleration_otherwise_than_a_mass_is_a_vibration():
    z, v = random_motion(np.random.default_rng(1))
    noise = 5 * np.random.default_rng(2).standard_normal(z.size)
    # a mass on a spring inside the bench answers quick motion more than slow one
    ringing = signal.filtfilt(*signal.iirpeak(3.0, 2.0, fs=FS), np.gradient(v, 1 / FS))
    found = law_of_bench(bench_of(z, v, 2e4 * z + 500 * v + 60 * ringing + noise), candidates=())
    assert found.memory.cause == "vibration"
    assert found.memory.moving_mass_kg is None
    assert len(found.memory.by_pace_kg) == DEFAULTS.memory.n_paces
    assert "not as a mass does" in found.memory.statement


def test_a_motion_that_hardly_turns_is_doubted():
    t = np.arange(1000) / FS
    z = 0.01 * (1 - np.cos(np.pi * t / 2))
    columns = {"x": z, "v": np.gradient(z, 1 / FS), "F": STIFFNESS * z + 100.0}
    bench = bench_from_recording(recording(**columns), force="F", travel="x", velocity="v")
    assert any("turns round less than twice" in warning for warning in bench.warnings)
    assert not bench_from_recording(recording(**good()), force="F", travel="x").warnings


def test_samples_that_do_not_count_are_followed_and_not_fitted():
    """A law with memory, and a force of another state in every second half of a second."""
    z, v = random_motion(np.random.default_rng(5))
    time_s = np.arange(z.size) / FS
    counted = (2 * time_s).astype(int) % 2 == 0
    own = bouc_wen(z)
    force = 5e3 * z + 200 * v + np.where(counted, own, 3 * own) + 2 * np.random.default_rng(6).standard_normal(z.size)
    columns = recording(x=z, v=v, F=force)
    names = {"force": "F", "travel": "x", "velocity": "v"}
    kinds = ("bouc_wen", "cubic_stiffness")
    held = law_of_bench(bench_from_recording(columns, counted=counted, **names), candidates=kinds)
    mixed = law_of_bench(bench_from_recording(columns, **names), candidates=kinds)
    assert held.law.name == "bouc_wen"
    assert held.r2_left_out > 0.999 > mixed.r2_left_out
    assert held.residual.size == z.size
    assert held.residual_rms < 5 < np.std(held.residual)
    with pytest.raises(InputError, match="one truth value a sample"):
        bench_from_recording(columns, counted=counted[1:], **names)
    with pytest.raises(InputError, match="simulated without a gap"):
        bench_from_recording(columns, counted=counted, moving_mass=True, **names)
    with pytest.raises(InputError, match="10 samples count: at least 200 are needed; take a longer record"):
        bench_from_recording(columns, counted=np.arange(z.size) < 10, **names)
    with pytest.raises(InputError, match=r"0 samples count.*the law never holds in this record"):
        bench_from_recording(columns, counted=np.zeros(z.size, dtype=bool), **names)


def test_one_cycle_over_and_over_cannot_tell_memory():
    t = np.arange(5000) / FS
    z, v = 0.01 * np.sin(9 * t), 0.09 * np.cos(9 * t)
    force = 5e3 * z + bouc_wen(z) + 5 * np.random.default_rng(0).standard_normal(t.size)
    found = law_of_bench(bench_of(z, v, force), candidates=("coulomb_friction",))
    assert not found.memory.testable
    assert any("repeats one cycle" in warning for warning in found.warnings)
    remembering = law_of_bench(bench_of(z, v, force), candidates=("bouc_wen",))
    assert remembering.law.name == "bouc_wen"
    assert any(
        "the memory of bouc_wen may stand for a law without memory" in warning for warning in remembering.warnings
    )
    of_law = remembering.law_estimates["bouc_wen"].values()
    assert {each.interval95 for each in (remembering.parameters.stiffness_n_per_m, *of_law)} == {None}
    ends = remembering.cycle.area_j.interval95
    assert ends[0] < found.cycle.area_j.value < ends[1]


def test_a_cycle_of_two_tones_that_a_memory_may_stand_for_has_no_energy_of_a_sine():
    """The true kind is no candidate: an arm fits the cycle, but not a sine, which was not recorded."""
    t, rng = np.arange(4000) / FS, np.random.default_rng(0)
    z = 0.004 * np.sin(2 * np.pi * t) + 0.003 * np.sin(6 * np.pi * t + 1)
    v = 0.008 * np.pi * np.cos(2 * np.pi * t) + 0.018 * np.pi * np.cos(6 * np.pi * t + 1)
    force = 2e4 * z + 100 * v + 2e4 * v * np.abs(v) + 0.3 * rng.standard_normal(t.size)
    found = law_of_bench(bench_of(z, v, force), candidates=("maxwell_arm",))
    assert found.law.has_memory
    assert found.cycle.area_j.interval95 is None
    assert any("neither has the energy of a cycle" in warning for warning in found.warnings)


# ---- the record ------------------------------------------------------------------------------------


def recording(**columns):
    units = {"x": "m", "F": "N", "v": "m/s", "y": "V"}
    channels = tuple(Channel(name, units[name[0]]) for name in columns)
    return Recording(np.stack(list(columns.values()), axis=1), fs=FS, channels=channels)


def good(n=1000):
    z, v = random_motion(np.random.default_rng(0), n)
    return {"x": z, "v": v, "F": STIFFNESS * z + DAMPING * v, "y": np.ones(n)}


def test_the_rate_of_a_travel_is_its_velocity():
    t = np.arange(4000) / FS
    travel = 3 + 2 * t + np.sin(7 * t) + 0.2 * np.sin(31 * t)
    exact = 2 + 7 * np.cos(7 * t) + 6.2 * np.cos(31 * t)
    rate, _ = rate_of(travel, fs=FS)
    assert np.abs(rate - exact)[100:-100].max() < 0.01
    noisy = travel + 1e-3 * np.random.default_rng(0).standard_normal(t.size)
    rate, band_hz = rate_of(noisy, fs=FS)
    assert np.std((rate - exact)[100:-100]) < 0.2 * np.std(np.gradient(noisy, 1 / FS) - exact)
    assert 31 / (2 * np.pi) < band_hz < 50


def test_velocity_is_differentiated_where_none_is_given():
    bench = bench_from_recording(recording(**good()), force="F", travel="x")
    assert "differentiated up to" in bench.velocity_from
    assert bench.velocity_band_hz > 4
    np.testing.assert_allclose(bench.velocity[50:-50], good()["v"][50:-50], atol=0.01 * good()["v"].std())
    given = bench_from_recording(recording(**good()), force="F", travel="x", velocity="v")
    assert (given.velocity_from, given.warnings) == ("recorded, 'v'", ())


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({"force": "Fz", "travel": "x"}, ("no column 'Fz' for the force", "did you mean 'F'")),
        ({"force": "x", "travel": "F"}, ("'x' is in m", "force and travel swapped")),
        ({"force": "F", "travel": "v"}, ("'v' is in m/s, a travel is in m", "'x'")),
        ({"force": "F", "travel": "x", "velocity": "y"}, ("'y' is in V, a velocity is in m/s",)),
        ({"force": "F", "travel": "F"}, ("given for both",)),
    ],
)
def test_wrong_columns_are_named(names, words):
    with pytest.raises(InputError) as error:
        bench_from_recording(recording(**good()), **names)
    for word in words:
        assert word in str(error.value)


def test_too_short_still_and_constant_records():
    with pytest.raises(InputError, match="at least 200"):
        bench_from_recording(recording(**good(150)), force="F", travel="x")
    still = good() | {"x": np.full(1000, 0.01)}
    with pytest.raises(NotDeterminedError, match="never moves"):
        bench_from_recording(recording(**still), force="F", travel="x")
    slack = good() | {"F": np.zeros(1000)}
    with pytest.raises(NotDeterminedError, match="never changes"):
        bench_from_recording(recording(**slack), force="F", travel="x")


def test_doubtful_records_are_doubted():
    def doubts(**changed):
        return bench_from_recording(recording(**(good() | changed)), force="F", travel="x", velocity="v").warnings

    one = good()
    assert "opposite sign" in doubts(v=-one["v"])[0]
    assert "0.0254 times" in doubts(v=0.0254 * one["v"])[0]
    assert "never comes near its zero" in doubts(x=one["x"] + 3)[0]


def test_force_that_is_noise_gives_no_law():
    z, v = random_motion(np.random.default_rng(0), 2000)
    found = law_of_bench(bench_of(z, v, np.random.default_rng(1).standard_normal(2000)), candidates=LIBRARY[:3])
    assert found.r2_left_out < 0.02
    assert "no law of travel and velocity predicts the force" in found.not_determined
    assert "Not determined:" in opid.text(found)


def test_an_unknown_candidate_is_named():
    with pytest.raises(InputError, match="did you mean 'cubic_stiffness'"):
        law_of_bench(simulated(LINEAR), candidates=("cubic_stifness",))


# ---- real dampers ----------------------------------------------------------------------------------


def test_a_magnetorheological_damper_follows_a_law_that_saturates():
    data = {
        name: values.astype(float).ravel()[:18000]
        for name, values in np.load(measured("mr_damper/random_first_half.npz")).items()
    }
    bench = Bench(data["D"] / 100, data["V"] / 100, data["F"], 3004.8, 0.0, "recorded", None, {}, ())
    found = law_of_bench(bench, candidates=("arctan_velocity", "quadratic_damping", "cubic_stiffness"))
    assert found.law.name == "arctan_velocity"
    assert 0.8 < found.r2_left_out < 0.9
    # its voltage changes at random, and is not told: no law of travel and velocity can do much better
    assert found.memory.r2_at_most < 0.9


def test_a_friction_damper_with_backlash_remembers_the_past():
    records = np.load(measured("friction_damper_brfd/brfd.npz"))
    table = next(records[name] for name in records if "0.5Hz30lbtension1amplitude" in name).astype(float)
    bench = Bench(
        table[:, 1] * 0.0254, table[:, 3] * 0.0254, table[:, 2] * 4448.2, 1024.0, 0.0, "recorded", None, {}, ()
    )
    found = law_of_bench(bench, candidates=("coulomb_friction", "arctan_mixed"))
    assert 0.85 < found.r2_left_out < found.memory.r2_at_most < 0.96
    assert found.memory.cause == "hysteresis"


def test_a_law_that_is_not_determined_has_no_curves():
    rng = np.random.default_rng(3)
    z, v = random_motion(rng)
    found = law_of_bench(bench_of(z, v, 100 * rng.standard_normal(z.size)), candidates=LIBRARY)
    assert found.not_determined
    assert [each.name for each in build_document(found).figures] == [
        "force_against_motion",
        "bench_ladder",
        "bench_residual",
    ]


def test_a_law_that_is_beyond_all_numbers_on_a_motion_is_none_of_it():
    rng = np.random.default_rng(0)
    travel = 1e-3 * rng.standard_normal(1500)
    noisy = recording(F=1e5 * travel, x=travel)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = law_of_bench(bench_from_recording(noisy, force="F", travel="x"))
    assert found.r2 > 0.9


def test_a_slow_test_needs_places_along_its_path_and_no_turn():
    pull = np.arange(1000) * 1e-5
    once = recording(F=1e5 * pull + 1e12 * pull**3, x=pull)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = law_of_bench(quasi_static_bench(once, force="F", travel="x"), candidates=("cubic_stiffness",))
    assert found.law.name == "cubic_stiffness"
    assert not found.memory.seen
    for coarse in (np.round(np.sin(np.arange(1000) / 60)), np.where(np.arange(1000) == 600, 0.1, 0.0)):
        with pytest.raises(
            InputError, match="different places along its path of 1000 samples, and a quasi-static test needs 200"
        ):
            quasi_static_bench(recording(F=coarse, x=1e-2 * coarse), force="F", travel="x")
