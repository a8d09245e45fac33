"""Figures: every one draws what it is given, with labels and units, and leaves no trace in matplotlib."""

import subprocess
import sys
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from opid import plots
from opid.errors import NotDeterminedError
from opid.mechanics.laws.law import Law
from opid.plots.runs import _compute_noise_lines
from opid.plots.style import format_units, panels, thin_samples
from opid.signals.recording import Channel, Recording
from opid.studies.study_file import read_study
from opid.suspensions.identification import identify
from opid.suspensions.result import GearParameters
from opid.suspensions.study import study_of_gear

OF_RESULT = {
    "accelerations": plots.accelerations,
    "transmissibilities": plots.transmissibilities,
    "printed_transmissibilities": plots.printed_transmissibilities,
    "equation_residual": plots.equation_residual,
    "law_curves": plots.law_curves,
    "law_ladder": plots.law_ladder,
    "estimates": plots.estimates,
}
OF_RUN = {
    "integration": plots.integration,
    "restoring_force_surface": plots.restoring_force_surface,
    "restoring_force_map": plots.restoring_force_map,
    "slices": plots.slices,
}


def _all_axes(drawn):
    return list(np.atleast_1d(np.asarray(drawn, dtype=object)).ravel())


def _draw(name, result):
    return OF_RESULT[name](result) if name in OF_RESULT else OF_RUN[name](result.paper_chain.runs[0])


def _content(ax):
    return len(ax.lines) + len(ax.collections) + len(ax.images) + len(ax.texts)


@pytest.fixture(scope="module")
def one_run(field_test):
    study = read_study(field_test / "study.toml")
    return identify(study_of_gear("alone", sprung=study.sprung, unsprung=study.unsprung, runs=study.runs[:1]))


@pytest.mark.parametrize("name", [*OF_RESULT, *OF_RUN])
def test_every_figure_draws_with_something_in_every_panel(name, identified):
    axes = _all_axes(_draw(name, identified.result))
    assert all(_content(ax) > 0 for ax in axes)
    image = plots.png(plots.figure_of(axes[0]), dpi=60)
    assert image.startswith(b"\x89PNG")
    assert len(image) > 5_000


@pytest.mark.parametrize("name", [*OF_RESULT, *OF_RUN])
def test_every_figure_draws_without_an_absolute_mass(name, one_run):
    axes = _all_axes(_draw(name, one_run))
    assert plots.png(plots.figure_of(axes[0]), dpi=40).startswith(b"\x89PNG")


@pytest.mark.parametrize("name", [*OF_RESULT, *OF_RUN])
def test_axes_carry_their_units(name, identified):
    axes = _all_axes(_draw(name, identified.result))
    said = " ".join(ax.get_xlabel() + ax.get_ylabel() + ax.get_title(loc="left") for ax in axes)
    assert "[" in said
    if name != "estimates":
        assert any(ax.get_xlabel() for ax in axes)
        assert any(ax.get_ylabel() or ax.get_yticklabels() for ax in axes)


@pytest.mark.parametrize(
    ("name", "shape"), [("accelerations", (2, 1)), ("transmissibilities", (3, 2)), ("law_curves", (1, 2))]
)
def test_given_axes_are_drawn_on(name, shape, identified):
    mine = Figure().subplots(*shape, squeeze=False)
    drawn = OF_RESULT[name](identified.result, mine)
    assert drawn.shape == shape
    assert set(_all_axes(drawn)) == set(mine.ravel())


def test_a_wrong_number_of_axes_is_refused():
    with pytest.raises(ValueError, match="1 Axes are given and the figure has 2 x 1"):
        panels(Figure().subplots(), 2, height_in=3)


def test_the_users_settings_stay(identified):
    before = dict(matplotlib.rcParams)
    plots.png(plots.figure_of(plots.law_ladder(identified.result)))
    assert dict(matplotlib.rcParams) == before


def test_no_state_of_pyplot():
    code = "import sys, opid.plots; print('matplotlib.pyplot' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_the_parabola_of_the_literal_integration_is_seen(identified):
    above, below = plots.integration(identified.result.paper_chain.runs[0])[:, 0]
    literal, sound = (np.ptp(line.get_ydata()) for line in above.lines)
    assert literal > 5 * sound
    assert np.ptp(below.lines[0].get_ydata()) == sound


def test_the_residual_is_drawn_as_noise_on_each_channel(identified):
    fit = identified.result.evidence[0].fit
    power = [np.mean(_compute_noise_lines(fit, i)[1] ** 2) for i in range(len(fit.model.runs))]
    assert np.sqrt(np.mean(power)) == pytest.approx(1e3 * fit.noise_m_per_s2, rel=0.05)
    # the simulated sensors have 5 mm/s^2
    assert np.sqrt(np.mean(power)) == pytest.approx(5, rel=0.1)


def test_the_fitted_transmissibility_ends_at_one_and_peaks_at_resonance(identified):
    grid = plots.transmissibilities(identified.result)
    (fitted,) = (line for line in grid[0, 0].lines if line.get_label() == "fitted suspension")
    assert fitted.get_ydata()[0] == pytest.approx(1, abs=0.02)
    peak_hz = fitted.get_xdata()[np.argmax(fitted.get_ydata())]
    assert peak_hz == pytest.approx(identified.result.ratios.natural_frequency_hz.value, rel=0.05)
    assert any("averages" in text.get_text() for text in grid[0, 0].get_legend().get_texts())


def test_the_identified_law_is_drawn_on_the_true_one(identified):
    (over_velocity, _) = plots.law_curves(identified.result, truth=identified.truth)[0]
    drawn = {line.get_label(): line.get_ydata() for line in over_velocity.lines}
    assert np.allclose(drawn["nonlinear force f"], drawn["f, truth"], atol=10)
    assert np.abs(drawn["f, truth"]).max() == pytest.approx(400, rel=0.1)


def test_straight_springs_have_no_figure_of_where_runs_rest(identified):
    with pytest.raises(NotDeterminedError, match="the springs are straight"):
        plots.static_curves(identified.result)


def test_a_linear_law_is_called_so(identified):
    first = replace(identified.result.interfaces[0], law=Law())
    linear = replace(identified.result, interfaces=(first,))
    over_velocity = plots.law_curves(linear)[0, 0]
    assert "no nonlinear force" in [line.get_label() for line in over_velocity.lines]


def test_estimates_mark_the_truth_and_write_what_lies_beyond(identified):
    mass = plots.estimates(identified.result, truth=identified.truth)[0, 0]
    assert [1850, 1850] in [list(line.get_xdata()) for line in mass.lines]
    low, high = mass.get_xlim()
    marks = [line for line in mass.lines if line.get_marker() != "None"]
    assert len(marks) > 2
    assert all(low <= mark.get_xdata()[0] <= high for mark in marks)
    pairs = identified.result.paper_chain.table_3
    beyond = [p for p in pairs for m in (p.as_printed, p.sign_restored) if not low < m.sprung_mass_kg < high]
    assert bool(beyond) == bool(mass.texts)


def test_the_peak_formula_can_be_left_out(identified):
    grid = plots.estimates(identified.result, has_peak_formula=False)
    assert not any(line.get_marker() in ("D", "s", "p", "<", ">") for ax in grid[0] for line in ax.lines)
    named = [label.get_text() for label in grid[0, 0].get_yticklabels()]
    assert len(named) == 3
    assert not any("peak" in name for name in named)
    low, high = grid[0, 0].get_xlim()
    assert 0 < low < identified.result.parameters.sprung_mass_kg.value < high


def test_both_sections_of_the_force_have_one_scale(identified):
    surface = next(iter(identified.result.evidence[0].surfaces.values()))
    along_travel, along_velocity = plots.force_sections(surface)[0]
    assert along_travel.get_ylim() == along_velocity.get_ylim()
    assert along_velocity.get_title(loc="left").startswith("Law over velocity: up to 0.2")


def test_a_mark_beyond_the_frame_keeps_its_shape(identified):
    grid = plots.estimates(identified.result, truth=identified.truth)
    drawn = [line.get_marker() for ax in grid[0] for line in ax.lines]
    beyond = [marker for marker in drawn if marker in ("<", ">")]
    pairs = [marker for marker in drawn if marker in ("D", "s", "p")]
    # of each pair of peaks M2, K2/M2 and K3/M2 twice, beyond the frame or not
    assert beyond
    assert len(pairs) == 6 * len(identified.result.paper_chain.table_3)
    assert len(beyond) == sum(len(ax.texts) for ax in grid[0])


def test_a_slice_shows_no_straight_part_that_nothing_tells_from_its_arctangent(identified):
    run = identified.result.paper_chain.runs[0]
    grid = plots.slices(run)
    told = [fit.verdicts[0].distinguishable for fit in run.slice_fits]
    assert told == [False, True]
    for ax, curve, is_told in zip(grid[0], run.slices, told, strict=True):
        assert ("its straight part" in [line.get_label() for line in ax.lines]) is is_told
        assert ax.get_ylim()[1] < 3 * max(np.abs(each.force_per_mass).max() for each in run.slices), curve.along


def test_estimates_show_no_mass_that_the_result_refuses(identified):
    result = identified.result
    refused = replace(result, parameters=GearParameters())
    for each, expected in ((result, True), (refused, False)):
        figure = plots.figure_of(plots.estimates(each))
        assert ("all runs" in [text.get_text() for text in figure.legends[0].get_texts()]) is expected


def test_a_recording_shows_each_channel_and_says_where_one_is_mute():
    samples = np.stack([np.random.default_rng(0).standard_normal(1000), np.zeros(1000)], axis=1)
    run = Recording(samples, fs=100.0, channels=(Channel("upper_z", "m/s^2"), Channel("force", "N")))
    grid = plots.recording(run)
    assert grid.shape == (2, 2)
    assert grid[0, 0].get_ylabel() == "[m/s²]"
    assert "mute" in grid[1, 1].texts[0].get_text()
    assert plots.png(plots.figure_of(grid)).startswith(b"\x89PNG")


def test_scatter_is_thinned_and_units_are_printed_well():
    assert len(range(10**6)[thin_samples(10**6)]) < 8001
    assert len(range(100)[thin_samples(100)]) == 100
    assert format_units("N s^2/m^2") == "N s²/m²"
