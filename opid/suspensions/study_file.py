"""Study files of a body on several suspensions -> `BodyStudy`, and back."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import tomli_w

from opid.errors import InputError
from opid.signals.files import written_whole
from opid.signals.tables import Document, load, log_settings, refuse
from opid.suspensions.one_gear.study_file import LogReading, Say, readings_of, run_files_of, write_logs
from opid.suspensions.run_files import RunFiles, at_one_rate, run_from_files
from opid.suspensions.study import BodySensor, BodyStudy, LoadedRun, MeasuredInterface, StructureSettings
from opid.suspensions.study_tables import body_document_faults, loading_of


def read_body_study(path: str | os.PathLike[str], *, progress: Say | None = None) -> BodyStudy:
    """Read the study file of a body on several suspensions, and the logs that it names.

    Args:
        path: a TOML file with one table `[[interfaces]]` for each suspension: `name`, `sprung` and `unsprung` (the name
            of a channel in the logs, or of an entry in `[channels]`), `x_m` forward and `y_m` to the left, and
            `sensor_x_m`, `sensor_y_m` where the sensor on the body is not at the suspension; one table
            `[[body_sensors]]` for each further sensor on the body (`channel`, `x_m`, `y_m`); a table `[structure]` with
            the fields of `StructureSettings`; and one table `[[runs]]` for each log: `name`, `log` (path beside the
            study file), and `loading`, what it carries more than the reference: rows [mass_kg, x_m, y_m], or the name
            of a CSV file with these columns. `title`, `date`, `fs_hz`, `[log]`, `[channels]`, `[runs.channels]`,
            `start_s` and `stop_s` are as in `opid.read_study`.
        progress: called with the name of each log as it is read.

    Raises:
        InputError: the file is missing or no TOML, an unknown, missing or mistyped key, an interface without one of its
            sides, or a log or a loading table is at fault: all at once.
    """
    source = Path(path)
    document = load(source)
    refuse(list(body_document_faults(document)), source)
    try:
        all_files = [_run_files(document, entry, source.parent) for entry in document["runs"]]
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    runs, loadings, faults = [], [], []
    for entry, files in zip(document["runs"], all_files, strict=True):
        try:
            loadings.append(loading_of(entry, source.parent))
        except InputError as error:
            faults.append(f"run {files.name!r}: {error}")
        try:
            runs.append(run_from_files(files, fs_hz=document.get("fs_hz"), progress=progress))
        except InputError as error:
            faults.append(f"run {files.name!r}: {error}")
    refuse(faults, source)
    return BodyStudy(
        title=document.get("title", source.stem),
        interfaces=tuple(MeasuredInterface(**entry) for entry in document["interfaces"]),
        runs=tuple(
            LoadedRun(run.name, run.recording, loading, run.findings)
            for run, loading in zip(at_one_rate(runs), loadings, strict=True)
        ),
        structure=_structure(document.get("structure", {})),
        sensors=tuple(BodySensor(**entry) for entry in document.get("body_sensors", [])),
        date=document.get("date"),
        source=source,
    )


def write_body_study(study: BodyStudy, path: str | os.PathLike[str]) -> None:
    """Write a study so that `read_body_study` gives it back: the study file, and `NAME.csv` beside it for a run.

    Args:
        study: what to write.
        path: the study file; its directory must exist.

    Raises:
        InputError: a place that cannot be written to, or a run whose name is no file name.
    """
    target = Path(path)
    write_logs({run.name: run.recording for run in study.runs}, target.parent)
    with written_whole(target) as file:
        file.write(_text(study))


def body_log_readings(path: str | os.PathLike[str], log: str | os.PathLike[str]) -> tuple[LogReading, ...]:
    """Return how the study of a body reads one log, as `opid.suspensions.one_gear.study_file.log_readings` does.

    Args:
        path: the study file; none of its logs need be there.
        log: the file, by any path that leads to it.

    Raises:
        InputError: the study is missing or no TOML, an unknown, missing or mistyped key, or a value that cannot be.
    """
    source = Path(path)
    document = load(source)
    refuse(list(body_document_faults(document)), source)
    try:
        settings = log_settings(document.get("log", {}))
        all_files = [_run_files(document, entry, source.parent) for entry in document["runs"]]
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    return readings_of(all_files, settings, log)


def _text(study: BodyStudy) -> str:
    """The study file."""
    head: dict[str, Any] = {"title": study.title} | ({} if study.date is None else {"date": study.date})
    used = _used(study)
    # every further channel of the runs by its own name, so that it is read back
    further = {name: name for run in study.runs for name in run.recording.names if name not in used}
    if further:
        head["channels"] = further
    standard = asdict(StructureSettings())
    head["structure"] = {
        name: value
        for name, value in asdict(study.structure).items()
        if name == "kind" or (value is not None and value != standard[name])
    }
    text = tomli_w.dumps(head)
    for interface in study.interfaces:
        told = {name: value for name, value in asdict(interface).items() if value is not None}
        text += "\n[[interfaces]]\n" + tomli_w.dumps(told)
    for sensor in study.sensors:
        text += "\n[[body_sensors]]\n" + tomli_w.dumps(asdict(sensor))
    for run in study.runs:
        # all of it: without a start the stretch in motion would be looked for
        entry = {"name": run.name, "log": f"{run.name}.csv", "start_s": run.recording.start_s}
        text += "\n[[runs]]\n" + tomli_w.dumps(entry)
        if run.loading:
            rows = ", ".join(f"[{each.mass_kg!r}, {each.x_m!r}, {each.y_m!r}]" for each in run.loading)
            text += f"loading = [{rows}]\n"
    return text


def _used(study: BodyStudy) -> list[str]:
    """The channels that the interfaces and the further sensors name."""
    pairs = [channel for interface in study.interfaces for channel in (interface.unsprung, interface.sprung)]
    return [*pairs, *(sensor.channel for sensor in study.sensors)]


def _structure(table: Mapping[str, Any]) -> StructureSettings:
    shared = tuple(tuple(group) for group in table.get("shared", []))
    return StructureSettings(**{**table, "shared": shared})


def _run_files(document: Document, entry: Mapping[str, Any], directory: Path) -> RunFiles:
    """Where each channel of a run is found; in the recording it has the name by which the study calls it."""
    named = document.get("channels", {})
    wanted = [side for each in document["interfaces"] for side in (each["unsprung"], each["sprung"])]
    wanted += [each["channel"] for each in document.get("body_sensors", [])]
    entries = {name: named.get(name, name) for name in dict.fromkeys([*wanted, *named])}
    tables = {name: table if isinstance(table, Mapping) else {"channel": table} for name, table in entries.items()}
    return run_files_of(
        {"channels": tables, "log": document.get("log", {})}, {"mass_change_kg": 0.0, **entry}, directory
    )
