"""The way to a fit: at a coarse rate until laws are found, then with all readings."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from body_runs import LOADS, NOISE, PLACES, aircraft, arrays_of, study, task_of
from law_runs import DAMPING, MASS_KG, STIFFNESS, fitted, gear_model, runs_of, study_of

from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws.law import LINEAR, Law, Term, default_law, law
from opid.signals.recording import Recording
from opid.suspensions import candidates, identification
from opid.suspensions.candidates import fit_rigid, gear_body, loading_matrix
from opid.suspensions.fitting import search
from opid.suspensions.fitting.fit import fit_model, refit
from opid.suspensions.fitting.search import Question, find_model, is_hopeless, judge_search, measure_folded_power
from opid.suspensions.fitting.start import start_values
from opid.suspensions.identification import identify
from opid.suspensions.model.run import driven_run
from opid.suspensions.model.unknowns import Group
from opid.suspensions.sensor_facts import SensorFacts, SensorPair
from opid.suspensions.settings import Settings
from opid.suspensions.study import Run
from opid.virtual.taxi_tests.airframe import DEFAULT_LAW, LandingGear
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_test

FRICTION = law("arctan_velocity", amplitude_n=1.0, scale_m_per_s=0.02)


# ---- one gear --------------------------------------------------------------------------------------


def begun(runs, question, law=LINEAR):
    """A model, and the start values of its equation of motion."""
    kinds = () if question.law_is_given else ("arctan_velocity", "cubic_stiffness")
    group = Group("", (0,), law.scaled(1 / MASS_KG) if law.terms else law)
    start = start_values(runs, gear_body(), (group,), mass_free=True, kinds=kinds)
    return replace(gear_model(runs), groups=start.groups, motion_rms=start.motion_rms), start


def found_of(runs, question, law=LINEAR):
    """Where a search ends from start values of the equation of motion."""
    return find_model(*begun(runs, question, law), question)


def test_a_given_law_is_the_only_one_that_is_tried():
    question = Question(law_is_given=True)
    found = judge_search(found_of(runs_of(DEFAULT_LAW), question, DEFAULT_LAW), question)
    (step,) = found.ladder
    assert (step.law_name, step.method, step.kept) == ("arctan_velocity", "given", True)
    assert step.left_out == pytest.approx(NOISE, rel=0.05)
    assert (found.n_starts, found.demands) == (1, ())


def test_a_friction_that_remembers_and_leaves_more_than_noise_is_tried_anew():
    """From its own equation, then as a joint of sliders; a law without memory asks for neither."""
    runs = runs_of(law("iwan_friction", amplitude_n=900.0, scale_m=3e-3, spread=0.6, jump=0.6))
    question = Question()
    model, start = begun(runs, question)

    def asked(name, question):
        best = search.SearchResult(fitted(runs, default_law(name)), ())
        assert not search.is_noise(best.fit)
        return search._Search(start, question, lambda step: None, model.settings)._start_from_own_equation(model, best)

    found = asked("dahl_friction", question)
    assert found.fit.law_name == "iwan_friction"
    assert search.is_noise(found.fit)
    assert found.fit.model.forgets
    assert 1 / found.fit.value("inverse_mass") == pytest.approx(MASS_KG, rel=0.01)
    assert asked("arctan_velocity", question) is None
    assert asked("dahl_friction", replace(question, law_is_given=True)) is None


def test_a_fit_that_forgets_the_first_periods_must_leave_noise_to_be_likelier(monkeypatch):
    """It need not explain them, so its criterion is lower whatever its law."""

    def fit(bic, *, forgets, is_noise):
        return SimpleNamespace(bic=bic, model=SimpleNamespace(forgets=forgets), is_noise=is_noise)

    monkeypatch.setattr(search, "is_noise", lambda each: each.is_noise)
    whole = fit(0.0, forgets=False, is_noise=False)
    for forgets, is_noise, is_taken in ((False, False, True), (True, True, True), (True, False, False)):
        other = fit(-50.0, forgets=forgets, is_noise=is_noise)
        assert search.is_likelier(other, whole) == is_taken
        assert search.is_likelier(whole, other) != is_taken


@pytest.mark.parametrize("method", ["pursuit", "sparse regression", "both"])
def test_every_method_ends_at_the_true_law(method):
    question = Question(method_of_law=method)
    found = judge_search(found_of(runs_of(default_law("quadratic_damping")), question), question)
    assert found.fit.law_name == "quadratic_damping"
    assert found.fit.ratio == pytest.approx(1.0, abs=0.05)
    assert [step.law_name for step in found.ladder if step.kept][-1] == "quadratic_damping"
    assert "linear" in {step.law_name for step in found.ladder}
    methods = {step.method for step in found.ladder}
    assert ("sparse regression" in methods) <= (method != "pursuit")
    # a law stands once in the story, and all of it is told at one rate
    names = [step.law_name for step in found.ladder]
    assert len(set(names)) == len(names)
    assert len({step.fit.model.runs[0].fs for step in found.ladder}) == 1


def test_a_wrong_law_that_is_given_is_left_alone_and_more_ways_are_tried():
    question = Question(law_is_given=True, faults=False)
    found = found_of(runs_of(DEFAULT_LAW), question)
    assert found.fit.law_name == "linear"
    assert found.fit.ratio > 3
    assert found.n_starts == (1 if is_hopeless(found.fit) else 2)


def test_where_the_runs_are_only_unlike_no_law_makes_up_for_it(monkeypatch):
    """What departures of the runs explain alone ends the search at once; what they do not is searched."""
    asked, real = [], search.search_laws
    monkeypatch.setattr(search, "search_laws", lambda *a, **settings: asked.append(1) or real(*a, **settings))
    heavy, light = runs_of(DEFAULT_LAW)[0], runs_of(gear=LandingGear(suspension_stiffness_n_per_m=1.03 * STIFFNESS))[1]
    question = Question(kinds=("arctan_velocity", "cubic_stiffness"), repeatability=0.01)
    found = found_of([heavy, light], question)
    assert found.is_unlike
    assert found.fit.law_name == DEFAULT_LAW.name
    assert not asked
    alike = found_of([heavy, light], replace(question, repeatability=0.0))
    assert not alike.is_unlike
    assert asked


@pytest.fixture(scope="module")
def long_runs():
    """Runs of 40 s, long enough for pieces."""
    return runs_of(DEFAULT_LAW, duration_s=40)


def lengths_tried(monkeypatch):
    """Filled with how long the runs of each fit are, s."""
    seen, real = [], search.fit_model

    def fitted(model, theta, **settings):
        seen.append(round(model.runs[0].n_samples / model.runs[0].fs))
        return real(model, theta, **settings)

    monkeypatch.setattr(search, "fit_model", fitted)
    return seen


def swapped(run):
    """The run with its channels exchanged."""
    return replace(run, sprung=run.unsprung, unsprung=run.sprung)


def test_a_wrong_structure_is_refused_on_pieces_of_the_runs(monkeypatch, long_runs):
    """Swapped channels: to the whole runs only the first fit is made, and the last one, from where pieces ended."""
    seen = lengths_tried(monkeypatch)
    found = found_of([swapped(run) for run in long_runs], Question())
    assert is_hopeless(found.fit)
    assert found.fit.model.runs[0].n_samples / found.fit.model.runs[0].fs == pytest.approx(40, abs=1)
    first, *between, last = seen
    assert between
    assert max(between) < 15 < 30 < min(first, last)


def test_only_what_explains_nothing_begins_in_vain(long_runs):
    """A wrong structure does; a right one does not, nor does one whose law is missing."""
    question = Question(law_is_given=True)
    assert search.is_start_useless(*begun([swapped(run) for run in long_runs], question), question)
    assert not search.is_start_useless(*begun(long_runs, question, DEFAULT_LAW), question)
    assert not search.is_start_useless(*begun(long_runs, question), question)


def test_runs_without_loading_are_not_searched_where_no_run_is_explained(monkeypatch):
    """Swapped channels end after one search; the runs without loading would begin in vain."""
    searched, real = [], candidates.find_model

    def find(model, *rest, **settings):
        searched.append(len(model.runs))
        return real(model, *rest, **settings)

    monkeypatch.setattr(candidates, "find_model", find)
    # whichever laws the start values have
    monkeypatch.setattr(candidates, "depends_on_travel", lambda law: True)
    right = study_of(LandingGear(law=default_law("cubic_stiffness")), duration_s=40)
    (gear,) = right.interfaces
    wrong = replace(right, interfaces=(replace(gear, sprung=gear.unsprung, unsprung=gear.sprung),))
    assert identify(wrong).is_refused
    assert searched == [2]


def test_a_right_structure_is_fitted_to_the_whole_runs(monkeypatch, long_runs):
    seen = lengths_tried(monkeypatch)
    assert found_of(long_runs, Question()).fit.ratio < 1.05
    assert min(seen) > 30


@pytest.mark.parametrize("explains", [False, True])
def test_a_coupling_that_nobody_stated_is_looked_for_on_whole_runs(monkeypatch, explains):
    """Pieces are too short to show it: they are tried where no coupling explains the whole runs of an aircraft."""
    settings = Settings()
    whole = SimpleNamespace(body=SimpleNamespace(n_interfaces=3), settings=settings)
    pieces, seen = object(), []
    fit, coupled = SimpleNamespace(model=whole, ratio=50.0), SimpleNamespace(fit=None)

    def try_several(self, model, theta, first=None):
        seen.append(model)
        raise UnboundedResponseError("enough is seen")

    def with_coupling(self, model, fit, noisier):
        seen.append(model)
        return coupled if explains else None

    monkeypatch.setattr(search._Search, "first_fit", lambda self, model, theta: fit)
    monkeypatch.setattr(search._Search, "try_several", try_several)
    monkeypatch.setattr(search._Search, "_search_with_coupling", with_coupling)
    for name, answer in (("is_hopeless", True), ("runs_contradict_each_other", False)):
        monkeypatch.setattr(search, name, lambda fit, answer=answer: answer)
    monkeypatch.setattr(search, "_is_unrelated_to_drive", lambda fit: False)
    monkeypatch.setattr(search, "_take_strongest_pieces", lambda model: pieces)
    started = search._Search(None, Question(), print, settings)
    if explains:
        assert started.find(whole, np.zeros(1)) is coupled
        assert seen == [whole]
    else:
        with pytest.raises(UnboundedResponseError):
            started.find(whole, np.zeros(1))
        assert seen[:2] == [whole, pieces]


def test_what_pieces_find_from_afar_is_fitted_to_the_whole_runs(monkeypatch, long_runs):
    """A first fit that leaves too much is no refusal: pieces lead to the model, and the runs to its numbers."""
    whole, first = found_of(long_runs, Question()), search._Search.first_fit

    def lost(self, model, theta):
        fit = first(self, model, theta)
        is_whole = model.runs[0].n_samples / model.runs[0].fs > 30
        return replace(fit, theta=2 * fit.theta, errors=model.evaluate(2 * fit.theta)) if is_whole else fit

    monkeypatch.setattr(search._Search, "first_fit", lost)
    seen = lengths_tried(monkeypatch)
    found = found_of(long_runs, Question())
    assert min(seen) < 15 < 30 < max(seen)
    assert {run.n_samples for step in found.ladder for run in step.fit.model.runs} == {long_runs[0].n_samples}
    assert found.fit.law_key == whole.fit.law_key
    np.testing.assert_allclose(found.fit.theta[:5], whole.fit.theta[:5], rtol=1e-3)


# ---- an aircraft at 512 Hz -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fast():
    """Two runs of 12 s at 512 Hz."""
    test = taxi_test(
        aircraft(),
        rng=np.random.default_rng(3),
        loadings=[LOADS],
        duration_s=12.0,
        fs=512.0,
        coherent_tracks=False,
        sprung_sensors=PLACES,
        lower_sensor=Sensor(noise_m_per_s2=NOISE),
        upper_sensor=Sensor(noise_m_per_s2=NOISE),
        lowest_step_rate_hz=1024.0,
    )
    runs = zip(("light", "heavy"), test.runs, ((), LOADS), strict=True)
    return study(runs=tuple(Run(name, run.recording, given) for name, run, given in runs))


def with_added(given, channels, added):
    """The study with something added to some channels of each run."""

    def changed(recording):
        samples = np.array(recording.samples)
        for name in channels:
            samples[:, recording.names.index(name)] += added(len(samples))
        return Recording(samples, fs=recording.fs, channels=recording.channels)

    return replace(given, runs=tuple(replace(each, recording=changed(each.recording)) for each in given.runs))


@pytest.fixture(scope="module")
def true(fast):
    found = fit_rigid(task_of(fast, FRICTION))
    assert found.residual_over_noise < 1.05
    return found.fit


def test_at_a_coarse_rate_the_true_model_leaves_the_noise_as_well(true):
    coarse = true.model.coarse
    assert [(run.fs, run.stride) for run in coarse.runs] == [(256.0, 2)] * 2
    # 470 lines of three sensors: 0.027 is one standard deviation
    for lines in coarse.evaluate(true.theta, sensitivity=False).lines:
        assert np.mean(np.abs(lines) ** 2) / 2 == pytest.approx(1.0, abs=0.12)


def test_at_a_coarse_rate_no_memory_makes_up_for_a_lag():
    """The lag is fitted as well as at the full rate, and a law with memory is not likelier than the true one."""
    facts = SensorPair(sprung=SensorFacts(lag_tolerance_s=1e-3))
    quiet = {"fs": 512.0, "road_class": "A", "upper_sensor": Sensor(noise_m_per_s2=NOISE, lag_s=5e-4)}
    full = fitted(runs_of(**quiet), DEFAULT_LAW, sensors=facts)
    coarse = fit_model(full.model.coarse, full.theta)
    assert coarse.model.runs[0].stride == 2
    for each in (full, coarse):
        assert each.value("lag_s") == pytest.approx(5e-4, abs=4 * each.std[each.model.names.index("lag_s")])
        assert each.ratio == pytest.approx(1.0, abs=0.05)
        arm = Term("maxwell_arm", (10.0, 0.003))
        other = refit(each, {"": Law((*each.laws[""].terms, arm))})
        assert other.bic > each.bic


def test_noise_below_the_suspensions_is_averaged_at_a_coarse_rate(fast, true):
    """So much of it that the readings follow it: what is left is white of unit variance at either rate."""
    rng, loud = np.random.default_rng(5), 1.0
    given = with_added(fast, fast.channels("unsprung"), lambda n: loud * rng.standard_normal(n))
    runs = tuple(
        driven_run(below, above, fs=fast.fs, loading=loading_matrix(given, place))
        for place, (below, above, _) in enumerate(arrays_of(given))
    )
    model = replace(true.model, runs=runs, noise=(np.full(3, loud), np.full(3, NOISE)))
    for each in (model, model.coarse):
        lines = each.evaluate(true.theta, sensitivity=False).lines
        assert [np.mean(np.abs(line) ** 2) / 2 for line in lines] == pytest.approx([1.0, 1.0], abs=0.15)


class EnoughError(Exception):
    """Ends a fit where a test has seen what it wants."""


def rates_tried(monkeypatch, given):
    seen = []

    def stops(model, theta, **settings):
        seen.append(model.runs[0].stride)
        raise EnoughError

    monkeypatch.setattr(search, "fit_model", stops)
    with pytest.raises(EnoughError):
        fit_rigid(task_of(given, FRICTION))
    return seen


@pytest.mark.parametrize(("stiffer", "stride"), [(1.0, 2), (200.0, 1)])
def test_a_body_that_moves_fast_is_followed_at_the_full_rate(fast, monkeypatch, stiffer, stride):
    """Steps of 1/256 s follow 0.7 x 256 rad/s; 200 times stiffer, a gear answers at some 28 Hz."""
    real = search.fastest_rate

    def rate(model, theta):
        theta = theta.copy()
        theta[list(model.first_of_group)] *= stiffer
        return real(model, theta)

    monkeypatch.setattr(search, "fastest_rate", rate)
    assert rates_tried(monkeypatch, fast) == [stride]


def test_a_tone_that_would_fold_into_the_band_is_followed_at_the_full_rate(fast, monkeypatch):
    def tone(n):
        return 0.5 * np.sin(2 * np.pi * 240 * np.arange(n) / 512.0)

    assert rates_tried(monkeypatch, fast) == [2]
    assert rates_tried(monkeypatch, with_added(fast, ["left_upper_z"], tone)) == [1]


def test_a_way_that_is_lost_at_a_coarse_rate_is_gone_at_the_full_one(fast, monkeypatch):
    seen, real = [], search.fit_model

    def grows(model, theta, **settings):
        seen.append(model.runs[0].stride)
        if seen[-1] == 2:
            raise UnboundedResponseError("it grows")
        return real(model, theta, **settings)

    monkeypatch.setattr(search, "fit_model", grows)
    assert fit_rigid(task_of(fast, FRICTION)).residual_over_noise < 1.05
    assert seen[0] == 2
    assert 1 in seen


def test_folded_power_is_that_of_the_lines_that_fold():
    """Of white noise it is one; a tone counts where thinning by two takes it for one of the band."""
    run = driven_run(np.zeros((5120, 1)), np.zeros((5120, 1)), fs=512.0)
    white = np.random.default_rng(0).standard_normal((1, 5120))
    assert measure_folded_power(white, run, run.coarse) == pytest.approx(1.0, abs=0.2)
    time_s = np.arange(5120) / 512.0
    for tone_hz, counts in ((240.0, True), (220.0, True), (200.0, False), (16.0, False)):
        tone = np.sin(2 * np.pi * tone_hz * time_s)[np.newaxis]
        assert (measure_folded_power(tone, run, run.coarse) > 1.0) == counts, tone_hz


def test_the_search_finds_friction_at_every_gear_and_goes_on_with_all_readings(fast, monkeypatch):
    """From linear suspensions; what half of the readings do not show is asked of all of them."""
    strides, real = [], search.search_laws

    def asked(problem, fit, **settings):
        strides.append(fit.model.runs[0].stride)
        return real(problem, fit, **settings)

    monkeypatch.setattr(search, "search_laws", asked)
    found = fit_rigid(task_of(fast, None))
    assert strides[0] == 2
    assert strides[-1] == 1
    fit = found.fit
    assert fit.model.runs[0].stride == 1
    for number, (name, gear) in enumerate(zip(fit.laws, aircraft().gears, strict=True)):
        # the force on the body, whatever it is called
        v = np.linspace(-0.3, 0.3, 41)
        mass = 1 / fit.model.inverse_mass(fit.theta)
        damping = fit.theta[fit.model.first_of_group[number] + 1]
        force = mass * (damping * v + fit.laws[name].force(0.0, v))
        true = gear.suspension_damping_n_s_per_m * v + gear.law.force(0.0, v)
        assert np.abs(force - true).max() < 0.1 * np.abs(true).max(), gear.name
        assert fit.laws[name].terms
    assert found.residual_over_noise < 1.03


@pytest.mark.slow
@pytest.mark.parametrize(("fs", "is_told"), [(512, True), (256, False)])
def test_friction_that_turns_over_within_a_step_is_fitted_with_shorter_ones(monkeypatch, fs, is_told):
    """Where it turns over between two samples, too, no step helps: damping is told without an interval."""
    gear = LandingGear(law=law("coulomb_friction", amplitude_n=3000.0, scale_m_per_s=0.005))
    # of all kinds it takes four times as long
    kinds = ("coulomb_friction", "arctan_velocity", "dahl_friction", "cubic_stiffness")
    monkeypatch.setattr(identification, "library", lambda: kinds)
    result = identify(study_of(gear, fs=fs, duration_s=12))
    (evidence,) = result.evidence
    assert evidence.fit.model.runs[0].finer > 1
    damping = result.parameters.suspension_damping_n_s_per_m
    assert result.parameters.sprung_mass_kg.holds(MASS_KG)
    assert (damping.std is not None) == is_told
    assert any("turns over faster than the runs were sampled" in each for each in result.warnings) != is_told
    if is_told:
        assert abs(damping.value - DAMPING) < 3 * damping.std
