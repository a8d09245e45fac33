"""Which forms of the law of some modes are tried: terms of the mode under test, products, one joint, and its relatives.

A joint of a kind that has a name is tried where it is asked for, or where nothing else explains a mode alone. Each form
is fitted by simulation (`simulated_fit`) and judged by its error on tests that are left out in turn.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product as combine

import numpy as np

from opid.errors import InputError
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.modal.couplings import DEGREES, Product, list_products
from opid.modal.forced.equation import Powers
from opid.modal.forced.mode_fit import ModeFit
from opid.modal.forced.restoring_fit import choose_simplest, find_rms, list_near
from opid.modal.forced.simulated_fit import FittedForm, find_misfit, fit_form
from opid.modal.forced.system import ModeTerms, System, SystemForm
from opid.modal.joint_terms import JOINT_KINDS, SLIP, JointKind, JointTerms, read_memory, slip_softening
from opid.modal.settings import MODAL, SIMULATED
from opid.signals.recording import FloatArray

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Trial:
    """A form that was fitted, and its terms for a table."""

    terms: str
    found: FittedForm


OwnTerms = tuple[ModeTerms, FloatArray]
"""Terms that the mode under test may have by itself, and their starts, (n_starts, n)."""


def try_forms(
    system: System,
    own_terms: Iterable[OwnTerms],
    products: tuple[Product, ...],
    guesses: FloatArray,
    *,
    has_joint: bool,
    free_linear: bool,
) -> list[Trial]:
    """Return the forms that could be fitted to a system.

    Args:
        system: the modes, the one under test first, and their tests.
        own_terms: the terms that the mode under test may have by itself.
        products: the products by which it drives the others.
        guesses: (n_products,) their coefficients in the units of the system, from which the search begins.
        has_joint: whether a joint and its relatives are tried in the place of the products.
        free_linear: whether k0 and c0 of the driven modes are corrected.
    """
    trials: list[Trial] = []
    linear = ModeTerms(Powers((1,), (1,)) if free_linear else Powers((), ()))
    others = dict.fromkeys(system.numbers[1:], linear)
    rest = np.zeros(linear.size * len(others))
    for terms, starts in own_terms:
        form = SystemForm({system.numbers[0]: terms} | others, products)
        # Products that each explain the quietest test are too much together: the motion may have no bound with them.
        for first in (guesses, np.zeros_like(guesses)):
            whole = [np.concatenate([start, rest, first]) for start in starts]
            misfits = [find_misfit(system, form, each) for each in whole]
            start = whole[int(np.argmin(misfits))]
            if min(misfits) < np.inf:
                break
        # Quieter tests tell nothing of a joint that slides at large motion.
        is_near = terms.has_friction or (terms.memory is not None and not terms.memory.is_slip)
        _try_form(system, form, start, trials, is_near=is_near)
    if products and trials:
        own = choose_trial(trials).found
        alone = own.vector[: own.form.size - len(products)]
        _try_form(system, SystemForm(own.form.own), alone, trials, is_near=True)
        if has_joint:
            _search_joint(system, own, alone, trials)
    return trials


def choose_trial(trials: Sequence[Trial]) -> Trial:
    """Return the smallest form within one standard error and 1 % of the least error (`choose_simplest`)."""
    return trials[choose_simplest(*list_errors(trials))]


def list_errors(trials: Sequence[Trial]) -> tuple[dict[int, FloatArray], dict[int, int]]:
    """Return errors and numbers of coefficients of the trials, by their index."""
    errors = {index: each.found.errors for index, each in enumerate(trials)}
    return errors, {index: each.found.form.size for index, each in enumerate(trials)}


def _try_form(
    system: System, form: SystemForm, start: FloatArray, trials: list[Trial], *, is_near: bool = False
) -> None:
    """Fit a form and add it to the trials, unless it cannot be simulated or its joint is not determined."""
    try:
        found = fit_form(system, form, start, is_near=is_near)
    except InputError as error:
        logger.info("%s: %s", _name_terms(form), error)
        return
    missed = ", ".join(f"{each:.2g}" for each in found.missed)
    logger.info("%s: left out %.3g, missed %s of each mode", _name_terms(form), find_rms(found.errors), missed)
    if _is_determined(found):
        trials.append(Trial(_name_terms(form), found))


def _search_joint(system: System, own: FittedForm, alone: FloatArray, trials: list[Trial]) -> None:
    """Try a joint that stretches with all modes, further terms of it, and all products of its degree."""
    degree, n_others = len(own.form.products[0].modes), len(own.form.modes) - 1
    rivals = [each.found for each in trials if _may_be_own(each.found, own)]
    joint = replace(own.form, products=(), joint=((False, degree),))
    first = len(trials)
    for sign in sorted({tuple(np.sign(each)) for each in combine(SIMULATED.first_ratios, repeat=n_others)}):
        # The first product of the joint is that which is known: its value is the amount times the ratio.
        starts = [
            np.concatenate([alone, [float(own.vector[alone.size]) / np.prod(each)], each])
            for each in combine(SIMULATED.first_ratios, repeat=n_others)
            if tuple(np.sign(each)) == sign
        ]
        _try_form(system, joint, min(starts, key=lambda start: find_misfit(system, joint, start)), trials)
    if len(trials) == first:
        return
    best = min(trials[first:], key=lambda each: each.found.score).found
    # With the joint other terms of the mode under test may be the better ones.
    for rival in rivals:
        form = replace(rival.form, products=(), joint=joint.joint)
        start = np.concatenate([rival.vector[: -len(rival.form.products)], best.vector[alone.size :]])
        _try_form(system, form, start, trials, is_near=True)
    best = choose_trial(trials[first:]).found
    for mode in best.form.modes[1:]:
        # A driven mode may slip or bend, too.
        place = sum(best.form.own[each].size for each in best.form.modes[: best.form.modes.index(mode)])
        n_k, terms = len(best.form.own[mode].powers.k), best.form.own[mode]
        bent = replace(terms, powers=replace(terms.powers, k=(*terms.powers.k, 3)))
        for changed, at, more in (
            (bent, place + n_k, [0.0]),
            (replace(terms, memory=SLIP), place + terms.size, [SIMULATED.first_slip, SIMULATED.first_slip_exponent]),
        ):
            form = replace(best.form, own=dict(best.form.own) | {mode: changed})
            _try_form(system, form, np.insert(best.vector, at, more), trials, is_near=True)
    best = choose_trial(trials[first:]).found
    n = best.form.size - len(best.form.joint) - n_others
    for further in ((False, next(each for each in DEGREES if each != degree)), (True, 4)):
        wider = replace(best.form, joint=(*best.form.joint, further))
        _try_form(system, wider, np.insert(best.vector, n + len(best.form.joint), 0.0), trials, is_near=True)
    every = tuple(list_products(best.form.modes, degree))
    amounts = [best.values.couplings[each] / system.measure_product(each) for each in every]
    form = replace(best.form, products=every, joint=())
    _try_form(system, form, np.concatenate([best.vector[:n], amounts]), trials, is_near=True)


def _may_be_own(found: FittedForm, own: FittedForm) -> bool:
    """Return whether a form with the same products, but other terms of the mode under test, may be the better one."""
    is_other = found is not own and found.form.products == own.form.products
    return is_other and find_rms(found.errors) < SIMULATED.own_rivals * find_rms(own.errors)


def list_own(system: System, fit: ModeFit, *, search_own: bool, free_linear: bool) -> Iterator[OwnTerms]:
    """Yield powers, and friction and slip if they are searched, which begin with what the powers of a fit show."""
    force, a, v = system.damping_force(0), float(system.largest[0]), system.top_speed(0)
    powers = Powers(tuple(fit.stiffness), tuple(fit.damping))
    start = [float(each.value or 0.0) * a**n / force for n, each in fit.stiffness.items()]
    start += [float(each.value or 0.0) * v**n / force for n, each in fit.damping.items()]
    yield ModeTerms(powers), np.array([start])
    if not search_own:
        return
    softer = _soften(system, fit)
    slip = max(softer / float(slip_softening(SIMULATED.first_slip_exponent)), SIMULATED.least_size)
    linear = (1,) if free_linear else ()
    frictions, exponents = SIMULATED.first_frictions, SIMULATED.first_slip_exponents
    for k in (linear, (*linear, 3)):
        own, of_linear = Powers(k, linear), [0.0] * len(linear)
        # With friction nothing but k3 moves the frequency as the powers do, and beside slip either may.
        bent = [*of_linear, *[-softer / float(first_harmonic_factor(3))] * (3 in k), *of_linear]
        zeros = [0.0] * len(bent)
        frictional = [[*bent, each] for each in frictions]
        slipping = [[*zeros, slip, each] for each in exponents]
        slipping += [[*bent, SIMULATED.least_size, each] for each in exponents] if 3 in k else []
        yield ModeTerms(own, has_friction=True), np.array(frictional)
        yield ModeTerms(own, memory=SLIP), np.array(slipping)


def _soften(system: System, fit: ModeFit) -> float:
    """Return by how much the powers soften the mode under test at its largest displacement, in the system's units."""
    softer = float(system.modes.stiffness()[0]) - float(2 * np.pi * fit.frequency_at_hz[-1]) ** 2
    return softer * float(system.largest[0]) / system.damping_force(0)


def list_joints(
    system: System,
    fit: ModeFit,
    kinds: Iterable[JointKind],
    beside: Powers | None = None,
    /,
    *,
    search_own: bool,
    free_linear: bool,
) -> Iterator[OwnTerms]:
    """Yield joints of named kinds, beside powers only where their orders are given and not searched, or `beside` is."""
    linear, at = (1,) if free_linear else (), np.ones(1)
    powers = Powers(linear, linear) if search_own else Powers(tuple(fit.stiffness), tuple(fit.damping))
    if beside is not None:
        powers = Powers((*linear, *beside.k), (*linear, *beside.c))
    softer = _soften(system, fit)
    bends = beside is not None and 3 in beside.k
    for kind in kinds:
        terms, starts = ModeTerms(powers, memory=kind), []
        for inner in kind.list_starts():
            of_unit = float(JointTerms.of_kind(0.0, kind, (1.0, *inner)).find_softening(at)[0])
            shown = _lose(fit) if bends else softer / max(of_unit, SIMULATED.least_softening)
            for force in (times * max(shown, SIMULATED.least_size) for times in SIMULATED.first_forces):
                values = dict.fromkeys(powers.k, 0.0)
                if bends:
                    # A spring makes up for what the joint softens more than the powers do.
                    values[3] = (force * of_unit - softer) / float(first_harmonic_factor(3))
                starts.append([*values.values(), *[0.0] * len(powers.c), force, *inner])
        yield terms, np.array(starts)


def _lose(fit: ModeFit) -> float:
    """Return the friction that loses what the powers lose at the largest displacement, in the units of the system."""
    return max(float(fit.damping_at[-1]) / fit.damping_ratio - 1.0, 0.0) * np.pi / 4.0


def _is_determined(found: FittedForm) -> bool:
    """Return whether friction and slip stand out of their standard deviations, and the exponent is known."""
    first = 0
    for terms in found.form.own.values():
        vector, std = (each[first : first + terms.size] for each in (found.vector, found.vector_std))
        first += terms.size
        (friction, memory), (friction_std, memory_std) = (terms.split(each.tolist())[2:] for each in (vector, std))
        if any(value < MODAL.joint_sigma * own for value, own in zip(friction, friction_std, strict=True)):
            return False
        if (kind := terms.memory) is None:
            continue
        is_at_end = any(
            abs(value - end) < 1e-3 for value, ends in zip(memory, kind.ranges, strict=True) for end in ends
        )
        if is_at_end or not kind.is_determined(np.array(memory), np.array(memory_std)):
            return False
    return True


def _name_terms(form: SystemForm) -> str:
    """Return the terms of a form beside the linear ones, for a table."""
    names = []
    for mode, terms in form.own.items():
        k, c = (",".join(str(n) for n in powers if n > 1) for powers in (terms.powers.k, terms.powers.c))
        powers = " ".join(f"{letter}{numbers}" for letter, numbers in (("k", k), ("c", c)) if numbers)
        own = [powers] * bool(powers) + ["friction"] * terms.has_friction
        own += [terms.memory.name if terms.memory.is_slip else terms.memory.words] if terms.memory else []
        names += [f"mode {mode}: {' + '.join(own)}"] if own else []
    names += [", ".join(each.name for each in form.products)] if form.products else []
    names += [f"joint c z'^{degree}" if of_velocity else f"joint k z^{degree}" for of_velocity, degree in form.joint]
    return "; ".join(names or ["linear"])


def mirror(found: FittedForm) -> FloatArray:
    """Return the start whose joint is stretched in the opposite direction by the other modes.

    The mode under test then moves the other way, which its own terms do not feel, so that the coefficients of odd
    degrees change their sign, too.
    """
    vector = found.vector.copy()
    n_others = len(found.form.modes) - 1
    first = vector.size - n_others - len(found.form.joint)
    for index, (_, degree) in enumerate(found.form.joint):
        vector[first + index] *= (-1) ** degree
    vector[-n_others:] *= -1.0
    return vector


@dataclass(frozen=True, eq=False)
class Choice:
    """The form of the law that was chosen among those that were tried.

    Args:
        trial: the form.
        warning: what is to be told of its joint, "" for nothing.
        dropped: why a joint that was asked for is not in it, "" where it is, or none was asked for.
    """

    trial: Trial
    warning: str = ""
    dropped: str = ""


def list_kinds(memory: str | None) -> tuple[JointKind, ...]:
    """Return the kinds of joint of a name, none where it is None; raise what `read_memory` does."""
    return () if memory is None else tuple(kind for kind in read_memory(memory) if kind is not None)


def try_other_joints(
    system: System, fit: ModeFit, kinds: Sequence[JointKind], best: float, *, search_own: bool, free_linear: bool
) -> list[Trial]:
    """Return joints where no law explains the tests: those that were asked for beside powers, and those of other kinds.

    Of the others those count that leave no more of the tests than noise, or little, and far less than the best law.

    Args:
        system: the mode under test alone, and its tests.
        fit: the mode by itself.
        kinds: the joints that were asked for.
        best: misfit of the best law over that of the noise; infinite where none could be simulated.
        search_own: whether the powers are searched, so that none stand beside the joints.
        free_linear: whether k0 and c0 are corrected.
    """
    free: dict[str, bool] = {"search_own": search_own, "free_linear": free_linear}
    beside = (Powers((3,), ()), Powers((), (2,)), Powers((3,), (2,))) if search_own else ()
    asked = [own for powers in beside for own in list_joints(system, fit, kinds, powers, **free)]
    others = [kind for several in JOINT_KINDS.values() for kind in several if kind not in kinds]
    both = (asked, list_joints(system, fit, others, **free))
    named, found = (try_forms(system, own, (), np.zeros(0), has_joint=False, free_linear=free_linear) for own in both)
    return named + [each for each in found if _is_explained(each.found, system, best)]


def _is_explained(found: FittedForm, system: System, best: float) -> bool:
    """Return whether a joint leaves no more of the tests than noise, or little, and far less than the best law."""
    excess = found.find_excess(system)
    is_good = float(found.missed[0]) <= SIMULATED.warned_missed and excess <= SIMULATED.far_less * best
    return is_good or excess <= SIMULATED.unexplained


def choose_form(trials: Sequence[Trial], mode: int, memory: str | None) -> Choice:
    """Return the simplest good form, with a joint of the kinds that were asked for where the tests determine one.

    Args:
        trials: the forms that were tried.
        mode: number of the mode under test.
        memory: the name of the kinds; None where no joint was asked for.
    """
    best, kinds = choose_trial(trials), list_kinds(memory)
    named = [each for each in trials if each.found.form.own[mode].memory in kinds]
    if memory is None or best in named:
        return Choice(best, _tell_found(best, mode) if memory is None else "")
    own = choose_trial(named) if named else None
    near = [trials[index] for index in list_near(*list_errors(trials))]
    simplest = best.found.form.own[mode]
    # Friction is a joint of no travel, and slip without an end is one that never slides as a whole.
    is_limit = own in near and (simplest.has_friction or simplest.memory is not None)
    if own is None or is_limit:
        why = (
            f"mode {mode}: these tests do not determine {memory}, which the study names, so that it is left out: its "
            "largest force and the travel at which all of it slides are only told by motions to both sides of that "
            "travel; give tests at higher levels, or leave memory out"
        )
        return Choice(best, dropped=why)
    errors = " and ".join(f"{100 * find_rms(each.found.errors):.2g} %" for each in (own, best))
    if own in near:
        warning = (
            f"mode {mode}: the tests hardly tell {memory} from powers (what is left out in turn is missed by {errors} "
            "of the motion): the intervals of the joint hold only if it is of this kind; give tests at more levels"
        )
        return Choice(own, warning)
    why = (
        f"mode {mode}: {memory}, which the study names, is left out: laws without it explain the tests better (what "
        f"is left out in turn is missed by {errors} of the motion; the best law is {best.terms}): leave memory out, or "
        "give orders of powers beside the joint, of which only k3 and c2 are tried"
    )
    return Choice(best, _tell_found(best, mode), why)


def _tell_found(trial: Trial, mode: int) -> str:
    """Return that a joint was found for which nobody asked, "" for none."""
    kind = trial.found.form.own[mode].memory
    if kind is None or kind.is_slip:
        return ""
    return f"mode {mode}: powers, dry friction and slip do not explain the tests, but {kind.words} does"
