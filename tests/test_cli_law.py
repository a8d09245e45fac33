"""`opid law` as a user drives it: what it writes, what it says, and with which status it ends."""

import json

import numpy as np
import pytest
from cli_runs import not_determined, opid, refused

from opid.mechanics.laws.law import LAWS, default_law
from opid.mechanics.memory import recorded_motion
from opid.suspensions.bench import law as bench_law

N, FS = 1500, 200.0


@pytest.fixture(autouse=True)
def short_library(monkeypatch):
    """Search few kinds: which law is found is tested elsewhere."""
    few = {name: bench_law.LAWS[name] for name in ("arctan_velocity", "cubic_stiffness")}
    monkeypatch.setattr(bench_law, "LAWS", few)


def damper():
    """Travel in mm, velocity in in/s and force in kN of 1e5 N/m, 2e3 N s/m and 300 N of friction."""
    rng = np.random.default_rng(0)
    t = np.arange(N) / FS
    z = sum(2e-3 * np.sin(2 * np.pi * f * t + phase) for f, phase in zip((0.7, 1.9, 3.1), rng.uniform(0, 6, 3)))  # noqa: B905
    v = np.gradient(z, 1 / FS)
    force = 1e5 * z + 2e3 * v + 300 * 2 / np.pi * np.arctan(v / 0.01) + 5 * rng.standard_normal(N)
    return {"time [s]": t, "stroke [mm]": 1e3 * z, "speed [in/s]": v / 0.0254, "load [kN]": 1e-3 * force}


def written(path, columns):
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")
    return path


@pytest.fixture
def bench(tmp_path):
    return written(tmp_path / "bench.csv", damper())


NAMED = ("--force-channel", "load", "--travel-channel", "stroke")
OF_BODY = ("--force-channel", "body", "--travel-channel", "stroke")


def test_a_law_is_found_and_reported(bench, tmp_path):
    done = opid("law", bench, *NAMED, "--velocity-channel", "speed", "--out", tmp_path / "result")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "Law: arctan_velocity" in done.stdout
    assert "no memory is seen" in done.stdout.lower()
    assert max(len(line) for line in done.stdout.splitlines() if "Report" not in line) <= 80
    names = sorted(path.name for path in (tmp_path / "result").iterdir())
    assert names == [
        "report.html",
        "result.json",
    ]
    result = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    assert result["schema"] == "opid.law/1"
    assert result["law"]["name"] == "arctan_velocity"
    low, high = result["law"]["parameters"]["arctan_velocity"]["amplitude_n"]["interval95"]
    assert low < 300 < high
    assert result["parameters"]["stiffness_n_per_m"]["value"] == pytest.approx(1e5, rel=0.01)
    assert result["parameters"]["damping_n_s_per_m"]["value"] == pytest.approx(2e3, rel=0.05)
    assert 0.99 < result["r2_left_out"] <= result["r2"] < 1
    assert {"law", "r2", "r2_left_out", "bic", "kept", "chosen"} == set(result["ladder"][0])
    assert result["memory"]["seen"] is False
    page = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert "--force-channel load --travel-channel stroke --velocity-channel speed" in page
    assert page.count('data-chart="') == 4


def test_without_a_velocity_it_is_differentiated_and_nothing_is_written(bench, tmp_path):
    done = opid("law", bench, *NAMED)
    assert done.exit_code == 0
    assert "'stroke' differentiated up to" in done.stdout.replace("\n", " ")
    assert [path.name for path in tmp_path.iterdir()] == ["bench.csv"]


def test_moving_parts_have_their_mass(tmp_path):
    columns = damper()
    speed = np.gradient(columns["stroke [mm]"] / 1e3, 1 / FS)
    columns["load [kN]"] = columns["load [kN]"] + 1e-3 * 400 * np.gradient(speed, 1 / FS)
    path = written(tmp_path / "heavy.csv", columns)
    done = opid("law", path, *NAMED, "--moving-mass", "--out", tmp_path / "result")
    assert done.exit_code == 0, done.output
    assert "F = F0 + m z'' + K z" in done.stdout
    result = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    assert result["parameters"]["moving_mass_kg"]["value"] == pytest.approx(400, rel=0.1)
    assert result["settings"]["moving_mass"] is True
    page = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert "--moving-mass" in page


def carried(unit="g"):
    """The damper holds a body of 250 kg, whose acceleration is recorded in place of the force."""
    columns = damper()
    force = 1e3 * columns.pop("load [kN]")
    return columns | {f"body [{unit}]": -force / 250 / 9.80665 + 1.0}


def test_a_body_that_nothing_else_holds_tells_the_force(tmp_path):
    path = written(tmp_path / "carried.csv", carried())
    done = opid("law", path, *OF_BODY, "--mass", 250, "--out", tmp_path / "result")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "The force is that of 250 kg with the acceleration 'body'" in " ".join(done.stdout.split())
    result = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    assert result["settings"]["mass_kg"] == 250
    assert result["parameters"]["stiffness_n_per_m"]["value"] == pytest.approx(1e5, rel=0.01)
    # gravity is no spring
    assert result["parameters"]["offset_n"]["value"] == pytest.approx(-250 * 9.80665, rel=0.01)
    page = (tmp_path / "result" / "report.html").read_text("utf-8")
    assert "--force-channel body --travel-channel stroke --mass 250" in page


def test_a_mass_belongs_to_an_acceleration(bench, tmp_path):
    path = written(tmp_path / "carried.csv", carried())
    refused(opid("law", path, *OF_BODY), "in m/s^2", "--mass")
    refused(opid("law", bench, *NAMED, "--mass", 250), "a force already", "leave the mass out")
    for wrong, words in ((0, "more than 0 kg"), (-3, "more than 0 kg"), ("nan", "'--mass'"), ("inf", "'--mass'")):
        refused(opid("law", path, *OF_BODY, "--mass", wrong), words)
    refused(opid("law", path, *OF_BODY, "--mass", "heavy"), "'heavy' is no number: give kg")
    refused(opid("law", path, *OF_BODY, "--mass", 250, "--moving-mass"), "leave one of them out")


@pytest.fixture
def slow_test(tmp_path, monkeypatch):
    """A spring and a friction that yields, in cycles of growing size, without time."""
    few = {name: LAWS[name] for name in ("dahl_friction", "arctan_velocity", "cubic_stiffness")}
    monkeypatch.setattr(bench_law, "LAWS", few)
    phase = np.linspace(0, 16 * np.pi, 800)
    z = 1e-3 * phase / 10 * np.sin(phase)
    force = 2e5 * z + recorded_motion(z, np.gradient(z), 1.0).force(default_law("dahl_friction"))
    force += 5 * np.random.default_rng(0).standard_normal(z.size)
    return written(tmp_path / "slow.csv", {"stroke [mm]": 1e3 * z, "load [kN]": 1e-3 * force})


def test_a_slow_test_needs_no_time(slow_test, tmp_path):
    done = opid("law", slow_test, *NAMED, "--quasi-static", "--out", tmp_path / "result")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "F = F0 + K z + f(z)" in done.stdout
    assert "damping C" not in done.stdout
    result = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    assert result["law"]["name"] == "dahl_friction"
    amplitude, scale = result["law"]["parameters"]["dahl_friction"].values()
    np.testing.assert_allclose([amplitude["value"], scale["value"]], [400, 5e-4], rtol=0.1)
    assert result["parameters"]["stiffness_n_per_m"]["value"] == pytest.approx(2e5, rel=0.02)
    assert result["parameters"]["damping_n_s_per_m"]["value"] is None
    assert result["settings"]["candidates"] == ["dahl_friction", "cubic_stiffness"]
    assert "--quasi-static" in (tmp_path / "result" / "report.html").read_text(encoding="utf-8")


def test_a_test_without_time_is_told_how_to_do_without(slow_test):
    refused(opid("law", slow_test, *NAMED), "there is no time column", "--quasi-static")
    said = refused(opid("law", slow_test, *NAMED, "--quasi-static", "--moving-mass", "--velocity-channel", "load"))
    assert "quasi_static beside velocity and moving_mass: a test without a time scale has none" in said
    assert said.count("bench.toml") <= 1


def test_noise_ends_with_status_1_and_what_there_is(tmp_path):
    columns = damper() | {"load [kN]": np.random.default_rng(2).standard_normal(N)}
    path = written(tmp_path / "noise.csv", columns)
    done = opid("law", path, *NAMED, "--out", tmp_path / "result")
    not_determined(done, "no law of travel and velocity")
    result = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    assert result["not_determined"]


def test_a_still_specimen_ends_with_status_1(tmp_path):
    path = written(tmp_path / "still.csv", damper() | {"stroke [mm]": np.full(N, 3.0)})
    refused(opid("law", path, *NAMED), "'stroke' never moves", status=1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            ("--force-channel", "lod", *NAMED[2:]),
            ("there is no channel 'lod'", "did you mean 'load'"),
        ),
        (("--force-channel", "stroke", "--travel-channel", "load"), ("are force and travel swapped",)),
        ((*NAMED, "--velocity-channel", "load"), ("given for both force and velocity",)),
        (("--force-channel", "load"), ()),
    ],
)
def test_wrong_columns_end_with_status_2(bench, tmp_path, options, words):
    done = opid("law", bench, *options, "--out", tmp_path / "result")
    refused(done, *words) if words else None
    assert done.exit_code == 2
    assert not (tmp_path / "result").exists()


def test_bad_records_end_with_status_2(tmp_path):
    columns = damper()
    pounds = {name.replace("kN", "lb"): values for name, values in columns.items()}
    refused(opid("law", written(tmp_path / "pounds.csv", pounds), *NAMED), "lb is a mass, lbf a force")
    strange = {name.replace("kN", "parsec"): values for name, values in columns.items()}
    refused(opid("law", written(tmp_path / "strange.csv", strange), *NAMED), "parsec")
    short = {name: values[:50] for name, values in columns.items()}
    refused(opid("law", written(tmp_path / "short.csv", short), *NAMED), "50 samples", "at least 200")
    for factor, words in ((1e300, "which nothing measures: correct its unit"), (1e30, "reaches")):
        huge = columns | {"load [kN]": factor * columns["load [kN]"]}
        refused(opid("law", written(tmp_path / "huge.csv", huge), *NAMED), words)
    columns["load [kN]"][7] = np.nan
    said = refused(opid("law", written(tmp_path / "gap.csv", columns), *NAMED), "line 9", "load", "mend the log")
    assert "more row" not in said
    refused(opid("law", tmp_path / "missing.csv", *NAMED), "there is no file")


def test_a_place_that_cannot_be_written_to_is_said_before_the_work(bench, monkeypatch):
    monkeypatch.setattr(bench_law, "law_of_bench", None)
    refused(opid("law", bench, *NAMED, "--out", bench), "is no directory")
