"""The way from start values to a fitted model: from afar, among laws and faults of sensors, then with all readings.

Until laws are found runs are taken at a coarse rate, where its steps follow the body and nothing that the model does
not predict would fold into the band. Where neither laws nor faults promise to mend what is left, the search ends.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import fft

from opid.mechanics.laws.law import LAWS, LINEAR, Law, default_law
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.faults import (
    Demand,
    demands_of,
    let_in,
    may_hold_a_needless_ground,
    promising_coupling,
    without_ground,
)
from opid.suspensions.fitting.fit import (
    NO_FIT,
    Fit,
    carried_over,
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
from opid.suspensions.fitting.repeatability import mends_much, with_departures
from opid.suspensions.fitting.start import Start, look_for_start, start_values
from opid.suspensions.law_search.driven import DrivenLaws, cannot_be, search_origins
from opid.suspensions.law_search.pursuit import (
    LawStep,
    add_neighbours,
    chosen,
    far_behind,
    is_better,
    judge_by_left_out,
    library,
    n_terms,
    relatives,
    search_laws,
    surely_behind,
)
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.run import DrivenRun
from opid.suspensions.sensor_facts import SIDES
from opid.suspensions.settings import SearchSettings, Settings

Say = Callable[[str], None]
Ladder = tuple[LawStep[Fit], ...]


@dataclass(frozen=True, eq=False)
class Found:
    """Where a search ended.

    Args:
        fit: of the model.
        ladder: laws that were tried, the chosen one last among those that were kept.
        demands: what was let in beside the suspensions.
        n_starts: attempts that were made.
        is_unlike: whether the search ended because the suspensions are not the same in all runs.
        problem: what laws were searched on, with what was asked of it; None where they were given.
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
        law_is_given: whether the laws of the model are those asked for; else laws are searched.
        ground: whether springs to the ground may be let in.
        faults: whether unstated faults of sensors may be let in.
        method_of_law: one of `METHODS_OF_LAW`: how laws are searched.
        kinds: of law that may enter.
        repeatability: of springs, damping and friction from run to run: a search that takes them to be the same ends
            where they are not.
    """

    law_is_given: bool = False
    ground: bool = True
    faults: bool = True
    method_of_law: str = "pursuit"
    kinds: tuple[str, ...] = field(default_factory=library)
    repeatability: float = 0.0


def find_model(model: Model, start: Start, question: Question, *, progress: Say | None = None) -> Found:
    """Fit a model from start values, with laws and faults of sensors as the runs demand them.

    Args:
        model: the body, its runs and first laws.
        start: where to begin.
        question: what may be tried.
        progress: called with the name of each step as it begins.

    Raises:
        UnboundedResponseError: the start values make a suspension that grows without bound.
        ImpossibleBodyError: the start values make a mass matrix that is not positive definite.
    """
    search = _Search(start, question, progress or (lambda step: None), model.settings)
    model = _forgetting_if_given(model, question)
    theta = first_vector(model, start)
    coarse = _at_coarse_rate(model, theta)
    found: Found | None = None
    try:
        found = search.find(coarse, theta)
    except NO_FIT:
        if coarse is model:
            raise
    if coarse is not model and (found is None or _is_too_fast(found.fit)):
        # with shorter steps the search may end elsewhere
        first = search.first_fit(model, theta)
        if found is None or not is_hopeless(found.fit) or first is None or not explains_nothing(first):
            found = search.try_several(model, theta, first)
    assert found is not None  # one of both searches has ended, or an error was raised
    return search.with_all_readings(found, model.runs)


def find_from_reference(
    model: Model, reference: Fit, start: Start, question: Question, *, progress: Say | None = None
) -> Found | None:
    """Fit a model from a fit of the runs without loading: where the others rest depends on a mass not known yet.

    Args:
        model: of all runs.
        reference: of its runs without loading, the mass not fitted.
        start: of the same runs.
        question: what may be tried.
        progress: called with the name of each step as it begins.

    Returns:
        Where the search ended; None where no mass lets the springs carry the loadings.
    """
    search = _Search(start, question, progress or (lambda step: None), model.settings)
    grown = replace(model, groups=reference.groups, sensors=reference.model.sensors, forgets=reference.model.forgets)
    grown = grown.coarse
    # a load that was only moved changes no mass, but moments
    largest = max(abs(float(run.loading[0, 0])) for run in model.runs)
    largest = largest or max(float(np.abs(run.loading).max()) for run in model.runs)
    best: tuple[float, FloatArray] | None = None
    for fraction in np.geomspace(*model.settings.fit.mass_fractions, model.settings.fit.n_mass_fractions):
        values = dict(zip(reference.model.names, reference.theta.tolist(), strict=False))
        values["inverse_mass"] = float(fraction) / largest
        shared = [values[name] for name in grown.names]
        theta = np.array([*shared, *np.zeros(grown.bounds()[0].size - len(shared))])
        theta = _begun(grown, theta, model.settings.fit.noisier[-1])
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


def begins_in_vain(model: Model, start: Start, question: Question) -> bool:
    """Return whether the first fit from start values explains nothing of the motion.

    Args:
        model: the body, its runs and first laws.
        start: where to begin.
        question: what may be tried.
    """
    model = _forgetting_if_given(model, question)
    theta = first_vector(model, start)
    search = _Search(start, question, lambda step: None, model.settings)
    first = search.first_fit(_at_coarse_rate(model, theta), theta)
    return first is not None and explains_nothing(first)


def is_likelier(fit: Fit, than: Fit) -> bool:
    """Return whether a fit takes the place of another by its criterion.

    Where one of them forgets the first periods the criteria do not compare: it must leave no more than noise.

    Args:
        fit: that may take the place.
        than: the other one, of the same runs.
    """
    if fit.model.forgets != than.model.forgets:
        forgetful = fit if fit.model.forgets else than
        if not is_noise(forgetful):
            return forgetful is than
    return fit.bic < than.bic


def is_hopeless(fit: Fit) -> bool:
    """Return whether a fit leaves what is beyond the mending of laws.

    Args:
        fit: of any laws.
    """
    return fit.ratio > fit.model.settings.verdicts.refused


def _shares_nothing(fit: Fit) -> bool:
    """Whether the body moves as if it knew nothing of what is below it: no law and no fault of a sensor mends that."""
    runs, known = fit.model.runs, fit.model.settings.search
    return fit.model.body.n_interfaces == 1 and max(run.shared_fraction for run in runs) < known.least_shared


class _Search:
    def __init__(self, start: Start, question: Question, say: Say, settings: Settings) -> None:
        self.start, self.question, self.say = start, question, say
        self.problem = DrivenLaws(settings.search, settings.fit.promise_in_search)
        self.asked: list[tuple[Fit, tuple[Fit, tuple[Demand, ...]]]] = []

    def find(self, model: Model, theta: FloatArray) -> Found:
        """Where the search ends.

        While a fit leaves what no law is likely to mend, attempts are made on the strongest piece of each run: a wrong
        structure is refused after a fraction of the time.
        """
        first = self.first_fit(model, theta)
        if first is None or not is_hopeless(first) or runs_contradict_each_other(first) or _shares_nothing(first):
            return self.try_several(model, theta, first)
        pieces = _strongest_pieces(model)
        if pieces is model:
            return self.try_several(model, theta, first)
        # what an AC coupling takes away is slow: pieces of some seconds hardly show it
        coupled = self._coupled(model, first, model.settings.fit.noisier[0])
        if coupled is not None:
            return coupled
        try:
            on_pieces = self.try_several(pieces, theta)
            found = self._on_whole_runs(on_pieces, model)
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

    def _is_possible(self, found: Found) -> bool:
        """Whether an answer can have the laws that were found; laws that were given are those asked for."""
        return self.question.law_is_given or not cannot_be(found.fit)

    def first_fit(self, model: Model, theta: FloatArray) -> Fit | None:
        """The fit that the first attempt begins with; None where start values make no body that the runs can drive."""
        noisier, promise = model.settings.fit.noisier[0], model.settings.fit.promise_in_search
        try:
            return fit_model(model, _begun(model, theta, noisier), noisier=noisier, least_promise=promise)
        except NO_FIT:
            return None

    def _on_whole_runs(self, found: Found, model: Model) -> Found:
        """Where a search on pieces ended, fitted to the whole runs; laws and faults are searched on from there."""
        fit, noisier = found.fit, model.settings.fit.noisier[-1]
        whole = replace(fit.model, runs=model.runs)
        theta = np.concatenate([fit.theta[: fit.model.n_shared], np.zeros(fit.model.n_own * len(model.runs))])
        promise = model.settings.fit.promise_in_search
        again = fit_model(whole, _begun(whole, theta, noisier), noisier=noisier, least_promise=promise)
        if is_hopeless(again):
            return replace(found, fit=again)
        if found.is_unlike:
            return replace(found, fit=again, ladder=(LawStep(again, True, chosen(found.ladder).method),))
        # what a demand mended of the pieces it is taken to mend of the whole runs
        louder = again.noise_m_per_s2 / fit.noise_m_per_s2
        demands = tuple(replace(each, error_before=louder * each.error_before) for each in found.demands)
        return replace(self._searched(again, demands), n_starts=found.n_starts)

    def try_several(self, model: Model, theta: FloatArray, first: Fit | None = None) -> Found:
        """The first attempt, and others while what is left is more than noise: minima differ.

        Args:
            model: to fit.
            theta: where to begin.
            first: the fit that the first attempt begins with, where it is known.
        """
        noisier = model.settings.fit.noisier
        bare = replace(model, groups=tuple(replace(group, law=LINEAR) for group in model.groups))
        searched = not self.question.law_is_given
        attempts: list[Callable[[], Found]] = [
            lambda: self.attempt(model, theta if first else _begun(model, theta, noisier[0]), noisier[0], first=first)
        ]
        if searched and any(group.law.terms for group in model.groups):
            attempts.append(lambda: self.attempt(bare, _without_laws(model, theta), noisier[0]))
        n_sure = len(attempts)
        attempts += [lambda each=each: self.attempt(model, theta, each, hold_coordinates=False) for each in noisier[1:]]  # type: ignore[misc]
        n_without_faults = len(attempts)
        attempts += [lambda: self.attempt(model, theta, noisier[0], faults_first=True)] * self.question.faults
        best: Found | None = None
        last: Found | None = None
        failed: Exception | None = None
        n_starts = 0
        is_confirmed = False
        for number, attempt in enumerate(attempts):
            if best is not None and leaves_noise(best.fit):
                break
            if best is not None and n_starts >= n_sure and (is_hopeless(best.fit) or is_of_others(best.fit)):
                break
            if best is not None and (runs_contradict_each_other(best.fit) or _shares_nothing(best.fit)):
                break
            if n_starts == 1 and best is not None and self._are_unlike(best.fit):
                # other attempts would make up for what is not the same in all runs
                return replace(best, n_starts=1, is_unlike=True)
            if best is not None and is_confirmed and (number < n_without_faults or best.demands):
                # two attempts ended at one minimum; one that let faults in searched its laws anew, as with faults first
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
                # such a law no search would take; the start values had it
                last = last or found
                continue
            is_confirmed = is_confirmed or (best is not None and _is_as_likely(found.fit, best.fit))
            best = found if best is None or found.fit.bic < best.fit.bic else best
        best = best or last
        if best is None:
            assert failed is not None  # no attempt without a fit or an error
            raise failed
        own = self._from_own_equation(model, best)
        best = own if own is not None and is_likelier(own.fit, best.fit) else best
        return replace(best, n_starts=n_starts + (own is not None))

    def _from_own_equation(self, model: Model, best: Found) -> Found | None:
        """Where a search ends that begins with a friction that remembers; None where that leaves more than noise.

        It is asked where the best law has such a friction and leaves more: that one is tried anew, then a joint of
        sliders. Far from its parameters such a law has many wrong minima, and its own equation leads to the right one.
        What each slider held at first nobody knows, so the first periods are not compared.
        """
        terms = [term for law in best.fit.laws.values() for term in law.terms]
        kinds = [term.name for term in terms if term.kind.memory is not None and term.kind.is_friction]
        if not kinds or self.question.law_is_given or leaves_noise(best.fit):
            return None
        if explains_nothing(best.fit) or _shares_nothing(best.fit) or runs_contradict_each_other(best.fit):
            # no law mends that
            return None
        noisier, settings = model.settings.fit.noisier[0], model.settings.start
        for kind in dict.fromkeys([*kinds, *(name for name in self.question.kinds if LAWS[name].slips)]):
            groups = tuple(replace(group, law=default_law(kind)) for group in model.groups)
            start = start_values(model.runs, model.body, groups, mass_free=model.mass_free, settings=settings)
            begun = replace(model, groups=start.groups, forgets=LAWS[kind].slips)
            try:
                found = self.attempt(begun, _begun(begun, first_vector(begun, start), noisier), noisier)
            except NO_FIT:
                continue
            if is_noise(found.fit):
                return found
        return None

    def _are_unlike(self, fit: Fit) -> bool:
        """Whether letting springs, damping and friction of each run go mends much."""
        return self._can_depart(fit) and mends_much(with_departures(fit, self.question.repeatability), fit)

    def _are_only_unlike(self, fit: Fit) -> bool:
        """Whether it mends all that is left: no other law is then asked to make up for it."""
        if is_noise(fit) or is_hopeless(fit) or not self._can_depart(fit):
            return False
        freed = with_departures(fit, self.question.repeatability)
        return is_noise(freed) and mends_much(freed, fit)

    def _can_depart(self, fit: Fit) -> bool:
        """Whether the runs may differ, and were taken to be alike."""
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
    ) -> Found:
        """The fit that start values, or a first fit, lead to, with the laws and faults that were tried on it."""
        promise = model.settings.fit.promise_in_search
        fit = first or fit_model(
            model, theta, noisier=noisier, hold_coordinates=hold_coordinates, least_promise=promise
        )
        if model.body.n_attachments == 1 and not is_noise(fit):
            # with better parameters another start may predict the first seconds better
            begun = _begun(model, fit.theta, noisier)
            again = fit_model(model, begun, noisier=noisier[-1:], least_promise=promise)
            fit = min(fit, again, key=lambda each: each.bic)
        if runs_contradict_each_other(fit) or _shares_nothing(fit):
            # a law of many terms would hide it
            return Found(fit, (LawStep(fit, True, "given" if self.question.law_is_given else "equation"),))
        if not self.question.law_is_given and self._are_only_unlike(fit):
            return Found(fit, (LawStep(fit, True, "equation"),), is_unlike=True)
        if faults_first:
            return self._searched(*self._let_in(fit))
        coupled = self._coupled(model, fit, noisier) if hold_coordinates else None
        return coupled or self._searched(fit, ())

    def _coupled(self, model: Model, fit: Fit, noisier: Sequence[float]) -> Found | None:
        """Where the search ends with an AC coupling that nobody stated; None where that leaves more than noise.

        Laws of several gears may hide it; those of one gear hide none. It is taken for granted from the start, for what
        it takes from slow motion and laws are told apart only together.
        """
        is_asked = self.question.faults and fit.model.body.n_interfaces > 1 and not is_noise(fit)
        coupling = promising_coupling(fit) if is_asked else None
        if coupling is None:
            return None
        coupled = coupling.added_to(without_ground(model))
        begun = first_vector(coupled, replace(self.start, groups=coupled.groups))
        try:
            found = self.attempt(coupled, _begun(coupled, begun, noisier), noisier)
        except NO_FIT:
            return None
        if not leaves_noise(found.fit):
            return None
        return replace(found, demands=(*demands_of(found.fit, coupling, fit.noise_m_per_s2), *found.demands))

    def _searched(self, fit: Fit, demands: tuple[Demand, ...]) -> Found:
        """Where a search for laws and faults ends that begins with a fit, and what was let into it."""
        more: tuple[Demand, ...] = ()
        ladder = self._laws(fit)
        ladder = (*ladder, *self._origins(chosen(ladder).fit))
        fit = chosen(ladder).fit
        if not is_noise(fit) or may_hold_a_needless_ground(fit):
            fit, more = self._let_in(fit)
        if more:
            # what was wrong with the sensors may have been taken for a term of the law
            ladder = (*ladder, *self._laws_anew(fit))
            fit = chosen(ladder).fit
        return Found(fit, ladder, (*(each for each in demands if each.name in fit.model.names), *more))

    def _laws_anew(self, fit: Fit) -> Ladder:
        """Laws searched from those of a fit, and from none: the better of both."""
        ladder = self._laws(fit)
        linear = None if self.question.law_is_given else refit(fit, dict.fromkeys(fit.laws, LINEAR))
        if linear is None or not n_terms(fit):
            return ladder
        bare = self._laws(linear)
        return (*ladder, *bare) if chosen(bare).fit.bic < chosen(ladder).fit.bic else (*bare, *ladder)

    def _laws(self, fit: Fit, method: str = "equation", rejected: Collection[tuple[str, ...]] = ()) -> Ladder:
        if self.question.law_is_given:
            return (LawStep(fit, True, "given"),)
        ladder: Ladder = ()
        if self.question.method_of_law != "sparse regression":
            kinds = self.question.kinds
            ladder = search_laws(self.problem, fit, kinds=kinds, method=method, rejected=rejected, progress=self.say)
        if self.question.method_of_law != "pursuit":
            # two seconds to import, so only here
            from opid.suspensions.law_search.sparse_regression import search_by_regression

            begun = chosen(ladder).fit if ladder else fit
            method = ladder[-1].method if ladder else method
            more = search_by_regression(
                # it begins elsewhere, so what the other method fitted is no answer
                DrivenLaws(self.problem.settings, self.problem.least_promise),
                begun,
                kinds=self.question.kinds,
                method=method,
                settings=fit.model.settings.regression,
                progress=self.say,
            )
            ladder = (*ladder, *more)
        return ladder

    def _origins(self, fit: Fit) -> Ladder:
        """Laws about another origin than where the suspensions rest; kept where they are better."""
        settings, known = fit.model.settings, fit.model.settings.search
        kinds = self.question.kinds
        # of laws that are searched, only those that nearly fit stand for a force
        if is_noise(fit) if self.question.law_is_given else is_hopeless(fit):
            return ()
        if self.question.law_is_given:
            kinds = tuple(dict.fromkeys(term.name for law in fit.laws.values() for term in law.terms))
        ladder = list[LawStep[Fit]]()
        # along a valley of laws alike each fit tells better where the next one begins
        for _ in range(settings.origin.n_rounds):
            steps = search_origins(fit, kinds, least_promise=settings.fit.promise_in_search)
            best: LawStep[Fit] | None = None
            for step in steps:
                than = best.fit if best else fit
                if is_better(step.fit, than, known) or _says_why_it_is_uneven(step.fit, than, known):
                    best = step
            ladder += [step for step in steps if step is not best]
            if best is None:
                break
            more: Ladder = (replace(best, kept=True),)
            if not self.question.law_is_given:
                more = search_laws(self.problem, best.fit, kinds=kinds, method=best.method, progress=self.say)
            ladder, fit = [*ladder, *more], chosen(more).fit
        return tuple(ladder)

    def _let_in(self, fit: Fit, before: tuple[Demand, ...] = ()) -> tuple[Fit, tuple[Demand, ...]]:
        """The fit with what the runs demand, and without what they demanded before and no longer do."""
        if not self.question.faults or runs_contradict_each_other(fit) or _shares_nothing(fit) or is_of_others(fit):
            return fit, ()
        for earlier, answer in self.asked:
            if not before and is_same_minimum(fit, earlier):
                # several attempts end at one minimum: what the runs demand there is asked once
                return answer if answer[1] else (fit, ())
        answer = let_in(fit, before, ground=self.question.ground, start=self.start, progress=self.say)
        if not before:
            self.asked.append((fit, answer))
        return answer

    def with_all_readings(self, found: Found, runs: tuple[DrivenRun, ...]) -> Found:
        """A fit at a coarse rate, and the laws that were tried, with all readings."""
        found = replace(found, problem=None if self.question.law_is_given else self.problem)
        fit, ladder, demands = found.fit, found.ladder, found.demands
        whole, known = replace(fit.model, runs=runs), fit.model.settings.fit
        is_coarse = fit.model.runs is not runs
        is_only_unlike = found.is_unlike and len(ladder) == 1
        if is_hopeless(fit) or runs_contradict_each_other(fit) or _shares_nothing(fit) or is_only_unlike:
            most, promise = known.most_hopeless_evaluations, known.promise_from_afar
            try:
                near = fit_model(whole, fit.theta, most_evaluations=most, least_promise=promise) if is_coarse else fit
            except NO_FIT:
                # a refused structure has no numbers, so the fit at the coarse rate is kept
                near = fit
            return replace(found, fit=near)
        rejected = _rejected(ladder) if is_coarse else set()
        coarse, fit = fit, fit_model(whole, fit.theta)
        if is_coarse and (is_noise(fit) or not is_noise(coarse)):
            # unless the coarse rate hid something, the candidates beside the laws are ranked
            self.problem.rank_as(fit, coarse)
        finer = _with_more_steps(fit, demands)
        if finer is not fit:
            # laws and faults may have made up for steps that were too long
            fit, demands, is_coarse, rejected = finer, (), True, set()
        late = bool(demands)
        for _ in range(2):
            # what only all readings together show
            if not self.question.law_is_given and (is_coarse or late):
                more = self._laws(fit, "pursuit", rejected)
                ladder = (*ladder, *more)
                fit = chosen(more).fit
                fit = fit if fit is more[0].fit else fit_model(fit.model, fit.theta)
            before = demands
            fit, demands = self._let_in(fit, demands)
            late = {demand.name for demand in demands} != {demand.name for demand in before}
            rejected = set() if late else rejected
            if not late:
                break
        return replace(found, fit=fit, ladder=ladder, demands=demands)


def judged(found: Found, question: Question) -> Found:
    """Return where a search ended, its choice judged by runs left out, with the laws that come closest to it.

    The laws are compared at a coarse rate, where all of them were fitted.

    Args:
        found: of `find_model`.
        question: what was tried.
    """
    fit = found.fit
    if is_hopeless(fit) or _shares_nothing(fit):
        return found if question.law_is_given else _with_fewer_terms(found)
    settings = fit.model.settings
    problem = found.problem or DrivenLaws(settings.search, settings.fit.promise_in_search)
    coarse = _thinned(fit)
    method = next((step.method for step in reversed(found.ladder) if step.fit.law_key == fit.law_key), "pursuit")
    ladder: Ladder = (LawStep(coarse, True, method),)
    if not question.law_is_given:
        smaller = [step for step in _of_same_data(found.ladder, coarse) if n_terms(step.fit) < n_terms(fit)]
        if smaller:
            best = min(smaller, key=lambda step: step.fit.bic)
            again = refit(coarse, best.fit.laws, least_promise=settings.fit.promise_in_search)
            ladder = (*([] if again is None else [LawStep(again, False, best.method)]), *ladder)
        if len(fit.model.groups) == 1:
            # of several suspensions a reader asks for the structure first, and each further fit is long
            far = surely_behind((*_of_same_data(found.ladder, coarse), *ladder), settings.search)
            ladder = add_neighbours(problem, ladder, kinds=question.kinds, known=far)
    ladder = judge_by_left_out(problem, ladder)
    best_fit = chosen(ladder).fit
    laws = best_fit.laws if best_fit.law_key != fit.law_key else {}
    changed, theta = with_laws(fit, laws)
    if laws or changed.slips != fit.model.forgets:
        # no law is compared with it any more
        fit = fit_model(replace(changed, forgets=changed.slips), theta)
    # the whole story, told at one rate
    on_ladder = {step.fit.law_key for step in ladder}
    tried = [step for step in _of_same_data(found.ladder, coarse) if step.fit.law_key not in on_ladder]
    story = [*{step.fit.law_key: replace(step, kept=False) for step in tried}.values(), *ladder]
    return replace(found, fit=fit, ladder=tuple(story))


def _of_same_data(ladder: Ladder, fit: Fit) -> Ladder:
    """The steps at the rate of a fit that are compared with as much of the runs: their criteria compare."""
    fs, forgets = fit.model.runs[0].fs, fit.model.forgets
    return tuple(step for step in ladder if step.fit.model.runs[0].fs == fs and step.fit.model.forgets == forgets)


def _forgetting_if_given(model: Model, question: Question) -> Model:
    """The model, which forgets the first periods where its laws were given and slip; laws that are searched do not."""
    return replace(model, forgets=question.law_is_given and model.slips)


def leaves_noise(fit: Fit) -> bool:
    """Return whether what a fit leaves is the noise of the sensors: as large, and white where that is a mere bound.

    Args:
        fit: of any laws.
    """
    if not is_noise(fit):
        return False
    is_stated = all(facts.noise_m_per_s2 for side in SIDES for facts in fit.model.sensors.facts(side))
    return is_stated or measure_whiteness(fit).white


def _with_fewer_terms(found: Found) -> Found:
    """Where a search ended with the smallest law that leaves hardly more: none of them is the law."""
    fit, known = found.fit, found.fit.model.settings.search
    chosen_step = next((step for step in found.ladder if step.fit.law_key == fit.law_key), None)
    if chosen_step is None:
        return found
    largest = (1 + known.overfit_fraction) * chosen_step.fit.error_rms
    alike = [step for step in _of_same_data(found.ladder, chosen_step.fit) if step.fit.error_rms <= largest]
    best = min(alike, key=lambda step: (n_terms(step.fit), step.fit.error_rms))
    if n_terms(best.fit) == n_terms(fit):
        return found
    again = refit(fit, best.fit.laws)
    if again is None or again.error_rms > (1 + known.overfit_fraction) * fit.error_rms:
        return found
    return _ended_with(found, best, again)


def asks_for_law(fit: Fit, kinds: Sequence[str]) -> bool:
    """Return whether a law of the library promises to explain what a fit leaves: no force that nobody measured does.

    Args:
        fit: whose law was not searched.
        kinds: of which the law may be.
    """
    dictionaries = DrivenLaws(fit.model.settings.search, fit.model.settings.fit.promise_in_search).dictionaries(
        fit, kinds
    )
    promised = max((each.most_promised() for each in dictionaries.values()), default=0.0)
    return promised > fit.model.settings.process.most_promised


def with_laws_of(found: Found, weighed: Fit, question: Question, progress: Say | None = None) -> Found:
    """Return what was found with the laws that a search finds beside errors as large as they are said to be.

    Forces that nobody measured hide what a law promises: beside them all laws leave about as much.

    Args:
        found: whose laws were not searched, for it left too much.
        weighed: a fit of the same runs with process noise.
        question: what may be tried.
        progress: called with the name of each law before it is fitted.
    """
    problem = DrivenLaws(weighed.model.settings.search, weighed.model.settings.fit.promise_in_search)
    laws = search_laws(problem, weighed, kinds=question.kinds, progress=progress)
    again = refit(found.fit, chosen(laws).fit.laws)
    if again is None or cannot_be(again) or again.law_key == found.fit.law_key:
        return found
    return _ended_with(found, LawStep(again, True, "pursuit"), again)


def with_simpler_laws(found: Found, kinds: Sequence[str]) -> Iterator[Found]:
    """Yield what was found with a term less in its laws, or with a relative of what then remembers.

    Args:
        found: whose law takes up what the model lacks.
        kinds: of which a relative may be.
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
        if again is not None and not cannot_be(again) and again.error_rms < known.most_left_by_simpler * fit.error_rms:
            yield _ended_with(found, LawStep(again, False, "pursuit"), again)


def _ended_with(found: Found, last: LawStep[Fit], fit: Fit) -> Found:
    """What was found, as if its search had ended with another step, and a fit of its laws."""
    ladder = (*(replace(step, kept=False) for step in found.ladder if step is not last), replace(last, kept=True))
    return replace(found, fit=fit, ladder=ladder)


def _says_why_it_is_uneven(fit: Fit, than: Fit, known: SearchSettings) -> bool:
    """Whether laws about another origin fit as well as others with even terms about the rest position.

    A cube about the unloaded length is a cube and a square about where it rests, but it also says how far that is.
    """
    is_even = any(term.kind.is_even for law in than.laws.values() for term in law.terms)
    return is_even and n_terms(fit) <= n_terms(than) and fit.bic < than.bic + known.alike_bic


def _is_as_likely(fit: Fit, other: Fit) -> bool:
    """Whether two fits have the same laws, sensors and criterion: two minima as deep as each other are hardly met."""
    is_alike = fit.model.names == other.model.names and fit.law_key == other.law_key
    return is_alike and abs(fit.bic - other.bic) < fit.model.settings.search.alike_bic


def _thinned(fit: Fit) -> Fit:
    """The fit at a coarse rate; as it is where the body moves too fast for that."""
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


def _rejected(ladder: Ladder) -> set[tuple[str, ...]]:
    """Names of the laws that need not be tried again at the full rate, with the sensors that were taken at last."""
    model = chosen(ladder).fit.model
    alike = [
        step
        for step in _of_same_data(ladder, chosen(ladder).fit)
        if step.fit.model.runs is model.runs and step.fit.model.sensors == model.sensors
    ]
    return far_behind(alike, model.settings.search) | surely_behind(alike, model.settings.search)


def _with_more_steps(fit: Fit, demands: Sequence[Demand]) -> Fit:
    """The fit without demands and with steps so short that its laws do not turn over within one; else as it is."""
    known, run = fit.model.settings.fit, fit.model.runs[0]
    by = int(np.ceil(turnover_rate(fit) / (known.turnover_in_step * run.fs)))
    if by <= 1:
        return fit
    by, model = min(by, known.most_steps), fit.model
    for demand in demands:
        model = demand.hypothesis.taken_from(model)
    finer = replace(model, runs=tuple(run.sampled_finer(by) for run in model.runs))
    try:
        return fit_model(finer, carried_over(fit, finer))
    except NO_FIT:
        return fit


def _begun(model: Model, theta: FloatArray, noisier: Sequence[float]) -> FloatArray:
    """The vector with the start of each run of one gear looked for under the noise that an attempt begins with.

    Several interfaces have too many starts for a grid.
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


def _strongest_pieces(model: Model) -> Model:
    """The model with the strongest piece of each run in its place; as it is where the runs are no longer than that."""
    runs = tuple(run.strongest_piece(model.settings.fit.hopeless_piece_s) for run in model.runs)
    return model if runs == model.runs else replace(model, runs=runs)


def _without_laws(model: Model, theta: FloatArray) -> FloatArray:
    """The vector without the laws."""
    gone = [np.arange(theta.size)[model.law_indices(number)] for number in range(len(model.groups))]
    return np.delete(theta, np.concatenate(gone))


def _at_coarse_rate(model: Model, theta: FloatArray) -> Model:
    """The model at a coarse rate; as it is where that would mislead."""
    coarse, known = model.coarse, model.settings.fit
    if coarse is model or fastest_rate(model, theta) > known.fastest * coarse.runs[0].fs:
        return model
    predictions = model.evaluate(theta, sensitivity=False).predictions
    n_sensors = len(model.sensors.sprung)
    folded = [
        folded_power(prediction.innovation[:n_sensors], run, thinned)
        for prediction, run, thinned in zip(predictions, model.runs, coarse.runs, strict=True)
    ]
    return coarse if max(folded) < known.most_folded else model


def folded_power(innovation: FloatArray, run: DrivenRun, thinned: DrivenRun) -> float:
    """Return what a thinned run folds into its band of what the model does not predict, over the noise.

    Args:
        innovation: (n_sensors, n) white errors of the run.
        run: the run.
        thinned: the same at a coarse rate.
    """
    frequency_hz = fft.rfftfreq(run.n_samples, 1 / run.fs)
    into_hz = np.abs(frequency_hz - thinned.fs * np.round(frequency_hz / thinned.fs))
    folds = (frequency_hz > thinned.fs / 2) & (into_hz <= thinned.omega[-1] / (2 * np.pi))
    power = np.abs(fft.rfft(innovation)[:, folds]) ** 2 / run.n_samples
    return float(power.mean(axis=1).max())
