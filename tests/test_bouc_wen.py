"""The Bouc-Wen benchmark (benchmarks/bouc_wen.py): a law from the training record predicts both official tests."""

import numpy as np
import pytest
from measured_data import DATA, needs_data
from scripts import script

RECORDS = "bouc_wen_benchmark/bouc_wen.npz"

pytestmark = needs_data(RECORDS)


@pytest.fixture(scope="module")
def bouc_wen():
    return script("benchmarks/bouc_wen.py")


@pytest.fixture(scope="module")
def records():
    with np.load(DATA / RECORDS) as file:
        return {name: file[name] for name in file}


def test_the_law_of_the_training_record_predicts_both_tests(bouc_wen, records):
    # of all kinds it takes twice as long
    found = bouc_wen.identified(records, ("bouc_wen", "dahl_friction", "iwan_friction", "cubic_stiffness"))
    assert found.law.name == "bouc_wen"
    part = bouc_wen.part_of(found)
    assert max(bouc_wen.errors_of(records, part)) < 5e-6 < max(bouc_wen.plain_errors(records))
    # 8192 samples of noise, five times
    assert found.simulation.error_rms_m == pytest.approx(7.4e-6, rel=0.03)
    np.testing.assert_allclose(part.straight[[0, 1, 3]], bouc_wen.TRUE_STRAIGHT[[0, 1, 3]], rtol=0.01)
    np.testing.assert_allclose(part.law.vector, bouc_wen.TRUE.vector, rtol=0.005)


def test_a_linear_model_leaves_as_much_as_in_the_literature(bouc_wen, records):
    linear = bouc_wen.part_of(bouc_wen.identified(records, ()))
    assert all(1.4e-4 < error < 1.9e-4 for error in bouc_wen.errors_of(records, linear))
