"""Every tuned number of the estimator is a field of a record, with its reason, and can be passed."""

import re
from dataclasses import FrozenInstanceError, asdict, fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path

import pytest
from law_runs import study_of

from opid.errors import InputError
from opid.signals.health.settings import HealthSettings
from opid.signals.health.spikes import SpikeSettings
from opid.signals.segments import SegmentSettings
from opid.suspensions import settings
from opid.suspensions.bench.settings import BenchSettings
from opid.suspensions.flights.departures import FlightSettings
from opid.suspensions.flights.fleet_model import FleetSettings
from opid.suspensions.identification import identify
from opid.suspensions.paper.settings import PaperSettings
from opid.suspensions.planning.search import PlanSettings
from opid.suspensions.sensing.settings import SensingSettings
from opid.suspensions.settings import RegressionSettings, RunSettings, Settings, Verdicts
from opid.suspensions.study import StructureSettings
from opid.suspensions.wheel.result import WheelSettings

ROOM = Path(settings.__file__).parent


def records_of_the_wing():
    """Every settings record that any file of the wing defines, and the verdicts."""
    found = {Verdicts}
    for path in sorted(ROOM.rglob("*.py")):
        names = path.relative_to(ROOM.parent.parent).with_suffix("").parts
        module = import_module(".".join(names))
        found |= {each for each in vars(module).values() if isinstance(each, type) and is_settings(each)}
    return sorted(found, key=lambda record: record.__name__)


def is_settings(record):
    # what a study says of its structure is no number that somebody tuned
    return is_dataclass(record) and record.__name__.endswith("Settings") and record is not StructureSettings


RECORDS = [each for each in records_of_the_wing() if each.__module__.startswith("opid.suspensions.")]
TUNED = [record for record in dict.fromkeys(RECORDS) if record is not Settings]
OF_SIGNALS = (HealthSettings, SegmentSettings, SpikeSettings)
FIELDS = [(record, field.name) for record in (*TUNED, *OF_SIGNALS) for field in fields(record)]


@pytest.mark.parametrize(("record", "name"), FIELDS, ids=lambda each: each if isinstance(each, str) else each.__name__)
def test_every_field_has_its_reason(record, name):
    """A sentence of its own under Args, of more words than its name has."""
    arguments = record.__doc__.split("Args:")[1]
    found = re.search(rf"^\s+{name}: (.+?)(?=^\s+\w+: |\Z)", arguments, re.S | re.M)
    assert found, f"{record.__name__} does not explain {name}"
    assert len(found[1].split()) >= 3


def test_records_are_frozen_and_have_defaults():
    for record in RECORDS:
        with pytest.raises(FrozenInstanceError):
            setattr(record(), fields(record)[0].name, None)


def test_all_records_are_part_of_the_settings():
    """Nothing that is tuned stands beside them."""
    parts = {type(getattr(Settings(), field.name)) for field in fields(Settings)}
    in_file = {each for each in vars(settings).values() if isinstance(each, type) and is_dataclass(each)}
    assert parts == in_file - {Settings}


def parts_of(record):
    """The records of the wing that stand in a record."""
    inside = [type(getattr(record, field.name)) for field in fields(record)]
    return {each for each in inside if is_dataclass(each) and each.__module__.startswith("opid.suspensions.")}


def test_every_record_of_the_wing_can_be_passed_and_is_printed():
    """It is part of the settings of the estimator, the paper's chain, bench, flights, plans, sensing or the wheel."""
    own = (Settings, PaperSettings, BenchSettings, FlightSettings, FleetSettings, PlanSettings, SensingSettings)
    own += (WheelSettings,)
    reached, waiting = set(), [record() for record in own]
    while waiting:
        record = waiting.pop()
        reached.add(type(record))
        waiting += [each() for each in parts_of(record) - reached]
    assert set(RECORDS) == reached
    assert asdict(Settings())["regression"]["n_passes"] == RegressionSettings().n_passes


@pytest.mark.slow
def test_settings_of_the_regression_reach_it():
    pytest.importorskip("pysindy")
    study, none = study_of(duration_s=12), Settings(regression=RegressionSettings(n_passes=0))
    result = identify(study, method_of_law="sparse regression", settings=none)
    assert result.settings == none
    assert not any(step.method == "sparse regression" for step in result.evidence[0].ladder)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"method_of_law": "both"},
            "method_of_law is 'both', which the method 'classical' does not know: leave it out",
        ),
        ({"seed": 3}, "seed is 3, which the method 'classical' does not know"),
        ({"settings": Settings()}, "settings are those of the method 'model', .* give PaperSettings to"),
        ({"method": "model", "high_pass_hz": 0.5}, "high_pass_hz is 0.5, and the method 'model' integrates nothing"),
    ],
)
def test_arguments_that_a_method_does_not_know_are_refused(given, words):
    with pytest.raises(InputError, match=words):
        identify(study_of(duration_s=12), **({"method": "classical"} | given))


def test_settings_are_used_and_stand_in_the_result():
    """With next to no unexplained motion allowed, any answer is refused by stricter verdicts."""
    study = study_of(duration_s=12)
    usual = identify(study, law="arctan_velocity")
    assert usual.settings == Settings()
    assert not usual.is_refused
    strict = Settings(verdicts=Verdicts(explained=0.1, noted=0.1, doubtful=0.1, refused_fraction=1e-6))
    strictly = identify(study, law="arctan_velocity", settings=strict)
    assert strictly.settings == strict
    assert strictly.is_refused
    banded = identify(study, law="arctan_velocity", band_hz=(1.0, 20.0))
    assert banded.settings == replace(Settings(), runs=RunSettings(band_hz=(1.0, 20.0)))
    assert banded.runs[0].frequency_hz[0] >= 1.0
    assert banded.runs[0].frequency_hz[-1] <= 20.0
