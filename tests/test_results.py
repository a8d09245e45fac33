"""Results of every kind: text, page, JSON, a short summary, a table, and a frame, each by the same names."""

import json
import re
import shlex
from dataclasses import fields, is_dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from made_body import small_body
from made_fleet import draw_fleet, make_campaign
from made_flights import body_result, write_result
from made_health import sound_health
from made_modal import small_decay, small_result
from made_resonance import curves_study, held_study, two_modes
from made_updating import small_harmonics, small_responses, small_updating
from scripts import script

import opid
from opid.errors import InputError
from opid.estimate import Estimate
from opid.json_values import json_text
from opid.mechanics.laws.law import law
from opid.mechanics.truth import UpdatingTruth
from opid.modal.linear.frequency_response import resynthesised
from opid.modal.linear.modes import LinearModes
from opid.modal.linear.response_fit import fit_modes
from opid.modal.linear.stages import compare_stages
from opid.modal.resonance.identification import identify_resonance, identify_resonances
from opid.provenance import traced
from opid.report.writing import KINDS
from opid.result import SummaryRow
from opid.signals.health.result import Inspection
from opid.studies.study_file import read_study
from opid.suspensions.bench.law import law_of_bench
from opid.suspensions.bench.record import Bench
from opid.suspensions.fitting.repeatability import Repeatability
from opid.suspensions.flights.comparison import compare
from opid.suspensions.flights.fleet_comparison import compare_fleet
from opid.suspensions.flights.results import read_flights
from opid.suspensions.identification import identify
from opid.suspensions.own_structure import StructureIdentification
from opid.suspensions.planning.search import PlanSettings, plan_runs
from opid.suspensions.result import SpringEstimate
from opid.suspensions.sensing.settings import SensingSettings
from opid.suspensions.sensing.virtual_sensors import sense
from opid.suspensions.wheel.identification import identify_wheel
from opid.suspensions.wheel.result import WheelSettings


def gear(request, folder):
    return request.getfixturevalue("identified").result


def body(request, folder):
    return small_body()


def by_paper(request, folder):
    study = read_study(request.getfixturevalue("field_test") / "study.toml")
    return identify(study, method="classical", law="arctan_velocity")


def structure(request, folder):
    friction = law("arctan_velocity", amplitude_n=120.0, scale_m_per_s=0.02)
    found = {"amplitude_n": Estimate.normal(118.0, 2.0), "scale_m_per_s": Estimate.normal(0.021, 1e-3)}
    moved, zero = np.zeros(3), Estimate(0.0)
    stiffness, damping = Estimate.normal(1.2e5, 300.0), Estimate.normal(1.1e3, 9.0)
    laws = {"arctan_velocity": found}
    isolator = SpringEstimate("low", stiffness, damping, friction, laws, moved, moved, zero, ())
    inner = SpringEstimate("inner", Estimate.normal(3.5e5, 900.0), damping, law("linear"), {}, moved, moved, zero, ())
    return StructureIdentification(
        masses={"low": Estimate.normal(300.0, 1.0)},
        interfaces={"low": isolator},
        joints={"inner": inner},
        per_mass=False,
        noise_m_per_s2=5e-3,
        residual_over_noise=1.01,
        residual_of={"low": 1.0, "high": 1.02},
        left_out_over_noise=1.1,
        repeatability=Repeatability(0.0, False),
        limits=("the noise of the sensors limits the mass",),
        warnings=("run '1', 'low': it has an offset of 0.3 m/s^2",),
        not_determined=None,
        fit=None,
    )


def bench(request, folder):
    rng = np.random.default_rng(0)
    z, v = 0.01 * rng.standard_normal(2000), 0.3 * rng.standard_normal(2000)
    force = 2e4 * z + 500 * v + 800 * v * np.abs(v) + 5 * rng.standard_normal(2000)
    record = Bench(z, v, force, 500.0, 0.0, "recorded", None, {"force": "F", "travel": "z", "velocity": "v"}, ())
    return law_of_bench(record, title="damper.csv", candidates=("quadratic_damping", "cubic_damping"))


def flights(request, folder):
    rng = np.random.default_rng(1)
    return compare(read_flights([write_result(folder / f"flight {i}", body_result(rng)) for i in range(4)]))


def virtual_sensors(request, folder):
    found = request.getfixturevalue("identified").result
    few = SensingSettings(n_draws=10, n_counted=2)
    return sense(found.study, found, unsprung_mass_kg=Estimate.normal(105.0, 2.0), settings=few)


def wheel(request, folder):
    found = request.getfixturevalue("identified").result
    runs = tuple(replace(run, speed_m_per_s=9.0) for run in found.study.runs)
    few = WheelSettings(rejected_p=0.0, n_probes=2)
    return identify_wheel(replace(found.study, runs=runs), found, settings=few)


def planned(request, folder):
    found = request.getfixturevalue("identified").result
    return plan_runs(found, ["sprung_mass=0.05%"], settings=PlanSettings(n_draws=4, n_quick_draws=2))


def campaign(request, folder):
    return make_campaign(folder)


def fleet(request, folder):
    return compare_fleet(draw_fleet(harm=-0.05)[0])


def health(request, folder):
    return replace(sound_health(), log="logs/heavy taxi.csv")


def decay(request, folder):
    return small_decay()


def linear_modes(request, folder):
    pytest.importorskip("sdypy")
    known = LinearModes([20.0, 30.0], [0.01, 0.02], [[0.3, 0.2], [0.4, -0.3]], ("tip", "root"))
    return fit_modes([resynthesised(known, np.arange(10.0, 40.0, 0.05), "tip")], band_hz=(12.0, 38.0))


def mode_stages(request, folder):
    return compare_stages({"hammer": linear_modes(request, folder), "shaker": linear_modes(request, folder)})


def modal(request, folder):
    return small_result(decays=[small_decay()])


def resonance(request, folder):
    return identify_resonance(held_study(n_curves=3))


def curve_held_out(request, folder):
    return identify_resonance(curves_study(n_curves=5), hold_out="highest")


def resonances(request, folder):
    return identify_resonances(two_modes())


def updating(request, folder):
    return small_updating(responses=small_responses(), harmonics=small_harmonics())


def inspection(request, folder):
    return Inspection((health(request, folder), replace(sound_health(), log="light.csv")), ("heavy taxi", "light"))


OF_SUSPENSIONS = (gear, body, by_paper, structure, bench, virtual_sensors, wheel, planned, flights, campaign, fleet)
MAKERS = (
    *OF_SUSPENSIONS,
    health,
    inspection,
    decay,
    linear_modes,
    mode_stages,
    modal,
    resonance,
    curve_held_out,
    resonances,
    updating,
)


@pytest.fixture(scope="module", params=MAKERS, ids=lambda maker: maker.__name__)
def result(request, tmp_path_factory):
    return request.param(request, tmp_path_factory.mktemp("made"))


class Pieces(HTMLParser):
    """What stands between the tags of a page, tag by tag."""

    def __init__(self, text):
        super().__init__()
        self.inside, self.open = {}, []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "img", "br", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open:
            self.inside.setdefault(self.open[-1], []).append(data)


def test_text_and_page_are_made_of_it(result, tmp_path):
    text = opid.text(result)
    assert text.endswith("\n")
    assert max(map(len, text.splitlines())) <= 80
    said = []
    page = opid.write_report(result, tmp_path, progress=said.append)
    pieces = Pieces(page.read_text(encoding="utf-8"))
    assert pieces.open == []
    assert pieces.inside["h1"] == pieces.inside["title"]
    figures = set(re.findall(r'data-chart="([^"]+)"', page.read_text(encoding="utf-8")))
    assert {step.removeprefix("figure ") for step in said} == figures
    # no part of a formula is left that a browser or a terminal cannot show, and no number that is none
    words = [each for tag, parts in pieces.inside.items() if tag not in ("script", "style") for each in parts]
    for each in (text, *words):
        assert not re.search("[\ue000-\uf8ff]", each)
        assert not re.search(r"(?i)\b(nan|inf|infinity)\b", each)
    (data,) = tmp_path.glob("*.json")
    assert data.read_text(encoding="utf-8") == json_text(traced(result.to_dict(), result.files))
    assert data.name in page.read_text(encoding="utf-8")


def test_what_result_json_holds_is_plain_and_has_a_schema(result):
    document = result.to_dict()
    assert document["schema"].startswith("opid.")
    assert json.loads(json.dumps(document, allow_nan=False)) == document


# ---- schemas ---------------------------------------------------------------------------------------

SCHEMAS = Path(__file__).parent.parent / "docs" / "schemas"


def schema_of(document):
    name = document["schema"].removeprefix("opid.").replace("/", "-")
    return json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))


def shortened(value):
    """A document with lists of at most three items: as many as a row of a loading has."""
    if isinstance(value, dict):
        return {key: shortened(each) for key, each in value.items()}
    return [shortened(each) for each in value[:3]] if isinstance(value, list) else value


def spoiled(value, free):
    """Yield what was replaced, while in its place stands what JSON does not know, value by value of a document."""
    for key in list(value) if isinstance(value, dict) else range(len(value)):
        if key in free:
            continue
        before, value[key] = value[key], object
        yield f"{key!r}: {before!r}"
        value[key] = before
        if isinstance(before, (dict, list)):
            yield from (f"{key!r} > {each}" for each in spoiled(before, free))


def test_the_example_of_a_resonance_test_in_the_docs_fits_its_schema():
    page = (SCHEMAS.parent / "nonlinear_modal_models.md").read_text(encoding="utf-8")
    document = json.loads(page.split("```json")[1].split("```")[0])
    Draft202012Validator(schema_of(document)).validate(document)


def test_schemas_in_the_docs_are_those_of_the_records():
    stored = {path.name: path.read_text(encoding="utf-8") for path in SCHEMAS.iterdir()}
    assert stored == script("docs/schemas.py").schemas(), "run python docs/schemas.py"


def test_what_result_json_holds_is_as_its_schema_says(result):
    document = traced(result.to_dict(), result.files)
    Draft202012Validator(schema_of(document)).validate(document)


def test_what_is_not_as_the_schema_says_does_not_pass(result):
    document = shortened(traced(result.to_dict(), result.files))
    schema = schema_of(document)
    validator = Draft202012Validator(schema)
    validator.validate(document)
    free = {"settings", "diagnostics"}
    assert [what for what in spoiled(document, free) if validator.is_valid(document)] == []
    for key in schema["required"]:
        assert not validator.is_valid({name: each for name, each in document.items() if name != key})
    assert not validator.is_valid({**document, "remark": "more than the schema knows"})


def test_its_summary_has_typed_rows_with_distinct_names(result):
    rows = result.summary()
    assert rows
    assert all(isinstance(row, SummaryRow) for row in rows)
    names = [row.name for row in rows]
    assert len(set(names)) == len(names)
    for row in rows:
        assert row.unit
        assert row.value is None or isinstance(row.value, float)
        if row.interval95 is not None:
            assert row.interval95[0] <= row.value <= row.interval95[1]


def test_it_is_printed_in_ten_lines(result):
    lines = repr(result).splitlines()
    assert len(lines) <= 10
    assert lines[0].startswith(f"{type(result).__name__}: ")
    assert max(map(len, lines)) <= 240
    first = result.summary()[0]
    assert first.name in lines[1]
    assert first.unit == "1" or first.unit in lines[1]


def test_a_notebook_shows_a_table_of_it(result):
    pieces = Pieces(result._repr_html_())
    assert pieces.open == []
    assert len(pieces.inside["td"]) == 5 * len(result.summary())


def test_a_frame_is_made_of_it(result):
    pytest.importorskip("pandas")
    frame = result.to_frame()
    assert list(frame.columns) == ["value", "std", "low", "high", "unit"]
    for name, row in zip(frame.index, result.summary(), strict=True):
        assert name == row.name
        told = frame.loc[name]
        assert np.array_equal(
            [told["value"], told["std"]], [np.nan if x is None else x for x in (row.value, row.std)], equal_nan=True
        )
        assert told["unit"] == row.unit


def test_a_long_reason_does_not_make_the_summary_long():
    result = replace(small_body(), not_determined="the runs tell nothing " * 100)
    assert max(map(len, repr(result).splitlines())) <= 240
    assert "not determined: the runs tell nothing" in repr(result)


def test_names_of_a_page_are_escaped():
    result = replace(small_body(), study=replace(small_body().study, title="<script>alert(1)</script>"))
    assert "<script>" not in result._repr_html_()


# ---- all kinds -------------------------------------------------------------------------------------


def test_every_class_of_results_has_its_place_in_the_table():
    """A result that nobody can print is found here, not by its user."""
    package, bases = Path(opid.__file__).parent, {}
    for path in package.rglob("*.py"):
        module = ".".join(path.relative_to(package).with_suffix("").parts)
        found = re.findall(r"^class (\w+)\((.*)\):", path.read_text(encoding="utf-8"), re.MULTILINE)
        bases |= {f"{module}.{name}": set(re.findall(r"\w+", given)) for name, given in found}
    # a result is a Result, or of a class in between that nothing is only
    between = {name for name, given in bases.items() if "Result" in given and name.endswith("ResultOfStudy")}
    kinds = {"Result", *(name.rpartition(".")[2] for name in between)}
    classes = {name for name, given in bases.items() if given & kinds} - between
    assert classes == {kind.result for kind in KINDS}


def test_the_results_above_are_of_every_kind(request, tmp_path):
    made = {type(maker(request, tmp_path / maker.__name__)).__name__ for maker in MAKERS}
    assert made == {kind.result.rpartition(".")[2] for kind in KINDS}


def test_what_is_no_result_is_refused(tmp_path):
    for use in (opid.text, lambda what: opid.write_report(what, tmp_path / "report")):
        with pytest.raises(InputError, match=r"a float is no result of opid: give one of Identification, .*Updating"):
            use(3.0)
    assert not (tmp_path / "report").exists()


def test_a_truth_is_refused_where_nothing_is_compared_with_it():
    with pytest.raises(InputError, match="a result of type Health is compared with no truth: leave it out"):
        opid.text(sound_health(), UpdatingTruth({}, {}))
    with pytest.raises(InputError, match="ModalIdentification is compared with a ModalTruth, not with a Updating"):
        opid.text(small_result(), UpdatingTruth({}, {}))


@pytest.mark.parametrize("maker", [bench, flights, campaign, health, modal, updating], ids=lambda maker: maker.__name__)
def test_the_command_of_a_page_is_quoted_for_the_shell(maker, request, tmp_path):
    """Names with blanks and quotes come out of the shell as they went in."""
    found, odd = maker(request, tmp_path / "in"), "it's a log.csv"
    if maker is bench:
        found = replace(found, bench=replace(found.bench, log=odd, channels={"force": "F [kN]", "travel": "z"}))
    elif maker is health:
        found = replace(found, log=odd)
    elif maker in (modal, updating):
        found = replace(found, settings={**found.settings, "study": odd})
    elif maker is campaign:
        odd = str(found.source)
    else:
        odd = str(found.flights[0].path)
        assert " " in odd
    page = opid.write_report(found, tmp_path / "out").read_text(encoding="utf-8")
    command = next(each for each in Pieces(page).inside["pre"] if each.startswith("opid "))
    assert odd in shlex.split(command)
    if maker is bench:
        assert shlex.split(command)[3:5] == ["--force-channel", "F [kN]"]


def test_results_are_frozen_records(result):
    assert is_dataclass(result)
    assert fields(result)
    with pytest.raises(AttributeError):
        result.warnings = ()
