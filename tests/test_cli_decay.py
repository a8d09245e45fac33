"""`opid decay` as a user drives it: what it writes, what it says, and with which status it ends."""

import json

import numpy as np
import pytest
from cli_runs import opid, refused
from made_modal import FS as RATE, LAW, SENSORS, SOFT, small_modes
from scipy.integrate import solve_ivp

from opid.modal.linear.modes_file import write_modes
from opid.modal.model import NonlinearModalModel, simulate
from opid.signals.units import STANDARD_GRAVITY

FS, FREQUENCY, ZETA = 2048.0, 60.0, 0.004
OMEGA = 2 * np.pi * FREQUENCY
K0, C0, K3, C2 = OMEGA**2, 2 * ZETA * OMEGA, -5e10, 8.0
ORDERS = ("--stiffness-order", 3, "--damping-order", 2)


def rate(_, state):
    q, v = state
    return v, -(K0 * q + C0 * v + K3 * q**3 + C2 * v * abs(v))


def written(path, columns):
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Rest, then the free decay of a mode from 0.7 mm, as several sensors see it with 0.5 % noise."""
    time = np.arange(round(4 * FS)) / FS
    found = solve_ivp(rate, (0, time[-1]), (7e-4, 0.0), t_eval=time, method="DOP853", rtol=1e-9, atol=1e-13)
    q, v = np.hstack([np.zeros((2, 1000)), found.y])
    rng = np.random.default_rng(0)
    noisy = [x + 0.005 * x.std() * rng.standard_normal(x.size) for x in (q, v, rate(0, (q, v))[1])]
    columns = {
        "time [s]": np.arange(q.size) / FS,
        "az [g]": noisy[2] / STANDARD_GRAVITY,
        "vz [mm/s]": 1e3 * noisy[1],
        "z [mm]": 1e3 * noisy[0],
        "raw": noisy[2] / STANDARD_GRAVITY,
        "bridge [V]": noisy[2],
    }
    return written(tmp_path_factory.mktemp("decay") / "hit.csv", columns)


def holds(estimate, truth):
    """Whether a value is as near to the truth as its standard deviation says, and that is near."""
    return abs(estimate["value"] - truth) < 4 * estimate["std"] < 0.2 * abs(truth)


def test_the_law_is_found_and_reported(log, tmp_path):
    out = tmp_path / "result"
    done = opid("decay", log, "--channel", "az", *ORDERS, "--out", out)
    assert (done.exit_code, done.stderr) == (0, "")
    for words in ("Free decay: 'az' in hit.csv", "largest", "law, at zero", "per unit mass", "k3"):
        assert words in done.stdout
    assert max(map(len, done.stdout.splitlines()[:-1])) <= 80
    assert f"Report: {out / 'report.html'}" in done.stdout
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert (result["schema"], result["amplitude_unit"]) == ("opid.decay/1", "m")
    assert [each["name"] for each in result["provenance"]["files"]] == [str(log)]
    assert holds(result["k"]["3"], K3)
    assert holds(result["c"]["2"], C2)
    assert holds(result["frequency_low_hz"], FREQUENCY)
    assert holds(result["damping_low"], ZETA)
    assert result["units"]["k3"] == "1/(s^2 m^2)"
    lengths = {len(result[name]) for name in ("amplitude", "frequency_hz", "frequency_std_hz", "damping_ratio")}
    assert lengths == {len(result["damping_std"])}
    assert result["amplitude"] == sorted(result["amplitude"], reverse=True)
    # harmonic linearisation in closed form
    expected = np.sqrt(K0 + 0.75 * K3 * result["amplitude"][0] ** 2) / (2 * np.pi)
    assert abs(result["frequency_hz"][0] - expected) < 0.05
    assert result["settings"]["channel"] == "az"
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count('data-chart="') == 1
    assert f"opid decay {log} --channel az --stiffness-order 3 --damping-order 2" in page


@pytest.mark.parametrize(("channel", "more"), [("vz", ()), ("z", ()), ("raw", ("--unit", "g"))])
def test_velocity_displacement_and_a_unit_that_is_told_give_the_same(log, tmp_path, channel, more):
    done = opid("decay", log, "--channel", channel, "--near", 60, *more, *ORDERS, "--out", tmp_path)
    assert done.exit_code == 0
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert holds(result["k"]["3"], K3)
    assert holds(result["c"]["2"], C2)


def test_a_stretch_may_be_given_and_nothing_is_written_without_out(log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = opid("decay", log, "--channel", "az", "--start", 0.8, "--stop", 2.5)
    assert done.exit_code == 0
    assert "From 0.7998 to 2.4" in done.stdout
    assert "Report" not in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_what_grows_ends_with_status_1(tmp_path):
    time = np.arange(4096) / 1024.0
    growing = np.exp(1.2 * time) * np.sin(2 * np.pi * 40 * time)
    path = written(tmp_path / "flutter.csv", {"time [s]": time, "az [m/s^2]": growing})
    refused(opid("decay", path, "--channel", "az", "--out", tmp_path / "out"), "decay", status=1)
    assert not (tmp_path / "out").exists()


def test_messages_speak_of_the_options(log, tmp_path):
    refused(opid("decay", log, "--channel", "az", "--start", 3, "--stop", 1), "--start is 3", "--stop 1")
    refused(opid("decay", log, "--channel", "az", "--near", 900), "--near or another stretch", status=1)
    short = opid("decay", log, "--channel", "az", "--start", 2, "--stop", 2.1)
    refused(short, "name another mode with --near", status=1)


def test_the_standard_deviation_stands_in_the_head_of_its_columns(log):
    done = opid("decay", log, "--channel", "az", *ORDERS)
    (head,) = (line for line in done.stdout.splitlines() if "std. dev." in line and "frequency" in line)
    assert head.split("  ")[-3:] == ["std. dev.", "damping [%]", "std. dev."]


def test_bad_input_ends_with_status_2(log, tmp_path):
    refused(opid("decay", log, "--channel", "ay"), "there is no channel 'ay'")
    refused(opid("decay", log, "--channel", "raw"), "'raw'", "states no unit", "--unit g")
    refused(opid("decay", log, "--channel", "bridge"), "'bridge'", "is in V", "--unit g")
    refused(opid("decay", log, "--channel", "az", "--unit", "furlong"), "furlong")
    refused(opid("decay", log, "--channel", "az", "--near", -5), "-5")
    refused(opid("decay", log, "--channel", "az", "--memory", "iwan"), "--memory is 'iwan'", "iwan_friction")
    refused(opid("decay", log, "--channel", "az", "--start", 3, "--stop", 1), "3")
    refused(opid("decay", tmp_path / "none.csv", "--channel", "az"), "none.csv")
    refused(opid("decay", log, "--channel", "az", "--out", log), "is no directory")
    refused(opid("decay", log, log, "--channel", "az"), "hit.csv is given twice", "give each log once")
    assert opid("decay", log).exit_code == 2


def test_repeats_are_pooled(log, tmp_path):
    """Three hammer blows on the same mode, each with noise of its own."""
    table, lines = np.loadtxt(log, delimiter=",", skiprows=1), log.read_text().splitlines()[0].split(",")
    paths = []
    for number in range(3):
        noise = np.random.default_rng([3, number]).standard_normal(len(table))
        noisy = table.copy()
        noisy[:, 1] += 0.005 * table[:, 1].std() * noise
        paths.append(written(tmp_path / f"hit_{number}.csv", dict(zip(lines, noisy.T, strict=True))))
    out = tmp_path / "result"
    done = opid("decay", *paths, "--channel", "az", *ORDERS, "--out", out)
    assert done.exit_code == 0, done.output
    found = json.loads((out / "result.json").read_text())
    assert len(found["repeats"]) == 3
    assert abs(found["frequency_low_hz"]["value"] - FREQUENCY) < 4 * found["frequency_low_hz"]["std"]
    assert "hit_0.csv" in done.stdout


@pytest.mark.parametrize(
    ("column", "unit", "factor", "per"),
    [("other [mrad]", "rad", 1.0, "per unit of inertia"), ("other [ustrain]", "strain", 1e-3, "per unit mass")],
)
def test_an_angle_or_a_strain_is_as_good_as_a_length(log, tmp_path, column, unit, factor, per):
    """The same numbers in mm and in mrad or microstrain give the same law, in units of their own."""
    turned = tmp_path / "hit.csv"
    turned.write_text(log.read_text().replace("z [mm]", column, 1))
    found = []
    for path, channel in ((log, "z"), (turned, "other")):
        out = tmp_path / channel
        done = opid("decay", path, "--channel", channel, *ORDERS, "--out", out)
        assert done.exit_code == 0, done.output
        found.append(json.loads((out / "result.json").read_text()))
    one, other = found
    assert (one["amplitude_unit"], other["amplitude_unit"]) == ("m", unit)
    assert other["frequency_low_hz"]["value"] == pytest.approx(one["frequency_low_hz"]["value"], rel=1e-9)
    assert factor**2 * other["k"]["3"]["value"] == pytest.approx(one["k"]["3"]["value"], rel=1e-6)
    assert (one["units"]["k3"], other["units"]["k3"]) == ("1/(s^2 m^2)", f"1/(s^2 {unit}^2)")
    assert per in done.stdout


@pytest.fixture(scope="module")
def rings(tmp_path_factory):
    """Two logs in g, in which two modes ring together, and the study of modal tests that names their sensors."""
    folder = tmp_path_factory.mktemp("rings")
    modes, model = small_modes(), NonlinearModalModel(small_modes(), {SOFT: LAW})
    write_modes(modes, folder / "modes.csv")
    for number, displacement in enumerate(([0, 3e-4, 2.5e-4, 1e-4], [0, 2e-4, 2e-4, 3e-5])):
        rng = np.random.default_rng(number)
        motion = simulate(model, np.zeros(round(8 * RATE)), fs=RATE, drive_point="case_x", displacement=displacement)
        noisy = motion.samples + 0.003 * motion.samples.std(axis=0) * rng.standard_normal(motion.samples.shape)
        columns = dict(zip(("time [s]", *SENSORS), (motion.time_s, *noisy.T / STANDARD_GRAVITY), strict=True))
        written(folder / f"ring_{number}.csv", columns)
    channels = "".join(f'[channels.{name}]\nunit = "g"\n' for name in SENSORS)
    test = '[[tests]]\nlog = "lost.csv"\nforce = "force"\ndrive_point = "case_x"\n'
    (folder / "study.toml").write_text(f'[modes]\nfile = "modes.csv"\n{channels}{test}', encoding="utf-8")
    return folder


def test_a_study_filters_the_mode_in_several_logs(rings, tmp_path):
    logs = [rings / f"ring_{number}.csv" for number in range(2)]
    chosen = ("--study", rings / "study.toml", "--mode", SOFT, "--stiffness-order", 3, "--damping-order", 2)
    done = opid("decay", *logs, *chosen, "--out", tmp_path / "result")
    assert (done.exit_code, done.stderr) == (0, "")
    assert f"Free decay: 'mode {SOFT}' in 2 records" in done.stdout
    found = json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))
    assert holds(found["k"]["3"], -1.5e11)
    assert abs(found["frequency_low_hz"]["value"] - 60.0) < 4 * found["frequency_low_hz"]["std"] < 0.05
    assert (found["settings"]["mode"], found["mode"]) == (SOFT, SOFT)
    assert f"--study {rings / 'study.toml'} --mode {SOFT}" in " ".join(
        (tmp_path / "result" / "report.html").read_text(encoding="utf-8").split()
    )


def test_the_mode_of_a_study_is_the_one_that_moves_most(rings):
    done = opid("decay", rings / "ring_1.csv", "--study", rings / "study.toml")
    assert (done.exit_code, done.stderr) == (0, "")
    assert "Free decay: 'mode 3' in ring_1.csv" in done.stdout


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "give --channel NAME (one sensor), or --study"),
        (("--channel", "case_x", "--study", "study.toml"), "(the shapes of its modes), not both"),
        (("--study", "study.toml", "--near", 60), "leave --near out (--mode names a mode)"),
        (("--channel", "case_x", "--mode", 3), "--mode needs the shapes of a study"),
        (("--study", "study.toml", "--mode", 9), "there is no mode 9: give a number from 1 to 4"),
        (("--study", "study.toml", "--mode", 1), "rigid-body mode"),
        (("--study", "bench.toml"), "give one of modal tests"),
    ],
)
def test_options_that_do_not_go_together_are_refused(rings, options, words):
    (rings / "bench.toml").write_text('[bench]\nlog = "a.csv"\nforce = "f"\ntravel = "z"\n', encoding="utf-8")
    options = [rings / each if str(each).endswith(".toml") else each for each in options]
    done = opid("decay", rings / "ring_0.csv", *options)
    assert done.exit_code != 0
    assert words in " ".join(done.stderr.split())


def test_noise_is_no_pair_of_modes_that_beat(tmp_path):
    rng = np.random.default_rng(0)
    path = written(tmp_path / "noise.csv", {"time [s]": np.arange(10000) / 500.0, "az [g]": rng.normal(size=10000)})
    done = opid("decay", path, "--channel", "az", "--start", 1)
    refused(done, status=1)
    assert "noise" in done.stderr
    assert "modes at" not in done.stderr
