"""Study files of modal tests and their logs -> `ModalStudy`, and back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from opid.errors import InputError, nearest, refuse
from opid.modal.linear.coordinates import ModalTest, modal_test
from opid.modal.linear.modes import LinearModes
from opid.modal.linear.modes_file import read_modes, write_modes
from opid.modal.study import THRESHOLDS, USES, ModalStudy, StudyTest
from opid.signals.conversion import recording_of, require_distinct
from opid.signals.log import Log
from opid.signals.log_settings import ChannelSettings, LogSettings
from opid.signals.logs import open_log, write_log
from opid.signals.recording import Recording
from opid.signals.units import to_si
from opid.studies.kinds import MODAL_TESTS
from opid.studies.tables import (
    CHANNEL,
    LOG,
    MAYBE_NUMBER,
    MAYBE_TEXT,
    TEXT,
    Document,
    Key,
    Say,
    channel_settings,
    dict_at,
    keys_of,
    list_at,
    log_settings,
    maybe,
    noted,
    one_of,
    prefixed,
    require_plain,
    stated,
    table_faults,
    toml_of,
)

LARGEST_CSV = 3_000_000
"""Values in all logs of a study beyond which they are written as HDF5, where that can be: some 60 MB of text."""

_MODEL = keys_of(
    ModalStudy,
    without=["title", "modes", "tests", "source"],
    drive_point=maybe(str, "the name of a sensor in quotes"),
    nonlinear=maybe(list, "a list of modes counted from 1, like [7, 11]"),
    **dict.fromkeys(THRESHOLDS, maybe((int, float), "a share, 0.01 for 1 %")),
)
"""What may stand in [modes] or beside it."""
# the channels of a test come from one recorder
_CHANNEL = {name: key for name, key in CHANNEL.items() if name not in ("file", "log", "shift_s")}
_TEST = {
    "log": TEXT,
    "name": MAYBE_TEXT,
    "force": maybe(str, "the name of a channel in quotes"),
    "use": maybe(str, one_of(USES)),
    "mode": maybe(int, "the number of a mode, from 1"),
    "modes": maybe(str, "the name of a file in quotes"),
    "start_s": MAYBE_NUMBER,
    "stop_s": MAYBE_NUMBER,
}
_STUDY = {
    "title": MAYBE_TEXT,
    "modes": Key(dict, MODAL_TESTS.needs["modes"], keys={"file": TEXT, **_MODEL}),
    "log": maybe(dict, "a table [log]", keys=LOG),
    "channels": maybe(dict, "a table [channels]", entries=_CHANNEL),
    "tests": Key(list, MODAL_TESTS.needs["tests"], keys=_TEST),
    **_MODEL,
}


def build_modal_study(document: Document, source: Path, say: Say) -> ModalStudy:
    """Read what a study file of modal tests names, and return the study."""
    refuse(list(_document_faults(document)), source)
    settings = {name: document["modes"].get(name, document.get(name)) for name in _MODEL}
    modes, faults = _all_modes(document, source.parent)
    linear = modes.get(document["modes"]["file"])
    if linear is not None:
        faults += _drive_point_faults(document, settings["drive_point"], linear)
        faults += _channel_faults(document, linear)
    refuse(faults, source)
    assert linear is not None  # or it would have been refused
    with prefixed(f"{source}: "):
        how = log_settings(document.get("log", {}))
        channels = {name: channel_settings(name, entry) for name, entry in document.get("channels", {}).items()}
    tests = []
    for entry in document["tests"]:
        say(entry["log"])
        own, use = modes[entry.get("modes", document["modes"]["file"])], "fit" if "force" in entry else "decay"
        with noted(faults, f"test {_name(entry)!r}: "):
            test = _test(entry, source.parent, own, settings["drive_point"], how, channels)
            tests.append(StudyTest(test, entry.get("use", use), entry.get("mode")))
    refuse(faults, source)
    nonlinear = tuple(settings.pop("nonlinear") or ())
    settings = {name: value for name, value in settings.items() if value is not None}
    return ModalStudy(document.get("title", source.stem), linear, nonlinear, tuple(tests), source=source, **settings)


def write_modal_logs(study: ModalStudy, directory: Path) -> str:
    """Write the modes and the log of each test, and return the text of the study file."""
    for each in study.tests:
        require_plain("test", each.test.name)
    values = sum(each.test.recording.samples.size for each in study.tests)
    ending = ".h5" if values > LARGEST_CSV and find_spec("h5py") is not None else ".csv"
    write_modes(study.modes, directory / "modes.npz")
    files = {id(study.modes): "modes.npz"}
    entries = []
    for each in study.tests:
        test = each.test
        if id(test.modes) not in files:
            files[id(test.modes)] = f"modes_{test.name}.npz"
            write_modes(test.modes, directory / files[id(test.modes)])
        log = f"{test.name}{ending}"
        write_log(test.recording, directory / log)
        entries.append(_entry(each, log, files[id(test.modes)]))
    return _toml(study, entries)


# ---- tables -> tests -------------------------------------------------------------------------------


def _document_faults(document: Document) -> Iterator[str]:
    yield from table_faults("the study", document, _STUDY)
    modes = dict_at(document, "modes")
    for name in _MODEL:
        if name in modes and name in document:
            yield f"{name!r} stands in [modes] and beside it, give it once"
    for mode in (*list_at(document, "nonlinear"), *list_at(modes, "nonlinear")):
        if not _TEST["mode"].takes(mode):
            yield f"'nonlinear' holds {mode!r}, give numbers of modes counted from 1"
    for number, entry in enumerate(list_at(document, "tests"), start=1):
        if isinstance(entry, dict) and isinstance(entry.get("use"), str) and entry["use"] not in USES:
            yield f"'use' in [[tests]] number {number} is {entry['use']!r}, give {_TEST['use'].what}"


def _all_modes(document: Document, directory: Path) -> tuple[dict[str, LinearModes], list[str]]:
    """The linear modes by the name of their file, each read once, and what is wrong with them."""
    modes: dict[str, LinearModes] = {}
    faults: list[str] = []
    for name in dict.fromkeys([document["modes"]["file"], *(e["modes"] for e in document["tests"] if "modes" in e)]):
        with noted(faults):
            modes[name] = read_modes(directory / name)
    return modes, faults


def _drive_point_faults(document: Document, drive_point: str | None, modes: LinearModes) -> list[str]:
    forced = [_name(entry) for entry in document["tests"] if "force" in entry]
    if drive_point is None:
        return [f"[modes] lacks 'drive_point', name the sensor at which the force of {forced[0]!r} acts"] * bool(forced)
    faults: list[str] = []
    with noted(faults, "'drive_point': "):
        modes.row(drive_point)
    return faults


def _channel_faults(document: Document, modes: LinearModes) -> list[str]:
    """A slip in the name of a sensor would leave the sensor out without a word."""
    forces = [entry["force"] for entry in document["tests"] if "force" in entry]
    known = [*modes.sensors, *dict.fromkeys(forces)]
    return [
        f"[channels] has {name!r}, which is no sensor of the shapes and no force of a test ({nearest(name, known)})"
        for name in document.get("channels", {})
        if name not in known
    ]


def _test(
    entry: Mapping[str, Any],
    directory: Path,
    modes: LinearModes,
    drive_point: str | None,
    how: LogSettings,
    channels: Mapping[str, ChannelSettings],
) -> ModalTest:
    log = open_log(directory / entry["log"], how)
    force = entry.get("force")
    if force is None and "use" not in entry and (seen := _force_seen(log)):
        raise InputError(
            f'its log has a force, {seen!r}, and the test names none: give force = "{seen}", or use = "decay" '
            "if nothing acts in the stretch that is used"
        )
    wanted = _wanted(log, modes, force, channels)
    recording = recording_of(log, how, channels=wanted, start_s=entry.get("start_s"), stop_s=entry.get("stop_s"))
    _require_alive(recording, modes)
    return modal_test(recording, modes, name=_name(entry), force=force, drive_point=drive_point)


def _wanted(
    log: Log, modes: LinearModes, force: str | None, channels: Mapping[str, ChannelSettings]
) -> dict[str, ChannelSettings]:
    """The channels of a test: the sensors of the shapes that the log has, and the force."""
    names = [name for name in modes.sensors if name in channels or name in log.names]
    if not names:
        raise InputError(
            f"{log.path} has none of the sensors of the shapes ({', '.join(map(repr, modes.sensors[:4]))}, ...), but "
            f"{', '.join(map(repr, log.names[:4]))}: say in [channels] which is which"
        )
    names += [force] if force is not None else []
    wanted = {name: channels.get(name, ChannelSettings(name)) for name in names}
    require_distinct(log, wanted)
    return wanted


def _force_seen(log: Log) -> str:
    """Name of a channel that is stated in a unit of force, "" if there is none."""
    for track in log.tracks:
        for channel in track.channels:
            try:
                if channel.unit and to_si(channel.unit)[1] == "N":
                    return channel.name
            except InputError:
                continue  # a unit nobody knows is told when the channel is used
    return ""


def _require_alive(recording: Recording, modes: LinearModes) -> None:
    """Refuse a dead sensor, of which the modal filter would make motion of every mode."""
    for name in recording.names:
        samples = recording.channel(name)
        if name in modes.sensors and samples.min() == samples.max():
            raise InputError(
                f"sensor {name!r} is mute, all samples lie at {samples[0]:.4g} m/s^2: leave its row out of the shapes"
            )


def _name(entry: Mapping[str, Any]) -> str:
    return entry.get("name", Path(entry["log"]).stem)


# ---- tests -> tables -------------------------------------------------------------------------------


def _entry(each: StudyTest, log: str, modes: str) -> dict[str, Any]:
    """The table of a test, without what goes without saying."""
    entry: dict[str, Any] = {"log": log, "use": each.use}
    if each.test.force is not None:
        entry["force"] = _force_channel(each.test)
    if each.mode is not None:
        entry["mode"] = each.mode
    if modes != "modes.npz":
        entry["modes"] = modes
    return entry


def _force_channel(test: ModalTest) -> str:
    """The channel of a test that holds its force."""
    recording = test.recording
    for channel in recording.channels:
        if channel.unit == "N" and (recording.channel(channel.name) == test.force).all():
            return channel.name
    raise InputError(f"test {test.name!r} has a force that is no channel of its recording: add it as a channel in N")


def _toml(study: ModalStudy, entries: list[dict[str, Any]]) -> str:
    modes = {"file": "modes.npz"} | ({"nonlinear": list(study.nonlinear)} if study.nonlinear else {})
    modes |= stated(study, without=["title", "modes", "nonlinear", "tests", "source"])
    return toml_of({"title": study.title, "modes": modes}, tests=entries)
