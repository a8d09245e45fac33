"""In no world of the table is an answer confidently wrong, sound worlds have one, and causes that show are said."""

import pytest
from bench_worlds import BENCH_WORLDS
from flight_worlds import FLIGHT_WORLDS
from hammer_worlds import HAMMER_WORLDS
from identify_worlds import IDENTIFY_WORLDS
from judged_worlds import judge, list_names
from modal_worlds import MODAL_WORLDS
from sensing_worlds import SENSING_WORLDS
from updating_worlds import UPDATING_WORLDS
from wheel_worlds import WHEEL_WORLDS

EVERY_WORLD = (
    *BENCH_WORLDS,
    *HAMMER_WORLDS,
    *MODAL_WORLDS,
    *UPDATING_WORLDS,
    *FLIGHT_WORLDS,
    *IDENTIFY_WORLDS,
    *SENSING_WORLDS,
    *WHEEL_WORLDS,
)
WORLDS = [each for each in EVERY_WORLD if not each.unseen and not each.is_slow]


@pytest.mark.parametrize("world", WORLDS, ids=list_names(WORLDS))
def test_no_answer_is_confidently_wrong(world):
    verdict = judge(world, seed=0)
    assert verdict.outcome == "right" or (verdict.outcome == "silent" and not world.must_answer), verdict
    assert world.must_say in verdict.said
