"""Figures of an updating: every one draws what it is given, with labels and units, and refuses nothing of it."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from made_updating import (
    CONTROLLED,
    CUBIC,
    SENSORS,
    small_bands,
    small_harmonics,
    small_linear,
    small_measured,
    small_motions,
    small_responses,
    small_updating,
)
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb

from opid import plots
from opid.errors import InputError
from opid.estimate import format_number
from opid.plots import ForceBand
from opid.plots.style import RUN_COLORS, VERMILION
from opid.updating.measured import Place
from opid.updating.structure.reduction import ReductionErrors


def settings():
    return {name: value for name, value in dict.items(matplotlib.rcParams) if name != "backend"}


def axes_of(drawn):
    return [ax for ax in np.atleast_1d(np.asarray(drawn, dtype=object)).ravel() if ax.axison]


def samples(n, d, *, seed=0):
    return np.random.default_rng(seed).standard_normal((n, d)) + np.arange(d)


def forces():
    z = np.linspace(0, 4e-3, 50)
    bands = [ForceBand(name, CUBIC * z**3, 0.9 * CUBIC * z**3, 1.1 * CUBIC * z**3) for name in ("a", "b")]
    return plots.joint_forces(z, bands, best="b", truth=CUBIC * z**3, reached={1: 4e-3, 2: 2.5e-3})


def errors_of(method="fixed", order=None):
    """Fifteen modes, each reduced worse than the one before; in another order where one is given."""
    number = np.arange(1, 16)
    hz, relative = 10.0 * (number - 1), 1e-9 * 3.0 ** (number - 1) - 1e-9
    nearest = number if order is None else np.array(order)
    mac = np.where(nearest == number, 1 - relative, 0.0)
    return ReductionErrors(hz, hz * (1 + relative), relative, mac, nearest, 1 - relative, method, 20)


def modes_of_reduction():
    return plots.reduction_figure(errors_of(), free=errors_of("free"))


DRAWN = {
    "measured": lambda: plots.measured_backbones(small_measured(), 1, sensors=SENSORS[:2]),
    "predicted": lambda: plots.predicted_backbones(small_bands(sensors=SENSORS[:2]), small_measured(), 2),
    "predicted without curves": lambda: plots.predicted_backbones(small_bands(sensors=SENSORS[:1]), (), 1),
    "predicted_motions": lambda: plots.predicted_motions(small_motions(), small_measured()),
    "forced_responses": lambda: plots.forced_responses(small_responses()),
    "higher_harmonics": lambda: plots.higher_harmonics(small_harmonics()[:2]),
    "log_evidences": lambda: plots.log_evidences(small_updating()),
    "joint_forces": forces,
    "linear_updating": lambda: plots.linear_updating(small_linear()),
    "mode_shape as bars": lambda: plots.mode_shape(small_updating().mode_shapes[0]),
    "reduction_figure": modes_of_reduction,
    "running_moments": lambda: plots.running_moments(samples(500, 1), ["a"]),
}


@pytest.mark.parametrize("name", DRAWN)
def test_every_figure_draws_with_labels(name):
    before = settings()
    drawn = DRAWN[name]()
    assert plots.png(plots.figure_of(drawn), dpi=40).startswith(b"\x89PNG")
    assert settings() == before
    lowest = axes_of(drawn)[-1]
    if name != "linear_updating":
        assert lowest.get_xlabel()


def test_a_band_that_opens_does_not_hide_the_points_of_a_harmonic():
    first, *_ = small_harmonics()
    high = first.high.copy()
    high[-1] = 1.0
    (ax,) = axes_of(plots.higher_harmonics([replace(first, high=high)]))
    assert ax.get_ylabel() == "harmonic 3 [mm]"
    assert np.abs(1e3 * first.measured).max() < ax.get_ylim()[1] < 0.1


@pytest.mark.parametrize("n_parameters", [1, 2, 7])
def test_samples_of_any_number_of_parameters_are_drawn(n_parameters):
    labels = [f"θ{k}" for k in range(n_parameters)]
    grid = plots.parameter_samples(samples(400, n_parameters), labels)
    shown = min(n_parameters, 5)
    assert grid.shape == (shown, shown)
    assert grid[-1, -1].get_xlabel() == labels[shown - 1]
    assert len(axes_of(grid)) == shown * (shown + 1) // 2
    assert plots.running_moments(samples(400, n_parameters), labels).shape == (shown, 2)


def test_histogram_and_gaussian_are_densities():
    """Also where one bin stands out, which would lift a Gaussian scaled to it."""
    drawn = np.concatenate([samples(4000, 1), np.full((400, 1), 0.5)])
    ax = plots.parameter_samples(drawn, ["a"])[0, 0]
    assert sum(bar.get_height() * bar.get_width() for bar in ax.patches) == pytest.approx(1)
    x, density = ax.lines[0].get_data()
    assert np.trapezoid(density, x) == pytest.approx(1, abs=1e-3)
    assert density.max() == pytest.approx(1 / np.sqrt(2 * np.pi) / drawn.std(), rel=1e-3)
    assert ax.get_ylabel() == "density"


def test_the_contours_hold_their_share_of_the_samples():
    rng = np.random.default_rng(4)
    covariance = np.array([[1.0, 0.95], [0.95, 1.0]])
    drawn = rng.multivariate_normal([1.0, 2.0], covariance, 20000)
    contours = [
        line for line in plots.parameter_samples(drawn, ["a", "b"])[1, 0].lines if line.get_color() == VERMILION
    ]
    for fraction, line in zip((0.5, 0.9, 0.99), contours, strict=True):
        path = matplotlib.path.Path(np.column_stack(line.get_data()))
        assert path.contains_points(drawn).mean() == pytest.approx(fraction, abs=0.01)


def test_running_moments_end_at_those_of_all_samples():
    drawn = 1e6 + samples(1000, 1)
    grid = plots.running_moments(drawn, ["a"])
    mean, deviation = (ax.lines[1].get_ydata()[0] for ax in grid[0])
    assert mean == pytest.approx(drawn.mean(), rel=1e-12)
    assert deviation == pytest.approx(drawn.std(), rel=1e-6)


def test_samples_that_do_not_move_draw():
    grid = plots.parameter_samples(np.full((50, 2), 3.0), ["a", "b"], truth=[3.0, None])
    plots.figure_of(grid).draw_without_rendering()


def test_amplitudes_are_drawn_in_a_unit_that_reads_well():
    grid = plots.measured_backbones(small_measured(), 1, sensors=["10"])
    assert grid[0, 0].get_ylabel() == "amplitude [mm]"
    assert max(line.get_ydata().max() for line in grid[0, 0].lines) == pytest.approx(4.0, rel=0.05)
    small = [replace(curve, amplitude=1e-4 * curve.amplitude) for curve in small_measured()]
    assert plots.measured_backbones(small, 1, sensors=["10"])[0, 0].get_ylabel() == "amplitude [µm]"
    large = [replace(curve, amplitude=1e3 * curve.amplitude) for curve in small_measured()]
    assert plots.measured_backbones(large, 1, sensors=["10"])[0, 0].get_ylabel() == "amplitude [m]"


def test_a_sensor_that_a_curve_lacks_is_left_out():
    measured = small_measured()
    few = replace(measured[0], amplitude=measured[0].amplitude[:, :2], sensors=SENSORS[:2])
    grid = plots.measured_backbones([few, measured[1]], 1, sensors=["10", "13"])
    assert [len(ax.lines) for ax in grid.ravel()] == [2, 1]


def test_motions_are_drawn_over_that_of_the_controlled_sensor():
    band = small_motions(1)
    grid = plots.predicted_motions(band, small_measured())
    drawn = axes_of(grid)
    assert [ax.get_title(loc) for ax in drawn for loc in ("left", "center") if ax.get_title(loc)] == [
        f"sensor {name}" for name in SENSORS if name != CONTROLLED
    ]
    line, *curves = drawn[0].lines
    assert line.get_ydata() == pytest.approx(0.04 / 0.9)
    assert len(curves) == 5
    first = small_measured()[0]
    assert curves[0].get_ydata() == pytest.approx(first.amplitude[:, 0] / first.amplitude[:, 1])
    with pytest.raises(InputError, match="has no band of a sensor: take the recommended form"):
        plots.predicted_motions(replace(band, sensors=()), small_measured())


def test_a_mode_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="no backbone of mode 3 was measured"):
        plots.measured_backbones(small_measured(), 3, sensors=["10"])
    with pytest.raises(InputError, match="no backbone of mode 3 was predicted"):
        plots.predicted_backbones(small_bands(), small_measured(), 3)


def test_predicted_bands_without_measurements_draw():
    grid = plots.predicted_backbones(small_bands(sensors=("9",)), (), 1)
    assert len(grid[0, 0].lines) == 1


@pytest.mark.parametrize("offsets", [(0.0, 0.0, 0.0), (-2.5, 0.0, -0.4), (-1e5, 0.0, -30.0), (-np.inf, 0.0, -3.0)])
def test_evidences_near_and_far_are_within_the_axes(offsets):
    result = small_updating()
    classes = tuple(
        replace(each, evidences=(replace(each.evidences[0], log_evidence=300 + offset),))
        for each, offset in zip(result.classes, offsets, strict=True)
    )
    ax = plots.log_evidences(replace(result, classes=classes))
    low, high = ax.get_xlim()
    assert low < 0.3
    assert max(-offset for offset in offsets if np.isfinite(offset)) < high
    said = [text.get_text() for text in ax.texts]
    assert said == [format_number(-offset) if np.isfinite(offset) else "not determined" for offset in offsets]
    named = [label.get_text() for label in ax.get_xticklabels()]
    assert named[0] == "best"
    assert len(named) < 9


def test_a_difference_of_five_is_seen_beside_one_of_thousands():
    result = small_updating()
    classes = tuple(
        replace(each, evidences=(replace(each.evidences[0], log_evidence=below),))
        for each, below in zip(result.classes, (0.0, -5.5, -4000.0), strict=True)
    )
    ax = plots.log_evidences(replace(result, classes=classes))
    plots.figure_of(ax).draw_without_rendering()
    x = [ax.transAxes.inverted().transform(ax.transData.transform((at, 0)))[0] for at in (0.3, 5.5, 4000.0)]
    assert np.diff(x).min() > 0.2
    marks = {handle.get_marker() for handle in ax.get_legend().legend_handles}
    assert len(marks) == len(ax.get_legend().get_texts())


def test_the_axis_of_the_evidences_tells_what_bars_are_where_there_are_any():
    result = small_updating()
    assert "bars: 95 % intervals" in plots.log_evidences(result).get_xlabel()
    exact = tuple(replace(each, evidences=each.evidences[:1]) for each in result.classes)
    assert plots.log_evidences(replace(result, classes=exact)).get_xlabel().endswith("best class")


def bands_of(coefficients):
    z = np.linspace(0, 4e-3, 80)
    return z, [ForceBand(name, k * z**p, k * z**p, k * z**p) for name, (k, p) in coefficients.items()]


def test_every_class_is_seen_where_curves_lie_on_each_other():
    z, bands = bands_of({"a": (2e5, 2), "b": (1e8, 3), "c": (1e8, 3), "d": (1e8, 3), "e": (1.001e8, 3)})
    ax = plots.joint_forces(z, bands, best="b", truth=bands[1].force)
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["a", "b (best)", "its 95 % band", "c", "d", "e", "truth"]
    ax.get_legend().remove()  # it has the colours, too
    canvas = FigureCanvasAgg(plots.figure_of(ax))
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    for color in RUN_COLORS[:5]:
        # four share the length of a curve of some 700 pixels
        assert (np.abs(pixels - 255 * np.array(to_rgb(color))).max(axis=-1) < 3).sum() > 50


def test_joints_that_are_not_extended_and_laws_without_force_draw():
    z = np.zeros(5)
    ax = plots.joint_forces(z, [ForceBand(name, z, z, z) for name in "ab"], best="a", reached={1: 0.0})
    plots.figure_of(ax).draw_without_rendering()


def test_many_classes_and_no_best_one_draw():
    z, bands = bands_of({f"class {k}": (1e8, 1 + k / 4) for k in range(14)})
    ax = plots.joint_forces(z, bands, best="")
    assert len(ax.get_legend().get_texts()) == 14
    plots.figure_of(ax).draw_without_rendering()


def test_modes_that_changed_places_have_the_mac_of_what_they_are():
    order = [*range(1, 14), 15, 14]
    grid = plots.reduction_figure(errors_of(), free=errors_of("free", order))
    crosses = [line for line in grid[0, 1].lines if line.get_marker() == "x"]
    assert [line.get_xdata().tolist() for line in crosses] == [[14, 15]]
    assert crosses[0].get_ydata().min() > 0.9
    assert [text.get_text() for text in grid[0, 0].get_legend().get_texts()] == [
        "sensors and joints held",
        "free modes",
    ]
    assert plots.reduction_figure(errors_of())[0, 1].get_legend() is None


def test_a_band_with_missing_points_breaks_off():
    band = small_bands(sensors=("10",))[0]
    there = np.arange(band.amplitude.size) % 20 < 15
    broken = replace(band, **{
        name: np.where(there, getattr(band, name), np.nan) for name in ("frequency_hz", "low_hz", "high_hz")
    })  # fmt: skip
    ax = plots.predicted_backbones([broken], small_measured(), 1)[0, 0]
    plots.figure_of(ax).draw_without_rendering()
    (area,) = ax.collections
    assert len(area.get_paths()) == 2
    assert np.isnan(ax.lines[0].get_xdata()).sum() == 10
    nothing = np.full(band.amplitude.size, np.nan)
    lost = replace(band, frequency_hz=nothing, low_hz=nothing, high_hz=nothing, coverage=np.nan)
    ax = plots.predicted_backbones([lost], small_measured(), 1)[0, 0]
    plots.figure_of(ax).draw_without_rendering()
    assert ax.get_title(loc="left") == "sensor 10"


def test_curves_of_one_sensor_and_bands_of_one_sensor_are_named_once():
    band = small_bands(sensors=("10",))[0]
    grid = plots.predicted_backbones([band, band], small_measured() * 2, 1)
    assert len(grid.ravel()) == 2
    for ax in grid.ravel():
        assert sorted(ax.get_legend_handles_labels()[1]) == ["95 % band", "measured", "predicted"]


def test_a_shape_is_drawn_at_its_sensors_where_their_coordinates_are_known():
    """The motion of each sensor is drawn in its direction, and neighbours are joined."""
    (shape, _), size = small_updating().mode_shapes, len(SENSORS)
    places = {name: Place((0.1 * k, 0.0, 0.0), "x" if k == 0 else "z") for k, name in enumerate(SENSORS)}
    ax = plots.mode_shape(shape, places)
    (measured,) = [line for line in ax.lines if line.get_label() == "measured"]
    points = measured.get_xydata().reshape(-1, 3, 2)
    assert len(points) == size - 1
    assert np.isnan(points[:, 2]).all()
    # x goes right and up, z goes up: a motion along z changes no horizontal coordinate.
    rest = np.array([0.1 * k for k in range(size)]) * np.sqrt(0.75)
    assert np.sort(points[:, :2, 0].ravel())[-1] == pytest.approx(rest[-1])
    up = points[-1, 1, 1] - 0.5 * 0.1 * (size - 1)
    first = points[0, 0, 0] - rest[0]
    assert up / first == pytest.approx(shape.measured[-1] / (shape.measured[0] * np.sqrt(0.75)))
    assert {line.get_label() for line in ax.lines} >= {"measured", "updated", "initial"}
    FigureCanvasAgg(ax.get_figure()).draw()


def test_shapes_of_the_structure_are_brought_nearest_to_the_measured_ones():
    result = small_updating()
    for shape in result.mode_shapes:
        for other in (shape.structure, shape.initial):
            assert (shape.measured - other) @ other == pytest.approx(0, abs=1e-12)
        assert np.linalg.norm(shape.measured) == pytest.approx(1, abs=1e-3)
        assert shape.structure == pytest.approx(shape.measured, abs=0.02)
    bare = replace(result, linear=None).mode_shapes[0]
    assert bare.initial is None
    labels = [text.get_text() for text in plots.mode_shape(bare).get_legend().get_texts()]
    assert labels == ["measured", "structure"]
    alone = [replace(each, sensors=(CONTROLLED,), amplitude=np.abs(each.amplitude[:, 1:2])) for each in result.measured]
    assert replace(result, measured=tuple(alone)).mode_shapes == ()
