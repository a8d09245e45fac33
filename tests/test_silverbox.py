"""The measured Duffing circuit: a law from its first part predicts the rest (benchmarks/silverbox.py)."""

import pytest
from measured_data import DATA, needs_data
from scripts import script

RECORD = DATA / "silverbox" / "SNLS80mV.csv"

pytestmark = needs_data("silverbox")


@pytest.fixture(scope="module")
def silverbox():
    return script("benchmarks/silverbox.py")


def test_the_cubic_law_of_the_first_part_predicts_the_rest(silverbox):
    nonlinear, linear, rms = silverbox.errors_mv(RECORD, 3, 1)
    assert nonlinear < 0.8
    assert linear > 10
    assert rms == pytest.approx(54.4, abs=0.1)


def test_the_spring_hardens(silverbox):
    force, output = silverbox.read(RECORD)
    modes = silverbox.linear_mode(force, output)
    assert modes.frequency_hz[0] == pytest.approx(68.4, abs=0.2)
    test = silverbox.first_part(force, output, modes)
    fit = silverbox.fit_mode(
        [test], 1, stiffness_order=3, damping_order=1, free_linear=True, band_hz=(30, 130), taper_s=1
    )
    assert fit.stiffness[3].interval95[0] > 0
    assert abs(fit.modal_mass.value - 1) < 0.01
