"""From a released structure to the posterior of its law: results of `opid decay` and `opid resonance` as backbones."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cli_runs import opid
from made_resonance import MODE, curves_study, held_study, true_curves
from measured_data import measured
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.json_values import json_text, plain
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.modal.resonance.identification import identify_resonance
from opid.studies.study_file import read_study
from opid.updating.measured import LEAST_POINTS, read_result_backbones
from opid.updating.settings import UPDATING

FS, MASS, HZ, ZETA, START = 1000.0, 0.8, 25.0, 0.004, 2e-3
STIFFNESS = MASS * (2 * np.pi * HZ) ** 2
CUBIC = 0.15 * STIFFNESS / (0.75 * START**2)
"""N/m^3: at the start the spring is 15 % stiffer than at rest."""


def study_of(frequency_hz, mass, cubic, largest):
    """A study of one mode whose laws stiffen it alike at the largest amplitude; the cubic one with theta = 2."""
    laws = {"cubic": cubic / 2, "quadratic": cubic * largest, "quintic": cubic / largest**2}
    classes = "".join(f'[[classes]]\nlaw = "{law}"\nscale = {scale}\n' for law, scale in laws.items())
    return f"""
[structure]
frequency_hz = {frequency_hz}
modal_mass_kg = {mass}
sensors = ["tip"]
[structure.joints]
spring = "tip"
[[backbones]]
file = "decay/result.json"
mode = 1
controlled_sensor = "tip"
{classes}
[sampling]
samples = 1000
"""


STUDY = study_of(HZ, MASS, CUBIC, START)


def released(seed):
    """Half a second of rest, then the acceleration of m x'' + c x' + k x + k3 x^3 = 0 with 1 % noise, m/s^2."""

    def rate(_, state):
        x, v = state
        return v, -2 * ZETA * 2 * np.pi * HZ * v - (STIFFNESS * x + CUBIC * x**3) / MASS

    time = np.arange(round(8 * FS)) / FS
    found = solve_ivp(rate, (0, time[-1]), (START, 0.0), t_eval=time, method="DOP853", rtol=1e-9, atol=1e-13)
    a = np.concatenate([np.zeros(500), rate(0, found.y)[1]])
    return a + 0.01 * a[500:1500].std() * np.random.default_rng(seed).standard_normal(a.size)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the study, and the result of `opid decay` for its log in the folder decay."""
    folder = tmp_path_factory.mktemp("released")
    a = released(0)
    table = np.column_stack([np.arange(a.size) / FS, a])
    np.savetxt(folder / "log.csv", table, delimiter=",", header="time [s],tip [m/s^2]", comments="", fmt="%.9g")
    done = opid("decay", folder / "log.csv", "--channel", "tip", "--out", folder / "decay")
    assert done.exit_code == 0, done.output
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    return folder


def test_a_release_leads_to_the_law_of_its_spring(place, tmp_path):
    done = opid("update", place / "study.toml", "--out", tmp_path)
    assert (done.exit_code, done.stderr) == (0, "")
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    evidence = {each["name"]: each["log_evidence"] for each in result["classes"]}
    assert result["best_class"] == "cubic"
    assert evidence["cubic"] - max(evidence["quadratic"], evidence["quintic"]) > 10
    (cubic,) = result["classes"][0]["coefficients"].values()
    low, high = cubic["interval95"]
    assert low < CUBIC < high
    # 1 % of the amplitudes are 2 % of the coefficient.
    assert 0.07 * CUBIC < high - low < 0.09 * CUBIC
    assert (result["reduction"], result["linear"]) == (None, None)
    used = {each["name"] for each in result["provenance"]["files"]}
    assert used == {str(place / name) for name in ("study.toml", "decay/result.json")}


def test_a_decay_is_a_backbone(place):
    """Its amplitudes are those of displacement, and its frequencies those of the harmonic linearisation."""
    (curve,) = read_study(place / "study.toml").backbones
    assert (curve.name, curve.sensors, curve.mode) == ("decay", ("tip",), 1)
    assert LEAST_POINTS < curve.frequency_hz.size <= UPDATING.n_parts
    amplitude = curve.controlled_amplitude
    assert 0.8 * START < amplitude[-1] < START
    assert amplitude[0] < 0.1 * START
    expected = np.sqrt((STIFFNESS + 0.75 * CUBIC * amplitude**2) / MASS) / (2 * np.pi)
    np.testing.assert_allclose(curve.frequency_hz, expected, rtol=1e-3)
    assert np.ptp(curve.frequency_hz) > 0.05 * HZ


# ---- results made by hand ---------------------------------------------------------------------------


LACKING = object()
"""Marks a key that is left out."""


def made(folder, name="decay", **changes):
    """Write a result.json of `opid decay` with eight windows; return its path."""
    amplitude = np.geomspace(2e-3, 1e-4, 8)
    document = {
        "schema": "opid.decay/1", "name": "tip", "mode": None, "amplitude_unit": "m", "amplitude": amplitude.tolist(),
        "frequency_hz": (25 + 1e6 * amplitude**2).tolist(), "frequency_std_hz": [0.05] * 8, "repeats": [],
        "settings": {"channel": "tip"},
    } | changes  # fmt: skip
    path = folder / name / "result.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(
        json_text(plain({key: value for key, value in document.items() if value is not LACKING})), encoding="utf-8"
    )
    return path


def read(path, **changes):
    return read_result_backbones(path, **{"mode": 1, "controlled_sensor": "tip", "sensors": ("tip", "top")} | changes)


def test_windows_in_one_part_of_the_amplitudes_are_averaged_by_their_noise(tmp_path):
    """Of two windows of equal amplitude one is twice as noisy: the mean is a fifth of the way to it."""
    names = {"amplitude": [2e-3, 1e-3, 1e-3, 2e-4], "frequency_hz": [27.0, 26.0, 26.5, 25.0]}
    path = made(tmp_path, **names, frequency_std_hz=[0.026, 0.026, 0.052, 0.026])
    (curve,), error = read(path)
    np.testing.assert_allclose(curve.controlled_amplitude, [2e-4, 1e-3, 2e-3])
    np.testing.assert_allclose(curve.frequency_hz, [25.0, 26.1, 27.0])
    assert error == pytest.approx(0.026 / 27.0)
    # a window without a deviation does not count
    with pytest.raises(InputError, match="at least 3"):
        read(made(tmp_path, **names, frequency_std_hz=[0.026, 0.026, 0.052, None]))


def test_repeats_are_curves_of_their_own_and_their_noise_is_expected(place, tmp_path):
    single = json.loads(made(tmp_path).read_text(encoding="utf-8"))
    repeats = [single | {"name": name} for name in ("hit_1.csv", "hit_2.csv")]
    made(tmp_path, repeats=repeats)
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    study = read_study(tmp_path / "study.toml")
    assert [each.name for each in study.backbones] == ["decay, hit_1.csv", "decay, hit_2.csv"]
    # seven windows of eight stand alone in their part
    assert study.noise.point_noise == pytest.approx(0.05 / 25.1, rel=0.05)
    (tmp_path / "study.toml").write_text(f"{STUDY}[noise]\npoint_noise = 0.01\n", encoding="utf-8")
    assert read_study(tmp_path / "study.toml").noise.point_noise == 0.01
    assert read_study(place / "study.toml").noise.point_noise == 0.0005


def test_a_decay_in_modal_coordinates_becomes_that_of_the_sensor(tmp_path):
    modes = JointedModes([1e3, 2e4], [[0.1, -0.5], [0.2, 0.3]], [[0.1, -0.5]], ("tip", "top"), ("spring",))
    path = made(tmp_path, mode=2, amplitude_unit="m kg^1/2")
    (curve,), _ = read(path, mode=2, modes=modes)
    (raw,), _ = read(made(tmp_path, "raw"))
    np.testing.assert_allclose(curve.amplitude, 0.5 * raw.amplitude)
    with pytest.raises(InputError, match="in modal coordinates, and the structure is not given by its modes: follow"):
        read(path, mode=2)
    with pytest.raises(InputError, match="it is a decay of mode 2, and the backbone is of mode 1"):
        read(path, modes=modes)


@pytest.mark.parametrize(
    ("changes", "asked", "message"),
    [
        ({"schema": "opid.modal/1"}, {}, "has the schema 'opid.modal/1' where .*: give the result.json of"),
        ({"schema": LACKING}, {}, "has no schema"),
        ({"amplitude_unit": "rad"}, {}, "the decay of an angle"),
        ({"settings": {"channel": "top"}}, {}, "the decay was read from 'top': name this as the controlled sensor"),
        ({"amplitude": [1e-3] * 8}, {}, r"in 8 window\(s\), amplitudes from 0.001 to 0.001: a backbone needs 3"),
        ({"amplitude": np.linspace(1.9e-3, 1e-3, 8)}, {}, "amplitudes that fall to 1/2"),
        ({"frequency_hz": [None] * 8}, {}, r"in 0 window\(s\), amplitudes nothing"),
        ({"amplitude": [9.0, 5, 4, 3, 2, 1, 1, 1]}, {}, "reaches 9 m"),
        ({"frequency_hz": LACKING}, {}, r"is damaged \(KeyError: 'frequency_hz'\): write it again"),
        ({"amplitude": [1e-3, 1e-4]}, {}, "is damaged"),
        ({}, {"controlled_sensor": "tap"}, "'tap' is not one of the structure: did you mean"),
    ],
)  # fmt: skip
def test_results_that_are_no_backbone_are_refused(tmp_path, changes, asked, message):
    with pytest.raises(InputError, match=message):
        read(made(tmp_path, **changes), **asked)


def test_files_that_are_no_result_are_refused(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    with pytest.raises(InputError, match=r"cannot read .*decay/result.json: No such file or directory: check the name"):
        read_study(tmp_path / "study.toml")
    made(tmp_path).write_text("frequency_hz,tip\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"is no JSON \(line 1: Expecting value\): give the result.json"):
        read_study(tmp_path / "study.toml")
    made(tmp_path)
    (tmp_path / "study.toml").write_text(STUDY.replace("mode = 1", 'mode = 1\nunit = "mm"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"a result.json is in SI units: leave 'unit' out"):
        read_study(tmp_path / "study.toml")
    (tmp_path / "study.toml").write_text(STUDY.replace("mode = 1", 'mode = 1\ndrive = "tip"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"a result.json has no force that is read: leave 'drive' out"):
        read_study(tmp_path / "study.toml")


# ---- resonance tests --------------------------------------------------------------------------------


def test_a_resonance_test_is_a_backbone(tmp_path):
    """Amplitudes of a sensor that the mode moves by phi q, frequencies by harmonic linearisation."""
    study = held_study()
    result = identify_resonance(study)
    path = tmp_path / "result.json"
    path.write_text(json_text(result.to_dict()), encoding="utf-8")
    sensor = study.drive_point
    (curve,), error = read(path, mode=MODE, controlled_sensor=sensor, sensors=study.modes.sensors)
    shape = abs(study.modes.row(sensor)[MODE - 1])
    assert curve.controlled_amplitude[-1] == pytest.approx(shape * result.amplitude.max(), rel=0.05)
    np.testing.assert_allclose(curve.frequency_hz, true_curves(curve.controlled_amplitude / shape)[0], rtol=1e-3)
    assert 0 < error < 1e-3
    with pytest.raises(InputError, match="its test has no sensor 'tip'"):
        read(path)
    path.write_text(json_text(replace(result, states=(), appropriation=None, level_tests=(),
                                      level_start_s=np.empty(0), level_stop_s=np.empty(0)).to_dict()))  # fmt: skip
    with pytest.raises(InputError, match="its curves have no sensor"):
        read(path, mode=MODE, controlled_sensor=sensor, sensors=study.modes.sensors)


def test_response_curves_are_a_backbone_of_one_point_each(tmp_path):
    """Stepped sines at five levels: the resonances of the curves lie on the true backbone."""
    for seed in range(3):
        study = curves_study(seed, n_curves=5)
        result = identify_resonance(study)
        path = tmp_path / "result.json"
        path.write_text(json_text(result.to_dict()), encoding="utf-8")
        sensor = study.curves[0].sensor
        (curve,), error = read(path, mode=MODE, controlled_sensor=sensor, sensors=study.modes.sensors)
        assert curve.frequency_hz.size == 5
        shape = abs(study.modes.row(sensor)[MODE - 1])
        np.testing.assert_allclose(curve.frequency_hz, true_curves(curve.controlled_amplitude / shape)[0], rtol=2e-3)
        assert 0 < error < 2e-3
        off = curve.frequency_hz / true_curves(curve.controlled_amplitude / shape)[0] - 1
        stated = np.array([each["resonance"]["hz_std_at_motion"] for each in result.to_dict()["curves"]])
        assert np.abs(off * curve.frequency_hz / np.sort(stated)).max() < 3.5
    with pytest.raises(InputError, match="its curves have no sensor 'tip'"):
        read(path)
    document = json.loads(path.read_text(encoding="utf-8"))
    for each in document["curves"][:3]:
        each["resonance"] = None
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match="2 of its response curves have points near phase resonance"):
        read(path, mode=MODE, controlled_sensor=sensor, sensors=study.modes.sensors)


# ---- measured ---------------------------------------------------------------------------------------


def test_a_measured_beam_between_magnets_hardens_by_a_cubic_law(tmp_path):
    """The strain stands for the displacement, so that the coefficient is that of a modal coordinate in strain."""
    log = measured("magnet_beam/decay_f_42p05_ampl_2p0_0.lvm.gz")
    done = opid("decay", log, "--channel", "Strain_0", "--unit", "m", "--start", 12.3, "--out", tmp_path / "decay")
    assert done.exit_code == 0, done.output
    (tmp_path / "study.toml").write_text(study_of(36.9, 1.0, 5e11, 1.6e-4), encoding="utf-8")
    done = opid("update", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    result = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert result["best_class"] == "cubic"
    assert min(result["classes"][0]["log_evidence"] - each["log_evidence"] for each in result["classes"][1:]) > 5
    (curve,), (band,) = result["measured"], result["prediction"]
    assert max(curve["frequency_hz"]) > 1.08 * min(curve["frequency_hz"])
    assert band["coverage"] == 1.0
