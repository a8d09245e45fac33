"""Tables [channels.NAME] of a study file -> where each channel is found, and how it is read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, TypeVar

from opid.errors import InputError
from opid.signals.log_settings import ChannelSettings, LogSettings
from opid.studies.run_files import Source
from opid.studies.schema import NO_KEY, recast

CHANNEL = "the name of a channel, its number or a table"
"""What an entry of [channels] needs."""


@dataclass(frozen=True, kw_only=True)
class ChannelTable(ChannelSettings):
    """What a table of a channel says.

    Args:
        channel: as in `ChannelSettings`; the name of the table where left out.
        log: how its file is to be read; as [log] says where left out.
        given: the keys that stand in it.
    """

    ELSEWHERE: ClassVar[dict[str, str]] = {"name": "write `channel` for the name of the channel in the log"}
    channel: str | int | None = None  # type: ignore[assignment]
    log: LogSettings | None = None
    given: Annotated[frozenset[str], NO_KEY] = frozenset()


C = TypeVar("C", bound=ChannelTable)


def as_table(kind: type[C], name: str, entry: str | int | C) -> C:
    """Return the table that an entry of [channels] stands for: a name, a number or a table that may leave both out."""
    if isinstance(entry, str | int):
        return kind(channel=entry, given=frozenset({"channel"}))
    return replace(entry, channel=name if entry.channel is None else entry.channel)


def sources_of(
    channels: Mapping[str, ChannelTable], *, run: str, log: str | None, settings: LogSettings, directory: Path
) -> dict[str, Source]:
    """Return where the channels of a run are found.

    Args:
        channels: by the names that they will have.
        run: its name, for which `{run}` stands in the name of a file.
        log: the file of channels that name none.
        settings: of logs whose channels give none.
        directory: of the study.

    Raises:
        InputError: a channel without a file in a run without a log.
    """
    sources = {}
    for name, table in channels.items():
        channel = recast(ChannelSettings, table)
        if channel.file is not None:
            channel = replace(channel, file=channel.file.replace("{run}", run))
        file = log if channel.file is None else channel.file
        if file is None:
            raise InputError(f"run {run!r} has no 'log', and [channels.{name}] no 'file': give one of them")
        sources[name] = Source(directory / file, channel, table.log or settings)
    return sources
