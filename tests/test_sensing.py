"""Virtual sensors beside the truth of a simulated test, their bands where an assumption fails, and `opid sense`."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_runs import opid, refused

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.memory import force_along
from opid.signals.logs import read_log
from opid.signals.recording import Recording
from opid.studies.stored_fits import read_fits
from opid.studies.study_file import read_study
from opid.suspensions.answer.stored_fit import store_fits
from opid.suspensions.sensing.settings import SensingSettings
from opid.suspensions.sensing.virtual_sensors import sense
from opid.suspensions.study import Run
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_run

GEAR = LandingGear()
FEW = SensingSettings(n_draws=60, n_counted=5)
M1 = Estimate.normal(GEAR.unsprung_mass_kg, 1.0)


@pytest.fixture(scope="session")
def study(field_test):
    """The study of the field test."""
    return read_study(field_test / "study.toml")


@pytest.fixture(scope="session")
def fits(identified):
    """The fits of the field test."""
    return store_fits(identified.result)


@pytest.fixture(scope="session")
def result_folder(identified, tmp_path_factory):
    """A folder with the result of the field test."""
    folder = tmp_path_factory.mktemp("result")
    (folder / "result.json").write_text(json.dumps(identified.result.to_dict()), encoding="utf-8")
    return folder


def drive(seed=5, gear=GEAR, **settings):
    """Return a further run of a gear."""
    return taxi_run(gear, rng=np.random.default_rng(seed), duration_s=20.0, fs=256.0, **settings)


def as_run(run, **changed):
    """Return the record of a simulated run, with some of its channels changed."""
    columns = [changed.get(name, run.recording.channel(name)) for name in run.recording.names]
    return Run("further", Recording(np.stack(columns, axis=1), run.recording.fs, run.recording.channels))


def true_force(run):
    """Return the strut force on the body."""
    gear = run.airframe.gears[0]
    z, v = run.truth.channel("travel"), run.truth.channel("travel_velocity")
    linear = gear.suspension_stiffness_n_per_m * z + gear.suspension_damping_n_s_per_m * v
    return -linear - force_along(gear.law, z, v, run.recording.fs)


def held(sensor, truth, n_std=1.96):
    """Return the rms error over the rms of the truth, and the fraction of samples in the band."""
    error = sensor.value - truth[: sensor.value.size]
    return float(np.std(error) / np.std(truth)), float(np.mean(np.abs(error) <= n_std * sensor.std))


def test_forces_and_motion_along_a_further_log_are_those_of_the_gear(study, fits):
    run = drive()
    found = sense(study, fits, as_run(run), unsprung_mass_kg=M1, settings=FEW)
    force = true_force(run)
    weight = 9.80665 * (GEAR.sprung_mass_kg + GEAR.unsprung_mass_kg)
    tyre = force + weight + GEAR.unsprung_mass_kg * run.truth.channel("lower_z")
    for name, truth in (
        ("strut_force", force),
        ("strut_load", force + 9.80665 * GEAR.sprung_mass_kg),
        ("tyre_force", tyre),
        ("travel", run.truth.channel("travel")),
        ("travel_velocity", run.truth.channel("travel_velocity")),
        ("acceleration", run.truth.channel("upper_z")),
    ):
        error, inside = held(found.sensor(name), truth)
        assert error < 0.01, name
        assert inside > 0.9, name
    (rest,) = found.static
    assert rest.load_n.holds(9.80665 * GEAR.sprung_mass_kg)
    assert found.unmeasured_m_per_s2 == 0.0


def test_a_run_of_the_study_tells_the_vector_nothing_twice(study, identified, fits):
    found = sense(study, identified.result, "light", settings=FEW)
    again = sense(study, fits, "light", settings=FEW)
    assert found.over_noise == again.over_noise
    np.testing.assert_array_equal(found.sensor("strut_force").value, again.sensor("strut_force").value)
    assert found.static[0].travel_m.value > 0.001  # the lighter gear rests higher


def test_the_band_holds_what_an_unmeasured_force_does_to_the_strut(study, fits):
    run = drive(pushed_fraction=0.05)
    found = sense(study, fits, as_run(run), settings=FEW)
    assert held(found.sensor("strut_force"), true_force(run))[1] > 0.9
    assert found.over_noise[0] > 5.0
    assert found.unmeasured_m_per_s2 > 0.01
    assert any("unmeasured forces" in each for each in found.warnings)


@pytest.mark.parametrize(
    "change",
    [
        {"suspension_stiffness_n_per_m": 1.05 * GEAR.suspension_stiffness_n_per_m},
        {"suspension_damping_n_s_per_m": 1.3 * GEAR.suspension_damping_n_s_per_m},
        {"sprung_mass_kg": 1.05 * GEAR.sprung_mass_kg},
        {"sprung_mass_kg": 1.1 * GEAR.sprung_mass_kg},
        {"law": GEAR.law.scaled(2.0)},
    ],
)
def test_the_log_of_another_strut_or_loading_has_a_wide_band(study, fits, change):
    run = drive(gear=replace(GEAR, **change))
    found = sense(study, fits, as_run(run), settings=FEW)
    assert found.warnings
    assert held(found.sensor("strut_force"), true_force(run))[1] > 0.9


def test_another_strut_altogether_is_refused_with_the_factor(study, fits):
    other = replace(GEAR, suspension_stiffness_n_per_m=3 * GEAR.suspension_stiffness_n_per_m)
    with pytest.raises(NotDeterminedError, match=r"leaves \d+.* times the noise .* another strut or loading"):
        sense(study, fits, as_run(drive(gear=other)), settings=FEW)


def test_a_clipped_log_has_a_band_that_holds_and_a_warning(study, fits):
    run = drive()
    above = run.recording.channel("upper_z")
    limit = np.quantile(np.abs(above), 0.99)
    found = sense(study, fits, as_run(run, upper_z=np.clip(above, -limit, limit)), settings=FEW)
    assert held(found.sensor("strut_force"), true_force(run))[1] > 0.9
    assert any("clip" in each for each in found.warnings)


def test_a_log_without_motion_is_refused(study, fits):
    run = drive()
    rng = np.random.default_rng(0)
    still = {name: 0.005 * rng.standard_normal(run.recording.n_samples) for name in ("lower_z", "upper_z")}
    with pytest.raises(InputError, match=r"no more than noise.*give a log with motion"):
        sense(study, fits, as_run(run, **still), settings=FEW)


def test_a_result_without_mass_gives_forces_per_unit_of_mass(study, fits):
    run = drive()
    (fit,) = fits
    found = sense(study, [replace(fit, has_mass=False)], as_run(run), unsprung_mass_kg=M1, settings=FEW)
    assert found.per_mass
    assert found.sensor("strut_force").unit == "m/s^2"
    assert "tyre_force" not in found.to_recording().names
    assert held(found.sensor("strut_force"), true_force(run) / GEAR.sprung_mass_kg)[0] < 0.01
    assert any("no mass" in each for each in found.warnings)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"interfaces": ("nose",)}, "result is of interface 'nose', and the study has interface 'gear'"),
        ({"kind": "pair", "interfaces": ("gear",)}, "result is of the mean of gear"),
        ({"names": ("mass",)}, "names no 'inverse_mass' among its values"),
    ],
)
def test_the_result_of_another_study_is_refused(study, fits, change, words):
    with pytest.raises(InputError, match=re.escape(words)):
        sense(study, [replace(fits[0], **change)], settings=FEW)


def test_what_cannot_be_given_is_refused_in_a_sentence(study, fits):
    for arguments, words in (
        ({"run": "hevy"}, "no run 'hevy'"),
        ({"places": {"tail": (1.0, 0.0)}}, "gears alone, whose mass has no extent"),
        ({"unsprung_mass_kg": {"nose": M1}}, "has an interface 'nose'"),
        ({"unsprung_mass_kg": Estimate.normal(-5.0)}, "give positive numbers"),
    ):
        with pytest.raises(InputError, match=words):
            sense(study, fits, settings=FEW, **arguments)
    with pytest.raises(InputError, match="gives no number with an interval"):
        sense(study, [], settings=FEW)


def test_cycles_are_those_of_the_strut_force(study, fits):
    found = sense(study, fits, as_run(drive()), settings=FEW)
    (counted,) = found.rainflow
    assert counted.edges_n[-1] > np.ptp(found.sensor("strut_force").value)
    assert counted.cycles[-1] == 0.5  # the largest range is a half cycle of the residue, or of the whole record
    assert counted.cycles.sum() > 100
    assert (counted.std >= 0.0).all()


def test_the_fits_of_a_result_file_are_those_of_the_result(result_folder, fits):
    assert read_fits(result_folder) == fits


def test_sense_writes_a_log_a_page_and_the_cycles(field_test, result_folder, tmp_path):
    log = tmp_path / "forces.h5"
    done = opid(
        "sense", field_test / "study.toml", result_folder, field_test / "light.csv", "--like", "light",
        "--unsprung-mass", "105+-5 kg", "--out", tmp_path / "out", "--log", log,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    written = read_log(log)
    assert {"strut_force", "strut_force_std", "tyre_force", "travel"} <= set(written.names)
    assert written.unit("strut_force") == "N"
    content = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert content["schema"] == "opid.sensing/1"
    assert content["rainflow"][0]["cycles"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "--like light --unsprung-mass 105+-5" in page
    assert "Cycles of the strut force" in page


def test_sense_refuses_bad_input_in_one_sentence(field_test, result_folder, tmp_path):
    study, light = field_test / "study.toml", field_test / "light.csv"
    lacking = tmp_path / "lacking.csv"
    lacking.write_text(light.read_text().replace("upper_z", "roof_z"))
    older = tmp_path / "older"
    older.mkdir()
    content = json.loads((result_folder / "result.json").read_text(encoding="utf-8"))
    del content["fits"]
    (older / "result.json").write_text(json.dumps(content), encoding="utf-8")
    for arguments, words in (
        ((study, result_folder, lacking), ("upper_z",)),
        ((study, older), ("older version", "identify the study again")),
        ((study, tmp_path / "missing"), ("cannot read",)),
        ((study, result_folder, light, "--run", "heavy"), ("give one of them",)),
        ((study, result_folder, "--like", "heavy"), ("no LOG is given",)),
        ((study, result_folder, light, "--like", "hevy"), ("no run 'hevy'", "heavy")),
        ((study, result_folder, "--unsprung-mass", "many"), ("no mass",)),
        ((study, result_folder, "--place", "tail"), ("NAME=X,Y",)),
    ):
        refused(opid("sense", *arguments, "--out", tmp_path / "out"), *words)


def test_the_log_that_is_written_replaces_no_file_by_chance_and_no_input_at_all(field_test, result_folder, tmp_path):
    study = field_test / "study.toml"
    given = ("sense", study, result_folder, "--no-figures", "--quiet", "--out", tmp_path / "out")
    there = tmp_path / "there.csv"
    there.write_text("mine", encoding="utf-8")
    inputs = [Path(run.recording.files[-1].name) for run in read_study(study).runs]
    before = [each.read_bytes() for each in inputs]
    refused(opid(*given, "--log", there), "--log", "is there already")
    refused(opid(*given, "--log", inputs[0]), "--log", "is there already")
    refused(opid(*given, "--log", inputs[0], "--force"), "--log", "is a file that was read")
    link = tmp_path / "link.csv"
    link.symlink_to(inputs[0])
    refused(opid(*given, "--log", link, "--force"), "--log", "is a file that was read")
    for name in ("x.npz", "", "..", f"{'n' * 300}.csv", tmp_path / "there.csv" / "x.csv", tmp_path):
        refused(opid(*given, "--log", name), "--log")
    assert [each.read_bytes() for each in inputs] == before
    assert there.read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "out").exists()
    refused(opid(*given, "--unsprung-mass", "100", "--unsprung-mass", "90"), "twice for the same interfaces")
    refused(opid(*given, "--unsprung-mass", "-5"), "'-5' is no mass")
