"""A result.json of `opid identify` as a typed record: all that the comparison of flights knows of the file.

The file is checked as it is read, and everything that is wrong with it is said at once.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.laws.law import LAWS
from opid.provenance import ReadFile, read_file
from opid.suspensions.result import SCHEMA

RESULT_FILE = "result.json"

ONE_GEAR = "gear"
"""What the suspension of a single-gear result is called."""

MOST_FAULTS = 6
"""Faults of a file that are told: a file that is something else has hundreds."""


_NOTHING = Estimate()


@dataclass(frozen=True)
class GearRecord:
    """One suspension, or several that share one estimate.

    Args:
        name: of the suspension; those that share an estimate are joined by commas.
        stiffness: in N/m, or per unit of mass in 1/s^2.
        damping: in N s/m, or per unit of mass in 1/s.
        kinds: of the terms of its law, sorted.
        amplitudes: {kind: Estimate}, without those of a law of which no values are told.
        per_mass: whether all of them are per unit of mass.
        gas: pressure times volume of the gas that carries it, N m; nothing where none does.
    """

    name: str
    stiffness: Estimate
    damping: Estimate
    kinds: tuple[str, ...]
    amplitudes: Mapping[str, Estimate]
    per_mass: bool
    gas: Estimate = _NOTHING


@dataclass(frozen=True)
class StructureRecord:
    """What is said of the structure of a body.

    Args:
        kind: of the structure.
        is_recommended: whether it is recommended.
        left_over_noise: what it leaves of the runs that it was fitted to, and of those left out, as far as it is known.
    """

    kind: str
    is_recommended: bool
    left_over_noise: tuple[float, ...]


@dataclass(frozen=True)
class ResultRecord:
    """What a result.json holds.

    Args:
        path: of the file.
        method: "model", "classical" or "paper".
        date: of the runs; None if it is not known.
        mass: of the body, kg.
        gears: the suspensions.
        structure: of a body; None of one gear, which is itself.
        not_determined: why absolute values are missing; empty where they are not.
        file: with the hash of what it holds.
    """

    path: Path
    method: str
    date: date | None
    mass: Estimate
    gears: tuple[GearRecord, ...]
    structure: StructureRecord | None
    not_determined: str
    file: ReadFile


def read_result(path: Path) -> ResultRecord:
    """Read a result.json.

    Args:
        path: the file.

    Raises:
        InputError: it cannot be read, is no result, or lacks what every result has; everything is said at once.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}: check the name") from error
    except ValueError as error:
        raise InputError(f"{path} is no JSON: give the {RESULT_FILE} of `opid identify`") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        has = f"has the schema {schema!r}" if schema is not None else "has no schema"
        raise InputError(f"{path} {has} where {SCHEMA!r} is needed: give the {RESULT_FILE} of `opid identify`")
    faults: list[str] = []
    record = _record(path, _Table(document, "", faults))
    faults = list(dict.fromkeys(faults))
    if faults:
        more = [f"and {len(faults) - MOST_FAULTS} more"] if len(faults) > MOST_FAULTS else []
        listed = "; ".join([*faults[:MOST_FAULTS], *more])
        raise InputError(f"{path} is no sound result: {listed}: write it anew with `opid identify`")
    return record


@dataclass(frozen=True)
class _Table:
    """A table of the file: it is read by keys, and what is wrong is noted as one sentence each."""

    content: Mapping[str, object]
    where: str
    faults: list[str] = field(repr=False)

    def _get(self, key: str, kind: type | tuple[type, ...], what: str, default: Any, is_needed: bool) -> Any:
        value = self.content.get(key)
        if value is None:
            if is_needed:
                self.faults.append(f"{self.where}{key} is missing, {what} is needed")
            return default
        # a JSON boolean is an int to Python
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            self.faults.append(f"{self.where}{key} is {value!r} where {what} is needed")
            return default
        return value

    def text(self, key: str, default: str | None = None) -> str:
        """A text; it must be there unless there is a default."""
        return str(self._get(key, str, "text", default or "", default is None))

    def is_true(self, key: str) -> bool:
        """True or false; false where it is not there."""
        return bool(self._get(key, bool, "true or false", False, False))

    def number(self, key: str) -> float | None:
        """A finite number, or None where there is none."""
        value = self._get(key, (int, float), "a number", None, False)
        if value is not None and not math.isfinite(value):
            self.faults.append(f"{self.where}{key} is {value!r} where a finite number is needed")
            return None
        return None if value is None else float(value)

    def table(self, key: str) -> _Table:
        """A table, which must be there."""
        content = self._get(key, dict, "a table", None, True)
        # what a table that is missing does not hold is no fault of its own
        return _Table(content or {}, f"{self.where}{key}.", [] if content is None else self.faults)

    def tables(self, key: str, *, is_needed: bool = True) -> list[_Table]:
        """Tables in a row."""
        rows = self._get(key, list, "a list of tables", [], is_needed)
        found = []
        for number, row in enumerate(rows):
            if isinstance(row, dict):
                found.append(_Table(row, f"{self.where}{key}[{number}].", self.faults))
            else:
                self.faults.append(f"{self.where}{key}[{number}] is {row!r} where a table is needed")
        return found

    def texts(self, key: str) -> list[str]:
        """Texts in a row; none where they are not there."""
        return [str(each) for each in self._get(key, list, "a list of names", [], False)]

    def day(self, key: str) -> date | None:
        """A date, or None where there is none."""
        value = self._get(key, str, "a date", None, False)
        try:
            return None if value is None else date.fromisoformat(value)
        except ValueError:
            self.faults.append(f"{self.where}{key} is {value!r} where a date like '2026-03-01' is needed")
            return None

    def estimate(self, key: str) -> Estimate:
        """A value with its standard deviation and interval, each of which may be missing."""
        table = self.table(key)
        value, std = table.number("value"), table.number("std")
        ends = table._get("interval95", list, "a list of two numbers", [], False)
        if not all(isinstance(end, (int, float)) and math.isfinite(end) for end in ends) or len(ends) not in (0, 2):
            self.faults.append(f"{table.where}interval95 is {ends!r} where two finite numbers are needed")
            ends = []
        if value is None:
            return Estimate()
        if ends:
            low, high = (float(end) for end in ends)
            return Estimate(value, std if std else (high - low) / (2 * 1.96), (low, high))
        return Estimate.normal(value, std)

    def amplitudes(self, key: str) -> dict[str, Estimate]:
        """The amplitude of each kind of a law."""
        kinds, found = self.table(key), {}
        for kind in kinds.content:
            parameters = kinds.table(kind)
            # the first parameter of a kind is its amplitude; a user's own kind need not be registered here
            name = LAWS[kind].parameters[0].name if kind in LAWS else next(iter(parameters.content), "amplitude")
            found[kind] = parameters.estimate(name)
        return found


def _record(path: Path, document: _Table) -> ResultRecord:
    has_structure = document.content.get("structure") is not None
    structure = document.table("structure") if has_structure else None
    if structure is not None and structure.is_true("is_one_gear"):
        structure = None
    return ResultRecord(
        path=path,
        method=document.text("method"),
        date=document.day("date"),
        mass=document.table("parameters").estimate("sprung_mass_kg"),
        gears=(_one_gear(document),) if structure is None else _gears(document),
        structure=None if structure is None else _structure(document, structure),
        not_determined=document.text("not_determined", default=""),
        file=read_file(path),
    )


def _one_gear(document: _Table) -> GearRecord:
    law = document.table("law")
    per_mass = law.is_true("per_mass")
    if per_mass:
        ratios = document.table("ratios")
        stiffness, damping = ratios.estimate("stiffness_per_mass"), ratios.estimate("damping_per_mass")
    else:
        parameters = document.table("parameters")
        stiffness = parameters.estimate("suspension_stiffness_n_per_m")
        damping = parameters.estimate("suspension_damping_n_s_per_m")
    kinds = {part for part in law.text("name").split("+") if part and part != "linear"}
    gas = next((_gas(each) for each in document.tables("interfaces", is_needed=False)), Estimate())
    return GearRecord(ONE_GEAR, stiffness, damping, tuple(sorted(kinds)), law.amplitudes("parameters"), per_mass, gas)


def _gas(interface: _Table) -> Estimate:
    has_gas = interface.content.get("gas") is not None
    return interface.table("gas").estimate("content_n_m") if has_gas else Estimate()


def _gears(document: _Table) -> tuple[GearRecord, ...]:
    gears: list[GearRecord] = []
    seen: set[str] = set()
    for interface in document.tables("interfaces"):
        name = interface.text("name")
        if name in seen:
            continue
        # those that share one estimate are one series
        alike = [name, *(other for other in interface.texts("shared_with") if other != name)]
        seen.update(alike)
        per_mass = interface.table("stiffness").text("unit") != "N/m"
        stiffness, damping = interface.estimate("stiffness"), interface.estimate("damping")
        amplitudes = interface.amplitudes("law")
        own = (stiffness, damping, tuple(sorted(amplitudes)), amplitudes, per_mass, _gas(interface))
        gears.append(GearRecord(", ".join(alike), *own))
    return tuple(gears)


def _structure(document: _Table, structure: _Table) -> StructureRecord:
    kind = structure.text("kind")
    candidates = document.tables("candidates", is_needed=False)
    left = [structure.number("residual_over_noise")]
    left += [each.number("left_out_over_noise") for each in candidates if each.text("kind") == kind]
    # null says that none is recommended; results of old say nothing
    is_recommended = "recommended" not in structure.content or structure.content["recommended"] is not None
    return StructureRecord(kind, is_recommended, tuple(each for each in left if each is not None))
