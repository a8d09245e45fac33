"""The driven model fitted to runs of known truth."""

from functools import cache

import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.landing_gear import DEFAULT_LAW, LandingGear, taxi_test
from opid.mechanics.laws import Law, Term, default_law, law
from opid.mechanics.sensors import Sensor
from opid.signals.recording import recording_from_arrays
from opid.suspensions.one_gear.driven_run import driven_run
from opid.suspensions.one_gear.identification import identify_study
from opid.suspensions.one_gear.model_fit import fit_model
from opid.suspensions.one_gear.pursuit import pursue_law, refit
from opid.suspensions.one_gear.study import Run, Study
from opid.suspensions.sensor_facts import Leak, SensorFacts, SensorPair

FS = 256
SHORT = {"duration_s": 20, "fs": FS}
START = {"stiffness_per_mass": 190.0, "damping_per_mass": 2.5}


def _runs(gear, seed=0, sensors=None, **settings):
    test = taxi_test(gear, rng=np.random.default_rng(seed), **(SHORT | settings))
    leaks = [leak.channel for leak in sensors.leaks] if sensors else []
    return [
        driven_run(
            run.recording.channel("lower_z"),
            run.recording.channel("upper_z"),
            fs=run.recording.fs,
            mass_change_kg=change,
            sensors=sensors,
            leaks=np.stack([run.recording.channel(name) for name in leaks], axis=1) if leaks else None,
        )
        for run, change in ((test.heavy, 0.0), (test.light, test.mass_change_kg))
    ]


def _true_values(law):
    return np.array([3.9e5 / 1850, 6e3 / 1850, *law.scaled(1 / 1850).vector, 1 / 1850])


LAWS_TRIED = [
    Law(),
    DEFAULT_LAW,
    law("arctan_displacement", amplitude_n=800.0, scale_m=0.002),
    default_law("quadratic_damping"),
    default_law("cubic_stiffness"),
    DEFAULT_LAW + default_law("cubic_stiffness"),
]


@pytest.mark.parametrize("truth", LAWS_TRIED, ids=lambda t: t.name)
def test_every_law_is_found_at_the_noise_with_its_slow_motion(truth):
    runs = _runs(LandingGear(law=truth))
    fit = fit_model(runs, truth.scaled(1.2 / 1850), **START, inverse_mass=1 / 1500)
    np.testing.assert_array_less(np.abs(fit.value - _true_values(truth)), 4 * fit.std)
    assert fit.std[-1] * 1850 < 0.004
    np.testing.assert_allclose(fit.noise_m_per_s2, 5e-3, rtol=0.06)
    residual = np.concatenate(fit.residual)
    np.testing.assert_allclose(np.sqrt(np.mean(np.abs(residual) ** 2)), fit.noise_m_per_s2, rtol=0.02)


def test_a_ground_spring_is_found():
    gear = LandingGear(ground_stiffness_n_per_m=1.67e5)
    fit = fit_model(
        _runs(gear),
        DEFAULT_LAW.scaled(1 / 1850),
        **START,
        ground_stiffness_per_mass=70.0,
        inverse_mass=1e-3,
    )
    np.testing.assert_allclose(fit["ground_stiffness_per_mass"] / fit["inverse_mass"], 1.67e5, rtol=0.005)
    np.testing.assert_allclose(1 / fit["inverse_mass"], 1850, rtol=0.005)


def test_stated_errors_are_the_spread():
    fits = [
        fit_model(_runs(LandingGear(), seed), DEFAULT_LAW.scaled(1 / 1850), **START, inverse_mass=1e-3)
        for seed in range(12)
    ]
    spread = np.std([fit.value for fit in fits], axis=0)
    np.testing.assert_allclose(np.mean([fit.std for fit in fits], axis=0), spread, rtol=0.6)


def test_pursuit_tells_friction_from_friction():
    """tanh and arctangent differ in their tails only; the classical chain knows but the arctangent."""
    truth = default_law("coulomb_friction")
    runs = _runs(LandingGear(law=truth))
    start = fit_model(runs, DEFAULT_LAW.scaled(1 / 1850), **START, inverse_mass=1e-3)
    ladder = pursue_law(runs, start)
    best = [step for step in ladder if step.kept][-1].fit
    assert best.law.name == "coulomb_friction"
    np.testing.assert_allclose(best.law.scaled(1 / best["inverse_mass"]).vector, truth.vector, rtol=0.02)


def test_refitting_without_a_term_starts_where_it_left():
    runs = _runs(LandingGear(law=DEFAULT_LAW + default_law("cubic_stiffness")))
    both = fit_model(runs, (DEFAULT_LAW + default_law("cubic_stiffness")).scaled(1 / 1850), **START, inverse_mass=1e-3)
    less = refit(runs, both, Law(both.law.terms[:1]))
    assert less.law.name == "arctan_velocity"
    assert less.noise_m_per_s2 > 5 * both.noise_m_per_s2


def test_the_method_model_beats_the_classical_chain_where_the_travel_matters():
    gear = LandingGear(law=default_law("cubic_stiffness"))
    test = taxi_test(gear, rng=np.random.default_rng(0), **SHORT)
    study = Study(
        "taxi",
        sprung="upper_z",
        unsprung="lower_z",
        runs=(Run("heavy", test.heavy.recording, 0.0), Run("light", test.light.recording, -220.0)),
    )
    classical, model = (identify_study(study, method=method) for method in ("classical", "model"))
    assert model.method == "model"
    assert model.law.name == "cubic_stiffness"
    for name, truth in (("sprung_mass_kg", 1850.0), ("suspension_stiffness_n_per_m", 3.9e5)):
        assert model.parameters[name].std < 0.3 * classical.parameters[name].std
        assert abs(model.parameters[name].value - truth) < 4 * model.parameters[name].std


def test_bad_input_is_named():
    with pytest.raises(InputError, match="one length"):
        driven_run(np.zeros(100), np.zeros(101), fs=100.0)
    with pytest.raises(InputError, match="wider band"):
        driven_run(np.zeros(1000), np.zeros(1000), fs=100.0, band_hz=(5, 6))
    with pytest.raises(InputError, match="at least one"):
        fit_model([], Law(), **START)
    runs = _runs(LandingGear())
    with pytest.raises(InputError, match="same mass change"):
        fit_model(runs[:1], Law(), **START, inverse_mass=1e-3)


# ---- faults of the sensors that are stated ---------------------------------------------------------

COUPLED = {"corner_hz": 0.4, "corner_tolerance": 0.3}
ACROSS = (Leak("lower_x", "unsprung"), Leak("upper_x", "sprung"))
# what the lower and the upper sensor do, and what is known of it
STATED = {
    "gain": ({"gain": 1.03}, {}, SensorPair(SensorFacts(gain_tolerance=0.03))),
    "corners 40 % apart": (
        {"corner_hz": 0.33},
        {"corner_hz": 0.462},
        SensorPair(SensorFacts(**COUPLED), SensorFacts(**COUPLED)),
    ),
    "lag of one sample": ({}, {"lag_s": 1 / FS}, SensorPair(sprung=SensorFacts(lag_tolerance_s=2 / FS))),
    "leak": ({"cross_axis": 0.03}, {"cross_axis": 0.03}, SensorPair(leaks=ACROSS)),
    "all together": (
        {"gain": 1.03, "corner_hz": 0.33, "cross_axis": 0.03},
        {"lag_s": 1 / FS, "corner_hz": 0.462, "cross_axis": 0.03},
        SensorPair(SensorFacts(gain_tolerance=0.03, **COUPLED), SensorFacts(lag_tolerance_s=2 / FS, **COUPLED), ACROSS),
    ),
}


@pytest.mark.parametrize("case", STATED)
def test_stated_faults_are_found_and_cost_the_mass_nothing(case):
    lower, upper, sensors = STATED[case]
    faults = {"lower_sensor": Sensor(**lower), "upper_sensor": Sensor(**upper), "fore_aft": True}
    sound = fit_model(_runs(LandingGear()), DEFAULT_LAW.scaled(1.2 / 1850), **START, inverse_mass=1e-3)
    runs = _runs(LandingGear(), sensors=sensors, **faults)
    fit = fit_model(runs, DEFAULT_LAW.scaled(1.2 / 1850), **START, inverse_mass=1e-3)
    expected = {
        "gain_unsprung": lower.get("gain"),
        "corner_unsprung_hz": lower.get("corner_hz"),
        "corner_sprung_hz": upper.get("corner_hz"),
        "lag_s": upper.get("lag_s"),
        "leak[0]": lower.get("cross_axis"),
        "leak[1]": upper.get("cross_axis"),
    }
    fitted = fit.names[len(sound.names) :]
    assert set(fitted) == {name for name, value in expected.items() if value is not None}
    true = np.array([*_true_values(DEFAULT_LAW), *(expected[name] for name in fitted)])
    np.testing.assert_array_less(np.abs(fit.value - true), 4 * fit.std)
    np.testing.assert_allclose(fit.noise_m_per_s2, 5e-3, rtol=0.06)
    # mass and stiffness are hardly less well known than from sensors without a fault
    for name in ("inverse_mass", "stiffness_per_mass"):
        place = sound.names.index(name)
        assert fit.std[place] < 1.6 * sound.std[place]


def test_faults_that_are_not_stated_spoil_what_stated_ones_leave_alone():
    lower, upper, _ = STATED["all together"]
    faults = {"lower_sensor": Sensor(**lower), "upper_sensor": Sensor(**upper)}
    fit = fit_model(_runs(LandingGear(), **faults), DEFAULT_LAW.scaled(1.2 / 1850), **START, inverse_mass=1e-3)
    assert fit.noise_m_per_s2 > 10 * 5e-3


def test_a_common_gain_cannot_be_seen_and_scales_the_law_alone():
    """Gains a and a of both sensors make motion and force a times as large: only inner scales and amplitudes know."""
    tolerance = 0.03
    loose = SensorFacts(gain_tolerance=tolerance)
    sound, fit = (
        fit_model(_runs(LandingGear(), sensors=pair), DEFAULT_LAW.scaled(1.2 / 1850), **START, inverse_mass=1e-3)
        for pair in (SensorPair(), SensorPair(loose, loose))
    )
    gains = [fit.names.index(f"gain_{side}") for side in ("unsprung", "sprung")]
    covariance = fit.covariance[np.ix_(gains, gains)]
    mean_std = np.sqrt(covariance.sum()) / 2
    difference_std = np.sqrt(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1])
    # of two independent priors, the mean is known as before and the difference from the data
    np.testing.assert_allclose(mean_std, tolerance / np.sqrt(2), rtol=1e-3)
    assert difference_std < 0.01 * tolerance
    np.testing.assert_allclose(fit.value[gains].mean(), 1.0, atol=0.1 * tolerance)
    for name in ("stiffness_per_mass", "damping_per_mass", "inverse_mass"):
        place = sound.names.index(name)
        np.testing.assert_allclose(fit.std[place], sound.std[place], rtol=0.03)
        assert abs(fit.value[place] - sound.value[place]) < 0.3 * sound.std[place]
    for name in ("law[0]", "law[1]"):
        place = sound.names.index(name)
        expected = np.hypot(sound.std[place] / sound.value[place], mean_std)
        np.testing.assert_allclose(fit.std[place] / fit.value[place], expected, rtol=0.03)


# ---- starts and spikes -----------------------------------------------------------------------------


def _from_off(runs, truth, seed, share=0.2):
    """Fit from start values that are each wrong by up to a share."""
    true = _true_values(truth)
    start = true * np.exp(np.random.default_rng(seed).uniform(-share, share, true.size))
    term = Term(truth.terms[0].name, tuple(start[2:-1]))
    return fit_model(runs, Law((term,)), stiffness_per_mass=start[0], damping_per_mass=start[1], inverse_mass=start[-1])


@pytest.mark.parametrize("name", ["coulomb_friction", "cubic_stiffness", "arctan_velocity"])
def test_every_start_a_fifth_off_leads_to_the_truth(name):
    truth = default_law(name)
    runs = _runs(LandingGear(law=truth))
    fits = [_from_off(runs, truth, seed) for seed in range(6)]
    for fit in fits:
        np.testing.assert_array_less(np.abs(fit.value - _true_values(truth)), 4 * fit.std)
        # one minimum, not six near it
        np.testing.assert_array_less(np.abs(fit.value - fits[0].value), 0.02 * fit.std)


def test_a_wrong_minimum_of_a_law_of_the_travel_is_seen_by_its_error():
    """An arctangent of the travel trades with the stiffness; a fit either finds it, or leaves ten times the noise."""
    truth = default_law("arctan_displacement")
    runs = _runs(LandingGear(law=truth))
    fits = [_from_off(runs, truth, seed) for seed in range(8)]
    found = [fit for fit in fits if fit.noise_m_per_s2 < 1.1 * 5e-3]
    assert len(found) >= 3
    for fit in found:
        np.testing.assert_array_less(np.abs(fit.value - _true_values(truth)), 4 * fit.std)
    assert all(fit.noise_m_per_s2 > 5 * 5e-3 for fit in fits if fit not in found)


@cache
def _identified_with_spikes(channel="lower_z", height=0.0):
    test = taxi_test(LandingGear(), rng=np.random.default_rng(0), **SHORT)
    runs = []
    for name, run, change in (("heavy", test.heavy, 0.0), ("light", test.light, test.mass_change_kg)):
        columns = {each: run.recording.channel(each).copy() for each in run.recording.names}
        columns[channel][[400, 1900, 3300]] += height
        runs.append(Run(name, recording_from_arrays(list(columns.values()), list(columns), fs=FS), change))
    study = Study("taxi", sprung="upper_z", unsprung="lower_z", runs=tuple(runs))
    return identify_study(study, law="arctan_velocity")


@pytest.mark.parametrize("channel", ["lower_z", "upper_z"])
@pytest.mark.parametrize("height", [20.0, 100.0])
def test_single_spikes_change_the_mass_by_less_than_its_deviation(channel, height):
    clean, spiked = _identified_with_spikes(), _identified_with_spikes(channel, height)
    assert any("6 spike(s) of one sample were mended" in warning for warning in spiked.warnings)
    assert not any("spike" in warning for warning in clean.warnings)
    clean, spiked = (answer.parameters["sprung_mass_kg"] for answer in (clean, spiked))
    assert abs(spiked.value - clean.value) < spiked.std
    assert spiked.std < 4 * clean.std


@pytest.mark.parametrize("fs", [64.0, 100.0])
def test_a_slow_logger_costs_no_accuracy(fs):
    """One step of the model a sample would be too coarse: the run is sampled finer inside."""
    runs = _runs(LandingGear(), fs=fs, duration_s=40)
    assert runs[0].fs >= 250
    fit = fit_model(runs, DEFAULT_LAW.scaled(1 / 1850), **START, inverse_mass=1e-3)
    expected = np.array([3.9e5 / 1850, 6e3 / 1850, *DEFAULT_LAW.scaled(1 / 1850).vector, 1 / 1850])
    np.testing.assert_array_less(np.abs(fit.value - expected), 4 * fit.std)
    # what the friction does above the Nyquist frequency is missing from the drive
    assert 4.7e-3 < fit.noise_m_per_s2 < 7e-3
