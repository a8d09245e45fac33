"""The study file of a test bench: what it says of a log, what comes of it, and what is wrong with one."""

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
from cli_runs import opid as command, refused

import opid
from opid.errors import InputError, NotDeterminedError
from opid.suspensions.bench.record import BenchStudy

N, FS = 1500, 200.0
KINDS = "candidates = ['arctan_velocity', 'cubic_stiffness']\n"


def damper():
    """Time, travel (mm), rate (mm/s) and force (kN) of 1e5 N/m, 2e3 N s/m and 300 N of friction."""
    t, rng = np.arange(N) / FS, np.random.default_rng(0)
    z = sum(2e-3 * np.sin(2 * np.pi * f * t + phase) for f, phase in ((0.7, 1), (1.9, 4), (3.1, 2)))
    v = np.gradient(z, 1 / FS)
    force = 1e5 * z + 2e3 * v + 300 * 2 / np.pi * np.arctan(v / 0.01) + 5 * rng.standard_normal(N)
    return {"time [s]": t, "stroke [mm]": 1e3 * z, "speed [mm/s]": 1e3 * v, "load [kN]": 1e-3 * force}


def written(path, columns):
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    return path


def study_file(place, bench="force = 'load'\ntravel = 'stroke'\n", more="", log="log = 'bench.csv'\n"):
    path = place / "study.toml"
    path.write_text(f"title = 'a damper'\n[bench]\n{log}{KINDS}{bench}{more}", encoding="utf-8")
    return path


@pytest.fixture
def bench(tmp_path):
    return written(tmp_path / "bench.csv", damper())


def test_a_study_gives_what_the_options_give(bench, tmp_path):
    path = study_file(tmp_path, "force = 'load'\ntravel = 'stroke'\nvelocity = 'speed'\n")
    done = command("law", path, "--out", tmp_path / "result")
    assert (done.exit_code, done.stderr) == (0, "")
    told = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    study = opid.read_study(path)
    assert isinstance(study, BenchStudy)
    found = opid.suspensions.law_of_bench(study)
    assert {name for name in told if told[name] != found.to_dict().get(name)} == {"provenance"}
    log = opid.read_log(bench)
    same = opid.suspensions.bench_from_recording(log, force="load", travel="stroke", velocity="speed")
    np.testing.assert_array_equal(study.bench.force, same.force)
    np.testing.assert_array_equal(study.bench.velocity, same.velocity)
    assert found.title == told["title"] == "a damper"
    assert found.candidates == ("arctan_velocity", "cubic_stiffness")
    assert found.law.name == "arctan_velocity"
    assert found.law_estimates["arctan_velocity"]["amplitude_n"].holds(300)
    page = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert f"opid law {shlex.quote(str(path))}" in page


def test_an_argument_goes_before_what_the_study_says(bench, tmp_path):
    study = opid.read_study(study_file(tmp_path, more="most_terms = 0\n", bench="force = 'load'\ntravel = 'stroke'\n"))
    assert opid.suspensions.law_of_bench(study).law.name == "linear"
    found = opid.suspensions.law_of_bench(study, title="another", candidates=("arctan_velocity",), most_terms=1)
    assert (found.title, found.law.name, found.candidates) == ("another", "arctan_velocity", ("arctan_velocity",))


def test_channels_have_units_scales_and_files_of_their_own(bench, tmp_path):
    """Raw counts of a travel that is turned round, and the force in a file whose clock began 0.5 s later."""
    columns = damper()
    counts = {"time [s]": columns["time [s]"], "c1": -columns["stroke [mm]"] * 1000 + 40}
    written(tmp_path / "motion.csv", counts)
    late = {"time [s]": columns["time [s]"] - 0.5, "load [kN]": columns["load [kN]"]}
    written(tmp_path / "cell.csv", late)
    channels = (
        "[channels]\nload = {file = 'cell.csv', shift_s = 0.5}\n"
        "travel = {channel = 'c1', unit = 'um', offset = -40, sign = -1}\n"
    )
    path = study_file(tmp_path, "force = 'load'\ntravel = 'travel'\n", channels, log="log = 'motion.csv'\n")
    study = opid.read_study(path)
    np.testing.assert_allclose(study.bench.travel, columns["stroke [mm]"] / 1e3, atol=1e-12)
    np.testing.assert_allclose(study.bench.force, 1e3 * columns["load [kN]"], atol=1e-6)
    (doubt,) = study.bench.warnings
    assert "its channels come from 2 recorders" in doubt
    assert "lag_tolerance_s" not in doubt


def test_a_stretch_and_samples_that_do_not_count(bench, tmp_path):
    held = (damper()["time [s]"] % 1) > 0.2
    written(bench, damper() | {"held [1]": held})
    text = "force = 'load'\ntravel = 'stroke'\ncounted = 'held'\nstart_s = 1.0\nstop_s = 6.0\n"
    found = opid.read_study(study_file(tmp_path, text)).bench
    assert found.force.size == 5 * FS
    np.testing.assert_array_equal(found.counted, held[200:1200])


def test_a_mass_and_its_acceleration_are_the_force(bench, tmp_path):
    columns = damper()
    force = 1e3 * columns.pop("load [kN]")
    written(bench, columns | {"body [g]": -force / 250 / 9.80665})
    study = opid.read_study(study_file(tmp_path, "force = 'body'\ntravel = 'stroke'\nmass_kg = 250\n"))
    np.testing.assert_allclose(study.bench.force, force, rtol=1e-9)


def test_a_slow_test_has_no_time(tmp_path):
    phase = np.linspace(0, 16 * np.pi, 800)
    z = 1e-3 * phase / 10 * np.sin(phase)
    written(tmp_path / "bench.csv", {"stroke [mm]": 1e3 * z, "load [kN]": 200 * z})
    refused(command("law", study_file(tmp_path)), "there is no time column", "quasi_static = true in a study")
    path = study_file(tmp_path, more="quasi_static = true\n")
    study = opid.read_study(path)
    assert study.bench.is_quasi_static
    again = tmp_path / "again"
    again.mkdir()
    opid.write_study(study, again / "study.toml")
    np.testing.assert_array_equal(opid.read_study(again / "study.toml").bench.travel, study.bench.travel)


@pytest.mark.parametrize(
    ("bench_keys", "more", "words"),
    [
        ("force = 'load'\n", "", "[bench] lacks 'travel', give the name of a channel in quotes"),
        ("force = 3\ntravel = 'stroke'\n", "", "'force' in [bench] is 3, give the name of a channel in quotes"),
        ("force = 'lod'\ntravel = 'stroke'\n", "", "no channel 'lod'"),
        ("force = 'stroke'\ntravel = 'load'\n", "", "are force and travel swapped?"),
        ("force = 'load'\ntravel = 'load'\n", "", "'load' is given for both force and travel: each needs its own"),
        ("force = 'load'\ntravel = 'stroke'\nmas_kg = 3\n", "", "unknown key 'mas_kg' (did you mean 'mass_kg'?)"),
        ("force = 'load'\ntravel = 'stroke'\nmass_kg = 3\n", "", "it is a force already: leave the mass out"),
        (
            "force = 'load'\ntravel = 'stroke'\nmass_kg = 0\n",
            "",
            "give the mass of the body, a number of more than 0 kg",
        ),
        ("force = 'speed'\ntravel = 'stroke'\nmass_kg = 3\n", "", "an acceleration is in m/s^2"),
        (
            "force = 'load'\ntravel = 'stroke'\nmoving_mass = 3\n",
            "",
            "'moving_mass' in [bench] is 3, give true or false",
        ),
        (
            "force = 'load'\ntravel = 'stroke'\nquasi_static = true\nmoving_mass = true\nvelocity = 'speed'\n",
            "",
            "quasi_static beside velocity and moving_mass: a test without a time scale has none; leave it out",
        ),
        (
            "force = 'load'\ntravel = 'stroke'\nquasi_static = true\nstart_s = 1\n",
            "",
            "start_s beside quasi_static, where time means nothing: leave one of them out",
        ),
        ("force = 'load'\ntravel = 'stroke'\nstart_s = 3\nstop_s = 2\n", "", "give a stop after the start"),
        (
            "force = 'load'\ntravel = 'stroke'\nstart_s = 99\n",
            "",
            "holds no samples: choose start and stop inside the log",
        ),
        ("force = 'load'\ntravel = 'stroke'\ncounted = 'hold'\n", "", "there is no channel 'hold'"),
        ("force = 'load'\ntravel = 'stroke'\nmost_terms = -1\n", "", "most_terms is -1: give 0 or more"),
        ("force = 'load'\ntravel = 'stroke'\n", "[channels.load]\nscale = 0\n", "[channels.load]: scale is 0"),
        (
            "force = 'load'\ntravel = 'stroke'\n",
            "[channels.lod]\nscale = 2\n",
            "[bench] takes no channel 'lod', which stands in [channels] (did you mean 'load'?)",
        ),
        ("force = 'load'\ntravel = 'stroke'\n", "[channels.load]\nunit = 'm'\n", "'load' is in m, a force is in N"),
        ("force = 'load'\ntravel = 'stroke'\n", "[channels.load]\nunit = 'lb'\n", "lb is a mass, lbf a force"),
        ("force = 'load'\ntravel = 'stroke'\n", "[channels.load]\nscale = 1e30\n", "check its unit"),
        ("force = 'load'\ntravel = 'stroke'\n", "[log]\nfs_hz = -3\n", "fs_hz is -3: give a rate in Hz"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(bench, tmp_path, bench_keys, more, words):
    path = study_file(tmp_path, bench_keys, more)
    said = refused(command("law", path, "--out", tmp_path / "out"), words)
    assert "needs none" not in said
    assert said.startswith(f"Error: {path}: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("kinds", "words"),
    [
        ("candidates = ['cubic_stifness']\n", "did you mean 'cubic_stiffness'?"),
        ("candidates = [3]\n", "'candidates' in [bench] holds 3, give a list of kinds of law in quotes"),
        ("candidates = 'cubic_stiffness'\n", "give a list of kinds of law in quotes"),
    ],
)
def test_kinds_that_are_none_are_named(bench, tmp_path, kinds, words):
    path = study_file(tmp_path)
    path.write_text(path.read_text(encoding="utf-8").replace(KINDS, kinds), encoding="utf-8")
    refused(command("law", path), words)


def test_options_beside_a_study_are_left_out(bench, tmp_path):
    path = study_file(tmp_path)
    words = f"{path} is a study, which states this itself: leave out --force-channel and --mass and --quasi-static"
    refused(command("law", path, "--force-channel", "load", "--mass", 0, "--quasi-static"), words)
    refused(
        command("law", bench, "--force-channel", "load"),
        "--force-channel NAME --travel-channel NAME",
        "or give a study",
    )
    refused(command("law", tmp_path / "none.toml"), "there is no study file")


def test_a_log_that_is_missing_or_still_is_told(tmp_path):
    path = study_file(tmp_path)
    refused(command("law", path), f"{path}: there is no file", "bench.csv")
    written(tmp_path / "bench.csv", damper() | {"stroke [mm]": np.full(N, 3.0)})
    with pytest.raises(NotDeterminedError, match="'stroke' never moves"):
        opid.read_study(path)
    refused(command("law", path), "'stroke' never moves", status=1)
    written(tmp_path / "bench.csv", {name: values[:50] for name, values in damper().items()})
    refused(command("law", path), "50 samples", "at least 200")


def test_a_study_made_in_python_is_checked(bench, tmp_path):
    study = opid.read_study(study_file(tmp_path))
    for wrong, words in (
        ({"force": "lod"}, "no column 'lod' for the force"),
        ({"counted": "lod"}, "lod"),
        ({"candidates": ("cubic_stifness",)}, "did you mean 'cubic_stiffness'"),
        ({"quasi_static": True, "mass_kg": 3.0}, "quasi_static beside mass_kg"),
    ):
        with pytest.raises(InputError, match=words):
            replace(study, **wrong)


# ---- a strut of oil and gas -------------------------------------------------------------------------

AREA_M2, PRESSURE_PA, LENGTH_M = 0.006, 3e6, 0.08


def strut(seed=1):
    """Time, travel and force of gas at 3 MPa above 480 cm^3 and of oil: 12 N of noise, strokes of half of the gas."""
    t, rng = np.arange(6000) / FS, np.random.default_rng(seed)
    z = sum(0.014 * np.sin(2 * np.pi * f * t + phase) for f, phase in ((0.7, 1), (1.3, 4), (2.1, 2)))
    v = np.gradient(z, 1 / FS)
    gas = (PRESSURE_PA + 101325) * (1 + z / LENGTH_M) ** -1.25 - 101325
    force = -AREA_M2 * gas + 2e3 * v + 4e4 * v * np.abs(v) + 12 * rng.standard_normal(t.size)
    return {"time [s]": t, "stroke [mm]": 1e3 * z, "speed [m/s]": v, "load [N]": force}


def strut_file(place, area):
    written(place / "bench.csv", strut())
    named = "force = 'load'\ntravel = 'stroke'\nvelocity = 'speed'\n"
    path = place / "study.toml"
    kinds = "candidates = ['gas_column', 'quadratic_damping', 'cubic_stiffness']\n"
    path.write_text(f"[bench]\nlog = 'bench.csv'\n{kinds}{named}{area}", encoding="utf-8")
    return path


def test_gas_of_a_strut_on_the_bench_is_told_in_pressure_and_volume(tmp_path):
    found = opid.suspensions.law_of_bench(opid.read_study(strut_file(tmp_path, f"piston_area_m2 = {AREA_M2}\n")))
    assert found.law.name == "quadratic_damping+gas_column"
    volume = AREA_M2 * LENGTH_M
    truth = ((PRESSURE_PA + 101325) * volume, PRESSURE_PA, volume)
    told_of_gas = (found.gas.content_n_m, found.gas.pressure_pa, found.gas.volume_m3)
    for estimate, true in zip(told_of_gas, truth, strict=True):
        assert estimate.holds(true)
        assert np.ptp(estimate.interval95) < 0.2 * true
    assert not any("piston_area" in warning for warning in found.warnings)
    assert "gas: gauge pressure" in opid.text(found)
    told = found.to_dict()
    assert told["gas"]["pressure_pa"]["value"] == found.gas.pressure_pa.value
    assert told["settings"]["piston_area_m2"] == AREA_M2


def test_gas_of_a_strut_without_its_area_is_told_as_pressure_times_volume(tmp_path):
    found = opid.suspensions.law_of_bench(opid.read_study(strut_file(tmp_path, "")))
    assert found.gas.content_n_m.holds((PRESSURE_PA + 101325) * AREA_M2 * LENGTH_M)
    assert found.gas.pressure_pa.value is None
    assert "gas: gauge pressure" not in opid.text(found)


def test_a_law_without_gas_tells_none(bench, tmp_path):
    study = replace(opid.read_study(study_file(tmp_path)), piston_area_m2=AREA_M2)
    found = opid.suspensions.law_of_bench(study)
    assert found.gas is None
    assert found.to_dict()["gas"] is None


@pytest.mark.parametrize("area_m2", [6e-5, 0.6])
def test_an_area_that_contradicts_the_static_pressure_is_doubted_on_the_bench(tmp_path, area_m2):
    found = opid.suspensions.law_of_bench(opid.read_study(strut_file(tmp_path, f"piston_area_m2 = {area_m2}\n")))
    (warning,) = (each for each in found.warnings if "contradicts the static pressure" in each)
    assert f"{area_m2:g}" in warning
    assert "MPa" in warning


def test_the_command_takes_the_area_and_refuses_one_that_no_piston_has(tmp_path):
    log = written(tmp_path / "bench.csv", strut())
    named = ("--force-channel", "load", "--travel-channel", "stroke", "--velocity-channel", "speed")
    done = command("law", log, *named, "--piston-area", AREA_M2, "--out", tmp_path / "result")
    assert done.exit_code == 0
    assert "gas: volume" in done.stdout
    page = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert "--piston-area 0.006" in page
    for area in ("60", "0"):
        done = command("law", log, *named, "--piston-area", area)
        refused(done, f"the piston_area_m2 is {float(area)!r}, give the area that the gas pushes on")
    study = strut_file(tmp_path, f"piston_area_m2 = {AREA_M2}\n")
    refused(command("law", study, "--piston-area", AREA_M2), "leave out --piston-area")
