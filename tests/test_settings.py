"""Every tuned number of the estimator is a field of a record, with its reason, and can be passed."""

import re
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace

import pytest
from law_runs import study_of

from opid.suspensions import settings
from opid.suspensions.flights.settings import FlightSettings
from opid.suspensions.identification import identify
from opid.suspensions.paper.settings import __dict__ as of_the_paper
from opid.suspensions.settings import RunSettings, Settings, Verdicts
from opid.suspensions.sparse_regression import RegressionSettings

RECORDS = [each for each in vars(settings).values() if isinstance(each, type) and is_dataclass(each)]
RECORDS += [each for each in of_the_paper.values() if isinstance(each, type) and is_dataclass(each)]
RECORDS += [RegressionSettings, FlightSettings]
TUNED = [record for record in dict.fromkeys(RECORDS) if record is not Settings]
FIELDS = [(record, field.name) for record in TUNED for field in fields(record)]


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


def test_settings_are_used_and_stand_in_the_result():
    """With a noise of the sensors of next to nothing allowed, any answer is refused by stricter verdicts."""
    study = study_of(duration_s=12)
    usual = identify(study, law="arctan_velocity")
    assert usual.settings == Settings()
    assert not usual.is_refused
    strict = Settings(verdicts=Verdicts(explained=0.1, noted=0.1, doubtful=0.1, refused=0.2))
    strictly = identify(study, law="arctan_velocity", settings=strict)
    assert strictly.settings == strict
    assert strictly.is_refused
    banded = identify(study, law="arctan_velocity", band_hz=(1.0, 20.0))
    assert banded.settings == replace(Settings(), runs=RunSettings(band_hz=(1.0, 20.0)))
    assert banded.runs[0].frequency_hz[0] >= 1.0
    assert banded.runs[0].frequency_hz[-1] <= 20.0
