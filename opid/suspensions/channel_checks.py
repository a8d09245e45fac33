"""Whether the channels of a run are what they are said to be: pairs below and on a body, levels, health."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from opid.errors import InputError
from opid.signals.health import check_levels, check_pair, inspect
from opid.signals.health_result import Finding
from opid.signals.recording import Recording


def check_channels(
    recording: Recording, pairs: Sequence[tuple[str, str]], used: Sequence[str], *, run: str
) -> list[Finding]:
    """Return what is to be said of the channels of a run.

    Two that look exchanged are a warning and no more: a lightly damped frame may look so, and if they are, no model
    will follow them.

    Args:
        recording: of the run.
        pairs: channels below and above each suspension.
        used: all channels that count.
        run: name of the run.

    Raises:
        InputError: two channels that make no pair: one is mute, in another unit, or the other one once more.
    """
    found: list[Finding] = []
    for below, above in pairs:
        try:
            samples = recording.channel(below), recording.channel(above)
            found += check_pair(*samples, fs=recording.fs, names=(below, above))
        except InputError as error:
            raise InputError(f"run {run!r}: {error}") from None
    found += check_levels(recording, sorted(used))
    health = inspect(recording, thorough=False)
    # a note (gravity on a channel, say) needs no word here: the mean is taken off anyway
    return [*found, *(each for each in health.findings if each.severity != "note" and each.channel in used)]


def findings_in_words(run: str, findings: Sequence[Finding]) -> Iterator[str]:
    """Yield what is found of the channels of a run, one sentence each, without mere notes.

    Args:
        run: name of the run.
        findings: of it.
    """
    for finding in findings:
        if finding.severity != "note":
            channel = f", {finding.channel!r}" if finding.channel else ""
            yield f"run {run!r}{channel}: {finding.message}"
