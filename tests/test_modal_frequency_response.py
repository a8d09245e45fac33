import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.structure import Structure, frequency_response
from opid.modal.linear.frequency_response import cmif, measured_response, resynthesised
from opid.modal.linear.modes import LinearModes, modal_test, modes_of_structure
from opid.modal.model import NonlinearModalModel, simulate
from opid.signals.recording import Channel, Recording

FS, N = 2048.0, 8192
SENSORS = ("a", "b", "c", "d")
MODES = LinearModes(
    [0.0, 42.0, 97.0, 180.0],
    [0.0, 0.01, 0.01, 0.008],
    [[0.4, 0.5, 0.3, 0.4], [0.4, -0.2, 0.5, -0.3], [0.4, 0.1, -0.4, 0.5], [0.4, -0.5, -0.35, -0.4]],
    SENSORS,
)


def recorded(force, *, name="hit", noise=0.0, rng=None, drive_point="a", sensors=SENSORS):
    """What a logger records of a linear structure under a force."""
    motion = simulate(NonlinearModalModel(MODES), force, fs=FS, drive_point=drive_point)
    columns = np.column_stack([*(motion.channel(sensor) for sensor in sensors), force])
    if noise:
        columns = columns + noise * columns.std(axis=0) * rng.standard_normal(columns.shape)
    channels = (*(Channel(sensor, "m/s^2") for sensor in sensors), Channel("force", "N"))
    recording = Recording(columns, fs=FS, channels=channels)
    return modal_test(recording, MODES, name=name, force="force", drive_point=drive_point)


def impact(newton=100.0, n=N):
    return newton * np.exp(-0.5 * ((np.arange(n) - 40) / 3) ** 2)


@pytest.fixture(scope="module")
def hit():
    return recorded(impact())


def test_the_accelerance_of_modes_is_that_of_the_structure():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((4, 4))
    mass, stiffness = np.diag(rng.uniform(1, 3, 4)), 1e4 * (root @ root.T + np.eye(4))
    structure = Structure(mass, 0.3 * mass + 1e-5 * stiffness, stiffness)
    modes = modes_of_structure(structure, np.eye(4), SENSORS)
    lines = np.linspace(0.5, 100, 150)
    receptance = frequency_response(structure, lines)[:, :, 2]
    np.testing.assert_allclose(
        resynthesised(modes, lines, "c").value, -((2 * np.pi * lines[:, None]) ** 2) * receptance, rtol=1e-8, atol=1e-12
    )


def test_an_impact_shows_the_response_of_the_modes(hit):
    measured = measured_response([hit])
    band = (measured.frequency_hz > 5) & (measured.frequency_hz < 250)
    expected = resynthesised(MODES, measured.frequency_hz[band], "a")
    assert measured.sensors == expected.sensors == SENSORS
    assert measured.drive_point == "a"
    assert measured.coherence is None
    # what is missing is the decay after the end of the record, and the last digits of the time steps
    error = np.abs(measured.value[band] - expected.value).max(axis=0)
    np.testing.assert_array_less(error, 1e-3 * np.abs(expected.value).max(axis=0))


def test_responses_are_reciprocal():
    lines = np.linspace(1, 200, 50)
    ab = resynthesised(MODES, lines, "a").value[:, SENSORS.index("c")]
    ba = resynthesised(MODES, lines, "c").value[:, SENSORS.index("a")]
    np.testing.assert_allclose(ab, ba, rtol=1e-12)


def test_only_the_rigid_body_mode_is_left_at_zero_frequency():
    np.testing.assert_allclose(resynthesised(MODES, [0.0], "a").value[0], 0.4 * 0.4, rtol=1e-12)


def test_averages_take_out_noise_of_the_response():
    rng = np.random.default_rng(4)
    tests = [recorded(impact(newton), name=str(newton), noise=0.05, rng=rng) for newton in np.linspace(50, 100, 16)]
    one, all_of_them = measured_response(tests[:1]), measured_response(tests)
    band = (one.frequency_hz > 30) & (one.frequency_hz < 200)
    expected = resynthesised(MODES, one.frequency_hz[band], "a").value
    errors = [np.sqrt(np.mean(np.abs(each.value[band] - expected) ** 2)) for each in (one, all_of_them)]
    assert errors[1] < 0.5 * errors[0]
    assert all_of_them.n_averages == 16
    assert all_of_them.coherence.shape == all_of_them.value.shape
    assert ((all_of_them.coherence >= 0) & (all_of_them.coherence <= 1)).all()


def test_records_of_different_lengths_are_averaged_as_if_at_rest_after_their_end(hit):
    shorter = recorded(impact(n=N - 1000), name="shorter")
    both = measured_response([hit, shorter])
    alone = measured_response([hit])
    band = (alone.frequency_hz > 30) & (alone.frequency_hz < 200)
    np.testing.assert_allclose(both.value[band], alone.value[band], atol=0.02 * np.abs(alone.value[band]).max())


def test_stationary_excitation_is_averaged_in_blocks():
    force = 10 * np.random.default_rng(2).standard_normal(8 * N)
    found = measured_response([recorded(force)], nperseg=N)
    assert found.n_averages > 8
    band = (found.frequency_hz > 30) & (found.frequency_hz < 200)
    expected = resynthesised(MODES, found.frequency_hz[band], "a").value
    assert np.median(np.abs(found.value[band] / expected - 1)) < 0.03
    assert np.median(found.coherence[band]) > 0.98


def test_a_line_without_force_has_no_response():
    time = np.arange(64) / 64
    samples = np.column_stack([np.cos(2 * np.pi * 8 * time), np.zeros(64)])
    samples[::2, 1] = 1.0  # a constant and the highest line, nothing between
    recording = Recording(samples, fs=64.0, channels=(Channel("a", "m/s^2"), Channel("force", "N")))
    modes = LinearModes([0.0], [0.0], [[0.5]], ("a",))
    response = measured_response([modal_test(recording, modes, name="t", force="force", drive_point="a")])
    assert np.isfinite(response.value[[0, -1]]).all()
    assert np.isnan(response.value[1:-1]).all()
    assert np.isnan(cmif([response]).value[1:-1]).all()


def test_the_mode_indicator_of_one_drive_point_is_the_length_of_the_response():
    response = resynthesised(MODES, np.linspace(10, 200, 100), "b")
    found = cmif([response])
    np.testing.assert_allclose(found.value[:, 0], np.linalg.norm(response.value, axis=1))


def test_two_drive_points_tell_two_modes_at_one_frequency_apart():
    shapes = 0.5 * np.array([[1, 1, 1], [1, -1, 1], [1, 1, -1], [1, -1, -1]])
    modes = LinearModes([50.0, 50.01, 90.0], [0.005] * 3, shapes, SENSORS)
    lines = np.linspace(40, 100, 1201)
    found = cmif([resynthesised(modes, lines, "a"), resynthesised(modes, lines, "b")])

    assert (np.diff(found.value, axis=1) <= 0).all()
    double, single = np.argmin(np.abs(lines - 50.0)), np.argmin(np.abs(lines - 90.0))
    # at the double frequency the second value peaks, too; at the single one it does not
    assert lines[np.argmax(found.value[:, 1])] == pytest.approx(50.0, abs=0.1)
    fraction = found.value[:, 1] / found.value[:, 0]
    assert fraction[double] > 5 * fraction[single]


def test_what_cannot_be_averaged_is_refused(hit):
    with pytest.raises(InputError, match="there is no test"):
        measured_response([])
    with pytest.raises(InputError, match="average tests of one drive point"):
        measured_response([hit, recorded(impact(), name="other", drive_point="b")])
    fewer = LinearModes(MODES.frequency_hz[:3], MODES.damping_ratio[:3], MODES.shapes[:3, :3], SENSORS[:3])
    with pytest.raises(InputError, match="different sensors"):
        measured_response([hit, modal_test(hit.recording, fewer, name="fewer", force="force", drive_point="a")])
    decay = modal_test(hit.recording, MODES, name="decay")
    with pytest.raises(InputError, match="'decay' has no force"):
        measured_response([decay])
    slow = Recording(hit.recording.samples, fs=1000.0, channels=hit.recording.channels)
    with pytest.raises(InputError, match="resample them to one rate"):
        measured_response([hit, modal_test(slow, MODES, name="slow", force="force", drive_point="a")])
    with pytest.raises(InputError, match="no longer than the run"):
        measured_response([hit], nperseg=2 * N)


def test_what_cannot_be_synthesised_is_refused():
    with pytest.raises(InputError, match="no damping and its resonance falls on 10 Hz"):
        resynthesised(LinearModes([10.0], [0.0], [[1.0]], ("a",)), [5.0, 10.0], "a")
    with pytest.raises(InputError, match="finite frequencies from 0 up"):
        resynthesised(MODES, [-1.0], "a")
    with pytest.raises(InputError, match="no sensor 'e'"):
        resynthesised(MODES, [1.0], "e")
    lines = np.linspace(1, 10, 10)
    with pytest.raises(InputError, match="no response"):
        cmif([])
    with pytest.raises(InputError, match="different lines"):
        cmif([resynthesised(MODES, lines, "a"), resynthesised(MODES, 2 * lines, "b")])
    few = LinearModes([10.0], [0.1], [[1.0]], ("a",))
    with pytest.raises(InputError, match="different sensors"):
        cmif([resynthesised(MODES, lines, "a"), resynthesised(few, lines, "a")])
