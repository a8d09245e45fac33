"""Curves of the model past interactions of modes, and with points where Newton's method fails: bridged, lost, told."""

from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest

from opid.errors import NotDeterminedError
from opid.json_values import plain
from opid.mechanics.backbones.family import family_evaluator
from opid.updating import prediction, warnings
from opid.updating.likelihood import curves
from opid.updating.likelihood.backbones import backbone_data, find_met_modes
from opid.updating.likelihood.curves import (
    describe_failures,
    likelihood_function,
    make_curves,
)
from opid.updating.likelihood.interactions import describe_interactions
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.model_class import PAPER_CLASSES
from opid.updating.posterior import update_class
from opid.updating.prediction import predict
from opid.updating.settings import UPDATING
from opid.updating.structure.reduction import reduce
from opid.updating.warnings import warn_of_choice, warn_of_curves
from opid.virtual.backbone_tests.measured import synthetic_backbones
from opid.virtual.backbone_tests.wing_engine import UPDATED, wing_engine_structure

THETA = np.array([[1.4], [1.58], [1.7]])


@pytest.fixture(scope="module")
def measured():
    return made.backbones(1)


@pytest.fixture(scope="module")
def data(measured):
    return backbone_data(made.system(), measured, harmonics=(1,))


def with_holes(monkeypatch, fails, module=curves, maker="family_evaluator"):
    """Let points fail: `fails` takes coefficients (n,) and amplitudes (n_points,) to (n, n_points)."""
    made_evaluator = getattr(module, maker)

    def failing(*args, **settings):
        solve = made_evaluator(*args, **settings)

        class Holed:
            find_slopes = staticmethod(solve.find_slopes)

            def __call__(self, coefficients):
                return holed(coefficients)

        def holed(coefficients):
            found = solve(coefficients)
            converged = found.converged & ~fails(np.asarray(coefficients)[:, 0], found.amplitude)
            return replace(
                found,
                converged=converged,
                eigenvalue=np.where(converged, found.eigenvalue, np.nan),
                shapes=np.where(converged[..., None], found.shapes, np.nan),
            )

        return Holed()

    monkeypatch.setattr(module, maker, failing)


def with_holes_in_bands(monkeypatch, fails):
    """Let points of predicted bands fail: `fails` takes theta (n,) and amplitudes."""
    with_holes(monkeypatch, fails, prediction, "make_solver")


def between(low, high):
    return lambda coefficients, amplitude: np.tile((amplitude > low) & (amplitude < high), (len(coefficients), 1))


@pytest.mark.parametrize("hole", [between(6e-4, 8.5e-4), between(1.95e-3, 1.0), between(0.0, 2.5e-4)])
def test_a_gap_is_bridged_from_the_rest_of_the_curve(data, monkeypatch, hole):
    whole, mode = made.log_likelihood(data, made.CUBIC, THETA), data.modes[0]
    exact = make_curves(data, mode, made.CUBIC)(THETA)
    with_holes(monkeypatch, hole)
    eigenvalue, shapes, missing, lost = make_curves(data, mode, made.CUBIC)(THETA)
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
    with_holes(monkeypatch, lambda c, a: hole(c, a) & (c > 1e8)[:, None])
    value, failed = likelihood_function(data, made.CUBIC)(THETA)
    assert np.isneginf(value).tolist() == [False, True, True]
    assert failed > 4


def test_where_it_fails_names_mode_amplitude_and_point(data, monkeypatch):
    assert describe_failures(data, made.CUBIC, THETA) == []
    with_holes(monkeypatch, lambda c, a: between(1.6e-3, 1.8e-3)(c, a) & (c > 1e8)[:, None])
    (told,) = describe_failures(data, made.CUBIC, THETA)  # mode 3 ends below
    assert told.startswith("mode 2 at 1.")
    assert "mm of sensor 'left' (point" in told
    assert told.endswith("of 12) for 67 %")
    assert describe_failures(data, made.CUBIC, THETA, lost=True) == []


def test_gaps_in_the_posterior_are_told_and_the_class_is_kept(data, monkeypatch):
    before = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    with_holes(monkeypatch, between(1.6e-3, 1.8e-3))
    found = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    assert found.log_evidence == pytest.approx(before.log_evidence, abs=0.05)
    (told,) = found.warnings
    assert told.startswith("in mode 2 at 1.")
    assert "for 100 % of the samples the model does not converge: its curve is interpolated there" in told
    assert "take fewer harmonics, or leave out measured points near those amplitudes" in told


def test_a_posterior_that_may_be_cut_off_is_told(data, monkeypatch):
    edge = 1.70 * made.CUBIC.terms[0].scales[0]  # some standard deviations above the best
    with_holes(monkeypatch, lambda c, a: between(1e-3, 1.0)(c, a) & (c > edge)[:, None])
    monkeypatch.setattr(warnings, "UPDATING", replace(UPDATING, far_out=20.0))
    found = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    (told,) = [each for each in found.warnings if "converge" in each]
    assert told.startswith("beside the posterior, in mode 2 at ")
    assert "count as impossible, which may cut the posterior off" in told


def test_a_class_that_never_converges_says_where(data, monkeypatch):
    with_holes(monkeypatch, between(1e-3, 1.0))
    with pytest.raises(NotDeterminedError, match=r"no backbone anywhere in its prior \(in mode 2 at .* mm of sensor"):
        update_class(data, made.CUBIC, rng=np.random.default_rng(0))


@pytest.fixture(scope="module", params=["recommended", "paper"])
def predicted(request, measured):
    data = backbone_data(made.system(), measured, form=request.param, harmonics=(1,))
    found = update_class(data, made.CUBIC, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    return data, found, predict(data, found, measured, rng=np.random.default_rng(0))


def test_the_rest_of_a_band_is_kept(predicted, measured, monkeypatch):
    data, found, whole = predicted
    with_holes_in_bands(monkeypatch, between(1.6e-3, 1.8e-3))
    bands = predict(data, found, measured, rng=np.random.default_rng(0))
    gap = (whole[0].amplitude > 1.6e-3) & (whole[0].amplitude < 1.8e-3)
    assert np.isnan([bands[0].low_hz[gap], bands[0].frequency_hz[gap], bands[0].high_hz[gap]]).all()
    np.testing.assert_allclose(bands[0].low_hz[~gap], whole[0].low_hz[~gap], rtol=1e-4)
    np.testing.assert_array_equal(bands[1].low_hz, whole[1].low_hz)
    assert bands[0].coverage == pytest.approx(whole[0].coverage, abs=0.05)
    told = list(warn_of_choice([found], bands))
    assert told[0].startswith("mode 2: there is no band at 1.6")
    assert "where the model does not converge for most draws: take fewer harmonics" in told[0]
    assert None in plain(bands[0].low_hz)


def test_a_few_draws_that_fail_leave_the_band(predicted, measured, monkeypatch):
    data, found, whole = predicted
    edge = np.quantile(found.samples, 0.9)
    with_holes_in_bands(monkeypatch, lambda c, a: between(1.6e-3, 1.8e-3)(c, a) & (c > edge)[:, None])
    bands = predict(data, found, measured, rng=np.random.default_rng(0))
    assert np.isfinite(bands[0].frequency_hz).all()
    np.testing.assert_allclose(bands[0].frequency_hz, whole[0].frequency_hz, rtol=1e-3)


def test_one_mode_without_a_band_leaves_the_other_and_none_is_told(predicted, measured, monkeypatch):
    data, found, whole = predicted
    with monkeypatch.context() as patched:
        with_holes_in_bands(patched, lambda c, a: np.full((len(c), len(a)), a.max() > 1.7e-3))
        bands = predict(data, found, measured, rng=np.random.default_rng(0))
    assert np.isnan(bands[0].frequency_hz).all()
    assert np.isnan(bands[0].coverage)
    np.testing.assert_array_equal(bands[1].low_hz, whole[1].low_hz)
    with_holes_in_bands(monkeypatch, between(0.0, 1.0))
    with pytest.raises(
        NotDeterminedError, match=r"most draws of 'cubic' have no backbone of mode 2 at .* or mode 3 at"
    ):
        predict(data, found, measured, rng=np.random.default_rng(0))


def test_sentences_of_points():
    assert warnings.describe_points(np.array([1e-3, 2e-3]), np.array([True, False]), "10") == (
        "1 mm of sensor '10' (point 1 of 2)"
    )
    many = warnings.describe_points(np.linspace(1e-3, 1e-2, 10), np.ones(10, dtype=bool), "10")
    assert many == "1 to 10 mm of sensor '10' (points 1, 2, 3 and 7 more of 10)"


# ------------------------------------------------------------------------------------------------ interactions
WING_THETA = 1.58
PAPERS_CUBIC = PAPER_CLASSES[1]


@pytest.fixture(scope="module")
def wing_structure():
    return wing_engine_structure()


@pytest.fixture(
    scope="module", params=[(1.005, 1.0), (0.995, 1.0), (1.0, 1.005), (1.0, 0.995), (0.98, 1.0)], ids=lambda p: str(p)
)
def wing(request, wing_structure):
    """The third harmonic of mode 8 meets mode 13 within 0.5 % of its last point: beyond it, at it, or before it."""
    factors = dict(zip(UPDATED, np.array(request.param) * list(UPDATED.values()), strict=True))
    system = reduce(wing_structure, factors)
    return system, synthetic_backbones(
        system, PAPERS_CUBIC, (WING_THETA,), rng=np.random.default_rng(0), linear_error=0.0, offset_fraction=0.0
    )


def test_an_interaction_neither_moves_theta_nor_makes_steps(wing):
    system, measured = wing
    data = backbone_data(system, measured)
    theta = np.linspace(1.53, 1.63, 101)
    value, failed = likelihood_function(data, PAPERS_CUBIC)(theta[:, None])
    assert failed == 0
    fraction = np.exp(value - value.max()) / np.exp(value - value.max()).sum()
    mean = fraction @ theta
    assert abs(mean / WING_THETA - 1) < 0.0015
    assert np.sqrt(fraction @ (theta - mean) ** 2) / WING_THETA == pytest.approx(0.00175, rel=0.1)
    # smooth: with the loops in the model these differences are up to 240
    assert np.abs(np.diff(value, 4)).max() < 1e-5
    for law, middle in ((PAPER_CLASSES[0], 1.6), (PAPER_CLASSES[2], 1.06)):
        theta = np.linspace(0.95, 1.05, 41)[:, None] * middle
        assert np.abs(np.diff(made.log_likelihood(data, law, theta), 4)).max() < 0.01


def test_beside_an_interaction_the_curve_is_that_of_the_whole_structure(wing):
    system, measured = wing
    data = backbone_data(system, measured)
    mode = data.modes[1]
    assert (find_met_modes(data, mode).columns + 1).tolist() == [12, 13]
    third = 3 * np.sqrt(mode.eigenvalue) / (2 * np.pi)
    apart = np.abs(third / system.frequency_hz[12] - 1) > 0.02
    amplitude = np.sort(mode.amplitude[apart])
    solve = family_evaluator(system, PAPERS_CUBIC.kinds, mode=8, sensor="10", amplitude=amplitude, harmonics=(1, 3))
    exact = solve(PAPERS_CUBIC.coefficients([[WING_THETA]]))
    eigenvalue, _, _, _ = make_curves(data, mode, PAPERS_CUBIC)(np.array([[WING_THETA]]))
    order = np.argsort(mode.amplitude[apart])
    np.testing.assert_allclose((mode.between @ eigenvalue[0])[apart][order], exact.eigenvalue[0], rtol=5e-5)


def test_the_first_harmonic_keeps_the_modes_that_others_meet(wing):
    system, measured = wing
    data = backbone_data(system, measured)
    mode = data.modes[1]
    smooth = find_met_modes(data, mode).remove_from(system)
    for one in (system, smooth):
        assert one.frequency_hz[7] == system.frequency_hz[7]
    middle = mode.eigenvalue.mean()
    flexibility = [one.at_joints / (one.eigenvalue - middle) @ one.at_joints.T for one in (system, smooth)]
    np.testing.assert_allclose(flexibility[0], flexibility[1], rtol=1e-9)
    with_one_harmonic = replace(data, harmonics=(1,))
    met = find_met_modes(with_one_harmonic, mode)
    assert met.columns.size == 0
    assert met.remove_from(system) is system


def test_measured_points_at_an_interaction_are_told(wing_structure):
    system = reduce(wing_structure, {"E_aluminium": 0.98 * 0.88, "E_steel": 0.31})
    measured = synthetic_backbones(system, PAPERS_CUBIC, (WING_THETA,), rng=np.random.default_rng(0), linear_error=0.0)
    told = describe_interactions(backbone_data(system, measured), PAPERS_CUBIC, [WING_THETA])
    assert len(told) == 1
    assert told[0].startswith("mode 8 at 2.3")
    assert told[0].endswith("measured amplitudes) harmonic 3 meets mode 13 at 57.53 Hz")
    (sentence,) = warn_of_curves((), (), told)
    assert sentence.startswith("in mode 8 at 2.3")
    assert "may lie off the smooth backbone of the model, which leaves interactions out" in sentence
    rough = backbone_data(system, measured, noise=NoiseSettings(point_noise=0.05))
    assert describe_interactions(rough, PAPERS_CUBIC, [WING_THETA]) == []
    assert describe_interactions(backbone_data(system, measured, harmonics=(1,)), PAPERS_CUBIC, [WING_THETA]) == []


@pytest.mark.slow
def test_a_band_runs_smoothly_past_an_interaction(wing):
    system, measured = wing
    data = backbone_data(system, measured)
    found = update_class(data, PAPERS_CUBIC, rng=np.random.default_rng(0), n_samples=1000, evidences=("laplace",))
    assert [each for each in found.warnings if "converge" in each] == []
    _, second = predict(data, found, measured, rng=np.random.default_rng(0))
    assert np.isfinite(second.frequency_hz).all()
    smooth = np.polynomial.Chebyshev.fit(second.amplitude, second.frequency_hz, 6)(second.amplitude)
    np.testing.assert_allclose(second.frequency_hz, smooth, rtol=6e-5)


def test_a_law_without_any_curve_has_no_band(predicted, measured, monkeypatch):
    data, found, _ = predicted
    made_curves = prediction.make_curves

    def lose_all(*args):
        return lambda theta: (*made_curves(*args)(theta)[:3], np.ones(len(theta), dtype=bool))

    monkeypatch.setattr(prediction, "make_curves", lose_all)
    if data.form == "recommended":
        with pytest.raises(NotDeterminedError):
            predict(data, found, measured, rng=np.random.default_rng(0))
