import numpy as np
import pytest
from scipy import signal

from opid.errors import InputError
from opid.modal.forced.excitation import (
    SineBeat,
    beat_between_neighbours,
    beat_over_drive_point_peak,
    first_minimum_hz,
    main_lobe_width_hz,
    quiet_s,
    shaped_sweep,
    sine_beat_voltage,
)
from opid.modal.linear.frequency_response import resynthesised
from opid.modal.linear.modes import LinearModes

FS = 2048.0
MODES = LinearModes(
    [0.0, 90.0, 120.0, 165.0],
    [0.0, 0.005, 0.004, 0.006],
    [[0.4, 0.5, 0.3, 0.4], [0.4, -0.2, 0.5, -0.3], [0.4, 0.1, -0.4, 0.0]],
    ("a", "b", "c"),
)
WINDOWS = ["blackmanharris", "hann", "flattop", "nuttall", ("kaiser", 10.0), ("tukey", 0.5), "boxcar"]


def spectrum_at(voltage, frequency_hz, fs=FS):
    """|V| at any frequencies, not those of the record's lines alone."""
    return np.abs(np.exp(-2j * np.pi * np.multiply.outer(frequency_hz, np.arange(voltage.size) / fs)) @ voltage) / fs


@pytest.mark.parametrize(
    ("window", "minimum"),
    [
        ("boxcar", 1.0),
        ("hann", 2.0),
        ("blackman", 3.0),
        ("blackmanharris", 4.0),
        ("nuttall", 4.0),
        ("flattop", 5.0),
        # the kaiser window's transform is sinh(sqrt(beta^2 - (pi x)^2)) / sqrt(...), zero at sqrt(1 + (beta/pi)^2)
        (("kaiser", 10.0), np.hypot(1, 10.0 / np.pi)),
    ],
)
def test_the_first_minimum_has_its_closed_form(window, minimum):
    for duration_s in (0.3, 1.0, 7.0):
        assert first_minimum_hz(window, duration_s) * duration_s == pytest.approx(minimum, rel=1e-5)
    assert main_lobe_width_hz(window, 1.0) == pytest.approx(2 * minimum, rel=1e-5)


@pytest.mark.parametrize("window", WINDOWS)
def test_the_width_at_a_level_is_where_the_spectrum_has_it(window):
    beat = SineBeat(200.0, 1.0, window)
    width = main_lobe_width_hz(window, 1.0, level_db=-6.0)
    centre, low, high = spectrum_at(sine_beat_voltage(beat, FS), [200.0, 200.0 - width / 2, 200.0 + width / 2])
    np.testing.assert_allclose([low, high], 10 ** (-6 / 20) * centre, rtol=5e-3)
    assert width < main_lobe_width_hz(window, 1.0, level_db=-10.0) < main_lobe_width_hz(window, 1.0)


@pytest.mark.parametrize("window", ["hann", "blackmanharris", "flattop", ("kaiser", 12.0)])
def test_a_beat_between_neighbours_has_its_minima_on_the_nearer_one(window):
    # far up, where the negative frequencies do not reach
    modes = LinearModes([360.0, 400.0, 430.0], [0.004] * 3, [[0.5] * 3], ("a",))
    design = beat_between_neighbours(modes, 2, window=window)
    assert design.beat.centre_hz == 400.0
    assert design.first_minimum_hz == pytest.approx(30.0)
    # samples end a window within one of its duration
    duration = design.beat.duration_s
    fs = round(4096 * duration) / duration
    voltage = sine_beat_voltage(design.beat, fs)
    near = np.linspace(-0.3, 0.3, 121)
    around = spectrum_at(voltage, 430.0 + near, fs)
    peak = spectrum_at(voltage, [400.0], fs)[0]
    assert around.min() < 1e-4 * peak
    assert abs(near[np.argmin(around)]) < 0.2


def test_the_energy_of_a_beat_lies_in_its_main_lobe():
    design = beat_between_neighbours(MODES, 3)
    voltage = sine_beat_voltage(design.beat, FS)
    frequency = np.fft.rfftfreq(16 * voltage.size, 1 / FS)
    power = np.abs(np.fft.rfft(voltage, 16 * voltage.size)) ** 2
    outside = np.abs(frequency - 120.0) > design.first_minimum_hz
    assert power[outside].sum() < 1e-6 * power.sum()


def test_a_beat_is_a_window_times_a_sine_between_quiet_times():
    beat = SineBeat(100.0, 0.5, "hann", amplitude=3.0, lead_s=0.25, tail_s=0.75)
    voltage = sine_beat_voltage(beat, 1024.0)
    time = np.arange(1536) / 1024 - 0.25
    inside = (time >= 0) & (time <= 0.5)
    expected = np.where(inside, 3.0 * np.sin(np.pi * time / 0.5) ** 2 * np.sin(2 * np.pi * 100 * time), 0)
    np.testing.assert_allclose(voltage, expected, atol=1e-12)


def test_a_mode_at_the_edge_has_one_neighbour():
    design = beat_between_neighbours(MODES, 2)
    assert design.first_minimum_hz == pytest.approx(30.0)  # rigid-body modes are no neighbours
    assert "90" not in design.reason
    assert "above" in design.reason


def test_the_quiet_time_is_what_the_mode_takes_to_decay():
    design = beat_between_neighbours(MODES, 3)
    assert design.beat.tail_s == pytest.approx(quiet_s(MODES, 3))
    zeta, omega = 0.004, 2 * np.pi * 120.0
    assert np.exp(-zeta * omega * quiet_s(MODES, 3, decay_to=0.01)) == pytest.approx(0.01)


def test_the_peak_of_a_single_mode_has_its_closed_form():
    # |Im| of an accelerance at f = f0 (1 + zeta x) is 1 / (1 + x^2) of its peak: 5 % at x = sqrt(19)
    modes = LinearModes([100.0], [0.003], [[0.5]], ("a",))
    for fraction in (0.05, 0.2, 0.5):
        design = beat_over_drive_point_peak(modes, 1, "a", fraction=fraction)
        assert 2 * design.first_minimum_hz == pytest.approx(2 * 0.3 * np.sqrt(1 / fraction - 1), rel=0.02)
        assert design.beat.duration_s == pytest.approx(4 / design.first_minimum_hz, rel=1e-6)


def test_a_lower_level_of_the_lobe_makes_a_shorter_beat_of_the_same_band():
    whole = beat_over_drive_point_peak(MODES, 3, "b")
    at_20 = beat_over_drive_point_peak(MODES, 3, "b", level_db=-20.0)
    assert at_20.beat.duration_s < whole.beat.duration_s
    voltage = sine_beat_voltage(at_20.beat, FS)
    edge = 120.0 + whole.first_minimum_hz
    assert spectrum_at(voltage, [edge])[0] / spectrum_at(voltage, [120.0])[0] == pytest.approx(0.1, rel=0.02)


def test_a_measured_response_gives_the_band_of_the_modes_it_shows():
    by_modes = beat_over_drive_point_peak(MODES, 3, "b")
    rng = np.random.default_rng(0)
    response = resynthesised(MODES, np.arange(0, 400, 0.05), "b")
    noise = 1 + 0.01 * (rng.standard_normal(response.value.shape) + 1j * rng.standard_normal(response.value.shape))
    noisy = type(response)(response.frequency_hz, response.value * noise, response.sensors, "b")
    measured = beat_over_drive_point_peak(MODES, 3, "b", response=noisy)
    assert measured.first_minimum_hz == pytest.approx(by_modes.first_minimum_hz, rel=0.15)


def test_a_band_ends_half_way_to_the_neighbour_at_the_latest():
    close = LinearModes([98.0, 100.0, 102.0], [0.02] * 3, [[0.5] * 3], ("a",))
    design = beat_over_drive_point_peak(close, 2, "a")
    assert design.first_minimum_hz == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("kind", ["linear", "logarithmic"])
@pytest.mark.parametrize(("start_hz", "stop_hz"), [(20.0, 200.0), (200.0, 20.0), (50.0, 50.0)])
def test_the_frequency_of_a_sweep_is_the_one_asked_for(kind, start_hz, stop_hz):
    duration = 8.0
    sweep = shaped_sweep([1], [1], start_hz=start_hz, stop_hz=stop_hz, duration_s=duration, fs=4096.0, kind=kind)
    time = np.arange(sweep.size) / 4096.0
    if kind == "linear":
        expected = start_hz + (stop_hz - start_hz) * time / duration
    else:
        expected = start_hz * (stop_hz / start_hz) ** (time / duration)
    now = np.gradient(np.unwrap(np.angle(signal.hilbert(sweep))), 1 / 4096.0) / (2 * np.pi)
    inside = slice(sweep.size // 10, -sweep.size // 10)
    np.testing.assert_allclose(now[inside], expected[inside], rtol=0.02)
    # scipy's chirp has the same phase
    method = "linear" if kind == "linear" else "logarithmic"
    np.testing.assert_allclose(
        sweep, signal.chirp(time, start_hz, duration, stop_hz, method=method, phi=-90), atol=1e-8
    )


def test_the_amplitude_of_a_sweep_follows_its_frequency_and_the_ends_are_smooth():
    points, heights = [20.0, 60.0, 100.0, 180.0], [1.0, 4.0, 0.5, 2.0]
    settings = {"start_hz": 10.0, "stop_hz": 200.0, "duration_s": 20.0, "fs": 2048.0}
    sweep = shaped_sweep(points, heights, **settings, fade_s=0.5)
    now = 10 + 190 * np.arange(sweep.size) / sweep.size
    envelope = np.abs(signal.hilbert(sweep))
    inside = (now > 20) & (now < 190)
    np.testing.assert_allclose(envelope[inside], np.interp(now[inside], points, heights), atol=0.08)
    assert sweep[0] == sweep[-1] == 0
    faded, plain = envelope, np.abs(signal.hilbert(shaped_sweep(points, heights, **settings)))
    np.testing.assert_allclose(faded[512] / plain[512], 0.5, atol=0.05)
    assert np.abs(sweep).max() <= 4.0


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: SineBeat(0.0, 1.0), "centre_hz is 0.0"),
        (lambda: SineBeat(10.0, np.nan), "duration_s is nan"),
        (lambda: SineBeat(10.0, 0.2), "holds 2 periods of 10 Hz.*three periods"),
        (lambda: SineBeat(10.0, 1.0, lead_s=-1.0), "lead_s is -1.0"),
        (lambda: SineBeat(10.0, 1.0, amplitude=np.inf), "amplitude is inf"),
        (lambda: SineBeat(10.0, 1.0, "blackmanharis"), "scipy does not make"),
        (lambda: SineBeat(10.0, 1.0, "kaiser"), "scipy does not make"),
        (lambda: SineBeat(10.0, 1.0, ("gaussian", 7.0)), "counts samples"),
        (lambda: sine_beat_voltage(SineBeat(900.0, 1.0), FS), "sample at 2304 Hz or more"),
        (lambda: sine_beat_voltage(SineBeat(900.0, 1.0), -1.0), "fs is -1.0"),
        (lambda: first_minimum_hz("hann", 0.0), "duration_s is 0.0"),
        (lambda: main_lobe_width_hz("hann", 1.0, level_db=3.0), "negative number of decibels"),
        (lambda: main_lobe_width_hz(("tukey", 0.25), 1.0, level_db=-400.0), "ends above -400 dB"),
        (lambda: quiet_s(MODES, 1), "mode 1 has no damping"),
        (lambda: quiet_s(MODES, 2, decay_to=2.0), "decay_to is 2.0"),
        (lambda: beat_between_neighbours(MODES, 1), "mode 1 is a rigid-body mode"),
        (lambda: beat_between_neighbours(MODES, 9), "from 1 to 4"),
        (lambda: beat_over_drive_point_peak(MODES, 4, "c"), "does not move at 'c'"),
        (lambda: beat_over_drive_point_peak(MODES, 3, "e"), "no sensor 'e'"),
        (lambda: beat_over_drive_point_peak(MODES, 3, "a", fraction=1.5), "fraction is 1.5"),
    ],
)
def test_beats_that_cannot_be_are_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


def test_modes_that_leave_no_beat_are_refused():
    alone = LinearModes([0.0, 50.0], [0.0, 0.01], [[1.0, 1.0], [1.0, -1.0]], ("a", "b"))
    with pytest.raises(InputError, match="no elastic neighbour"):
        beat_between_neighbours(alone, 2)
    twins = LinearModes([50.0, 50.0], [0.01] * 2, [[1.0, 1.0]], ("a",))
    with pytest.raises(InputError, match="at its own frequency"):
        beat_between_neighbours(twins, 1)
    far = LinearModes([10.0, 90.0], [0.01] * 2, [[1.0, 1.0]], ("a",))
    with pytest.raises(InputError, match=r"three periods.*rule that designed it.*80 Hz above"):
        beat_between_neighbours(far, 1)
    undamped = LinearModes([10.0], [0.0], [[1.0]], ("a",))
    with pytest.raises(InputError, match="no damping: its peak has no width"):
        beat_over_drive_point_peak(undamped, 1, "a")


def test_responses_that_do_not_show_the_peak_are_refused():
    with pytest.raises(InputError, match="to a force at 'a'"):
        beat_over_drive_point_peak(MODES, 3, "b", response=resynthesised(MODES, np.arange(0, 300, 0.1), "a"))
    with pytest.raises(InputError, match="narrower than the lines"):
        beat_over_drive_point_peak(MODES, 3, "b", response=resynthesised(MODES, np.arange(0, 300, 3.0), "b"))
    with pytest.raises(InputError, match="around mode 3: give one with finer lines"):
        beat_over_drive_point_peak(MODES, 3, "b", response=resynthesised(MODES, np.arange(0, 300, 30.0), "b"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frequency_hz": [20.0, 10.0]}, "sort them"),
        ({"amplitude": [1.0, np.nan]}, "must be finite"),
        ({"amplitude": [1.0]}, "one amplitude for each frequency"),
        ({"start_hz": 0.0}, "start_hz is 0.0"),
        ({"stop_hz": 900.0}, "fs / 2.56"),
        ({"kind": "quadratic"}, "no sweep of kind 'quadratic'"),
        ({"fade_s": 6.0}, "give 0 to half of the sweep"),
        ({"duration_s": 1e-4}, "at least two"),
    ],
)
def test_sweeps_that_cannot_be_are_refused(change, words):
    given = {"frequency_hz": [10.0, 20.0], "amplitude": [1.0, 2.0], "start_hz": 10.0, "stop_hz": 20.0}
    given |= {"duration_s": 10.0, "fs": FS}
    given |= change
    points = given.pop("frequency_hz"), given.pop("amplitude")
    with pytest.raises(InputError, match=words):
        shaped_sweep(*points, **given)
