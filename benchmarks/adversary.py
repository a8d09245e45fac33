"""Worlds in which an assumption fails, and what each command answers there: right, silent, or confidently wrong.

Run `python benchmarks/adversary.py` (about 25 min for 3 seeds, most of them those of `identify`); in parts
`--commands update,compare --seeds 10`. The worlds are those of `tests/adversary/`, whose `judged_worlds.py` says what
is right, silent and wrong. Seeds count from 0 and none is dropped. A world that no data can tell from a sound one has
the reason in the place of the sentence: wrong answers are expected there. The last lines count the outcomes.
"""

import argparse
import os
import sys
from collections import Counter
from pathlib import Path

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS / "adversary"), str(TESTS)]

from judged_worlds import Verdict, World, judge  # noqa: E402
from test_worlds import EVERY_WORLD  # noqa: E402

OUTCOMES = ("right", "silent", "wrong")


def describe(world: World, verdicts: list[Verdict]) -> list[str]:
    """Return the cells of one world: the farthest estimate of all seeds, its width, and what is said."""
    counts = Counter(each.outcome for each in verdicts)
    worst = max(verdicts, key=lambda each: each.deviations)
    has_interval = any(each.outcome != "silent" for each in verdicts)
    said = next((each.said for each in verdicts if each.said), "")
    is_said = sum(world.must_say in each.said for each in verdicts)
    told = world.unseen and f"(no data tell it: {world.unseen})"
    if not told and said:
        told = said if len(said) <= 120 else f"{said[:117]}..."
    return [
        world.command,
        world.fails,
        *(str(counts[each]) if counts[each] else "-" for each in OUTCOMES),
        f"{worst.deviations:.1f} ({worst.worst})" if has_interval else "-",
        f"{100 * worst.width:.2g} %" if has_interval else "-",
        f"{is_said} of {len(verdicts)}" if world.must_say else "-",
        told.replace("|", "/"),
    ]


def main() -> None:
    """Print a line for each world as soon as it is asked, then the counts of each command."""
    commands = list(dict.fromkeys(world.command for world in EVERY_WORLD))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commands", help=f"names joined by commas, of {', '.join(commands)}; all where left out")
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    names = commands if options.commands is None else options.commands.split(",")
    if unknown := [each for each in names if each not in commands]:
        parser.error(f"there is no command {', '.join(unknown)}: give some of {', '.join(commands)}")
    titles = ("command", "what fails", *OUTCOMES, "farthest, std", "its std", "cause said", "sentence")
    print("| " + " | ".join(titles) + " |\n|" + "---|" * len(titles))
    counts: dict[str, Counter[str]] = {name: Counter() for name in names}
    for world in (each for each in EVERY_WORLD if each.command in names):
        verdicts = [judge(world, seed) for seed in range(options.seeds)]
        print("| " + " | ".join(describe(world, verdicts)) + " |", flush=True)
        counts[world.command].update(each.outcome if not world.unseen else "unseen" for each in verdicts)
    for name, counted in counts.items():
        listed = ", ".join(f"{n} {outcome}" for outcome, n in sorted(counted.items()))
        print(f"\n{name}: {counted.total()} answers, {listed} (unseen: no data tell that something fails)")


if __name__ == "__main__":
    main()
