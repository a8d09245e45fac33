"""What several test files share: one short simulated field test on disk, and its identification."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from opid.studies.study_file import read_study
from opid.suspensions.identification import identify
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

# what two runs write at different times is the same to the byte
os.environ["SOURCE_DATE_EPOCH"] = "1700000000"

# no property fails because hypothesis took long on a busy machine
settings.register_profile("opid", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("opid")


@pytest.fixture(scope="session")
def field_test(tmp_path_factory):
    """A directory with heavy.csv, light.csv, study.toml and truth.json of 20 s at 256 Hz; not to be changed."""
    from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_truth
    from opid.virtual.truth_file import write_field_test

    directory = tmp_path_factory.mktemp("field_test")
    test = taxi_test(LandingGear(), rng=np.random.default_rng(1), duration_s=20.0, fs=256.0)
    study = taxi_study(test, title="A short field test")
    write_field_test(study, taxi_truth(test, settings={"seed": 1}), directory)
    return directory


@pytest.fixture(scope="session")
def identified(field_test):
    """The identification of the field test, with its truth: `.result`, `.truth`."""
    from opid.mechanics.truth import GearTruth
    from opid.virtual.truth_file import read_truth

    truth = read_truth(field_test / "truth.json", GearTruth)
    return SimpleNamespace(result=identify(read_study(field_test / "study.toml")), truth=truth)


@pytest.fixture
def few_figures(monkeypatch):
    """Draw only one figure where the figures are not what a test is about."""
    from opid.report.suspensions import figures

    monkeypatch.setattr(
        "opid.report.suspensions.identification.list_figures",
        lambda result, truth: [each for each in figures.list_figures(result, truth) if each.name == "law_ladder"],
    )
