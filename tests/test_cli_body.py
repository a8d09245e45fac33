"""`opid simulate aircraft` and `opid identify` on its study, as a user drives them."""

import json

import pytest
from cli_runs import not_determined, opid, refused
from made_body import small_body

from opid.studies.study_file import read_study
from opid.suspensions import identification

SMALL = ("--duration", 6, "--fs", 128)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """A directory that `opid simulate aircraft` wrote; not to be changed."""
    place = tmp_path_factory.mktemp("aircraft") / "default"
    done = opid("simulate", "aircraft", place, "--seed", 3, "--date", "2026-03-01", *SMALL)
    assert (done.exit_code, done.stderr) == (0, "")
    assert f"5900 kg: {place / 'loaded.csv'}" in done.stdout
    assert f"Next: opid identify {place / 'study.toml'} --truth {place / 'truth.json'}" in done.stdout
    return place


@pytest.fixture
def found(monkeypatch):
    """What `identify` was asked, which answers with a result made by hand."""
    asked = {}

    def answer(study, **settings):
        asked.update(settings, study=study)
        return small_body(**asked.pop("changes", {}))

    monkeypatch.setattr(identification, "identify", answer)
    return asked


def test_a_simulation_writes_a_study_and_its_truth(simulated):
    study = read_study(simulated / "study.toml")
    assert str(study.date) == "2026-03-01"
    assert [run.mass_change_kg for run in study.runs] == [0.0, 500.0]
    assert study.interfaces[1].sensor_place == (0.3, 1.36)
    assert [sensor.channel for sensor in study.sensors] == ["tail_z"]
    truth = json.loads((simulated / "truth.json").read_text(encoding="utf-8"))
    assert truth["schema"] == "opid.body-truth/1"
    assert truth["parameters"]["sprung_mass_kg"] == 5400.0
    assert (truth["settings"]["seed"], truth["settings"]["tracks"]) == (3, "coherent")
    assert (study.structure.noise_m_per_s2, study.structure.position_tolerance_m) == (0.005, 0.01)


def test_a_weakened_strut_is_in_the_truth_and_the_rest_is_as_before(simulated, tmp_path):
    done = opid("simulate", "aircraft", tmp_path, "--seed", 3, "--weaken", "left", 0.95, "--noise", 0, *SMALL)
    assert done.exit_code == 0, done.output
    sound, harmed = (
        json.loads((folder / "truth.json").read_text(encoding="utf-8")) for folder in (simulated, tmp_path)
    )
    ratio = {
        name: harmed["interfaces"][name]["stiffness_n_per_m"] / gear["stiffness_n_per_m"]
        for name, gear in sound["interfaces"].items()
    }
    assert ratio == {"nose": 1.0, "left": pytest.approx(0.95), "right": 1.0}
    assert harmed["interfaces"]["left"]["law"] == sound["interfaces"]["left"]["law"]
    assert harmed["settings"]["weaken"] == [["left", 0.95]]
    assert read_study(tmp_path / "study.toml").structure.noise_m_per_s2 is None
    other = tmp_path / "other"
    refused(opid("simulate", "aircraft", other, "--weaken", "lft", 0.9), "--weaken names the gear 'lft'", "'left'")
    refused(opid("simulate", "aircraft", other, "--weaken", "left", 0), "has the factor 0, give a positive one")


def test_tables_of_a_body_in_the_study_of_one_gear_point_to_its_interfaces(tmp_path):
    (tmp_path / "study.toml").write_text(
        '[channels]\nsprung = "a"\nunsprung = "b"\n[structure]\nkind = "auto"\n'
        '[[runs]]\nname = "r"\nlog = "r.csv"\nmass_change_kg = 0.0\nloading = [[500.0, -1.0, 0.2]]\n',
        encoding="utf-8",
    )
    done = opid("identify", tmp_path / "study.toml", "--out", tmp_path / "r")
    refused(
        done, "the study has 'structure', which belongs to a body", "has 'loading', which belongs", "[[interfaces]]"
    )
    assert "did you mean" not in done.stderr


def test_a_study_is_no_log_to_inspect(simulated):
    path = simulated / "study.toml"
    refused(opid("inspect", path), "is a study, no log", f"opid inspect LOG... --study {path}")


def test_the_options_of_a_simulation(tmp_path):
    done = opid("simulate", "aircraft", tmp_path, "--random", "--bending", 8, "--tracks", "independent", "--seed", 2,
                "--loading", 200, 1, 0.5, "--loading", -50, 0, 0, "--duration", 2, "--fs", 128)  # fmt: skip
    assert done.exit_code == 0, done.output
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert truth["loadings"]["loaded"] == [[200.0, 1.0, 0.5], [-50.0, 0.0, 0.0]]
    assert 4000 <= truth["parameters"]["sprung_mass_kg"] <= 8000
    refused(opid("simulate", "aircraft", tmp_path, "--date", "yesterday"), "--date")
    refused(opid("simulate", "aircraft", tmp_path / "other", "--loading", -9000, 0, 0, *SMALL), "not positive definite")


def test_the_study_of_a_body_is_identified(simulated, tmp_path, found):
    done = opid("identify", simulated / "study.toml", "--out", tmp_path / "result", "--law", "arctan_velocity",
                "--band", 0.5, 30, "--method-of-law", "both", "--no-ground",
                "--truth", simulated / "truth.json")  # fmt: skip
    assert (done.exit_code, done.stderr) == (0, "")
    assert found["law"] == "arctan_velocity"
    assert found["band_hz"] == (0.5, 30.0)
    assert (found["method_of_law"], found["ground"]) == ("both", False)
    assert found["study"].names == ("nose", "left", "right")
    assert "Recommended: rigid body" in done.stdout
    assert "inside" in done.stdout  # of the truth
    assert json.loads((tmp_path / "result" / "result.json").read_text(encoding="utf-8"))["structure"]["kind"]
    assert (tmp_path / "result" / "report.html").exists()


def test_the_directory_of_a_study_is_enough(simulated, tmp_path, found, monkeypatch):
    monkeypatch.setattr("opid.report.suspensions.identification.list_figures", lambda result, truth: ())
    monkeypatch.chdir(tmp_path)
    done = opid("identify", simulated)
    assert (done.exit_code, done.stderr) == (0, "")
    assert found["study"].names == ("nose", "left", "right")
    assert [path.name for path in tmp_path.iterdir()] == [f"{simulated.name}_result"]


def test_what_is_not_determined_ends_with_status_1_after_the_report(simulated, tmp_path, found, monkeypatch):
    monkeypatch.setattr("opid.report.suspensions.identification.list_figures", lambda result, truth: ())
    found["changes"] = {"not_determined": "all runs have the same loading"}
    done = opid("identify", simulated / "study.toml", "--out", tmp_path)
    not_determined(done, "all runs have the same loading")
    assert (tmp_path / "report.html").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--method", "paper"), ["has no --method: leave it out"]),
        (("--high-pass", 0.3), ["--high-pass"]),
        (("--sprung", "a", "--mass-change", 3), ["--sprung or --mass-change"]),
        (("--repeatability", 0), ["has no --repeatability: leave it out"]),
    ],
)
def test_options_of_one_suspension_are_refused(simulated, tmp_path, found, options, words):
    refused(opid("identify", simulated / "study.toml", "--out", tmp_path / "r", *options), *words)
    assert not found
    assert not (tmp_path / "r").exists()


def test_the_truth_of_something_else_is_refused(simulated, tmp_path, found):
    other = tmp_path / "truth.json"
    other.write_text('{"schema": "opid.truth/1"}', encoding="utf-8")
    done = opid("identify", simulated / "study.toml", "--out", tmp_path / "r", "--truth", other)
    refused(done, "'opid.body-truth/1' is needed")
    assert not found


def test_faults_of_the_study_are_one_sentence(simulated, tmp_path):
    text = (simulated / "study.toml").read_text(encoding="utf-8")
    (tmp_path / "study.toml").write_text(text.replace('unsprung = "nose_lower_z"\n', ""), encoding="utf-8")
    refused(
        opid("identify", tmp_path / "study.toml", "--out", tmp_path / "r"),
        "'nose' lacks 'unsprung', give the",
    )


def test_interfaces_that_are_no_tables_are_named(simulated, tmp_path):
    text = (simulated / "study.toml").read_text()
    head = text[: text.index("[[interfaces]]")]
    (tmp_path / "study.toml").write_text(f"interfaces = true\n{head}")
    refused(opid("identify", tmp_path / "study.toml"), "'interfaces' in the study is True")


def test_a_log_is_inspected_as_the_study_of_a_body_says(simulated):
    done = opid("inspect", simulated / "reference.csv", "--study", simulated / "study.toml")
    assert done.exit_code in (0, 1), done.output
    assert "nose_upper_z" in done.stdout
    assert "tail_z" in done.stdout


def test_a_short_run_is_identified_from_end_to_end(tmp_path, monkeypatch):
    """One rigid body with the law given: 12 s of a smooth runway, and every number near its truth."""
    monkeypatch.setattr("opid.report.suspensions.identification.list_figures", lambda result, truth: ())
    done = opid("simulate", "aircraft", tmp_path, "--seed", 5, "--duration", 12, "--fs", 128)
    assert done.exit_code == 0, done.output
    path = tmp_path / "study.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('kind = "auto"', 'kind = "rigid_body"'), encoding="utf-8")
    done = opid(
        "identify", path, "--out", tmp_path / "r", "--law", "arctan_velocity", "--truth", tmp_path / "truth.json"
    )
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "r" / "result.json").read_text(encoding="utf-8"))
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert found["structure"]["recommended"] == "rigid_body"
    assert found["structure"]["residual_over_noise"] < 1.2
    for name in ("sprung_mass_kg", "roll_inertia_kg_m2", "pitch_inertia_kg_m2"):
        assert found["parameters"][name]["value"] == pytest.approx(truth["parameters"][name], rel=0.03)
    for interface in found["interfaces"]:
        true = truth["interfaces"][interface["name"]]
        assert interface["stiffness"]["value"] == pytest.approx(true["stiffness_n_per_m"], rel=0.03)
