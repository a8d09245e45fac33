"""Joints of named kinds in the law of a mode by simulation: when they are tried, and what is told of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.modal.forced.form_search import Trial, choose_trial, list_errors, list_joints, try_forms
from opid.modal.forced.mode_fit import ModeFit
from opid.modal.forced.restoring_fit import find_rms, list_near
from opid.modal.forced.system import System
from opid.modal.joint_terms import JOINT_KINDS, JointKind, read_memory
from opid.modal.settings import SIMULATED


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
    system: System, fit: ModeFit, kinds: Sequence[JointKind], *, search_own: bool, free_linear: bool
) -> list[Trial]:
    """Return joints of named kinds that nobody asked for, those that alone leave no more of the tests than noise.

    Args:
        system: the mode under test alone, and its tests.
        fit: the mode by itself.
        kinds: the joints that were asked for.
        search_own: whether the powers are searched, so that none stand beside the joints.
        free_linear: whether k0 and c0 are corrected.
    """
    others = [kind for several in JOINT_KINDS.values() for kind in several if kind not in kinds]
    own = list_joints(system, fit, others, search_own=search_own, free_linear=free_linear)
    trials = try_forms(system, own, (), np.zeros(0), has_joint=False, free_linear=free_linear)
    return [each for each in trials if each.found.find_excess(system) <= SIMULATED.unexplained]


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
        "give orders of powers beside the joint, of which it has none by itself"
    )
    return Choice(best, _tell_found(best, mode), why)


def _tell_found(trial: Trial, mode: int) -> str:
    """Return that a joint was found for which nobody asked, "" for none."""
    kind = trial.found.form.own[mode].memory
    if kind is None or kind.is_slip:
        return ""
    return f"mode {mode}: powers, dry friction and slip do not explain the tests, but {kind.words} does"
