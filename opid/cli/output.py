"""What a command prints, the folder that it writes into, and its progress on stderr."""

from __future__ import annotations

import logging
import os
import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import VERBOSE, NotDetermined
from opid.errors import FileError, InputError, escape_invisible, list_names
from opid.progress import Say, Step

if TYPE_CHECKING:
    from opid.mechanics.truth import Truth
    from opid.result import Result
    from opid.signals.files import ReservedDirectory


def result_name(path: Path) -> str:
    """Return the name of a result: that of its study file, or that of its directory if the file is study.toml."""
    return path.stem if path.name != "study.toml" else Path(os.path.realpath(path)).parent.name or path.stem


REPORT = ("result.json", "report.html")
"""Files that every report has, so that an older report is recognised by them."""


_PRINT_OPTIONS = (
    click.option("--verbose", is_flag=True, help="Print every step of the work on stderr, and what opid logs."),
    click.option("--quiet", is_flag=True, help="Print no progress and no text; files and status remain."),
    click.option("--json", "as_json", is_flag=True, help="Print the result as JSON."),
    click.option("--force", "overwrite", is_flag=True, help="Overwrite what an earlier run has left in the folder."),
)
"""The options of every command that writes files."""

_FIGURE_OPTIONS = (
    click.option("--png", is_flag=True, help="Write each figure as a PNG file, too."),
    click.option("--no-figures", "figures", flag_value=False, default=True, help="Write the report without figures."),
)
"""Those of a command that writes a report."""


def reserve_free(path: Path, names: tuple[str, ...], *, overwrite: bool) -> ReservedDirectory:
    """Reserve a directory for these files until the command ends, and refuse if one of them exists already.

    Raises:
        InputError: the directory cannot be made or written to, another process writes into it, or a file exists and
            may not be overwritten; or the directory is one of those that opid keeps for what is not complete.
    """
    from opid.signals.files import reserve_directory

    if any(part.startswith(".") and part.endswith(".part") for part in Path(os.path.realpath(path)).parts):
        raise FileError(
            f"cannot write into {path}: opid keeps results that are not complete under hidden names that end in .part: "
            "choose another name"
        )
    reserved = click.get_current_context().with_resource(reserve_directory(path))
    for name in filter(lambda name: (reserved / name).is_dir(), names):
        raise FileError(f"{path} has a directory called {name}: choose another folder")
    there = [name for name in names if (reserved / name).exists()]
    if there and not overwrite:
        raise FileError(f"{path} has {', '.join(there)} already: choose another folder, or overwrite with --force")
    return reserved


@dataclass(frozen=True)
class Output:
    """What a command prints, where it writes its files, and whether it may overwrite older ones.

    Args:
        out: the folder for the files, or None.
        overwrite: whether files of an earlier run are replaced.
        as_json: whether the result is printed as JSON in the place of the text.
        quiet: whether neither text nor progress is printed.
        verbose: whether every step is printed.
        figures: whether the report has figures.
        png: whether each figure is written as a PNG file, too.
        reserved: the folder as it is reserved for this command, or None before that.
    """

    out: Path | None
    overwrite: bool
    as_json: bool
    quiet: bool
    verbose: bool
    figures: bool
    png: bool
    reserved: ReservedDirectory | None = None

    def reserve(self, names: tuple[str, ...] = REPORT, *, default: str = "") -> Output:
        """Return the output with a folder for these files, as `reserve_free`; without one where none is named."""
        if self.out is None and not default:
            return self
        path = self.out or Path(default)
        return replace(self, out=path, reserved=reserve_free(path, names, overwrite=self.overwrite))

    def together(self, older: Iterable[str] = ()) -> AbstractContextManager[Path | None]:
        """Give the folder to write into, whose files stand in `out` when the block has ended; None without one.

        Args:
            older: patterns of the names of files that an earlier run may have left beside its report, and which go.
        """
        if self.reserved is None:
            return nullcontext()
        is_older = (self.reserved / REPORT[0]).exists()
        stale = [each.name for pattern in older for each in self.reserved.path.glob(pattern)] if is_older else ()
        return self.reserved.replace_files(stale=stale)

    @property
    def folder(self) -> Path:
        """The folder for the files of a command that always has one."""
        assert self.out is not None
        return self.out

    @property
    def place(self) -> ReservedDirectory:
        """That folder as it is reserved."""
        assert self.reserved is not None
        return self.reserved

    @property
    def has_text(self) -> bool:
        """Whether a text is printed."""
        return not self.as_json and not self.quiet

    def progress(self) -> AbstractContextManager[Say]:
        """Show the step that is under way, every step with --verbose, none with --quiet."""
        return steps() if self.verbose else progress(quiet=self.quiet)

    @staticmethod
    @contextmanager
    def name_files(*paths: Path) -> Iterator[None]:
        """Put the files that a command reads before the reason why they cannot be used, unless it names its file."""
        try:
            yield
        except FileError:
            raise
        except InputError as error:
            raise InputError(f"{list_names(paths)}: {error}") from error

    def write(
        self,
        result: Result,
        truth: Truth | None = None,
        *,
        command: Sequence[str] | None = None,
        progress: Say,
    ) -> tuple[str, ...]:
        """Write the report into the folder, and return a note that names its page; nothing where there is no folder."""
        from opid.report import write_report

        if self.out is None:
            return ()
        page = write_report(
            result,
            self.reserved or self.out,
            truth,
            command=command,
            figures=self.figures,
            png=self.png,
            progress=progress,
        )
        return (f"Report: {page} (open it in a browser)",)

    def show(self, result: Result, truth: Truth | None = None, *, notes: Sequence[str] = ()) -> None:
        """Print the result as JSON, or as text with the notes below it.

        Raises:
            NotDetermined: something is not determined; it has the reason if no text has given it.
        """
        from opid.json_values import json_text
        from opid.provenance import traced
        from opid.report import text

        if self.as_json:
            click.echo(escape_invisible(json_text(traced(result.to_dict(), result.files))), nl=False)
        elif self.has_text:
            click.echo(text(result, truth))
            for note in notes:
                click.echo(escape_invisible(note))
        reason = getattr(result, "not_determined", None)
        if reason:
            raise NotDetermined(
                "not determined, for the reason above" if self.has_text else f"not determined: {reason}"
            )

    def show_made(self, words: str, command: str, study: Path) -> None:
        """Print what was simulated, and the command line that identifies it and compares the result with the truth."""
        from opid.json_values import json_text

        truth = study.with_name("truth.json")
        again = shlex.join(["opid", command, str(study), "--truth", str(truth)])
        if self.as_json:
            made = {"made": words.splitlines(), "study": str(study), "truth": str(truth), "next": again}
            click.echo(escape_invisible(json_text(made)), nl=False)
        elif self.has_text:
            click.echo(escape_invisible(f"{words}\nNext: {again}"))


def with_output(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command that writes a report the options of an `Output`, which becomes its argument `output`."""
    return _add_output(command, (*_FIGURE_OPTIONS, *_PRINT_OPTIONS))


def with_files(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command that writes files but no report the options of an `Output`, as `with_output`."""
    return _add_output(command, _PRINT_OPTIONS)


def _add_output(command: Callable[..., None], options: Sequence[Callable[..., Any]]) -> Callable[..., None]:
    @wraps(command)
    def run(
        *,
        out: Path | None,
        overwrite: bool,
        as_json: bool,
        quiet: bool,
        verbose: bool,
        figures: bool = False,
        png: bool = False,
        **given: Any,
    ) -> None:
        if quiet and verbose:
            raise click.UsageError("--quiet and --verbose are both given: give one of them")
        if png and not figures:
            raise click.UsageError("--png and --no-figures are both given: give one of them")
        click.get_current_context().meta[VERBOSE] = verbose
        command(output=Output(out, overwrite, as_json, quiet, verbose, figures, png), **given)

    decorated: Callable[..., None] = run
    for each in options:
        decorated = each(decorated)
    return decorated


class _LogAsSteps(logging.Handler):
    """Shows what the library logs like steps of the work."""

    def __init__(self, say: Say) -> None:
        super().__init__()
        self.say = say

    def emit(self, record: logging.LogRecord) -> None:
        """Show a record."""
        self.say(record.getMessage())


@contextmanager
def steps() -> Iterator[Say]:
    """Print each step and each message that opid logs on stderr, each on a line with the seconds since the start."""
    start, logger = time.monotonic(), logging.getLogger("opid")

    def say(step: str) -> None:
        click.echo(escape_invisible(f"{time.monotonic() - start:7.1f} s  {step}"), err=True)

    shown, before = _LogAsSteps(say), logger.level
    logger.addHandler(shown)
    logger.setLevel(logging.DEBUG)
    try:
        yield say
    finally:
        logger.removeHandler(shown)
        logger.setLevel(before)


UNCOUNTED = "{elapsed} {desc}"
COUNTED = "{elapsed} {percentage:3.0f}%|{bar:20}| {remaining} left: {desc}"
"""The line of a step of which no fraction is known, and of one of which it is; a narrow terminal cuts its end off."""


@contextmanager
def progress(*, quiet: bool = False) -> Iterator[Say]:
    """Show the present step with the time that it has taken on stderr, if that is a terminal; a `Step` has a bar, too.

    tqdm draws the line when a step is named, and a thread draws it again every second, so that a user sees that a long
    step still runs.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda step: None
        return
    from tqdm import tqdm

    line = tqdm(total=1.0, bar_format=UNCOUNTED, leave=False, dynamic_ncols=True, file=sys.stderr)

    def say(step: str) -> None:
        name, fraction = (step.name, step.fraction) if isinstance(step, Step) else (step, None)
        # Steps that count on from each other, like the tests of a series, share one clock and one bar.
        goes_on = fraction is not None and line.bar_format == COUNTED and fraction >= line.n
        line.set_description_str(escape_invisible(name), refresh=False)
        line.bar_format = UNCOUNTED if fraction is None else COUNTED
        line.n = fraction or 0.0
        if not goes_on:  # The time that is left is estimated from what is done from here on.
            line.initial, line.start_t = line.n, time.time()
        line.refresh()

    ended = threading.Event()

    def tick() -> None:
        while not ended.wait(1.0):
            line.refresh()

    ticker = threading.Thread(target=tick, daemon=True)
    ticker.start()
    try:
        yield say
    finally:
        ended.set()
        ticker.join()
        line.clear()  # `close` leaves the line where the clock was set after tqdm's own last drawing.
        line.close()
