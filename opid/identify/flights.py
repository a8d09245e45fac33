"""Results of many flights of one structure, read from their result.json files and put in order."""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from opid.errors import InputError
from opid.estimate import Estimate
from opid.identify.result import SCHEMA
from opid.mechanics.laws import LAWS

RESULT_FILE = "result.json"

FRICTION = ("arctan_velocity", "coulomb_friction")
"""Kinds of law whose amplitude is a friction force."""

ONE_GEAR = "gear"
"""What the suspension of a single-gear result is called."""

SINGLE_GEAR = "single gear"
"""What the structure of a single-gear result is called; those of a body have the names of their kinds."""


@dataclass(frozen=True)
class Quantity:
    """What is followed from flight to flight.

    Args:
        gear: the suspension that it belongs to; empty for the body.
        name: "stiffness", "damping", "friction", "mass", or the kind of a term of the law.
        unit: of its values.
        kind: of the law's term whose amplitude it is; empty for the others.
    """

    gear: str
    name: str
    unit: str
    kind: str = ""

    @property
    def label(self) -> str:
        """The quantity in words, without the gear."""
        return {"friction": f"friction force ({self.kind})", "mass": "total mass"}.get(self.name, self.name)


@dataclass(frozen=True, eq=False)
class Flight:
    """One result.

    Args:
        name: of its study's folder.
        path: of its file.
        date: of the runs; None if the result has none.
        method: "model", "classical" or "paper".
        structure: kind of the structure.
        laws: {gear: kinds of the terms of its law}.
        values: {quantity: Estimate}.
    """

    name: str
    path: Path
    date: date | None
    method: str
    structure: str
    laws: Mapping[str, tuple[str, ...]]
    values: Mapping[Quantity, Estimate]


@dataclass(frozen=True)
class Flights:
    """Results that may be compared, the earliest first.

    Args:
        flights: two or more.
        dated: whether they are in the order of their dates.
        notes: what is to be said of the order, one sentence each.
    """

    flights: tuple[Flight, ...]
    dated: bool
    notes: tuple[str, ...] = ()


def read_flights(paths: Sequence[str | os.PathLike[str]]) -> Flights:
    """Read the results of several flights.

    Args:
        paths: result.json files, or folders that hold one, or folders of such folders (of studies whose results stand
            in them or one level below, like `out/result.json`).

    Returns:
        The flights by their dates, or as they were given where a date is missing.

    Raises:
        InputError: no result, one result only, a file that is no result, the same result twice, or results of
            different structures or units.
    """
    files = [file for path in paths for file in _files_at(Path(path))]
    twice = [str(file) for file, n in Counter(file.resolve() for file in files).items() if n > 1]
    if twice:
        raise InputError(f"{listed(twice)}: given more than once, give each result once")
    if len(files) < 2:
        raise InputError(f"{len(files)} result is given ({listed(files)}): give two or more to compare")
    flights = [_flight(file, name) for file, name in zip(files, _names(files), strict=True)]
    _refuse_copies(flights)
    _refuse_unlike(flights)
    return in_order(flights)


def in_order(flights: Sequence[Flight]) -> Flights:
    """Return flights in the order of their dates, or as they are given where a date is missing.

    Args:
        flights: in any order.
    """
    without = [flight.name for flight in flights if flight.date is None]
    if without:
        note = (
            f"{len(without)} of {len(flights)} results have no date ({listed(without)}): all are taken in the order "
            "in which they were given; put 'date = 2026-03-01' into each study file to have them sorted"
        )
        return Flights(tuple(flights), False, (note,))
    ordered = sorted(flights, key=lambda flight: flight.date or date.min)
    days = Counter(flight.date for flight in ordered)
    notes = tuple(
        f"{n} flights have the date {day} ({listed([f.name for f in ordered if f.date == day])}): they are taken in "
        "the order in which they were given"
        for day, n in days.items()
        if n > 1
    )
    return Flights(tuple(ordered), True, notes)


def listed(names: Sequence[Any] | Mapping[str, Any], most: int = 6) -> str:
    """Return names in a sentence, of many only the first.

    Args:
        names: of anything.
        most: that are named.

    >>> listed(["a", "b", "c"], most=2)
    'a, b and 1 more'
    """
    words = [str(name) for name in names]
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")


# ---- files -----------------------------------------------------------------------------------------


def _files_at(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise InputError(f"there is no file or folder {path}: check the name")
    if (path / RESULT_FILE).is_file():
        return [path / RESULT_FILE]
    found: list[Path] = []
    for child in sorted(each for each in path.iterdir() if each.is_dir()):
        own = child / RESULT_FILE
        found += [own] if own.is_file() else sorted(child.glob(f"*/{RESULT_FILE}"))
    if not found:
        raise InputError(
            f"there is no {RESULT_FILE} in {path}, nor one or two folders below: name the folders that "
            "`opid identify --out` wrote"
        )
    return found


def _names(files: Sequence[Path]) -> list[str]:
    """Name each result after the folder of its study, or by its whole path where two have that name."""
    names = []
    for file in files:
        above = [part for part in file.resolve().parts[:-1] if part not in ("out", "result")]
        name = file.stem if file.name != RESULT_FILE else above[-1]
        names.append(name.removesuffix("_result") or name)
    return [str(file) if names.count(name) > 1 else name for file, name in zip(files, names, strict=True)]


def _flight(file: Path, name: str) -> Flight:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror or error}: check the name") from error
    except ValueError as error:
        raise InputError(f"{file} is no JSON: give the {RESULT_FILE} of `opid identify`") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        has = f"has the schema {schema!r}" if schema is not None else "has no schema"
        raise InputError(f"{file} {has} where {SCHEMA!r} is needed: give the {RESULT_FILE} of `opid identify`")
    try:
        day = document.get("date")
        body = document.get("structure")
        values, laws = _of_one_gear(document) if body is None else _of_body(document)
        return Flight(
            name,
            file,
            None if day is None else date.fromisoformat(day),
            str(document["method"]),
            SINGLE_GEAR if body is None else str(body["kind"]),
            laws,
            values,
        )
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        raise InputError(
            f"{file} lacks what every result has, or holds text where numbers are needed ({type(error).__name__}: "
            f"{error}): write it anew with `opid identify`"
        ) from error


# ---- what a file holds -----------------------------------------------------------------------------

Found = tuple[dict[Quantity, Estimate], dict[str, tuple[str, ...]]]


def _of_one_gear(document: Mapping[str, Any]) -> Found:
    per_mass, parameters, ratios = bool(document["law"]["per_mass"]), document["parameters"], document["ratios"]
    terms = document["law"]["parameters"]
    values = {Quantity("", "mass", "kg"): _estimate(parameters["sprung_mass_kg"])}
    if per_mass:
        values[Quantity(ONE_GEAR, "stiffness", "1/s^2")] = _estimate(ratios["stiffness_per_mass"])
        values[Quantity(ONE_GEAR, "damping", "1/s")] = _estimate(ratios["damping_per_mass"])
    else:
        values[Quantity(ONE_GEAR, "stiffness", "N/m")] = _estimate(parameters["suspension_stiffness_n_per_m"])
        values[Quantity(ONE_GEAR, "damping", "N s/m")] = _estimate(parameters["suspension_damping_n_s_per_m"])
    values |= dict(_amplitudes(ONE_GEAR, terms, per_mass))
    return values, {ONE_GEAR: _kinds(document["law"]["name"])}


def _of_body(document: Mapping[str, Any]) -> Found:
    values = {Quantity("", "mass", "kg"): _estimate(document["parameters"]["sprung_mass_kg"])}
    laws: dict[str, tuple[str, ...]] = {}
    told: set[str] = set()
    for interface in document["interfaces"]:
        name = interface["name"]
        if name in told:
            continue
        # those that share one estimate are one series
        alike = [name, *(other for other in interface.get("shared_with", ()) if other != name)]
        told.update(alike)
        gear = ", ".join(alike)
        for what in ("stiffness", "damping"):
            values[Quantity(gear, what, str(interface[what]["unit"]))] = _estimate(interface[what])
        per_mass = interface["stiffness"]["unit"] != "N/m"
        values |= dict(_amplitudes(gear, interface["law"], per_mass))
        laws[gear] = tuple(sorted(interface["law"]))
    return values, laws


def _amplitudes(
    gear: str, terms: Mapping[str, Mapping[str, Any]], per_mass: bool
) -> Iterator[tuple[Quantity, Estimate]]:
    for kind, parameters in terms.items():
        # the first parameter of a kind is its amplitude; a user's own kind need not be registered here
        known = LAWS[kind].parameters[0] if kind in LAWS else None
        name = known.name if known else next(iter(parameters))
        unit = known.unit if known else ""
        what = "friction" if kind in FRICTION else kind
        yield Quantity(gear, what, f"{unit}/kg" if per_mass else unit, kind), _estimate(parameters[name])


def _kinds(name: str) -> tuple[str, ...]:
    return tuple(sorted(part for part in name.split("+") if part and part != "linear"))


def _estimate(table: Mapping[str, Any]) -> Estimate:
    value, std, interval = (table.get(key) for key in ("value", "std", "interval95"))
    numbers = [each for each in (value, std, *(interval or ())) if each is not None]
    if not all(isinstance(each, (int, float)) and math.isfinite(each) for each in numbers):
        raise ValueError(f"{table!r} is no estimate")
    if value is None:
        return Estimate()
    if interval is not None:
        low, high = (float(each) for each in interval)
        return Estimate(float(value), float(std) if std else (high - low) / (2 * 1.96), (low, high))
    return Estimate.normal(value, std)


# ---- what cannot be compared -----------------------------------------------------------------------


def _refuse_copies(flights: Sequence[Flight]) -> None:
    for i, one in enumerate(flights):
        for other in flights[:i]:
            known = [estimate.value for estimate in one.values.values() if estimate.value is not None]
            if known and one.values == other.values:
                raise InputError(f"{other.path} and {one.path} hold the same numbers: give each flight once")


def _refuse_unlike(flights: Sequence[Flight]) -> None:
    kinds = {flight.structure: flight.name for flight in reversed(flights)}
    if len(kinds) > 1:
        told = ", ".join(f"{kind!r} (as {name!r})" for kind, name in kinds.items())
        raise InputError(
            f"the results are of different structures, {told}: their numbers mean different things; identify all "
            "flights with one kind in [structure]"
        )
    units: dict[tuple[str, str], dict[str, str]] = {}
    for flight in reversed(flights):
        for quantity in flight.values:
            units.setdefault((quantity.gear, quantity.name), {})[quantity.unit] = flight.name
    for (gear, name), found in units.items():
        if len(found) > 1 and name in ("stiffness", "damping"):
            told = " and ".join(f"{unit} (as {flight!r})" for unit, flight in found.items())
            raise InputError(
                f"the {name} of {gear!r} is in {told}: some results are per unit of mass, for want of a known mass "
                "change; compare those with each other, or give the mass change"
            )
    gears = Counter(gear for flight in flights for gear in flight.laws)
    if not any(n > 1 for n in gears.values()):
        raise InputError(f"the results have no gear in common ({listed(gears)}): give results of one structure")
