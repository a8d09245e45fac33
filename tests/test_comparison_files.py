"""Results of flights as files: what is read, what is left out with its reason, and what cannot be compared."""

import json

import numpy as np
import pytest
from made_flights import body_result, day, gear_result, write_result

from opid.errors import InputError, NotDeterminedError
from opid.suspensions.flights.comparison import compare
from opid.suspensions.flights.results import read_flights


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(1)
    for i in (2, 0, 1):
        write_result(tmp_path / f"flight{9 - i}" / "out", body_result(rng, day=day(i)))
    return tmp_path


def test_a_folder_of_studies_is_read_by_date(folder):
    flights = read_flights([folder])
    assert [flight.name for flight in flights.flights] == ["flight9", "flight8", "flight7"]
    assert flights.dated
    assert flights.notes == flights.left_out == ()
    quantities = {(q.gear, q.name, q.unit) for q in flights.flights[0].values}
    assert ("left", "friction", "N") in quantities
    assert ("", "mass", "kg") in quantities
    assert len(quantities) == 10
    assert read_flights(sorted(folder.iterdir())).flights[0].name == "flight9"
    assert read_flights(sorted(folder.rglob("result.json"))).flights[0].name == "flight9"


def test_without_dates_the_order_given_is_taken_and_said(tmp_path):
    rng = np.random.default_rng(1)
    folders = [write_result(tmp_path / name, gear_result(rng)) for name in ("b_result", "a_result")]
    flights = read_flights(folders)
    assert [flight.name for flight in flights.flights] == ["b", "a"]
    assert not flights.dated
    assert "2 of 2 results have no date (b, a)" in compare(flights).warnings[0]


def test_results_per_unit_of_mass_are_compared_with_each_other(tmp_path):
    rng = np.random.default_rng(1)
    folders = [write_result(tmp_path / f"f{i}", gear_result(rng, day=day(i), per_mass=True)) for i in range(3)]
    result = compare(read_flights(folders))
    assert {series.quantity.unit for series in result.series} == {"1/s^2", "1/s", "N/kg"}
    absolute = [write_result(tmp_path / f"absolute{i}", gear_result(rng, day=day(3 + i))) for i in range(2)]
    flights = read_flights([*folders, absolute[0]])
    assert [flight.name for flight in flights.flights] == ["f0", "f1", "f2"]
    (told,) = flights.left_out
    assert told.name == "absolute0"
    assert told.sentence == "'absolute0' is left out: its values are not per unit of mass, and those of the others are"
    # two that are absolute come before any number of the others
    flights = read_flights([*folders, *absolute])
    assert [flight.name for flight in flights.flights] == ["absolute0", "absolute1"]
    assert flights.left_out[0].sentence == "'f0' is left out: it is not determined: no mass change"
    assert [each.name for each in flights.left_out] == ["f0", "f1", "f2"]


REFUSAL = (
    "no number is reported: the structure leaves 90 times the sensors' noise (most at 'right: upper': 127, the others "
    "1); check channels (exchanged, upside down); or coordinates"
)
SAME_LOADING = "all runs have the same loading: only ratios are determined; give `loading`"


def tables_of(document):
    """All estimates of a body's result."""
    for interface in document["interfaces"]:
        yield from (interface["stiffness"], interface["damping"])
        yield from (table for parameters in interface["law"].values() for table in parameters.values())
    yield from document["parameters"].values()


def spoilt(document, how):
    """The result of a body as `opid identify` writes it where it has something to refuse."""
    document["structure"] |= {"recommended": None, "residual_over_noise": 1.05}
    if how == "refused":
        document |= {"not_determined": REFUSAL}
        for table in tables_of(document):
            table |= {"value": None, "std": None, "interval95": None}
    elif how == "per mass":
        document |= {"not_determined": SAME_LOADING}
        document["structure"]["recommended"] = "rigid_body"
        document["parameters"]["sprung_mass_kg"] |= {"value": None, "std": None, "interval95": None}
        for interface in document["interfaces"]:
            interface["stiffness"]["unit"], interface["damping"]["unit"] = "1/s^2", "1/s"
    else:
        document["candidates"] = [{"kind": "rigid_body", "left_out_over_noise": 4.536}]
        for table in tables_of(document) if how == "without intervals" else ():
            table |= {"std": None, "interval95": None}
    return document


NOT_RECOMMENDED = "no structure was recommended for it (4.54 times the noise)"


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ("refused", f"it is not determined: {REFUSAL}"),
        ("per mass", f"it is not determined: {SAME_LOADING}"),
        ("without intervals", NOT_RECOMMENDED),
        ("with intervals", NOT_RECOMMENDED),
    ],
)  # fmt: skip
def test_a_flight_that_tells_nothing_is_left_out_with_its_own_reason(how, why, folder, tmp_path):
    without = compare(read_flights([folder]))
    document = spoilt(body_result(np.random.default_rng(2), day=day(3)), how)
    other = write_result(tmp_path / "odd" / "deeper" / "f4", document)
    result = compare(read_flights([folder, other]))
    assert result.warnings[0] == f"'f4' is left out: {why}"
    assert result.series == without.series
    with pytest.raises(NotDeterminedError) as caught:
        read_flights([folder / "flight7", other])
    told = f"of 2 flights 'flight7' alone can be compared, and two are needed: 'f4' is left out: {why}"
    assert str(caught.value) == told


def test_the_kind_of_a_flight_that_is_left_out_does_not_matter(folder, tmp_path):
    document = spoilt(body_result(np.random.default_rng(2), day=day(3)), "refused")
    document["structure"]["kind"] = "single"
    flights = read_flights([folder, write_result(tmp_path / "f4" / "odd" / "deep", document)])
    assert [flight.structure for flight in flights.flights] == 3 * ["rigid_body"]


def test_a_study_without_a_result_is_said(folder):
    (folder / "flight1").mkdir()
    (folder / "notes").mkdir()
    (folder / "flight8" / "study.toml").touch()
    assert read_flights([folder]).left_out == ()
    (folder / "flight1" / "study.toml").touch()
    told = f"{str(folder / 'flight1')!r} holds no result.json and is left out: run `opid identify` there"
    assert [each.sentence for each in read_flights([folder]).left_out] == [told]
    # the result of a study may stand beside it
    rng = np.random.default_rng(2)
    write_result(folder / "flight1_result", body_result(rng, day=day(3)))
    flights = read_flights([folder])
    assert (len(flights.flights), flights.left_out) == (4, ())


def test_one_result_beside_a_study_without_one_is_no_comparison(tmp_path):
    write_result(tmp_path / "f1", gear_result(np.random.default_rng(0)))
    (tmp_path / "f2").mkdir()
    (tmp_path / "f2" / "study.toml").touch()
    with pytest.raises(InputError, match=r"1 result is given .*give two or more to compare; .*f2' holds no result"):
        read_flights([tmp_path])


def test_shared_gears_are_one_series(tmp_path):
    rng = np.random.default_rng(1)
    for i in range(2):
        document = body_result(rng, day=day(i))
        left = document["interfaces"][1]
        document["interfaces"][2] = {**left, "name": "right", "shared_with": ["left"]}
        left["shared_with"] = ["right"]
        write_result(tmp_path / f"f{i}", document)
    gears = {series.quantity.gear for series in compare(read_flights([tmp_path])).series}
    assert gears == {"", "nose", "left, right"}


def test_laws_of_other_kinds_are_not_compared_and_said(tmp_path):
    rng = np.random.default_rng(1)
    kinds = ["arctan_velocity", "arctan_velocity", "coulomb_friction"]
    folders = [write_result(tmp_path / f"f{i}", gear_result(rng, day=day(i), kind=k)) for i, k in enumerate(kinds)]
    result = compare(read_flights(folders))
    friction = [series for series in result.series if series.quantity.name == "friction"]
    assert [series.quantity.kind for series in friction] == ["arctan_velocity"]
    assert friction[0].points[2].status == "no value"
    told = " ".join(result.warnings)
    assert "the law of 'gear' is arctan_velocity, but coulomb_friction in 'f2'" in told
    assert "'f2' (2026-01-19): friction force (arctan_velocity) of 'gear' have no value" in told


def test_values_without_intervals_are_not_judged_and_said(tmp_path):
    rng = np.random.default_rng(1)
    folders = []
    for i in range(3):
        document = gear_result(rng, day=day(i))
        if i == 1:
            stiffness = document["parameters"]["suspension_stiffness_n_per_m"]
            stiffness["std"] = stiffness["interval95"] = None
        folders.append(write_result(tmp_path / f"f{i}", document))
    result = compare(read_flights(folders))
    series = next(each for each in result.series if each.quantity.name == "stiffness")
    assert [point.status for point in series.points] == ["first", "no interval", "as expected"]
    assert any("'f1' (2026-01-12): stiffness of 'gear' have no interval" in each for each in result.warnings)
    for folder in folders:
        document = json.loads((folder / "result.json").read_text())
        for table in [
            *document["parameters"].values(),
            document["law"]["parameters"]["arctan_velocity"]["amplitude_n"],
        ]:
            table["std"] = table["interval95"] = None
        document["method"] = "paper"
        (folder / "result.json").write_text(json.dumps(document))
    with pytest.raises(NotDeterminedError, match=r"two flights.*the method paper, and the default method gives interv"):
        compare(read_flights(folders))


def test_bad_input_is_one_sentence_each(folder, tmp_path):
    one = tmp_path / "flight7"
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="there is no file or folder"):
        read_flights([tmp_path / "nothing"])
    with pytest.raises(InputError, match=r"there is no result.json in .*empty"):
        read_flights([tmp_path / "empty"])
    with pytest.raises(InputError, match="1 result is given"):
        read_flights([one])
    with pytest.raises(InputError, match="given more than once"):
        read_flights([one, tmp_path / "flight8", one / "out" / "result.json"])
    text = (one / "out" / "result.json").read_text()
    copy = write_result(tmp_path / "copy", json.loads(text))
    with pytest.raises(InputError, match="hold the same numbers"):
        read_flights([one, copy])
    single = write_result(tmp_path / "single", gear_result(np.random.default_rng(0)))
    with pytest.raises(InputError, match=r"of different structures, 'single gear'.*'rigid_body'"):
        read_flights([one, single])
    for content, words in (
        ("nonsense", "is no JSON"),
        ("[1]", "has no schema where 'opid.identification/1' is needed"),
        ('{"schema": "opid.law/1"}', "has the schema 'opid.law/1'"),
        (
            '{"schema": "opid.identification/1"}',
            "is no valid result: method is missing, text is needed; parameters is missing, a table is needed; law is "
            "missing, a table is needed: write it again",
        ),
        (
            text.replace('"value": ', '"value": "x", "other": ', 1),
            r"result.json is no valid result: parameters.sprung_mass_kg.value is 'x' where a number is needed: write",
        ),
        (text.replace('"2026-01-19"', '"5.1.26"'), "date is '5.1.26' where a date like '2026-03-01' is needed"),
        (text.replace('"interfaces": [', '"interfaces": [3, '), r"interfaces\[0\] is 3 where a table is needed"),
        (text.replace('"law": {', '"law": {"gas_column": {}, '), "law.gas_column.static_force_n is missing"),
        (
            text.replace('"std": ', '"std": NaN, "other": '),
            "is no JSON .it holds NaN, and JSON has no number without an end",
        ),
    ):
        (copy / "result.json").write_text(content)
        with pytest.raises(InputError, match=words):
            read_flights([one, copy])
    with pytest.raises(InputError, match="chance of a false alarm is 2: give one"):
        compare(read_flights([folder / "flight7", folder / "flight8"]), false_alarm=2)


def test_what_two_flights_cannot_tell_is_said(folder):
    told = " ".join(compare(read_flights([folder / "flight7", folder / "flight8"])).warnings)
    assert "with 2 flights the scatter between flights cannot be estimated" in told


def test_a_gear_of_one_flight_is_said(tmp_path):
    rng = np.random.default_rng(1)
    for i in range(3):
        document = body_result(rng, day=day(i))
        if i == 1:
            document["interfaces"][0]["name"] = "front"
        write_result(tmp_path / f"f{i}", document)
    told = " ".join(compare(read_flights([tmp_path])).warnings)
    assert "'front' occurs only in 'f1' (2026-01-12), so it is not compared" in told
    assert "stiffness of 'nose', damping of 'nose'" in told
