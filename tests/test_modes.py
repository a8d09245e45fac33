import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.structure import Joint, Structure
from opid.modal.linear.modes import (
    LinearModes,
    condition_number,
    force_projection,
    modal_filter,
    modes_of_structure,
    with_sensors,
)

SENSORS = ("a", "b", "c", "d")


def some_modes(n_modes=3, seed=0):
    rng = np.random.default_rng(seed)
    shapes = rng.standard_normal((len(SENSORS), n_modes))
    return LinearModes(np.arange(n_modes) * 30.0, np.full(n_modes, 0.004), shapes, SENSORS)


def chain(n_dof=5, stiffness=4e5, mass=2.0):
    """Free masses in a row: the first mode is a rigid-body mode."""
    joints = []
    for place in range(n_dof - 1):
        direction = np.zeros(n_dof)
        direction[place : place + 2] = -1.0, 1.0
        joints.append(Joint(f"spring {place}", direction, stiffness, 1e-5 * stiffness))
    return Structure(mass * np.eye(n_dof), np.zeros((n_dof, n_dof)), np.zeros((n_dof, n_dof)), tuple(joints))


@pytest.mark.parametrize("seed", range(5))
def test_the_filter_returns_the_modal_coordinates_of_any_motion(seed):
    modes = some_modes(seed=seed)
    q = np.random.default_rng(seed + 100).standard_normal((50, 3))
    np.testing.assert_allclose(q @ modes.shapes.T @ modal_filter(modes).T, q, atol=1e-10)


def test_the_filter_leaves_the_least_squares_residual_normal_to_the_shapes():
    modes = some_modes()
    x = np.random.default_rng(3).standard_normal(4)
    residual = x - modes.shapes @ (modal_filter(modes) @ x)
    np.testing.assert_allclose(modes.shapes.T @ residual, 0, atol=1e-12)


def test_a_force_projects_on_the_modes_by_the_row_of_its_place():
    modes = some_modes()
    np.testing.assert_array_equal(force_projection(modes, "c"), modes.shapes.T @ [0, 0, 1, 0])


def test_the_modes_of_a_free_chain_have_their_closed_form():
    n, k, m = 5, 4e5, 2.0
    modes = modes_of_structure(chain(n, k, m), np.eye(n), [f"x{i}" for i in range(n)])
    expected = 2 * np.sqrt(k / m) * np.sin(np.arange(n) * np.pi / (2 * n)) / (2 * np.pi)
    np.testing.assert_allclose(modes.frequency_hz, expected, rtol=1e-9, atol=1e-3)
    assert modes.elastic.tolist() == [False, True, True, True, True]
    # stiffness-proportional damping: zeta = beta omega / 2; that of the rigid-body mode is taken for 0
    np.testing.assert_allclose(modes.damping_ratio, 1e-5 * np.pi * modes.frequency_hz, rtol=1e-6, atol=1e-12)
    # mass-normalised: the rigid-body mode carries the whole mass
    np.testing.assert_allclose(np.abs(modes.shapes[:, 0]), 1 / np.sqrt(n * m), rtol=1e-9)


def test_stiffness_and_damping_follow_from_frequency_and_ratio():
    modes = LinearModes([0.0, 10.0], [0.0, 0.01], [[1.0, 1.0]], ("a",))
    np.testing.assert_allclose(modes.stiffness(), [0.0, (20 * np.pi) ** 2])
    np.testing.assert_allclose(modes.damping(), [0.0, 2 * 0.01 * 20 * np.pi])


def test_orthogonal_shapes_have_condition_one_and_alike_ones_a_high_one():
    orthogonal, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 3)))
    assert condition_number(LinearModes([1, 2, 3], [0] * 3, orthogonal, SENSORS)) == pytest.approx(1)
    alike = np.column_stack([orthogonal[:, 0], orthogonal[:, 0] + 0.01 * orthogonal[:, 1]])
    assert condition_number(LinearModes([1, 2], [0] * 2, alike, SENSORS)) > 100


def test_sensors_are_chosen_in_the_order_asked_for():
    modes = some_modes()
    chosen = with_sensors(modes, ["d", "a"])
    assert chosen.sensors == ("d", "a")
    np.testing.assert_array_equal(chosen.shapes, modes.shapes[[3, 0]])


def test_modes_do_not_change_with_the_arrays_they_came_from():
    frequency = np.array([1.0, 2.0])
    modes = LinearModes(frequency, [0.0, 0.0], [[1.0, 1.0]], ("a",))
    frequency[0] = 9.0
    assert modes.frequency_hz[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        modes.shapes[0, 0] = 2.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frequency_hz": [1.0, 2.0]}, "one value for each mode"),
        ({"frequency_hz": [[1.0, 2.0, 3.0]]}, "give one number a mode"),
        ({"frequency_hz": [1.0, np.nan, 3.0]}, "not finite"),
        ({"frequency_hz": [-1.0, 2.0, 3.0]}, "give 0 for rigid-body modes"),
        ({"damping_ratio": [0.4, 1.2, 0.3]}, r"mode 2 is 1.2.*0.004, not 0.4 %"),
        ({"damping_ratio": [-0.1, 0.2, 0.3]}, "mode 1 is -0.1"),
        ({"shapes": np.ones((3, 4)), "sensors": tuple("abc")}, "one value for each mode"),
        ({"shapes": np.column_stack([np.ones((4, 2)), np.zeros(4)])}, "mode 3 is zero at every sensor"),
        ({"shapes": np.ones(4)}, "one row a sensor and one column a mode"),
        ({"sensors": ("a", "b", "c")}, "give one for each row"),
        ({"sensors": ("a", "b", "c", "a")}, "'a' is named 2 times"),
    ],
)
def test_what_cannot_be_is_refused(change, words):
    given = {"frequency_hz": [0.0, 1.0, 2.0], "damping_ratio": [0.0] * 3, "shapes": np.ones((4, 3)), "sensors": SENSORS}
    with pytest.raises(InputError, match=words):
        LinearModes(**{**given, **change})


def test_transposed_shapes_are_recognised():
    with pytest.raises(InputError, match="sensors x modes: transpose them"):
        LinearModes([1.0, 2.0, 3.0, 4.0], [0.0] * 4, np.ones((4, 3)), SENSORS)


def test_too_few_or_dependent_sensors_are_refused_by_the_filter():
    with pytest.raises(InputError, match="cannot separate 3 modes"):
        modal_filter(with_sensors(some_modes(), ["a", "b"]))
    with pytest.raises(InputError, match="depend on each other"):
        modal_filter(LinearModes([1, 2], [0, 0], [[1, 2], [1, 2], [2, 4]], ("a", "b", "c")))


def test_unknown_sensors_and_modes_are_named():
    modes = LinearModes([1.0], [0.0], [[1.0]], ("nose",))
    with pytest.raises(InputError, match="did you mean 'nose'"):
        modes.row("nosee")
    for mode in (0, 2):
        with pytest.raises(InputError, match="from 1 to 1"):
            modes.index(mode)


@pytest.mark.parametrize(
    ("shapes", "sensors", "words"),
    [
        ([[1.0 + 1j]], ("a",), "shapes is complex: give real normal modes"),
        ([["x"]], ("a",), "shapes is not an array of numbers"),
        ([[1.0]], "a", "sensors is 'a': give a sequence of names"),
    ],
)
def test_what_is_no_real_shape_is_refused(shapes, sensors, words):
    with pytest.raises(InputError, match=words):
        LinearModes([10.0], [0.01], shapes, sensors)


def test_sensors_that_miss_a_mode_are_named():
    modes = LinearModes([10.0, 20.0], [0.01, 0.01], [[1.0, 0.0], [0.0, 1.0]], ("a", "b"))
    with pytest.raises(InputError, match="mode 2 does not move the sensors 'a'"):
        with_sensors(modes, ["a"])
    with pytest.raises(InputError, match="no sensor is asked for"):
        with_sensors(modes, [])
    with pytest.raises(InputError, match=r"there is no mode 1\.5"):
        modes.index(1.5)
