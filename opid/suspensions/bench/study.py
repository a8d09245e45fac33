"""The study of a test bench: one record, what its channels are, and which laws may be found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from opid.errors import InputError
from opid.mechanics.laws.law import default_law
from opid.signals.health.result import Finding
from opid.signals.recording import Recording
from opid.suspensions.bench.record import Bench, bench_from_recording, quasi_static_bench


@dataclass(frozen=True, eq=False)
class BenchStudy:
    """A record of a test bench, as `law_of_bench` takes it.

    Args:
        title: of the study.
        recording: what was measured, in SI units.
        force: name of the channel of the force, or with `mass_kg` of the acceleration.
        travel: name of the channel of the travel (extension).
        velocity: name of the channel of its rate; differentiated where left out.
        mass_kg: of a body that the specimen alone holds; None where a force was measured.
        moving_mass: whether parts of unknown mass move between the force and the specimen.
        quasi_static: whether the test was so slow that time means nothing.
        counted: name of a channel that is 0 where the law does not hold: such samples are followed and not fitted.
        candidates: kinds that the law may be made of; None for every kind that is searched.
        most_terms: of the law at the most; None for as many as the settings say.
        findings: what is to be said of the log that it was taken from.
        source: the study file; None where there is none.
        log: the file that it was read from without a study file; None where it came otherwise.

    Raises:
        InputError: an unknown kind, a quasi-static test with a velocity, a mass, a moving mass or samples that do not
            count, or as `bench_from_recording`.
        NotDeterminedError: a travel or a force that never changes.
    """

    title: str
    recording: Recording
    force: str
    travel: str
    velocity: str | None = None
    mass_kg: float | None = None
    moving_mass: bool = False
    quasi_static: bool = False
    counted: str | None = None
    candidates: Sequence[str] | None = None
    most_terms: int | None = None
    findings: tuple[Finding, ...] = ()
    source: Path | None = None
    log: Path | None = None

    def __post_init__(self) -> None:
        for kind in self.candidates or ():
            default_law(kind)  # an unknown one is named here
        if self.most_terms is not None and self.most_terms < 0:
            raise InputError(f"most_terms is {self.most_terms}: give 0 or more")
        timed = [name for name in ("velocity", "mass_kg", "moving_mass", "counted") if getattr(self, name)]
        if self.quasi_static and timed:
            raise InputError(
                f"quasi_static beside {' and '.join(timed)}: a test whose time means nothing has none; leave it out"
            )
        assert self.bench  # what is wrong with the record is said here

    @cached_property
    def bench(self) -> Bench:
        """The record in SI units."""
        if self.quasi_static:
            found = quasi_static_bench(self.recording, force=self.force, travel=self.travel)
        else:
            found = bench_from_recording(
                self.recording,
                force=self.force,
                travel=self.travel,
                velocity=self.velocity,
                moving_mass=self.moving_mass,
                mass_kg=self.mass_kg,
                counted=None if self.counted is None else self.recording.channel(self.counted) != 0,
            )
        of_log = (f"{each.channel}: " * bool(each.channel) + each.message for each in self.findings)
        return replace(found, warnings=(*found.warnings, *of_log), source=self.source, log=self.log)
