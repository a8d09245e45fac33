"""Numbers and files that no machine can hold are answered at once, in one sentence."""

import json

import pytest
from cli_runs import opid, refused

from opid.cli import group
from opid.errors import InputError
from opid.mechanics.truth import GearTruth
from opid.virtual.truth_file import read_truth


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("simulate", "taxi", "OUT", "--fs", "1e9"), "takes 4.8e+10 steps and 1.2e+04 GB"),
        (("simulate", "taxi", "OUT", "--duration", "1e9"), "give at most 2e+07 steps"),
        (("simulate", "taxi", "OUT", "--duration", "1e5", "--fs", "64"), "takes 4.1e+08 steps and 1e+02 GB"),
        (("simulate", "taxi", "OUT", "--fs", "1e9", "--duration", "0.01"), "give at most 2e+07 steps"),
        (("simulate", "taxi", "OUT", "--duration", "1e308"), "--duration"),
        (("simulate", "taxi", "OUT", "--duration", "1e400"), "--duration"),
        (("simulate", "taxi", "OUT", "--duration", "nan"), "--duration"),
        (("simulate", "taxi", "OUT", "--noise", "1e308"), "--noise"),
        (("simulate", "taxi", "OUT", "--noise", "inf"), "--noise"),
        (("simulate", "taxi", "OUT", "--friction", "1e308"), "--friction"),
        (("simulate", "taxi", "OUT", "--speed-start", "1e308"), "--speed-start"),
        (("simulate", "taxi", "OUT", "--speed-start", "1e15"), "at most 1000 m/s"),
        (("simulate", "taxi", "OUT", "--speed-start", "900", "--duration", "4000", "--fs", "64"), "at most 200000 m"),
        (("simulate", "taxi", "OUT", "--sprung-mass", "1e-320"), "--sprung-mass"),
        (("simulate", "aircraft", "OUT", "--duration", "1e9"), "give at most 2e+07 steps"),
        (("law", "bench.csv", "--lag-tolerance", "1e308"), "--lag-tolerance"),
        (("law", "bench.csv", "--mass-tolerance", "1e-320"), "--mass-tolerance"),
        (("law", "bench.csv", "--piston-area", "1e-320"), "--piston-area"),
        (("decay", "hit.csv", "--gain-tolerance", "nan"), "--gain-tolerance"),
        (("compare", "fleet", "--alarms-per-year", "1e308"), "--alarms-per-year"),
        (("simulate", "backbones", "OUT", "--points", "1000000000"), "3<=x<=10000"),
        (("simulate", "backbones", "OUT", "--curves", "1000000", "1"), "1<=x<=1000"),
        (("simulate", "resonance", "OUT", "--levels", "1000000"), "2<=x<=10000"),
        (("update", "study.toml", "--samples", "100000000000000000000"), "1000<=x<=100000000"),
        (("simulate", "taxi", "OUT", "--seed", "9" * 5000), "--seed"),
    ],
)
def test_sizes_that_no_machine_holds_are_refused_before_work(words, sentence, tmp_path):
    done = opid(*(tmp_path / "out" if word == "OUT" else word for word in words))
    assert done.exit_code == 2
    assert sentence in " ".join(done.output.replace("│", " ").split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("content", ["[" * 100_000, '{"schema": ' + "9" * 6000 + "}", "\x00", "[]", "3"])
def test_results_that_are_none_are_told(content, tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text(content, encoding="utf-8")
    refused(opid("compare", tmp_path / "one", tmp_path / "two"), "give the result.json of")


@pytest.mark.parametrize("content", ["x = " + "9" * 6000, "x = " + "[" * 3000 + "]" * 3000, "x = 1e400", "[a]\n[a]"])
def test_studies_that_are_none_are_told(content, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(content, encoding="utf-8")
    done = opid("identify", study)
    assert done.exit_code == 2
    assert "Traceback" not in done.output
    assert str(study) in done.output


def test_a_truth_that_nests_without_end_is_told(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text("[" * 100_000, encoding="utf-8")
    with pytest.raises(InputError, match="is not the truth of"):
        read_truth(path, GearTruth)


def test_memory_that_ends_is_one_sentence(monkeypatch, tmp_path):
    def fail(*given, **options):
        raise MemoryError("Unable to allocate 12 TiB")

    monkeypatch.setattr("opid.virtual.taxi_tests.taxiing.taxi_test", fail)
    done = opid("simulate", "taxi", tmp_path / "out")
    assert (done.exit_code, json.dumps(done.output).count("\\n")) == (group.BadInput.exit_code, 1)
    assert "needs more memory than there is (Unable to allocate 12 TiB)" in done.output
