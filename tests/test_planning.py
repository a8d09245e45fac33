"""Plans of runs: expected standard deviations against stated ones, the cheapest plan, and guesses that are wrong."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from opid import text
from opid.errors import InputError, NotDeterminedError
from opid.mechanics.laws.law import law
from opid.planning import Guess, GuessedGear, GuessedRoad, GuessedSensors, plan, read_guess
from opid.suspensions.identification import identify
from opid.suspensions.planning.result import Costs, PlannedRun
from opid.suspensions.planning.search import SearchSpace, plan_runs
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_test

FRICTION = {"arctan_velocity": {"amplitude_n": 400.0, "scale_m_per_s": 0.02}}
GEAR = GuessedGear(
    sprung_mass_kg=1850.0, suspension_stiffness_n_per_m=3.9e5, suspension_damping_n_s_per_m=6e3, law=FRICTION
)
TWO_RUNS = (PlannedRun(40.0), PlannedRun(40.0, -220.0))
ONLY_THESE = SearchSpace((40.0,), (-220.0,), (1,))
GUESS = Guess(gear=GEAR, runs=TWO_RUNS, sensors=GuessedSensors(fs_hz=256.0), repeatability=0.0)
REACHED = ["sprung_mass=100%"]


def std_of(found, name="sprung_mass_kg"):
    return found.planned.std_of(name)


def identified(*, repeatability=0.0, seed=1, **settings):
    gear = LandingGear(law=law("arctan_velocity", **FRICTION["arctan_velocity"]))
    test = taxi_test(gear, rng=np.random.default_rng(seed), fs=256.0, **settings)
    study = replace(taxi_study(test, title="taxi"), repeatability=repeatability)
    return identify(study, law="arctan_velocity")


@pytest.fixture(scope="module")
def runs_made():
    return identified()


@pytest.fixture(scope="module")
def planned():
    return plan(GUESS, ["sprung_mass=0.05%"])


def test_runs_that_were_made_have_the_stated_standard_deviations(runs_made):
    found = plan_runs(runs_made, ["sprung_mass=1%"])
    stated = {row.name: row.std for row in runs_made.summary()}
    for each in found.planned.numbers:
        assert each.std == pytest.approx(stated[each.name], rel=0.05), each.name
    # they reach this target, so no run has to be added
    assert found.cheapest.runs == ()
    assert found.cheapest.cost == 0.0
    assert "no further run is needed" in " ".join(text(found).split())


def test_a_guess_predicts_what_other_runs_over_another_road_give(planned, runs_made):
    stated = {row.name: row.std for row in runs_made.summary()}
    for each in planned.planned.numbers:
        assert each.std == pytest.approx(stated[each.name], rel=0.15), each.name


def test_runs_add_to_those_that_were_made(runs_made):
    found = plan_runs(runs_made, ["sprung_mass=0.06%"], search=SearchSpace((40.0,), (-220.0,), (1, 2, 3, 4)))
    n = len(found.cheapest.runs)
    alone = std_of(found) / np.sqrt(1 + n / 2)
    assert found.cheapest.std_of("sprung_mass_kg") == pytest.approx(alone, rel=0.15)


def test_information_grows_in_proportion_to_time():
    """Runs that were really made twice as long give what the plan scales."""
    short, long = identified(seed=3), identified(seed=3, duration_s=80.0)
    scaled = plan_runs(short, REACHED, runs=(PlannedRun(80.0), PlannedRun(80.0, -220.0)), noise_m_per_s2=0.005)
    stated = {row.name: row.std for row in long.summary()}
    for each in scaled.planned.numbers:
        assert each.std == pytest.approx(stated[each.name], rel=0.15), each.name


@pytest.mark.parametrize("kind", ["linear", "friction"])
def test_a_motion_is_scaled_to_another_road_class_as_if_it_were_simulated(kind):
    gear = replace(GEAR, law={}) if kind == "linear" else GEAR
    guess = replace(GUESS, gear=gear, search=ONLY_THESE)
    scaled, rougher = (plan(each, REACHED) for each in (guess, replace(guess, road=GuessedRoad(road_class="C"))))
    (change,) = (each for each in scaled.changes if each.what == "a road one class rougher")
    # friction keeps the wheel of a smooth road quieter than a factor of 2
    assert change.std[0] == pytest.approx(std_of(rougher), rel=0.02 if kind == "linear" else 0.15)


def test_the_cheapest_plan_reaches_the_target_and_no_cheaper_one_does(planned):
    best, grid, target = planned.cheapest, planned.grid, planned.targets[0]
    assert best.std_of("sprung_mass_kg") <= target.std
    assert best.cost == pytest.approx(planned.costs.of(best.runs))
    for change_kg, row in zip(grid.mass_changes_kg, grid.std[0], strict=True):
        for duration_s, std in zip(grid.durations_s, row, strict=True):
            runs = (PlannedRun(duration_s), PlannedRun(duration_s, change_kg))
            assert std > target.std or planned.costs.of(runs) >= best.cost
        assert all(before > after for before, after in pairwise(row))


def test_costs_choose_another_plan(planned):
    """If only seconds cost something, few seconds with the largest mass change are cheapest."""
    seconds = plan(GUESS, ["sprung_mass=0.05%"], costs=Costs(per_run=0.0, per_s=1.0, per_kg=0.0, unit="s"))
    assert sum(run.duration_s for run in seconds.cheapest.runs) < sum(run.duration_s for run in planned.cheapest.runs)
    assert min(run.mass_change_kg for run in seconds.cheapest.runs) == min(seconds.grid.mass_changes_kg)


def test_a_target_that_no_plan_reaches_is_said_in_one_sentence():
    found = plan(replace(GUESS, search=ONLY_THESE), ["sprung_mass=0.001%"])
    assert found.cheapest is None
    assert "none of the 1 plans that were tried reaches sprung_mass=0.001%" in found.not_determined
    assert "longer runs" in found.not_determined
    assert found.best.std_of("sprung_mass_kg") == pytest.approx(std_of(found))


def test_differences_between_runs_that_rule_the_mass_are_named():
    found = plan(replace(GUESS, repeatability=0.01, search=ONLY_THESE), ["sprung_mass=0.1%"])
    assert found.cheapest is None
    assert "the runs may differ" in found.not_determined
    number = found.planned.numbers[0]
    low, high = number.std_range
    assert low < number.std < high
    (alike,) = (each for each in found.changes if "known to be alike" in each.what)
    assert alike.std[0] < 0.05 * number.std


def test_runs_that_turn_out_to_be_alike_have_the_stated_standard_deviation():
    """The identification weighs how much the runs show, so it states far less than for runs that differ as stated."""
    found = plan(replace(GUESS, repeatability=0.01, search=ONLY_THESE), REACHED)
    (alike,) = (each for each in found.changes if each.what == "runs that turn out to be alike")
    mass = identified(repeatability=0.01).parameters.sprung_mass_kg
    assert 0.4 * alike.std[0] < mass.std < 2.5 * alike.std[0]
    assert found.ranges[0][0] <= alike.std[0] < 0.3 * found.planned.numbers[0].std


def test_without_a_mass_change_no_mass_is_promised():
    bare = replace(GUESS, runs=(PlannedRun(40.0), PlannedRun(40.0)), search=SearchSpace((40.0,), (0.0,), (1,)))
    found = plan(bare, ["sprung_mass=1%"])
    assert found.cheapest is None
    assert found.not_determined.startswith("no planned run changes the mass")
    known = {each.name: each.std for each in found.planned.numbers}
    assert known["sprung_mass_kg"] is None
    assert known["suspension_stiffness_n_per_m"] is None
    # ratios need no mass
    assert 0.0 < known["natural_frequency_hz"] < 1e-3
    assert any("sprung mass" in each for each in found.inseparable)


def test_friction_that_is_only_damping_is_named_as_inseparable():
    """A friction whose scale is far beyond the motion is a damper to the runs."""
    slow = replace(GUESS, gear=replace(GEAR, law={"arctan_velocity": {"amplitude_n": 4e4, "scale_m_per_s": 4.0}}))
    found = plan(replace(slow, search=ONLY_THESE), REACHED)
    assert found.planned.numbers[2].value == 6e3
    damper = [each for each in found.inseparable if "damping over mass" in each]
    assert any("arctan_velocity.amplitude_n" in each and "cannot be told apart" in each for each in damper)


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "stiffness", "road"), [(1.25, 0.8, "C"), (0.8, 1.25, "A")])
def test_a_guess_that_is_wrong_by_a_fifth_says_by_how_much_the_prediction_changes(mass, stiffness, road):
    right = replace(GUESS, search=ONLY_THESE)
    gear = replace(GEAR, sprung_mass_kg=mass * 1850.0, suspension_stiffness_n_per_m=stiffness * 3.9e5)
    wrong = replace(right, gear=gear, road=GuessedRoad(road_class=road))
    low, high = plan(wrong, REACHED).ranges[0]
    assert low < std_of(plan(right, REACHED)) < high
    assert high > 2 * low


def test_an_identification_that_noise_does_not_limit_is_no_basis(runs_made):
    evidence = replace(runs_made.evidence[0], error=_Limit("unmeasured forces"))
    with pytest.raises(NotDeterminedError, match="limited by unmeasured forces"):
        plan_runs(replace(runs_made, evidence=(evidence,)), REACHED)
    with pytest.raises(NotDeterminedError, match="no mass"):
        plan_runs(replace(runs_made, not_determined="the loading does not change"), REACHED)


class _Limit:
    def __init__(self, limit):
        self.limit = limit


@pytest.mark.parametrize(
    ("targets", "words"),
    [
        ([], "no target"),
        (["sprung_mass"], "give a number and its standard deviation"),
        (["sprung_mas=1%"], "did you mean 'sprung_mass_kg'"),
        (["sprung_mass=0%"], "no positive standard deviation"),
        (["sprung_mass=-1"], "no positive standard deviation"),
        (["sprung_mass=1e"], "no positive standard deviation"),
    ],
)
def test_targets_that_cannot_be(runs_made, targets, words):
    with pytest.raises(InputError, match=words):
        plan_runs(runs_made, targets)


FILE = """
repeatability = 0.0
[gear]
sprung_mass_kg = 1850
suspension_stiffness_n_per_m = 3.9e5
suspension_damping_n_s_per_m = 6e3
[gear.law.arctan_velocity]
amplitude_n = 400.0
scale_m_per_s = 0.02
[road]
road_class = "B"
[[runs]]
duration_s = 40
[[runs]]
duration_s = 40
mass_change_kg = -220
"""


def test_a_guess_is_read(tmp_path):
    path = tmp_path / "guess.toml"
    path.write_text(FILE, encoding="utf-8")
    guess = read_guess(path)
    assert (guess.gear, guess.runs, guess.source) == (GEAR, TWO_RUNS, path)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("sprung_mass_kg = 1850", "sprung_mass_kg = -5", "sprung_mass_kg is -5"),
        ("sprung_mass_kg = 1850", "", "lacks 'sprung_mass_kg'"),
        ("sprung_mass_kg", "sprung_mas_kg", "unknown key 'sprung_mas_kg'"),
        ("arctan_velocity", "arctan_velocty", "arctan_velocity"),
        ("amplitude_n = 400.0", "amplitude_n = -1", "would drive the gear"),
        ("amplitude_n = 400.0", "", "amplitude_n"),
        ('road_class = "B"', 'road_class = "Q"', "road class 'Q'"),
        ('road_class = "B"', "speed_m_per_s = [0, 0]", "speed_m_per_s"),
        ("duration_s = 40", "duration_s = 4", "lasts 4 s"),
        ("mass_change_kg = -220", "mass_change_kg = -2200", "give less than that"),
        ("repeatability = 0.0", "repeatability = 2.0", "repeatability is 2.0"),
        ("[road]", "[sensors]\nnoise_m_per_s2 = 0\n[road]", "noise_m_per_s2 is 0"),
        ("[road]", "[costs]\nper_run = -1\n[road]", "not negative"),
        ("[road]", "[search]\ndurations_s = []\n[road]", "no duration"),
        ("[[runs]]", "[[flights]]", "runs"),
    ],
)
def test_guesses_that_cannot_be(tmp_path, before, after, words):
    path = tmp_path / "guess.toml"
    path.write_text(FILE.replace(before, after), encoding="utf-8")
    with pytest.raises(InputError, match=words) as error:
        read_guess(path)
    assert str(error.value).startswith(str(path))


def test_what_is_no_guess_is_refused():
    with pytest.raises(InputError, match="give a Guess"):
        plan("guess.toml", REACHED)
    with pytest.raises(InputError, match="states its law"):
        plan(GUESS, REACHED, law="linear")
