"""An updating as text, JSON and page."""

import csv
import json
import re
import sys
from dataclasses import replace
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from made_updating import CUBIC, small_harmonics, small_motions, small_system, small_truth, small_updating

import opid
from opid.errors import InputError, escape_invisible
from opid.json_values import json_text
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.truth import UpdatingTruth
from opid.report.document import Table
from opid.report.sketch import sketch_joints
from opid.report.updating import say_orders, say_reductions
from opid.report.writing import build_document
from opid.updating.chain_files import write_chains
from opid.updating.model_class import Prior, StiffnessFactor
from opid.updating.sampling.chains import Chain, effective_samples, split_r_hat
from opid.updating.sampling.evidence import Evidence
from opid.updating.structure.reduction import ReductionErrors
from opid.virtual.truth_file import read_truth, tabulate_truth


@pytest.fixture(scope="module")
def result():
    return small_updating()


def tables_of(result):
    return {table.columns[0].head: table for table in build_document(result).blocks if isinstance(table, Table)}


def line_of(text, start):
    return next(line for line in text.splitlines() if line.startswith(start))


def test_the_text_holds_the_numbers_within_eighty_columns(result):
    for truth in (None, small_truth()):
        text = opid.text(result, truth)
        assert max(len(line) for line in text.splitlines()) <= 80
    assert "8 backbones (5 of mode 1, 3 of mode 2), 96 points, 6 sensors, 2 joints" in text
    assert line_of(text, "class 2").split() == ["class", "2", "cubic", "360.20", "-", "best", "365.20"]
    assert "-279.20" in line_of(text, "class 1")
    assert "ahead of class 4 by 2.30 (odds 9.97 to 1)" in text
    assert line_of(text, "1       14.65 Hz").split()[-2:] == ["0.810", "0.990"]
    assert "360.10 ± 0.19" in text
    assert "Warning: class 4: the chains of theta_2" in text


def test_coefficients_are_in_si_units_whatever_the_sign_of_the_scale(result):
    ((of_cubic, cubic),) = result.classes[1].coefficients.items()
    assert (cubic.value, cubic.std) == (pytest.approx(CUBIC), pytest.approx(0.04 * 6.8e7))
    _, (of_quartic, quartic) = result.classes[2].coefficients.items()
    assert [(each.key, each.own.unit) for each in (of_cubic, of_quartic)] == [
        ("cubic_stiffness", "N/m^3"),
        ("quartic_stiffness", "N/m^4"),
    ]
    assert quartic.value == pytest.approx(-2.7e9 * 0.6)
    assert quartic.std > 0
    assert quartic.interval95[0] < quartic.value < quartic.interval95[1]


def test_truth_stands_beside_the_classes_that_hold_the_true_law(result):
    text = opid.text(result, small_truth())
    rows = [line for line in text.splitlines() if line.startswith(("cubic", "quadratic", "quartic"))]
    assert rows[0].split()[-3:] == ["-", "-", "-"]  # no cubic term: there is no true value
    assert rows[1].split()[-3:] == ["1.0744×10⁸", "+0.00%", "yes"]
    assert rows[2].split()[-1] == "no"
    assert rows[3].split()[-3:] == ["0", "-", "yes"]
    assert line_of(text, "E_steel").split()[-3:] == ["0.31", "+0.00%", "yes"]


def test_one_class_one_method_and_no_linear_updating_are_told_too(result):
    alone = replace(result.classes[1], evidences=(Evidence("laplace", 360.2),), prior_sensitivity={})
    few = replace(result, linear=None, classes=(alone,), prediction=())
    text = opid.text(few)
    assert "Best: class 2, cubic, the only class" in text
    assert "Linear structure" not in text
    assert {"log evidence ± std. dev.", "prior twice as wide", "within the band"} & set(tables_of(few)) == set()
    assert len(tables_of(few)["sampling"].rows) == 1
    assert few.to_dict()["linear"] is None


def test_a_class_that_explains_nothing_is_told(result):
    lost = replace(result.classes[0], evidences=(Evidence("laplace", -np.inf),))
    two = replace(result, classes=(lost, result.classes[1]))
    assert "no other class can explain the data" in build_document(two).answer
    assert tables_of(two)["class"].rows[0][4] == "-inf"
    assert json.loads(json_text(two.to_dict()))["classes"][0]["log_evidence"] is None


def test_what_is_not_determined_is_said(result):
    text = opid.text(replace(result, not_determined="no class explains the backbones", best_class="", prediction=()))
    assert "Not determined: no class explains the backbones" in text


def test_json_has_the_schema_and_is_strict(result):
    document = json.loads(json_text(result.to_dict()))
    assert document["schema"] == "opid.updating/1"
    assert document["best_class"] == "class 2"
    second = document["classes"][1]
    assert (second["name"], second["law"]) == ("class 2", "cubic")
    assert (second["log_evidence"], second["log_evidence_std"]) == (360.2, 0.0)
    assert [each["method"] for each in second["evidences"]] == ["laplace", "transitional", "quadrature"]
    assert second["parameters"]["theta_1"]["mean"] == 1.58
    assert second["parameters"]["theta_1"]["interval95"] == pytest.approx([1.5016, 1.6584])
    assert second["coefficients"]["cubic_stiffness"]["mean"] == pytest.approx(CUBIC)
    assert second["coefficients"]["cubic_stiffness"]["unit"] == "N/m^3"
    prior = {"family": "uniform", "first": 0.0, "second": 10.0}
    assert second["terms"] == [{"kind": "cubic_stiffness", "scales": [6.8e7], "priors": [prior], "joints": []}]
    assert set(second["diagnostics"]) == {
        *("sampler", "n_samples", "n_evaluations", "acceptance", "effective_samples", "r_hat", "divergent"),
    }
    assert document["classes"][2]["prior_sensitivity"] == {"theta_1": -0.693, "theta_2": -0.693}
    assert document["classes"][2]["warnings"]
    assert document["linear"]["best"] == {"E_aluminium": 0.88, "E_steel": 0.31}
    assert document["linear"]["modes"][0]["updated_mac"] == 0.99
    assert document["system"]["frequency_hz"] == pytest.approx([14.65, 17.71, 60.0])
    assert len(document["measured"]) == 8
    assert len(document["measured"][0]["amplitude"]["10"]) == 12
    band = document["prediction"][0]
    assert set(band) == {
        *("mode", "sensor", "amplitude", "frequency_hz", "low_hz", "high_hz", "coverage", "left_out", "mode_left_out"),
        *("is_measured", "sensors", "loop"),
    }
    assert {"warnings", "not_determined", "settings", "form", "title"} <= set(document)


def test_the_page_opens_offline_with_its_figures_inside(result, tmp_path):
    said = []
    page = opid.write_report(result, tmp_path / "out", small_truth(), progress=said.append)
    text = page.read_text(encoding="utf-8")
    names = set(re.findall(r'data-chart="(\w+)"', text))
    assert names == {
        *("measured_mode_1", "measured_mode_2", "shape_mode_1", "shape_mode_2"),
        *("predicted_mode_1", "predicted_mode_2"),
        *("linear_updating", "linear_samples", "linear_running", "log_evidences", "joint_forces"),
        # the data rule out the first class
        *(f"class_{number}_{what}" for number in (2, 3) for what in ("samples", "running")),
    }
    assert [each.model_class.name for each in result.rejected] == [result.classes[0].model_class.name]
    assert text.count('data-chart="') == len(names) == len(said)
    assert not re.search(r'(src|href)="[^#]', text)
    assert "opid update study.toml --form recommended --sampler adaptive --samples 5000 --seed 1" in text
    assert json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))["schema"] == "opid.updating/1"


def test_what_the_reduction_leaves_out_is_drawn_and_kept_where_it_is_given(result, tmp_path):
    errors = errors_of([0.0, 7e-4], [1, 2])
    free = errors_of([0.0, 0.0], [2, 1], method="free", n_cut=1)
    few = replace(result, linear=None, classes=(), measured=(), prediction=(), reductions=(errors, free))
    opid.write_report(few, tmp_path)
    assert re.findall(r'data-chart="(\w+)"', (tmp_path / "report.html").read_text(encoding="utf-8")) == ["reduction"]
    document = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert document["reduction"]["relative"] == [0.0, 7e-4]
    assert document["reduction_free"]["nearest"] == [2, 1]
    assert "With free modes the order changes: mode 1 is the whole structure" in (tmp_path / "report.html").read_text(
        encoding="utf-8"
    )
    assert result.to_dict()["reduction"] is result.to_dict()["reduction_free"] is None


def errors_of(relative, nearest, **others):
    number, relative = np.arange(1, len(relative) + 1), np.array(relative)
    mac = np.where(np.array(nearest) == number, 1.0, 0.0)
    return ReductionErrors(
        10.0 * number, 10.0 * number * (1 + relative), relative, mac, np.array(nearest),
        np.where(np.array(nearest) > 0, 0.97, 0.3), **{"n_dof": 29, **others},
    )  # fmt: skip


def test_the_text_says_what_the_reduction_keeps(result):
    held = errors_of([1e-7, 2e-6, 1e-4, 0.02, 0.001], [1, 2, 3, 5, 4])
    free = errors_of([1e-9, 3e-9], [1, 2], method="free", n_dof=28, n_cut=1)
    reduced = replace(result, reductions=(held, free))
    told = say_reductions(reduced)
    assert told == (
        "29 coordinates, modes with sensors and joints held: frequency of modes 1 and 2 off by at most 0.0002 %, "
        "modes 1 to 3 by less than 1 %",
        "28 coordinates (1 direction cut off), free modes (the paper's words): frequency of modes 1 and 2 off by at "
        "most 3×10⁻⁷ %, modes 1 to 2 by less than 1 %",
    )
    text = opid.text(reduced)
    assert text.count("Reduction: ") == 2
    assert max(len(line) for line in text.splitlines()) <= 80


def test_a_small_mac_is_explained_by_what_is_true():
    assert say_orders([errors_of([0.0, 0.0], [1, 2])]) == ()
    (moved,) = say_orders([errors_of([0.0] * 3, [1, 3, 2])])
    assert "mode 2 is the whole structure's mode 3, mode 3 is the whole structure's mode 2 (crosses: MAC" in moved
    (lost,) = say_orders([errors_of([0.0] * 3, [1, 0, 3], method="free")])
    assert lost == "with free modes the shape of mode 2 is like no single one of the 3 compared"
    (many,) = say_orders([errors_of([0.0] * 8, [8, 7, 6, 5, 4, 3, 2, 1])])
    assert "and 4 more" in many


def test_one_of_each_is_told_in_the_singular(result):
    curve = result.measured[0]
    one = replace(
        curve, frequency_hz=curve.frequency_hz[:3], amplitude=curve.amplitude[:3, :2], sensors=curve.sensors[:2]
    )
    system = small_system()
    alone = JointedModes(system.eigenvalue[:1], system.at_sensors[:1, :1], system.at_joints[:1, :1], ("9",), ("left",))
    told = build_document(replace(result, measured=(one,), system=alone)).blocks[0].text
    assert told.startswith("1 backbone (1 of mode 1), 3 points, 1 sensor, 1 joint, 1 mode kept;")


def test_the_coverage_is_said_to_be_that_of_fitted_points(result):
    text = " ".join(opid.text(result).split())
    assert "The class was fitted to these points" in text
    assert "Curves that are left out in turn, and judged by the band that the others give, are new to it" in text


def test_missing_points_of_a_band_are_counted_and_null(result):
    first, *others = result.prediction
    gap = np.where(np.arange(first.amplitude.size) < 3, np.nan, first.frequency_hz)
    broken = replace(result, prediction=(replace(first, frequency_hz=gap, low_hz=gap, high_hz=gap), *others))
    assert "has no frequency" not in tables_of(result)["within the band"].note
    assert "The band of mode 1 has no frequency at 3 of its 40 amplitudes" in " ".join(opid.text(broken).split())
    band = json.loads(json_text(broken.to_dict()))["prediction"][0]
    assert band["frequency_hz"][:4] == [None, None, None, pytest.approx(first.frequency_hz[3])]
    texts = {figure.name: figure.text for figure in build_document(broken).figures}
    assert "Where it breaks off" in texts["predicted_mode_1"]
    assert "Where it breaks off" not in texts["predicted_mode_2"]


def test_bands_of_one_mode_and_sensor_share_a_cell(result):
    band = next(each for each in result.prediction if each.sensor == "10" and each.mode == 1)
    several = replace(result, prediction=(band, replace(band, coverage=0.5), replace(band, mode=2, coverage=np.nan)))
    table = tables_of(several)["within the band"]
    assert [column.head for column in table.columns] == ["within the band", "mode 1", "mode 2"]
    assert table.rows == (("sensor 10", "94 %, 50 %", "-"),)


def test_motions_of_every_sensor_are_counted_and_drawn_in_a_part_that_is_folded(result):
    whole = replace(result, prediction=(small_motions(1), small_motions(2)))
    table = tables_of(whole)["motion within its band"]
    assert [column.head for column in table.columns][1:] == ["mode 1", "mode 2"]
    assert table.rows[0] == ("sensor 9", "93 % (96 %)", "93 % (96 %)")
    assert len(table.rows) == 5
    figures = [figure for figure in build_document(whole).figures if figure.name.startswith("motions_mode_")]
    assert [figure.name for figure in figures] == ["motions_mode_1", "motions_mode_2"]
    assert {table.fold, *(figure.fold for figure in figures)} == {"Motion of every sensor"}
    rows = tables_of(whole)["within the band"].rows
    assert [row[0] for row in rows[1:]] == ["its curves left out in turn", "all curves of the mode left out"]
    assert rows[2][1:] == ("90 %", "90 %")
    assert "motion within its band" not in tables_of(result)


def test_harmonics_of_every_sensor_are_counted_and_drawn_in_a_part_that_is_folded(result):
    harmonics = small_harmonics()
    told = replace(result, harmonics=harmonics)
    assert told.harmonics_within == {(1, 3): pytest.approx(0.75), (2, 3): pytest.approx(0.7)}
    tables = tables_of(told)
    assert tables["harmonic within its band"].rows == (
        ("sensor 9, harmonic 3", "75 %", "-"),
        ("sensor 10, harmonic 3", "75 %", "75 %"),
    )
    assert ("harmonic 3, all sensors", "75 %", "70 %") in tables["within the band"].rows
    names = [figure.name for figure in build_document(told).figures]
    assert [name for name in names if name.startswith("harmonic")] == ["harmonic_3_mode_1", "harmonic_3_mode_2"]
    rows = {row.name: row.value for row in told.summary()}
    assert rows["mode 1, harmonic 3: points within the band"] == pytest.approx(0.75)
    written = told.to_dict()["harmonics"]
    assert [(each["mode"], each["order"], each["sensor"]) for each in written] == [
        (1, 3, "9"),
        (1, 3, "10"),
        (2, 3, "10"),
    ]
    assert written[-1]["low"][-1] is None
    assert "harmonic" not in opid.text(result)


def test_modes_without_curves_have_a_table_and_a_figure(result):
    nothing = {"is_measured": False, "coverage": np.nan}
    third = replace(small_motions(2, **nothing), mode=3, left_out=None, mode_left_out=None)
    whole = replace(result, prediction=(small_motions(1), third))
    lowest, highest = tables_of(whole)["predicted mode"].rows
    assert (lowest[:3], highest[2]) == (("3", "10", "0.2"), "2.5")
    assert lowest[4] == f"{0.995 * third.frequency_hz[0]:.3f} to {1.005 * third.frequency_hz[0]:.3f}"
    assert [column.head for column in tables_of(whole)["within the band"].columns] == ["within the band", "mode 1"]
    (figure,) = (each for each in build_document(whole).figures if each.name == "predicted_mode_3")
    assert "was not measured" in figure.text
    figure.draw()


def test_the_forces_of_joints_that_the_tests_do_not_move_are_drawn(result):
    system = small_system()
    still = replace(system, at_joints=np.zeros_like(system.at_joints))
    found = build_document(replace(result, system=still))
    next(each for each in found.figures if each.name == "joint_forces").draw()


class Groups:
    """What ArviZ returns, as far as it is asked."""

    def __init__(self, posterior, sample_stats):
        self.posterior, self.sample_stats = posterior, sample_stats

    def groups(self):
        return []

    def to_netcdf(self, path):
        shapes = {name: np.shape(values) for name, values in self.posterior.items()}
        Path(path).write_text(f"{shapes} {np.isfinite(self.sample_stats['lp']).all()}", encoding="utf-8")


@pytest.fixture
def arviz(monkeypatch):
    module, pandas = ModuleType("arviz"), pytest.importorskip("pandas")
    module.__version__, module.from_dict = "0.23.4", lambda **groups: Groups(**groups)
    module.summary = lambda data, **options: pandas.DataFrame({"r_hat": dict.fromkeys(data.posterior, 1.0)})
    module.__spec__ = ModuleSpec("arviz", None)
    monkeypatch.setitem(sys.modules, "arviz", module)
    return module


def test_chains_are_written_one_file_a_posterior(result, arviz, tmp_path):
    files = write_chains(result, tmp_path / "new")
    names = ("linear.nc", "class_1.nc", "class_2.nc", "class_3.nc", "summary.csv")
    assert [path.name for path in files] == [f"chains_{name}" for name in names]
    assert "'E_aluminium': (2, 1500)" in files[0].read_text(encoding="utf-8")
    assert files[3].read_text(encoding="utf-8") == "{'theta_1': (2, 1000), 'theta_2': (2, 1000)} True"


def test_arviz_reads_back_the_chains_that_are_written(result, tmp_path):
    real = pytest.importorskip("arviz")
    written = write_chains(result, tmp_path)
    posteriors = [result.linear, *result.classes]
    for path, posterior in zip(written[:-1], posteriors, strict=True):
        read = real.from_netcdf(path)["posterior"]
        assert list(read.data_vars) == list(posterior.estimates)
        for column, name in zip(posterior.chain.pooled.T, posterior.estimates, strict=True):
            np.testing.assert_array_equal(read[name].to_numpy().ravel(), column)


def test_the_diagnostics_of_several_chains_are_those_of_arviz(result, tmp_path):
    real = pytest.importorskip("arviz")
    n_of = {"class 1": 1, "class 2": 4, "class 4": 4}  # The first is one of particles.
    classes = tuple(
        replace(each, chain=Chain(samples, np.zeros(samples.shape[:2]), 0.3, samples[..., 0].size, "adaptive", 0))
        for each in result.classes
        for samples in [each.samples.reshape(n_of[each.model_class.name], -1, len(each.estimates))]
    )
    summary = write_chains(replace(result, linear=None, classes=classes), tmp_path)[-1]
    assert summary == tmp_path / "chains_summary.csv"
    rows = {tuple(row[:2]): row[2:] for row in csv.reader(summary.read_text(encoding="utf-8").splitlines())}
    head = rows.pop(("posterior", "parameter"))
    assert list(rows) == [("class_2", "theta_1"), ("class_3", "theta_1"), ("class_3", "theta_2")]
    for (name, parameter), row in rows.items():
        told = dict(zip(head, map(float, row), strict=True))
        data = real.from_netcdf(tmp_path / f"chains_{name}.nc")["posterior"][[parameter]]
        for column, expected in {
            "mcse_mean": real.mcse(data, method="mean"),
            "ess_bulk": real.ess(data, method="bulk"),
            "ess_tail": real.ess(data, method="tail"),
            "r_hat": real.rhat(data),
        }.items():
            assert told[column] == pytest.approx(float(expected[parameter]), rel=1e-6)
        # opid's own numbers, which a plain installation has, are the same
        samples = classes[int(name[-1]) - 1].chain.samples[..., [int(parameter[-1]) - 1]]
        assert effective_samples(samples)[0] == pytest.approx(told["ess_bulk"], rel=0.03)
        assert split_r_hat(samples)[0] == pytest.approx(told["r_hat"], rel=0.03)


def test_without_the_writer_of_arviz_chains_are_refused_in_a_sentence(result, arviz, tmp_path, monkeypatch):
    def to_netcdf(self, path):
        raise ValueError("no suitable backend")

    monkeypatch.setattr(Groups, "to_netcdf", to_netcdf)
    with pytest.raises(InputError, match=r"no suitable backend\): run `\S+ -m pip install h5netcdf`"):
        write_chains(result, tmp_path)


def test_a_warning_of_a_part_is_told_once(result):
    told = replace(result, warnings=("class 'class 4': the chains of theta_2 have few effective samples",))
    doubts = told.all_warnings
    assert sum("theta_2" in doubt for doubt in doubts) == 1
    assert any("E_steel" in doubt for doubt in doubts)


def test_the_extension_that_was_reached_follows_the_shape_of_the_mode(result):
    system = small_system()
    ratio = np.abs(system.at_joints).max(axis=0) / np.abs(system.at_sensors[system.sensor("10")])
    largest = [
        max(curve.controlled_amplitude[-1] for curve in result.measured if curve.mode == mode) for mode in (1, 2)
    ]
    assert result.reached_extension == pytest.approx({mode: ratio[mode - 1] * largest[mode - 1] for mode in (1, 2)})
    assert replace(result, measured=()).reached_extension == {}


def test_a_truth_is_read_and_anything_else_refused(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text(json.dumps(tabulate_truth(small_truth())), encoding="utf-8")
    assert read_truth(path, UpdatingTruth) == small_truth()
    for text, words in (
        ('{"schema": "opid.truth/1"}', "where 'opid.updating-truth/2' is needed"),
        (
            '{"schema": "opid.updating-truth/2", "linear": {}, "laws": {"a": "x"}}',
            "not the truth of simulated backbones",
        ),
        ("[1]", "not the truth of simulated backbones"),
        ("{", "not the truth of simulated backbones"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=words):
            read_truth(path, UpdatingTruth)
    with pytest.raises(InputError, match="cannot read"):
        read_truth(tmp_path / "none.json", UpdatingTruth)


def test_the_sketch_shows_the_joints_with_the_law_of_the_best_class(result):
    sketch = sketch_joints(result)
    for words in (
        "f(z): cubic (class 2)",
        "cubic: 1.074×10⁸ ± 2.7×10⁶ N/m³",
        "E_steel = 0.3100 ± 0.0020",
    ):
        assert words in sketch.alt
    assert all(f">{name}</text>" in sketch.svg for name in ("left", "right"))
    assert sketch_joints(replace(result, best_class="")) is None
    hidden = "abc\u202egnp.exe\u2066x"
    renamed = replace(result, system=replace(result.system, joints=(hidden, *result.system.joints[1:])))
    assert f"<title>{escape_invisible(hidden)}</title>" in sketch_joints(renamed).svg


def test_what_few_readers_need_is_folded(result):
    found = build_document(result)
    shown = [figure.name for figure in found.figures if not figure.fold]
    best = ["class_2_samples"]
    predicted = ["predicted_mode_1", "predicted_mode_2"]
    assert shown == ["measured_mode_1", "shape_mode_1", "log_evidences", "joint_forces", *best, *predicted]
    running = {figure.fold for figure in found.figures if figure.name.endswith("_running")}
    assert len(running) == 1
    others = {figure.name: figure.fold for figure in found.figures}["class_3_samples"]
    assert others
    assert others not in running
    assert {
        table.fold != "" for table in found.blocks if isinstance(table, Table) and table.columns[0].head == "sampling"
    } == {True}


def test_a_factor_that_is_updated_with_a_law_has_one_row_and_its_truth(result):
    """Both phases at once: the second parameter of the class is a factor of the linear stiffness."""
    cubic, pair = result.classes[1], result.classes[2]
    own = replace(cubic.model_class, factors=(StiffnessFactor("E_steel", Prior("uniform", 0.05, 5.0)),))
    joint = replace(result, classes=(replace(pair, model_class=own),), best_class=own.name)
    text = opid.text(joint, small_truth())
    assert "theta_1 x 6.8×10⁷ N/m^3\n" in text
    assert line_of(text, "theta_1").split()[1:] == ["1.710", "1.632", "..", "1.788", "1", "1.58", "no"]
    factor = [line for line in text.splitlines() if line.startswith("E_steel")]
    assert len(factor) == 2  # in both phases and in phase I
    assert "of nominal" in factor[0]
    assert "0.31" in factor[0]
    document = json.loads(json_text(joint.to_dict()))
    assert document["classes"][0]["factors"][0]["name"] == "E_steel"
    assert document["classes"][0]["coefficients"]["E_steel"]["unit"] == "1"
    assert sketch_joints(joint).alt.count("E_steel") == 1
