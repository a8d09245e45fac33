"""Curves of the model with points where Newton's method fails: bridged, lost, and told."""

from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest

from opid.errors import NotDeterminedError
from opid.report.as_json import plain
from opid.updating import doubts, model_curves, prediction
from opid.updating.doubts import doubts_of_choice
from opid.updating.likelihood import backbone_data, likelihood_function, log_likelihood
from opid.updating.model_curves import curves_of, where_it_fails
from opid.updating.posterior import update_class
from opid.updating.prediction import predict

THETA = np.array([[1.4], [1.58], [1.7]])


@pytest.fixture(scope="module")
def measured():
    return made.backbones(1)


@pytest.fixture(scope="module")
def data(measured):
    return backbone_data(made.system(), measured, harmonics=(1,))


def with_holes(monkeypatch, module, fails):
    """Let points fail: `fails` takes coefficients (n,) and amplitudes (n_points,) to (n, n_points)."""
    made_evaluator = module.family_evaluator

    def failing(*args, **settings):
        solve = made_evaluator(*args, **settings)

        def holed(coefficients):
            found = solve(coefficients)
            converged = found.converged & ~fails(np.asarray(coefficients)[:, 0], found.amplitude)
            return replace(
                found,
                converged=converged,
                eigenvalue=np.where(converged, found.eigenvalue, np.nan),
                shapes=np.where(converged[..., None], found.shapes, np.nan),
            )

        return holed

    monkeypatch.setattr(module, "family_evaluator", failing)


def between(low, high):
    return lambda coefficients, amplitude: np.tile((amplitude > low) & (amplitude < high), (len(coefficients), 1))


@pytest.mark.parametrize("hole", [between(6e-4, 8.5e-4), between(1.95e-3, 1.0), between(0.0, 2.5e-4)])
def test_a_gap_is_bridged_from_the_rest_of_the_curve(data, monkeypatch, hole):
    whole, mode = log_likelihood(data, made.CUBIC, THETA), data.modes[0]
    exact = curves_of(data, mode, made.CUBIC)(THETA)
    with_holes(monkeypatch, model_curves, hole)
    eigenvalue, shapes, missing, lost = curves_of(data, mode, made.CUBIC)(THETA)
    assert missing.any()
    assert not lost.any()
    np.testing.assert_allclose(eigenvalue, exact[0], rtol=2e-5)
    np.testing.assert_allclose(shapes, exact[1], atol=2e-5)
    np.testing.assert_array_equal(eigenvalue[~missing], exact[0][~missing])
    value, failed = likelihood_function(data, made.CUBIC)(THETA)
    assert value == pytest.approx(whole, abs=0.02)
    assert failed >= missing.sum()


@pytest.mark.parametrize("hole", [between(1.2e-3, 1.0), between(3e-4, 1.1e-3)])
def test_a_curve_with_too_much_missing_is_impossible(data, monkeypatch, hole):
    with_holes(monkeypatch, model_curves, lambda c, a: hole(c, a) & (c > 1e8)[:, None])
    value, failed = likelihood_function(data, made.CUBIC)(THETA)
    assert np.isneginf(value).tolist() == [False, True, True]
    assert failed > 4


def test_where_it_fails_names_mode_amplitude_and_point(data, monkeypatch):
    assert where_it_fails(data, made.CUBIC, THETA) == []
    with_holes(monkeypatch, model_curves, lambda c, a: between(1.6e-3, 1.8e-3)(c, a) & (c > 1e8)[:, None])
    (told,) = where_it_fails(data, made.CUBIC, THETA)  # mode 3 ends below
    assert told.startswith("mode 2 at 1.")
    assert "mm of sensor 'left' (point" in told
    assert told.endswith("of 12) for 67 %")
    assert where_it_fails(data, made.CUBIC, THETA, lost=True) == []


def test_gaps_in_the_posterior_are_told_and_the_class_is_kept(data, monkeypatch):
    before = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    with_holes(monkeypatch, model_curves, between(1.6e-3, 1.8e-3))
    found = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    assert found.log_evidence == pytest.approx(before.log_evidence, abs=0.05)
    (told,) = found.warnings
    assert told.startswith("in mode 2 at 1.")
    assert "for 100 % of the samples the model does not converge: its curve is bridged there" in told
    assert "take fewer harmonics, or leave out measured points near those amplitudes" in told


def test_a_posterior_that_may_be_cut_off_is_told(data, monkeypatch):
    edge = 1.70 * made.CUBIC.scales[0]  # some standard deviations above the best
    with_holes(monkeypatch, model_curves, lambda c, a: between(1e-3, 1.0)(c, a) & (c > edge)[:, None])
    monkeypatch.setattr("opid.updating.posterior.FAR_OUT", 20.0)
    found = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    (told,) = [each for each in found.warnings if "converge" in each]
    assert told.startswith("beside the posterior, in mode 2 at ")
    assert "count as impossible, which may cut the posterior off" in told


def test_a_class_that_never_converges_says_where(data, monkeypatch):
    with_holes(monkeypatch, model_curves, between(1e-3, 1.0))
    with pytest.raises(NotDeterminedError, match=r"no backbone anywhere in its prior \(in mode 2 at .* mm of sensor"):
        update_class(data, made.CUBIC, rng=np.random.default_rng(0))


@pytest.fixture(scope="module", params=["recommended", "paper"])
def predicted(request, measured):
    data = backbone_data(made.system(), measured, form=request.param, harmonics=(1,))
    found = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    return data, found, predict(data, found, measured, rng=np.random.default_rng(0))


def test_the_rest_of_a_band_is_kept(predicted, measured, monkeypatch):
    data, found, whole = predicted
    with_holes(monkeypatch, prediction, between(1.6e-3, 1.8e-3))
    bands = predict(data, found, measured, rng=np.random.default_rng(0))
    gap = (whole[0].amplitude > 1.6e-3) & (whole[0].amplitude < 1.8e-3)
    assert np.isnan([bands[0].low_hz[gap], bands[0].frequency_hz[gap], bands[0].high_hz[gap]]).all()
    np.testing.assert_allclose(bands[0].low_hz[~gap], whole[0].low_hz[~gap], rtol=1e-4)
    np.testing.assert_array_equal(bands[1].low_hz, whole[1].low_hz)
    assert bands[0].coverage == pytest.approx(whole[0].coverage, abs=0.05)
    told = list(doubts_of_choice([found], bands))
    assert told[0].startswith("mode 2: there is no band at 1.6")
    assert "where the model does not converge for most draws: take fewer harmonics" in told[0]
    assert None in plain(bands[0].low_hz)


def test_a_few_draws_that_fail_leave_the_band(predicted, measured, monkeypatch):
    data, found, whole = predicted
    edge = np.quantile(found.samples, 0.9) * made.CUBIC.scales[0]
    with_holes(monkeypatch, prediction, lambda c, a: between(1.6e-3, 1.8e-3)(c, a) & (c > edge)[:, None])
    bands = predict(data, found, measured, rng=np.random.default_rng(0))
    assert np.isfinite(bands[0].frequency_hz).all()
    np.testing.assert_allclose(bands[0].frequency_hz, whole[0].frequency_hz, rtol=1e-3)


def test_one_mode_without_a_band_leaves_the_other_and_none_is_told(predicted, measured, monkeypatch):
    data, found, whole = predicted
    with monkeypatch.context() as patched:
        with_holes(patched, prediction, lambda c, a: np.full((len(c), len(a)), a.max() > 1.7e-3))
        bands = predict(data, found, measured, rng=np.random.default_rng(0))
    assert np.isnan(bands[0].frequency_hz).all()
    assert np.isnan(bands[0].coverage)
    np.testing.assert_array_equal(bands[1].low_hz, whole[1].low_hz)
    with_holes(monkeypatch, prediction, between(0.0, 1.0))
    with pytest.raises(
        NotDeterminedError, match=r"most draws of 'cubic' have no backbone of mode 2 at .* or mode 3 at"
    ):
        predict(data, found, measured, rng=np.random.default_rng(0))


def test_sentences_of_points():
    assert doubts.named_points(np.array([1e-3, 2e-3]), np.array([True, False]), "10") == (
        "1 mm of sensor '10' (point 1 of 2)"
    )
    many = doubts.named_points(np.linspace(1e-3, 1e-2, 10), np.ones(10, dtype=bool), "10")
    assert many == "1 to 10 mm of sensor '10' (points 1, 2, 3 and 7 more of 10)"
