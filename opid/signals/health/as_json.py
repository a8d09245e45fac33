"""What is wrong with logs, as a value of JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from opid.json_values import plain
from opid.signals.health.result import Health

SCHEMA = "opid.health/1"


def health_json(logs: Sequence[Health]) -> dict[str, Any]:
    """Return the health of some logs as a value of JSON, without the arrays that pictures are drawn from.

    Args:
        logs: the health of each.

    Returns:
        `schema` and `logs`, each with the fields of `Health` but `levels` and `files`, of its channels all but
        `overview`.

    >>> health_json([])
    {'schema': 'opid.health/1', 'logs': []}
    """
    return plain({"schema": SCHEMA, "logs": [_without_arrays(each) for each in logs]})


def _without_arrays(health: Health) -> dict[str, Any]:
    # left out before `asdict`, which copies
    channels = tuple(replace(channel, overview=None) for channel in health.channels)
    document = asdict(replace(health, channels=channels, levels=(), files=()))
    del document["levels"], document["files"]
    for channel in document["channels"]:
        del channel["overview"]
    return {"log": document.pop("log")} | document
