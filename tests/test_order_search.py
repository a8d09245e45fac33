import numpy as np
import pytest
from made_beats import beats, softening

from opid.errors import InputError
from opid.modal.forced.equation import mode_lines
from opid.modal.forced.restoring_fit import is_linear_part_off, search_orders

BAND = (100.0, 140.0)


@pytest.fixture(scope="module")
def lines():
    return [mode_lines(test, 1, BAND) for test in beats(softening(), np.random.default_rng(0))]


@pytest.mark.parametrize("n_tests", [1, 2, 4])
def test_one_rung_is_chosen_with_enough_powers(lines, n_tests):
    rungs = search_orders(lines[-n_tests:])
    chosen = [rung for rung in rungs if rung.chosen]
    assert len(rungs) == 25
    assert len(chosen) == 1
    assert chosen[0].stiffness_order >= 3
    assert chosen[0].damping_order >= 2
    assert chosen[0].error < 0.1 * next(r.error for r in rungs if (r.stiffness_order, r.damping_order) == (1, 1))


def test_a_given_order_is_kept(lines):
    assert {rung.damping_order for rung in search_orders(lines, damping_order=2)} == {2}


def test_right_linear_properties_are_left_alone(lines):
    assert not is_linear_part_off(lines, stiffness_order=3, damping_order=3)


def test_too_few_lines_for_any_order_are_refused(lines):
    few = [each.only(np.arange(each.frequency_hz.size) < 3) for each in lines[:1]]
    with pytest.raises(InputError, match="no order can be fitted to so few lines"):
        search_orders(few, free_linear=True)
