"""Worlds of `opid compare`: flights that are not of one structure, one law or one order, and intervals too narrow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from judged_worlds import Answer, World
from made_flights import GEARS, body_result, day, gear_result, write_result

from opid.suspensions.flights.comparison import Change, Comparison, compare
from opid.suspensions.flights.results import read_flights

Document = dict[str, Any]
Gone = dict[tuple[str, str], float]
"""{(gear, quantity): fraction of it that has gone}"""

LOSS: Gone = {("left", "stiffness"): 0.1}
"""A harmed strut, for the worlds in which something did change."""


def flight_world(
    fails: str,
    make: Callable[[np.random.Generator], Sequence[Document]],
    *,
    changed: Gone | None = None,
    history: Callable[[int], Gone] | None = None,
    must_say: str = "",
    unseen: str = "",
) -> World:
    """Return the world of some flights, in the order in which they are handed over.

    `changed` is what is truly lost (or won, where negative) from the earlier flights to the later ones; every flagged
    change is compared with it, and with no change where a quantity is not among them. Where the structure goes on
    changing, `history` is what is lost at each flight, by its number, and a change is that of the mean of the flagged
    flights from that of the flights before that were not flagged.
    """

    def measure(change: Change, found: Comparison) -> float:
        """Return the true change as a fraction."""
        name = name_of(change)
        if history is None:
            return -(changed or {}).get(name, 0.0)
        series = next(each for each in found.series if each.quantity == change.quantity)
        left = [1.0 - history(int(flight.name[1:])).get(name, 0.0) for flight in found.flights]
        before = [point.flight for point in series.points if point.has_interval and not point.flagged]
        usual = np.mean([left[flight] for flight in before if flight < change.first])
        return float(np.mean(left[change.first : change.last + 1]) / usual) - 1.0

    def ask(seed: int) -> Answer:
        with TemporaryDirectory() as folder:
            documents = make(np.random.default_rng([seed, 5]))
            paths = [write_result(Path(folder) / f"f{number}", each) for number, each in enumerate(documents)]
            found = compare(read_flights(paths))
        pairs = [(f"{each.quantity.full_label}", each.fraction, measure(each, found)) for each in found.changes]
        return Answer(tuple(pairs), found.warnings)

    return World("compare", fails, ask, must_say, unseen)


def name_of(change: Change) -> tuple[str, str]:
    """Return gear and quantity of a change, as `Gone` has them."""
    return change.quantity.gear, change.quantity.name


def make_flights(rng: np.random.Generator, n: int = 8, *, loss: Gone | None = None, first: int = 5, **settings: Any):
    """Return flights of one body, a week apart, of which those from `first` on have lost something."""
    return [
        body_result(rng, day=day(number), loss=loss if number >= first else None, **settings) for number in range(n)
    ]


def with_dates(documents: list[Document], dates: Sequence[str | None]) -> list[Document]:
    """Return the flights with other dates."""
    return [each | {"date": date} for each, date in zip(documents, dates, strict=True)]


def load(documents: list[Document], factor: float, chosen: Sequence[int]) -> list[Document]:
    """Return the flights, of which the chosen ones weigh more."""
    for number in chosen:
        mass = documents[number]["parameters"]["sprung_mass_kg"]
        mass["value"] *= factor
        mass["interval95"] = [factor * end for end in mass["interval95"]]
    return documents


def scale(documents: list[Document], factors: Sequence[float], *, mass: bool = True) -> list[Document]:
    """Return the flights, of which each has all forces, and its mass, off by a factor, as by a wrong mass change."""
    for number, factor in enumerate(factors):
        for each in documents[number]["interfaces"]:
            for table in (each["stiffness"], each["damping"], each["law"]["arctan_velocity"]["amplitude_n"]):
                table["value"] *= factor
                table["interval95"] = [factor * end for end in table["interval95"]]
        if mass:
            load(documents, factor, (number,))
    return documents


def scale_some(n: int, factor: float, chosen: Sequence[int]) -> list[float]:
    """Return the factors of n flights, of which the chosen ones are off."""
    return [factor if number in chosen else 1.0 for number in range(n)]


def scale_all(rng: np.random.Generator, n: int, std: float, *, memory: float = 0.0, **settings: Any) -> list[Document]:
    """Return flights whose scale is off by a random fraction, which may be nearly that of the flight before."""
    documents, factors, error = make_flights(rng, n, **settings), [], 0.0
    for _ in range(n):
        error = memory * error + std * np.sqrt(1.0 - memory**2) * rng.standard_normal()
        factors.append(1.0 + error)
    return scale(documents, factors)


def follow(history: Callable[[int], Gone], n: int = 9) -> Callable[[np.random.Generator], list[Document]]:
    """Return what makes flights of a structure with a history."""
    return lambda rng: [body_result(rng, day=day(number), loss=history(number)) for number in range(n)]


def lose(fraction: Callable[[int], float], *gears: str) -> Callable[[int], Gone]:
    """Return the history of struts that have lost a fraction of their stiffness at each flight."""
    return lambda number: {(gear, "stiffness"): fraction(number) for gear in gears or ("left",)}


def make_narrow(rng: np.random.Generator, chosen: int) -> list[Document]:
    """Return flights of which one states intervals a tenth as wide as the others, and errs as these do."""
    return [
        body_result(rng, day=day(number), std=0.001 if number == chosen else 0.01, scatter=0.01 * (number == chosen))
        for number in range(8)
    ]


HISTORIES = {
    "a strut that loses 10 % flight by flight": lose(lambda number: 0.1 * number / 8),
    "a strut that loses 10 % at an increasing rate": lose(lambda number: 0.1 * (number / 8) ** 2),
    "a strut that loses 5 % twice": lose(lambda number: 0.05 * (number >= 3) + 0.05 * (number >= 6)),
    "a strut that loses 10 %, then gains 20 %": lose(lambda number: 0.1 * (number >= 3) - 0.2 * (number >= 6)),
    "a strut that is repaired after three flights": lose(lambda number: 0.1 * (3 <= number < 6)),
    "all struts stiffer by 30 % in two flights": lose(lambda number: -0.3 * (number in (3, 4)), *GEARS),
    "all struts stiffer by 30 % in the first flight": lose(lambda number: -0.3 * (number == 0), *GEARS),
}
"""How structures may change from flight to flight otherwise than by one step."""

SEASONS = lose(lambda number: -0.05 * float(np.sin(2 * np.pi * number / 8)), *GEARS)
"""Struts that are stiffer in summer than in winter, by no more than the scatter between flights might be."""


def add_strut(documents: list[Document], number: int) -> list[Document]:
    """Return the flights, of which one has a strut that no other has."""
    other = deepcopy(documents[number]["interfaces"][0])
    documents[number]["interfaces"].append(other | {"name": "tail"})
    return documents


def rename(documents: list[Document], number: int) -> list[Document]:
    """Return the flights, of which one calls the left strut the right one."""
    names = {"left": "right", "right": "left"}
    for each in documents[number]["interfaces"]:
        each["name"] = names.get(each["name"], each["name"])
    return documents


def repeat(documents: list[Document], n: int, *, digits: int = 17) -> list[Document]:
    """Return the flights with n copies of the first one under other dates, written with so many digits."""

    def shorten(value: object) -> object:
        if isinstance(value, float):
            return float(f"{value:.{digits}g}")
        if isinstance(value, dict):
            return {key: shorten(each) for key, each in value.items()}
        return [shorten(each) for each in value] if isinstance(value, list) else value

    copies = [shorten(deepcopy(documents[0])) | {"date": day(-1 - number)} for number in range(n)]
    return [*copies, *documents]


def use_other_law(rng: np.random.Generator, chosen: Sequence[int]) -> list[Document]:
    """Return flights, of which the chosen ones have another law, whose linear part is stiffer and damps less."""
    documents = make_flights(rng)
    for number in chosen:
        other = body_result(rng, day=day(number), kind="coulomb_friction", loss={
            (gear, name): size for gear in ("nose", "left", "right") for name, size in LINEAR_PART.items()
        })  # fmt: skip
        documents[number] = other
    return documents


LINEAR_PART = {"stiffness": -0.1, "damping": -0.3}
"""How far the linear part beside another law differs, with the same force."""

FLIGHT_WORLDS = [
    flight_world("none", make_flights),
    flight_world("none, a strut lost 10 %", lambda rng: make_flights(rng, loss=LOSS), changed=LOSS),
    flight_world(
        "another mass in the last three",
        lambda rng: load(make_flights(rng), 1.2, (5, 6, 7)),
        changed={("", "mass"): -0.2},
    ),
    flight_world(
        "a strut that one flight alone has", lambda rng: add_strut(make_flights(rng), 4), must_say="occurs only in"
    ),
    flight_world("two struts exchanged in a flight", lambda rng: rename(make_flights(rng), 4)),
    flight_world("a copied result", lambda rng: repeat(make_flights(rng), 1), must_say="the same"),
    flight_world(
        "a flight identified four times", lambda rng: repeat(make_flights(rng), 3, digits=5), must_say="the same"
    ),
    flight_world(
        "all dates alike",
        lambda rng: with_dates(make_flights(rng, loss=LOSS), [day(0)] * 8),
        changed=LOSS,
        must_say="have the date",
    ),
    flight_world(
        "a date is missing",
        lambda rng: with_dates(make_flights(rng, loss=LOSS), [None, *map(day, range(1, 8))]),
        changed=LOSS,
        must_say="no date",
    ),
    flight_world(
        "the last dates are 1970",
        lambda rng: with_dates(make_flights(rng, loss=LOSS), [*map(day, range(5)), *["1970-01-01"] * 3]),
        changed=LOSS,
        must_say="1970",
    ),
    flight_world(
        "the first date is in the future",
        lambda rng: with_dates(make_flights(rng, loss=LOSS), ["2099-01-01", *map(day, range(1, 8))]),
        changed=LOSS,
    ),
    flight_world(
        "dates reversed", lambda rng: with_dates(make_flights(rng, loss=LOSS), [*map(day, range(8, 0, -1))]),
        changed=LOSS,
        unseen="a strut that loses 10 % is in the reversed order one that gains 11 %, and both orders are as probable",
    ),
    flight_world(
        "another structure", lambda rng: [*make_flights(rng, 5), gear_result(rng, day=day(6))], must_say="different"
    ),
    flight_world(
        "one flight with another law", lambda rng: use_other_law(rng, (4,)), must_say="the law of"
    ),
    flight_world(
        "the last three with another law", lambda rng: use_other_law(rng, (5, 6, 7)), must_say="the law of"
    ),
    flight_world("intervals three times too narrow", lambda rng: make_flights(rng, scatter=0.03), must_say="scatter"),
    flight_world("intervals three times too narrow, 20 flights", lambda rng: make_flights(rng, 20, scatter=0.03)),
    flight_world("intervals ten times too narrow", lambda rng: make_flights(rng, scatter=0.1)),
    flight_world("intervals ten times too narrow, 5 flights", lambda rng: make_flights(rng, 5, scatter=0.1)),
    flight_world("intervals ten times too narrow, 3 flights", lambda rng: make_flights(rng, 3, scatter=0.1)),
    *(flight_world(f"none, {words}", follow(history), history=history) for words, history in HISTORIES.items()),
    flight_world("all struts stiffer in summer", follow(SEASONS), history=SEASONS),
    flight_world("masses of all flights 3 % off, each its own", lambda rng: scale_all(rng, 8, 0.03)),
    flight_world(
        "masses of all flights 3 % off, each its own, a strut lost 10 %",
        lambda rng: scale_all(rng, 8, 0.03, loss=LOSS),
        changed=LOSS,
    ),
    flight_world(
        "masses 3 % off, that of a flight nearly as before", lambda rng: scale_all(rng, 12, 0.03, memory=0.9)
    ),
    flight_world(
        "mass change 3 % off in the last three", lambda rng: scale(make_flights(rng), scale_some(8, 1.03, (5, 6, 7)))
    ),
    flight_world("mass change 5 % off in one flight", lambda rng: scale(make_flights(rng), scale_some(8, 1.05, (4,)))),
    flight_world(
        "forces in pounds in one flight", lambda rng: scale(make_flights(rng), scale_some(8, 4.448, (4,)), mass=False)
    ),
    flight_world("masses 3 % off, 3 flights", lambda rng: scale_all(rng, 3, 0.03)),
    flight_world("intervals three times too narrow, 2 flights", lambda rng: make_flights(rng, 2, scatter=0.03)),
    flight_world("intervals of one flight ten times too narrow", lambda rng: make_narrow(rng, 4)),
    flight_world("intervals of the first flight ten times too narrow", lambda rng: make_narrow(rng, 0)),
]  # fmt: skip
