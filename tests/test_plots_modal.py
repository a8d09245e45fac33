"""Figures of modal tests: every one draws what it is given, with labels and units, and refuses nothing of it."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from made_modal import SOFT, appropriation, small_decay, small_modes, small_result, small_shift

from opid import plots
from opid.errors import InputError
from opid.mechanics.truth import ModeTruth
from opid.modal.decay.free_decay import law_of_decays
from opid.modal.linear.frequency_response import cmif, measured_response, resynthesised
from opid.modal.resonance.appropriation import modal_interaction
from opid.plots.nonlinear_modes import compute_fourier_amplitude
from opid.plots.style import BLUE, INK, VERMILION
from opid.signals.recording import Recording


@pytest.fixture(scope="module")
def result():
    return small_result(shifts=[small_shift(2, nonlinear=False), small_shift(), small_shift(4, determined=False)])


def settings():
    return {name: value for name, value in dict.items(matplotlib.rcParams) if name != "backend"}


def axes_of(drawn):
    return list(np.atleast_1d(np.asarray(drawn, dtype=object)).ravel())


def indicators(result):
    made = cmif([resynthesised(result.modes, np.linspace(20, 100, 500), "case_x")])
    measured = {test.name: cmif([measured_response([test])]) for test in result.tests[:2]}
    return plots.mode_indicators(measured, made, marked={SOFT: 60.0}, zoomed=[SOFT])


DRAWN = {
    "auto_mac": plots.auto_mac,
    "sine_beats": lambda result: plots.sine_beats(result, SOFT),
    "mode_restoring_force": lambda result: plots.mode_restoring_force(result.fits[0]),
    "modal_orders": lambda result: plots.modal_orders(result.fits[0]),
    "law_trials": lambda result: plots.law_trials(result.systems[0]),
    "level_shift_figures": lambda result: plots.level_shift_figures(result.shifts),
    "truth_test": lambda result: plots.truth_test(
        result.truth_tests[0], sensors=("case_x", "lid_y"), nonlinear_hz=[60.0]
    ),
    "truth_test_figures": lambda result: plots.truth_test_figures(result.truth_tests[0]),
    "mode_indicators": indicators,
    "free_decay_figure": lambda result: plots.free_decay_figure(small_decay()),
    "backbone": lambda result: plots.backbone(appropriation()),
    "sensor_harmonics": lambda result: plots.sensor_harmonics(appropriation(), "lid_x"),
    "modal_harmonics": lambda result: plots.modal_harmonics(modal_interaction(appropriation())),
    "harmonic_shape": lambda result: plots.harmonic_shape(modal_interaction(appropriation())),
    "drive_point_response": lambda result: plots.drive_point_response(
        resynthesised(small_modes(), np.linspace(20, 100, 300), "case_x"), {SOFT: 60.0}
    ),
    "stage_responses": lambda result: plots.stage_responses(
        {name: resynthesised(small_modes(), np.linspace(20, 100, 300), "case_x") for name in ("hammer", "$shaker$")},
        {SOFT: 60.0},
    ),
}


@pytest.mark.parametrize("name", DRAWN)
def test_every_figure_draws_with_labels(name, result):
    before = settings()
    axes = axes_of(DRAWN[name](result))
    assert all(len(ax.lines) + len(ax.images) + len(ax.collections) > 0 for ax in axes)
    assert any(ax.get_xlabel() for ax in axes)
    assert any(ax.get_ylabel() for ax in axes)
    assert any(ax.get_title(loc="left") or ax.get_title() for ax in axes)
    assert plots.png(plots.figure_of(axes[0]), dpi=40)[1:4] == b"PNG"
    assert settings() == before


def test_axes_that_are_given_are_drawn_on(result):
    figure = matplotlib.figure.Figure()
    given = figure.subplots(1, 3)
    drawn = plots.truth_test(result.truth_tests[0], sensors=("case_x",), axes=given)
    assert drawn.shape == (1, 3)
    assert drawn[0, 0] is given[0]


def test_measured_is_black_nonlinear_red_and_linear_blue(result):
    test = result.truth_tests[0]
    whole = plots.truth_test(test, sensors=("lid_x",))[0, 0]
    lines = {line.get_label(): line for line in whole.lines}
    # of many samples only how far they go: models as lines, what was measured as an area below them
    assert lines["linear"].get_ydata().max() == test.linear.channel("lid_x").max()
    assert lines["linear"].get_ydata().size < 500
    area = whole.collections[0]
    assert area.get_datalim(whole.transData).ymax == pytest.approx(test.measured.channel("lid_x").max())
    assert area.get_zorder() < lines["linear"].get_zorder() < lines["nonlinear"].get_zorder()
    near = {line.get_label(): line for line in plots.truth_test(test, sensors=("lid_x",))[0, 1].lines}
    assert set(near["measured"].get_ydata()) <= set(test.measured.channel("lid_x"))
    colors = {name: line.get_color() for name, line in near.items()}
    assert colors == {"measured": INK, "nonlinear": VERMILION, "linear": BLUE}


def test_a_short_truth_test_is_drawn_sample_by_sample(result):
    test = result.truth_tests[0]
    short = {name: part.section(0.3, 0.6) for name, part in vars(test).items() if isinstance(part, Recording)}
    whole = plots.truth_test(replace(test, **short), sensors=("lid_x",))[0, 0]
    lines = {line.get_label(): line for line in whole.lines}
    np.testing.assert_array_equal(lines["measured"].get_ydata(), short["measured"].channel("lid_x"))


def test_noise_at_small_amplitudes_does_not_rule_the_heights_of_a_decay():
    decay = small_decay()
    law = law_of_decays([decay])
    wide = replace(decay, frequency_std_hz=np.where(decay.amplitude < 1e-6, 50.0, decay.frequency_std_hz))
    for each in (decay, wide):
        frequency = plots.free_decay_figure(each, law=law)[0, 1]
        low, high = frequency.get_ylim()
        assert low < decay.frequency_hz[0] < law.frequency_low_hz.value < high
        assert high - low < 2.0
        assert "law" in [line.get_label() for line in frequency.lines]
        # the band is there all the same
        assert frequency.collections[0].get_datalim(frequency.transData).xmin <= 1.01e6 * decay.amplitude.min()


def test_thresholds_are_dashed_and_levels_are_whole_numbers(result):
    grid = plots.level_shift_figures(result.shifts, frequency_threshold=0.002, damping_threshold=0.15)
    dashed = [line.get_ydata()[0] for line in grid[1, 0].lines if line.get_linestyle() == "--"]
    assert dashed == pytest.approx([15.0, -15.0])
    ax = plots.harmonic_shape(modal_interaction(appropriation(3)))
    plots.figure_of(ax).canvas.draw()
    assert all(float(tick).is_integer() for tick in ax.get_xticks())


def test_the_truth_of_a_simulation_stands_beside_the_fit(result):
    truth = ModeTruth({}, {}, (1e-4, 2e-4, 9e-4), (59.9, 59.5, 50.0), (0.006, 0.008, 0.1))
    grid = plots.mode_restoring_force(result.fits[0], truth=truth)
    dots = next(line for line in grid[0, 2].lines if line.get_label() == "truth, other modes at rest")
    assert dots.get_ydata().tolist() == [59.9, 59.5]  # nothing beyond what was fitted


def test_a_level_that_did_not_lock_is_hollow():
    frequency = plots.backbone(appropriation())[0, 0]
    hollow = next(line for line in frequency.lines if line.get_label() == "not locked")
    assert hollow.get_xdata().size == 1
    assert hollow.get_markerfacecolor() == "white"


def test_levels_of_a_measured_log_are_steady_and_no_loop_is_spoken_of():
    measured = replace(appropriation(), settings=None)
    held = replace(measured, levels=tuple(level for level in measured.levels if level.locked))
    ax = plots.backbone(held)[0, 0]
    assert ax.get_title(loc="left").endswith(f" {len(held.levels)} steady levels")
    assert "locked" not in "".join(line.get_label() for line in ax.lines)
    assert "lock" not in modal_interaction(held).statement
    assert "excitation" not in plots.harmonic_shape(modal_interaction(held)).get_xlabel()


def test_the_label_of_one_law_that_was_tried_is_no_longer_than_its_axis(result):
    (few, *_) = result.systems
    ax = plots.law_trials(replace(few, trials=few.trials[:1]))
    ax.figure.canvas.draw()
    assert ax.yaxis.label.get_window_extent().height < ax.bbox.height


def test_the_legend_leaves_the_line_of_the_mode_itself_free():
    quiet = replace(modal_interaction(appropriation()), least_fraction=0.9)
    ax = plots.modal_harmonics(quiet)
    assert ax.get_ylim()[1] >= 1.3


def test_only_harmonics_over_the_share_are_drawn():
    found = modal_interaction(appropriation())
    labels = [line.get_label() for line in plots.modal_harmonics(found).lines]
    assert "mode 4, harmonic 2" in labels
    assert not any(label.startswith("mode 2") for label in labels)


def test_a_sensor_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="no sensor 'lid'"):
        plots.sensor_harmonics(appropriation(), "lid")


def test_indicators_without_measured_ones_show_the_linear_modes(result):
    made = cmif([resynthesised(result.modes, np.linspace(20, 100, 100), "case_x")])
    assert len(plots.mode_indicators({}, made)) == 1


def test_a_record_without_a_band_and_without_noise_draws(result):
    test = replace(result.truth_tests[0], band_hz=None)
    assert plots.truth_test(test, sensors=("case_x",)).shape == (1, 3)


def test_the_fourier_amplitude_of_a_pulse_is_its_impulse():
    samples = np.zeros(400)
    samples[3:7] = 2.5
    frequency, amplitude = compute_fourier_amplitude(samples, 100.0)
    assert frequency[-1] == 50.0
    assert amplitude[0] == pytest.approx(4 * 2.5 / 100)
