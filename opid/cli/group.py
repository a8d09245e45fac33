"""What the commands share: their group, failures as sentences, folders for results, and progress on stderr."""

from __future__ import annotations

import errno
import gc
import logging
import os
import shlex
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.errors import InputError, NotDeterminedError, escape_invisible, list_names, shorten_middle
from opid.progress import Say, Step

if TYPE_CHECKING:
    from opid.mechanics.truth import Truth
    from opid.result import Result
    from opid.signals.files import ReservedDirectory


class _Path(click.Path):
    """A path, which has no zero byte."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the text as a path."""
        if "\0" in str(value):
            self.fail(f"{str(value)!r} holds a zero byte: give a path without one", param, ctx)
        return super().convert(value, param, ctx)


PATH = _Path(path_type=Path)

_VERBOSE = "opid.verbose"  # what the contexts of a command share of its options
_LONGEST_WORD, _LONGEST_LINE, _LONGEST_REASON = 300, 1500, 200
_LEAST_SIZE, _LARGEST_SIZE = 1e-50, 1e50  # as of recordings, whose sixth powers a computer still knows
_PAUSE_S = 0.01  # before a signal is sent once more: what was destroyed is gone by then


def example(command: str) -> str:
    """Return the end of a help text: an example that click does not wrap."""
    return f"\b\nExample:\n  {command}"


class Number(click.ParamType):
    """A number; the refusal of any other text says what is needed."""

    name = "number"

    def __init__(self, needed: str) -> None:
        self.needed = needed

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the text as a number."""
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is no number: give {self.needed}", param, ctx)


class Unit(click.ParamType):
    """A unit that opid knows, of time where it `is_of_time`; behind the name of a channel where it `is_named`."""

    def __init__(self, *, is_of_time: bool = False, is_named: bool = False) -> None:
        self.is_of_time, self.is_named = is_of_time, is_named
        self.name = "CHANNEL=UNIT" if is_named else "UNIT"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the unit, with a channel before it where it is named."""
        from opid.signals.units import to_si

        channel, _, unit = str(value).rpartition("=")
        if bool(channel) != self.is_named:
            self.fail(f"{value!r} is no {self.name}: give one, like {'load=kN' if self.is_named else 'g'}", param, ctx)
        try:
            is_time = to_si(unit)[1] == "s"
        except InputError as error:
            self.fail(str(error), param, ctx)
        if self.is_of_time and not is_time:
            self.fail(f"{unit!r} is no unit of time: give one, like s or ms", param, ctx)
        return (channel, unit) if self.is_named else unit


time_unit_option = click.option(
    "--time-unit",
    type=Unit(is_of_time=True),
    metavar="UNIT",
    help="Unit of the time (s, ms, ...), whatever the log says.",
)
unit_option = click.option(
    "--unit", type=Unit(), metavar="UNIT", help="Unit of every channel for which the log states none (g, m/s^2, ...)."
)


def channel_units_option(help_text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option for units of single channels."""
    return click.option("--unit", "units", type=Unit(is_named=True), multiple=True, help=help_text)


class OfWords(click.Choice[str]):
    """Choices of one or more words, joined by hyphens so that none needs quotes; with blanks they are taken, too."""

    def __init__(self, choices: Sequence[str]) -> None:
        super().__init__([choice.replace(" ", "-") for choice in choices])

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the choice with blanks."""
        return super().convert(value.replace(" ", "-"), param, ctx).replace("-", " ")


def as_line(text: str) -> str:
    r"""Return a sentence as one line that any terminal shows: a name in it may hold anything, at any length.

    >>> as_line("there is no file a\x1b[31m\nb")
    'there is no file a\\x1b[31m b'
    """
    words = (shorten_middle(word, _LONGEST_WORD, "...") for word in escape_invisible(text).split())
    return shorten_middle(" ".join(words), _LONGEST_LINE, "...")


class _Sentence(click.ClickException):
    """A reason why a command ends, as one line that any terminal shows."""

    def __init__(self, message: str) -> None:
        super().__init__(as_line(message))


class BadInput(_Sentence):
    """The input cannot be used."""

    exit_code = 2


class NotDetermined(_Sentence):
    """The data do not determine the answer."""

    exit_code = 1


class Unexpected(_Sentence):
    """opid itself is at fault: its message says where, and how to report it."""

    exit_code = 70  # as sysexits.h has it

    def __init__(self, error: Exception) -> None:
        frames = traceback.extract_tb(error.__traceback__)
        own = [each for each in frames if Path(each.filename).is_relative_to(Path(__file__).parents[1])]
        where = f" in {Path(own[-1].filename).name}, line {own[-1].lineno}" if own else ""
        said = " ".join(str(error).split())[:_LONGEST_REASON]
        super().__init__(
            f"opid itself failed{where} ({type(error).__name__}{': ' if said else ''}{said}), and there is no answer: "
            "report this line and the command to the authors of opid, with the files if you can; --verbose prints more"
        )


class Interrupted(click.ClickException):
    """The user pressed Ctrl-C."""

    exit_code = 128 + signal.SIGINT


class Ended(click.ClickException):
    """The system asked the process to end."""

    exit_code = 128 + signal.SIGTERM


class _EndedError(SystemExit):
    """The system asks the process to end, and blocks that clean up shall do so."""


@contextmanager
def _end_cleanly() -> Iterator[None]:
    """Turn signals by which the system ends a process into an exception; one that is ignored stays ignored.

    Python drops an exception that a signal raises while it destroys an object: the signal is then sent once more.
    """

    def end(*_: object) -> None:
        raise _EndedError

    def repeat(dropped: Any) -> None:
        if issubclass(dropped.exc_type, (_EndedError, KeyboardInterrupt)):
            number = signal.SIGINT if issubclass(dropped.exc_type, KeyboardInterrupt) else signal.SIGTERM
            threading.Timer(_PAUSE_S, os.kill, (os.getpid(), number)).start()
        else:
            hook(dropped)

    hook, sys.unraisablehook = sys.unraisablehook, repeat
    before: dict[signal.Signals, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                before[number] = signal.signal(number, end)
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)


def _escape(error: click.ClickException) -> click.ClickException:
    """Return what click says of a command line, whose words must not steer the terminal."""
    said = as_line(error.format_message())
    error.format_message = lambda: said  # type: ignore[method-assign]
    return error


class Command(click.Command):
    """A command whose numbers have a size that something measured has."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the words of the command line, and refuse NaN, infinity and numbers whose powers are none."""
        rest = super().parse_args(ctx, args)
        for param in self.params:
            for each in _flatten(ctx.params.get(param.name or "")):
                size = abs(each)
                if size and not _LEAST_SIZE <= size <= _LARGEST_SIZE:
                    raise click.BadParameter(
                        f"{each:g} has a size that nothing has which is measured: give a number from {_LEAST_SIZE:g} "
                        f"to {_LARGEST_SIZE:g}",
                        ctx,
                        param,
                    )
        return rest


def _flatten(value: Any) -> Iterator[float]:
    """Yield the numbers of an option that is given once, several times, or with several numbers."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, tuple):
        for each in value:
            yield from _flatten(each)


class Commands(click.Group):
    """Where the input or the data are at fault, these commands end with a sentence instead of a traceback."""

    group_class = type
    command_class = Command

    def make_context(self, *args: Any, **settings: Any) -> click.Context:
        """Read the words of the command line."""
        try:
            return super().make_context(*args, **settings)
        except click.ClickException as error:
            raise _escape(error) from None

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands with their whole summaries, which click would shorten to one line each."""
        rows = [(name, each.get_short_help_str(limit=1000)) for name, each in sorted(self.commands.items())]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def invoke(self, context: click.Context) -> Any:
        """Run a command."""
        # A command makes many objects and few cycles: looking for cycles as often as usual takes 4 % of its time.
        gc.set_threshold(100_000, *gc.get_threshold()[1:])
        # Where there is no home, matplotlib says on stderr, unless its logger has a handler, that fonts are not kept.
        logging.getLogger("matplotlib").addHandler(logging.NullHandler())
        try:
            with _end_cleanly():
                return super().invoke(context)
        except click.ClickException as error:
            raise _escape(error) from None
        except InputError as error:
            raise BadInput(str(error)) from error
        except NotDeterminedError as error:
            raise NotDetermined(str(error)) from error
        except MemoryError as error:
            words = str(error) or "there is none left"
            raise BadInput(f"it needs more memory than there is ({words}): ask for less at once") from error
        except OSError as error:
            # if the reader of a pipe has ended, click ends without a word
            if error.errno == errno.EPIPE:
                raise
            # a failed write or read of an open file names none
            raise BadInput(f"{error.filename or 'the system refuses'}: {error.strerror or error}") from error
        except KeyboardInterrupt as error:
            raise Interrupted("interrupted") from error
        except _EndedError as error:
            raise Ended("ended by a signal of the system") from error
        except (click.exceptions.Exit, click.Abort):
            raise
        except Exception as error:
            if context.meta.get(_VERBOSE):
                click.echo(escape_invisible(traceback.format_exc()), err=True)
            raise Unexpected(error) from error


@click.group(
    cls=Commands,
    epilog=example("opid demo"),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="opid")
def main() -> None:
    """Identify nonlinear mechanical structures from what sensors recorded in operation.

    Begin with `opid demo`, and with `opid inspect` on a log of your own. Then there are four jobs:

    \b
    identify  suspensions, from accelerations below and above each at two
              known loadings: one gear, a car, a whole aircraft, a building;
              `compare` says what changed from flight to flight, and `sense`
              gives strut forces, travel and motion along any log
    law       a damper or spring, from force and motion on a test bench
    modal     modes whose stiffness and damping depend on their amplitude, from
              sine beats; `decay` from free decays, `resonance` from tests
              at phase resonance; `modes` finds the linear modes before
    update    the law of joints, from backbones beside a finite-element model

    `opid simulate` makes a test with known truth for each but `law`.
    """


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


def seed_option(of: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option of a seed of what is drawn."""
    seed = click.IntRange(min=0)
    return click.option("--seed", type=seed, default=1, show_default=True, metavar="N", help=f"Seed of {of}.")


def out_option(help_text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option that names the folder for a report."""
    return click.option("--out", type=PATH, metavar="DIR", help=help_text)


truth_option = click.option("--truth", type=PATH, metavar="JSON", help="truth.json of a simulation, to compare.")


def reserve_free(path: Path, names: tuple[str, ...], *, overwrite: bool) -> ReservedDirectory:
    """Reserve a directory for these files until the command ends, and refuse if one of them exists already.

    Raises:
        InputError: the directory cannot be made or written to, another process writes into it, or a file exists and
            may not be overwritten.
    """
    from opid.signals.files import reserve_directory

    reserved = click.get_current_context().with_resource(reserve_directory(path))
    for name in filter(lambda name: (reserved / name).is_dir(), names):
        raise InputError(f"{path} has a directory called {name}: choose another folder")
    there = [name for name in names if (reserved / name).exists()]
    if there and not overwrite:
        raise InputError(f"{path} has {', '.join(there)} already: choose another folder, or overwrite with --force")
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
        """Put the files that a command reads before the reason why they cannot be used, if it names no file."""
        try:
            yield
        except InputError as error:
            # what cannot be written comes from the system, and names the folder
            if isinstance(error.__cause__, OSError) or any(str(path) in str(error) for path in paths):
                raise
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
        click.get_current_context().meta[_VERBOSE] = verbose
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
