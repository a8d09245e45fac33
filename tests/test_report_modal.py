"""A nonlinear modal model as text, JSON and page."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from made_modal import SOFT, small_decay, small_fit, small_result, small_shift

import opid
from opid.errors import InputError
from opid.estimate import format_number, with_std
from opid.json_values import json_text
from opid.mechanics.truth import ModalTruth, ModeTruth
from opid.modal.decay.free_decay import law_of_decays
from opid.modal.model import Comparison
from opid.report.document import Table
from opid.report.nonlinear_modes import list_figures, write_command
from opid.report.sketch import sketch_decay, sketch_modes
from opid.report.writing import build_document
from opid.virtual.truth_file import read_truth, tabulate_truth

TRUTH = ModalTruth({SOFT: ModeTruth({3: -1.5e11}, {2: 30.0})})


@pytest.fixture(scope="module")
def result():
    return small_result(shifts=[small_shift(), small_shift(4, determined=False)], decays=[small_decay()])


def tables_of(result):
    return [block for block in build_document(result).blocks if isinstance(block, Table)]


def test_the_text_holds_the_numbers_within_eighty_columns(result):
    text = opid.text(result)
    assert max(len(line) for line in text.splitlines()) <= 80
    assert "4 modes (1 rigid), 6 sensors, force at 'case_x'; condition number" in text
    assert "60.00 Hz" in text
    assert "-1.5030×10¹¹" in text
    assert "cannot tell" in text
    assert "Truth test 'strong'" in text
    assert "Warning: the shapes do not look mass-normalised" in text
    assert "Warning: test 'beat_2' ends with" in text.replace("\n", " ")


def test_frequency_and_damping_stand_at_zero_and_at_the_top_amplitude(result):
    lines = opid.text(result).splitlines()
    zero = next(k for k, line in enumerate(lines) if line.startswith("mode ") and "q [m kg^1/2]" in line) + 1
    assert lines[zero].split()[:4] == ["3", "zero", "60.00", "Hz"]
    assert lines[zero + 1].split()[:2] == ["top,", "0.00025"]
    heads = [[column.head for column in table.columns] for table in tables_of(result)]
    (decays,) = (table for table in tables_of(result) if table.columns[0].head == "free decay")
    assert [row[2].split(",")[0] for row in decays.rows] == ["zero", "top"]
    assert all(len(set(each)) == len(each) for each in heads), heads
    # one word for one thing: a ± could be half an interval or a standard deviation
    assert "±" not in opid.text(result)


def test_every_warning_stands_once_in_text_page_and_json(result):
    doubted = replace(result, warnings=("of a decay", "of its law", *small_fit().warnings))
    told = json.loads(json_text(doubted.to_dict()))["warnings"]
    assert told == ["of a decay", "of its law", *small_fit().warnings]
    text = opid.text(doubted).replace("\n         ", " ")
    for warning in told:
        assert text.count(warning) == 1


def test_the_command_gives_the_result_again(result, tmp_path, monkeypatch):
    monkeypatch.setattr("opid.report.nonlinear_modes.list_figures", lambda *_: ())

    def command(settings, **given):
        found = replace(result, settings={"study": "my study.toml", **settings})
        given = {"command": write_command(found, given["options"])} if given else {}
        text = opid.write_report(found, tmp_path, **given).read_text(encoding="utf-8")
        return next(line for line in text.splitlines() if "opid modal" in line).removeprefix('<pre tabindex="0">')[
            : -len("</pre>")
        ]

    thresholds = {"frequency_threshold": 0.002, "damping_threshold": 0.15}
    head = "opid modal &#39;my study.toml&#39;"
    assert command(thresholds) == head
    assert command({**thresholds, "free_linear": True}) == f"{head} --free-linear"
    settings = {"stiffness_order": 3, "free_linear": False, "frequency_threshold": 0.01, "damping_threshold": 0.15}
    assert command(settings) == f"{head} --stiffness-order 3 --frequency-threshold 0.01 --fixed-linear"
    # what the study file says need not be said again; what overrules it must be, be it a default
    assert command(settings, options={}) == head
    assert command(settings, options={"frequency_threshold": 0.002}) == f"{head} --frequency-threshold 0.002"


def test_green_dots_are_spoken_of_only_where_they_are(result):
    def words(truth):
        return next(each.text for each in list_figures(result, truth) if each.name.endswith("_force"))

    curves = ((1e-4,), (59.9,), (0.006,))
    assert "Green dots" not in words(None) + words(TRUTH)
    assert "while all others are at rest" in words(ModalTruth({SOFT: ModeTruth({}, {}, *curves)}))


def test_truth_stands_beside_each_coefficient(result):
    lines = opid.text(result, TRUTH).splitlines()
    cubic = next(line for line in lines if line.startswith("k3"))
    assert "-1.5×10¹¹" in cubic
    assert cubic.endswith("yes")
    assert next(line for line in lines if line.startswith("k2")).endswith("yes")  # the truth has none: zero


def test_a_joint_without_powers_gives_no_true_coefficients(result):
    joint = ModeTruth({}, {})
    assert opid.text(result, ModalTruth({SOFT: joint})) == opid.text(result)
    # where another mode has some, the columns stay
    truth = ModalTruth({SOFT: joint, 4: ModeTruth({3: 1e9}, {})})
    cubic = next(line for line in opid.text(result, truth).splitlines() if line.startswith("k3"))
    assert cubic.split()[-2:] == ["-", "-"]


def test_at_most_eight_sensors_the_worst_first(result):
    test = result.truth_tests[0]
    many = replace(test, sensors={f"s{k}": Comparison(1.0, 2.0, 0.01 * k, 1.0) for k in range(12)})
    assert many.worst_sensors[:2] == ["s11", "s10"]
    shown = replace(result, truth_tests=(many,))
    assert len(tables_of(shown)[-1].rows) == 12
    text = opid.text(shown)
    assert "s4 " in text
    assert "s3 " not in text
    assert "and 4 more in the report" in text


def test_what_is_not_determined_is_said(result):
    text = opid.text(replace(result, not_determined="the tests do not move mode 3", fits=(), truth_tests=()))
    assert "Not determined: the tests do not move mode 3" in text


def test_the_thresholds_of_the_levels_are_said(result):
    shown = replace(result, settings=result.settings | {"frequency_threshold": 0.002, "damping_threshold": 0.15})
    words = "A mode is nonlinear where its frequency shifts by more than 0.2 % or its damping ratio by more than 15 %"
    assert words in opid.text(shown).replace("\n", " ")
    assert json.loads(json_text(shown.to_dict()))["settings"]["damping_threshold"] == 0.15
    assert "A mode is nonlinear where" not in opid.text(replace(shown, shifts=()))


def test_the_law_of_free_decays_stands_beside_the_fits_or_in_their_place(result):
    law = law_of_decays(result.decays)
    both = replace(result, decay_laws={SOFT: law})
    assert f"Mode {SOFT} by free decay '{result.decays[0].name}', 60.00 Hz" in opid.text(both, TRUTH)
    document = json.loads(json_text(both.to_dict()))
    assert [mode["known_by"] for mode in document["modes"]] == ["forced tests"]
    told = document["decay_laws"][str(SOFT)]
    assert told["k"]["1"]["value"] == pytest.approx(law.stiffness[1].value)
    assert set(told["c"]["1"]) == {"value", "std", "interval95"}
    assert told["frequency_low_hz"]["value"] == pytest.approx(60.0, abs=0.05)
    alone = replace(both, fits=())
    assert f"nonlinear: {SOFT} (by free decays);" in opid.text(alone).replace("\n", " ")
    entry = json.loads(json_text(alone.to_dict()))["modes"][0]
    assert set(entry) == set(document["modes"][0])
    assert (entry["mode"], entry["known_by"], entry["band_hz"]) == (SOFT, "free decays", None)
    # the correction of k0, as in all modes
    k0 = float(result.modes.stiffness()[SOFT - 1])
    assert entry["k"]["1"]["value"] == pytest.approx(law.stiffness[1].value - k0)
    assert entry["k"]["3"] == told["k"]["3"]


def test_json_has_the_schema_and_is_strict(result):
    document = json.loads(json_text(result.to_dict()))
    assert document["schema"] == "opid.modal/1"
    assert document["drive_point"] == "case_x"
    assert document["condition_number"] == pytest.approx(result.condition_number)
    assert np.asarray(document["auto_mac"]).shape == (4, 4)
    mode = document["modes"][0]
    assert (mode["mode"], mode["stiffness_order"], mode["damping_order"]) == (SOFT, 3, 3)
    assert mode["k"]["3"]["std"] == 4.1e8
    assert mode["c"]["2"]["interval95"] == pytest.approx([30.1 - 1.96 * 0.3, 30.1 + 1.96 * 0.3])
    assert mode["units"]["k3"] == "N/(m^3 kg^2)"
    assert mode["band_hz"] == [52.0, 68.0]
    assert set(mode["force_curves"]["stiffness"]) == {"displacement", "force", "low", "high", "linear"}
    assert set(mode["force_curves"]["damping"]) == {"velocity", "force", "low", "high", "linear"}
    assert len(mode["frequency_at_hz"]) == len(mode["damping_at"]) == 101
    assert sum(rung["chosen"] for rung in mode["orders"]) == 1
    assert document["linear_modes"]["frequency_hz"] == [0.0, 40.0, 60.0, 85.0]
    figures = document["truth_tests"][0]["sensors"]["lid_x"]
    assert set(figures) == {"peak_ratio_nonlinear", "peak_ratio_linear", "nrmse_nonlinear", "nrmse_linear"}
    assert document["level_shifts"][0]["nonlinear"] is True
    decay = document["decays"][0]
    assert decay["mode"] == SOFT
    assert len(decay["frequency_hz"]) == len(decay["amplitude"])
    assert {"warnings", "not_determined", "settings"} <= set(document)


def test_numbers_that_are_not_finite_become_null(result):
    fit = replace(small_fit(), condition_raw=np.inf)
    document = json.loads(json_text(replace(result, fits=(fit,)).to_dict()))
    assert document["modes"][0]["condition_raw"] is None


def test_the_page_opens_offline_with_its_figures_inside(result, tmp_path):
    said = []
    page = opid.write_report(result, tmp_path / "out", TRUTH, progress=said.append)
    text = page.read_text(encoding="utf-8")
    names = set(re.findall(r'data-chart="(\w+)"', text))
    assert names == {
        *(
            "auto_mac",
            "mode_indicators",
            "level_shifts",
            "mode_3_tests",
            "mode_3_force",
            "mode_3_orders",
            "modes_3_4_laws",
        ),
        *("decay_1", "truth_test_1", "truth_test_1_errors"),
    }
    assert text.count('data-chart="') == len(names) == len(said)
    assert not re.search(r'(src|href)="[^#]', text)
    assert "opid modal study.toml --stiffness-order 3 --damping-order 3" in text
    assert json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))["schema"] == "opid.modal/1"


def test_a_truth_is_read_and_anything_else_refused(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text(json.dumps(tabulate_truth(TRUTH)), encoding="utf-8")
    assert read_truth(path, ModalTruth) == TRUTH
    for text, words in (
        ('{"schema": "opid.truth/1"}', "where 'opid.modal-truth/1' is needed"),
        (
            '{"schema": "opid.modal-truth/1", "nonlinear": {"3": {"k": {"x": 1}, "c": {}}}}',
            "not the truth of a simulated",
        ),
        ("[1]", "not the truth of a simulated"),
        ("{", "not the truth of a simulated"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=words):
            read_truth(path, ModalTruth)
    with pytest.raises(InputError, match="cannot read"):
        read_truth(tmp_path / "none.json", ModalTruth)


def test_the_sketch_shows_frequency_and_damping_of_each_nonlinear_mode():
    found = small_result()
    fit = found.fits[0]
    sketch = sketch_modes(found)
    for words in ("k(q)", "c(q)", "f = 60.00 Hz, ζ = 0.5 %", f"f = {fit.frequency_at_hz[-1]:.2f} Hz"):
        assert words in sketch.svg
    assert "mode 3 at q = 0.00025 m √kg:" in sketch.svg
    assert sketch_modes(replace(found, fits=())) is None
    many = replace(found, fits=tuple(replace(fit, mode=mode) for mode in range(1, 6)))
    assert "and 2 more in the table" in sketch_modes(many).svg


def test_a_mode_that_only_decays_show_is_sketched():
    decay = small_decay()
    found = replace(small_result(decays=(decay,)), fits=(), decay_laws={3: law_of_decays([decay])})
    assert f"f = {found.decay_laws[3].frequency_hz.max():.2f} Hz" in sketch_modes(found).alt


def test_the_sketch_of_a_decay_shows_both_ends():
    decay = small_decay()
    sketch = sketch_decay(decay)
    assert "mode 3, modal mass 1" in sketch.svg
    for k in (0, -1):
        assert f"f = {with_std(decay.frequency_hz[k], decay.frequency_std_hz[k])} Hz" in sketch.svg
    assert "k(x)" in sketch_decay(replace(decay, mode=None, amplitude_unit="m")).svg


def test_the_first_sentence_of_a_decay_tells_no_damping_that_noise_makes():
    decay = small_decay()
    std = np.where(np.arange(decay.damping_std.size) < 3, decay.damping_std, np.abs(decay.damping_ratio))
    first = build_document(replace(decay, damping_std=std)).answer
    assert f"to {format_number(decay.amplitude[2], 3)} {decay.amplitude_unit}" in first
    assert f"{format_number(100 * decay.damping_ratio[2], 2)} %; noise hides the damping at other" in first
    sure = replace(decay, damping_std=0.01 * np.abs(decay.damping_ratio))
    assert "noise" not in build_document(sure).answer
    unknown = build_document(replace(decay, damping_std=np.abs(decay.damping_ratio))).answer
    assert "the damping is not known" in unknown
    assert "%" not in unknown


def test_a_decay_in_a_table_says_in_which_unit_its_amplitudes_are():
    decay = small_decay()
    assert f"amplitudes in {decay.amplitude_unit}" in repr(decay)
    assert "amplitudes in rad" in repr(replace(decay, mode=None, amplitude_unit="rad"))
