"""Which law, by prediction: known laws are found, from near and from far, and the ladder says how surely."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from law_runs import MASS_KG, fitted, gear_model, runs_of, shared, true_values, vector_of

from opid.mechanics.laws.kinds import Kind, Parameter
from opid.mechanics.laws.law import LAWS, LINEAR, Law, default_law, law
from opid.mechanics.laws.own_kinds import register_kind, unregister_kind
from opid.suspensions.fitting.fit import fit_model, refit
from opid.suspensions.fitting.search import SearchResult, with_simpler_laws
from opid.suspensions.law_search.driven import DrivenLaws, is_impossible
from opid.suspensions.law_search.pursuit import (
    LawStep,
    _list_limits,
    _list_moves,
    add_neighbours,
    alternatives,
    chosen,
    is_better,
    judge_by_left_out,
    library,
    search_laws,
)
from opid.suspensions.model.law_parameters import faint_terms, pulls_at_a_stop
from opid.suspensions.model.run import driven_run
from opid.suspensions.settings import SearchSettings
from opid.virtual.taxi_tests.airframe import DEFAULT_LAW, LandingGear

SETTINGS = SearchSettings()
LAWS_OF_RUNS = DrivenLaws(SETTINGS)


@pytest.fixture(scope="module")
def friction():
    return fitted(runs_of(DEFAULT_LAW), DEFAULT_LAW)


FROM_TO = [
    ("arctan_velocity", "coulomb_friction"),
    ("coulomb_friction", "arctan_velocity"),
    ("cubic_damping", "quadratic_damping"),
    ("coulomb_friction+quadratic_damping", "arctan_velocity+cubic_damping"),
    ("arctan_velocity", "arctan_velocity+cubic_stiffness"),
    ("arctan_velocity+cubic_stiffness", "cubic_stiffness"),
    ("arctan_velocity", "arctan_mixed"),
    ("linear", "arctan_velocity+quadratic_damping"),
    ("linear", "linear"),
    ("arctan_velocity", "arctan_velocity+even_quadratic_stiffness"),
    (
        "arctan_velocity+quadratic_damping+cubic_stiffness",
        "arctan_velocity+quadratic_damping+even_quadratic_stiffness+cubic_stiffness",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("start", "truth"), FROM_TO, ids=lambda name: name)
def test_the_true_law_is_found(start, truth):
    law = default_law(truth)
    ladder = search_laws(LAWS_OF_RUNS, fitted(runs_of(law), default_law(start)))
    best = chosen(ladder).fit
    assert best.law_name == truth
    assert ladder[0].law_name == start
    assert chosen(ladder).method == ("equation" if start == truth else "pursuit")
    np.testing.assert_array_less(np.abs(shared(best) - true_values(best, law)), 4.5 * best.std)


def test_no_law_leaves_the_body_without_a_place_to_rest(friction):
    """A spring that gives way at rest and holds elsewhere, against ones that soften, or hold nothing but noise."""
    model, stiffness = friction.model, friction.value("stiffness_per_mass")
    travel = friction.motion(0)[0]
    for fraction, force_scale, expected in ((-0.5, 2.0, True), (0.5, 2.0, False), (-0.5, 0.0, False)):
        theta = friction.theta.copy()
        theta[model.names.index("stiffness_per_mass")] = fraction * stiffness
        # over the motion it adds that many times the stiffness on the mean
        cube = law("cubic_stiffness", stiffness_n_per_m3=force_scale * stiffness / (3.0 * float(np.mean(travel**2))))
        other = replace(model, groups=(replace(model.groups[0], law=cube),))
        shared_part = [theta[model.names.index(name)] for name in ("stiffness_per_mass", "damping_per_mass")]
        vector = np.concatenate([shared_part, [cube.terms[0].amplitude], theta[model.names.index("inverse_mass") :]])
        assert is_impossible(replace(friction, model=other, theta=vector)) is expected


def test_simpler_laws_are_those_with_a_term_less_and_their_relatives():
    truth = law("dahl_friction", amplitude_n=400.0, scale_m=1e-3)
    beside = truth + law("cubic_stiffness", stiffness_n_per_m3=1e7)
    fit = fitted(runs_of(truth, duration_s=10.0), beside)
    found = SearchResult(fit, (LawStep(fit, True, "pursuit"),))
    simpler = list(with_simpler_laws(found, library()))
    names = [each.fit.law_name for each in simpler]
    # without the friction much more is left; a cube that is not there may go, and other memories are alike
    assert names[0] == "dahl_friction"
    assert "cubic_stiffness" not in names
    assert set(names[1:]) <= {"lugre_friction", "bouc_wen", "iwan_friction"}
    for each in simpler:
        assert chosen(each.ladder).fit is each.fit
        assert [step.kept for step in each.ladder] == [False, True]


class SeenLaws:
    """Stands in for a fit that compares by its criterion and its error alone."""

    def __init__(self, law, bic, error_rms=5e-3):
        self.laws, self.bic, self.error_rms, self.n_data = {"": law}, bic, error_rms, 4000
        self.law_name = law.name


def test_the_dictionary_foretells_the_fit(friction):
    """The criterion of a near relative, and of one term more, against those of the fits."""
    (dictionary,) = LAWS_OF_RUNS.dictionaries(friction, library()).values()
    found = {proposal.law.name: proposal for proposal in dictionary.proposals()}
    for name, rtol in (("coulomb_friction", 0.3), ("arctan_velocity+cubic_stiffness", 0.01)):
        reached = refit(friction, {"": found[name].law}).bic - friction.bic
        np.testing.assert_allclose(found[name].bic, reached, rtol=rtol, atol=0.5)


def test_scales_between_the_simulated_ones_are_right(friction):
    """What the fitted law does is what its own columns say; scales are offered evenly."""
    kinds = ["cubic_stiffness", "dead_zone_stiffness", "coulomb_friction"]
    (dictionary,) = LAWS_OF_RUNS.dictionaries(friction, kinds).values()
    assert list(dictionary.fitted) == ["arctan_velocity"]
    now, weights = dictionary.left(dictionary.fitted["arctan_velocity"])
    np.testing.assert_allclose(weights[0], friction.laws[""].terms[0].amplitude, rtol=1e-3)
    np.testing.assert_allclose(now, np.sum(friction.errors.stacked**2), rtol=1e-3)
    scales = [dictionary.terms[place].inner[0] for place in dictionary.offered["coulomb_friction"]]
    steps = np.diff(np.log(scales))
    assert len(scales) == 4 * 3 + 1
    np.testing.assert_allclose(steps, steps[0])
    # a column at a scale between is that of a simulation there
    few = DrivenLaws(replace(SETTINGS, n_scales=7, n_between=1)).dictionaries(friction, kinds)[""]
    at_scale = {round(np.log(dictionary.terms[k].inner[0]), 6): k for k in dictionary.offered["coulomb_friction"]}
    for place in few.offered["coulomb_friction"]:
        near = at_scale[round(np.log(few.terms[place].inner[0]), 6)]
        np.testing.assert_allclose(dictionary.along[near], few.along[place], atol=0.02 * np.linalg.norm(few.along))
        np.testing.assert_allclose(dictionary.size[near], few.size[place], rtol=0.02)


def test_no_move_leads_to_a_friction_beside_one_that_remembers():
    """The limits of an arctangent of both are a friction and a spring; the friction takes the place of the other."""
    both = default_law("arctan_mixed+bouc_wen")

    class NoColumns:
        settings = SETTINGS

        def dictionaries(self, fit, kinds):
            return {}

    moves = _list_moves(NoColumns(), SeenLaws(both, 0.0), library())
    found = {law.name for move in moves for law in move.laws.values()}
    assert "arctan_displacement+bouc_wen" in found
    assert "arctan_velocity" in found
    assert "arctan_velocity+bouc_wen" not in found
    assert "arctan_mixed+dahl_friction" in found


def test_a_smaller_law_that_ended_elsewhere_from_afar_is_tried_again_from_near():
    """Of the cube alone a fit from nothing ends in a wrong minimum; beside friction it is found, and then alone."""
    cube, friction = default_law("cubic_stiffness"), default_law("coulomb_friction")
    ends = {
        (LINEAR.name, cube.name): (10.0, 9e-3),
        (LINEAR.name, friction.name): (-100.0, 8e-3),
        (friction.name, (friction + cube).name): (-300.0, 5e-3),
        ((friction + cube).name, cube.name): (-310.0, 5e-3),
    }
    offered = {
        LINEAR.name: [(cube, 1), (friction, 1)],
        friction.name: [(friction + cube, 1)],
        (friction + cube).name: [(cube, -1)],
        cube.name: [],
    }
    asked = []

    class Offers:
        further = ()

        def __init__(self, rows):
            self.rows = rows

        def proposals(self):
            return [SimpleNamespace(law=each, bic=-1000.0, n_more=n_more) for each, n_more in self.rows]

    class Problem:
        settings = SETTINGS

        def dictionaries(self, fit, kinds):
            return {"": Offers(offered[fit.law_name])}

        def refit(self, fit, laws):
            asked.append((fit.law_name, laws[""].name))
            return SeenLaws(laws[""], *ends[asked[-1]]) if asked[-1] in ends else None

        def confirms(self, fit, than):
            return True

    ladder = search_laws(Problem(), SeenLaws(LINEAR, 0.0, 1e-2), kinds=("cubic_stiffness", "coulomb_friction"))
    assert chosen(ladder).fit.bic == -310.0
    assert chosen(ladder).law_name == "cubic_stiffness"
    again = search_laws(Problem(), SeenLaws(friction + cube, -300.0, 5e-3), kinds=(), rejected={(cube.name,)})
    assert chosen(again).law_name == (friction + cube).name


def test_what_a_run_left_out_says(friction):
    linear = refit(friction, {"": LINEAR})
    held = LAWS_OF_RUNS.left_out(friction)
    assert held == pytest.approx(friction.noise_m_per_s2, rel=0.02)
    assert LAWS_OF_RUNS.left_out(linear) > 3 * held
    assert LAWS_OF_RUNS.left_out(fitted(runs_of(DEFAULT_LAW)[:1], DEFAULT_LAW, mass_free=False)) is None


@pytest.mark.parametrize(("left_out", "winner"), [(4.9e-3, "more"), (5e-3, "fewer"), (5.1e-3, "fewer")])
def test_a_law_that_predicts_no_better_gives_way(monkeypatch, left_out, winner):
    """Of two laws the larger one must predict a run that was left out better."""
    fewer, more = SeenLaws(DEFAULT_LAW, 0.0), SeenLaws(DEFAULT_LAW + default_law("cubic_stiffness"), -50.0)
    monkeypatch.setattr(DrivenLaws, "left_out", lambda self, fit: 5e-3 if fit is fewer else left_out)
    judged = judge_by_left_out(LAWS_OF_RUNS, (LawStep(fewer, True, "given"), LawStep(more, True, "pursuit")))
    assert chosen(judged).fit is (more if winner == "more" else fewer)
    assert {step.fit: step.left_out for step in judged} == {fewer: 5e-3, more: left_out}


def test_a_larger_law_needs_a_margin():
    few, many = DEFAULT_LAW, DEFAULT_LAW + default_law("cubic_stiffness")
    fit = SeenLaws(few, 0.0)
    assert not is_better(SeenLaws(many, -6.0), fit, SETTINGS)
    assert not is_better(SeenLaws(many, -40.0), fit, SETTINGS)
    lower = SeenLaws(many, -40.0, 0.99 * 5e-3)
    assert is_better(lower, fit, SETTINGS)
    assert not is_better(fit, lower, SETTINGS)
    assert is_better(SeenLaws(default_law("coulomb_friction"), -1.0), fit, SETTINGS)


def test_of_laws_that_fit_alike_the_plainer_one_is_taken_where_it_is_asked_for():
    plain, rich = SeenLaws(default_law("quadratic_damping"), 0.0), SeenLaws(default_law("coulomb_friction"), -6.0)
    asked = replace(SETTINGS, inner_margin=10.0)
    assert is_better(rich, plain, SETTINGS)
    assert not is_better(rich, plain, asked)
    assert is_better(plain, rich, asked)
    # a larger law must pass the margin for larger laws only
    larger = SeenLaws(plain.laws[""] + rich.laws[""], -11.0, 0.99 * 5e-3)
    assert is_better(larger, plain, asked)


def test_a_law_that_cannot_be_told_apart_is_named():
    def ladder(behind, law=None):
        rival = SeenLaws(law or Law(default_law("coulomb_friction").terms), behind)
        return LawStep(rival, False, "pursuit"), LawStep(SeenLaws(DEFAULT_LAW, 0.0), True, "pursuit")

    (sentence,) = alternatives(ladder(3.0), SETTINGS)
    assert sentence.startswith("coulomb_friction (0.02 m/s) in place of arctan_velocity")
    assert "BIC +3" in sentence
    assert "velocities" in sentence
    assert alternatives(ladder(20.0), SETTINGS) == ()
    # what is the chosen law and more besides is no alternative, but what does without a term is one
    assert alternatives(ladder(3.0, DEFAULT_LAW + default_law("cubic_stiffness")), SETTINGS) == ()
    (sentence,) = alternatives(ladder(3.0, LINEAR), SETTINGS)
    assert sentence.startswith("the runs are explained as well without arctan_velocity (BIC +3)")


def test_a_reader_sees_the_linear_gear_and_the_nearest_laws(friction):
    ladder = add_neighbours(LAWS_OF_RUNS, (LawStep(friction, True, "pursuit"),))
    assert ladder[0].law_name == "linear"
    assert chosen(ladder).fit is friction
    assert len(ladder) == 2 + SETTINGS.n_neighbours
    assert len({step.law_name for step in ladder}) == len(ladder)
    # what runs left out say of a law is asked where it could change the choice
    asked = {step.law_name: step.left_out for step in judge_by_left_out(LAWS_OF_RUNS, ladder)}
    assert asked[friction.law_name] == pytest.approx(friction.noise_m_per_s2, rel=0.02)
    assert asked["linear"] is None


def test_what_was_asked_where_a_fit_ended_is_not_asked_again(friction, monkeypatch):
    problem, kinds = DrivenLaws(SETTINGS, 1.0), ("arctan_velocity", "cubic_stiffness")
    again = fit_model(friction.model, friction.theta)
    assert again is not friction
    first = problem.dictionaries(friction, kinds)
    linear = problem.refit(friction, {"": LINEAR})
    assert problem.dictionaries(again, kinds) is first
    assert problem.refit(again, {"": LINEAR}) is linear
    # other kinds, another place, or another model
    assert problem.dictionaries(friction, kinds[1:]) is not first
    assert problem.dictionaries(linear, kinds) is not first
    below, above = friction.model.noise
    noisier = fit_model(replace(friction.model, noise=(2 * below, above)), friction.theta)
    assert problem.refit(noisier, {"": LINEAR}) is not linear


def test_candidates_ranked_at_a_coarse_rate_are_not_simulated_at_the_full_one():
    """The law is found with all readings all the same, and more readings promise more."""
    linear = fitted(runs_of(DEFAULT_LAW, fs=512), LINEAR)
    coarse = fit_model(linear.model.coarse, linear.theta)
    assert coarse.model.runs[0].stride == 2
    kinds = ("arctan_velocity", "coulomb_friction", "cubic_stiffness")
    problem = DrivenLaws(SETTINGS, 1.0)
    few = problem.dictionaries(coarse, kinds)[""]
    problem.rank_as(linear, coarse)
    all_readings = problem.dictionaries(linear, kinds)[""]
    assert all_readings.gram is few.gram
    assert all_readings.n_data == pytest.approx(2 * few.n_data, rel=0.01)
    best, fresh = (each.proposals()[0] for each in (all_readings, DrivenLaws(SETTINGS).dictionaries(linear, kinds)[""]))
    assert best.law.name == fresh.law.name
    assert chosen(search_laws(problem, linear, kinds=kinds)).law_name == DEFAULT_LAW.name
    # nothing is ranked anew where there are no more readings
    before = len(problem.asked)
    problem.rank_as(linear, linear)
    assert len(problem.asked) == before


def test_laws_that_are_far_behind_are_not_fitted_for_the_reader_again(friction):
    ladder = (LawStep(friction, True, "pursuit"),)
    moves = [step.law_name for step in add_neighbours(LAWS_OF_RUNS, ladder)[:-1]]
    rest = add_neighbours(LAWS_OF_RUNS, ladder, known={(name,) for name in moves[:2]})
    assert [step.law_name for step in rest] == [*moves[2:], friction.law_name]


def test_laws_are_not_searched_where_they_promise_nothing(friction):
    """Far beyond the noise, laws that explain hardly any of it are not tried; those that explain most of it are."""
    settings = friction.model.settings
    strict = replace(friction.model, settings=replace(settings, verdicts=replace(settings.verdicts, refused=2.0)))
    linear = refit(replace(friction, model=strict), {"": LINEAR})
    assert linear.ratio > 2.0
    kinds = ("arctan_velocity", "cubic_stiffness")
    (dictionary,) = LAWS_OF_RUNS.dictionaries(linear, kinds).values()
    assert dictionary.largest_expected_gain() > SETTINGS.good_fraction
    # something else pushes the body: nothing of it is a law's
    push = 1.0 * np.random.default_rng(5).normal(size=(2, linear.model.runs[0].sprung.size, 1))
    runs = tuple(
        driven_run(run.unsprung, run.sprung + own, fs=run.recorded_fs, loading=run.loading, settings=run.settings)
        for run, own in zip(linear.model.runs, push, strict=True)
    )
    pushed = fit_model(replace(linear.model, runs=runs), linear.theta)
    assert pushed.ratio > linear.ratio
    assert LAWS_OF_RUNS.dictionaries(pushed, kinds) == {}
    (step,) = search_laws(LAWS_OF_RUNS, pushed, kinds=kinds)
    assert step.fit is pushed


def test_the_library_is_what_is_searched_and_follows_the_registered_kinds():
    names = library()
    assert {"arctan_velocity", "arctan_mixed", "cubic_stiffness", "gas_column", "blow_off_damping"} <= set(names)
    assert set(names) <= set(LAWS)
    # one place says what is searched, and where: a free power contains others as special cases
    assert {name for name, kind in LAWS.items() if kind.bench_only} == {
        "signed_power_damping",
        "signed_power_stiffness",
    }
    assert set(names) == {name for name, kind in LAWS.items() if kind.searched and not kind.bench_only}

    def softening(z, v, s, _):
        bell = np.exp(-((z / s) ** 2))
        return z * bell, (1 - 2 * (z / s) ** 2) * bell, 0.0, 2 * (z / s) ** 3 * bell, 0.0

    stiffness = Parameter("stiffness_n_per_m", "N/m", "amplitude", 1e5)
    register_kind(Kind("softening", r"k z", (stiffness, Parameter("scale_m", "m", "scale", 0.005)), softening))
    try:
        assert "softening" in library()
    finally:
        unregister_kind("softening")


def test_what_a_law_contains_as_a_limit_is_tried_in_its_place():
    """Far from its scale arctan((z + c v) / s) is friction of the velocity alone, of either sign, or of the travel."""
    z, v = np.random.default_rng(0).standard_normal((2, 200)) * [[1e-3], [0.05]]
    for lag_s in (20.0, -20.0):
        mixed = law("arctan_mixed", amplitude_n=400.0, scale_m=0.4, lag_s=lag_s)
        by_velocity, by_travel = _list_limits(mixed + law("cubic_stiffness", stiffness_n_per_m3=1.0), library())
        np.testing.assert_allclose(by_velocity.force(z, v), mixed.force(z, v), atol=2.0)
        assert by_travel.name == "arctan_displacement+cubic_stiffness"
    assert not list(_list_limits(law("arctan_mixed", amplitude_n=400.0, scale_m=0.4, lag_s=1.0), ["arctan_mixed"]))


@pytest.mark.parametrize("stiffness", [2e6, -2e6])
@pytest.mark.parametrize("rest_m", [0.0, 0.01, -0.01])
def test_a_stop_is_tried_in_the_place_of_a_dead_zone(stiffness, rest_m):
    """As far as the motion does not visit its other corner both are the same, but for a straight line."""
    zone = law("dead_zone_stiffness", stiffness_n_per_m=stiffness, gap_m=0.006).resting_at(rest_m)
    stops = list(_list_limits(DEFAULT_LAW.resting_at(rest_m) + zone, library()))
    corner = np.copysign(0.006, stiffness)
    ways = {"rebound_stop": corner - rest_m, "bump_stop": corner + rest_m}
    assert {each.name for each in stops} == {f"arctan_velocity+{name}" for name, way in ways.items() if way > 0.0}
    for stop in stops:
        (name,) = set(stop.parameters) - {"arctan_velocity"}
        side = 1.0 if name == "rebound_stop" else -1.0
        # beyond this corner and before it, on the way there from rest
        before, beyond = side * ways[name] * np.array([0.9, 1.1])
        bend = [float(np.diff(each.gradient([before, beyond], 0.0)[0])[0]) for each in (zone, stop)]
        np.testing.assert_allclose(bend, 2e6)
    assert not list(_list_limits(zone, ["dead_zone_stiffness"]))


def test_stops_beyond_the_travel_are_not_offered(friction):
    far, near = (friction.motion(0)[0].max() * factor for factor in (2.0, 0.2))
    settings = replace(SETTINGS, scale_fractions=(0.0, 1.0))
    travel, velocity = friction.motion(0)
    terms = faint_terms(
        "rebound_stop",
        travel,
        velocity,
        travel_rms=float(travel.std()),
        velocity_rms=1.0,
        noise=5e-3,
        settings=settings,
    )
    gaps = [term.inner[0] for term in terms]
    assert 0 < len(gaps) < settings.n_scales
    assert near < max(gaps) < far
    rms = [float(np.sqrt(np.mean(Law((term,)).force(travel, velocity) ** 2))) for term in terms]
    np.testing.assert_allclose(rms, settings.faint * 5e-3)
    assert pulls_at_a_stop(law("bump_stop", stiffness_n_per_m=-1e5, gap_m=0.01))
    assert not pulls_at_a_stop(DEFAULT_LAW.scaled(-1.0))


def test_a_law_about_a_rest_that_no_run_comes_near_is_no_answer():
    """A spring to the ground hides the mean travel: a cube about one travel is a cube and a square about another."""
    cubic, away_m, ground = 4e9, -0.008, {"ground_stiffness_per_mass": 1e5 / MASS_KG}
    cube = law("cubic_stiffness", stiffness_n_per_m3=cubic)
    runs = runs_of(gear=LandingGear(law=cube, ground_stiffness_n_per_m=1e5))
    model = gear_model(runs, cube, ground=True)
    right = fit_model(model, vector_of(model, **ground))

    square = law("even_quadratic_stiffness", stiffness_n_per_m2=-3 * cubic * away_m)
    about_another = gear_model(runs, square + cube, ground=True)
    stiffer = float(right.theta[0]) + 3 * cubic * away_m**2 / MASS_KG
    theta = vector_of(about_another, stiffness_per_mass=stiffer, **ground)
    theta[about_another.n_shared :] = right.theta[model.n_shared :] + np.array([away_m, 0.0] * len(runs))
    wrong = fit_model(about_another, theta)

    assert wrong.theta[0] > 2.5 * right.theta[0]
    assert wrong.ratio < 1.002 * right.ratio
    assert is_impossible(wrong)
    assert not is_impossible(right)
