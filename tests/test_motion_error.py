"""The calibration of the amplitudes is a part of the intervals of theta."""

from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest

from opid.updating import posterior
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.posterior import update_class
from opid.updating.prediction import predict

EXACT = NoiseSettings(motion_error=0.0)


def update(curves, model_class=made.CUBIC, noise=None, form="recommended"):
    data = backbone_data(made.system(), curves, harmonics=(1,), noise=noise, form=form)
    return data, update_class(data, model_class, rng=np.random.default_rng(0), n_samples=1000)


def louder(curves, factor, sensor=None):
    """Curves whose amplitudes, or those of the curves of one controlled sensor, are `factor` times as large."""
    return tuple(
        replace(one, amplitude=one.amplitude * factor) if sensor in (None, one.controlled_sensor) else one
        for one in curves
    )


KNOWN_GAP = ModelClass(
    "late cubic",
    (
        UncertainTerm(
            "late_cubic_stiffness", (2 * made.CUBIC.terms[0].scales[0], 3e-4), (Prior("uniform", 0, 10), None)
        ),
    ),
)


@pytest.mark.parametrize("model_class", [made.CUBIC, made.QUADRATIC, made.BOTH, KNOWN_GAP], ids=lambda each: each.name)
def test_theta_moves_as_if_the_curves_were_fitted_again_with_other_amplitudes(model_class):
    curves = made.backbones(2)
    _, found = update(curves, model_class)
    ends = [update(louder(curves, factor), model_class, EXACT)[1].best for factor in (1.01, 0.99)]
    moved = np.abs(ends[0] - ends[1]) / 2
    tolerance = 0.1 * found.chain.pooled.std(axis=0)
    assert np.all(np.abs(found.calibration_std - moved) < 0.03 * moved + tolerance)


def test_a_normal_prior_is_counted_once():
    _, flat = update(made.backbones(2), noise=EXACT)
    prior = Prior("normal", float(flat.best[0]), float(flat.chain.pooled.std()))
    own = ModelClass("own", (replace(made.CUBIC.terms[0], priors=(prior,)),))
    _, found = update(made.backbones(2), own)
    ends = [update(louder(made.backbones(2), factor), own, EXACT)[1].best[0] for factor in (1.01, 0.99)]
    assert found.calibration_std[0] == pytest.approx(abs(ends[0] - ends[1]) / 2, rel=0.03)


def test_a_cubic_coefficient_is_twice_as_uncertain_as_its_amplitudes():
    _, found = update(made.backbones(2), noise=NoiseSettings(motion_error=0.02))
    # A factor s of all amplitudes makes the coefficient that of s^-2.
    assert found.calibration_std == pytest.approx(0.04 * found.best, rel=0.01)
    theta, alone = found.estimates["theta_1"], found.chain.pooled.std()
    assert theta.std == pytest.approx(np.hypot(alone, 0.04 * found.best[0]), rel=0.1)
    assert found.samples.shape == found.chain.pooled.shape


def test_exact_amplitudes_and_the_forms_of_the_paper_leave_the_samples_as_they_are():
    for given in ({"noise": EXACT}, {"form": "paper"}):
        _, found = update(made.backbones(2), **given)
        np.testing.assert_array_equal(found.samples, found.chain.pooled)
        np.testing.assert_array_equal(found.calibration_std, [0.0])


def test_no_interval_is_given_where_the_model_has_no_curve_beside_the_best_parameters(monkeypatch):
    def lose(data, model_class):
        return lambda theta: (np.full(len(theta), -np.inf), np.zeros(theta.shape))

    monkeypatch.setattr(posterior, "slopes_function", lose)
    _, found = update(made.backbones(2))
    assert found.estimates["theta_1"].interval95 is None
    assert sum("no interval is given" in warning for warning in found.warnings) == 1


def test_a_wide_lognormal_prior_leaves_the_calibration_as_it_is():
    wide = ModelClass("wide", (replace(made.CUBIC.terms[0], priors=(Prior("lognormal", 1.0, 20.0),)),))
    _, found = update(made.backbones(2), wide)
    assert found.calibration_std == pytest.approx(0.02 * found.best, rel=0.01)


def test_samples_that_never_move_give_no_interval():
    # Draws of so wide a prior do not meet the posterior, and neither do particles.
    absurd = ModelClass("absurd", (replace(made.CUBIC.terms[0], priors=(Prior("lognormal", 1.0, 100.0),)),))
    _, found = update(made.backbones(2), absurd)
    assert found.diagnostics.effective_samples < 10
    assert found.estimates["theta_1"].interval95 is None
    assert any("no interval is given, draw more samples" in warning for warning in found.warnings)


def test_bands_over_measured_amplitudes_do_not_open_with_their_calibration():
    curves, bands = made.backbones(2), []
    for motion_error in (0.0, 0.2):
        data, found = update(curves, noise=NoiseSettings(motion_error=motion_error))
        bands.append(predict(data, found, curves, rng=np.random.default_rng(1))[0])
    np.testing.assert_array_equal(bands[0].low_hz, bands[1].low_hz)


def test_sensors_have_gains_of_their_own():
    first, second = "left", "right"
    curves = made.backbones(2, shape_noise=0.0)
    curves = tuple(replace(one, controlled_sensor=second if one.mode == 3 else first) for one in curves)
    _, apart = update(curves)
    ends = []
    for sensor in (first, second):
        pair = [update(louder(curves, factor, sensor), noise=EXACT)[1].best[0] for factor in (1.01, 0.99)]
        ends.append((pair[0] - pair[1]) / 2)
    assert min(np.abs(ends)) > 0.003 * apart.best[0]
    assert apart.calibration_std[0] == pytest.approx(np.hypot(*ends), rel=0.1)
    assert apart.calibration_std[0] < 0.02 * apart.best[0]


def test_intervals_hold_the_truth_where_every_set_has_another_gain():
    held = []
    for seed in range(40):
        gain = np.exp(0.01 * np.random.default_rng([seed, 1]).standard_normal())
        _, found = update(louder(made.backbones(seed), gain))
        held.append(found.estimates["theta_1"].holds(made.TRUTH))
    assert np.mean(held) >= 0.875  # 5 of 40 outside have the probability 5 % if 95 % hold
