"""What the paper's chain answers with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any, Literal

from opid.estimate import Estimate
from opid.mechanics.laws.law import Law
from opid.mechanics.laws.rows import law_rows
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.suspensions.law_search.force_surface import VisitedForce
from opid.suspensions.law_search.pursuit import LawStep, alternatives
from opid.suspensions.paper.added_mass import AddedMass
from opid.suspensions.paper.chain import PaperChain
from opid.suspensions.paper.settings import PaperSettings
from opid.suspensions.paper.spectral_equation import JointFit
from opid.suspensions.result import GearParameters, GearRatios, Identification, estimate_rows
from opid.suspensions.settings import SearchSettings
from opid.suspensions.study import Study

PaperMethod = Literal["classical", "paper"]
METHODS: tuple[PaperMethod, ...] = ("classical", "paper")


@dataclass(frozen=True, eq=False, repr=False)
class PaperIdentification(Result):
    """The result of an identification by the paper's chain.

    Args:
        study: the runs.
        method: "classical" (every step mended) or "paper" (the printed formula; no intervals).
        title: of the study.
        date: of the runs; None if it is not known.
        parameters: absolute values, of the reference run.
        ratios: what needs no known mass.
        law: the nonlinear law in N, or per unit of mass (m/s^2) where the mass is not determined.
        law_estimates: {kind: {parameter: Estimate}} in the same unit; empty where no law is concluded.
        restoring_force: the identified force over the visited plane; empty where no number is given.
        chain: the steps of the paper, run by run.
        joint: the fit of the equation to all runs, per unit of the reference mass; its intervals are widened where the
            model leaves much more than noise.
        ladder: the laws that were tried.
        added_mass: absolute parameters of `joint`; None where the mass is not determined.
        settings: what was asked for, and every number that was chosen.
        warnings: what limits the answer, one sentence each.
        not_determined: why absolute values are missing, or None.
    """

    study: Study
    method: PaperMethod
    title: str
    date: date | None
    parameters: GearParameters
    ratios: GearRatios
    law: Law
    law_estimates: Mapping[str, Mapping[str, Estimate]]
    restoring_force: VisitedForce
    chain: PaperChain
    joint: JointFit
    ladder: tuple[LawStep[JointFit], ...]
    added_mass: AddedMass | None
    settings: PaperSettings
    warnings: tuple[str, ...]
    not_determined: str | None

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the parameters, the law, and the ratios that need no known mass."""
        laws = law_rows(self.law, self.law_estimates, "law", per_mass=self.per_mass)
        return (*estimate_rows(self.parameters), *laws, *estimate_rows(self.ratios))

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The logs of the runs, as they were when they were read."""
        return self.study.files

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, see `opid.suspensions.answer.as_json.result_json`."""
        from opid.suspensions.answer.as_json import result_json

        return result_json(self)

    def _headline(self) -> str:
        return f"{self.title or 'without a title'} (method {self.method}, law {self.law.name})"

    @property
    def per_mass(self) -> bool:
        """Whether the law and the restoring force are per unit of mass."""
        return self.restoring_force.per_mass

    @property
    def paper_chain(self) -> PaperChain:
        """The steps of the paper, as other results call them."""
        return self.chain

    @property
    def is_refused(self) -> bool:
        """Whether the joint fit leaves so much that no number of it is told, and no figure shows it.

        What the printed formula makes of a pair of peaks does not rest on it, and is told all the same.
        """
        return self.residual_over_noise > self.settings.verdicts.refused

    @property
    def residual_over_noise(self) -> float:
        """The noise that would explain the residual of the joint fit over the sensors' own noise."""
        return self.joint.noise_m_per_s2 / max(self.chain.noise_floor_m_per_s2, 1e-12)

    @property
    def tried_kinds(self) -> tuple[str, ...]:
        """Kinds of terms that were tried, by name."""
        return tuple(
            sorted({term.name for step in self.ladder for law in step.fit.laws.values() for term in law.terms})
        )

    @property
    def alternative_laws(self) -> tuple[str, ...]:
        """Which other laws explain the runs as well, a sentence each."""
        return alternatives(self.ladder, SearchSettings(alike_bic=self.settings.bic_margin))


AnyIdentification = Identification | PaperIdentification
"""What `identify` returns: the driven model's answer, or that of the paper's chain."""
