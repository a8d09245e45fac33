"""Options that several commands have, their types, and the examples below the help texts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from opid.errors import InputError


class _Path(click.Path):
    """A path, which has no zero byte."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the text as a path."""
        if "\0" in str(value):
            self.fail(f"{str(value)!r} holds a zero byte: give a path without one", param, ctx)
        return super().convert(value, param, ctx)


PATH = _Path(path_type=Path)


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


def seed_option(of: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option of a seed of what is drawn."""
    seed = click.IntRange(min=0)
    return click.option("--seed", type=seed, default=1, show_default=True, metavar="N", help=f"Seed of {of}.")


def out_option(help_text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return the option that names the folder for a report."""
    return click.option("--out", type=PATH, metavar="DIR", help=help_text)


truth_option = click.option("--truth", type=PATH, metavar="JSON", help="truth.json of a simulation, to compare.")
