"""`opid demo` and `opid simulate taxi` as a user drives them."""

import json

import numpy as np
import pytest
from cli_runs import opid, parsed, refused

from opid import cli
from opid.mechanics.laws.law import law
from opid.mechanics.truth import GearTruth
from opid.signals.logs import read_log
from opid.virtual.taxi_tests import taxiing
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.road import ROAD_CLASSES
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test
from opid.virtual.truth_file import read_truth


@pytest.mark.usefixtures("few_figures")
def test_demo_shows_truth_beside_estimate(tmp_path, monkeypatch):
    short = {"duration_s": 20.0, "fs": 256.0}
    monkeypatch.setattr(taxiing, "taxi_test", lambda gear, **settings: taxi_test(gear, **settings, **short))
    done = opid("demo", "--out", tmp_path / "demo", "--seed", 2)
    assert done.exit_code == 0
    row = next(line for line in done.output.splitlines() if line.startswith("sprung mass"))
    assert row.split()[-1] == "yes"
    assert "1850" in row
    assert str(tmp_path / "demo" / "report" / "report.html") in done.output
    assert (tmp_path / "demo" / "study.toml").exists()
    assert (tmp_path / "demo" / "report" / "result.json").exists()


def test_the_defaults_of_simulate_are_those_of_the_library():
    options = cli.virtual_tests.taxi.make_context("taxi", ["out"]).params
    gear, sensor = LandingGear(), Sensor()
    assert options["sprung_mass"] == gear.sprung_mass_kg
    assert options["stiffness"] == gear.suspension_stiffness_n_per_m
    assert options["ground_stiffness"] == gear.ground_stiffness_n_per_m
    assert options["noise"] == sensor.noise_m_per_s2
    assert options["corner"] == sensor.corner_hz
    defaults = taxi_run.__kwdefaults__
    assert (options["speed_start"], options["speed_stop"]) == defaults["speed_m_per_s"]
    assert options["duration"] == defaults["duration_s"]
    assert options["fs"] == defaults["fs"]
    assert tuple(ROAD_CLASSES) == cli.virtual_tests.ROAD_CLASSES
    assert options["road_class"] == defaults["road_class"]
    assert options["mass_removed"] == taxi_test.__kwdefaults__["mass_removed_kg"]
    assert cli.virtual_tests._make_gear(options) == gear


def test_simulate_does_what_its_options_say(tmp_path):
    options = "--duration 3 --fs 256 --law arctan_velocity+cubic_stiffness --friction 900 --damping-ratio 0.3"
    sensors = "--gain-error 1 --corner 0.3 --corner-mismatch 10 --cross-axis 3 --bits 12 --range 80"
    done = opid("simulate", "taxi", tmp_path / "a", *options.split(), *sensors.split(), "--mass-removed", 300)
    assert done.exit_code == 0
    truth = read_truth(tmp_path / "a" / "truth.json", GearTruth)
    assert truth.law.parameters["arctan_velocity"]["amplitude_n"] == 900
    assert truth.law.parameters["cubic_stiffness"]["stiffness_n_per_m3"] == 3e9
    assert truth.parameters.suspension_damping_n_s_per_m == pytest.approx(2 * 0.3 * (3.9e5 * 1850) ** 0.5)
    assert truth.mass_change_kg == -300
    assert truth.settings["bits"] == 12
    run = read_log(tmp_path / "a" / "heavy.csv")
    assert (run.fs, run.duration_s) == (256, 3)
    steps = run.samples / (2 * 80 / 2**12)
    assert np.allclose(steps, np.round(steps), atol=1e-6)


def test_one_seed_gives_one_test_and_another_seed_another(tmp_path):
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        opid("simulate", "taxi", tmp_path / name, "--duration", 2, "--fs", 256, "--seed", seed)
        texts.append((tmp_path / name / "heavy.csv").read_text())
    assert texts[0] == texts[1] != texts[2]


def test_the_next_command_is_one_that_a_shell_takes(tmp_path):
    done = opid("simulate", "taxi", tmp_path / "my runs", "--duration", 2, "--fs", 256)
    (line,) = (line.removeprefix("Next: ") for line in done.stdout.splitlines() if line.startswith("Next: "))
    given = parsed(line).params
    assert (given["paths"], given["truth"]) == (
        (tmp_path / "my runs" / "study.toml",),
        tmp_path / "my runs" / "truth.json",
    )
    assert given["truth"].is_file()


def test_what_was_made_is_shown_as_asked(tmp_path):
    done = opid("simulate", "taxi", tmp_path / "a", "--duration", 2, "--fs", 256, "--json", "--verbose")
    assert done.exit_code == 0
    made = json.loads(done.stdout)
    study, truth = tmp_path / "a" / "study.toml", tmp_path / "a" / "truth.json"
    assert (made["study"], made["truth"]) == (str(study), str(truth))
    assert made["made"] == [f"1850 kg: {tmp_path / 'a' / 'heavy.csv'}", f"1630 kg: {tmp_path / 'a' / 'light.csv'}"]
    assert (parsed(made["next"]).params["paths"], parsed(made["next"]).params["truth"]) == ((study,), truth)
    assert [line.split(" s  ")[1] for line in done.stderr.splitlines() if "opened" not in line][:2] == [
        "two taxi runs",
        "the files",
    ]
    refused(opid("simulate", "taxi", tmp_path / "b", "--quiet", "--verbose"), "give one of them")


def test_no_friction_is_no_term(tmp_path):
    opid("simulate", "taxi", tmp_path, "--duration", 2, "--friction", 0)
    assert read_truth(tmp_path / "truth.json", GearTruth).law == law("linear")


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ("--law cubc_stiffness", "did you mean 'cubic_stiffness'"),
        ("--law cubic_stiffness --friction 400", "--friction needs one friction term"),
        ("--duration -3", "duration_s is -3"),
        ("--mass-removed 5000", "mass_removed_kg is 5000"),
        ("--sprung-mass 0", "sprung_mass_kg"),
        ("--road-class Z", "'Z' is not one of 'A', 'B'"),
        ("--damping 1 --damping-ratio 1", "give one of them"),
        ("--bits 1", "bits is 1"),
        ("--noise -1", "negative"),
        ("--fs many", "'many' is not a valid float"),
        ("--seed -1", "--seed"),
    ],
)
def test_simulate_refuses(options, word, tmp_path):
    refused(opid("simulate", "taxi", tmp_path / "out", *options.split()), word)
    assert not (tmp_path / "out").exists()
