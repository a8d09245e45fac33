"""Where a result comes from: version, time and the files that were read, in what is written of every kind of result."""

import hashlib
import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from cli_runs import opid as command
from made_modal import small_study
from made_updating import small_updating

import opid
from opid.errors import InputError
from opid.provenance import ReadFile, read_file, time_of_writing, traced
from opid.signals.resampling import on_common_clock, resampled


def hash_of(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def log(tmp_path):
    columns = np.random.default_rng(0).standard_normal((2, 512))
    opid.write_log(opid.signals.recording_from_arrays(columns, ["a", "b"], fs=256.0), tmp_path / "run.csv")
    return tmp_path / "run.csv"


def test_the_time_is_now_or_as_stated(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert time_of_writing() == "2023-11-14T22:13:20+00:00"
    for none in ("abc", "1.5", "-5", "9" * 12, "9" * 5000):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", none)
        with pytest.raises(InputError, match="SOURCE_DATE_EPOCH is '"):
            time_of_writing()
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    assert abs((datetime.now(UTC) - datetime.fromisoformat(time_of_writing())).total_seconds()) < 3600


def test_a_file_is_named_once_with_the_hash_of_what_it_holds(log):
    read = read_file(log)
    assert read == ReadFile(str(log), hash_of(log))
    document = traced({"a": 1, "schema": "opid.x/1"}, [read, read])
    assert list(document) == ["schema", "provenance", "a"]
    assert document["provenance"] == {
        "opid": opid.__version__,
        "written": time_of_writing(),
        "files": [{"name": str(log), "sha256": hash_of(log)}],
    }


def test_a_recording_keeps_the_file_that_it_was_read_from(log):
    recording = opid.read_log(log)
    expected = (ReadFile(str(log), hash_of(log)),)
    assert recording.files == expected
    assert resampled(recording, 100.0).files == expected
    assert recording.section(0.5, 1.5).files == expected
    renamed = opid.read_log(log, channels={"c": opid.signals.ChannelSettings("a")})
    assert on_common_clock([recording, renamed]).files == expected
    assert opid.inspect(opid.signals.open_log(log)).files == opid.inspect(recording).files == expected
    made = opid.signals.recording_from_arrays([[0.0, 1.0]], ["a"], fs=2.0)
    assert made.files == opid.inspect(made).files == ()


def test_a_result_names_study_and_logs_as_they_were_read(field_test, identified, tmp_path):
    expected = [{"name": str(field_test / name), "sha256": hash_of(field_test / name)} for name in READ]
    opid.write_report(identified.result, tmp_path, figures=False)
    told = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert told["provenance"] == {"opid": opid.__version__, "written": time_of_writing(), "files": expected}
    flight = opid.suspensions.read_flights([tmp_path, field_flight(tmp_path, told)]).flights[0]
    assert flight.file == read_file(tmp_path / "result.json")


READ = ("study.toml", "heavy.csv", "light.csv")


def field_flight(folder, document):
    """The same result with another mass, as another flight."""
    other = folder / "other"
    other.mkdir()
    document["parameters"]["sprung_mass_kg"]["value"] += 1.0
    (other / "result.json").write_text(json.dumps(document), encoding="utf-8")
    return other


def test_benches_modal_tests_and_backbones_name_theirs(tmp_path, log):
    of_log = (read_file(log),)
    rng = np.random.default_rng(1)
    recording = opid.signals.recording_from_arrays(
        [0.01 * rng.standard_normal(512), rng.standard_normal(512)], ["stroke", "load"], fs=512.0, unit=["m", "N"]
    )
    recording = replace(recording, files=of_log)
    bench = opid.suspensions.bench_from_recording
    assert bench(recording, force="load", travel="stroke").files == of_log
    assert opid.suspensions.quasi_static_bench(recording, force="load", travel="stroke").files == of_log
    opid.write_study(small_study(), tmp_path / "study.toml")
    study = opid.read_study(tmp_path / "study.toml", kind=opid.modal.ModalStudy)
    logs = [f"{each.test.name}.csv" for each in study.tests]
    expected = {read_file(tmp_path / name) for name in ("study.toml", "modes.npz", *logs)}
    assert {file for each in study.tests for file in each.test.recording.files} == expected
    (curve, *_) = small_updating().measured
    opid.updating.write_backbone(curve, tmp_path / "curve.csv")
    read = opid.updating.read_backbone(
        tmp_path / "curve.csv", mode=curve.mode, controlled_sensor=curve.controlled_sensor
    )
    assert read.files == (read_file(tmp_path / "curve.csv"),)
    assert replace(small_updating(), measured=(read,)).files == read.files


def test_inspect_names_its_logs(log):
    told = command("inspect", log, "--json")
    assert json.loads(told.stdout)["provenance"]["files"] == [{"name": str(log), "sha256": hash_of(log)}]
