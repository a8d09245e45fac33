import numpy as np
import pytest
from made_beats import FOUR, ONE, beat, measured, softening

from opid.errors import InputError
from opid.modal.linear.modes import modal_test
from opid.modal.model import NonlinearModalModel, compare_models, truth_test
from opid.modal.power_laws import power_law


def test_the_true_model_passes_and_the_linear_one_over_predicts():
    test = measured(softening(FOUR, 3), beat(55.0), np.random.default_rng(0))
    done = truth_test(softening(FOUR, 3), test)
    assert done.band_hz == (27.0, 262.5)
    assert set(done.sensors) == set("abcde")
    for sensor in done.sensors.values():
        assert abs(sensor.peak_ratio_nonlinear - 1) < 0.03
        assert sensor.nrmse_nonlinear < 0.02
        assert sensor.nrmse_linear > 0.5
    assert max(sensor.peak_ratio_linear for sensor in done.sensors.values()) > 1.5


def test_figures_are_what_they_say():
    rng = np.random.default_rng(1)
    measured_, one, two = rng.standard_normal((3, 500))
    found = compare_models(measured_, one, two)
    assert found.peak_ratio_linear == pytest.approx(np.abs(two).max() / np.abs(measured_).max())
    assert found.nrmse_nonlinear == pytest.approx(np.linalg.norm(one - measured_) / np.linalg.norm(measured_))


def test_an_unstable_model_is_named():
    test = measured(NonlinearModalModel(ONE), beat(4000.0))
    with pytest.raises(InputError, match="the nonlinear model is unstable: its polynomials were fitted at lower"):
        truth_test(NonlinearModalModel(ONE, {1: power_law({3: -1e14}, {})}), test)


def test_without_a_force_there_is_no_truth_test():
    test = measured(NonlinearModalModel(ONE), beat(10.0))
    decay = modal_test(test.recording, ONE, name="decay")
    with pytest.raises(InputError, match="has no force"):
        truth_test(NonlinearModalModel(ONE), decay)
