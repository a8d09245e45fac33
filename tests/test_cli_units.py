"""Units that a log does not state are told by options of every command that takes a log without a study."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from cli_runs import CHANNELS, opid, refused

from opid.signals.logs import read_log

FS = 200.0


def as_pandas_writes(path, columns):
    """Write columns as `to_csv` of a data frame does: an index without a name first."""
    table = np.stack(list(columns.values()), axis=1)
    rows = [",".join(map(repr, (index, *row))) for index, row in enumerate(table.tolist())]
    path.write_text("\n".join([f",{','.join(columns)}", *rows]) + "\n", encoding="utf-8")
    return path


def spring(n=800):
    """Travel in mm and force in kN of 1e5 N/m and 2e3 N s/m."""
    t = np.arange(n) / FS
    omega = 2 * np.pi * np.array([[0.7], [1.9], [3.1]])
    z, v = (2e-3 * np.sin(omega * t)).sum(axis=0), (2e-3 * omega * np.cos(omega * t)).sum(axis=0)
    force = 1e5 * z + 2e3 * v + 2 * np.random.default_rng(0).standard_normal(n)
    return {"time": t, "stroke": 1e3 * z, "load": 1e-3 * force}


@pytest.fixture
def commands(field_test, tmp_path):
    """By the name of each command: its words, the options that tell the units, and a number that they decide."""
    runs = [read_log(field_test / f"{name}.csv") for name in ("heavy", "light")]
    logs = []
    for name, run in zip(("heavy", "light"), runs, strict=True):
        in_g = {each.name: samples / 9.80665 for each, samples in zip(run.channels, run.samples.T, strict=True)}
        logs.append(as_pandas_writes(tmp_path / f"{name}.csv", {"time": np.arange(len(run.samples)) / run.fs} | in_g))
    bench = as_pandas_writes(tmp_path / "bench.csv", spring())
    t = np.arange(2000) / FS
    ringing = {"time": t, "az": np.exp(-t) * np.sin(2 * np.pi * 20 * t)}
    g, columns = ("--unit", "g"), ("--force-channel", "load", "--travel-channel", "stroke")
    made = {
        "inspect": (logs[:1], g, lambda found: found["logs"][0]["channels"][-1]["unit"], "m/s^2"),
        "decay": (
            (as_pandas_writes(tmp_path / "hit.csv", ringing), "--channel", "az"),
            g,
            lambda found: found["frequency_low_hz"]["value"],
            pytest.approx(20, rel=1e-3),
        ),
        "identify": (
            (*logs, *CHANNELS, "--mass-change", -220, "--law", "arctan_velocity", "--no-figures"),
            g,
            lambda found: found["parameters"]["sprung_mass_kg"]["value"],
            pytest.approx(1850, rel=0.02),
        ),
        "law": (
            (bench, *columns),
            ("--unit", "load=kN", "--unit", "stroke=mm"),
            lambda found: found["parameters"]["stiffness_n_per_m"]["value"],
            pytest.approx(1e5, rel=0.01),
        ),
    }
    return {name: SimpleNamespace(words=w, units=u, number=n, truth=t) for name, (w, u, n, t) in made.items()}


@pytest.mark.parametrize("name", ["inspect", "decay", "identify", "law"])
def test_units_that_a_log_does_not_state_are_told_by_options(commands, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = commands[name]
    refused(opid(name, *given.words, *given.units), "'time' has no unit", "--time-unit")
    wrong = opid(name, *given.words, *given.units, "--time-unit", "kg")
    assert refused(wrong, "'kg' is no unit of time").startswith("Error: Invalid value for '--time-unit'")
    done = opid(name, *given.words, *given.units, "--time-unit", "s", "--json")
    assert (done.exit_code, done.stderr) == (0, "")
    assert given.number(json.loads(done.stdout)) == given.truth


@pytest.mark.parametrize("name", ["decay", "identify", "law"])
def test_a_channel_without_a_unit_is_refused_with_the_option(commands, name):
    refused(opid(name, *commands[name].words, "--time-unit", "s"), "states no unit", "--unit")


def test_the_page_repeats_the_units(commands, tmp_path):
    for name, out in (("identify", tmp_path / "gear"), ("law", tmp_path / "bench")):
        given = commands[name]
        done = opid(name, *given.words, *given.units, "--time-unit", "s", "--no-figures", "--out", out)
        assert done.exit_code == 0, done.output
        page = (out / "report.html").read_text(encoding="utf-8")
        for told in (" ".join(given.units), "--time-unit s"):
            assert told in page
    assert "settings=opid.signals.LogSettings(" in (tmp_path / "gear" / "report.html").read_text(encoding="utf-8")


def test_units_of_a_bench_are_those_of_its_columns(commands):
    words = (*commands["law"].words, "--time-unit", "s")
    refused(opid("law", *words, "--unit", "laod=kN"), "'laod'", "--unit", "did you mean 'load'?")
    refused(opid("law", *words, "--unit", "kN"), "'kN' is no CHANNEL=UNIT", "load=kN")
    refused(opid("law", *words, "--unit", "load=quid"), "the unit 'quid' is not known")


def test_a_study_says_the_units_itself(field_test, tmp_path):
    study = field_test / "study.toml"
    for option in (("--unit", "g"), ("--time-unit", "s")):
        refused(opid("identify", study, *option, "--out", tmp_path / "out"), "leave out", option[0])
        refused(opid("inspect", field_test / "heavy.csv", "--study", study, *option), "leave", option[0])
    bench = tmp_path / "bench.toml"
    refused(opid("law", bench, "--unit", "load=kN", "--time-unit", "s"), "leave out --unit and --time-unit")
