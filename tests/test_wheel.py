"""Wheel, tyre and road beside the truth of a simulated test, where an assumption fails, and `opid wheel`."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cli_runs import not_determined, opid, refused

from opid import plots
from opid.errors import InputError
from opid.mechanics.laws.law import LINEAR
from opid.report import text
from opid.signals.recording import Channel
from opid.studies.study_file import read_study, write_study
from opid.suspensions.answer.stored_fit import restore_model, store_fits
from opid.suspensions.identification import collect_arrays, identify
from opid.suspensions.study import BodySensor, MeasuredInterface, Run, Study, study_of_gear
from opid.suspensions.wheel.identification import identify_wheel
from opid.suspensions.wheel.likelihood import (
    FIRST_ROAD,
    WheelProblem,
    average_strut,
    cut_into_blocks,
    evaluate_lines,
    straighten_strut,
)
from opid.suspensions.wheel.result import WheelSettings, classify_road
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

GEAR = LandingGear()
BRAKING = (18.0, 0.5)


def with_speed(run, speed):
    """Return a run with the channel of a GPS receiver, whose speed goes linearly from one value to another."""
    recording = run.recording
    samples = np.column_stack([recording.samples, np.linspace(*speed, recording.n_samples)])
    channels = (*recording.channels, Channel("speed", "m/s"))
    return replace(run, recording=replace(recording, samples=samples, channels=channels), speed_m_per_s="speed")


def at_speed(study, speed):
    """Return a study whose runs have a speed."""
    return replace(study, runs=tuple(with_speed(run, speed) for run in study.runs))


@pytest.fixture(scope="module")
def braking(identified):
    """The study of the field test with its speed."""
    return at_speed(identified.result.study, BRAKING)


@pytest.fixture(scope="module")
def found(braking, identified):
    """Its wheel."""
    return identify_wheel(braking, identified.result)


@pytest.fixture(scope="module")
def linear():
    """A gear without friction: its study and its identification."""
    gear = replace(GEAR, law=LINEAR)
    test = taxi_test(gear, rng=np.random.default_rng(3), duration_s=20.0, fs=256.0)
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    study = study_of_gear("linear", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=0.0)
    return at_speed(study, BRAKING), identify(study, law="linear")


def cut_first_run(study, result, settings):
    """Return the blocks of the first run."""
    (fit,) = store_fits(result)
    alone = replace(study, runs=study.runs[:1])
    known = restore_model(fit, alone, collect_arrays(alone)[0], result.settings, is_run=True)
    return cut_into_blocks(known, alone.runs[0], alone.runs[0].recording.channel("speed"), settings)


# ---- the likelihood --------------------------------------------------------------------------------


def true_vector(gear, n_runs=1):
    """Return the vector of unknowns of the virtual taxi run."""
    mass = gear.sprung_mass_kg
    head = [
        np.log(gear.unsprung_mass_kg / mass),
        np.log(gear.tyre_stiffness_n_per_m / mass),
        gear.tyre_damping_n_s_per_m / mass,
        2.0,
        0.3,
    ]
    return np.array([*head, *[np.log(64e-6)] * n_runs])


def test_the_gradient_is_that_of_the_cost(linear):
    gear = cut_first_run(*linear, WheelSettings())
    column = np.linspace(-1.0, 1.0, gear.speed.shape[0])
    problem, struts = WheelProblem((gear,), WheelSettings(), (column,)), (straighten_strut(gear),)
    vector = np.append(true_vector(GEAR), 0.1)

    def cost(at):
        return problem.cost(problem.evaluate(at, struts), at)

    gradient = problem.gradient(problem.evaluate(vector, struts), vector)
    steps = 1e-5 * np.eye(vector.size)
    by_differences = [(cost(vector + step) - cost(vector - step)) / 2e-5 for step in steps]
    assert gradient == pytest.approx(by_differences, rel=1e-4, abs=1e-2)


def test_the_expectation_is_that_of_the_lines(linear):
    """At the true values the squared lines have their expected size."""
    gear = cut_first_run(*linear, WheelSettings())
    lines = evaluate_lines(gear, true_vector(GEAR), FIRST_ROAD, straighten_strut(gear))
    assert lines.ratio[gear.is_used].mean() == pytest.approx(1.0, abs=0.12)


def test_probes_find_the_response_of_a_linear_strut(linear):
    gear = cut_first_run(*linear, WheelSettings())
    straight, by_probes = straighten_strut(gear), average_strut(gear, true_vector(GEAR), WheelSettings(), 0)
    above_bounce = (gear.frequency_hz > 5.0) & gear.is_used.any(axis=0)
    assert np.abs(by_probes / straight - 1)[above_bounce].max() < 0.05


def test_friction_damps_a_small_force_less_than_its_mean_slope_does(braking, identified):
    """It sticks while the strut hardly moves, and slips while it moves: the mean response is not that of the mean."""
    gear = cut_first_run(braking, identified.result, WheelSettings())
    straight, by_probes = straighten_strut(gear), average_strut(gear, true_vector(GEAR), WheelSettings(), 0)
    hop = (gear.frequency_hz > 8.0) & (gear.frequency_hz < 16.0)
    assert np.abs(by_probes / straight - 1)[hop].mean() > 0.02


# ---- the answer ------------------------------------------------------------------------------------


def test_wheel_and_tyre_are_found(found):
    assert found.not_determined is None
    assert not found.per_mass
    for name in ("unsprung_mass_kg", "tyre_stiffness_n_per_m", "tyre_damping_n_s_per_m"):
        estimate, true = getattr(found.parameters, name), getattr(GEAR, name)
        assert abs(estimate.value - true) < 3 * estimate.std
    assert found.parameters.unsprung_mass_kg.std < 0.35 * GEAR.unsprung_mass_kg
    assert found.parameters.footprint_m.value == pytest.approx(0.3, abs=3 * found.parameters.footprint_m.std)
    assert found.parameters.road_slope.value == pytest.approx(2.0, abs=3 * found.parameters.road_slope.std)
    assert found.bounds is None or all(0.0 < each < 3.0 for each in found.bounds)


def test_the_road_has_its_class(found):
    assert all("B" in road.road_class for road in found.roads)
    assert all(road.roughness_m3.interval95[0] < 64e-6 < road.roughness_m3.interval95[1] for road in found.roads)
    assert found.roads[0].speed_m_per_s == pytest.approx((18.0, 9.25, 0.5), rel=1e-3)


def test_the_wheel_hops_at_its_frequency(found):
    """sqrt((K1 + K2)/M1) is 15.6 Hz."""
    hop = found.parameters.hop_frequency_hz
    assert hop.value == pytest.approx(15.6, abs=3 * hop.std + 0.5)


def test_a_linear_tyre_is_called_linear(found):
    changes = (found.stiffer_by_load, found.stiffer_by_force)
    assert all(abs(change.value) < 3 * change.std for change in changes)
    assert not any("not linear" in warning for warning in found.warnings)


def test_the_same_seed_gives_the_same_answer(found, braking, identified):
    assert identify_wheel(braking, store_fits(identified.result)).to_dict() == found.to_dict()


def test_one_loading_gives_ratios(linear):
    study, _ = linear
    alone = replace(study, runs=study.runs[:1])
    ratios = identify_wheel(alone, identify(alone, law="linear"))
    assert ratios.per_mass
    mass = ratios.parameters.unsprung_mass_kg
    assert abs(mass.value - 105 / 1850) < 3 * mass.std
    assert dict(ratios.units)["unsprung_mass_kg"] == "1"
    assert any("no sprung mass" in warning for warning in ratios.warnings)
    assert ratios.stiffer_by_load.value is None


def test_text_and_figure(found):
    said = text(found)
    assert max(map(len, said.splitlines())) <= 80
    assert "unsprung mass M1" in said
    axes = plots.force_spectra(found)
    assert len(axes.ravel()) == 2


@pytest.mark.parametrize(
    ("ends", "name"), [((1e-6, 2e-6), "A"), ((20e-6, 40e-6), "A to B"), ((0.9, 9.0), "H"), ((2e-4, 3e-4), "C")]
)
def test_classes_of_roads(ends, name):
    assert classify_road(ends) == name


# ---- where an assumption fails ---------------------------------------------------------------------


def test_braking_that_is_not_stated_is_refused(identified):
    hidden = at_speed(identified.result.study, (9.25, 9.25))
    answer = identify_wheel(hidden, identified.result)
    assert "differs by more than chance allows" in answer.not_determined
    assert all(estimate.value is None for _, estimate in answer.parameters.items())
    assert "Not determined" in text(answer)
    with pytest.raises(InputError, match="no spectrum to draw"):
        plots.force_spectra(answer)


def test_forces_beside_the_strut_are_refused(braking, identified):
    (fit,) = store_fits(identified.result)
    answer = identify_wheel(braking, (replace(fit, over_noise=4.0),))
    assert "4 times the noise of the sensors" in answer.not_determined


# ---- bad input -------------------------------------------------------------------------------------


def test_a_run_without_speed_is_refused(identified):
    with pytest.raises(InputError, match=r"run 'heavy' has no speed, .* give speed_m_per_s"):
        identify_wheel(identified.result.study, identified.result)


def test_the_result_of_other_runs_is_refused(braking, identified):
    renamed = replace(braking, runs=tuple(replace(run, name=f"{run.name} again") for run in braking.runs))
    with pytest.raises(
        InputError, match=r"the result is of runs .*, and the study has run .* again': give the result of"
    ):
        identify_wheel(renamed, identified.result)


def test_runs_too_slow_are_refused(identified):
    slow = at_speed(identified.result.study, (0.3, 0.3))
    with pytest.raises(InputError, match=r"only 0 lines .* check the speed"):
        identify_wheel(slow, identified.result)


def test_a_body_and_horizontal_motion_are_refused(braking, identified):
    first = braking.runs[0].recording
    tail = Channel("tail", "m/s^2")
    third = replace(first, samples=first.samples[:, [0, 1, 1]], channels=(*first.channels[:2], tail))
    gears = (MeasuredInterface("main", "upper_z", "lower_z"),)
    body = Study("body", gears, (Run("one", third),), sensors=(BodySensor("tail", 0.0, 0.0),))
    with pytest.raises(InputError, match="are identified for one gear"):
        identify_wheel(body, identified.result)
    flat = replace(braking, interfaces=(replace(braking.interfaces[0], axis="horizontal"),))
    with pytest.raises(InputError, match="along which no road pushes a wheel"):
        identify_wheel(flat, identified.result)
    with pytest.raises(InputError, match="gives no number with an interval"):
        identify_wheel(braking, ())


@pytest.mark.parametrize(
    ("speed", "words"),
    [
        (-3.0, "speed_m_per_s is -3.0, give the speed in m/s"),
        (True, "speed_m_per_s is True"),
        (900.0, "at most 150"),
        ("sped", "names the channel 'sped', which is not in its log"),
        ("upper_z", "is in m/s\\^2: name a channel with a speed"),
    ],
)
def test_a_speed_that_is_none_is_refused(braking, speed, words):
    with pytest.raises(InputError, match=words):
        replace(braking, runs=(replace(braking.runs[0], speed_m_per_s=speed), braking.runs[1]))


# ---- files and the command -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folders(braking, identified, tmp_path_factory):
    """A study with a speed in its logs, and the result of its identification."""
    folder = tmp_path_factory.mktemp("wheel")
    (folder / "study").mkdir()
    write_study(braking, folder / "study" / "study.toml")
    (folder / "result").mkdir()
    (folder / "result" / "result.json").write_text(json.dumps(identified.result.to_dict()), encoding="utf-8")
    return folder


def test_the_speed_of_a_log_is_read_back(folders, braking):
    back = read_study(folders / "study" / "study.toml")
    assert [run.speed_m_per_s for run in back.runs] == ["speed", "speed"]
    speed = back.runs[0].recording.channel("speed")
    assert speed == pytest.approx(braking.runs[0].recording.channel("speed"), abs=1e-3)


def test_the_command(folders, tmp_path):
    done = opid("wheel", folders / "study", folders / "result", "--out", tmp_path / "out")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "The unsprung mass is" in " ".join(done.stdout.split())
    written = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert written["schema"] == "opid.wheel/1"
    assert written["parameters"]["tyre_stiffness_n_per_m"]["unit"] == "N/m"
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count('data-chart="') == 1


def test_the_command_says_why_there_is_no_answer(folders, tmp_path):
    file = folders / "study" / "study.toml"
    steady = folders / "study" / "steady.toml"
    steady.write_text(file.read_text(encoding="utf-8").replace('speed_m_per_s = "speed"', "speed_m_per_s = 9.0"))
    not_determined(opid("wheel", steady, folders / "result", "--out", tmp_path / "out"), "than chance allows")
    slow = folders / "study" / "slow.toml"
    slow.write_text(file.read_text(encoding="utf-8").replace('speed_m_per_s = "speed"', "speed_m_per_s = -9.0"))
    refused(opid("wheel", slow, folders / "result", "--out", tmp_path / "out2"), "speed_m_per_s is -9.0")
