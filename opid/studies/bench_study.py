"""The study file of a test bench and its log -> `BenchStudy`, and back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from opid.errors import InputError, nearest, refuse
from opid.signals.logs import write_log
from opid.studies.kinds import TEST_BENCH
from opid.studies.run_files import RunFiles, run_from_files
from opid.studies.suspension_study import run_files_of
from opid.studies.tables import (
    CHANNEL,
    LOG,
    MAYBE_NUMBER,
    MAYBE_TEXT,
    TEXT,
    Document,
    Key,
    Say,
    dict_at,
    keys_of,
    list_at,
    maybe,
    prefixed,
    stated,
    table_faults,
    toml_of,
)
from opid.suspensions.bench.study import BenchStudy
from opid.suspensions.study import Run

_OF_THE_FILE = ("title", "recording", "findings", "source", "log")
"""Fields of the record that no key of [bench] gives."""
_CHANNELS = ("force", "travel", "velocity", "counted")
_BENCH = keys_of(
    BenchStudy,
    without=_OF_THE_FILE,
    log=TEXT,
    **dict.fromkeys(_CHANNELS[:2], Key(str, "the name of a channel in quotes")),
    **dict.fromkeys(_CHANNELS[2:], maybe(str, "the name of a channel in quotes")),
    candidates=maybe(list, "a list of kinds of law in quotes"),
    start_s=MAYBE_NUMBER,
    stop_s=MAYBE_NUMBER,
)
_STUDY = {
    "title": MAYBE_TEXT,
    "bench": Key(dict, TEST_BENCH.needs["bench"], keys=_BENCH),
    "log": maybe(dict, "a table [log]", keys=LOG),
    "channels": maybe(dict, "a table [channels]", entries=CHANNEL),
}


def build_bench_study(document: Document, source: Path, say: Say) -> BenchStudy:
    """Read the log that a study file of a test bench names, and return the study."""
    refuse(list(document_faults(document)), source)
    with prefixed(f"{source}: "):
        return _study(document, source.parent, say, title=document.get("title", source.stem), source=source)


def bench_study_from_log(log: Path, *, progress: Say, **bench: Any) -> BenchStudy:
    """Return the study of a log without a study file.

    Args:
        log: the log.
        progress: called with the name of the log as it is read.
        bench: the fields of `BenchStudy` that are known.

    Raises:
        InputError: the log is at fault, or as `BenchStudy`.
    """
    known = {name: value for name, value in bench.items() if value is not None}
    return _study({"bench": {"log": str(log), **known}}, Path(), progress, title=log.name, log=log)


def write_bench_log(study: BenchStudy, directory: Path) -> str:
    """Write the log of a test bench, and return the text of the study file."""
    write_log(study.recording, directory / "bench.csv")
    table = stated(study, without=_OF_THE_FILE)
    if "candidates" in table:
        table["candidates"] = list(table["candidates"])
    return toml_of({"title": study.title, "bench": {"log": "bench.csv", **table}})


def document_faults(document: Document) -> Iterator[str]:
    """Yield what is wrong with a study file of a test bench."""
    yield from table_faults("the study", document, _STUDY)
    for kind in list_at(dict_at(document, "bench"), "candidates"):
        if not isinstance(kind, str):
            yield f"'candidates' in [bench] holds {kind!r}, give {_BENCH['candidates'].what}"
    used = [name for name in map(dict_at(document, "bench").get, _CHANNELS) if isinstance(name, str)]
    for name in dict_at(document, "channels"):
        if name not in used:
            yield f"[bench] takes no channel {name!r}, which stands in [channels] ({nearest(name, used)})"


def _study(document: Document, directory: Path, say: Say, *, title: str, **origin: Any) -> BenchStudy:
    table = document["bench"]
    files = _files_of(document, directory, title)
    if table.get("quasi_static"):
        for name in ("start_s", "stop_s"):
            if name in table:
                raise InputError(
                    f"[bench]: {name} beside quasi_static, where time means nothing: leave one of them out"
                )
        run = run_from_files(_without_time(files), is_bench=True, progress=say)
    else:
        run = _with_time(files, say)
    known = {name: value for name, value in table.items() if name not in ("log", "start_s", "stop_s")}
    return BenchStudy(title, run.recording, findings=run.findings, **known, **origin)


def _files_of(document: Document, directory: Path, title: str) -> RunFiles:
    """Where each channel of the bench is found, and how it is read: as those of a run."""
    table, named = document["bench"], document.get("channels", {})
    wanted = [table[name] for name in _CHANNELS if name in table]
    channels = {name: named.get(name, name) for name in dict.fromkeys(wanted)}
    channels = {name: each if isinstance(each, Mapping) else {"channel": each} for name, each in channels.items()}
    return run_files_of({**document, "channels": channels}, {**table, "name": title}, directory)


def _with_time(files: RunFiles, say: Say) -> Run:
    """Read a test with its time; where only that is at fault, say how to do without."""
    try:
        return run_from_files(files, is_bench=True, progress=say)
    except InputError as error:
        has_stretch = files.start_s is not None or files.stop_s is not None
        if has_stretch or not _is_readable(_without_time(files)):
            raise
        raise InputError(
            f"{error}; a test so slow that time means nothing needs none: --quasi-static, or quasi_static = true in a "
            "study"
        ) from None


def _is_readable(files: RunFiles) -> bool:
    try:
        return bool(run_from_files(files, is_bench=True))
    except InputError:
        return False


def _without_time(files: RunFiles) -> RunFiles:
    """The same logs, each row of which is a second later than the one before."""
    sources = {name: replace(each, settings=replace(each.settings, fs_hz=1.0)) for name, each in files.sources.items()}
    return replace(files, sources=sources)
