import numpy as np
import pytest
from made_beats import FOUR, FS, beat, measured

from opid.errors import InputError
from opid.modal.linear.modes import force_projection, modal_test
from opid.modal.model import NonlinearModalModel, modal_response
from opid.signals.recording import Channel, Recording

LEVEL = beat(5.0, whole_s=1.0, beat_s=0.3)


def recording(units=("N",) + 5 * ("m/s^2",), names=("force", *"abcde")):
    rng = np.random.default_rng(0)
    channels = tuple(Channel(name, unit) for name, unit in zip(names, units, strict=True))
    return Recording(rng.standard_normal((100, len(names))), fs=FS, channels=channels)


def test_the_filter_gives_back_the_modes():
    test = measured(NonlinearModalModel(FOUR), LEVEL)
    motion = modal_response(NonlinearModalModel(FOUR), LEVEL, fs=FS, drive_point="a")
    np.testing.assert_allclose(test.acceleration, motion.acceleration, atol=1e-9 * np.abs(motion.acceleration).max())
    np.testing.assert_allclose(test.modal_force(3), force_projection(FOUR, "a")[2] * LEVEL)


def test_velocities_are_differentiated():
    """As a laser vibrometer gives them: two of five sensors here."""
    model = NonlinearModalModel(FOUR)
    motion = modal_response(model, LEVEL, fs=FS, drive_point="a")
    rates = motion.velocity @ FOUR.shapes.T
    accelerations = motion.acceleration @ FOUR.shapes.T
    samples = np.column_stack([LEVEL, accelerations[:, :3], rates[:, 3:]])
    units = ("N", *3 * ("m/s^2",), *2 * ("m/s",))
    channels = tuple(Channel(name, unit) for name, unit in zip(("force", *"abcde"), units, strict=True))
    test = modal_test(Recording(samples, FS, channels), FOUR, name="t", force="force", drive_point="a")
    np.testing.assert_allclose(test.acceleration, motion.acceleration, atol=2e-3 * np.abs(motion.acceleration).max())
    assert {channel.unit for channel in test.recording.channels} == {"N", "m/s^2"}
    assert test.recording.history[-1] == "d, e: velocities differentiated to accelerations"


def test_the_order_of_channels_does_not_matter():
    one = recording()
    turned = Recording(one.samples[:, ::-1], fs=FS, channels=one.channels[::-1])
    both = [modal_test(each, FOUR, name="t", force="force", drive_point="a").acceleration for each in (one, turned)]
    np.testing.assert_allclose(both[0], both[1])


def test_a_missing_sensor_is_left_out_while_the_rest_can_tell_the_modes():
    names = ("force", *"abcd")
    fewer = modal_test(recording(("N",) + 4 * ("m/s^2",), names), FOUR, name="t", force="force", drive_point="a")
    assert fewer.acceleration.shape == (100, 4)
    with pytest.raises(InputError, match=r"3 sensor\(s\) cannot separate 4 modes"):
        modal_test(recording(("N",) + 3 * ("m/s^2",), ("force", *"abc")), FOUR, name="t")


@pytest.mark.parametrize(
    ("units", "names", "force", "drive", "words"),
    [
        (("lbf",) + 5 * ("m/s^2",), ("force", *"abcde"), "force", "a", "is in lbf where N"),
        (("V",) + 5 * ("m/s^2",), ("force", *"abcde"), "force", "a", "is in V where N"),
        (("N",) + 5 * ("V",), ("force", *"abcde"), "force", "a", "'a' of test 't' is in V where an acceleration, a v"),
        (("N",) + 5 * ("1",), ("force", *"abcde"), "force", "a", "'a' of test 't' is in 1 where an acceleration, a v"),
        (("N",) + 5 * ("m/s^2",), ("force", *"vwxyz"), "force", "a", "has none of the sensors 'a'"),
        (("N",) + 5 * ("m/s^2",), ("force", *"abcde"), "forse", "a", "there is no channel 'forse'"),
        (("N",) + 5 * ("m/s^2",), ("force", *"abcde"), "force", None, "name the sensor at which the force acts"),
        (("N",) + 5 * ("m/s^2",), ("force", *"abcde"), "force", "q", "there is no sensor 'q'"),
    ],
)
def test_what_is_wrong_is_said(units, names, force, drive, words):
    with pytest.raises(InputError, match=words):
        modal_test(recording(units, names), FOUR, name="t", force=force, drive_point=drive)


def test_a_force_cell_that_is_off_is_named():
    silent = Recording(
        np.column_stack([np.zeros(100), recording().samples[:, 1:]]), fs=FS, channels=recording().channels
    )
    with pytest.raises(InputError, match="is zero throughout"):
        modal_test(silent, FOUR, name="t", force="force", drive_point="a")


def test_the_modal_force_is_the_sum_over_the_shakers():
    given = recording(("N", "N") + 5 * ("m/s^2",), ("one", "two", *"abcde"))
    test = modal_test(given, FOUR, name="t", force={"one": "a", "two": "d"})
    sum_of_both = FOUR.row("a")[2] * given.channel("one") + FOUR.row("d")[2] * given.channel("two")
    np.testing.assert_allclose(test.modal_force(3), sum_of_both)
    assert test.drive_points == ("a", "d")
    with pytest.raises(InputError, match=r"2 forces \('one', 'two'\) where one is needed"):
        test.force  # noqa: B018


def test_one_force_is_the_case_of_several_with_one():
    one = modal_test(recording(), FOUR, name="t", force="force", drive_point="b")
    same = modal_test(recording(), FOUR, name="t", force={"force": "b"})
    np.testing.assert_array_equal(one.modal_force(2), same.modal_force(2))
    assert (same.drive_point, same.forces[0].channel) == ("b", "force")
