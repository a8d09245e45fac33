"""From a study of a body to an answer: which structure is recommended, what is told and what is withheld."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from body_runs import NOISE, aircraft, gears_apart, one_track, short_runs, study
from law_runs import logs_of

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.signals.recording import Channel, Recording
from opid.suspensions import identification
from opid.suspensions.answer import warnings as doubts
from opid.suspensions.answer.refusals import why_no_mass
from opid.suspensions.candidates import FittedStructure, groups_of
from opid.suspensions.identification import identify
from opid.suspensions.law_search import driven as driven_laws
from opid.suspensions.result import BodyParameters, BodyRatios, GearParameters
from opid.suspensions.settings import Settings
from opid.suspensions.study import (
    BodySensor,
    MeasuredInterface,
    PointMass,
    Run,
    StructureSettings,
    Study,
    study_of_gear,
)
from opid.virtual.taxi_tests.airframe import LandingGear

LAW = "arctan_velocity"
GEAR = LandingGear()


def near(estimate, truth):
    return abs(estimate.value - truth) < 4 * estimate.std


def candidates(found, kind):
    return [each for each in found.candidates if each.kind == kind]


@pytest.fixture(scope="module")
def compared():
    """All structures on the runs of the aircraft."""
    return identify(study("auto"), law=LAW)


def test_the_rigid_body_is_recommended_on_an_aircraft(compared):
    assert compared.structure == "rigid_body"
    assert [each.kind for each in compared.candidates] == ["single"] * 3 + ["pair", "rigid_body"]
    assert [each.recommended for each in compared.candidates] == [False] * 4 + [True]
    for each in compared.candidates[:4]:
        assert not each.explains
        assert each.residual_over_noise > 5
        assert "this structure does not fit these gears" in each.why
    rigid = compared.candidates[4]
    assert rigid.explains
    assert rigid.left_out_over_noise == pytest.approx(1.0, abs=0.1)
    assert compared.why.startswith("one rigid body leaves ")
    assert "each gear alone leaves" in compared.why


def test_its_numbers_are_those_of_the_aircraft(compared):
    true = aircraft()
    assert compared.not_determined is None
    assert compared.warnings == ()
    assert not compared.per_mass
    assert near(compared.parameters.sprung_mass_kg, true.mass_kg)
    assert near(compared.parameters.roll_inertia_kg_m2, true.ixx_kg_m2)
    assert near(compared.parameters.pitch_inertia_kg_m2, true.iyy_kg_m2)
    assert near(compared.parameters.x_cg_m, true.x_cg_m)
    assert isinstance(compared.ratios, BodyRatios)
    assert compared.noise_m_per_s2 == NOISE
    for each, gear in zip(compared.interfaces, true.gears, strict=True):
        assert each.name == gear.name
        assert near(each.stiffness, gear.suspension_stiffness_n_per_m)
        assert near(each.damping, gear.suspension_damping_n_s_per_m)
        assert near(each.law_estimates[LAW]["amplitude_n"], gear.law.parameters[LAW]["amplitude_n"])
        assert each.law.parameters[LAW]["amplitude_n"] == pytest.approx(each.law_estimates[LAW]["amplitude_n"].value)
        assert each.residual_over_noise == pytest.approx(1.0, abs=0.1)
        assert each.travel.shape == each.velocity.shape
        assert 1e-3 < each.travel.std() < 0.1


def test_what_is_left_of_each_run_is_shown(compared):
    assert [run.name for run in compared.runs] == ["light", "heavy"]
    assert [run.mass_change_kg for run in compared.runs] == [0.0, 500.0]
    assert compared.runs[1].loading == ((500.0, 1.0, 0.2),)
    for run in compared.runs:
        assert run.residual.shape == (3, run.frequency_hz.size)
        assert np.mean(run.residual**2) == pytest.approx(1.0, abs=0.1)
        assert run.measured.shape == run.predicted.shape == (3, run.time_s.size)
        assert np.std(run.measured - run.predicted) < 3 * NOISE
    assert compared.evidence[0].whiteness.white
    assert compared.options.law == LAW


@pytest.mark.slow
def test_gears_that_stand_alone_are_told_from_an_aircraft():
    found = identify(study("auto", runs=gears_apart()), law=LAW)
    assert found.structure == "single"
    assert [each.recommended for each in found.candidates] == [True] * 3 + [False, False]
    assert all(each.explains for each in candidates(found, "single"))
    assert not any(each.explains for each in candidates(found, "rigid_body"))
    # three gears under masses of their own; of a rigid body there is nothing
    assert near(found.parameters.sprung_mass_kg, 3 * GEAR.sprung_mass_kg)
    assert found.parameters.roll_inertia_kg_m2 == Estimate()
    assert found.ratios.x_cg_m == Estimate()
    assert [run.residual.shape[0] for run in found.runs] == [3, 3]


def test_one_loading_gives_ratios_and_a_sentence(compared):
    found = identify(study(runs=short_runs()[:1]), law=LAW)
    true = aircraft()
    assert found.not_determined.startswith(
        "one run gives ratios to the mass alone: record a second one with a known mass"
    )
    assert found.parameters == BodyParameters()
    assert found.per_mass
    assert near(found.ratios.pitch_radius_m, math.sqrt(true.iyy_kg_m2 / true.mass_kg))
    assert near(found.ratios.x_cg_m, true.x_cg_m)
    for each, gear in zip(found.interfaces, true.gears, strict=True):
        assert near(each.stiffness, gear.suspension_stiffness_n_per_m / true.mass_kg)
    assert found.candidates[0].left_out_over_noise is None
    # known better than the mass itself
    ratio = found.interfaces[1].stiffness
    absolute = compared.interfaces[1].stiffness
    assert ratio.std / ratio.value < absolute.std / absolute.value


def test_runs_of_one_loading_are_told_from_a_single_run():
    part = SimpleNamespace(fit=SimpleNamespace(model=SimpleNamespace(mass_free=False)), wrong_forces=())
    twice = study(runs=tuple(replace(run, loading=()) for run in short_runs()))
    assert why_no_mass(SimpleNamespace(study=twice, parts=[part])).startswith(
        "all runs have the same loading: only ratios to the mass"
    )


def test_a_run_of_a_few_seconds_is_refused():
    given = study()
    short = replace(given.runs[0], recording=given.runs[0].recording.section(0.0, 4.0))
    with pytest.raises(InputError, match="run 'light' lasts 4 s: give at least 10 s"):
        identify(replace(given, runs=(short, *given.runs[1:])))


def test_noise_that_is_not_stated_and_a_low_rate_are_told():
    given = study(noise_m_per_s2=None)
    slow = tuple(
        replace(run, recording=replace(run.recording, samples=run.recording.samples[::4], fs=64.0))
        for run in given.runs
    )
    part = SimpleNamespace(level=0.0053, is_noise_of_fit=False, settings=Settings())
    told = list(doubts._warn_of_record(SimpleNamespace(study=replace(given, runs=slow), parts=[part])))
    assert told[0].startswith("the noise of the sensors, 5.3 mm/s^2, is estimated from their quietest spectra")
    assert told[1].startswith("the runs are sampled at 64 Hz, and compared up to 25.6 Hz")
    assert not list(doubts._warn_of_record(SimpleNamespace(study=study(), parts=[part])))


def test_a_loading_that_moves_nothing_does_not_give_the_mass():
    runs = short_runs(loads=(PointMass(1.0, 1.0, 0.2),))
    found = identify(study(runs=runs), law=LAW)
    assert found.structure == "rigid_body"
    assert found.residual_over_noise < 1.2
    assert "the change of loading ('light' +0 kg, 'heavy' +1 kg) has too small an effect" in found.not_determined
    assert found.parameters == BodyParameters()
    assert found.candidates[0].sprung_mass_kg == Estimate()
    check_ratios(found)


def check_ratios(found):
    """What is told without the mass: places, radii, and suspensions per kg."""
    true = aircraft()
    assert found.per_mass
    assert near(found.ratios.x_cg_m, true.x_cg_m)
    assert near(found.ratios.pitch_radius_m, math.sqrt(true.iyy_kg_m2 / true.mass_kg))
    for each, gear in zip(found.interfaces, true.gears, strict=True):
        assert near(each.stiffness, gear.suspension_stiffness_n_per_m / true.mass_kg)
        amplitude = each.law_estimates[LAW]["amplitude_n"]
        assert near(amplitude, gear.law.parameters[LAW]["amplitude_n"] / true.mass_kg)
        assert each.law.parameters[LAW]["amplitude_n"] == pytest.approx(amplitude.value)


def with_loading(*rows):
    """The short runs, with another loading stated for the second."""
    return short_runs()[0], replace(short_runs()[1], loading=tuple(PointMass(*row) for row in rows))


def test_a_loading_of_the_wrong_sign_gives_no_negative_springs():
    found = identify(study(runs=with_loading((-500.0, 1.0, 0.2))), law=LAW)
    assert found.not_determined == (
        "the mass would be negative: check the sign of the loading ('light' +0 kg, 'heavy' -500 kg), or whether two "
        "runs are exchanged"
    )
    assert found.parameters == BodyParameters()
    assert not found.candidates[0].recommended
    assert found.candidates[0].sprung_mass_kg == Estimate()
    assert found.candidates[0].why.endswith("but its mass would be negative")
    check_ratios(found)


def test_runs_that_are_exchanged_are_told():
    light, heavy = short_runs()
    exchanged = (replace(light, recording=heavy.recording), replace(heavy, recording=light.recording))
    found = identify(study(runs=exchanged), law=LAW)
    assert found.not_determined.startswith("the mass would be negative")
    assert found.not_determined.endswith("whether two runs are exchanged")
    assert found.per_mass
    assert all(each.stiffness.value > 0 for each in found.interfaces)


def test_a_sensor_that_is_upside_down_is_refused_and_the_worst_one_named():
    runs = []
    for run in short_runs()[:1]:
        samples = np.array(run.recording.samples)
        samples[:, run.recording.names.index("left_upper_z")] *= -1
        recording = Recording(samples, fs=run.recording.fs, channels=run.recording.channels)
        runs.append(replace(run, recording=recording))
    found = identify(study(runs=tuple(runs)), law="linear")
    assert re.search(
        r"times the sensors' noise; most at 'left_upper_z': [\d.]+, the others [\d.]+", found.not_determined
    )
    assert "upside down, in another unit" in found.not_determined
    assert all(each.stiffness == Estimate() for each in found.interfaces)
    # places that the search ran to are nobody's
    assert not any("would have to be" in sentence for sentence in found.warnings)


def test_a_loading_in_tonnes_is_asked_about():
    found = identify(study(runs=with_loading((0.5, 1.0, 0.2))), law=LAW)
    assert found.warnings == (
        "the scale rests on +0.5 kg at (1, 0.2) m, which makes the mass 5.38 kg: loadings are in kg, and the runs "
        "cannot show that it was tonnes, which scale all masses and forces alike",
    )


def test_a_body_that_does_not_roll_does_not_tell_its_inertia_in_roll():
    """What the search finds is 2 to 90 per cent of it, with a sharp interval: noise explained."""
    found = identify(study(runs=one_track()), law=LAW)
    true = aircraft()
    assert found.not_determined is None
    assert found.residual_over_noise < 1.2
    assert found.parameters.roll_inertia_kg_m2 == found.ratios.roll_radius_m == Estimate()
    (sentence,) = found.warnings
    assert sentence.startswith("these runs do not determine the inertia in roll: this motion is too small")
    assert "let left and right run over different ground, load one side" in sentence
    assert near(found.parameters.sprung_mass_kg, true.mass_kg)
    assert near(found.parameters.pitch_inertia_kg_m2, true.iyy_kg_m2)


def test_inertias_that_rough_places_hide_are_told():
    found = identify(study(runs=short_runs()[:1], position_tolerance_m=0.6), law=LAW)
    assert found.ratios.roll_radius_m == Estimate()
    assert any("measure the coordinates better" in sentence for sentence in found.warnings)


def test_runs_that_do_not_go_together_are_not_recommended(monkeypatch):
    monkeypatch.setattr(driven_laws, "left_out_ratio", lambda fit: 1.5)
    found = identify(study(), law=LAW)
    (rigid,) = found.candidates
    assert rigid.residual_over_noise < 1.1
    assert (rigid.left_out_over_noise, rigid.explains, rigid.recommended) == (pytest.approx(1.5), False, False)
    assert "1.5 times as much in runs that the others predict" in rigid.why
    assert "leaves 0.998 times the noise, but 1.50 in runs that the others predict" in found.warnings[0]
    assert found.warnings[1].startswith("runs that are predicted from the other runs leave 1.50 times the noise")
    assert found.warnings[2].startswith("the intervals are withheld: the residual of the structure is not noise")
    mass = found.parameters.sprung_mass_kg
    assert mass.value == pytest.approx(aircraft().mass_kg, rel=0.02)
    assert mass.interval95 is None


def test_a_refit_that_fails_does_not_throw_the_fit_away(monkeypatch):
    monkeypatch.setattr(driven_laws, "left_out_ratio", lambda fit: None)
    found = identify(study(), law=LAW)
    assert near(found.parameters.sprung_mass_kg, aircraft().mass_kg)
    assert found.candidates[0].left_out_over_noise is None
    assert found.candidates[0].recommended
    assert "the model cannot be fitted when one of the runs is left out" in found.warnings[0]


def test_a_fuselage_that_bends_is_told_and_its_numbers_withheld():
    found = identify(study(runs=short_runs(8.0)), law="linear")
    assert found.residual_over_noise > 3
    assert not any(each.recommended for each in found.candidates)
    assert "no structure explains these runs" in found.warnings[0]
    assert "a bending airframe" in found.warnings[0]
    assert all(each.interval95 is None for _, each in found.parameters.items())
    assert all(each.stiffness.interval95 is None for each in found.interfaces)


@pytest.mark.slow
@pytest.mark.parametrize("fraction", [0.2, 10.0])
def test_noise_of_all_sensors_that_the_runs_contradict_is_named(compared, fraction):
    found = identify(study(noise_m_per_s2=fraction * NOISE), law=LAW)
    assert found.warnings[0].startswith("the stated noise of the sensors, ")
    assert "contradicts the runs: the residual of the model is white, with 5 mm/s^2" in found.warnings[0]
    assert len(found.warnings) == 1
    assert found.limited_by == "noise"
    assert found.recommended is not None
    assert found.residual_over_noise == pytest.approx(1 / fraction, rel=0.1)
    for mine, right in (
        (found.parameters.sprung_mass_kg, compared.parameters.sprung_mass_kg),
        (found.interfaces[1].stiffness, compared.interfaces[1].stiffness),
    ):
        assert mine.value == pytest.approx(right.value, abs=right.std)
        assert mine.std == pytest.approx(right.std, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "fraction", "is_given"), [(0, 0.1, True), (1, 0.1, True), (2, 0.03, False)])
def test_a_force_that_nobody_measured_widens_the_intervals_of_an_aircraft_and_bends_nothing(
    monkeypatch, seed, fraction, is_given
):
    """A tenth of its motion is beyond what is refused of a wrong structure."""
    monkeypatch.setattr(identification, "library", lambda: ("arctan_velocity", "cubic_stiffness"))
    runs = short_runs(seed=seed, pushed_fraction=fraction)
    found = identify(study(runs=runs), law=LAW if is_given else None)
    assert found.residual_over_noise > 150 * fraction
    assert found.limited_by == "unmeasured forces"
    assert found.recommended is not None
    assert "is incoherent with every motion measured below it" in found.warnings[0]
    assert "limited by something that moves the body" in found.warnings[1]
    assert any("from unmeasured forces" in each for each in found.evidence[0].limits)
    assert not any("prediction of each run from the others is not" in sentence for sentence in found.warnings)
    for run, left in zip(found.runs, found.evidence[0].error.left_out, strict=True):
        assert 0.5 * fraction < run.unexplained < 2 * fraction
        assert left.unexplained < 1.2 * run.unexplained
        assert left.inside > 0.8
    truths = []
    for each, gear in zip(found.interfaces, aircraft().gears, strict=True):
        truths += [
            (each.stiffness, gear.suspension_stiffness_n_per_m),
            (each.damping, gear.suspension_damping_n_s_per_m),
        ]
    # none is told where it is hidden
    if found.parameters.sprung_mass_kg.value is not None:
        truths.append((found.parameters.sprung_mass_kg, aircraft().mass_kg))
        assert found.parameters.sprung_mass_kg.std > 0.1 * fraction * aircraft().mass_kg
    assert [estimate.holds(truth) for estimate, truth in truths].count(False) <= 1
    assert all(abs(estimate.value - truth) < 4 * estimate.std for estimate, truth in truths)


def test_a_fuselage_that_bends_is_refused_under_a_force_that_nobody_measured_too():
    found = identify(study(runs=short_runs(8.0, pushed_fraction=0.03)), law="linear")
    assert found.residual_over_noise > 20
    assert found.is_refused
    assert found.limited_by == "model"
    assert not any(each.recommended for each in found.candidates)


@pytest.mark.slow
def test_loadings_that_were_not_there_are_not_believed():
    """A wrong mass would scale everything and be seen by nobody; a wrong place is seen."""
    runs = short_runs()
    wrong = (runs[0], replace(runs[1], loading=(PointMass(500.0, -1.5, -1.0),)))
    found = identify(study(runs=wrong), law=LAW)
    assert found.residual_over_noise > 1.2
    assert not found.candidates[0].recommended
    assert any("wrong coordinates or loadings" in sentence for sentence in found.warnings)


def test_groups_share_and_places_are_corrected_within_their_tolerance():
    shared = (("left", "right"),)
    given = study(shared=shared, position_tolerance_m=0.01)
    assert [group.members for group in groups_of(given)] == [(0,), (1, 2)]
    off = replace(given.interfaces[1], sensor_x_m=given.interfaces[1].sensor_x_m + 0.015)
    given = replace(given, interfaces=(given.interfaces[0], off, given.interfaces[2]))
    found = identify(given, law=LAW)
    nose, left, right = found.interfaces
    assert nose.shared_with == ()
    assert left.shared_with == ("right",)
    assert left.stiffness == right.stiffness
    assert near(left.stiffness, aircraft().gears[1].suspension_stiffness_n_per_m)
    assert len(found.place_corrections) == 12
    assert all(each.std < 0.0101 for each in found.place_corrections.values())
    assert near(found.parameters.sprung_mass_kg, aircraft().mass_kg)
    assert found.places["left"] == (0.0, 1.6, 0.265, 1.4)


def test_a_further_sensor_on_the_body_is_predicted_too():
    """Here one that is read twice: a copy of the left one."""
    runs = []
    for run in short_runs():
        samples = np.column_stack([run.recording.samples, run.recording.channel("left_upper_z")])
        rng = np.random.default_rng(len(runs))
        samples[:, -1] += NOISE * rng.standard_normal(len(samples))
        channels = (*run.recording.channels, Channel("again", "m/s^2"))
        runs.append(replace(run, recording=Recording(samples, fs=run.recording.fs, channels=channels)))
    given = replace(study(runs=tuple(runs)), sensors=(BodySensor("again", 0.25, 1.4),))
    found = identify(given, law=LAW)
    assert near(found.parameters.sprung_mass_kg, aircraft().mass_kg)
    assert found.runs[0].residual.shape[0] == 4
    assert len(found.interfaces) == 3


def test_pairs_are_found_by_their_places():
    found = identify(study("pair"), law="linear")
    assert [each.kind for each in found.candidates] == ["pair", "single"]
    assert found.interfaces[1].shared_with == ("right",)
    assert found.not_determined.endswith('these gears do not move alone: try kind = "auto" or "rigid_body"')
    assert found.interfaces[0].stiffness == Estimate()


def test_where_nothing_can_be_fitted_it_is_said(monkeypatch):
    def fails(task, interfaces):
        return FittedStructure("single", interfaces, None, task.noise, task, "it grows")

    monkeypatch.setattr(identification, "fit_alone", fails)
    with pytest.raises(NotDeterminedError, match="no structure can be fitted to these runs: it grows; it grows"):
        identify(study("single"))


def test_a_gear_that_cannot_be_fitted_leaves_no_mass_of_the_whole(monkeypatch):
    real = identification.fit_alone

    def fails_at_the_nose(task, interfaces):
        if interfaces == (0,):
            return FittedStructure("single", interfaces, None, task.noise, task, "it grows")
        return real(task, interfaces)

    monkeypatch.setattr(identification, "fit_alone", fails_at_the_nose)
    found = identify(study("single", runs=gears_apart()), law=LAW)
    assert found.not_determined == "nose cannot be fitted (it grows), so there is no mass of the whole"
    assert found.parameters.sprung_mass_kg == Estimate()
    assert "each gear alone cannot be fitted" in found.why
    assert [each.name for each in found.interfaces] == ["left", "right"]
    assert found.interfaces[0].stiffness.interval95 is not None


def test_an_unknown_law_is_refused():
    with pytest.raises(InputError, match="arctan_velocity"):
        identify(study(), law="arctan_velocty")


def two_gears(*, right_loaded):
    """The main gears of those that stand apart; the right one without its load if so wished."""
    light, heavy = gears_apart()
    recording, loading = heavy.recording, heavy.loading[1:]
    if not right_loaded:
        samples = np.array(recording.samples)
        for name in ("right_lower_z", "right_upper_z"):
            samples[:, recording.names.index(name)] = light.recording.channel(name)
        recording, loading = Recording(samples, fs=recording.fs, channels=recording.channels), loading[:1]
    given = study("auto", runs=(light, replace(heavy, recording=recording, loading=loading)))
    return replace(given, interfaces=given.interfaces[1:])


def test_two_interfaces_on_one_line_are_compared_as_gears_alone():
    """kind = "auto" leaves the rigid body out where it cannot be."""
    found = identify(two_gears(right_loaded=True), law=LAW)
    assert {each.kind for each in found.candidates} == {"single", "pair"}
    assert found.structure == "single"
    assert near(found.parameters.sprung_mass_kg, 2 * GEAR.sprung_mass_kg)
    assert all(near(each.sprung_mass_kg, GEAR.sprung_mass_kg) for each in candidates(found, "single"))
    assert any(sentence.startswith("one rigid body was not tried") for sentence in found.warnings)


def test_a_load_over_one_gear_says_nothing_of_the_other():
    found = identify(two_gears(right_loaded=False), law=LAW)
    left, right = candidates(found, "single")
    assert near(left.sprung_mass_kg, GEAR.sprung_mass_kg)
    assert right.sprung_mass_kg == Estimate()
    assert right.explains
    assert found.not_determined.startswith("the loading ('light' +0 kg, 'heavy' +200 kg) does not rest on right")
    assert found.parameters.sprung_mass_kg == Estimate()
    assert found.per_mass
    for each in found.interfaces:
        # the same noise twice on the right: its interval is too narrow
        truth = GEAR.suspension_stiffness_n_per_m / GEAR.sprung_mass_kg
        assert each.stiffness.value == pytest.approx(truth, rel=2e-3)


# ---- a gear is an aircraft with one leg ------------------------------------------------------------


def test_a_gear_is_a_body_with_one_interface_to_the_last_digit():
    """The same runs as a study of one gear, and with one table [[interfaces]] at the origin."""
    logs = [Run(name, *each) for name, each in zip(("heavy", "light"), logs_of(), strict=True)]
    gear = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=logs)
    written = Study("taxi", (MeasuredInterface("left", "upper_z", "lower_z"),), logs, StructureSettings("auto"))
    assert written.is_one_gear
    one, other = (identify(each) for each in (gear, written))
    assert one.parameters == other.parameters
    assert one.ratios == other.ratios
    assert one.law_estimates == other.law_estimates
    assert one.warnings == other.warnings
    np.testing.assert_array_equal(one.evidence[0].fit.theta, other.evidence[0].fit.theta)


def test_a_single_gear_of_a_rolling_aircraft_gets_no_mass_and_is_told_that_it_may_not_be_alone():
    """The left gear of the aircraft, under its share of the load; what it leaves is short of a plain refusal."""
    logs = [Run(run.name, run.recording, 0.4 * run.mass_change_kg) for run in short_runs()]
    found = identify(study_of_gear("left", sprung="left_upper_z", unsprung="left_lower_z", runs=logs), law=LAW)
    assert found.residual_over_noise > 3
    assert "the body also rolls and pitches on other gears" in found.not_determined
    assert "describe all of them in [[interfaces]]" in found.not_determined
    assert found.parameters == GearParameters()
    assert any("roll or pitch of a body on several gears" in each for each in found.warnings)
    # forces are per kg here, and so is every number in a sentence
    assert all("N/m per kg" in each for each in found.warnings if "K3 = " in each)


def test_ground_springs_of_an_aircraft_that_are_ruled_out_are_zero(compared):
    found = identify(study(), law=LAW, ground=False)
    assert [each.ground_stiffness for each in found.interfaces] == [Estimate(0.0)] * 3
    for each in compared.interfaces:
        assert each.ground_stiffness.value == 0.0
        assert 0.0 < each.ground_stiffness.std < 0.02 * each.stiffness.value


def test_ground_springs_of_an_aircraft_are_found_with_its_mass_and_laws():
    found = identify(study(runs=short_runs(ground_n_per_m=1e5)), law=LAW)
    assert found.not_determined is None
    assert found.parameters.sprung_mass_kg.holds(aircraft().mass_kg)
    for each, gear in zip(found.interfaces, aircraft().gears, strict=True):
        assert each.law.name == gear.law.name
        assert each.ground_stiffness.holds(1e5)
        assert each.ground_stiffness.std < 2e3
