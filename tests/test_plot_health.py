"""The picture of a log's health: every fault is marked where it is, and every number has its unit."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from made_health import FS, channel_of, faulty_health, sound_health
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb

from opid import plots
from opid.errors import InputError
from opid.plots.health import KINDS, health_picture
from opid.plots.style import panels
from opid.signals.health.result import Health, SpectralLine, Stretch


@pytest.fixture(scope="module")
def faulty():
    return faulty_health()


@pytest.fixture(scope="module")
def drawn(faulty):
    return dict(zip([each.name for each in faulty.channels], health_picture(faulty), strict=True))


def spans(ax, kind):
    """Return begin and end of what is marked in the colour of a kind of fault, s."""
    found = set()
    for each in ax.collections:
        if isinstance(each, PolyCollection) and tuple(each.get_facecolor()[0][:3]) == to_rgb(KINDS[kind][1]):
            for path in each.get_paths():
                x = path.vertices[:, 0]
                found.add((round(float(x.min()), 6), round(float(x.max()), 6)))
    return sorted(found)


def texts(ax):
    return [each.get_text() for each in ax.texts]


def health_with(*channels, fs=FS):
    return Health(fs, 120.0, 60000, channels, None, ())


def test_every_stretch_is_marked_where_it_is(drawn):
    assert spans(drawn["holed"][0], "missing") == [(60.0, 66.0)]
    assert spans(drawn["holed"][0], "flat") == [(100.0, 104.0)]
    assert len(spans(drawn["lower_z"][0], "clipped")) == 100
    assert spans(drawn["upper_z"][0], "spike")[0] == (18.0, 18.002)
    for name in ("lower_z", "dead"):
        assert spans(drawn[name][0], "gap") == [(33.0, 36.5), (110.0, 110.01)]
    # another clock has no such gaps
    assert spans(drawn["oil temperature"][0], "gap") == []
    # nor does the spectrogram show motion where there was no sample
    assert spans(drawn["holed"][2], "missing") == [(60.0, 66.0)]


def test_the_legend_names_what_there_is_and_no_more(faulty, drawn):
    figure = plots.figure_of(drawn["dead"])
    (legend,) = figure.legends
    named = [each.get_text() for each in legend.get_texts()]
    assert named == [
        "least to largest value",
        "gap: no samples",
        "missing values",
        "clipped (the first 100 are drawn)",
        "held at one value",
        "spike",
    ]
    fine = health_picture(sound_health(1), segment_s=(20.0, 90.0))
    named = [each.get_text() for each in plots.figure_of(fine).legends[0].get_texts()]
    assert named == ["least to largest value", "segment that is used"]
    (shade,) = fine[0, 0].patches
    assert (shade.get_x(), shade.get_x() + shade.get_width()) == (20.0, 90.0)


def test_a_spike_does_not_stretch_the_scale_and_is_told(faulty, drawn):
    low, high = drawn["upper_z"][0].get_ylim()
    assert -10 < low < -1
    assert 1 < high < 10
    assert texts(drawn["upper_z"][0]) == ["spikes reach −900.7 and 4000"]
    # an impact is no spike: it is shown whole
    impact = np.random.default_rng(0).standard_normal(60000)
    impact[30000:30100] += 500.0
    ax = health_picture(health_with(channel_of("upper_z", impact)))[0, 0]
    assert ax.get_ylim()[1] > 500
    assert texts(ax) == []


def test_lines_are_marked_at_their_frequencies_and_named(drawn):
    ax = drawn["hum"][1]
    marked = sorted(float(line.get_xdata()[0]) for line in ax.lines if line.get_marker() == "o")
    assert marked == [23.4, 50.0, 100.0, 150.0, 200.0]
    assert "mains, 50 Hz, and harmonics 2, 3, 4" in texts(ax)
    assert "23.4 Hz" in texts(ax)


def test_harmonics_without_their_mains_are_named():
    lines = (SpectralLine(180.0, 0.1, "harmonic 3 of the mains (60 Hz)", 3),)
    channel = channel_of("lower_z", np.random.default_rng(0).standard_normal(5000), lines=lines)
    assert "mains (60 Hz): harmonic 3" in texts(health_picture(health_with(channel))[0, 1])


def test_the_noise_floor_is_drawn_as_a_density():
    channel = channel_of("lower_z", np.random.default_rng(0).standard_normal(60000), noise_floor=1.0)
    ax = health_picture(health_with(channel))[0, 1]
    (floor,) = [line for line in ax.lines if line.get_linestyle() == "--"]
    (density,) = [line for line in ax.lines if line.get_linestyle() == "-"]
    # the signal is white noise of rms 1: its spectrum lies on the floor
    assert np.median(density.get_ydata()) == pytest.approx(floor.get_ydata()[0], rel=0.05)
    assert "noise at most 1 m/s² rms" in texts(ax)


def test_axes_carry_their_units(drawn):
    assert [ax.get_ylabel() for ax in drawn["lower_z"]] == ["[m/s²]", "[(m/s²)²/Hz]", "[Hz]"]
    assert [ax.get_ylabel() for ax in drawn["oil temperature"]] == ["[K]", "[K²/Hz]", "[Hz]"]
    assert [ax.get_ylabel() for ax in drawn["hum"]][:2] == ["[no unit]", "[1/Hz]"]
    assert [ax.get_xlabel() for ax in drawn["oil temperature"]] == ["time [s]", "frequency [Hz]", "time [s]"]
    assert "mute" in drawn["dead"][0].get_title(loc="left")


def test_twelve_channels_are_drawn_without_overlap():
    grid = health_picture(sound_health(12))
    figure = plots.figure_of(grid)
    assert plots.png(figure, dpi=40).startswith(b"\x89PNG")
    boxes = [ax.get_tightbbox() for ax in grid[:, 0]]
    assert all(above.y0 > below.y1 - 1 for above, below in pairwise(boxes))


def test_some_channels_on_given_axes(faulty):
    mine = panels(None, 2, 3, height_in=4)
    grid = health_picture(faulty, mine, channels=["holed", "lower_z"])
    assert (grid == mine).all()
    assert grid[0, 0].get_title(loc="left").startswith("holed")
    assert plots.figure_of(mine).legends == []
    assert grid[0, 0].get_legend() is not None


@pytest.mark.parametrize(("names", "word"), [(["lower"], "did you mean 'lower_z'"), ([], "no channel to draw")])
def test_what_cannot_be_drawn_is_refused(faulty, names, word):
    with pytest.raises(InputError, match=word):
        health_picture(faulty, channels=names)


def test_a_channel_without_values_or_overview_is_still_shown(faulty):
    empty = replace(faulty.channels[0], overview=None, lines=())
    overview = faulty.channels[0].overview
    nothing = replace(
        empty,
        stretches=(Stretch("missing", 0.0, 120.0),),
        overview=replace(
            overview,
            lowest=np.full_like(overview.lowest, np.nan),
            highest=np.full_like(overview.highest, np.nan),
            psd=np.zeros_like(overview.psd),
            spectrogram=np.zeros_like(overview.spectrogram),
        ),
    )
    grid = health_picture(health_with(empty, nothing))
    assert texts(grid[0, 0]) == texts(grid[1, 0]) == ["no values"]
    assert plots.png(plots.figure_of(grid), dpi=40).startswith(b"\x89PNG")


def test_names_are_drawn_as_they_are_and_long_ones_without_their_middle():
    samples = np.random.default_rng(0).standard_normal(500)
    names = ("$x^{$", "a/" * 50 + "upper_z", "up\nper")
    grid = health_picture(health_with(*(channel_of(name, samples) for name in names)))
    assert plots.png(plots.figure_of(grid), dpi=40).startswith(b"\x89PNG")
    titles = [ax.get_title(loc="left").split(",")[0] for ax in grid[:, 0]]
    assert titles[0] == "$x^{$"
    assert titles[1].startswith("a/a/a/")
    assert titles[1].endswith("…/upper_z")
    assert len(titles[1]) == 26
    assert titles[2] == "up per"


def test_a_log_of_few_samples_is_drawn():
    channel = channel_of("lower_z", np.array([0.0, 1.0, 0.5, 0.2]))
    short = replace(channel, overview=replace(channel.overview, spectrogram_s=np.array([0.004])))
    assert plots.png(plots.figure_of(health_picture(health_with(short))), dpi=40).startswith(b"\x89PNG")


def test_many_channels_are_drawn_without_minor_ticks_which_take_most_of_the_time():
    few, many = (health_picture(sound_health(n)) for n in (2, 7))
    assert few[0, 1].xaxis.get_minorticklocs().size > 0
    assert all(ax.xaxis.get_minorticklocs().size == ax.yaxis.get_minorticklocs().size == 0 for ax in many.flat)
