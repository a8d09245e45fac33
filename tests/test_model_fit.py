"""The driven model fitted to runs of known truth."""

import numpy as np
import pytest

from opid.errors import InputError
from opid.identify.driven_run import driven_run
from opid.identify.identification import identify_study
from opid.identify.model_fit import fit_model, score_of_term
from opid.identify.pursuit import pursue_law, refit
from opid.identify.study import Run, Study
from opid.mechanics.landing_gear import DEFAULT_LAW, LandingGear, taxi_test
from opid.mechanics.laws import Law, Term, default_law, law

SHORT = {"duration_s": 20, "fs": 256}
START = {"stiffness_per_mass": 190.0, "damping_per_mass": 2.5}


def _runs(gear, seed=0, **settings):
    test = taxi_test(gear, rng=np.random.default_rng(seed), **(SHORT | settings))
    return [
        driven_run(
            run.recording.channel("lower_z"),
            run.recording.channel("upper_z"),
            fs=run.recording.fs,
            mass_change_kg=change,
        )
        for run, change in ((test.heavy, 0.0), (test.light, test.mass_change_kg))
    ]


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
    expected = np.array([3.9e5 / 1850, 6e3 / 1850, *truth.scaled(1 / 1850).vector, 1 / 1850])
    np.testing.assert_array_less(np.abs(fit.value - expected), 4 * fit.std)
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


def test_the_score_of_a_term_foretells_its_worth():
    runs = _runs(LandingGear())
    linear = fit_model(runs, Law(), **START, inverse_mass=1e-3)
    scores = {
        term.name: score_of_term(runs, linear, term)[0]
        for term in (
            Term("arctan_velocity", (1.0, 0.02)),
            Term("cubic_stiffness", (1.0,)),
            Term("quintic_stiffness", (1.0,)),
        )
    }
    assert scores["arctan_velocity"] > 10 * max(scores["cubic_stiffness"], scores["quintic_stiffness"])


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
