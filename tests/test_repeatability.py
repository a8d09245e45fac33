"""No two runs are alike: what differs is found, and the interval of the mass allows for what may differ."""

import re
from dataclasses import replace

import numpy as np
import pytest
from body_runs import aircraft, study as body_study
from law_runs import DAMPING, MASS_KG, STIFFNESS, gear_study, study_of

import opid
from opid.errors import InputError
from opid.mechanics.driven import Interface
from opid.mechanics.laws.law import LAWS, LINEAR, default_law, law
from opid.mechanics.repeatability import PARTS, Departure, part_of
from opid.suspensions.fitting.fit import fit_model
from opid.suspensions.fitting.repeatability import levels, with_departures
from opid.suspensions.identification import identify
from opid.suspensions.settings import RepeatabilitySettings, Settings
from opid.suspensions.study import Run
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test

LAW = "arctan_velocity"
# runs that are stated to be alike are then taken to be, whatever they say
NEVER_CONTRADICTED = Settings(repeatability=RepeatabilitySettings(bic_margin=np.inf))


def runs_that_differ(departure=None, *, third=None, seed=0, gear=None, **settings):
    """A heavy and a light run whose strut departs, and a third one at the first mass that departs as `third`."""
    given = {"duration_s": 20, "fs": 256} | settings
    rng = np.random.default_rng(seed)
    test = taxi_test(gear or LandingGear(), rng=rng, departures=(Departure(), departure or Departure()), **given)
    runs = [Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg)]
    if third is not None:
        changed = third.of(Interface(STIFFNESS, DAMPING, 0.0, LandingGear().law))
        again = LandingGear(
            suspension_stiffness_n_per_m=changed.stiffness,
            suspension_damping_n_s_per_m=changed.damping,
            law=changed.law,
        )
        runs.append(Run("again", taxi_run(again, rng=rng, **given).recording))
    return runs


def test_every_kind_of_law_belongs_to_springs_damping_or_friction():
    parts = {name: part_of(kind) for name, kind in LAWS.items()}
    assert set(parts.values()) == set(PARTS)
    for name, part in parts.items():
        usual = default_law(name).terms[0]
        by_travel = usual.evaluate(np.array([-0.01, 0.01]), np.zeros(2))[0]
        assert bool(by_travel.any()) == (part == "spring"), name


def test_a_departure_multiplies_its_own_part_alone():
    laws = {
        "arctan_velocity": {"amplitude_n": 400.0, "scale_m_per_s": 0.02},
        "cubic_stiffness": {"stiffness_n_per_m3": 1e8},
        "quadratic_damping": {"damping_n_s2_per_m2": 1e4},
    }
    strut = Interface(2e5, 4e3, 1e3, law("+".join(laws), **laws))
    found = Departure(0.1, 0.2, 0.3).of(strut)
    assert (found.stiffness, found.damping, found.ground_stiffness) == pytest.approx((2.2e5, 4.8e3, 1e3))
    before = {term.name: term.amplitude for term in strut.law.terms}
    factors = {"arctan_velocity": 1.3, "cubic_stiffness": 1.1, "quadratic_damping": 1.2}
    assert {term.name: term.amplitude / before[term.name] for term in found.law.terms} == pytest.approx(factors)


def test_derivatives_by_departures_are_those_of_the_parameters_they_multiply():
    """In its own run a departure of the springs does what their stiffness does, and nothing in the other."""
    fit = identify(study_of(), law=LAW).evidence[0].fit
    model, plain = replace(fit.model, repeatability=0.01), fit.model
    theta = with_departures(fit, 0.01).theta
    theta[np.r_[model.indices_of_run(0)[1], model.indices_of_run(1)[1]]] = 0.0
    n, n_first = fit.n_data, 2 * fit.errors.lines[0].size
    same = np.concatenate([theta[: model.n_shared], *(theta[model.indices_of_run(place)[0]] for place in (0, 1))])
    found, usual = model.evaluate(theta).jacobian[:n], plain.evaluate(same).jacobian[:n]
    # springs, damping, and the amplitude of the friction
    for part, entry in enumerate((0, 1, 2)):
        for place, rows in enumerate((slice(0, n_first), slice(n_first, n))):
            column = found[:, model.indices_of_run(place)[1].start + part]
            np.testing.assert_allclose(column[rows], usual[rows, entry] * same[entry], rtol=1e-9, atol=1e-12)
            assert np.count_nonzero(column) == np.count_nonzero(column[rows])


def test_a_second_flight_with_a_stiffer_spring_moves_no_mass_beyond_its_interval():
    """Two per cent of stiffness move the mass by 7 % where the runs are said to be alike; then no mass is told."""
    runs = runs_that_differ(Departure(spring=0.02), duration_s=40, fs=512)
    alike = identify(gear_study(*runs, repeatability=0.0), law=LAW, settings=NEVER_CONTRADICTED)
    assert alike.limited_by == "model"
    assert alike.parameters.sprung_mass_kg.value is None
    fit = alike.evidence[0].fit
    assert abs(1 / fit.model.inverse_mass(fit.theta) / MASS_KG - 1) > 0.05
    result = identify(gear_study(*runs, repeatability=None), law=LAW)
    mass = result.parameters.sprung_mass_kg
    assert mass.holds(MASS_KG)
    assert abs(mass.value / MASS_KG - 1) < 0.05
    assert result.evidence[0].repeatability.estimated > 2e-3


@pytest.mark.parametrize("gear", [LandingGear(), LandingGear(law=LINEAR)], ids=["friction", "linear"])
def test_a_repeatability_of_zero_that_the_runs_contradict_is_not_believed(gear):
    """Half a per cent of stiffness moved the mass by 2.5 to 3.4 % with an interval of 0.3 %, without a warning."""
    name = gear.law.name
    runs = runs_that_differ(Departure(spring=-0.005), gear=gear, duration_s=40, fs=512)
    believed = identify(gear_study(*runs, repeatability=0.0), law=name, settings=NEVER_CONTRADICTED)
    assert not believed.parameters.sprung_mass_kg.holds(MASS_KG)
    result = identify(gear_study(*runs, repeatability=0.0), law=name)
    assert result.parameters.sprung_mass_kg.holds(MASS_KG)
    (alike,) = (each.repeatability for each in result.evidence)
    assert (alike.stated, alike.exceeds) == (0.0, True)
    assert any("more than the stated repeatability of 0 %" in each for each in result.warnings)
    assert "(`repeatability = 0`), which these runs contradict: they show" in " ".join(opid.text(result).split())


def test_flights_that_are_alike_cost_a_wider_interval_and_no_accuracy():
    runs = runs_that_differ(duration_s=40, fs=512)
    same, usual = (identify(gear_study(*runs, repeatability=each), law=LAW) for each in (0.0, None))
    masses = [each.parameters.sprung_mass_kg for each in (same, usual)]
    assert masses[1].holds(MASS_KG)
    assert abs(masses[1].value - masses[0].value) < 2 * masses[0].std
    assert masses[1].std > masses[0].std
    (alike,) = (each.repeatability for each in usual.evidence)
    assert alike.is_usual
    assert alike.estimated < 0.3 * alike.stated
    assert alike.mass_if_alike == pytest.approx(masses[0].std / masses[1].std, rel=0.2)
    text = " ".join(opid.text(usual).split())
    found = re.search(r": ([\d.]+) % from the sensors' noise, ([\d.]+) % from suspensions", text)
    noise, rest = map(float, found.groups())
    assert noise == pytest.approx(196 * masses[0].std / MASS_KG, rel=0.2)
    assert np.hypot(noise, rest) == pytest.approx(196 * masses[1].std / MASS_KG, rel=0.05)
    assert "is taken to be 1 % (the usual value, for the study states no `repeatability`)" in text
    assert "What would help most: repeat each loading once more, alternately" in text
    text = " ".join(opid.text(same).split())
    assert "all of it from the sensors' noise" in text
    assert "stated to be the same in all runs (`repeatability = 0`)" in text


def test_the_first_mass_flown_again_tells_how_much_alike_the_runs_are():
    """Two runs of a linear strut leave it open which of mass and strut changed."""
    gear = LandingGear(law=LINEAR)
    two = identify(gear_study(*runs_that_differ(gear=gear), repeatability=None), law="linear")
    rng = np.random.default_rng(5)
    again = Run("again", taxi_run(gear, rng=rng, duration_s=20, fs=256).recording)
    three = identify(gear_study(*runs_that_differ(gear=gear), again, repeatability=None), law="linear")
    assert three.evidence[0].repeatability.estimated < two.evidence[0].repeatability.estimated
    widths = [each.parameters.sprung_mass_kg.std for each in (two, three)]
    assert widths[1] < 0.8 * widths[0]
    assert three.parameters.sprung_mass_kg.holds(MASS_KG)


def test_a_strut_that_changed_between_two_runs_of_one_mass_is_named():
    runs = runs_that_differ(third=Departure(spring=0.02, friction=-0.03))
    result = identify(gear_study(*runs, repeatability=None), law=LAW)
    told = [each for each in result.warnings if "in run 'again'" in each]
    assert any(
        each.startswith("the stiffness in run 'again' is 2") and "more than in run 'heavy'" in each for each in told
    )
    assert any(each.startswith("the friction in run 'again' is") and "less than" in each for each in told)
    # told run by run
    first, last = (each.stiffness for each in (result.interfaces[0].at_rest[0], result.interfaces[0].at_rest[2]))
    assert last.value / first.value == pytest.approx(1.02, abs=2e-3)


def test_levels_are_those_of_fits_at_each_of_them():
    """To first order about one fit, against fits."""
    runs = runs_that_differ(Departure(0.01, -0.01, 0.005))
    fit = identify(gear_study(*runs, repeatability=0.01), law=LAW).evidence[0].fit
    found = levels(fit, 0.01)
    assert found.weight.sum() == pytest.approx(1.0)
    place = fit.model.names.index("inverse_mass")
    for k in np.flatnonzero((found.repeatability > 2e-3) & (found.repeatability < 3e-2))[::3]:
        other = fit_model(replace(fit.model, repeatability=float(found.repeatability[k])), fit.theta)
        moved, std = other.theta[place] - fit.theta[place], np.sqrt(found.covariance[k, place, place])
        assert abs(moved - found.moved[k, place]) < 0.1 * std
        assert std == pytest.approx(other.std[place], rel=0.1)


def test_a_number_that_no_run_depends_on_leaves_the_levels_as_they_are():
    """As the stiffness of a stop that is never reached."""
    fit = identify(gear_study(*runs_that_differ(), repeatability=0.01), law=LAW).evidence[0].fit
    place = fit.model.names.index("law[1]")
    found = []
    for factor in (1e-4, 0.0):  # next to nothing, and nothing
        jacobian = fit.errors.jacobian.copy()
        jacobian[:, place] *= factor
        found.append(levels(replace(fit, errors=replace(fit.errors, jacobian=jacobian)), 0.01))
    hardly, idle = found
    assert idle.weight.sum() == pytest.approx(1.0)
    assert 0.3 < idle.median / hardly.median < 3.0
    assert np.abs(idle.moved[:, place]).max() < 1e-6 * fit.std[place]


def test_one_run_has_nothing_to_differ_from():
    result = identify(gear_study(runs_that_differ()[0], repeatability=None), law=LAW)
    assert result.evidence[0].repeatability.estimated is None
    assert result.ratios.stiffness_per_mass.holds(STIFFNESS / MASS_KG)


@pytest.mark.parametrize("wrong", [-0.01, 0.5, float("nan")])
def test_a_repeatability_that_cannot_be_is_refused(wrong):
    with pytest.raises(InputError, match="give the relative standard deviation by which springs"):
        gear_study(runs_that_differ()[0], repeatability=wrong)


def test_equal_masses_that_were_not_equal_are_not_taken_for_another_strut():
    heavy, light = runs_that_differ()
    result = identify(gear_study(heavy, replace(light, loading=()), repeatability=None), law=LAW)
    assert "natural frequencies" in result.not_determined


def test_two_runs_that_differ_say_that_something_changed_though_not_what():
    result = identify(gear_study(*runs_that_differ(Departure(spring=0.02)), repeatability=None), law=LAW)
    (said,) = (each for each in result.warnings if "are not those in run 'heavy'" in each)
    assert said.startswith("the stiffness and the ")
    assert "in run 'light'" in said
    assert result.parameters.sprung_mass_kg.holds(MASS_KG)


def test_a_run_whose_forces_all_changed_by_one_ratio_has_another_mass():
    """The third run is 60 kg heavier than stated: that is no strut that changed."""
    heavy, light = runs_that_differ(duration_s=40)
    gear = LandingGear(sprung_mass_kg=MASS_KG - 110.0)
    third = taxi_run(gear, rng=np.random.default_rng(9), duration_s=40, fs=256).recording
    result = identify(gear_study(heavy, light, Run("third", third, -170.0), repeatability=None), law=LAW)
    (said,) = (each for each in result.warnings if "check the mass_change_kg of all runs" in each)
    assert "in run 'third' are all" in said
    kg = float(said.split("as if it carried ")[1].split(" kg")[0])
    assert "more than stated" in said
    assert kg == pytest.approx(60, abs=15)


def test_a_stated_repeatability_that_the_runs_contradict_is_named():
    runs = runs_that_differ(Departure(0.02, -0.02, 0.01), duration_s=40)
    result = identify(gear_study(*runs, repeatability=0.001), law=LAW)
    assert any("more than the stated repeatability of 0.1 %" in each for each in result.warnings)


def test_no_number_is_known_better_than_at_the_level_that_knows_it_best():
    fit = identify(gear_study(*runs_that_differ(), repeatability=0.01), law=LAW).evidence[0].fit
    found = levels(fit, 0.01)
    rng = np.random.default_rng(0)
    appreciable = np.flatnonzero(found.weight > 1e-3)
    for _ in range(20):
        slopes = rng.standard_normal(fit.theta.size) / np.sqrt(np.diag(found.covariance[0]))
        each = [np.sqrt(slopes @ found.covariance[k] @ slopes) for k in appreciable]
        assert found.deviation(slopes) > 0.99 * min(each)


@pytest.mark.parametrize("shared", [(), (("left", "right"),)])
def test_a_body_whose_runs_may_differ_is_told_with_wider_intervals(shared):
    """Three gears, each with departures of its own, or two of them with the same."""
    given = body_study(shared=shared)
    same, usual = (identify(replace(given, repeatability=each), law=LAW) for each in (0.0, None))
    (fit,) = (each.fit for each in usual.evidence)
    assert fit.model.n_own == 6 + 3 * len(fit.model.groups)
    masses = [each.parameters.sprung_mass_kg for each in (same, usual)]
    assert masses[1].std > masses[0].std
    assert masses[1].holds(aircraft().mass_kg)
    assert abs(masses[1].value - masses[0].value) < 3 * masses[1].std
    assert "from suspensions that may differ from run to run" in " ".join(opid.text(usual).split())


@pytest.mark.parametrize("kind", ["cubic_stiffness", "arctan_displacement"])
def test_a_stiffer_spring_lifts_the_body_and_the_mass_is_told_all_the_same(kind):
    """Where the strut rests tells the mass of a law of the travel: a stiffer one rests elsewhere."""
    values = {"stiffness_n_per_m3": 3e8} if kind == "cubic_stiffness" else {"amplitude_n": 2000.0, "scale_m": 0.004}
    gear = LandingGear(law=law(kind, **values))
    runs = runs_that_differ(Departure(spring=0.01), gear=gear, duration_s=25)
    same = identify(gear_study(*runs, repeatability=0.0), law=kind, settings=NEVER_CONTRADICTED)
    usual = identify(gear_study(*runs, repeatability=None), law=kind)
    masses = [each.parameters.sprung_mass_kg for each in (same, usual)]
    assert masses[1].holds(MASS_KG)
    assert not masses[0].holds(MASS_KG)


def test_damping_that_changed_much_is_named_where_the_mass_is_not_told():
    runs = runs_that_differ(Departure(damper=-0.1), duration_s=25)
    result = identify(gear_study(*runs, repeatability=None), law=LAW)
    if result.parameters.sprung_mass_kg.value is None:
        assert "hides the effect of the mass change of 220 kg" in result.not_determined
    assert any("the damping" in each and "in run 'light'" in each for each in result.warnings)
