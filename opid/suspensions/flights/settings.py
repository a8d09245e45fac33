"""The tuned numbers of the comparison of flights, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FlightSettings:
    """When a value departs from the earlier ones, and when the flights scatter.

    Args:
        false_alarm: chance that a structure that did not change is flagged anywhere in a comparison, if the intervals
            hold.
        narrow: intervals are too narrow where the chance of the steps between neighbouring flights is below this ...
        narrow_as_others: ... or below this for one quantity, where the intervals of all together are too narrow.
        enough_steps: fewer steps between neighbouring flights do not distinguish a change from scatter.
        suspect: below this chance of the steps scatter is not yet certain, but a flag may be scatter.
        clear_std: a change is given as a fraction where the value before is this many standard deviations from zero.
        following: one-sided chance at which the flight after a flagged one confirms it. It is a single test, so it
            shares the false alarms with no other.
        freedom_of_a_step: degrees of freedom that each of the overlapping differences adds to their median. Student's
            distribution with them has the far tail that such a median gives to normal deviates (simulated for 2 to 147
            differences).
        largest_scatter: scatter between flights is looked for up to this many times the value.
        each_of_two_std: both flights of a pair depart by this many standard deviations: one alone is judged alone.
    """

    false_alarm: float = 1e-3
    narrow: float = 0.01
    narrow_as_others: float = 0.5
    enough_steps: int = 4
    suspect: float = 0.1
    clear_std: float = 5.0
    following: float = 0.01
    freedom_of_a_step: float = 0.4
    largest_scatter: float = 10.0
    each_of_two_std: float = 1.96


DEFAULTS = FlightSettings()
