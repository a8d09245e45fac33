"""Several forms of the law, fitted to the same decays, and their weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from opid.errors import NotDeterminedError
from opid.modal.decay.form_fit import FormFit, fit_form
from opid.modal.decay.law_search import LawForm, Linearisation, score_misfit, search_forms
from opid.modal.decay.scaled_track import FitUnits, ScaledTrack
from opid.modal.joint_terms import JointKind
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class DecayProblem:
    """Decays in the units of a fit, their harmonic linearisation, and the orders that are asked for."""

    seen: Linearisation
    decays: Sequence[ScaledTrack]
    units: FitUnits
    stiffness_order: int | None
    damping_order: int | None

    @property
    def n_data(self) -> int:
        """The number of amplitudes and phases."""
        return 2 * sum(each.time.size for each in self.decays)

    def find_unexplained(self, fit: FormFit) -> float:
        """Return the fraction of the squared misfit of a form that noise does not explain, 0 where it may."""
        freedom = max(self.n_data - (fit.form.size + 2) * fit.repeats, 1)
        explained = float(stats.chi2.ppf(1.0 - MODAL.chance_misfit, freedom)) / freedom
        return max(0.0, 1.0 - explained / max(fit.misfit**2, explained))

    def is_beyond_noise(self, squares: float, n_coefficients: int, chance: float) -> bool:
        """Whether noise leaves such squared errors of a law with so many coefficients less often than by a chance."""
        freedom = max(self.n_data - n_coefficients, 1)
        return squares > float(stats.chi2.ppf(1.0 - chance, freedom))

    def search_forms(
        self, friction: bool | None, memory: bool | str | JointKind | None, *, may_imitate: bool = False
    ) -> list[tuple[LawForm, FloatArray]]:
        """Return forms of the orders that are asked for, with or without a joint, as `search_forms` does."""
        return search_forms(
            self.seen,
            stiffness_order=self.stiffness_order,
            damping_order=self.damping_order,
            friction=friction,
            memory=memory,
            may_imitate=may_imitate,
        )

    def fit(self, form: LawForm, guess: FloatArray) -> FormFit:
        """Return a form that is fitted to the decays, from its first coefficients; raise what `fit_form` does."""
        damping = float(np.median(self.seen.damping))
        return fit_form(self.decays, form, guess, derivative=self.units.derivative, damping=damping)

    def score(self, fits: Sequence[FormFit]) -> FloatArray:
        """Return the Bayesian criterion of forms that were fitted to the decays above that of the best, (m,)."""
        sizes = [each.form.size * each.repeats for each in fits]
        scores = score_misfit([each.squares for each in fits], self.n_data, sizes)
        scores += [each.form.prior_score for each in fits]
        return scores - scores.min()

    def weigh(self, fits: Sequence[FormFit]) -> FloatArray:
        """Return the probabilities of forms by that criterion, (m,); those of unlikely ones are zero."""
        weights = np.exp(-0.5 * self.score(fits))
        weights = np.where(weights < MODAL.least_weight, 0.0, weights)
        return weights / weights.sum()


@dataclass(frozen=True, eq=False)
class TriedForms:
    """Forms that were fitted, those whose joint is not determined, and why the first one failed."""

    fits: list[FormFit]
    undetermined: list[FormFit]
    failed: NotDeterminedError | None


@dataclass(frozen=True, eq=False)
class FittedForms:
    """Forms with their weights, the chosen one first, and what is to be doubted.

    Args:
        fits: the forms and their weights.
        is_doubted: whether the damping at zero amplitude of the chosen form is to be doubted.
        warnings: one sentence for each warning.
        part: fraction of the squared misfit that noise does not explain.
        is_untold: whether nothing tells how far the law is from the true one.
    """

    fits: Sequence[tuple[FormFit, float]]
    is_doubted: bool
    warnings: tuple[str, ...]
    part: float = 0.0
    is_untold: bool = False

    @property
    def is_another_kind(self) -> bool:
        """Whether the law misses the decays by so much that it is of another kind than the true one."""
        return bool(self.part) and self.best.misfit > MODAL.most_misfit

    @property
    def best(self) -> FormFit:
        """The fit of the form that was chosen."""
        return self.fits[0][0]


def try_forms(problem: DecayProblem, forms: Sequence[tuple[LawForm, FloatArray]]) -> TriedForms:
    """Fit forms to all decays."""
    fits: list[FormFit] = []
    undetermined: list[FormFit] = []
    failed: NotDeterminedError | None = None
    for form, guess in forms:
        try:
            if problem.n_data <= (form.size + 2) * len(problem.decays) + 2:
                raise NotDeterminedError(
                    f"{problem.n_data} amplitudes and phases cannot determine {form.size} coefficients: lower the "
                    "orders"
                )
            fit = problem.fit(form, guess)
            if not form.is_possible(fit.vector):
                raise NotDeterminedError("the fitted law has no stiffness at zero amplitude: lower the orders")
            if not form.is_determined(fit.vector, np.sqrt(np.diag(fit.covariance))):
                undetermined.append(fit)
                raise NotDeterminedError(
                    "the decay does not determine the friction or the slip of the joint that its curves suggest: give "
                    "a damping_order, which leaves them out"
                )
            fits.append(fit)
        except NotDeterminedError as why:
            failed = failed or why
    return TriedForms(fits, undetermined, failed)


def weigh_fits(problem: DecayProblem, fits: list[FormFit]) -> list[tuple[FormFit, float]]:
    """Return fits with their weights, first the simplest of the best criterion."""
    fits = [each for each in fits if not each.is_at_edge] or fits
    fits = [each for each in fits if not each.is_active] or fits
    chosen = min(np.flatnonzero(problem.score(fits) < MODAL.bare_mention), key=lambda j: fits[j].form.size)
    weighed = list(zip(fits, problem.weigh(fits).tolist(), strict=True))
    return [weighed[chosen], *weighed[:chosen], *weighed[chosen + 1 :]]
