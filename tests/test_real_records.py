"""Real records of structures measured on both sides and of test benches, by the study files in `examples/real_records`.

What is asked holds of every record of a set; other records of the same sets are kept elsewhere.
"""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from measured_data import DATA, measured
from scripts import script

from opid.errors import InputError
from opid.signals.health.across_channels import check_pair
from opid.studies.bench_study import read_bench_tables
from opid.studies.study_file import read_study
from opid.studies.suspension_study import read_suspension_tables
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.identification import identify


@pytest.fixture(scope="module")
def records():
    return script("examples/real_records.py")


@pytest.fixture
def found(records, tmp_path):
    """The identification of some records of a set, those that its study names where none are given."""

    def of(name, chosen=(), **options):
        measured(records.folder_of(name, Path()))
        study = read_study(records.write_logs(name, DATA, tmp_path, chosen))
        return identify(study, band_hz=records.SETS[name].band_hz, **options)

    return of


def test_each_set_has_a_sound_study_that_names_the_band_of_its_script(records):
    files = {path.stem: path.read_text() for path in records.STUDIES.glob("*.toml")}
    assert files.keys() == records.SETS.keys()
    for name, text in files.items():
        document = tomllib.loads(text)
        read = read_bench_tables if "[bench]" in text else read_suspension_tables
        assert read(document)[1] == []
        band_hz = records.SETS[name].band_hz
        command = f"opid law records/{name}.toml\n"
        if band_hz is not None:
            command = f"opid identify records/{name}.toml --band {band_hz[0]:g} {band_hz[1]:g} "
        assert command in text


@pytest.mark.slow
def test_a_building_on_rubber_isolators_is_answered_as_far_as_one_mass_goes(found):
    """Its floors bend and its rubber remembers: the model is the limit, and the other quakes predict each of them."""
    result = found("isolated_building", law="dahl_friction")
    assert result.limited_by == "model"
    assert not result.is_refused
    assert result.parameters.sprung_mass_kg.value is None
    linear = found("isolated_building", law="linear")
    straight, bent = (np.mean([run.unexplained for run in each.runs]) for each in (linear, result))
    assert bent < 0.8 * straight
    for left_out in result.evidence[0].error.left_out:
        assert left_out.unexplained < 0.8
        assert left_out.inside > 0.8
    for equivalent in result.equivalents:
        frequency = equivalent.natural_frequency_hz
        assert 0.25 < frequency.value < 0.6
        assert frequency.std > 0.02 * frequency.value


@pytest.mark.slow
def test_the_law_that_is_searched_predicts_a_quake_that_was_left_out(found):
    """Three quakes to a quarter of their motion; the fourth moves the isolators twice as far as the others do."""
    result = found("isolated_building")
    assert result.law.has_memory
    left_out = sorted(each.unexplained for each in result.evidence[0].error.left_out)
    assert left_out[2] < 0.25
    assert left_out[3] < 0.5
    assert all(each.inside > 0.9 for each in result.evidence[0].error.left_out)


@pytest.mark.parametrize(
    ("name", "kinds", "law"),
    [
        ("sliding_isolators_bench", None, "coulomb_friction"),
        ("water_impact", None, "linear"),
        ("mr_damper", ("arctan_velocity", "lugre_friction", "dahl_friction"), "lugre_friction"),
        ("friction_damper_brfd", ("arctan_velocity", "iwan_friction", "bouc_wen"), "bouc_wen"),
    ],
)
def test_the_study_of_a_bench_has_the_law_of_its_record(records, name, kinds, law):
    measured(records.folder_of(name, Path()))
    found = law_of_bench(records.read_set(name, DATA), candidates=kinds)
    assert found.not_determined is None
    assert found.law.name == law
    assert found.r2_left_out > 0.94


def test_a_stiff_frame_has_one_frequency_and_one_delay_in_all_records(records, found):
    """Two trials of an earthquake agree to half a per cent; a slow sine, which tells its frequency to 1.6 %, to one.

    The delays lie within 0.3 ms. It passes for no exchanged pair.
    """
    results = [found("shake_table_frame", (name,), law="linear") for name in records.records_of("shake_table_frame")]
    frequencies = [each.ratios.natural_frequency_hz for each in results]
    *quakes, sine = [each.value for each in frequencies]
    np.testing.assert_allclose(quakes, quakes[0], rtol=0.005)
    np.testing.assert_allclose(sine, quakes, rtol=0.01)
    assert all(frequencies[-1].holds(each) for each in quakes)
    lags = [each.evidence[0].fit.value("lag_s") for each in results]
    np.testing.assert_allclose(lags, lags[0], atol=3e-4)
    for result in results:
        assert not result.is_refused
        assert check_pair(*sides_of(result), names=("ground", "floors"), fs=result.study.fs) == ()


def sides_of(result):
    log = result.study.runs[0].recording
    return log.channel("ground"), log.channel("floors")


def test_a_flexible_frame_is_one_mass_as_far_as_its_first_bending(found):
    """The mean of its floors is the mass above its lowest columns, which swings at 3.76 Hz."""
    result = found("flexible_frame", law="linear")
    assert not result.is_refused
    frequency = result.ratios.natural_frequency_hz
    assert frequency.value == pytest.approx(3.76, rel=0.01)
    assert frequency.std < 0.01 * frequency.value
    assert result.runs[0].unexplained < 0.25


def test_a_bench_of_a_quarter_car_is_answered_and_its_runs_predict_each_other(found):
    """Plates that rub on their rails are forces that nobody measured; the line through them is the suspension."""
    result = found("quarter_car_bench", law="linear")
    assert not result.is_refused
    assert result.parameters.sprung_mass_kg.value is None
    for left_out in result.evidence[0].error.left_out:
        assert left_out.unexplained < 0.5
        assert left_out.inside > 0.8
    frequencies = [each.natural_frequency_hz.value for each in result.equivalents]
    np.testing.assert_allclose(frequencies, frequencies[0], rtol=0.01)


def write_frames(path, names, *, slip):
    """Records of a frame on a table that swings, whose base follows it or slides against it."""
    t = np.arange(2048) / 256.0
    swing = np.sin(2 * np.pi * 1.5 * t) * np.sin(np.pi * t / t[-1])
    channels = {}
    for name in names:
        table_m = 0.02 * swing
        channels[f"{name}/aextx"] = np.gradient(np.gradient(table_m, t), t) / 9.80665
        for storey in (2, 3, 4, 5):
            channels[f"{name}/s{storey}"] = (1 - slip) * table_m / 0.0254
    np.savez(path, **channels)


def test_records_are_those_that_files_of_any_name_hold(records, tmp_path):
    write_frames(tmp_path / "tuesday.npz", ["one", "two"], slip=0.0)
    assert records.records_in("sliding_isolators", tmp_path) == ("one", "two")
    assert records.records_in("sliding_isolators", tmp_path / "tuesday.npz") == ("one", "two")
    assert records.default_records("sliding_isolators", tmp_path) == ("one", "two")
    write_frames(tmp_path / "wednesday.npz", ["two"], slip=0.0)
    assert records.records_in("sliding_isolators", tmp_path) == ("one", "tuesday_two", "wednesday_two")
    study = read_study(records.write_logs("sliding_isolators", tmp_path, tmp_path / "out", ("wednesday_two",)))
    assert study.runs[0].name == "wednesday_two"
    # a file of one record each
    assert records.records_in("quarter_car_bench", tmp_path) == ("tuesday", "wednesday")


def test_a_record_or_a_channel_that_is_not_there_ends_in_a_list_of_those_that_are(records, tmp_path):
    write_frames(tmp_path / "tuesday.npz", ["one"], slip=0.0)
    with pytest.raises(InputError, match=r"no record 'three' of sliding_isolators .* it has one$"):
        records.read_set("sliding_isolators", tmp_path, ("three",))
    with pytest.raises(InputError, match=r"has no one/pos, one/ay: it holds one/aextx, one/s2, one/s3"):
        records.read_set("water_impact", tmp_path, ("one",))
    with pytest.raises(InputError, match=r"has no time_s, tyre_plate_m, body_plate_m: it holds one/aextx"):
        records.read_set("quarter_car_bench", tmp_path, ("tuesday",))
    with pytest.raises(InputError, match="no records of mr_damper"):
        records.read_set("mr_damper", tmp_path / "out", ("voltage_on",))
    with pytest.raises(InputError, match="a law is that of one record, and 2"):
        records.write_logs("water_impact", tmp_path, tmp_path / "out", ("one", "two"))


def test_a_base_that_never_slips_is_said_to(records, tmp_path):
    write_frames(tmp_path / "bolted.npz", ["bolted"], slip=0.0)
    write_frames(tmp_path / "loose.npz", ["loose"], slip=0.9)
    with pytest.raises(InputError, match=r"the base never slips in bolted: .* slide for so long: loose$"):
        records.read_set("sliding_isolators_bench", tmp_path, ("bolted",))
    assert records.read_set("sliding_isolators_bench", tmp_path, ("loose",)).bench.samples.size >= records.LEAST_SAMPLES


def test_the_command_of_the_example_ends_in_one_sentence(records, tmp_path, monkeypatch):
    write_frames(tmp_path / "tuesday.npz", ["one"], slip=0.0)
    said = ["sliding_isolators_bench", "--data", str(tmp_path), "--records", "one", "--out", str(tmp_path / "out")]
    monkeypatch.setattr("sys.argv", ["real_records.py", *said])
    with pytest.raises(SystemExit, match=r"^sliding_isolators_bench: the base never slips in one"):
        records.main()


@pytest.fixture(scope="module")
def as_recorded():
    """The identification of each record of a study of the docs that names the files of a set as they are."""
    bench = script("benchmarks/real_records.py")

    def of(title, law="linear"):
        folder, band_hz = bench.AS_RECORDED[title]
        records = bench.studies_of_records(bench.studies_as_recorded()[title], measured(folder))
        return {name: bench.identify_document(document, law, band_hz) for name, document in records}, bench

    return of


def test_a_frame_that_rubs_on_a_wall_is_told_so_from_its_own_files(as_recorded):
    found, _ = as_recorded("friction frame, as recorded")
    for result in found.values():
        assert result.is_refused
        frequency, std = re.search(r"frequency of ([\d.]+) ± ([\d.]+) Hz", result.not_determined).groups()
        # that of the mass and the stiffness that its owners state
        assert abs(float(frequency) - 3.13) < 2 * float(std)


def test_a_quarter_car_is_answered_from_its_own_files(as_recorded):
    found, _ = as_recorded("quarter car, as recorded")
    frequencies = [each.ratios.natural_frequency_hz for each in found.values()]
    for one in frequencies:
        for other in frequencies:
            assert abs(one.value - other.value) < 1.96 * np.hypot(one.std, other.std)
    lags_s = [each.evidence[0].fit.value("lag_s") for each in found.values()]
    assert np.ptp(lags_s) < 2e-4


def test_frames_on_a_shake_table_are_answered_from_their_own_files(as_recorded):
    """Lags within 0.2 ms and angles within half a degree; the intervals hold what the quietest record says."""
    found, bench = as_recorded("stiff frame, as recorded")
    lags_s = [each.evidence[0].fit.value("lag_s") for each in found.values()]
    assert np.ptp(lags_s) < 2e-4
    assert np.ptp([bench.angle_deg(each) for each in found.values()]) < 0.5
    for result in found.values():
        assert result.ratios.natural_frequency_hz.holds(22.03)
        assert result.ratios.damping_ratio.holds(0.004)
    flexible, _ = as_recorded("flexible frame, as recorded")
    for result in flexible.values():
        assert result.ratios.natural_frequency_hz.holds(3.765)


def test_the_exported_files_of_both_sensors_are_matched_without_a_word_about_their_clocks(as_recorded):
    found, bench = as_recorded("stiff frame, as exported")
    for result in found.values():
        assert result.ratios.natural_frequency_hz.holds(22.03)
        assert abs(result.study.runs[0].clocks[0].offset_s + 0.0193) < 5e-4
        assert bench.angle_deg(result) == pytest.approx(-6.5, abs=0.5)
