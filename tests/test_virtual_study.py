"""Virtual series of modal tests: levels that are asked for, both rules for beats, and modes that are stated wrong."""

from dataclasses import replace

import numpy as np
import pytest

from opid.errors import InputError
from opid.signals.units import STANDARD_GRAVITY
from opid.virtual.modal_tests.bolted_structures import CASE_SHAKER
from opid.virtual.modal_tests.series import CUBIC_TOP, stated_modes, top_displacement, virtual_series, virtual_study


@pytest.fixture(scope="module")
def series():
    return virtual_series("cubic")


@pytest.fixture(scope="module")
def quiet(series):
    """The whole series without noise; not to be changed."""
    return run(series, noise_fraction=0.0)


def run(series, **settings):
    return virtual_study(series, rng=np.random.default_rng(0), **settings)


def peak(series, test, mode=3):
    return np.abs(test.acceleration[:, mode - 1]).max() / (
        series.case.modes.stiffness()[mode - 1] * top_displacement(series, mode)
    )


def test_the_highest_beat_and_the_sweep_come_as_far_as_is_asked(series, quiet):
    assert top_displacement(series, 3) == pytest.approx(CUBIC_TOP)
    tests = {each.test.name: each.test for each in quiet.tests}
    assert peak(series, tests["beat_3_level_4"]) == pytest.approx(1.0, abs=0.06)
    assert peak(series, tests["sweep"]) == pytest.approx(1.0, abs=0.1)
    assert [each.mode for each in quiet.of_use("fit")] == [3] * 4


def test_impacts_are_at_three_levels_and_have_decayed(quiet):
    impacts = [each.test for each in quiet.of_use("level")]
    forces = [np.abs(test.force).max() for test in impacts]
    np.testing.assert_allclose(np.array(forces) / forces[0], [1, 10, 60], rtol=0.01)
    for test in impacts:
        assert np.abs(test.acceleration[-50:, 1:]).max() < 0.01 * np.abs(test.acceleration[:, 1:]).max()


def test_the_other_rule_makes_longer_beats_and_the_highest_can_be_the_truth_test(series, quiet):
    steps = []
    other = run(replace(series, rule="drive point", truth="beat", levels=(0.5, 1.0)), progress=steps.append)
    names = ["impact 1", "impact 2", "impact 3", "level of mode 3", "sine beat 1 of mode 3", "sine beat 2 of mode 3"]
    assert [(step.name, step.fraction) for step in steps] == [(name, k / 6) for k, name in enumerate(names)]
    # what judges is not fitted
    assert [each.test.name for each in other.of_use("fit")] == ["beat_3_level_1"]
    assert [(each.test.name, each.mode) for each in other.of_use("truth")] == [("beat_3_level_2", 3)]
    fitted, judged = other.of_use("fit")[0].test, other.of_use("truth")[0].test
    assert fitted.force.size > quiet.of_use("fit")[3].test.force.size
    assert np.abs(fitted.force).max() / np.abs(judged.force).max() == pytest.approx(0.5, rel=0.05)
    assert peak(series, judged) == pytest.approx(1.0, abs=0.06)


def test_an_amplifier_can_be_the_limit(series):
    weak = replace(CASE_SHAKER, full_voltage_v=0.5)
    limited = replace(series, case=replace(series.case, rig=replace(series.case.rig, shaker=weak)))
    study = run(limited)
    reached = peak(series, study.of_use("fit")[3].test)
    assert reached < 0.5
    assert peak(series, study.of_use("truth")[0].test) < 1.2 * reached


def test_the_study_states_the_modes_it_is_given(series):
    wrong = stated_modes(series.case.modes, frequency_error=0.001, damping_error=0.05)
    study = run(replace(series, truth="beat", levels=(1.0,)), given=wrong)
    assert study.modes is wrong
    assert all(each.test.modes is wrong for each in study.tests)
    np.testing.assert_allclose(wrong.frequency_hz, 1.001 * series.case.modes.frequency_hz)


@pytest.mark.parametrize(
    ("case", "n_modes", "nonlinear", "top_g"), [("1", 18, (7, 11, 12, 13, 15), 20.0), ("2", 26, (10,), 300.0)]
)
def test_the_case_studies_are_those_of_the_paper(case, n_modes, nonlinear, top_g):
    series = virtual_series(case)
    assert series.top_m_per_s2 == pytest.approx(top_g * STANDARD_GRAVITY)
    assert series.levels[-1] == 1.0
    assert series.truth == ("sweep" if case == "1" else "beat")
    assert series.case.modes.n_modes == n_modes
    assert series.case.nonlinear_modes == nonlinear
    assert series.case.rig.shaker is not None
    assert virtual_series(case, shaker=False).case.rig.shaker is None


def test_what_cannot_be_is_refused(series):
    with pytest.raises(InputError, match="there is no case '3'"):
        virtual_series("3")
    with pytest.raises(InputError, match="levels are"):
        replace(series, levels=(0.1, 0.5))


def test_a_sweep_of_twice_the_rate_is_about_half_as_long(series, quiet):
    fast = virtual_study(replace(series, sweep_octaves_per_s=0.2), rng=np.random.default_rng(0))
    long, short = (
        len(next(each for each in study.tests if each.use == "truth").test.acceleration) for study in (quiet, fast)
    )
    assert 0.4 * long < short < 0.7 * long
    with pytest.raises(InputError, match=r"sweep_octaves_per_s is 0\.0: give a positive rate"):
        replace(series, sweep_octaves_per_s=0.0)
