"""Results of many flights of one structure, read from their result.json files and put in order."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

from opid.errors import FileError, InputError, NotDeterminedError, list_names
from opid.result import RESULT_FILE
from opid.signals.files import nearest_beside
from opid.suspensions.flights.result_file import Flight, read_flight

STUDY_FILE = "study.toml"

EARLIEST = date(1990, 1, 1)
"""No log that is read here is older; clocks that have lost their time begin in 1904, 1970 or 1980."""


@dataclass(frozen=True)
class LeftOut:
    """A flight that is not compared.

    Args:
        name: name of the flight, or the folder of its study.
        sentence: the reason, one sentence.
    """

    name: str
    sentence: str


@dataclass(frozen=True)
class Flights:
    """Results that may be compared, the earliest first.

    Args:
        flights: two or more flights.
        dated: whether they are in the order of their dates.
        left_out: flights that are not among them.
        notes: notes on the order, one sentence each.
    """

    flights: tuple[Flight, ...]
    dated: bool
    left_out: tuple[LeftOut, ...] = ()
    notes: tuple[str, ...] = ()


def read_flights(paths: Sequence[str | os.PathLike[str]]) -> Flights:
    """Read the results of several flights.

    Args:
        paths: result.json files, or folders that hold one, or folders of such folders (of studies whose results are in
            them or one level below, like `out/result.json`).

    Returns:
        The flights by their dates, or in the given order if a date is missing. Flights that are not determined, those
        without a recommended structure, and those per unit of mass if two others are not, are left out with a note.

    Raises:
        InputError: no result, one result only, a file that is no result, the same result twice, or results of
            different structures.
        NotDeterminedError: fewer than two flights remain that can be compared.
    """
    files, unfinished = _list_files(paths)
    twice = [str(file) for file, n in Counter(os.path.realpath(file) for file in files).items() if n > 1]
    if twice:
        raise InputError(f"{list_names(twice)}: given more than once, give each result once")
    names = _name_results(files)
    # The result of a study may be beside its folder and have its name.
    without_result = [
        LeftOut(str(folder), f"{str(folder)!r} holds no {RESULT_FILE} and is left out: run `opid identify` there")
        for folder in unfinished
        if folder.resolve().name not in names
    ]
    if len(files) < 2:
        others = "".join(f"; {each.sentence}" for each in without_result)
        raise FileError(f"{len(files)} result is given ({list_names(files)}): give two or more to compare{others}")
    flights = [read_flight(file, name) for file, name in zip(files, names, strict=True)]
    _refuse_copies(flights)
    kept, left_out = _select_comparable(flights)
    _refuse_unlike(kept)
    return replace(put_in_order(kept), left_out=(*without_result, *left_out))


def put_in_order(flights: Sequence[Flight]) -> Flights:
    """Return flights in the order of their dates, or in the given order if a date is missing."""
    without = [flight.name for flight in flights if flight.date is None]
    if without:
        note = (
            f"{len(without)} of {len(flights)} results have no date ({list_names(without)}): all are taken in the "
            "order in which they were given; put 'date = 2026-03-01' into each study file to have them sorted"
        )
        return Flights(tuple(flights), False, notes=(note,))
    if early := [flight for flight in flights if flight.date and flight.date < EARLIEST]:
        written = ", ".join(sorted({str(flight.date) for flight in early}))
        note = (
            f"{len(early)} of {len(flights)} results have the date {written} ({list_names([f.name for f in early])}), "
            "as clocks write that have lost their time: all are taken in the order in which they were given; correct "
            "'date' in each study file to have them sorted"
        )
        return Flights(tuple(flights), False, notes=(note,))
    ordered = sorted(flights, key=lambda flight: flight.date or date.min)
    days = Counter(flight.date for flight in ordered)
    notes = tuple(
        f"{n} flights have the date {day} ({list_names([f.name for f in ordered if f.date == day])}): they are taken "
        "in the order in which they were given"
        for day, n in days.items()
        if n > 1
    )
    return Flights(tuple(ordered), True, notes=notes)


# ---- files -----------------------------------------------------------------------------------------


def _list_files(paths: Sequence[str | os.PathLike[str]]) -> tuple[list[Path], list[Path]]:
    """Return the results, and folders beside them that hold a study without a result."""
    files, unfinished = [], []
    for path in map(Path, paths):
        if not os.path.exists(path):
            raise FileError(f"there is no file or folder {path}{nearest_beside(path)}")
        if not path.is_dir():
            files.append(path)
            continue
        if (path / RESULT_FILE).is_file():
            files.append(path / RESULT_FILE)
            continue
        found: list[Path] = []
        for child in sorted(each for each in path.glob("[!.]*") if each.is_dir()):
            own = child / RESULT_FILE
            several = [own] if own.is_file() else sorted(child.glob(f"[!.]*/{RESULT_FILE}"))
            found += several
            if not several and (child / STUDY_FILE).is_file():
                unfinished.append(child)
        if not found:
            raise FileError(
                f"there is no {RESULT_FILE} in {path}, nor one or two folders below: name the folders that "
                "`opid identify --out` wrote"
            )
        files += found
    return files, unfinished


def _name_results(files: Sequence[Path]) -> list[str]:
    """Name each result after the folder of its study, or by its whole path if two have that name."""
    names = []
    for file in files:
        above = [part for part in Path(os.path.realpath(file)).parts[:-1] if part not in ("out", "result")]
        name = file.stem if file.name != RESULT_FILE else above[-1]
        names.append(name.removesuffix("_result") or name)
    return [str(file) if names.count(name) > 1 else name for file, name in zip(files, names, strict=True)]


# ---- what cannot be compared -----------------------------------------------------------------------


def _select_comparable(flights: Sequence[Flight]) -> tuple[list[Flight], list[LeftOut]]:
    """Return the flights that can be compared with each other, and why each of the others is left out."""
    reasons: dict[str, str] = {}
    for flight in flights:
        if all(each.value is None for each in flight.values.values()):
            reasons[flight.name] = flight.doubt or "it holds no values"
        elif flight.doubt and not (flight.recommended and any(each.std for each in flight.values.values())):
            reasons[flight.name] = flight.doubt
    kept = [flight for flight in flights if flight.name not in reasons]
    # Absolute values are compared if two flights have them, otherwise those per unit of mass.
    absolute = sum(not flight.per_mass for flight in kept)
    per_mass = absolute < 2 and len(kept) - absolute > 1
    for flight in kept:
        if flight.per_mass and not per_mass:
            reasons[flight.name] = flight.doubt or "its values are per unit of mass, and those of the others are not"
        elif per_mass and not flight.per_mass:
            reasons[flight.name] = "its values are not per unit of mass, and those of the others are"
    kept = [flight for flight in flights if flight.name not in reasons]
    left_out = [
        LeftOut(flight.name, f"{flight.name!r} is left out: {reasons[flight.name]}")
        for flight in flights
        if flight.name in reasons
    ]
    if len(kept) < 2:
        remains = "none" if not kept else f"{kept[0].name!r} alone"
        raise NotDeterminedError(
            f"of {len(flights)} flights {remains} can be compared, and two are needed: "
            f"{'; '.join(each.sentence for each in left_out)}"
        )
    return kept, left_out


def _refuse_copies(flights: Sequence[Flight]) -> None:
    for i, one in enumerate(flights):
        for other in flights[:i]:
            known = [estimate.value for estimate in one.values.values() if estimate.value is not None]
            if known and one.values == other.values:
                raise FileError(f"{other.path} and {one.path} hold the same numbers: give each flight once")


def _refuse_unlike(flights: Sequence[Flight]) -> None:
    kinds = {flight.structure: flight.name for flight in reversed(flights)}
    if len(kinds) > 1:
        listing = ", ".join(f"{kind!r} (as {name!r})" for kind, name in kinds.items())
        raise InputError(
            f"the results are of different structures, {listing}: their numbers mean different things; identify all "
            "flights with one kind in [structure]"
        )
    gears = Counter(gear for flight in flights for gear in flight.laws)
    if not any(n > 1 for n in gears.values()):
        raise InputError(f"the results have no gear in common ({list_names(gears)}): give results of one structure")
