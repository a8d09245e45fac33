"""Study files: the kinds that there are, each known by its tables, and one reader and one writer for all of them."""

from __future__ import annotations

import logging
import os
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

from opid.errors import FileError, InputError
from opid.progress import Say
from opid.signals.files import PATIENCE_S, reserve_directory
from opid.studies.schema import Document, find_misspelt, load

if TYPE_CHECKING:
    from opid.modal.study import ModalStudy
    from opid.suspensions.bench.record import BenchStudy
    from opid.suspensions.study import Study
    from opid.updating.study import UpdatingStudy

    AnyStudy = Study | BenchStudy | ModalStudy | UpdatingStudy

logger = logging.getLogger(__name__)

S = TypeVar("S", "Study", "BenchStudy", "ModalStudy", "UpdatingStudy")


@dataclass(frozen=True)
class StudyKind:
    """A kind of study file.

    Args:
        record: its class in `opid`, by the full name, so that no wing is loaded to know the kind of a study.
        module: in `opid.studies`, with `build_study` and `write_files`.
        subject: what is studied.
        command: the command of `opid` that identifies from it.
        needs: the tables that it must have, each with a description.
        others: the tables that it may have.
    """

    record: str
    module: str
    subject: str
    command: str
    needs: Mapping[str, str]
    others: tuple[str, ...]

    @property
    def tables(self) -> tuple[str, ...]:
        """All tables that it may have."""
        return (*self.needs, *self.others)


SUSPENSIONS = StudyKind(
    "suspensions.study.Study",
    "suspension_study",
    "suspensions",
    "identify",
    {"channels": "a table [channels]", "runs": "one table [[runs]] for each log"},
    ("interfaces", "body_sensors", "structure", "sensors", "log"),
)
TEST_BENCH = StudyKind(
    "suspensions.bench.record.BenchStudy",
    "bench_study",
    "a test bench",
    "law",
    {"bench": "a table [bench]"},
    ("channels", "log"),
)
MODAL_TESTS = StudyKind(
    "modal.study.ModalStudy",
    "modal_study",
    "modal tests",
    "modal",
    {"modes": "a table [modes]", "tests": "one table [[tests]] for each log"},
    ("curves", "channels", "log"),
)
BACKBONES = StudyKind(
    "updating.study.UpdatingStudy",
    "updating_study",
    "backbones",
    "update",
    {
        "structure": "a table [structure]",
        "backbones": "one table [[backbones]] for each file",
        "classes": "one table [[classes]] for each candidate law",
    },
    ("sampling", "noise", "log"),
)
KINDS = (SUSPENSIONS, TEST_BENCH, MODAL_TESTS, BACKBONES)


@overload
def read_study(path: str | os.PathLike[str], *, progress: Say | None = None) -> AnyStudy: ...


@overload
def read_study(path: str | os.PathLike[str], *, kind: type[S], progress: Say | None = None) -> S: ...


def read_study(path: str | os.PathLike[str], *, kind: type[Any] | None = None, progress: Say | None = None) -> AnyStudy:
    """Read a study file of any kind, and the logs, modes, matrices or backbones that it names.

    The tables of the file show what it is a study of.

    **Suspensions** (`Study`): `title`, `date` (of the runs, without quotes: 2026-03-01) and one table `[[runs]]` for
    each log: `name`, `log` (path beside the study file), and optionally `start_s` and `stop_s` on the time axis of the
    log (where neither is given, the sound stretch of sustained motion is found), and `[runs.channels]` for what differs
    in this run. How logs are to be read goes into `[log]` (the fields of `LogSettings`; `log` in a channel's table for
    its own file). `{run}` in a channel's `file` stands for the run's name. `fs_hz` is the rate to identify at. `axis`,
    of one gear in the file itself and of several in `[[interfaces]]`, says where the channels count positive: "up",
    "down", or "horizontal" where no weight acts on the motion; `piston_area_m2`, likewise, what the gas of a strut
    pushes on.

    Of one gear: a table `[channels]` (`sprung`, `unsprung`, and further ones by any name: each the name of a channel in
    the logs, or a table with the fields of `ChannelSettings` and `SensorFacts`), and `mass_change_kg` in `[[runs]]`.
    A three-axis sensor has `axes` (three channels) in its table, and optionally `gyroscope` (three angular rates),
    `vertical` (the upward direction in these axes, found by gravity where left out) and `tilt_tolerance_deg`.
    What is known of the sensors may also stand in `[sensors.sprung]` and `[sensors.unsprung]`, a further recorded axis
    that leaks in in `[[sensors.leak]]` (`channel`, `into`, `tolerance`; without `into`, both sides).

    Of a body on several suspensions: one table `[[interfaces]]` for each: `name`, `sprung` and `unsprung` (the name of
    a channel in the logs, or of an entry in `[channels]`), `x_m` forward and `y_m` to the left, and `sensor_x_m`,
    `sensor_y_m` where the sensor on the body is not at the suspension; one table `[[body_sensors]]` for each further
    sensor on the body (`channel`, `x_m`, `y_m`); a table `[structure]` with the fields of `StructureSettings`; and in
    `[[runs]]` `loading`, what it carries more than the reference: rows [mass_kg, x_m, y_m], or the name of a CSV file
    with these columns. What is known of a sensor stands in the table `[channels.NAME]` of its channel; `into` of a leak
    is the name of a channel.

    **A test bench** (`BenchStudy`): `title` and a table `[bench]`: `log` (path beside the study file), `force` and
    `travel` (channels), and optionally `velocity` (a channel; differentiated where left out), `mass_kg` (of a body that
    the specimen alone holds: `force` is then its acceleration), `moving_mass` (true where parts of unknown mass move
    between force cell and specimen), `quasi_static` (true for a test so slow that time means nothing), `counted` (a
    channel that is 0 where the law does not hold), `start_s` and `stop_s`, `candidates` (kinds that the law may be made
    of) and `most_terms`. `[log]` says how logs are to be read, `[channels.NAME]` what a channel means, and its file.

    **Modal tests** (`ModalStudy`): `title`, a table `[modes]` and one table `[[tests]]` for each log. `[modes]` gives
    `file` (npz or CSV, see `read_modes`), `drive_point` (the sensor where the force acts), `nonlinear` (modes
    counted from 1; those that the level tests show where left out), `stiffness_order` and `damping_order` (chosen by
    cross-validation where left out), `free_linear` (true or false; decided by the data where left out), `memory` (the
    kind of joint of the nonlinear modes),
    `frequency_threshold` and `damping_threshold` (of the level tests, as fractions; 0.002 and 0.15 where left out); all
    but `file` may stand beside the tables as well. A test gives `log` (path beside the study file), `force` (its
    channel; left out of a free decay), `use` ("fit", "truth", "level", "decay" or "resonance"; "fit" where left out,
    "decay" without a force), and optionally `name`, `mode` (the one it is for), `modes` (the file of the linear modes
    that hold during this test), `drive_point` (of this test), `start_s` and `stop_s`. Several forces stand in `forces`
    (channel = sensor) instead of `force`; `displacement` and `velocity` (mode = value) are the initial condition of a
    truth test. `[log]` says how logs are to be read, `[channels.NAME]` what their channels mean (the fields of
    `ChannelSettings`), where a channel is not called as its sensor. A table `[[curves]]` for each stepped-sine response
    curve gives `file` (CSV, see `read_curve`), `sensor`, `force_n` (its amplitude; left out where the file has a column
    of it), and optionally `mode`, `name`, `error_fraction`, and `frequency`, `amplitude`, `phase` and `force`: the name
    of a column, or a table with `channel`, `unit` and `sign`. A study with curves needs no tests.

    **Backbones** (`UpdatingStudy`): `title`, `form` (of the likelihood), a table `[structure]`, one table
    `[[backbones]]` for each curve and one `[[classes]]` for each candidate law. `[structure]` gives `matrices` (a file,
    or a table with one for each matrix, see `read_structure`), `sensors` (degrees of freedom), `[structure.joints]`
    (name = [one end, other end], or the only end of a joint to the ground), `dofs` (their names), `parameters` (factors
    of the linear structure to update; the structure is taken as it is where left out) and `[structure.priors]` (name =
    ["uniform", low, high]); or instead of matrices `modes` (a file, see `read_modes`), or `frequency_hz` and
    `modal_mass_kg` of one mode that one of `sensors` sees. A backbone gives `file` (see `read_backbone`, and
    `read_result_backbones` for a result.json), `mode` (from 1, rigid ones count), `controlled_sensor`, and optionally
    `name` and `unit`; `[log]` may give the `unit` of all. A class gives `law` (kinds of spring, joined by +), `scale`
    (one for all terms or one each, in SI units or with the unit in a text), and optionally `name` and `prior`.
    `[sampling]` may give `sampler`, `samples` and `seed`; `[noise]` the fields of `NoiseSettings`; `harmonics` stands
    beside the tables, `internal_modes` in `[structure]`.

    Args:
        path: a TOML file.
        kind: the record that is wanted; any where left out.
        progress: called with the name of each file as it is read.

    Raises:
        InputError: the file is missing, no TOML, no study or none of this kind; an unknown, missing or mistyped key; or
            a file that the study names is at fault: all at once.
    """
    source = Path(path)
    document = load(source)
    found = kind_of(document, source)
    logger.info("read %s: a study of %s", source, found.subject)
    if kind is not None and f"{kind.__module__}.{kind.__qualname__}" != f"opid.{found.record}":
        command = f"opid {found.command} {shlex.quote(str(source))}"
        raise FileError(f"{source} is a study of {found.subject}: use `{command}`")
    return _load_module(found).build_study(document, source, progress or (lambda step: None))


def write_study(study: AnyStudy, path: str | os.PathLike[str]) -> None:
    """Write a study file, and beside it the files that it names, so that `read_study` gives the study back.

    All of them appear together.

    Of suspensions that is `NAME.csv` for each run, of a test bench bench.csv; of modal tests modes.npz, the log of each
    test, CSV, or HDF5 where the logs are large and h5py is installed, and a CSV file for each curve; of backbones
    structure.npz and a CSV file for each.

    Args:
        study: what to write.
        path: the study file; its directory must exist.

    Raises:
        InputError: no study, a place that cannot be written to, a run, a test or a backbone whose name is no file name,
            or a structure that is given by its modes.
    """
    target = Path(path)
    names = [f"{each.__module__}.{each.__qualname__}" for each in type(study).__mro__]
    kind = next((each for each in KINDS if f"opid.{each.record}" in names), None)
    if kind is None:
        raise InputError(
            f"study is of type {type(study).__name__}: give a Study, a BenchStudy, a ModalStudy or an UpdatingStudy"
        )
    if not target.parent.is_dir():
        raise FileError(f"cannot write {path}: there is no directory {target.parent}: create it first")
    with (
        reserve_directory(target.parent, wait_s=PATIENCE_S) as reserved,
        reserved.replace_files(last=target.name) as folder,
    ):
        text = _load_module(kind).write_files(study, folder)
        (folder / target.name).write_text(text, encoding="utf-8", newline="\n")


def _load_module(kind: StudyKind) -> Any:
    return import_module(f"opid.studies.{kind.module}")


# ---- which kind a file is ---------------------------------------------------------------------------


def kind_of(document: Document, source: Path) -> StudyKind:
    """Return the kind of a study file: that of which it has most tables that no other kind has.

    Args:
        document: its content.
        source: its path, for the message.

    Raises:
        InputError: it has no table of a study, or as many of one kind as of another.

    >>> kind_of({"tests": [], "modes": {}}, Path("study.toml")).command
    'modal'
    """
    ranks = [_count_tables(document, kind) for kind in KINDS]
    best = max(ranks)
    if best > (0, 0) and ranks.count(best) == 1:
        return KINDS[ranks.index(best)]
    named = [repr(name) for name in document][:8] + ["..."] * (len(document) > 8)
    raise FileError(
        f"{source} is no study: it has {', '.join(named) or 'no keys'}; {'; '.join(_say_what_lacks(document))}"
    )


def _find_tables(document: Document, kind: StudyKind) -> set[str]:
    """Return the tables of a kind that a file has; a misspelt name counts, too, unless another kind has it."""
    known = {name for each in KINDS for name in each.tables}
    unknown = {name: value for name, value in document.items() if name not in known}
    return {*kind.tables} & {*document, *find_misspelt(unknown, kind.tables)}


def _count_tables(document: Document, kind: StudyKind) -> tuple[int, int]:
    """Return the numbers of tables in a file that only this kind has, and that this kind needs."""
    there = _find_tables(document, kind)
    of_others = {name for other in KINDS if other is not kind for name in other.tables}
    return len(there - of_others), len(there & {*kind.needs})


def _say_what_lacks(document: Document) -> Iterator[str]:
    for kind in KINDS:
        there = _find_tables(document, kind)
        lacking = [f"lacks {name!r}, give {what}" for name, what in kind.needs.items() if name not in there]
        yield f"as a study of {kind.subject} it {', and '.join(lacking) or 'lacks nothing'}"
