"""Worlds of `opid compare`: flights that are not of one structure, one law or one order, and intervals too narrow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from judged_worlds import Answer, World
from made_flights import body_result, day, gear_result, write_result

from opid.suspensions.flights.comparison import Change, compare
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
    must_say: str = "",
    unseen: str = "",
) -> World:
    """Return the world of some flights, in the order in which they are handed over.

    `changed` is what is truly lost (or won, where negative) from the earlier flights to the later ones; every flagged
    change is compared with it, and with no change where a quantity is not among them.
    """

    def ask(seed: int) -> Answer:
        with TemporaryDirectory() as folder:
            documents = make(np.random.default_rng([seed, 5]))
            paths = [write_result(Path(folder) / f"f{number}", each) for number, each in enumerate(documents)]
            found = compare(read_flights(paths))
        pairs = [
            (f"{each.quantity.full_label}", each.fraction, -(changed or {}).get(name_of(each), 0.0))
            for each in found.changes
        ]
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
]  # fmt: skip
