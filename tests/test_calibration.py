"""Calibration is an uncertainty of modal tests and of test benches: by closed forms, and by fits to changed records."""

from dataclasses import replace

import numpy as np
import pytest
from cli_runs import opid, refused
from made_beats import FOUR, beats, softening
from made_decays import decay_at_sensors
from made_resonance import held_study
from scipy import signal
from scipy.interpolate import make_interp_spline

from opid.errors import InputError
from opid.mechanics.laws.law import Law, Term
from opid.modal.decay.free_decay import decay_of, free_decay
from opid.modal.identification import identify_modes
from opid.modal.linear.modes import modal_test
from opid.modal.resonance.identification import identify_resonance
from opid.modal.study import ModalStudy, StudyTest
from opid.signals.recording import Channel, Recording
from opid.studies.study_file import read_study, write_study
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.record import Bench, BenchTolerances, bench_from_recording, quasi_static_bench, rate_of
from opid.suspensions.bench.simulation import MovingPart

# ---- the modal wing -----------------------------------------------------------------------------------


def beat_study(gain_tolerance):
    tests = beats(softening(FOUR, 3), np.random.default_rng(0))
    used = tuple(StudyTest(each, "fit", 3) for each in tests)
    return ModalStudy("beats", FOUR, (3,), used, "a", stiffness_order=3, damping_order=3, gain_tolerance=gain_tolerance)


def test_beats_hold_the_gain_that_force_and_motion_have_in_common():
    exact, loose = (identify_modes(beat_study(tolerance)).fits[0] for tolerance in (0.0, 0.1))
    for own, wide in ((exact.stiffness, loose.stiffness), (exact.damping, loose.damping)):
        for power, estimate in own.items():
            by_gain = np.sqrt(wide[power].std ** 2 - estimate.std**2)
            assert by_gain == pytest.approx((power - 1) * 0.1 / np.sqrt(2) * abs(estimate.value), rel=1e-6)


def test_the_common_gain_moves_a_coefficient_as_the_interval_says():
    """A shape of the same sensors: motion and force s times too large give s^(1 - n) times the coefficient."""
    s, tests = 1.05, beats(softening(FOUR, 3), np.random.default_rng(0))
    changed = []
    for test in tests:
        modes = replace(FOUR, shapes=FOUR.shapes * s)
        samples = test.recording.samples.copy()
        samples[:, 1:] *= s**2  # sqrt(accelerations / force) scales the shapes
        record = replace(test.recording, samples=samples)
        again = modal_test(record, modes, name=test.name, force="force", drive_point="a")
        changed.append(StudyTest(again, "fit", 3))
    given = beat_study(0.0)
    fits = [identify_modes(study).fits[0] for study in (given, replace(given, modes=modes, tests=tuple(changed)))]
    assert fits[1].modal_mass.value == pytest.approx(fits[0].modal_mass.value, abs=1e-6)  # nothing shows it
    assert fits[1].stiffness[3].value / fits[0].stiffness[3].value == pytest.approx(s**-2, rel=1e-4)
    assert fits[1].damping[2].value / fits[0].damping[2].value == pytest.approx(s**-1, rel=1e-3)


def test_a_decay_holds_a_gain_that_all_sensors_have_in_common():
    test, _ = decay_at_sensors(0)
    options = {"stiffness_order": 3, "damping_order": 1}
    exact, loose = (decay_of(test, 1, **options, gain_tolerance=tolerance) for tolerance in (0.0, 0.05))
    by_gain = np.sqrt(loose.stiffness[3].std ** 2 - exact.stiffness[3].std ** 2)
    assert by_gain == pytest.approx(2 * 0.05 * loose.stiffness[3].value, rel=0.02)
    assert loose.stiffness[1].std == pytest.approx(exact.stiffness[1].std)
    usual = free_decay(test.modal_acceleration(1), fs=test.fs, near_hz=40.0, **options)
    assert usual.gain_std == 0.015


def test_resonance_takes_the_tolerance_of_its_study():
    study = held_study(0)
    laws = [identify_resonance(replace(study, gain_tolerance=tolerance)).law for tolerance in (0.0, 0.05)]
    assert laws[1].stiffness[3].std > 0.09 * abs(laws[1].stiffness[3].value) > 5 * laws[0].stiffness[3].std
    assert identify_resonance(study).to_dict()["settings"]["gain_tolerance"] == 0.015


@pytest.mark.parametrize("tolerance", [-0.01, 1.0, float("nan")])
def test_a_tolerance_is_a_fraction(tolerance):
    with pytest.raises(InputError, match=r"gain_tolerance is .* give a fraction from 0 to below 1"):
        beat_study(tolerance)


def test_the_tolerance_stands_in_study_files_and_on_the_command_line(tmp_path):
    test, _ = decay_at_sensors(0)
    study = ModalStudy("ring", test.modes, (1,), (StudyTest(test, "decay", 1),), gain_tolerance=0.07)
    write_study(study, tmp_path / "study.toml")
    assert read_study(tmp_path / "study.toml").gain_tolerance == 0.07
    log, words = tmp_path / "ring.csv", ("--study", tmp_path / "study.toml", "--mode", "1")
    for more, found in (((), "0.07"), (("--gain-tolerance", "0.02"), "0.02")):
        out = tmp_path / f"out {found}"
        assert opid("decay", log, *words, *more, "--out", out).exit_code == 0
        assert f'"gain_std": {found}' in (out / "result.json").read_text(encoding="utf-8")


# ---- test benches ---------------------------------------------------------------------------------------

FS, N = 500.0, 4000
EXACT = BenchTolerances(0.0, 0.0, 0.0)


def bench_of(*, hz=None, mass_kg=0.0, lag_s=0.0, friction_n=0.0, seed=0, recorded_velocity=False):
    """A spring of 20 kN/m with a damper of 150 N s/m, a cubic part and maybe friction, moved by a sine or by noise."""
    rng, time = np.random.default_rng(seed), np.arange(N) / FS
    if hz is None:
        band = signal.butter(4, (0.5, 12.0), "band", fs=FS, output="sos")
        travel = signal.sosfiltfilt(band, rng.standard_normal(N + 2000))[1000:-1000]
        travel *= 0.005 / travel.std()
    else:
        travel = np.linspace(0.002, 0.01, N) * np.sin(2 * np.pi * hz * time)
    path = make_interp_spline(time, travel, 5)
    z, v, a = path(time), path(time, 1), path(time, 2)
    force = 2e4 * z + 150.0 * v + 4e7 * z**3 + friction_n * 2 / np.pi * np.arctan(v / 0.02) + mass_kg * a
    if lag_s:
        force = make_interp_spline(time, force, 5)(np.clip(time - lag_s, 0.0, time[-1]))
    force = force + 0.5 * rng.standard_normal(N)
    names = {"force": "F", "travel": "z", "velocity": "v" if recorded_velocity else None}
    return Bench(z, v, force, FS, 0.0, "made", None, names, (), tolerances=EXACT)


def law_with(bench, **tolerances):
    found = replace(bench, tolerances=replace(EXACT, **tolerances))
    return law_of_bench(found, candidates=("cubic_stiffness", "coulomb_friction"))


def values_of(found):
    law = [each for terms in found.law_estimates.values() for each in terms.values()]
    return [found.parameters.stiffness_n_per_m, found.parameters.damping_n_s_per_m, *law]


@pytest.mark.slow
@pytest.mark.parametrize("recorded", [False, True])
@pytest.mark.parametrize("gains", [(1.05, 1.0, 1.0), (1.0, 1.05, 1.0), (1.0, 1.0, 1.05)])
def test_gains_move_the_parameters_of_a_bench_as_their_units_say(gains, recorded):
    """The same record in other units is fitted to other values: the power of each gain stands in the unit."""
    if not recorded and gains[1] != gains[2]:
        gains = (1.0, 1.05, 1.05)  # a velocity that was differentiated has the gain of the travel
    bench = bench_of(recorded_velocity=recorded, friction_n=30.0)
    of_force, of_travel, of_velocity = gains
    scaled = replace(
        bench, force=of_force * bench.force, travel=of_travel * bench.travel, velocity=of_velocity * bench.velocity
    )
    exact, moved, loose = law_with(bench), law_with(scaled), law_with(bench, gain_tolerance=0.05)
    assert moved.law.name == exact.law.name
    for before, after, wide in zip(values_of(exact), values_of(moved), values_of(loose), strict=True):
        change = abs(after.value / before.value - 1.0)
        by_gains = np.sqrt(wide.std**2 - before.std**2) / abs(before.value)
        assert change < 1.2 * by_gains + 1e-3  # one of the gains, all of which the interval holds


def test_a_mass_that_a_sine_cannot_tell_is_held_as_it_is_believed():
    omega = 2 * np.pi * 3.0
    found = law_with(bench_of(hz=3.0), mass_tolerance_kg=2.0)
    exact = law_with(bench_of(hz=3.0))
    by_mass = np.sqrt(found.parameters.stiffness_n_per_m.std**2 - exact.parameters.stiffness_n_per_m.std**2)
    (mass,) = (each for each in found.calibration if each.name == "mass")
    assert by_mass == pytest.approx(np.hypot(mass.found.value, mass.found.std) * omega**2, rel=0.1)
    assert 0.2 * mass.tolerance < mass.found.std <= mass.tolerance  # its growing amplitude says a little at most


def test_a_mass_that_noise_tells_is_found_whatever_was_believed():
    found = law_with(bench_of(mass_kg=0.3), mass_tolerance_kg=1.0)
    (mass,) = (each for each in found.calibration if each.name == "mass")
    assert mass.found.value == pytest.approx(0.3, abs=max(3 * mass.found.std, 0.02))
    assert mass.found.std < 0.05
    assert found.parameters.stiffness_n_per_m.holds(2e4)
    assert not law_with(bench_of(mass_kg=0.3)).parameters.stiffness_n_per_m.holds(2e4)


def test_a_lag_is_found_and_moves_the_damping_by_stiffness_times_lag():
    lag_s = 5e-4
    found, exact = law_with(bench_of(lag_s=lag_s), lag_tolerance_s=1e-3), law_with(bench_of(lag_s=lag_s))
    (lag,) = (each for each in found.calibration if each.name == "lag")
    assert lag.found.value == pytest.approx(lag_s, rel=0.1)
    assert found.parameters.damping_n_s_per_m.holds(150.0)
    assert not exact.parameters.damping_n_s_per_m.holds(150.0)
    assert exact.parameters.damping_n_s_per_m.value == pytest.approx(150.0 - 2e4 * lag_s, rel=0.06)


def test_a_lag_far_beyond_its_tolerance_is_told():
    found = law_with(bench_of(lag_s=2e-3), lag_tolerance_s=2e-4)
    assert any("the force comes 0.002 s after the motion" in each for each in found.warnings)


@pytest.mark.parametrize("lag_s", [-5e-3, -2e-3, -5e-4, 1e-3, 2e-3, 5e-3])
def test_the_interval_of_a_lag_holds_it_up_to_a_third_of_a_radian(lag_s):
    """To first order, a lag of 2 ms would be found 10 % too long, at three standard deviations."""
    for seed in range(4):
        found = law_with(bench_of(lag_s=lag_s, seed=seed), lag_tolerance_s=2e-4)
        (lag,) = (each.found for each in found.calibration if each.name == "lag")
        assert lag.std < 1e-4
        assert abs(lag.value - lag_s) < 3.5 * lag.std
        assert found.parameters.stiffness_n_per_m.holds(2e4)


@pytest.mark.parametrize("lag_s", [-2e-3, -1e-3, 1e-3, 2e-3])
@pytest.mark.parametrize("seed", [0, 3])
def test_a_law_that_takes_the_lag_of_a_sine_for_its_own_tells_nothing_else(lag_s, seed):
    """The stiffness and the slope of the law cancel to nine digits: a variance rounded below zero is no certainty."""
    bench = replace(bench_of(hz=8.0, lag_s=lag_s, seed=seed), tolerances=BenchTolerances())
    found = law_of_bench(bench).parameters
    for estimate, truth in ((found.stiffness_n_per_m, 2e4), (found.damping_n_s_per_m, 150.0)):
        assert estimate.interval95 is None or estimate.holds(truth)


@pytest.mark.parametrize("lag_s", [-2e-3, 1e-3, 2e-3])
def test_the_lag_of_a_force_that_drives_a_simulated_motion_is_held(lag_s):
    part = MovingPart(np.array([2e4, 150.0, 0.0, 5.0]), Law(()), np.zeros(2))
    band = signal.butter(4, (0.5, 20.0), "band", fs=FS, output="sos")
    time = np.arange(N) / FS
    for seed in range(3):
        rng = np.random.default_rng(seed)
        force = signal.sosfiltfilt(band, rng.standard_normal(N + 2000))[1000:-1000]
        force *= 100.0 / force.std()
        travel = part.travel(force, fs=FS, steps_per_sample=8) + 2e-5 * rng.standard_normal(N)
        late = make_interp_spline(time, force, 5)(np.clip(time - lag_s, 0.0, time[-1]))
        record = Recording(np.stack([late, travel], 1), fs=FS, channels=(Channel("F", "N"), Channel("z", "m")))
        bench = bench_from_recording(record, force="F", travel="z", moving_mass=True)
        found = law_with(bench, lag_tolerance_s=2e-4)
        assert found.simulation is not None
        (lag,) = (each.found for each in found.calibration if each.name == "lag")
        assert abs(lag.value - lag_s) < 3.5 * lag.std


def late_record(travel, force_of, *, lag_s=0.0, fs=FS, noise=2e-3, seed=0):
    """Return the record of a travel, by a function of time, and of a force that comes later."""
    rng, fine = np.random.default_rng(seed), np.arange(-0.2, N / FS + 0.2, 0.1 / fs)
    path = make_interp_spline(fine, travel(fine), 5)
    force = make_interp_spline(fine, force_of(path(fine), path(fine, 1), fine), 5)
    time = np.arange(round(N / FS * fs)) / fs
    read = force(time - lag_s) + noise * force(time).std() * rng.standard_normal(time.size)
    seen = path(time) + 5e-4 * path(time).std() * rng.standard_normal(time.size)
    record = Recording(np.stack([read, seen], 1), fs=fs, channels=(Channel("F", "N"), Channel("z", "m")))
    return bench_from_recording(record, force="F", travel="z")


def noise_to(hz, rms_m=0.005, seed=0):
    """Return a random travel by time, of 0.5 Hz to a frequency."""
    rng, lines = np.random.default_rng(seed), np.arange(0.5, hz, 0.1)
    size, phase = rng.standard_normal(lines.size), rng.uniform(0.0, 2 * np.pi, lines.size)
    scale = rms_m / np.sqrt(0.5 * np.sum(size**2))
    return lambda time: scale * np.sum(size * np.cos(2 * np.pi * time[:, None] * lines + phase), axis=1)


def told(found, name="lag"):
    (each,) = (each.found for each in found.calibration if each.name == name)
    return each


@pytest.mark.parametrize("lag_s", [-1e-3, 0.0, 5e-4, 1e-3])
@pytest.mark.parametrize("hz", [12.0, 20.0])
def test_noise_and_the_ends_of_a_record_tell_no_lag_of_a_linear_specimen(hz, lag_s):
    """The rate of a linear force is a damping and a mass: what remains of it is noise and the ends of a filter."""
    bench = late_record(
        lambda t: (1.25e-3 + 1.5e-3 * (t - 4.0) / 8.0) * np.sin(2 * np.pi * hz * t),
        lambda z, v, t: 2e4 * z + 150.0 * v,
        lag_s=lag_s,
    )
    found = law_of_bench(bench, candidates=("cubic_stiffness", "quadratic_damping"))
    assert told(found).value == 0.0
    for estimate, truth in ((found.parameters.stiffness_n_per_m, 2e4), (found.parameters.damping_n_s_per_m, 150.0)):
        assert estimate.holds(truth)


@pytest.mark.parametrize("lag_s", [-1e-3, 5e-4, 1e-3])
def test_an_arm_beside_a_damper_leaves_a_lag_to_belief(lag_s):
    def force(z, v, t):
        state = np.zeros(z.size)
        fade = np.exp(-np.diff(t) / 0.02)
        for k, each in enumerate(fade):
            state[k + 1] = state[k] * each + (z[k + 1] - z[k]) * np.sqrt(each)
        return 2e4 * z + 50.0 * v + 2e4 * state

    found = law_of_bench(late_record(noise_to(12.0), force, lag_s=lag_s), candidates=("maxwell_arm", "cubic_stiffness"))
    assert found.law.name == "maxwell_arm"
    assert found.parameters.damping_n_s_per_m.holds(50.0)
    assert found.law_estimates["maxwell_arm"]["stiffness_n_per_m"].holds(2e4)


def test_a_law_that_lags_is_told_from_a_late_force_where_it_differs():
    """A late force makes every part late; here the spring is in time, and the friction is not."""
    friction = Law((Term("arctan_mixed", (100.0, 0.01, 0.01)),))
    bench = late_record(noise_to(8.0), lambda z, v, t: 2e4 * z + 150.0 * v + friction.force(z, v))
    found = law_of_bench(bench, candidates=("arctan_mixed", "cubic_stiffness"))
    assert found.law.name == "arctan_mixed"
    assert not any("lags behind the motion, but" in each for each in found.warnings)
    assert told(found).std < 5e-4  # the record tells it
    assert found.law_estimates["arctan_mixed"]["amplitude_n"].holds(100.0)


def test_a_late_force_that_a_law_takes_for_its_own_is_told():
    """With the whole library a law with a lag of its own fits best."""
    bench = late_record(noise_to(12.0), lambda z, v, t: 2e4 * z + 150.0 * v + 4e7 * z**3, lag_s=2e-3)
    found = law_of_bench(bench)
    assert "arctan_mixed" in found.law.name
    assert any("a force that comes 0.002 s after the motion explain" in each for each in found.warnings)
    assert told(found).value == 0.0
    assert told(found).std > 1.9e-3


@pytest.mark.parametrize(("preload_n", "drift"), [(1e3, 0.01), (5e3, 0.005)])
def test_the_gain_of_a_preload_drifts_too(preload_n, drift):
    small = noise_to(12.0, rms_m=1e-3)
    bench = late_record(
        lambda t: 0.002 * (t - 4.0) + small(t),
        lambda z, v, t: (preload_n + 2e4 * z + 150.0 * v + 4e7 * z**3) * (1 + drift * (t - 4.0) / 4.0),
    )
    found = law_of_bench(bench, candidates=("cubic_stiffness",))
    assert found.parameters.stiffness_n_per_m.holds(2e4)


@pytest.mark.parametrize("which", ["force", "travel"])
def test_a_slow_test_holds_the_drift_of_its_gains(which):
    time, rng = np.arange(2400) / 20.0, np.random.default_rng(0)
    z = np.linspace(0.002, 0.01, time.size) * np.sin(2 * np.pi * 0.05 * time)
    force = 2e4 * z + 2e7 * z**3 + 0.3 * rng.standard_normal(z.size)
    drift = 1 + 0.01 * np.linspace(-1.0, 1.0, z.size)
    read, seen = (force * drift, z) if which == "force" else (force, z * drift)
    record = Recording(np.stack([read, seen], 1), fs=20.0, channels=(Channel("F", "N"), Channel("z", "m")))
    found = law_of_bench(quasi_static_bench(record, force="F", travel="z"), candidates=("cubic_stiffness",))
    assert [each.name for each in found.calibration[2:]] == ["drift of the force gain", "drift of the travel gain"]
    assert found.law_estimates["cubic_stiffness"]["stiffness_n_per_m3"].holds(2e7)


def test_a_weak_second_tone_belongs_to_the_motion_if_the_force_has_it():
    time, rng = np.arange(8000) / 500.0, np.random.default_rng(0)
    slow, quick = 0.01 * np.sin(2 * np.pi * time), 0.01 * 0.28 / 15 * np.sin(2 * np.pi * 15 * time + 1)
    of_slow, of_quick = 0.02 * np.pi * np.cos(2 * np.pi * time), 0.0056 * np.pi * np.cos(2 * np.pi * 15 * time + 1)
    read = slow + quick + 3.5e-6 * rng.standard_normal(time.size)
    noise = 0.3 * rng.standard_normal(time.size)
    for motion, truth in ((slow + quick, of_slow + of_quick), (slow, of_slow)):
        rate, band_hz = rate_of(read, fs=500.0, force=2e4 * motion + noise)
        assert (band_hz > 20.0) == (motion is not slow)
        assert np.std((rate - truth)[500:-500]) < 0.02 * np.std(truth)


def test_a_force_that_drives_the_motion_has_no_interval():
    bench = bench_of()
    found = law_of_bench(replace(bench, force=-bench.force), candidates=("cubic_stiffness",))
    assert found.parameters.stiffness_n_per_m.interval95 is None
    assert any("reverse the sign of force or travel" in each for each in found.warnings)


@pytest.mark.parametrize(
    ("name", "value"),
    [("gain_tolerance", -0.1), ("gain_tolerance", 1.0), ("lag_tolerance_s", -1.0), ("mass_tolerance_kg", np.inf)],
)
def test_tolerances_of_a_bench_that_are_none_are_refused(name, value):
    with pytest.raises(InputError, match=f"{name} is {value}"):
        BenchTolerances(**{name: value})


def test_tolerances_stand_in_the_command_that_repeats_a_bench(tmp_path):
    bench = bench_of(hz=3.0)
    rows = np.column_stack([np.arange(N) / FS, bench.force, bench.travel])
    log = tmp_path / "bench.csv"
    np.savetxt(log, rows, delimiter=",", header="time [s],F [N],z [m]", comments="")
    words = ("law", log, "--force-channel", "F", "--travel-channel", "z", "--out", tmp_path / "out")
    done = opid(*words, "--lag-tolerance", "0.001", "--mass-tolerance", "0.5", "--gain-tolerance", "0.02")
    assert done.exit_code == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "--gain-tolerance 0.02 --lag-tolerance 0.001 --mass-tolerance 0.5" in page
    refused(opid(*words, "--lag-tolerance", "-1"), "--lag-tolerance")


@pytest.mark.parametrize("tolerance", [-0.01, 1.0, 5.0, float("nan")])
def test_every_way_to_state_a_tolerance_refuses_what_is_no_fraction(tolerance):
    test, _ = decay_at_sensors(0)
    with pytest.raises(InputError, match="gain_tolerance is"):
        free_decay(test.modal_acceleration(1), fs=test.fs, gain_tolerance=tolerance)
    with pytest.raises(InputError, match="gain_tolerance is"):
        decay_of(test, 1, gain_tolerance=tolerance)
    with pytest.raises(InputError, match="gain_tolerance is"):
        BenchTolerances(gain_tolerance=tolerance)
