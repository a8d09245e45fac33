"""Figures of a body on several suspensions: every one draws what it is given, with labels and units."""

from dataclasses import replace
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from made_body import LOADING, body_without_mass, short_test, small_body

from opid import plots
from opid.errors import NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.laws.law import law
from opid.plots.body import list_sensor_names
from opid.plots.style import GREEN, INK, VERMILION
from opid.report.suspensions.figures import list_figures
from opid.suspensions.answer.model_error import LeftOut, LeftOutSpectrum, ModelError
from opid.suspensions.result import BodyParameters, BodyRatios
from opid.virtual.taxi_tests.taxiing import taxi_truth

TRUE = taxi_truth(short_test(duration_s=0.5))
DRAWN = {
    "plan_view": lambda result: plots.plan_view(result, truth=TRUE),
    "structure_candidates": plots.structure_candidates,
    "suspension_parameters": lambda result: plots.suspension_parameters(result, truth=TRUE),
    "suspension_forces": lambda result: plots.suspension_forces(result, truth=TRUE),
    "predicted_accelerations": plots.predicted_accelerations,
    "body_residuals": plots.body_residuals,
}


@pytest.fixture(scope="module")
def result():
    return small_body()


def axes_of(drawn):
    return list(np.atleast_1d(np.asarray(drawn, dtype=object)).ravel())


def settings():
    return {name: value for name, value in dict.items(matplotlib.rcParams) if name != "backend"}


@pytest.mark.parametrize("name", DRAWN)
def test_every_figure_draws_with_labels(name, result):
    before = settings()
    axes = axes_of(DRAWN[name](result))
    assert all(len(ax.lines) for ax in axes if ax.axison)
    assert any(ax.get_xlabel() or [label.get_text() for label in ax.get_xticklabels()] for ax in axes)
    assert any(ax.get_title(loc="left") for ax in axes)
    assert plots.png(plots.figure_of(axes[0]), dpi=30)[1:4] == b"PNG"
    assert settings() == before


@pytest.mark.parametrize("name", ["plan_view", "suspension_parameters", "suspension_forces"])
def test_figures_without_the_mass_are_per_kg(name):
    axes = axes_of(DRAWN[name](body_without_mass()))
    told = " ".join(ax.get_ylabel() + ax.get_title(loc="left") for ax in axes)
    assert "kN" not in told


@pytest.fixture(scope="module")
def predicted(result):
    """Both runs as the other one predicts them, each of the four sensors twice as loud as the one before."""
    edges, read = np.array([0.5, 1.0, 2.0, 4.0]), np.array([0.2, 0.8, 0.1])
    spectra = tuple(
        LeftOutSpectrum(edges, 2.0**k * read, 2.0**k * 0.9 * read, 2.0**k * 0.3 * read, 2.0**k * 0.4 * read, np.ones(3))
        for k in range(4)
    )
    error = ModelError("unmeasured forces", 0.5, np.zeros((1, 1)), (), np.zeros(4))
    error = replace(error, left_out=tuple(LeftOut(run, 0.3, 1.0, spectra) for run in (0, 1)))
    return replace(result, evidence=(SimpleNamespace(error=error),))


def test_a_run_that_others_predict_is_drawn_sensor_by_sensor_with_its_band(predicted):
    axes = axes_of(plots.left_out_spectra(predicted))
    titles = [ax.get_title(loc="left") for ax in axes]
    assert titles[:2] == ["run 'reference', above nose", "run 'reference', above left"]
    assert titles[-1] == "run 'loaded', tail"
    for k, ax in enumerate(axes):
        drawn = {patch.get_label(): patch.get_data() for patch in ax.patches}
        np.testing.assert_allclose(drawn["measured"].values, 2.0 ** (k % 4) * np.array([0.2, 0.8, 0.1]))
        band = drawn["predicted, with the band for 95 % of the lines"]
        np.testing.assert_allclose(band.values / drawn["predicted"].values, 1.3 / 0.9)
        np.testing.assert_allclose(band.baseline / drawn["predicted"].values, 0.5 / 0.9)
    assert plots.png(plots.figure_of(axes[0]), dpi=30)[1:4] == b"PNG"
    assert "left_out_spectra" in [figure.name for figure in list_figures(predicted)]


def test_a_body_without_predictions_has_no_figure_of_them(result):
    assert "left_out_spectra" not in [figure.name for figure in list_figures(result)]
    with pytest.raises(NotDeterminedError, match="no run is predicted by the others"):
        plots.left_out_spectra(result)


def test_axes_that_are_given_are_drawn_on(result):
    given = matplotlib.figure.Figure().subplots(4, 2)
    assert plots.predicted_accelerations(result, given)[2, 0] is given[2, 0]
    with pytest.raises(ValueError, match="6 Axes are given"):
        plots.predicted_accelerations(result, given[:3])


def test_left_is_left_and_the_centre_of_gravity_is_as_long_as_its_interval(result):
    ax = plots.plan_view(result)
    assert ax.get_xlim()[0] > ax.get_xlim()[1]
    low, high = result.parameters.x_cg_m.interval95
    assert any(np.allclose(line.get_ydata(), [low, high]) for line in ax.lines if line.get_color() == VERMILION)
    assert any(text.get_text() == "+500 kg" for text in ax.texts)
    squares = [line for line in ax.lines if line.get_marker() == "s"]
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in squares] == [(LOADING[0].y_m, LOADING[0].x_m)]
    # without a value there is no cross, and the figure stands
    lost = replace(result, parameters=BodyParameters(), ratios=BodyRatios())
    assert not any(line.get_marker() == "x" for line in plots.plan_view(lost).lines)


def test_no_ring_hides_a_sensor(result):
    ax = plots.plan_view(result)
    rings = [line for line in ax.lines if line.get_marker() == "o" and line.get_color() == INK]
    sensors = [line for line in ax.lines if line.get_marker() == "^"]
    assert len(rings) == 3
    assert len(sensors) == 4
    assert {line.get_markerfacecolor() for line in rings} == {"none"}
    assert min(line.get_zorder() for line in sensors) > max(line.get_zorder() for line in rings)


def test_candidates_stand_on_a_logarithmic_axis_beside_the_line(result):
    ax = plots.structure_candidates(result)
    assert ax.get_xscale() == "log"
    assert any(np.allclose(line.get_xdata(), 1.2) and line.get_linestyle() == "--" for line in ax.lines)
    labels = [label.get_text() for label in ax.get_yticklabels()]
    assert labels[1] == "left alone\narctan velocity + cubic stiffness"
    assert ax.get_yticklabels()[4].get_color() == VERMILION
    assert any(text.get_text() == "no fit" for text in ax.texts)
    hollow = [line for line in ax.lines if line.get_markerfacecolor() == "white"]
    assert len(hollow) == 4
    many = replace(result.candidates[4], law="a; b; c")
    names = [
        label.get_text() for label in plots.structure_candidates(replace(result, candidates=(many,))).get_yticklabels()
    ]
    assert names == ["rigid body\na\nand 2 other laws"]


def test_every_amplitude_has_a_panel_and_a_gear_without_it_a_dash(result):
    nose = result.interfaces[0]
    hardening = nose.law + law("cubic_stiffness", stiffness_n_per_m3=1e8)
    table = {**nose.law_estimates, "cubic_stiffness": {"stiffness_n_per_m3": Estimate.normal(1e8, 1e7)}}
    changed = replace(result, interfaces=(replace(nose, law=hardening, law_estimates=table), *result.interfaces[1:]))
    grid = plots.suspension_parameters(changed, truth=TRUE)
    assert grid.shape == (2, 3)
    assert [ax.axison for ax in grid.ravel()] == [True] * 4 + [False] * 2
    last = grid[1, 0]
    assert (last.get_title(loc="left"), last.get_xlabel()) == (
        "Cubic stiffness, stiffness [N/m³]",
        "from the estimate [%]",
    )
    assert sum(text.get_text() == "–" for text in last.texts) == 2
    assert not any(line.get_color() == GREEN for line in last.lines)  # the truth has no such term
    assert sum(line.get_color() == GREEN for line in grid[0, 0].lines) == 3


def test_suspensions_that_share_a_law_share_a_row(result):
    nose, left, right = result.interfaces
    shared = (nose, replace(left, shared_with=("right",)), replace(right, shared_with=("left",)))
    grid = plots.suspension_forces(replace(result, interfaces=shared))
    assert [row[0].get_title(loc="left") for row in grid] == ["nose", "left, right"]
    assert [row[1].get_title(loc="left") for row in grid] == [
        f"law: {each.law.name.replace('_', ' ').replace('+', ' + ')}" for each in (nose, left)
    ]
    curves = {line.get_label(): line for line in grid[0, 0].lines}
    velocity = curves["nonlinear part f"].get_xdata()
    expected = 1e-3 * (nose.damping.value * velocity + nose.law.force(0 * velocity, velocity))
    np.testing.assert_allclose(curves["C z′ + f"].get_ydata(), expected)


def test_the_linear_force_is_seen_where_the_law_adds_nothing(result):
    travel = plots.suspension_forces(result)[0, 1]
    curves = {line.get_label(): line for line in travel.lines}
    linear, whole = curves["K z"], curves["K z + f"]
    np.testing.assert_allclose(linear.get_ydata(), whole.get_ydata())
    assert (linear.get_linestyle(), whole.get_linestyle()) == ("--", "-")
    assert linear.get_zorder() > whole.get_zorder()
    assert whole.get_linewidth() > 2 * linear.get_linewidth()
    assert linear.get_color() != whole.get_color()


def test_heights_say_of_what(result):
    measured, difference = plots.predicted_accelerations(result).T
    assert {ax.get_ylabel() for ax in measured} == {"acceleration [m/s²]"}
    assert {ax.get_ylabel() for ax in difference} == {"difference [mm/s²]"}
    assert [row[0].get_ylabel() for row in plots.body_residuals(result)] == 2 * ["residual over noise"]


def test_an_offset_of_a_sensor_is_no_difference(result):
    run = result.runs[0]
    shifted = replace(run, measured=run.measured + 0.3)
    difference = plots.predicted_accelerations(replace(result, runs=(shifted,)))[0, 1]
    assert difference.get_title(loc="left").startswith(("4.", "5"))
    # noise of 5 mm/s^2 fills its panel
    (line,), (low, high) = difference.lines, difference.get_ylim()
    assert np.ptp(line.get_ydata()) > 0.8 * (high - low)
    assert high - low < 100
    chosen = plots.predicted_accelerations(result, run="loaded", start_s=21.0)
    assert chosen[-1, 0].get_xlabel() == "time [s], run 'loaded'"
    assert chosen[0, 0].get_xlim() == pytest.approx((21.0, 25.0), abs=0.02)


def test_sensors_have_the_names_of_their_places(result):
    assert list_sensor_names(result, 4) == ["above nose", "above left", "above right", "tail"]
    assert list_sensor_names(replace(result, study=replace(result.study, sensors=())), 4)[-1] == "sensor 4"
    assert list_sensor_names(replace(result, structure="pair"), 2) == ["mean above left, right", "above nose"]
    assert list_sensor_names(replace(result, structure="single"), 3) == ["above nose", "above left", "above right"]


def test_a_structure_whose_fit_ran_away_does_not_stretch_the_axis():
    result = small_body()
    first, *others = result.candidates
    away = replace(first, residual_over_noise=1e107, left_out_over_noise=None)
    ax = plots.structure_candidates(replace(result, candidates=(away, *others)))
    assert ax.get_xlim()[1] < 1e5
    assert "1×10¹⁰⁷" in [text.get_text() for text in ax.texts]
