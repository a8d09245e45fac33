"""What every command shares: the group, failures as sentences, progress on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.errors import InputError, NotDeterminedError

if TYPE_CHECKING:
    from opid.modal.result import ModalIdentification
    from opid.suspensions.bench.law import BenchLaw
    from opid.suspensions.paper.result import AnyIdentification
    from opid.updating.result import Updating


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


def end(result: AnyIdentification | BenchLaw | ModalIdentification | Updating) -> None:
    """Leave with status 1 and the reason if something is not determined."""
    if result.not_determined:
        raise NotDetermined(f"not determined: {result.not_determined}")


def result_name(path: Path) -> str:
    """Name a result after its study; every other study is called study.toml, so after the directory of such a one."""
    return path.stem if path.name != "study.toml" else path.resolve().parent.name or path.stem


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Show the step that is under way on stderr; nothing where that is no terminal."""
    from tqdm import tqdm

    with tqdm(bar_format="{desc} ({elapsed})", file=sys.stderr, disable=None, leave=False) as bar:
        yield bar.set_description_str
