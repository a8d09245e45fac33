"""Search for the fitted model: a fit from start values, a search of laws and sensor faults, a final fit to all samples.

The search runs at a coarse rate if its steps are short enough for the motion of the body, and if what the model does
not predict is not aliased into the band. It ends where neither a law nor a sensor fault is expected to reduce the
residual.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import fft

from opid.errors import NotDeterminedError
from opid.mechanics.laws.law import LAWS, LINEAR, Law, default_law
from opid.progress import Say
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.faults import (
    Demand,
    add_faults,
    demands_of,
    find_coupling,
    has_doubtful_ground,
    without_ground,
)
from opid.suspensions.fitting.fit import (
    NO_FIT,
    Fit,
    carry_over,
    explains_nothing,
    fastest_rate,
    first_vector,
    fit_model,
    is_same_minimum,
    refit,
    runs_contradict_each_other,
    turnover_rate,
    with_laws,
)
from opid.suspensions.fitting.noise import is_noise, is_of_others, measure_whiteness
from opid.suspensions.fitting.repeatability import is_much_better, with_departures
from opid.suspensions.fitting.start import Start, look_for_start, start_values
from opid.suspensions.law_search.driven import DrivenLaws, is_impossible, search_origins
from opid.suspensions.law_search.pursuit import (
    LawStep,
    add_neighbours,
    chosen,
    find_far_behind,
    find_surely_behind,
    is_better,
    judge_by_left_out,
    library,
    n_terms,
    relatives,
    search_laws,
)
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.run import DrivenRun
from opid.suspensions.sensor_facts import SIDES
from opid.suspensions.settings import SearchSettings, Settings

Ladder = tuple[LawStep[Fit], ...]


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The model on which a search ended.

    Args:
        fit: the fitted model.
        ladder: the laws that were tried; the last one that was kept is the chosen one.
        demands: ground springs and sensor faults that were added to the model.
        n_starts: number of attempts.
        is_unlike: whether the search ended because the suspensions are not the same in all runs.
        problem: the problem on which laws were searched, with its stored answers; None if the law was given.
    """

    fit: Fit
    ladder: Ladder
    demands: tuple[Demand, ...] = ()
    n_starts: int = 1
    is_unlike: bool = False
    problem: DrivenLaws | None = None


@dataclass(frozen=True)
class Question:
    """What a search may try.

    Args:
        law_is_given: whether the user gave the laws; otherwise they are searched.
        ground: whether springs to the ground may be added.
        faults: whether sensor faults that are not stated may be added.
        method_of_law: the method of the search for laws, one of `METHODS_OF_LAW`.
        kinds: the kinds of terms that a law may have.
        repeatability: relative standard deviation of springs, damping and friction from run to run. The search assumes
            that they are the same in all runs, and ends where the runs contradict this.
    """

    law_is_given: bool = False
    ground: bool = True
    faults: bool = True
    method_of_law: str = "pursuit"
    kinds: tuple[str, ...] = field(default_factory=library)
    repeatability: float = 0.0


def find_model(model: Model, start: Start, question: Question, *, progress: Say | None = None) -> SearchResult:
    """Fit a model from start values, and add the laws and sensor faults that the runs demand.

    Args:
        model: the body, its runs and first laws.
        start: the start values.
        question: what may be tried.
        progress: called with the name of each step as it begins.

    Raises:
        UnboundedResponseError: the start values make a suspension that grows without bound.
        ImpossibleBodyError: the start values make a mass matrix that is not positive definite.
    """
    search = _Search(start, question, progress or (lambda step: None), model.settings)
    model = _forget_if_given(model, question)
    theta = first_vector(model, start)
    coarse = _reduce_rate(model, theta)
    found: SearchResult | None = None
    try:
        found = search.find(coarse, theta)
    except NO_FIT:
        if coarse is model:
            raise
    if coarse is not model and (found is None or _is_too_fast(found.fit)):
        # With shorter steps the search may end at another minimum.
        first = search.first_fit(model, theta)
        if found is None or not is_hopeless(found.fit) or first is None or not explains_nothing(first):
            found = search.try_several(model, theta, first)
    assert found is not None  # one of the two searches has ended, or an error was raised
    return search.with_all_readings(found, model.runs)


def find_from_reference(
    model: Model, reference: Fit, start: Start, question: Question, *, progress: Say | None = None
) -> SearchResult | None:
    """Fit a model to all runs, beginning at a fit of the runs without loading.

    The other runs rest elsewhere on their laws, by an amount that depends on the unknown mass.

    Args:
        model: the model of all runs.
        reference: the fit of the runs without loading, in which the mass is not fitted.
        start: start values for the same runs.
        question: what may be tried.
        progress: called with the name of each step as it begins.

    Returns:
        The end of the search; None if the springs cannot carry the loadings for any mass that was tried.
    """
    search = _Search(start, question, progress or (lambda step: None), model.settings)
    grown = replace(model, groups=reference.groups, sensors=reference.model.sensors, forgets=reference.model.forgets)
    grown = grown.coarse
    # A load that was only moved changes the moments and not the mass.
    largest = max(abs(float(run.loading[0, 0])) for run in model.runs)
    largest = largest or max(float(np.abs(run.loading).max()) for run in model.runs)
    best: tuple[float, FloatArray] | None = None
    for fraction in np.geomspace(*model.settings.fit.mass_fractions, model.settings.fit.n_mass_fractions):
        values = dict(zip(reference.model.names, reference.theta.tolist(), strict=False))
        values["inverse_mass"] = float(fraction) / largest
        shared = [values[name] for name in grown.names]
        theta = np.array([*shared, *np.zeros(grown.bounds()[0].size - len(shared))])
        theta = _find_start_states(grown, theta, model.settings.fit.noisier[-1])
        try:
            errors = replace(grown, louder=model.settings.fit.noisier[0][0]).evaluate(theta, sensitivity=False)
        except NO_FIT:
            continue
        cost = -grown.log_likelihood(errors, theta)
        best = min(best or (np.inf, theta), (cost, theta), key=lambda entry: entry[0])
    if best is None:
        return None
    found = search.attempt(grown, best[1], model.settings.fit.noisier[0])
    return search.with_all_readings(found, model.runs)


def is_start_useless(model: Model, start: Start, question: Question) -> bool:
    """Return whether the first fit from the start values explains nothing of the motion.

    Args:
        model: the body, its runs and first laws.
        start: the start values.
        question: what may be tried.
    """
    model = _forget_if_given(model, question)
    theta = first_vector(model, start)
    search = _Search(start, question, lambda step: None, model.settings)
    first = search.first_fit(_reduce_rate(model, theta), theta)
    return first is not None and explains_nothing(first)


def is_likelier(fit: Fit, than: Fit) -> bool:
    """Return whether a fit replaces another one by its information criterion.

    If one of the fits does not compare the first periods, the criteria cannot be compared: that fit is taken if it
    leaves no more than noise.

    Args:
        fit: the fit that may replace the other.
        than: the other fit, of the same runs.
    """
    if fit.model.forgets != than.model.forgets:
        forgetful = fit if fit.model.forgets else than
        if not is_noise(forgetful):
            return forgetful is than
    return fit.bic < than.bic


def is_hopeless(fit: Fit) -> bool:
    """Return whether a fit leaves so much that no law can explain it.

    Args:
        fit: a fitted model.
    """
    return fit.ratio > fit.model.settings.verdicts.refused


def _is_unrelated_to_drive(fit: Fit) -> bool:
    """Whether the body's motion is incoherent with the motion below it: no law and no sensor fault explains that."""
    runs, known = fit.model.runs, fit.model.settings.search
    return fit.model.body.n_interfaces == 1 and max(run.shared_fraction for run in runs) < known.least_shared


class _Search:
    def __init__(self, start: Start, question: Question, say: Say, settings: Settings) -> None:
        self.start, self.question, self.say = start, question, say
        self.problem = DrivenLaws(settings.search, settings.fit.promise_in_search)
        self.asked: list[tuple[Fit, tuple[Fit, tuple[Demand, ...]]]] = []

    def find(self, model: Model, theta: FloatArray) -> SearchResult:
        """Search, on the strongest piece of each run as long as no law is likely to explain what a fit leaves.

        A wrong structure is thus refused after a fraction of the time.
        """
        first = self.first_fit(model, theta)
        if (
            first is None
            or not is_hopeless(first)
            or runs_contradict_each_other(first)
            or _is_unrelated_to_drive(first)
        ):
            return self.try_several(model, theta, first)
        pieces = _take_strongest_pieces(model)
        if pieces is model:
            return self.try_several(model, theta, first)
        # An AC coupling removes slow motion, which pieces of some seconds hardly show.
        coupled = self._search_with_coupling(model, first, model.settings.fit.noisier[0])
        if coupled is not None:
            return coupled
        try:
            on_pieces = self.try_several(pieces, theta)
            found = self._continue_on_whole_runs(on_pieces, model)
        except NO_FIT:
            return self.try_several(model, theta, first)
        if is_hopeless(found.fit) and is_hopeless(on_pieces.fit):
            return found
        is_possible = self._is_possible(found)
        if is_possible and (found.is_unlike or leaves_noise(found.fit)):
            return found
        try:
            other = self.try_several(model, theta, first)
        except NO_FIT:
            return found
        n_starts = found.n_starts + other.n_starts
        is_kept = is_likelier(found.fit, other.fit) if is_possible == self._is_possible(other) else is_possible
        return replace(found if is_kept else other, n_starts=n_starts)

    def _is_possible(self, found: SearchResult) -> bool:
        """Whether the laws that were found are physically possible; laws that the user gave are always accepted."""
        return self.question.law_is_given or not is_impossible(found.fit)

    def first_fit(self, model: Model, theta: FloatArray) -> Fit | None:
        """Return the fit that the first attempt begins with; None if the model cannot be simulated at the start."""
        noisier, promise = model.settings.fit.noisier[0], model.settings.fit.promise_in_search
        try:
            return fit_model(model, _find_start_states(model, theta, noisier), noisier=noisier, least_promise=promise)
        except NO_FIT:
            return None

    def _continue_on_whole_runs(self, found: SearchResult, model: Model) -> SearchResult:
        """Fit the end of a search on pieces to the whole runs, and search laws and faults from there."""
        fit, noisier = found.fit, model.settings.fit.noisier[-1]
        whole = replace(fit.model, runs=model.runs)
        theta = np.concatenate([fit.theta[: fit.model.n_shared], np.zeros(fit.model.n_own * len(model.runs))])
        promise = model.settings.fit.promise_in_search
        again = fit_model(whole, _find_start_states(whole, theta, noisier), noisier=noisier, least_promise=promise)
        if is_hopeless(again):
            return replace(found, fit=again)
        if found.is_unlike:
            return replace(found, fit=again, ladder=(LawStep(again, True, chosen(found.ladder).method),))
        # The error without each demand is scaled from the pieces to the whole runs.
        louder = again.noise_m_per_s2 / fit.noise_m_per_s2
        demands = tuple(replace(each, error_before=louder * each.error_before) for each in found.demands)
        return replace(self._search_from(again, demands), n_starts=found.n_starts)

    def try_several(self, model: Model, theta: FloatArray, first: Fit | None = None) -> SearchResult:
        """Make attempts from several starts, which may end at different minima, until one leaves no more than noise.

        Args:
            model: the model to be fitted.
            theta: the start vector.
            first: the fit that the first attempt begins with, if it is known.
        """
        noisier = model.settings.fit.noisier
        bare = replace(model, groups=tuple(replace(group, law=LINEAR) for group in model.groups))
        searched = not self.question.law_is_given
        attempts: list[Callable[[], SearchResult]] = [
            lambda: self.attempt(
                model, theta if first else _find_start_states(model, theta, noisier[0]), noisier[0], first=first
            )
        ]
        if searched and any(group.law.terms for group in model.groups):
            attempts.append(lambda: self.attempt(bare, _drop_laws(model, theta), noisier[0]))
        n_sure = len(attempts)
        attempts += [lambda each=each: self.attempt(model, theta, each, hold_coordinates=False) for each in noisier[1:]]  # type: ignore[misc]
        n_without_faults = len(attempts)
        attempts += [lambda: self.attempt(model, theta, noisier[0], faults_first=True)] * self.question.faults
        best: SearchResult | None = None
        last: SearchResult | None = None
        failed: NotDeterminedError | None = None
        n_starts = 0
        is_confirmed = False
        for number, attempt in enumerate(attempts):
            if best is not None and leaves_noise(best.fit):
                break
            if best is not None and n_starts >= n_sure and (is_hopeless(best.fit) or is_of_others(best.fit)):
                break
            if best is not None and (runs_contradict_each_other(best.fit) or _is_unrelated_to_drive(best.fit)):
                break
            if n_starts == 1 and best is not None and self._has_unlike_runs(best.fit):
                # Further attempts would only find laws that compensate for the differences between the runs.
                return replace(best, n_starts=1, is_unlike=True)
            if best is not None and is_confirmed and (number < n_without_faults or best.demands):
                # Two attempts ended at the same minimum. An attempt that added faults searched its laws again, as an
                # attempt with the faults first does.
                continue
            n_starts += 1
            try:
                found = attempt()
            except NO_FIT as error:
                failed = failed or error
                continue
            if found.is_unlike:
                return replace(found, n_starts=n_starts)
            if not self._is_possible(found):
                # The law is impossible and comes from the start values: no search accepts it.
                last = last or found
                continue
            is_confirmed = is_confirmed or (best is not None and _is_as_likely(found.fit, best.fit))
            best = found if best is None or found.fit.bic < best.fit.bic else best
        best = best or last
        if best is None:
            assert failed is not None  # no attempt without a fit or an error
            raise failed
        own = self._start_from_own_equation(model, best)
        best = own if own is not None and is_likelier(own.fit, best.fit) else best
        return replace(best, n_starts=n_starts + (own is not None))

    def _start_from_own_equation(self, model: Model, best: SearchResult) -> SearchResult | None:
        """Search from start values for a friction with memory; None if the result leaves more than noise.

        This is tried if the best law has such a friction and leaves more than noise: first with that friction, then
        with a joint of sliders. Far from its parameters such a law has many wrong minima, and the equation of motion
        with this law gives a start near the right one. The initial force of each slider is unknown, so the first
        periods are not compared.
        """
        terms = [term for law in best.fit.laws.values() for term in law.terms]
        kinds = [term.name for term in terms if term.kind.memory is not None and term.kind.is_friction]
        if not kinds or self.question.law_is_given or leaves_noise(best.fit):
            return None
        if explains_nothing(best.fit) or _is_unrelated_to_drive(best.fit) or runs_contradict_each_other(best.fit):
            # No law explains such runs.
            return None
        noisier, settings = model.settings.fit.noisier[0], model.settings.start
        for kind in dict.fromkeys([*kinds, *(name for name in self.question.kinds if LAWS[name].slips)]):
            groups = tuple(replace(group, law=default_law(kind)) for group in model.groups)
            start = start_values(model.runs, model.body, groups, mass_free=model.mass_free, settings=settings)
            begun = replace(model, groups=start.groups, forgets=LAWS[kind].slips)
            try:
                found = self.attempt(begun, _find_start_states(begun, first_vector(begun, start), noisier), noisier)
            except NO_FIT:
                continue
            if is_noise(found.fit):
                return found
        return None

    def _has_unlike_runs(self, fit: Fit) -> bool:
        """Whether the runs are explained much better if springs, damping and friction may differ between them."""
        return self._can_depart(fit) and is_much_better(with_departures(fit, self.question.repeatability), fit)

    def _has_only_unlike_runs(self, fit: Fit) -> bool:
        """Whether differences between the runs explain all that is left, so that no other law has to be searched."""
        if is_noise(fit) or is_hopeless(fit) or not self._can_depart(fit):
            return False
        freed = with_departures(fit, self.question.repeatability)
        return is_noise(freed) and is_much_better(freed, fit)

    def _can_depart(self, fit: Fit) -> bool:
        """Whether the runs may differ and were fitted as if they were alike."""
        return bool(self.question.repeatability) and not fit.model.repeatability and len(fit.model.runs) > 1

    def attempt(
        self,
        model: Model,
        theta: FloatArray,
        noisier: Sequence[float],
        *,
        hold_coordinates: bool = True,
        faults_first: bool = False,
        first: Fit | None = None,
    ) -> SearchResult:
        """Fit the model from start values, or continue from a first fit, and search laws and faults from there."""
        promise = model.settings.fit.promise_in_search
        fit = first or fit_model(
            model, theta, noisier=noisier, hold_coordinates=hold_coordinates, least_promise=promise
        )
        if model.body.n_attachments == 1 and not is_noise(fit):
            # With better parameters another initial state may predict the first seconds better.
            begun = _find_start_states(model, fit.theta, noisier)
            again = fit_model(model, begun, noisier=noisier[-1:], least_promise=promise)
            fit = min(fit, again, key=lambda each: each.bic)
        if runs_contradict_each_other(fit) or _is_unrelated_to_drive(fit):
            # A law of many terms would hide the contradiction.
            return SearchResult(fit, (LawStep(fit, True, "given" if self.question.law_is_given else "equation"),))
        if not self.question.law_is_given and self._has_only_unlike_runs(fit):
            return SearchResult(fit, (LawStep(fit, True, "equation"),), is_unlike=True)
        if faults_first:
            return self._search_from(*self._add_faults(fit))
        coupled = self._search_with_coupling(model, fit, noisier) if hold_coordinates else None
        return coupled or self._search_from(fit, ())

    def _search_with_coupling(self, model: Model, fit: Fit, noisier: Sequence[float]) -> SearchResult | None:
        """Search with an AC coupling that the study does not state; None if the result leaves more than noise.

        Laws of several gears may compensate for a coupling; those of one gear do not. The coupling is in the model from
        the start of the search, because its effect on slow motion and that of the laws can be distinguished only
        together.
        """
        is_asked = self.question.faults and fit.model.body.n_interfaces > 1 and not is_noise(fit)
        coupling = find_coupling(fit) if is_asked else None
        if coupling is None:
            return None
        coupled = coupling.add_to(without_ground(model))
        begun = first_vector(coupled, replace(self.start, groups=coupled.groups))
        try:
            found = self.attempt(coupled, _find_start_states(coupled, begun, noisier), noisier)
        except NO_FIT:
            return None
        if not leaves_noise(found.fit):
            return None
        return replace(found, demands=(*demands_of(found.fit, coupling, fit.noise_m_per_s2), *found.demands))

    def _search_from(self, fit: Fit, demands: tuple[Demand, ...]) -> SearchResult:
        """Search laws and faults from a fit and the demands that were added to it."""
        more: tuple[Demand, ...] = ()
        ladder = self._search_laws(fit)
        ladder = (*ladder, *self._search_origins(chosen(ladder).fit))
        fit = chosen(ladder).fit
        if not is_noise(fit) or has_doubtful_ground(fit):
            fit, more = self._add_faults(fit)
        if more:
            # A sensor fault may have been fitted by a term of the law before.
            ladder = (*ladder, *self._search_laws_anew(fit))
            fit = chosen(ladder).fit
        return SearchResult(fit, ladder, (*(each for each in demands if each.name in fit.model.names), *more))

    def _search_laws_anew(self, fit: Fit) -> Ladder:
        """Search laws from those of a fit and from linear suspensions; the better result comes last."""
        ladder = self._search_laws(fit)
        linear = None if self.question.law_is_given else refit(fit, dict.fromkeys(fit.laws, LINEAR))
        if linear is None or not n_terms(fit):
            return ladder
        bare = self._search_laws(linear)
        return (*ladder, *bare) if chosen(bare).fit.bic < chosen(ladder).fit.bic else (*bare, *ladder)

    def _search_laws(self, fit: Fit, method: str = "equation", rejected: Collection[tuple[str, ...]] = ()) -> Ladder:
        if self.question.law_is_given:
            return (LawStep(fit, True, "given"),)
        ladder: Ladder = ()
        if self.question.method_of_law != "sparse regression":
            kinds = self.question.kinds
            ladder = search_laws(self.problem, fit, kinds=kinds, method=method, rejected=rejected, progress=self.say)
        if self.question.method_of_law != "pursuit":
            # The import takes two seconds, so it is made only here.
            from opid.suspensions.law_search.sparse_regression import search_by_regression

            begun = chosen(ladder).fit if ladder else fit
            method = ladder[-1].method if ladder else method
            more = search_by_regression(
                # It begins at another fit, so the stored fits of the other method do not apply.
                DrivenLaws(self.problem.settings, self.problem.least_promise),
                begun,
                kinds=self.question.kinds,
                method=method,
                settings=fit.model.settings.regression,
                progress=self.say,
            )
            ladder = (*ladder, *more)
        return ladder

    def _search_origins(self, fit: Fit) -> Ladder:
        """Search laws whose origin is not where the suspensions rest; they are kept where they are better."""
        settings, known = fit.model.settings, fit.model.settings.search
        kinds = self.question.kinds
        # A searched law describes the force well enough for this only if it nearly fits.
        if is_noise(fit) if self.question.law_is_given else is_hopeless(fit):
            return ()
        if self.question.law_is_given:
            kinds = tuple(dict.fromkeys(term.name for law in fit.laws.values() for term in law.terms))
        ladder = list[LawStep[Fit]]()
        # The squared error has a long valley: each round begins at a better fit than the one before.
        for _ in range(settings.origin.n_rounds):
            steps = search_origins(fit, kinds, least_promise=settings.fit.promise_in_search)
            best: LawStep[Fit] | None = None
            for step in steps:
                than = best.fit if best else fit
                if is_better(step.fit, than, known) or _is_explained_by_origin(step.fit, than, known):
                    best = step
            ladder += [step for step in steps if step is not best]
            if best is None:
                break
            more: Ladder = (replace(best, kept=True),)
            if not self.question.law_is_given:
                more = search_laws(self.problem, best.fit, kinds=kinds, method=best.method, progress=self.say)
            ladder, fit = [*ladder, *more], chosen(more).fit
        return tuple(ladder)

    def _add_faults(self, fit: Fit, before: tuple[Demand, ...] = ()) -> tuple[Fit, tuple[Demand, ...]]:
        """Add the demands of the runs to a fit, and remove earlier ones that the runs no longer demand."""
        if (
            not self.question.faults
            or runs_contradict_each_other(fit)
            or _is_unrelated_to_drive(fit)
            or is_of_others(fit)
        ):
            return fit, ()
        for earlier, answer in self.asked:
            if not before and is_same_minimum(fit, earlier):
                # Several attempts end at the same minimum, so the demands are found only once there.
                return answer if answer[1] else (fit, ())
        answer = add_faults(fit, before, ground=self.question.ground, start=self.start, progress=self.say)
        if not before:
            self.asked.append((fit, answer))
        return answer

    def with_all_readings(self, found: SearchResult, runs: tuple[DrivenRun, ...]) -> SearchResult:
        """Return the end of a search fitted to all samples, with the laws and faults that only these show."""
        found = replace(found, problem=None if self.question.law_is_given else self.problem)
        fit, ladder, demands = found.fit, found.ladder, found.demands
        whole, known = replace(fit.model, runs=runs), fit.model.settings.fit
        is_coarse = fit.model.runs is not runs
        is_only_unlike = found.is_unlike and len(ladder) == 1
        if is_hopeless(fit) or runs_contradict_each_other(fit) or _is_unrelated_to_drive(fit) or is_only_unlike:
            most, promise = known.most_hopeless_evaluations, known.promise_from_afar
            try:
                near = fit_model(whole, fit.theta, most_evaluations=most, least_promise=promise) if is_coarse else fit
            except NO_FIT:
                # No numbers of a refused structure are reported, so the fit at the coarse rate is kept.
                near = fit
            return replace(found, fit=near)
        rejected = _find_rejected_laws(ladder) if is_coarse else set()
        coarse, fit = fit, fit_model(whole, fit.theta)
        if is_coarse and (is_noise(fit) or not is_noise(coarse)):
            # The ranking of the candidates at the coarse rate holds here, too, unless that rate hid something.
            self.problem.rank_as(fit, coarse)
        finer = _with_more_steps(fit, demands)
        if finer is not fit:
            # Laws and faults may have compensated for steps that were too long.
            fit, demands, is_coarse, rejected = finer, (), True, set()
        late = bool(demands)
        for _ in range(2):
            if not self.question.law_is_given and (is_coarse or late):
                more = self._search_laws(fit, "pursuit", rejected)
                ladder = (*ladder, *more)
                fit = chosen(more).fit
                fit = fit if fit is more[0].fit else fit_model(fit.model, fit.theta)
            before = demands
            fit, demands = self._add_faults(fit, demands)
            late = {demand.name for demand in demands} != {demand.name for demand in before}
            rejected = set() if late else rejected
            if not late:
                break
        return replace(found, fit=fit, ladder=ladder, demands=demands)


def judge_search(found: SearchResult, question: Question) -> SearchResult:
    """Return the end of a search, its law checked by runs that are left out, with the closest other laws.

    The laws are compared at a coarse rate, at which all of them were fitted.

    Args:
        found: the result of `find_model`.
        question: what was tried.
    """
    fit = found.fit
    if is_hopeless(fit) or _is_unrelated_to_drive(fit):
        return found if question.law_is_given else _with_fewer_terms(found)
    settings = fit.model.settings
    problem = found.problem or DrivenLaws(settings.search, settings.fit.promise_in_search)
    coarse = _fit_at_coarse_rate(fit)
    method = next((step.method for step in reversed(found.ladder) if step.fit.law_key == fit.law_key), "pursuit")
    ladder: Ladder = (LawStep(coarse, True, method),)
    if not question.law_is_given:
        smaller = [step for step in _select_comparable_steps(found.ladder, coarse) if n_terms(step.fit) < n_terms(fit)]
        if smaller:
            best = min(smaller, key=lambda step: step.fit.bic)
            again = refit(coarse, best.fit.laws, least_promise=settings.fit.promise_in_search)
            ladder = (*([] if again is None else [LawStep(again, False, best.method)]), *ladder)
        if len(fit.model.groups) == 1:
            # Neighbours are fitted for one gear only: with several suspensions each further fit takes long, and the
            # structure matters more than the closest other laws.
            far = find_surely_behind((*_select_comparable_steps(found.ladder, coarse), *ladder), settings.search)
            ladder = add_neighbours(problem, ladder, kinds=question.kinds, known=far)
    ladder = judge_by_left_out(problem, ladder)
    best_fit = chosen(ladder).fit
    laws = best_fit.laws if best_fit.law_key != fit.law_key else {}
    changed, theta = with_laws(fit, laws)
    if laws or changed.slips != fit.model.forgets:
        # No other law is compared with this fit, so the first periods may be left out now.
        fit = fit_model(replace(changed, forgets=changed.slips), theta)
    # The ladder holds all laws at the same rate.
    on_ladder = {step.fit.law_key for step in ladder}
    tried = [step for step in _select_comparable_steps(found.ladder, coarse) if step.fit.law_key not in on_ladder]
    story = [*{step.fit.law_key: replace(step, kept=False) for step in tried}.values(), *ladder]
    return replace(found, fit=fit, ladder=tuple(story))


def _select_comparable_steps(ladder: Ladder, fit: Fit) -> Ladder:
    """Return the steps at the rate of a fit and with the same samples, so that the criteria can be compared."""
    fs, forgets = fit.model.runs[0].fs, fit.model.forgets
    return tuple(step for step in ladder if step.fit.model.runs[0].fs == fs and step.fit.model.forgets == forgets)


def _forget_if_given(model: Model, question: Question) -> Model:
    """Return the model; if its laws were given and have sliders, the first periods are not compared."""
    return replace(model, forgets=question.law_is_given and model.slips)


def leaves_noise(fit: Fit) -> bool:
    """Return whether a fit leaves no more than sensor noise; if the noise is not stated, the residual must be white.

    Args:
        fit: a fitted model.
    """
    if not is_noise(fit):
        return False
    is_stated = all(facts.noise_m_per_s2 for side in SIDES for facts in fit.model.sensors.facts(side))
    return is_stated or measure_whiteness(fit).white


def _with_fewer_terms(found: SearchResult) -> SearchResult:
    """Return the search with the smallest law that leaves hardly more, because no law explains these runs."""
    fit, known = found.fit, found.fit.model.settings.search
    chosen_step = next((step for step in found.ladder if step.fit.law_key == fit.law_key), None)
    if chosen_step is None:
        return found
    largest = (1 + known.overfit_fraction) * chosen_step.fit.error_rms
    alike = [step for step in _select_comparable_steps(found.ladder, chosen_step.fit) if step.fit.error_rms <= largest]
    best = min(alike, key=lambda step: (n_terms(step.fit), step.fit.error_rms))
    if n_terms(best.fit) == n_terms(fit):
        return found
    again = refit(fit, best.fit.laws)
    if again is None or again.error_rms > (1 + known.overfit_fraction) * fit.error_rms:
        return found
    return _end_with(found, best, again)


def asks_for_law(fit: Fit, kinds: Sequence[str]) -> bool:
    """Return whether a law of the library is expected to explain a part of what a fit leaves.

    No law is expected to explain an unmeasured force.

    Args:
        fit: a fit whose law was not searched.
        kinds: the kinds of terms that a law may have.
    """
    dictionaries = DrivenLaws(fit.model.settings.search, fit.model.settings.fit.promise_in_search).dictionaries(
        fit, kinds
    )
    expected = max((each.largest_expected_gain() for each in dictionaries.values()), default=0.0)
    return expected > fit.model.settings.process.most_promised


def with_laws_of(found: SearchResult, weighed: Fit, question: Question, progress: Say | None = None) -> SearchResult:
    """Return the end of a search with laws that are searched under process noise.

    Unmeasured forces hide the improvement that a law brings: without process noise all laws leave about as much.

    Args:
        found: the end of a search in which laws were not searched because the first fit left too much.
        weighed: a fit of the same runs with process noise.
        question: what may be tried.
        progress: called with the name of each law before it is fitted.
    """
    problem = DrivenLaws(weighed.model.settings.search, weighed.model.settings.fit.promise_in_search)
    laws = search_laws(problem, weighed, kinds=question.kinds, progress=progress)
    again = refit(found.fit, chosen(laws).fit.laws)
    if again is None or is_impossible(again) or again.law_key == found.fit.law_key:
        return found
    return _end_with(found, LawStep(again, True, "pursuit"), again)


def with_simpler_laws(found: SearchResult, kinds: Sequence[str]) -> Iterator[SearchResult]:
    """Yield the end of a search with one term less in its laws, also with another friction with memory.

    Args:
        found: the end of a search whose law compensates for something that the model lacks.
        kinds: the kinds that may replace a friction with memory.
    """
    fit, known = found.fit, found.fit.model.settings.process
    simpler = [
        (name, Law(tuple(each for each in law.terms if each is not term), law.rest_m))
        for name, law in fit.laws.items()
        for term in law.terms
        if len(law.terms) > 1
    ]
    simpler += [(name, each) for name, law in simpler for each in relatives(law, kinds)]
    for name, law in simpler:
        again = refit(fit, {name: law})
        if (
            again is not None
            and not is_impossible(again)
            and again.error_rms < known.most_left_by_simpler * fit.error_rms
        ):
            yield _end_with(found, LawStep(again, False, "pursuit"), again)


def _end_with(found: SearchResult, last: LawStep[Fit], fit: Fit) -> SearchResult:
    """Return the end of a search with another chosen step and the fit of its laws."""
    ladder = (*(replace(step, kept=False) for step in found.ladder if step is not last), replace(last, kept=True))
    return replace(found, fit=fit, ladder=ladder)


def _is_explained_by_origin(fit: Fit, than: Fit, known: SearchSettings) -> bool:
    """Whether laws about another origin fit as well as others with even terms about the rest position.

    A cubic term about the unloaded length is a cubic and a quadratic term about the rest position, but it also gives
    the distance between the two.
    """
    is_even = any(term.kind.is_even for law in than.laws.values() for term in law.terms)
    return is_even and n_terms(fit) <= n_terms(than) and fit.bic < than.bic + known.alike_bic


def _is_as_likely(fit: Fit, other: Fit) -> bool:
    """Whether two fits have the same laws, sensors and criterion: two different minima are hardly ever as deep."""
    is_alike = fit.model.names == other.model.names and fit.law_key == other.law_key
    return is_alike and abs(fit.bic - other.bic) < fit.model.settings.search.alike_bic


def _fit_at_coarse_rate(fit: Fit) -> Fit:
    """Return the fit at a coarse rate; unchanged if the body moves too fast for that rate."""
    model, known = fit.model.coarse, fit.model.settings.fit
    fs = model.runs[0].fs
    is_fast = (
        fastest_rate(fit.model, fit.theta) > known.fastest * fs or turnover_rate(fit) > known.turnover_in_step * fs
    )
    if model is fit.model or is_fast:
        return fit
    try:
        return fit_model(model, fit.theta, least_promise=known.promise_in_search)
    except NO_FIT:
        return fit


def _find_rejected_laws(ladder: Ladder) -> set[tuple[str, ...]]:
    """Return the names of the laws that need not be tried again at the full rate, with the final sensor faults."""
    model = chosen(ladder).fit.model
    alike = [
        step
        for step in _select_comparable_steps(ladder, chosen(ladder).fit)
        if step.fit.model.runs is model.runs and step.fit.model.sensors == model.sensors
    ]
    return find_far_behind(alike, model.settings.search) | find_surely_behind(alike, model.settings.search)


def _with_more_steps(fit: Fit, demands: Sequence[Demand]) -> Fit:
    """Return a fit with steps short enough for its friction, and without demands; unchanged if they already are."""
    known, run = fit.model.settings.fit, fit.model.runs[0]
    by = int(np.ceil(turnover_rate(fit) / (known.turnover_in_step * run.fs)))
    if by <= 1:
        return fit
    by, model = min(by, known.most_steps), fit.model
    for demand in demands:
        model = demand.hypothesis.remove_from(model)
    finer = replace(model, runs=tuple(run.sample_finer(by) for run in model.runs))
    try:
        return fit_model(finer, carry_over(fit, finer))
    except NO_FIT:
        return fit


def _find_start_states(model: Model, theta: FloatArray, noisier: Sequence[float]) -> FloatArray:
    """Return the vector with the initial state of each run searched on a grid, for one gear.

    The search uses the noise that an attempt begins with. With several interfaces the grid would be too large.
    """
    if model.body.n_attachments > 1:
        return theta
    factor = noisier[0] if noisier else 1.0
    return look_for_start(replace(model, louder=factor), theta)


def _is_too_fast(fit: Fit) -> bool:
    """Whether a fitted body moves too fast for the steps of its model, or grows without bound."""
    try:
        return fastest_rate(fit.model, fit.theta) > fit.model.settings.fit.fastest * fit.model.runs[0].fs
    except NO_FIT:
        return True


def _take_strongest_pieces(model: Model) -> Model:
    """Return the model of the strongest piece of each run; unchanged if the runs are no longer than that."""
    runs = tuple(run.strongest_piece(model.settings.fit.hopeless_piece_s) for run in model.runs)
    return model if runs == model.runs else replace(model, runs=runs)


def _drop_laws(model: Model, theta: FloatArray) -> FloatArray:
    """Return the vector without the entries of the laws."""
    gone = [np.arange(theta.size)[model.law_indices(number)] for number in range(len(model.groups))]
    return np.delete(theta, np.concatenate(gone))


def _reduce_rate(model: Model, theta: FloatArray) -> Model:
    """Return the model at a coarse rate; unchanged if the motion is too fast or would be aliased into the band."""
    coarse, known = model.coarse, model.settings.fit
    if coarse is model or fastest_rate(model, theta) > known.fastest * coarse.runs[0].fs:
        return model
    predictions = model.evaluate(theta, sensitivity=False).predictions
    folded = [
        measure_folded_power(prediction.innovation[model.compared], run, thinned)
        for prediction, run, thinned in zip(predictions, model.runs, coarse.runs, strict=True)
    ]
    return coarse if max(folded) < known.most_folded else model


def measure_folded_power(innovation: FloatArray, run: DrivenRun, thinned: DrivenRun) -> float:
    """Return the power of the prediction errors that a coarse rate aliases into the band, over that of the noise.

    Args:
        innovation: (n_sensors, n) whitened prediction errors of the run.
        run: the run.
        thinned: the same run at the coarse rate.
    """
    frequency_hz = fft.rfftfreq(run.n_samples, 1 / run.fs)
    into_hz = np.abs(frequency_hz - thinned.fs * np.round(frequency_hz / thinned.fs))
    folds = (frequency_hz > thinned.fs / 2) & (into_hz <= thinned.omega[-1] / (2 * np.pi))
    power = np.abs(fft.rfft(innovation)[:, folds]) ** 2 / run.n_samples
    return float(power.mean(axis=1).max())
