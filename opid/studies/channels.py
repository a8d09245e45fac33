"""The tables [channels.NAME] of a study file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, TypeVar

from opid.signals.log import ChannelSettings, LogSettings
from opid.studies.schema import NO_KEY

CHANNEL = "the name of a channel, its number or a table"
"""What an entry of [channels] may be."""


@dataclass(frozen=True, kw_only=True)
class ChannelTable(ChannelSettings):
    """A table [channels.NAME].

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
    """Return an entry of [channels] as a table; the entry may be a name, a number or a table without either."""
    if isinstance(entry, str | int):
        return kind(channel=entry, given=frozenset({"channel"}))
    return replace(entry, channel=name if entry.channel is None else entry.channel)
