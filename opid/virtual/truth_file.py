"""A simulated test on disk: its study with the logs, and truth.json, which only this file writes and reads."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from opid.errors import FileError, InputError, shorten_middle
from opid.json_values import json_text, plain, read_json
from opid.mechanics.laws.law import Law, law_from_parameters
from opid.mechanics.truth import (
    BodyNumbers,
    BodyTruth,
    GearNumbers,
    GearTruth,
    LinearModesTruth,
    ModalTruth,
    ModeTruth,
    SuspensionTruth,
    Truth,
    UpdatingTruth,
)
from opid.signals.files import PATIENCE_S, reserve_directory, write_whole
from opid.studies.study_file import write_study

if TYPE_CHECKING:
    from opid.studies.study_file import AnyStudy

T = TypeVar("T", GearTruth, BodyTruth, ModalTruth, UpdatingTruth)


@dataclass(frozen=True)
class _Kind:
    """A kind of truth.json: its schema, what was simulated, by which command, and how it is read and written."""

    schema: str
    what: str
    command: str
    read: Callable[[Mapping[str, Any]], Truth]
    tables: Callable[[Any], Mapping[str, Any]]


def write_field_test(study: AnyStudy, truth: Truth, directory: str | os.PathLike[str]) -> Path:
    """Write the logs or other files of a study, study.toml and truth.json, together, and return the path of the study.

    Raises:
        InputError: a directory that cannot be written to, or what `write_study` refuses.
    """
    with (
        reserve_directory(directory, wait_s=PATIENCE_S) as reserved,
        reserved.replace_files(last="study.toml") as folder,
    ):
        write_study(study, folder / "study.toml")
        with write_whole(folder / "truth.json") as file:
            file.write(json_text(tabulate_truth(truth)))
    return reserved / "study.toml"


def tabulate_truth(truth: Truth) -> dict[str, Any]:
    """Return the content of truth.json: `schema`, the fields of the record, and `settings`."""
    kind = _KINDS[type(truth)]
    return plain({"schema": kind.schema, **kind.tables(truth), "settings": dict(truth.settings)})


def read_truth(path: str | os.PathLike[str], record: type[T]) -> T:
    """Read a truth.json.

    Raises:
        InputError: no such file, another schema, or content that this command does not write.
    """
    kind = _KINDS[record]
    remedy = f"give the truth.json that `{kind.command}` wrote beside the study"
    try:
        table = _load(Path(path), remedy)
        if table["schema"] != kind.schema:
            has = shorten_middle(str(table["schema"]), 40)
            raise InputError(
                f"it has the schema {has!r} where {kind.schema!r} is needed, the truth of {kind.what}; {remedy}"
            )
        return kind.read(table)  # type: ignore[return-value]
    except OSError as error:
        raise FileError(
            f"cannot read the truth {path}: {error.strerror or error}: {remedy}, or leave it out"
        ) from error
    except InputError as error:
        raise FileError(f"{path} is not the truth of {kind.what}, {error}") from error
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError) as error:
        why = (
            f"it has no {error.args[0]!r}"
            if isinstance(error, KeyError)
            else "one of its values is not of the kind that such a file holds"
        )
        raise FileError(f"{path} is not the truth of {kind.what}, {why}: {remedy}") from error


def _load(path: Path, remedy: str) -> Any:
    try:
        return read_json(path)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"it is not JSON ({error}): {remedy}") from error


def _read_numbers(record: Any, table: Mapping[str, Any], **others: Any) -> Any:
    """Return the record with the numbers of a table and some other fields."""
    names = [each.name for each in fields(record) if each.name not in others]
    return record(**{name: float(table[name]) for name in names}, **others)


def _read_law(table: Mapping[str, Any]) -> Law:
    # Older files do not hold the origin of a law.
    return law_from_parameters(table["name"], table["parameters"]).resting_at(float(table.get("rest_m", 0.0)))


def _tabulate_law(law: Law) -> dict[str, Any]:
    return {"name": law.name, "parameters": law.parameters, "rest_m": law.rest_m}


def _read_gear(table: Mapping[str, Any]) -> GearTruth:
    numbers = _read_numbers(GearNumbers, table["parameters"])
    return GearTruth(
        numbers, _read_law(table["law"]), float(table.get("mass_change_kg", 0.0)), table.get("settings", {})
    )


def _tabulate_gear(truth: GearTruth) -> dict[str, Any]:
    return {
        "parameters": asdict(truth.parameters),
        "law": _tabulate_law(truth.law),
        "mass_change_kg": truth.mass_change_kg,
    }


def _read_body(table: Mapping[str, Any]) -> BodyTruth:
    loadings = {run: tuple((*map(float, row),) for row in rows) for run, rows in table.get("loadings", {}).items()}
    return BodyTruth(
        _read_numbers(BodyNumbers, table["parameters"]),
        {
            name: _read_numbers(SuspensionTruth, each, law=_read_law(each["law"]))
            for name, each in table["interfaces"].items()
        },
        loadings,  # type: ignore[arg-type]
        table.get("settings", {}),
    )


def _tabulate_body(truth: BodyTruth) -> dict[str, Any]:
    interfaces = {name: vars(each) | {"law": _tabulate_law(each.law)} for name, each in truth.interfaces.items()}
    return {"parameters": asdict(truth.parameters), "interfaces": interfaces, "loadings": dict(truth.loadings)}


def _read_modes(table: Mapping[str, Any]) -> ModalTruth:
    nonlinear = {}
    for mode, each in table["nonlinear"].items():
        k, c = ({int(power): float(value) for power, value in each[letter].items()} for letter in ("k", "c"))
        nonlinear[int(mode)] = ModeTruth(k, c, **_read_series(each))
    linear = LinearModesTruth(**_read_series(table.get("linear_modes", {})))
    return ModalTruth(nonlinear, linear, table.get("structure", ""), table.get("settings", {}))


def _read_series(table: Mapping[str, Any]) -> dict[str, tuple[float, ...]]:
    names = ("amplitude", "frequency_hz", "damping_ratio")
    return {name: tuple(map(float, table[name])) for name in names if name in table}


def _tabulate_modes(truth: ModalTruth) -> dict[str, Any]:
    nonlinear = {str(mode): asdict(each) for mode, each in truth.nonlinear.items()}
    for each in nonlinear.values():
        each |= {letter: {str(power): value for power, value in each[letter].items()} for letter in ("k", "c")}
    return {"structure": truth.structure, "linear_modes": asdict(truth.linear_modes), "nonlinear": nonlinear}


def _read_backbones(table: Mapping[str, Any]) -> UpdatingTruth:
    linear = {name: float(value) for name, value in table["linear"].items()}
    laws = {joint: _read_law(law) for joint, law in table["laws"].items()}
    return UpdatingTruth(linear, laws, table.get("structure", ""), table.get("settings", {}))


def _tabulate_backbones(truth: UpdatingTruth) -> dict[str, Any]:
    laws = {joint: _tabulate_law(law) for joint, law in truth.laws.items()}
    return {"structure": truth.structure, "linear": dict(truth.linear), "laws": laws}


_KINDS: dict[type, _Kind] = {
    GearTruth: _Kind("opid.truth/1", "a simulated field test", "opid simulate", _read_gear, _tabulate_gear),
    BodyTruth: _Kind("opid.body-truth/1", "a simulated aircraft", "opid simulate aircraft", _read_body, _tabulate_body),
    ModalTruth: _Kind(
        "opid.modal-truth/1", "a simulated modal test", "opid simulate sine-beats", _read_modes, _tabulate_modes
    ),
    UpdatingTruth: _Kind(
        "opid.updating-truth/2", "simulated backbones", "opid simulate backbones", _read_backbones, _tabulate_backbones
    ),
}
