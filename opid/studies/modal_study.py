"""Study files of modal tests and their logs -> `ModalStudy`, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from opid.errors import FileError, InputError, nearest, refuse
from opid.modal.linear.modes import LinearModes, ModalTest, modal_test
from opid.modal.linear.modes_file import read_modes, write_modes
from opid.modal.resonance.curve_file import CurveColumns, read_curve, write_curve
from opid.modal.resonance.curves import ResponseCurve
from opid.modal.study import ModalStudy, StudyTest, Use
from opid.progress import Say
from opid.provenance import read_file
from opid.signals.conversion import recording_of, require_distinct
from opid.signals.log import AS_WRITTEN, ChannelSettings, Log, LoggedChannel, LogSettings
from opid.signals.logs import open_log, write_log
from opid.signals.recording import Recording
from opid.studies.run_files import CHANNEL, ChannelTable, add_files, tabulate_channel
from opid.studies.schema import (
    NO_KEY,
    Document,
    collect_faults,
    derive_record,
    find_misspelt,
    format_toml,
    load,
    name_source,
    read_tables,
    recast,
    require_plain,
    select_stated,
)
from opid.studies.study_file import MODAL_TESTS, kind_of

LARGEST_CSV = 3_000_000
"""Logs with more values than this, some 60 MB of text, are written as HDF5 if h5py is installed."""

_Settings: Any = derive_record(ModalStudy, "title", "modes", "tests", "curves", "source", nonlinear=())
"""The settings of the model, which stand in [modes] or beside it."""


@dataclass(frozen=True, kw_only=True)
class _Modes(_Settings):
    file: str


@dataclass(frozen=True, kw_only=True)
class _Channel(ChannelTable):
    # All channels of a test come from one recorder.
    file: Annotated[None, NO_KEY] = None
    log: Annotated[None, NO_KEY] = None
    shift_s: Annotated[float, NO_KEY] = 0.0
    shift_tolerance_s: Annotated[float | None, NO_KEY] = None
    drift_tolerance_ppm: Annotated[float, NO_KEY] = 100.0


@dataclass(frozen=True, kw_only=True)
class _Test:
    log: str
    name: str = ""
    use: Use | None = None
    force: Annotated[str | None, "the name of a channel in quotes"] = None
    drive_point: Annotated[str | None, "the name of a sensor in quotes"] = None
    forces: Mapping[str, Annotated[str, "the name of a sensor in quotes"]] = field(default_factory=dict)
    mode: Annotated[int | None, "the number of a mode, from 1"] = None
    modes: Annotated[str | None, "the name of a file in quotes"] = None
    displacement: Mapping[int, float] = field(default_factory=dict)
    velocity: Mapping[int, float] = field(default_factory=dict)
    start_s: float | None = None
    stop_s: float | None = None

    @property
    def label(self) -> str:
        return self.name or Path(self.log).stem

    @property
    def is_forced(self) -> bool:
        return self.force is not None or bool(self.forces)

    def place_forces(self, drive_point: str | None) -> dict[str, str | None]:
        """Return the sensor at which each force acts, by its channel; of a single one, it may be that of the study."""
        return {self.force: self.drive_point or drive_point} if self.force is not None else dict(self.forces)


_Column = Annotated[str | int | _Channel | None, "the name of a column, its number or a table"]


@dataclass(frozen=True, kw_only=True)
class _Curve:
    file: str
    sensor: Annotated[str, "the name of a sensor in quotes"]
    force_n: float | None = None
    name: str = ""
    mode: Annotated[int | None, "the number of a mode, from 1"] = None
    error_fraction: float = 0.01
    frequency: _Column = None
    amplitude: _Column = None
    phase: _Column = None
    force: _Column = None

    @property
    def label(self) -> str:
        return self.name or Path(self.file).stem


@dataclass(frozen=True, kw_only=True)
class _Study(_Settings):
    title: str | None = None
    modes: Annotated[_Modes, MODAL_TESTS.needs["modes"]]
    log: LogSettings = AS_WRITTEN
    channels: Mapping[str, Annotated[str | int | _Channel, CHANNEL]] = field(default_factory=dict)
    tests: Annotated[tuple[_Test, ...], MODAL_TESTS.needs["tests"]] = ()
    curves: tuple[_Curve, ...] = ()

    def split_settings(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the settings that are stated in [modes], and those that are stated beside it."""
        names = {each.name for each in fields(_Settings)}
        inside, beside = (
            {name: value for name, value in select_stated(table).items() if name in names}
            for table in (self.modes, self)
        )
        return inside, beside


@dataclass(frozen=True, kw_only=True, eq=False)
class Decays:
    """Logs of free decays as tests of a study, with what the study says of their calibration.

    Args:
        tests: one of each log.
        gain_tolerance: standard deviation of the calibration.
    """

    tests: tuple[ModalTest, ...]
    gain_tolerance: float


def build_study(document: Document, source: Path, say: Say) -> ModalStudy:
    """Read what a study file of modal tests names, and return the study."""
    study, faults = read_tables(_Study, document)
    if not {"tests", "curves"} & {*document, *find_misspelt(document, ("tests", "curves"))}:
        faults.append(f"the study lacks 'tests', give {MODAL_TESTS.needs['tests']}")
    refuse(faults, source)
    inside, beside = study.split_settings()
    faults += [f"{name!r} stands in [modes] and beside it: give it once" for name in inside if name in beside]
    modes: dict[str | None, LinearModes] = {}
    for name in dict.fromkeys([study.modes.file, *(each.modes for each in study.tests if each.modes is not None)]):
        with collect_faults(faults):
            modes[name] = read_modes(source.parent / name)
    settings: dict[str, Any] = {"nonlinear": (), "drive_point": None} | beside | inside
    linear = modes.get(study.modes.file)
    if linear is not None:
        faults += _check_drive_points(study, settings["drive_point"], linear)
        # Without this check a sensor whose name is misspelt would be left out silently.
        known = [*linear.sensors, *dict.fromkeys(name for each in study.tests for name in each.place_forces(None))]
        faults += [
            f"[channels] has {name!r}, which is no sensor of the shapes and no force of a test ({nearest(name, known)})"
            for name in study.channels
            if name not in known
        ]
    refuse(faults, source)
    assert linear is not None  # Otherwise the study has been refused.
    channels = _read_channels(study)
    tests = []
    for each in study.tests:
        say(each.log)
        with collect_faults(faults, f"test {each.label!r}: "):
            file = each.modes or study.modes.file
            test = _read_test(each, source.parent, modes[file], settings["drive_point"], study.log, channels)
            test = replace(test, recording=add_files(test.recording, source, source.parent / file))
            tests.append(recast(StudyTest, each, test=test, use=each.use or ("fit" if each.is_forced else "decay")))
    curves = []
    for entry in study.curves:
        say(entry.file)
        with collect_faults(faults, f"curve {entry.label!r}: "):
            curve = _read_curve(entry, source.parent)
            own = tuple(map(read_file, (source, source.parent / study.modes.file)))
            curves.append(replace(curve, files=(*own, *curve.files)))
    refuse(faults, source)
    title = source.stem if study.title is None else study.title
    return ModalStudy(title, linear, tests=tuple(tests), curves=tuple(curves), source=source, **settings)


def read_decays(path: Path, logs: Sequence[Path], say: Say) -> Decays:
    """Read logs of free decays with the modes, sensors, channels and `gain_tolerance` of a study file of modal tests.

    Args:
        path: the study file; the logs of its own tests are not read.
        logs: the logs.
        say: called with the name of each log as it is read.

    Raises:
        InputError: what is wrong with the tables or the modes of the study, or with a log; all logs at once.
    """
    document = load(path)
    found = kind_of(document, path)
    if found is not MODAL_TESTS:
        raise FileError(f"{path} is a study of {found.subject}: give one of modal tests, which has a table [modes]")
    study, faults = read_tables(_Study, document)
    refuse(faults, path)
    inside, beside = study.split_settings()
    if "gain_tolerance" in inside and "gain_tolerance" in beside:
        raise FileError(f"{path}: 'gain_tolerance' stands in [modes] and beside it: give it once")
    stated: dict[str, Any] = {"gain_tolerance": study.gain_tolerance} | beside | inside
    with name_source(path):
        modes = read_modes(path.parent / study.modes.file)
    channels = _read_channels(study)
    tests = []
    for log in logs:
        say(log.name)
        with collect_faults(faults, f"{log}: "):
            entry = _Test(log=str(log.absolute()), name=log.name, use="decay")
            test = _read_test(entry, path.parent, modes, None, study.log, channels)
            files = add_files(test.recording, path, path.parent / study.modes.file)
            tests.append(replace(test, recording=files))
    refuse(faults, path)
    return Decays(tests=tuple(tests), gain_tolerance=float(stated["gain_tolerance"]))


def write_files(study: ModalStudy, directory: Path) -> str:
    """Write the modes and the log of each test, and return the text of the study file."""
    for each in study.tests:
        require_plain("test", each.test.name)
    for curve in study.curves:
        require_plain("curve", curve.name)
    values = sum(each.test.recording.samples.size for each in study.tests)
    ending = ".h5" if values > LARGEST_CSV and find_spec("h5py") is not None else ".csv"
    write_modes(study.modes, directory / "modes.npz")
    written = {"modes.npz": study.modes}
    entries = []
    for each in study.tests:
        test = each.test
        file = next((file for file, modes in written.items() if _is_same(modes, test.modes)), None)
        if file is None:
            file = f"modes_{test.name}.npz"
            written[file] = test.modes
            write_modes(test.modes, directory / file)
        log = f"{test.name}{ending}"
        write_log(test.readings, directory / log)
        own = None if file == "modes.npz" else file
        points = _list_forces(test)
        force = next(iter(points)) if len(points) == 1 else None
        point = points[force] if force is not None and points[force] != study.drive_point else None
        forces = points if len(points) > 1 else {}
        entries.append(recast(_Test, each, log=log, force=force, drive_point=point, forces=forces, modes=own))
    curves = []
    for curve in study.curves:
        write_curve(curve, directory / f"{curve.name}.csv")
        entry = _Curve(
            file=f"{curve.name}.csv", sensor=curve.sensor, mode=curve.mode, error_fraction=curve.error_fraction
        )
        curves.append(entry)
    named = recast(_Modes, study, file="modes.npz")
    return format_toml(_Study(title=study.title, modes=named, tests=tuple(entries), curves=tuple(curves)))


def _is_same(one: LinearModes, other: LinearModes) -> bool:
    """Return whether one file can hold both; the units of their sensors are in the logs."""
    names = ("frequency_hz", "damping_ratio", "shapes", "sensors")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


# ---- tables -> tests -------------------------------------------------------------------------------


def _read_channels(study: _Study) -> dict[str, ChannelSettings]:
    return {
        name: recast(ChannelSettings, tabulate_channel(_Channel, name, entry)) for name, entry in study.channels.items()
    }


def _check_drive_points(study: _Study, drive_point: str | None, modes: LinearModes) -> list[str]:
    faults: list[str] = []
    if drive_point is not None:
        with collect_faults(faults, "'drive_point': "):
            modes.row(drive_point)
    without = [each.label for each in study.tests if None in each.place_forces(drive_point).values()]
    without += [each.label for each in study.curves if drive_point is None]
    if without:
        faults.append(f"[modes] lacks 'drive_point', name the sensor at which the force of {without[0]!r} acts")
    for each in study.tests:
        if each.force is not None and each.forces:
            faults.append(
                f"test {each.label!r} has 'force' and 'forces', give one: forces names the sensor of each channel"
            )
        elif each.drive_point is not None and each.force is None:
            faults.append(
                f"test {each.label!r} has 'drive_point' and no 'force', name the channel of the force (in 'forces' "
                "each channel has its sensor)"
            )
        for point in [*each.forces.values(), *([each.drive_point] if each.drive_point is not None else [])]:
            with collect_faults(faults, f"test {each.label!r}: "):
                modes.row(point)
    return faults


def _read_test(
    entry: _Test,
    directory: Path,
    modes: LinearModes,
    drive_point: str | None,
    how: LogSettings,
    channels: Mapping[str, ChannelSettings],
) -> ModalTest:
    log = open_log(directory / entry.log, how)
    points = {channel: point for channel, point in entry.place_forces(drive_point).items() if point is not None}
    if not points and entry.use is None and (seen := _find_channel(log, "N")):
        raise InputError(
            f'its log has a force, {seen!r}, and the test names none: give force = "{seen}", or use = "decay" '
            "if nothing acts in the stretch that is used"
        )
    wanted = _choose_channels(log, modes, list(points), channels)
    if entry.use == "resonance" and (voltage := _find_channel(log, "V")):
        wanted[voltage] = ChannelSettings(voltage)
    read = partial(recording_of, log, how, start_s=entry.start_s, stop_s=entry.stop_s)
    recording = _add_forces(log, wanted, channels, read) if entry.use == "decay" else read(channels=wanted)
    _require_alive(recording, modes)
    return modal_test(recording, modes, name=entry.label, force=points)


def _read_curve(entry: _Curve, directory: Path) -> ResponseCurve:
    named = {
        each.name: recast(ChannelSettings, tabulate_channel(_Channel, each.name, column))
        for each in fields(CurveColumns)
        if (column := getattr(entry, each.name)) is not None
    }
    return read_curve(
        directory / entry.file,
        sensor=entry.sensor,
        mode=entry.mode,
        force_n=entry.force_n,
        columns=CurveColumns(**named),
        error_fraction=entry.error_fraction,
        name=entry.label,
    )


def _choose_channels(
    log: Log, modes: LinearModes, forces: list[str], channels: Mapping[str, ChannelSettings]
) -> dict[str, ChannelSettings]:
    """Return the channels of a test: the forces, and the sensors of the shapes that the log has."""
    names = [name for name in modes.sensors if name in channels or name in log.names]
    if not names:
        raise FileError(
            f"{log.path} has none of the sensors of the shapes ({', '.join(map(repr, modes.sensors[:4]))}, ...), but "
            f"{', '.join(map(repr, log.names[:4]))}: say in [channels] which is which"
        )
    names += forces
    wanted = {name: channels.get(name, ChannelSettings(name)) for name in names}
    require_distinct(log, wanted)
    return wanted


def _add_forces(
    log: Log,
    wanted: Mapping[str, ChannelSettings],
    channels: Mapping[str, ChannelSettings],
    read: Callable[..., Recording],
) -> Recording:
    """Return the recording of a decay with the forces on the clock of its sensors, after whose end it begins."""
    track, _ = log.find(next(iter(wanted.values())).channel)
    forces = {each.name: ChannelSettings(each.name) for each in track.channels if each.is_in("N")}
    forces |= {name: each for name, each in channels.items() if LoggedChannel(name, each.unit).is_in("N")}
    try:
        return read(channels={**forces, **wanted})
    except InputError:
        return read(channels=wanted)  # A force with gaps tells nothing of the decay, and the motion may be complete.


def _find_channel(log: Log, unit: str) -> str:
    """Return the name of a channel in a unit of the kind of `unit`, of SI; "" if there is none."""
    return next((each.name for track in log.tracks for each in track.channels if each.is_in(unit)), "")


def _require_alive(recording: Recording, modes: LinearModes) -> None:
    """Refuse a mute sensor, which the modal filter would turn into motion of every mode."""
    for name in recording.names:
        samples = recording.channel(name)
        if name in modes.sensors and samples.min() == samples.max():
            raise InputError(
                f"sensor {name!r} is mute, all samples lie at {samples[0]:.4g} {recording.unit(name)}: leave its row "
                "out of the shapes"
            )


def _list_forces(test: ModalTest) -> dict[str, str]:
    """Return the sensor at which each force of a test acts, by the channel that holds it."""
    for each in test.forces:
        if each.channel not in test.recording.names:
            raise InputError(
                f"test {test.name!r} has a force {each.channel!r} that is no channel of its recording: add it as a "
                "channel in N"
            )
    return {each.channel: each.drive_point for each in test.forces}
