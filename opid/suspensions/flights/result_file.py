"""Reading of a result.json of `opid identify` as a flight.

The file is checked while it is read, and all its errors are listed in one message.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

from opid.errors import FileError
from opid.estimate import Estimate
from opid.mechanics.laws.law import LAWS, Law, Term
from opid.provenance import ReadFile, read_file
from opid.result import load_document
from opid.suspensions.result import SCHEMA

ONE_GEAR = "gear"
"""Name of the suspension of a single-gear result."""

MOST_FAULTS = 6
"""Number of errors of a file that are listed: a file of another kind has hundreds."""

_MOST_APART = 100.0
"""Ratio of two standard deviations of one estimate beyond which one is a slip: Student's t makes it up to 7."""

SINGLE_GEAR = "single gear"
"""Name of the structure of a single-gear result; those of a body have the names of their kinds."""


@dataclass(frozen=True)
class Quantity:
    """A number that is followed from flight to flight.

    Args:
        gear: the suspension that it belongs to; empty for the body.
        name: "stiffness", "damping", "friction", "gas", "mass", or the kind of a term of the law.
        unit: unit of its values.
        kind: kind of the law's term whose amplitude it is; empty for other quantities.
    """

    gear: str
    name: str
    unit: str
    kind: str = ""

    @property
    def label(self) -> str:
        """The quantity in words, without the gear."""
        words = {
            "friction": f"friction force ({self.kind})",
            "gas": "gas, pressure times volume",
            "mass": "total mass",
        }
        return words.get(self.name, self.name)

    @property
    def full_label(self) -> str:
        """The quantity in words, with the gear."""
        return self.label + (f" of {self.gear!r}" if self.gear else "")

    @property
    def key(self) -> str:
        """The quantity as summaries name it: gear, name and kind, separated by dots."""
        return ".".join(filter(None, (self.gear, self.name, self.kind)))

    def to_dict(self) -> dict[str, str]:
        """Return gear, name and kind as files of comparisons hold them."""
        return {"gear": self.gear, "quantity": self.name, "kind": self.kind}


@dataclass(frozen=True, eq=False)
class StrutLaw:
    """The force of a suspension as one result gives it.

    Args:
        stiffness: of its linear spring, N/m (per kg of mass where the flight is).
        damping: of its linear damper, N s/m.
        law: beside both; None if a kind in it is not known here.
        travelled_m: the least and the largest travel of the runs.
    """

    stiffness: float
    damping: float
    law: Law | None
    travelled_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Flight:
    """One result.

    Args:
        name: name of its study's folder.
        path: path of its file.
        date: date of the runs; None if the result has none.
        method: "model", "classical" or "paper".
        structure: kind of the structure.
        laws: {gear: kinds of the terms of its law}.
        values: {quantity: Estimate}.
        per_mass: whether its values are per unit of mass.
        recommended: whether its structure is recommended; always True for a single gear.
        doubt: why its values are missing, per unit of mass, or doubtful; empty if its result gives no reason.
        strut_laws: {gear: its force}; of those whose runs tell how far they travelled.
        file: its file with the hash of its content.
    """

    name: str
    path: Path
    date: date | None
    method: str
    structure: str
    laws: Mapping[str, tuple[str, ...]]
    values: Mapping[Quantity, Estimate]
    per_mass: bool = False
    recommended: bool = True
    doubt: str = ""
    strut_laws: Mapping[str, StrutLaw] = field(default_factory=dict)
    file: ReadFile | None = None

    @property
    def page(self) -> Path:
        """Its report, or its result where that has none."""
        return find_page(self.path)


def find_page(result: Path) -> Path:
    """Return the report beside a result; the result itself where it has none."""
    page = result.with_name("report.html")
    return page if page.exists() else result


def load_result(path: Path) -> dict[str, Any]:
    """Return the content of a result.json.

    Args:
        path: the file.

    Raises:
        InputError: it cannot be read, or is no result of `opid identify`.
    """
    return load_document(path, {SCHEMA: "identify"})


def read_flight(path: Path, name: str) -> Flight:
    """Read a result.json as the flight that is called `name`.

    Args:
        path: the file.
        name: of the flight.

    Raises:
        InputError: it cannot be read, is no result, or lacks a value of every result; all errors in one message.
    """
    document = load_result(path)
    faults: list[str] = []
    flight = _build_flight(path, name, _Table(document, "", faults))
    faults = list(dict.fromkeys(faults))
    if faults:
        more = [f"and {len(faults) - MOST_FAULTS} more"] if len(faults) > MOST_FAULTS else []
        listed = "; ".join([*faults[:MOST_FAULTS], *more])
        raise FileError(f"{path} is no valid result: {listed}: write it again with `opid identify`")
    return flight


@dataclass(frozen=True)
class _Table:
    """A table of the file, read by its keys; its errors are collected, one sentence each."""

    content: Mapping[str, object]
    where: str
    faults: list[str] = field(repr=False)

    def _get(self, key: str, kind: type | tuple[type, ...], what: str, default: Any, is_needed: bool) -> Any:
        value = self.content.get(key)
        if value is None:
            if is_needed:
                self.faults.append(f"{self.where}{key} is missing, {what} is needed")
            return default
        # A JSON boolean is an int in Python.
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            self.faults.append(f"{self.where}{key} is {value!r} where {what} is needed")
            return default
        return value

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text; it must be there unless there is a default."""
        return str(self._get(key, str, "text", default or "", default is None))

    def is_true(self, key: str) -> bool:
        """Return true or false; false if it is not there."""
        return bool(self._get(key, bool, "true or false", False, False))

    def number(self, key: str) -> float | None:
        """Return a finite number, or None if there is none."""
        value = self._get(key, (int, float), "a number", None, False)
        if value is not None and not math.isfinite(value):
            self.faults.append(f"{self.where}{key} is {value!r} where a finite number is needed")
            return None
        return None if value is None else float(value)

    def table(self, key: str) -> _Table:
        """Return a table, which must be there."""
        content = self._get(key, dict, "a table", None, True)
        # The keys of a missing table are no further errors.
        return _Table(content or {}, f"{self.where}{key}.", [] if content is None else self.faults)

    def optional(self, key: str) -> _Table | None:
        """Return a table, or None if there is none."""
        return None if self.content.get(key) is None else self.table(key)

    def tables(self, key: str, *, is_needed: bool = True) -> list[_Table]:
        """Return a list of tables."""
        rows = self._get(key, list, "a list of tables", [], is_needed)
        found = []
        for number, row in enumerate(rows):
            if isinstance(row, dict):
                found.append(_Table(row, f"{self.where}{key}[{number}].", self.faults))
            else:
                self.faults.append(f"{self.where}{key}[{number}] is {row!r} where a table is needed")
        return found

    def numbers(self, key: str) -> list[float]:
        """Return a list of finite numbers; empty if it is not there."""
        found = self._get(key, list, "a list of numbers", [], False)
        if all(isinstance(each, (int, float)) and math.isfinite(each) for each in found):
            return [float(each) for each in found]
        self.faults.append(f"{self.where}{key} is {found!r} where finite numbers are needed")
        return []

    def texts(self, key: str) -> list[str]:
        """Return a list of texts; empty if it is not there."""
        return [str(each) for each in self._get(key, list, "a list of names", [], False)]

    def day(self, key: str) -> date | None:
        """Return a date, or None if there is none."""
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
        if std is not None and std < 0:
            self.faults.append(f"{table.where}std is {std!r} where a positive number is needed")
        if value is None:
            return Estimate()
        if ends and not ends[0] <= value <= ends[1]:
            self.faults.append(f"{table.where}interval95 is {ends!r}, which does not hold the value {value!r}")
        if ends and std is not None and not self._do_agree(std, (ends[1] - ends[0]) / (2 * 1.96)):
            self.faults.append(f"{table.where}std is {std!r} beside interval95 {ends!r}, which do not belong together")
        if ends:
            low, high = (float(end) for end in ends)
            return Estimate(value, std if std else (high - low) / (2 * 1.96), (low, high))
        return Estimate.normal(value, std)

    @staticmethod
    def _do_agree(std: float, of_interval: float) -> bool:
        """Return whether a standard deviation and that of an interval may be of one estimate, few samples included."""
        return max(std, of_interval) <= _MOST_APART * min(std, of_interval)

    def amplitudes(self, key: str) -> dict[str, Estimate]:
        """Return the amplitude of each kind of a law."""
        kinds, found = self.table(key), {}
        for kind in kinds.content:
            parameters = kinds.table(kind)
            # the first parameter of a kind is its amplitude; a user's own kind need not be registered here
            name = LAWS[kind].parameters[0].name if kind in LAWS else next(iter(parameters.content), "amplitude")
            found[kind] = parameters.estimate(name)
        return found


def _build_flight(path: Path, name: str, document: _Table) -> Flight:
    structure = document.optional("structure")
    if structure is not None and structure.is_true("is_one_gear"):
        structure = None
    method, day = document.text("method"), document.day("date")
    mass = document.table("parameters").estimate("sprung_mass_kg")
    if mass.value is not None and not mass.value > 0:
        document.faults.append(f"parameters.sprung_mass_kg.value is {mass.value!r} where a positive number is needed")
    values = {Quantity("", "mass", "kg"): mass}
    laws: dict[str, tuple[str, ...]] = {}
    are_per_mass = []
    for gear, kinds, per_mass, of_gear in _read_one_gear(document) if structure is None else _read_gears(document):
        laws[gear] = tuple(sorted(kinds))
        are_per_mass.append(per_mass)
        values |= of_gear
    kind, is_recommended, left = (SINGLE_GEAR, True, "") if structure is None else _read_structure(document, structure)
    if not_determined := document.text("not_determined", default=""):
        doubt = f"it is not determined: {not_determined}"
    else:
        doubt = "" if is_recommended else f"no structure was recommended for it{left}"
    per_mass = any(are_per_mass)
    forces = dict(_read_strut_laws(document, laws, is_one_gear=structure is None))
    return Flight(name, path, day, method, kind, laws, values, per_mass, is_recommended, doubt, forces, read_file(path))


def _read_strut_laws(document: _Table, gears: Iterable[str], *, is_one_gear: bool) -> Iterator[tuple[str, StrutLaw]]:
    """Yield the force of each suspension whose linear part is known, and whose runs tell how far it travelled."""
    alike = {part: gear for gear in gears for part in gear.split(", ")}
    for interface in document.tables("interfaces", is_needed=False):
        gear = ONE_GEAR if is_one_gear else alike.get(interface.text("name"), "")
        tables = [interface.optional(name) for name in ("stiffness", "damping", "law")]
        if None in tables:  # an older result
            continue
        stiffness, damping = (interface.estimate(name).value for name in ("stiffness", "damping"))
        ends = [end for each in interface.tables("at_rest", is_needed=False) for end in each.numbers("travelled_m")]
        if gear and ends and stiffness is not None and damping is not None:
            yield gear, StrutLaw(stiffness, damping, _read_law(interface.table("law")), (min(ends), max(ends)))


def _read_law(kinds: _Table) -> Law | None:
    """Return the law of a table {kind: {parameter: estimate}}; None if a kind or a value is not known."""
    terms = []
    for name in kinds.content:
        kind, parameters = LAWS.get(name), kinds.table(name)
        values = [] if kind is None else [parameters.estimate(each.name).value for each in kind.parameters]
        if kind is None or None in values:
            return None
        terms.append(Term(name, tuple(float(value) for value in values if value is not None)))
    return Law(tuple(terms))


def _read_structure(document: _Table, structure: _Table) -> tuple[str, bool, str]:
    """Return the kind of the structure, whether it is recommended, and its residual in words.

    A structure may explain the runs that it was fitted to, but not a run that was left out: the larger residual counts.
    """
    kind = structure.text("kind")
    candidates = document.tables("candidates", is_needed=False)
    left = [structure.number("residual_over_noise")]
    left += [each.number("left_out_over_noise") for each in candidates if each.text("kind") == kind]
    most = max((each for each in left if each is not None), default=None)
    # null means that no structure is recommended; older results do not have the key.
    is_recommended = "recommended" not in structure.content or structure.content["recommended"] is not None
    return kind, is_recommended, "" if most is None else f" ({most:.3g} times the noise)"


_Gear = tuple[str, Iterable[str], bool, dict[Quantity, Estimate]]
"""Name of a suspension, kinds of its law, whether its values are per unit of mass, and these."""


def _require_names_once(document: _Table) -> None:
    names = Counter(each.text("name") for each in document.tables("interfaces", is_needed=False))
    document.faults.extend(
        f"the interface {name!r} stands {n} times in interfaces" for name, n in names.items() if n > 1
    )


def _read_one_gear(document: _Table) -> Iterator[_Gear]:
    _require_names_once(document)
    law = document.table("law")
    per_mass = law.is_true("per_mass")
    if per_mass:
        ratios = document.table("ratios")
        linear = ratios.estimate("stiffness_per_mass"), ratios.estimate("damping_per_mass")
    else:
        parameters = document.table("parameters")
        linear = (
            parameters.estimate("suspension_stiffness_n_per_m"),
            parameters.estimate("suspension_damping_n_s_per_m"),
        )
    kinds = {part for part in law.text("name").split("+") if part and part != "linear"}
    gas = next((_read_gas(each) for each in document.tables("interfaces", is_needed=False)), Estimate())
    yield ONE_GEAR, kinds, per_mass, _read_values(ONE_GEAR, *linear, law.amplitudes("parameters"), gas, per_mass)


def _read_gears(document: _Table) -> Iterator[_Gear]:
    seen: set[str] = set()
    _require_names_once(document)
    for interface in document.tables("interfaces"):
        name = interface.text("name")
        if name in seen:
            continue
        # Interfaces with a common estimate are one series.
        alike = [name, *(other for other in interface.texts("shared_with") if other != name)]
        seen.update(alike)
        per_mass = interface.table("stiffness").text("unit") != "N/m"
        linear = interface.estimate("stiffness"), interface.estimate("damping")
        amplitudes, gear = interface.amplitudes("law"), ", ".join(alike)
        yield gear, amplitudes, per_mass, _read_values(gear, *linear, amplitudes, _read_gas(interface), per_mass)


def _read_gas(interface: _Table) -> Estimate:
    gas = interface.optional("gas")
    return Estimate() if gas is None else gas.estimate("content_n_m")


def _read_values(
    gear: str, stiffness: Estimate, damping: Estimate, amplitudes: Mapping[str, Estimate], gas: Estimate, per_mass: bool
) -> dict[Quantity, Estimate]:
    """Return the quantities of a suspension; `gas` is pressure times volume of the gas that carries it."""
    has_gas, (of_spring, of_damper) = gas.value is not None, ("1/s^2", "1/s") if per_mass else ("N/m", "N s/m")
    # The stiffness of a gas strut changes with the weight of the flight, the amount of gas does not.
    first = (Quantity(gear, "gas", "N m"), gas) if has_gas else (Quantity(gear, "stiffness", of_spring), stiffness)
    values = dict([first, (Quantity(gear, "damping", of_damper), damping)])
    for kind, amplitude in amplitudes.items():
        if has_gas and kind in LAWS and LAWS[kind].quasi_static:
            continue  # it is the weight, which the mass represents
        unit = LAWS[kind].parameters[0].unit if kind in LAWS else ""
        what = "friction" if kind in LAWS and LAWS[kind].is_friction else kind
        values[Quantity(gear, what, f"{unit}/kg" if per_mass else unit, kind)] = amplitude
    return values
