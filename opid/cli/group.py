"""The group of all commands, and how they end: a failure is one sentence and a status."""

from __future__ import annotations

import errno
import gc
import logging
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from opid.cli.options import example
from opid.errors import InputError, NotDeterminedError, escape_invisible, shorten_middle

VERBOSE = "opid.verbose"  # what the contexts of a command share of its options
_LONGEST_WORD, _LONGEST_LINE, _LONGEST_REASON = 300, 1400, 200
_LEAST_SIZE, _LARGEST_SIZE = 1e-50, 1e50  # as of recordings, whose sixth powers a computer still knows
_PAUSE_S = 0.01  # before a signal is sent once more: what was destroyed is gone by then


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


def _name_what_failed(error: OSError) -> BadInput:
    """Return an error of the system as that with which a command ends."""
    # a failed write or read of an open file names none; what is printed goes to one, too
    where = error.filename or "the system refuses"
    return BadInput(f"{where}: {error.strerror or error}")


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
        except OSError as error:  # of the help or the version, which are printed here
            if error.errno == errno.EPIPE:
                raise
            raise _name_what_failed(error) from None

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
            raise _name_what_failed(error) from error
        except KeyboardInterrupt as error:
            raise Interrupted("interrupted") from error
        except _EndedError as error:
            raise Ended("ended by a signal of the system") from error
        except (click.exceptions.Exit, click.Abort):
            raise
        except Exception as error:
            if context.meta.get(VERBOSE):
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
