"""The study file of a test bench and its log -> `BenchStudy`, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

from opid.errors import InputError, nearest, refuse
from opid.progress import Say
from opid.signals.log import AS_WRITTEN, LogSettings
from opid.signals.logs import write_log
from opid.studies.run_files import CHANNEL, ChannelTable, RunFiles, add_files, find_sources, read_run, tabulate_channel
from opid.studies.schema import Document, derive_record, format_toml, name_source, read_tables, recast
from opid.studies.study_file import TEST_BENCH
from opid.suspensions.bench.record import BenchStudy
from opid.suspensions.study import Run

_NAME = "the name of a channel in quotes"


@dataclass(frozen=True, kw_only=True)
class _Bench(derive_record(BenchStudy, "title", "recording", "findings", "source")):  # type: ignore[misc]
    log: str
    force: Annotated[str, _NAME]
    travel: Annotated[str, _NAME]
    velocity: Annotated[str | None, _NAME] = None
    counted: Annotated[str | None, _NAME] = None
    candidates: Annotated[tuple[str, ...] | None, "a list of kinds of law in quotes"] = None
    start_s: float | None = None
    stop_s: float | None = None

    @property
    def channels(self) -> list[str]:
        used = (self.force, self.travel, self.velocity, self.counted)
        return list(dict.fromkeys(name for name in used if name is not None))


@dataclass(frozen=True, kw_only=True)
class _Study:
    title: str | None = None
    bench: Annotated[_Bench, TEST_BENCH.needs["bench"]]
    log: LogSettings = AS_WRITTEN
    channels: Mapping[str, Annotated[str | int | ChannelTable, CHANNEL]] = field(default_factory=dict)


def build_study(document: Document, source: Path, say: Say) -> BenchStudy:
    """Read the log that a study file of a test bench names, and return the study."""
    study, faults = read_bench_tables(document)
    refuse(faults, source)
    with name_source(source):
        read = _read_log(study, source.parent, say, title=study.title or source.stem, source=source, log=None)
        return replace(read, recording=add_files(read.recording, source))


def read_bench_tables(document: Document) -> tuple[_Study, list[str]]:
    """Return the content of a study file of a test bench, and its faults."""
    study, faults = read_tables(_Study, document)
    if study.bench:
        faults += _find_unused_channels(study, "[channels]")
    return study, faults


def _find_unused_channels(study: _Study, where: str) -> list[str]:
    """Return the faults of channels that `where` describes and the bench does not take."""
    return [
        f"[bench] takes no channel {name!r}, which stands in {where} ({nearest(name, study.bench.channels)})"
        for name in study.channels
        if name not in study.bench.channels
    ]


def bench_study_from_log(
    log: Path,
    *,
    progress: Say,
    units: Mapping[str, str] = MappingProxyType({}),
    time_unit: str | None = None,
    **bench: Any,
) -> BenchStudy:
    """Return the study of a log without a study file.

    Args:
        log: the log.
        progress: called with the name of the log as it is read.
        units: of channels, by name, whatever the log states.
        time_unit: likewise of its time.
        bench: the fields of `BenchStudy` that are known.

    Raises:
        InputError: the log is at fault, or as `BenchStudy`.
    """
    study = _Study(
        bench=_Bench(log=str(log), **bench),
        log=LogSettings(time_unit=time_unit),
        channels={name: ChannelTable(unit=unit) for name, unit in units.items()},
    )
    refuse(_find_unused_channels(study, "--unit"), log)
    return _read_log(study, Path(), progress, title=log.name, log=log, source=None)


def write_files(study: BenchStudy, directory: Path) -> str:
    """Write the log of a test bench, and return the text of the study file."""
    write_log(study.recording, directory / "bench.csv")
    return format_toml(_Study(title=study.title, bench=recast(_Bench, study, log="bench.csv")))


def _read_log(study: _Study, directory: Path, say: Say, *, title: str, **origin: Any) -> BenchStudy:
    bench = study.bench
    channels = {name: tabulate_channel(ChannelTable, name, study.channels.get(name, name)) for name in bench.channels}
    sources = find_sources(channels, run=title, log=bench.log, settings=study.log, directory=directory)
    files = RunFiles(title, sources, 0.0, bench.start_s, bench.stop_s)
    if bench.quasi_static:
        for name in ("start_s", "stop_s"):
            if getattr(bench, name) is not None:
                raise InputError(
                    f"[bench]: {name} beside quasi_static, where time means nothing: leave one of them out"
                )
        run = read_run(_drop_time(files), is_bench=True, progress=say)
    else:
        run = _read_with_time(files, say)
    return recast(BenchStudy, bench, title=title, recording=run.recording, findings=run.findings, **origin)


def _read_with_time(files: RunFiles, say: Say) -> Run:
    """Read a test with its time; if only the time is at fault, say how to do without it."""
    try:
        return read_run(files, is_bench=True, progress=say)
    except InputError as error:
        has_stretch = files.start_s is not None or files.stop_s is not None
        if has_stretch or not _is_readable(_drop_time(files)):
            raise
        raise error.reword(
            f"{error}; a test so slow that time means nothing needs none: --quasi-static, or quasi_static = true in a "
            "study"
        ) from None


def _is_readable(files: RunFiles) -> bool:
    try:
        return bool(read_run(files, is_bench=True))
    except InputError:
        return False


def _drop_time(files: RunFiles) -> RunFiles:
    """Return the same logs with one second from each row to the next."""
    sources = {name: replace(each, settings=replace(each.settings, fs_hz=1.0)) for name, each in files.sources.items()}
    return replace(files, sources=sources)
