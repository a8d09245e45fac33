"""`opid simulate backbones` and `opid update` as a user drives them."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from cli_runs import not_determined, opid, refused
from made_updating import small_truth, small_updating
from test_updating_study_file import STUDY, curve_of, small_chain

from opid import cli
from opid.errors import NotDeterminedError
from opid.mechanics.truth import UpdatingTruth
from opid.studies.study_file import read_study
from opid.updating import identification
from opid.updating.measured import MeasuredBackbone, write_backbone
from opid.updating.structure.matrices_file import write_structure
from opid.virtual.truth_file import read_truth, tabulate_truth


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A study of a small chain of masses; not to be changed."""
    place = tmp_path_factory.mktemp("chain")
    write_structure(place / "structure.npz", small_chain())
    write_backbone(curve_of(), place / "first.csv")
    path = place / "study.toml"
    # a single curve has no scatter, which the paper's form asks for
    text = STUDY.replace("[structure]", "[structure]\ninternal_modes = 0") + "[noise]\ncov = { 1 = 0.01 }\n"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def quick(monkeypatch):
    """Nothing is sampled: what the command makes of study and result is tested. Returns the studies it was given."""
    given = []

    def update_study(study, *, progress=None):
        given.append(study)
        progress("class 1")
        return small_updating(linear=None)

    monkeypatch.setattr(identification, "update_study", update_study)
    monkeypatch.setattr("opid.report.updating.list_figures", lambda *_: ())  # tested by themselves
    return given


def test_options_go_before_the_study_and_the_report_is_named_after_it(study, quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("opid.report.write_report", lambda result, target, *_, **__: target / "report.html")
    done = opid("update", study, "--form", "paper", "--sampler", "transitional", "--samples", 2000, "--seed", 5)
    assert done.exit_code == 0, done.output
    given = quick[0]
    assert (given.form, given.sampler, given.n_samples, given.seed) == ("paper", "transitional", 2000, 5)
    assert given.title == "A chain"
    assert f"Report: {study.parent.name}_result" in done.stdout.replace("\n", "")
    done = opid("update", study)
    assert (quick[1].form, quick[1].sampler, quick[1].n_samples) == ("recommended", "adaptive", 1500)


def test_text_and_report_show_truth_beside_estimate(study, quick, tmp_path):
    truth = tmp_path / "truth.json"
    truth.write_text(json.dumps(tabulate_truth(small_truth())), encoding="utf-8")
    refused(opid("update", study, "--out", tmp_path / "out", "--truth", truth), "was written beside this study")
    (law, *_), joints = small_truth().laws.values(), read_study(study).structure.joints
    of_chain = replace(small_truth(), laws=dict.fromkeys(joints, law))
    truth.write_text(json.dumps(tabulate_truth(of_chain)), encoding="utf-8")
    done = opid("update", study, "--out", tmp_path / "out", "--truth", truth)
    assert (done.exit_code, done.stderr) == (0, "")
    assert "Best: class 2, cubic, ahead of class 4" in done.stdout
    assert "inside" in done.stdout
    document = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
    assert document["schema"] == "opid.updating/1"
    assert "were simulated" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    again = opid("update", study, "--out", tmp_path / "out", "--json", "--force")
    assert json.loads(again.stdout) == json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))


def test_what_is_not_determined_ends_with_status_1(study, monkeypatch, tmp_path):
    found = small_updating(linear=None, not_determined="no class explains the backbones", best_class="", prediction=())
    monkeypatch.setattr(identification, "update_study", lambda study, *, progress=None: found)
    monkeypatch.setattr("opid.report.write_report", lambda result, target, *_, **__: target / "report.html")
    done = opid("update", study, "--out", tmp_path / "out")
    not_determined(done, "no class explains the backbones")


def test_bad_usage_ends_with_status_2_before_the_work(study, quick, tmp_path):
    refused(opid("update", tmp_path / "none.toml", "--out", tmp_path / "out"), "there is no study file")
    refused(opid("update", study, "--out", study), "is no directory")
    refused(opid("update", study, "--samples", 10, "--out", tmp_path / "out"), "--samples")
    refused(opid("update", study, "--form", "other", "--out", tmp_path / "out"), "--form")
    refused(opid("update", study, "--truth", study, "--out", tmp_path / "out"), "not the truth of simulated backbones")
    assert quick == []
    assert not (tmp_path / "out").exists()


def test_without_nutpie_its_sampler_is_refused_before_any_work(study, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "nutpie", None)
    monkeypatch.setattr(identification, "update_linear", None)
    refused(opid("update", study, "--sampler", "nuts", "--out", tmp_path / "out"), "pip install '.[nuts]'")
    assert not (tmp_path / "out").exists()


def test_chains_go_beside_the_report_where_arviz_is_there(study, quick, tmp_path, monkeypatch):
    monkeypatch.setattr("opid.errors.find_spec", lambda name: None)
    refused(opid("update", study, "--chains", "--out", tmp_path / "out"), "pip install '.[bayes]'")
    assert quick == []
    monkeypatch.setattr("opid.errors.find_spec", lambda name: "there")
    monkeypatch.setattr("opid.updating.chain_files.to_inference_data", lambda chain, names: Written(names))
    monkeypatch.setattr("opid.updating.chain_files._write_summary", lambda data_of, path: None)
    done = opid("update", study, "--chains", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert f"Chains: {tmp_path / 'out' / 'chains_class_3.nc'}" in done.stdout
    assert (tmp_path / "out" / "chains_class_3.nc").read_text(encoding="utf-8") == "theta_1 theta_2"


class Written:
    """In the place of ArviZ's object: what is written is the names of the parameters."""

    def __init__(self, names):
        self.names = names

    def to_netcdf(self, path):
        path.write_text(" ".join(self.names), encoding="utf-8")


def test_the_options_are_those_of_the_library():
    from opid.updating.likelihood.backbones import FORMS
    from opid.updating.study import FEWEST_SAMPLES, SAMPLERS

    options = {option.name: option for option in cli.main.commands["update"].params}
    assert set(options["form"].type.choices) == set(FORMS)
    assert tuple(options["sampler"].type.choices) == SAMPLERS
    assert options["n_samples"].type.min == FEWEST_SAMPLES


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """A directory that `opid simulate backbones` wrote; not to be changed."""
    place = tmp_path_factory.mktemp("backbones") / "wing"
    done = opid("simulate", "backbones", place, "--seed", 3, "--curves", 4, 3, "--points", 8, "--matrices", "mtx")
    assert (done.exit_code, done.stderr) == (0, "")
    assert f"Next: opid update {place / 'study.toml'} --truth {place / 'truth.json'}" in done.stdout
    return place


def test_a_simulation_writes_a_study_and_its_truth(simulated):
    study = read_study(simulated / "study.toml")
    assert study.structure.sensors == tuple(map(str, range(1, 15)))
    assert set(study.structure.joints.values()) == {("9", "10"), ("9", "11"), ("12", "13"), ("12", "14")}
    assert [each.name for each in study.classes] == [f"class {k}" for k in range(1, 6)]
    assert set(study.parameters) == {"E_aluminium", "E_steel"}
    for mode, n, lowest_hz, highest_m in ((7, 4, 14.65, 4e-3), (8, 3, 17.71, 2.5e-3)):
        curves = [curve for curve in study.backbones if curve.mode == mode]
        assert [curve.frequency_hz.size for curve in curves] == [8] * n
        # the linear structure is off by 0.4 %, a curve by 0.15 %
        assert [curve.frequency_hz[0] for curve in curves] == pytest.approx([lowest_hz] * n, rel=0.02)
        assert max(curve.controlled_amplitude[-1] for curve in curves) == pytest.approx(highest_m, rel=0.05)
    truth = read_truth(simulated / "truth.json", UpdatingTruth)
    assert truth.linear == {"E_aluminium": 0.88, "E_steel": 0.31}
    assert len(truth.laws) == 4
    for own in truth.laws.values():
        assert own.parameters == {"cubic_stiffness": {"stiffness_n_per_m3": pytest.approx(1.58 * 6.8e7)}}
    assert truth.settings["curves"] == [4, 3]


def test_the_same_seed_gives_the_same_files_and_the_same_structure_in_any_format(simulated, tmp_path):
    first = read_study(simulated / "study.toml").structure
    for kind, names in (("npz", ["structure.npz"]), ("mat", ["structure.mat"])):
        place = tmp_path / kind
        opid("simulate", "backbones", place, "--seed", 3, "--curves", 4, 3, "--points", 8, "--matrices", kind)
        for name in ("mode_7_curve_2.csv", "truth.json"):
            assert (place / name).read_bytes() == (simulated / name).read_bytes()
        assert [path.name for path in place.iterdir() if path.suffix not in (".csv", ".json", ".toml")] == names
        other = read_study(place / "study.toml").structure
        assert (other.dofs, other.sensors, other.joints) == (first.dofs, first.sensors, first.joints)
        for one, same in ((first.mass, other.mass), *((first.parts[name], other.parts[name]) for name in first.parts)):
            assert abs(one - same).max() == 0
    files = sorted(path.name for path in simulated.iterdir() if path.suffix in (".mtx", ".npz", ".mat", ".txt"))
    assert files == ["dofs.txt", "mass.mtx", "part_E_aluminium.mtx", "part_E_steel.mtx", "stiffness.mtx"]


def test_a_controlled_test_keeps_the_curves_that_reach_quadrature(tmp_path, monkeypatch):
    seen = []

    def virtual_backbones(specimen, *, modes, sensors, **settings):
        seen.append((modes[0], sensors[0]))
        if modes[0] == 8 and sensors[0] != "10":
            raise NotDeterminedError("no quadrature")
        assert (specimen.drive, settings["n_points"]) == ("7", 10)
        system, row = specimen.system, specimen.system.sensor("10")
        shape = system.at_sensors[:, modes[0] - 1] / system.at_sensors[row, modes[0] - 1]
        level = np.linspace(*settings["amplitude_m"][0], 5)
        hz = system.frequency_hz[modes[0] - 1] * (1 + 5e3 * level**2)
        name = f"mode {modes[0]}, quadrature at {sensors[0]}"
        return (MeasuredBackbone(name, modes[0], "10", hz, level[:, None] * shape, system.sensors),)

    monkeypatch.setattr("opid.virtual.backbone_tests.measured.virtual_backbones", virtual_backbones)
    done = opid("simulate", "backbones", tmp_path, "--by", "continuation", "--curves", 2, 1, "--points", 10)
    assert done.exit_code == 0, done.output
    assert seen == [(7, "14"), (7, "13"), (8, "14"), (8, "13"), (8, "12"), (8, "11"), (8, "10")]
    names = [curve.name for curve in read_study(tmp_path / "study.toml").backbones]
    assert names == [f"mode {mode}, quadrature at {sensor}" for mode, sensor in ((7, 14), (7, 13), (8, 10))]


def test_a_controlled_test_with_few_points_is_refused_before_it_begins(tmp_path):
    done = opid("simulate", "backbones", tmp_path / "out", "--by", "continuation", "--points", 6)
    refused(done, "--points is 6, and a controlled test loses quadrature between points so far apart: give at least 10")
    assert not (tmp_path / "out").exists()


def test_a_mode_without_a_curve_is_not_determined(tmp_path, monkeypatch):
    def virtual_backbones(*_, **__):
        raise NotDeterminedError("no quadrature")

    monkeypatch.setattr("opid.virtual.backbone_tests.measured.virtual_backbones", virtual_backbones)
    done = opid("simulate", "backbones", tmp_path / "out", "--by", "continuation")
    refused(done, "no sensor reaches quadrature in mode 7", status=1)
    assert not (tmp_path / "out" / "study.toml").exists()


def test_the_study_of_a_simulation_is_updated(simulated, tmp_path, monkeypatch):
    """From Matrix Market files by the no-U-turn sampler to the report: the true class stands first, near the truth."""
    pytest.importorskip("nutpie")
    monkeypatch.setattr("opid.report.updating.list_figures", lambda *_: ())
    text = (simulated / "study.toml").read_text(encoding="utf-8")
    first, *others = text[: text.index("[sampling]")].split("[[classes]]")
    chosen = "[[classes]]".join([first, *others[:2]])
    (simulated / "two.toml").write_text(chosen.replace("harmonics = [1, 3]", "harmonics = [1]"), encoding="utf-8")
    done = opid("update", simulated / "two.toml", "--truth", simulated / "truth.json", "--out", tmp_path,
                "--samples", 1000, "--sampler", "nuts")  # fmt: skip
    assert (done.exit_code, done.stderr) == (0, "")
    told = " ".join(done.stdout.split())
    assert "Reduction: 29 coordinates, modes with sensors and joints held: frequency of modes 7 and 8 off" in told
    assert re.search(r"Reduction: 2\d coordinates \(\d directions? cut off\), free modes", told)
    assert re.search(r"Best: class 2, .*?, ahead of class 1 by", told)
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    cubic = result["classes"][1]["coefficients"]["cubic_stiffness"]
    assert cubic["mean"] == pytest.approx(1.58 * 6.8e7, rel=0.05)
    assert result["linear"]["parameters"]["E_steel"]["mean"] == pytest.approx(0.31, rel=0.05)
    assert result["classes"][1]["log_evidence"] - result["classes"][0]["log_evidence"] > 15
    assert max(result["reduction"]["relative"][:9]) < 1e-3
    assert max(result["reduction_free"]["relative"][:15]) < 1e-8
    assert result["settings"]["harmonics"] == [1]
    assert {each["diagnostics"]["sampler"] for each in result["classes"]} == {"nuts"}
