"""Study files of every kind -> the records of the wings, and back."""

from __future__ import annotations

import logging
import os
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

from opid.errors import InputError
from opid.signals.files import write_whole
from opid.studies.kinds import KINDS, MODAL_TESTS, SUSPENSIONS, TEST_BENCH, StudyKind, kind_of
from opid.studies.schema import Say, load

if TYPE_CHECKING:
    from opid.modal.study import ModalStudy
    from opid.suspensions.bench.study import BenchStudy
    from opid.suspensions.study import Study
    from opid.updating.study import UpdatingStudy

    AnyStudy = Study | BenchStudy | ModalStudy | UpdatingStudy

logger = logging.getLogger(__name__)

S = TypeVar("S", "Study", "BenchStudy", "ModalStudy", "UpdatingStudy")


@overload
def read_study(path: str | os.PathLike[str], *, progress: Say | None = None) -> AnyStudy: ...


@overload
def read_study(path: str | os.PathLike[str], *, kind: type[S], progress: Say | None = None) -> S: ...


def read_study(path: str | os.PathLike[str], *, kind: type[Any] | None = None, progress: Say | None = None) -> AnyStudy:
    """Read a study file of any kind, and the logs, modes, matrices or backbones that it names.

    The tables of the file tell what it is a study of.

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
    cross-validation where left out), `free_linear` (true or false; decided by the data where left out),
    `frequency_threshold` and `damping_threshold` (of the level tests, as fractions; 0.002 and 0.15 where left out); all
    but `file` may stand beside the tables as well. A test gives `log` (path beside the study file), `force` (its
    channel; left out of a free decay), `use` ("fit", "truth", "level" or "decay"; "fit" where left out, "decay" without
    a force), and optionally `name`, `mode` (the one it is for), `modes` (the file of the linear modes that hold during
    this test), `start_s` and `stop_s`. `[log]` says how logs are to be read, `[channels.NAME]` what their channels mean
    (the fields of `ChannelSettings`), where a channel is not called as its sensor.

    **Backbones** (`UpdatingStudy`): `title`, `form` (of the likelihood), a table `[structure]`, one table
    `[[backbones]]` for each curve and one `[[classes]]` for each candidate law. `[structure]` gives `matrices` (a file,
    or a table with one for each matrix, see `read_structure`), `sensors` (degrees of freedom), `[structure.joints]`
    (name = [one end, other end]), `dofs` (their names), `parameters` (factors of the linear structure to update; the
    structure is taken as it is where left out) and `[structure.priors]` (name = ["uniform", low, high]). A backbone
    gives `file` (see `read_backbone`), `mode` (from 1, rigid ones count), `controlled_sensor`, and optionally `name`
    and `unit`; `[log]` may give the `unit` of all. A class gives `law` (kinds of spring, joined by +), `scale` (one for
    all terms or one each, in SI units or with the unit in a text), and optionally `name` and `prior`. `[sampling]` may
    give `sampler`, `samples` and `seed`; `[noise]` the fields of `NoiseSettings`; `harmonics` stands beside the tables,
    `internal_modes` in `[structure]`.

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
    record, build, _ = _room(found)
    if kind is not None and kind is not record:
        command = f"opid {found.command} {shlex.quote(str(source))}"
        raise InputError(f"{source} is a study of {found.subject}: use `{command}`")
    return build(document, source, progress or (lambda step: None))


def write_study(study: AnyStudy, path: str | os.PathLike[str]) -> None:
    """Write a study so that `read_study` gives it back: its file, and what it is made of beside it.

    Of suspensions that is `NAME.csv` for each run, of a test bench bench.csv; of modal tests modes.npz and the log of
    each test, CSV, or HDF5 where the logs are large and h5py is installed; of backbones structure.npz and a CSV file
    for each.

    Args:
        study: what to write.
        path: the study file; its directory must exist.

    Raises:
        InputError: no study, a place that cannot be written to, a run, a test or a backbone whose name is no file name,
            or a structure that is given by its modes.
    """
    target = Path(path)
    for kind in KINDS:
        record, _, write = _room(kind)
        if isinstance(study, record):
            text = write(study, target.parent)
            with write_whole(target) as file:
                file.write(text)
            return
    raise InputError(
        f"study is of type {type(study).__name__}: give a Study, a BenchStudy, a ModalStudy or an UpdatingStudy"
    )


def _room(kind: StudyKind) -> tuple[type[AnyStudy], Callable[..., AnyStudy], Callable[..., str]]:
    """The record of a kind of study, what makes it of tables, and what writes its files and returns its text.

    No other kind is loaded.
    """
    if kind is SUSPENSIONS:
        from opid.studies.suspension_study import build_suspension_study, write_suspension_logs
        from opid.suspensions.study import Study

        return Study, build_suspension_study, write_suspension_logs
    if kind is TEST_BENCH:
        from opid.studies.bench_study import build_bench_study, write_bench_log
        from opid.suspensions.bench.study import BenchStudy

        return BenchStudy, build_bench_study, write_bench_log
    if kind is MODAL_TESTS:
        from opid.modal.study import ModalStudy
        from opid.studies.modal_study import build_modal_study, write_modal_logs

        return ModalStudy, build_modal_study, write_modal_logs
    from opid.studies.updating_study import build_updating_study, write_backbones
    from opid.updating.study import UpdatingStudy

    return UpdatingStudy, build_updating_study, write_backbones
