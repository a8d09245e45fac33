"""What every command shares: the group, failures as sentences, folders for results, progress on stderr."""

from __future__ import annotations

import logging
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from shutil import get_terminal_size
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

import click

from opid.errors import InputError, NotDeterminedError

if TYPE_CHECKING:
    from opid.mechanics.truth import Truth
    from opid.result import Result


LONGEST_SUMMARY = 1000
"""Characters: more than any first sentence has."""


def example(command: str) -> str:
    """Return the end of a help text: an example, which click does not wrap."""
    return f"\b\nExample:\n  {command}"


class Number(click.ParamType):
    """A number, with what to give where something else was given."""

    name = "number"

    def __init__(self, needed: str) -> None:
        self.needed = needed

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Turn what was given into a number."""
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is no number: give {self.needed}", param, ctx)


class BadInput(click.ClickException):
    """What was given cannot be used."""

    exit_code = 2


class NotDetermined(click.ClickException):
    """The data do not determine the answer."""

    exit_code = 1


class Interrupted(click.ClickException):
    """The user pressed Ctrl-C."""

    exit_code = 130


class Commands(click.Group):
    """Commands whose failures for the user's reasons are sentences, not tracebacks."""

    group_class = type

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands with their whole summaries, which click cuts to one line each."""
        rows = [(name, each.get_short_help_str(LONGEST_SUMMARY)) for name, each in sorted(self.commands.items())]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def invoke(self, context: click.Context) -> Any:
        """Run the command that was asked for."""
        try:
            return super().invoke(context)
        except InputError as error:
            raise BadInput(str(error)) from error
        except NotDeterminedError as error:
            raise NotDetermined(str(error)) from error
        except OSError as error:
            # without a name it is no file of the user's (a pipe whose reader has gone: click ends quietly)
            if error.filename is None:
                raise
            raise BadInput(f"{error.filename}: {error.strerror}") from error
        except KeyboardInterrupt as error:
            raise Interrupted("interrupted") from error


@click.group(
    cls=Commands,
    epilog=example("opid demo"),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="opid")
def main() -> None:
    """Identify a nonlinear suspension from what two accelerometers recorded in operation.

    Or a body on several suspensions, like a whole aircraft on its gears, from two on each: `opid simulate aircraft`
    makes an example.

    Begin with `opid demo`, or with `opid inspect` and `opid identify` on logs of your own. For modes of any structure
    whose stiffness and damping depend on their amplitude: `opid simulate sine-beats` and `opid modal` (sine beats), or
    `opid decay` (one free decay).
    """


def result_name(path: Path) -> str:
    """Name a result after its study; every other study is called study.toml, so after the directory of such a one."""
    return path.stem if path.name != "study.toml" else path.resolve().parent.name or path.stem


REPORT = ("result.json", "report.html")
"""Files that every report has, by which an older one is known."""


def overwrite_option(name: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the option to overwrite older files, as the argument `overwrite`."""
    return click.option(name, "overwrite", is_flag=True, help="Overwrite what an earlier run has left in the folder.")


with_force = overwrite_option("--force")


def free_directory(path: Path, names: tuple[str, ...], *, overwrite: bool, option: str = "--force") -> Path:
    """Return the path of a directory for these files; refuse before long work where one of them is there.

    Files of other names stay in any case.

    Raises:
        InputError: a file stands in the way, the place is not writable, or an older file is there and `overwrite`,
            which `option` asks for, is False.
    """
    from opid.signals.files import require_directory

    target = require_directory(path)
    there = [name for name in names if (target / name).exists()]
    if there and not overwrite:
        raise InputError(f"{path} has {', '.join(there)} already: choose another folder, or overwrite with {option}")
    return target


@dataclass(frozen=True)
class Output:
    """What a command that writes a report shows of its work, and whether it may overwrite an older report."""

    overwrite: bool
    as_json: bool
    quiet: bool
    verbose: bool
    figures: bool
    option: str = "--force"

    def directory(self, path: Path, names: tuple[str, ...] = REPORT) -> Path:
        """Return the path of a directory for the report, as `free_directory`."""
        return free_directory(path, names, overwrite=self.overwrite, option=self.option)

    def progress(self) -> AbstractContextManager[Callable[[str], None]]:
        """Show the step that is under way, every step with --verbose, none with --quiet."""
        return steps() if self.verbose else progress(quiet=self.quiet)

    def show(self, result: Result, truth: Truth | None = None, *, notes: Sequence[str] = ()) -> None:
        """Print the result: as JSON where that is asked for, otherwise as text with the notes below it.

        Raises:
            NotDetermined: something is not determined; the reason is in it where no text has given it.
        """
        from opid.json_values import json_text
        from opid.provenance import traced
        from opid.report import text

        if self.as_json:
            click.echo(json_text(traced(result.to_dict(), result.files)), nl=False)
        elif not self.quiet:
            click.echo(text(result, truth))
            for note in notes:
                click.echo(note)
        reason = getattr(result, "not_determined", None)
        if reason:
            is_silent = self.as_json or self.quiet
            raise NotDetermined(f"not determined: {reason}" if is_silent else "not determined, for the reason above")


def with_output(command: Callable[..., None], *, option: str = "--force") -> Callable[..., None]:
    """Give a command the options of `Output`, and `output` in their place; `option` asks for overwriting."""

    @wraps(command)
    def run(*, overwrite: bool, as_json: bool, quiet: bool, verbose: bool, figures: bool, **given: Any) -> None:
        if quiet and verbose:
            raise click.UsageError("--quiet and --verbose are both given: give one of them")
        command(output=Output(overwrite, as_json, quiet, verbose, figures, option), **given)

    decorated: Callable[..., None] = run
    for each in (
        click.option(
            "--no-figures", "figures", flag_value=False, default=True, help="Write the report without figures."
        ),
        click.option("--verbose", is_flag=True, help="Print every step of the work on stderr, and what opid logs."),
        click.option("--quiet", is_flag=True, help="Print no progress and no text; files and status tell."),
        click.option("--json", "as_json", is_flag=True, help="Print the result as JSON."),
        overwrite_option(option),
    ):
        decorated = each(decorated)
    return decorated


def report_note(page: Path | None) -> tuple[str, ...]:
    """Say where the page is; nothing where none was written."""
    return () if page is None else (f"Report: {page} (open it in a browser)",)


def show_next(command: str, study: Path) -> None:
    """Print the command line that works on a virtual test, beside whose study its truth stands, as a shell takes it."""
    words = ["opid", command, str(study), "--truth", str(study.with_name("truth.json"))]
    click.echo(f"Next: {shlex.join(words)}")


class _Shown(logging.Handler):
    """What the library logs, as steps of the work."""

    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__()
        self.say = say

    def emit(self, record: logging.LogRecord) -> None:
        """Show a record."""
        self.say(record.getMessage())


@contextmanager
def steps() -> Iterator[Callable[[str], None]]:
    """Print each step and each record of the logger "opid" on a line of its own on stderr, with the seconds passed."""
    start, logger = time.monotonic(), logging.getLogger("opid")

    def say(step: str) -> None:
        click.echo(f"{time.monotonic() - start:7.1f} s  {step}", err=True)

    shown, before = _Shown(say), logger.level
    logger.addHandler(shown)
    logger.setLevel(logging.DEBUG)
    try:
        yield say
    finally:
        logger.removeHandler(shown)
        logger.setLevel(before)


@contextmanager
def progress(*, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Show the step that is under way and the time since the start on stderr; nothing where that is no terminal.

    A thread draws the line anew every second: a long step is seen to be alive.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda step: None
        return
    room = get_terminal_size().columns - 1  # what wraps cannot be drawn over
    start, step, stirred, ended = time.monotonic(), "", Event(), Event()

    def say(name: str) -> None:
        nonlocal step
        step = name
        stirred.set()

    def draw() -> None:
        while not ended.is_set():
            minutes, seconds = divmod(int(time.monotonic() - start), 60)
            click.echo(f"\r{f'{step} ({minutes:02}:{seconds:02})'.strip()[:room].ljust(room)}", err=True, nl=False)
            stirred.wait(1.0)
            stirred.clear()
        click.echo(f"\r{'':{room}}\r", err=True, nl=False)

    line = Thread(target=draw, daemon=True)
    line.start()
    try:
        yield say
    finally:
        ended.set()
        stirred.set()
        line.join()
