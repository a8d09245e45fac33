"""Which terms a mode, or several modes that drive each other, need beyond powers: friction, slip and couplings.

Every form of the law is fitted by simulation (`simulated_fit`), and judged as the orders of a single mode are: by its
error on tests that are left out in turn. The fewest coefficients are chosen whose error is within one standard error
and 1 % of the least one.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import product as combine
from typing import Any

import numpy as np
from scipy import fft

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.laws.law import Law
from opid.modal.couplings import DEGREES, Coupling, Product, list_products
from opid.modal.forced.equation import Powers, mode_lines
from opid.modal.forced.mode_fit import ModeFit, warn_of_fit
from opid.modal.forced.mode_tests import Interaction
from opid.modal.forced.restoring_fit import choose_simplest, find_rms, linearised, list_near
from opid.modal.forced.simulated_fit import (
    FittedForm,
    ModeTerms,
    System,
    SystemForm,
    differentiate,
    find_misfit,
    fit_form,
    make_system,
    refine_form,
)
from opid.modal.joint_terms import ModalJoint, make_joint, slip_softening
from opid.modal.linear.modes import ModalTest
from opid.modal.power_laws import coefficients_json, make_fitted_law
from opid.modal.settings import MODAL, SIMULATED
from opid.signals.recording import FloatArray

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class DrivenLaw:
    """The law of a driven mode by itself.

    Args:
        stiffness: k_n by its power n, (N/kg^1/2) / (m kg^1/2)^n; 1 is the correction of k0.
        damping: c_n by its power n, (N/kg^1/2) / (m/s kg^1/2)^n; 1 is the correction of c0.
        friction: dry friction F, N/kg^1/2; empty where there is none.
        slip: R of an Iwan joint, (N/kg^1/2) / (m kg^1/2)^(2 + chi); empty without one.
        slip_exponent: chi of that joint; empty without one.
        largest: its largest displacement in the tests, m kg^1/2.
    """

    stiffness: Mapping[int, Estimate]
    damping: Mapping[int, Estimate]
    friction: Estimate
    slip: Estimate
    slip_exponent: Estimate
    largest: float

    @property
    def law(self) -> Law:
        """The nonlinear restoring force of the powers 2 and up."""
        return make_fitted_law(self.stiffness, self.damping)

    @property
    def joint(self) -> ModalJoint:
        """Friction and slip, ready to be simulated."""
        return make_joint(self.friction, self.slip, self.slip_exponent, self.largest)

    def as_json(self) -> dict[str, Any]:
        """Return the law as result.json holds it."""
        joint = {name: asdict(getattr(self, name)) for name in ("friction", "slip", "slip_exponent")}
        return {**coefficients_json(self.stiffness, self.damping), **joint, "largest": self.largest}


@dataclass(frozen=True)
class LawTrial:
    """One form of the law that was tried."""

    terms: str  # its terms beside the powers
    coefficients: int  # their number, with those of the powers
    error: float  # misfit of the tests that were left out, over the motion (rms)
    error_std: float  # standard error of that misfit, from test to test
    chosen: bool  # whether this form was chosen


@dataclass(frozen=True, eq=False)
class SystemFit:
    """The law of one mode, or of several that drive each other, by simulation of the tests.

    Args:
        modes: numbers of the modes, the one under test first.
        fit: the mode under test, with the law that was chosen.
        driven: the law of each other mode by itself, by its number.
        couplings: the products by which the modes drive each other; empty for one mode.
        ratios: where one joint explains the couplings, how far it is stretched by a unit of each other mode, over that
            of the first mode; empty otherwise.
        missed: misfit over the motion in the band of each mode, rms, by its number.
        trials: the forms of the law that were tried.
        warnings: one sentence for each warning about the fit.
    """

    modes: tuple[int, ...]
    fit: ModeFit
    driven: Mapping[int, DrivenLaw]
    couplings: tuple[Coupling, ...]
    ratios: Mapping[int, Estimate]
    missed: Mapping[int, float]
    trials: tuple[LawTrial, ...]
    warnings: tuple[str, ...]

    @property
    def is_good(self) -> bool:
        """Whether the law explains the motion of all its modes well enough to be used."""
        return max(self.missed.values()) <= SIMULATED.most_missed

    def as_json(self) -> dict[str, Any]:
        """Return the fit as result.json holds it; the law of the mode under test is among the modes."""
        return {
            "modes": self.modes,
            "couplings": [each.as_json() for each in self.couplings],
            "driven": {str(mode): law.as_json() for mode, law in self.driven.items()},
            "ratios": {str(mode): asdict(each) for mode, each in self.ratios.items()},
            "missed": {str(mode): each for mode, each in self.missed.items()},
            "trials": [asdict(each) for each in self.trials],
            "warnings": self.warnings,
        }


def fit_system(
    tests: Sequence[ModalTest],
    fit: ModeFit,
    interactions: Sequence[Interaction] = (),
    *,
    products: Sequence[Product] | None = None,
    search_own: bool = True,
    free_linear: bool = True,
) -> SystemFit:
    """Fit the law of a mode, and of the modes that it drives, by simulation.

    Args:
        tests: the tests that the mode was fitted to.
        fit: the mode by itself, whose powers are the start.
        interactions: the modes that it drives.
        products: the products by which they do, if they are known; searched where None.
        search_own: whether friction and slip are tried beside the powers.
        free_linear: whether k0 and c0 of the driven modes, and beside slip, are corrected.

    Raises:
        InputError: no form of the law could be fitted.
    """
    bands = {fit.mode: fit.band_hz} | {each.other: each.band_hz for each in interactions}
    bands |= {
        mode: _choose_band(tests[0], mode) for product in products or () for mode in product.modes if mode not in bands
    }
    largest = {mode: max(mode_lines(test, mode, band).largest_q for test in tests) for mode, band in bands.items()}
    system = make_system(tests, bands, largest, step_rad=SIMULATED.first_step_rad)
    trials: list[_Trial] = []
    others = {
        mode: ModeTerms(Powers((1,), (1,)) if free_linear else Powers((), ())) for mode in bands if mode != fit.mode
    }
    first = tuple(products) if products is not None else tuple(each.product for each in interactions)
    guesses = np.array([_guess_product(tests, bands, each) / system.measure_product(each) for each in first])
    rest = np.zeros(2 * free_linear * len(others))
    for terms, starts in _list_own(system, fit, search_own, free_linear):
        form = SystemForm({fit.mode: terms} | others, first)
        whole = [np.concatenate([start, rest, guesses]) for start in starts]
        start = min(whole, key=lambda each: find_misfit(system, form, each))
        _try_form(system, form, start, trials, is_near=terms.has_friction)
    if first and trials:
        own = _choose(trials).found
        alone = own.vector[: own.form.size - len(first)]
        _try_form(system, SystemForm(own.form.own), alone, trials, is_near=True)
        if products is None:
            _search_joint(system, own, alone, trials)
    if not trials:
        raise InputError(
            f"no law of mode {fit.mode} could be simulated in tests {', '.join(repr(test.name) for test in tests)}: "
            "its start is too far off; give tests at lower levels, too"
        )
    chosen = _choose(trials)
    ends = [chosen.found]
    if chosen.found.form.joint:
        # The form was found with one sign of its joint; the mirrored one may explain the tests as well, or better.
        with suppress(InputError):
            ends.append(fit_form(system, chosen.found.form, _mirror(chosen.found), is_near=True))
    finer = make_system(tests, bands, largest, step_rad=SIMULATED.step_rad)
    ends = sorted((refine_form(finer, each) for each in ends), key=lambda each: each.score)
    likely = [each for each in ends if each.score <= ends[0].score + MODAL.rival_score]
    return _make_fit(finer, fit, trials, chosen, likely)


@dataclass(frozen=True, eq=False)
class _Trial:
    terms: str
    found: FittedForm


def _choose(trials: Sequence[_Trial]) -> _Trial:
    return trials[choose_simplest(*_list_errors(trials))]


def _list_errors(trials: Sequence[_Trial]) -> tuple[dict[int, FloatArray], dict[int, int]]:
    """Return errors and numbers of coefficients of the trials, by their index."""
    errors = {index: each.found.errors for index, each in enumerate(trials)}
    return errors, {index: each.found.form.size for index, each in enumerate(trials)}


def _try_form(
    system: System, form: SystemForm, start: FloatArray, trials: list[_Trial], *, is_near: bool = False
) -> None:
    """Fit a form and add it to the trials, unless it cannot be simulated or its joint is not determined."""
    try:
        found = fit_form(system, form, start, is_near=is_near)
    except InputError as error:
        logger.info("%s: %s", _name_terms(form), error)
        return
    logger.info("%s: left out %.3g, missed %s", _name_terms(form), find_rms(found.errors), found.missed)
    if _is_determined(found):
        trials.append(_Trial(_name_terms(form), found))


def _search_joint(system: System, own: FittedForm, alone: FloatArray, trials: list[_Trial]) -> None:
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
    best = _choose(trials[first:]).found
    for mode in best.form.modes[1:]:
        # A driven mode may slip or bend, too.
        place = sum(best.form.own[each].size for each in best.form.modes[: best.form.modes.index(mode)])
        n_k, terms = len(best.form.own[mode].powers.k), best.form.own[mode]
        bent = replace(terms, powers=replace(terms.powers, k=(*terms.powers.k, 3)))
        for changed, at, more in (
            (bent, place + n_k, [0.0]),
            (replace(terms, has_slip=True), place + terms.size, [SIMULATED.first_slip, -0.5]),
        ):
            form = replace(best.form, own=dict(best.form.own) | {mode: changed})
            _try_form(system, form, np.insert(best.vector, at, more), trials, is_near=True)
    best = _choose(trials[first:]).found
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


def _list_own(system: System, fit: ModeFit, search: bool, free_linear: bool) -> Iterator[tuple[ModeTerms, FloatArray]]:
    """Yield the terms that the mode under test may have by itself, and their starts, (n_starts, n) each."""
    force, a, v = system.damping_force(0), float(system.largest[0]), system.top_speed(0)
    powers = Powers(tuple(fit.stiffness), tuple(fit.damping))
    start = [float(each.value or 0.0) * a**n / force for n, each in fit.stiffness.items()]
    start += [float(each.value or 0.0) * v**n / force for n, each in fit.damping.items()]
    yield ModeTerms(powers), np.array([start])
    if not search:
        return
    k0 = float(system.modes.stiffness()[0])
    softer = k0 - float(2 * np.pi * fit.frequency_at_hz[-1]) ** 2
    slip = max(softer * a / force / slip_softening(-0.5), 0.1)
    linear = (1,) if free_linear else ()
    for k in (linear, (*linear, 3)):
        zeros, own = [0.0] * (len(k) + len(linear)), Powers(k, linear)
        yield ModeTerms(own, has_friction=True), np.array([[*zeros, each] for each in SIMULATED.first_frictions])
        yield ModeTerms(own, has_slip=True), np.array([[*zeros, slip, each] for each in MODAL.first_exponents[::2]])


def _choose_band(test: ModalTest, mode: int) -> tuple[float, float]:
    """Return the band of a mode whose excitation is not known."""
    index = test.modes.index(mode)
    natural, damping = float(test.modes.frequency_hz[index]), float(test.modes.damping_ratio[index])
    width = 2 * MODAL.half_widths * damping * natural
    return natural - width, natural + width


def _guess_product(tests: Sequence[ModalTest], bands: Mapping[int, tuple[float, float]], product: Product) -> float:
    """Return a product's coefficient by the equation of its last mode in the quietest test."""
    driven = product.modes[-1]
    best, least = 0.0, np.inf
    for test in tests:
        lines = mode_lines(test, driven, bands[driven])
        motion = {mode: mode_lines(test, mode, bands[mode]) for mode in set(product.modes)}
        others = [motion[mode].v if product.of_velocity else motion[mode].q for mode in product.modes[:-1]]
        factor = product.modes.count(driven)
        column = factor * fft.rfft(np.prod(others, axis=0))[lines.indices]
        loudness = float(np.sum(np.abs(column) ** 2))
        if 0.0 < loudness < least:
            best, least = float(np.vdot(column, lines.left_side).real) / loudness, loudness
    return best


def _is_determined(found: FittedForm) -> bool:
    """Return whether friction and slip stand out of their standard deviations, and the exponent is known."""
    first = 0
    for terms, values in zip(found.form.own.values(), found.values.own.values(), strict=True):
        size = len(values.flatten())
        value, std = np.array(values.flatten())[-3:], found.std[first + size - 3 : first + size]
        first += size
        if terms.has_friction and value[0] < MODAL.joint_sigma * std[0]:
            return False
        is_at_end = min(abs(value[2] - end) for end in MODAL.slip_exponents) < 1e-3
        if terms.has_slip and (value[1] <= 0.0 or is_at_end or std[2] > MODAL.widest_exponent):
            return False
    return True


def _name_terms(form: SystemForm) -> str:
    """Return the terms of a form beside the linear ones, for a table."""
    names = []
    for mode, terms in form.own.items():
        k, c = (",".join(str(n) for n in powers if n > 1) for powers in (terms.powers.k, terms.powers.c))
        powers = " ".join(f"{letter}{numbers}" for letter, numbers in (("k", k), ("c", c)) if numbers)
        own = [powers] * bool(powers) + ["friction"] * terms.has_friction + ["slip"] * terms.has_slip
        names += [f"mode {mode}: {' + '.join(own)}"] if own else []
    names += [", ".join(each.name for each in form.products)] if form.products else []
    names += [f"joint c z'^{degree}" if of_velocity else f"joint k z^{degree}" for of_velocity, degree in form.joint]
    return "; ".join(names or ["linear"])


def _mirror(found: FittedForm) -> FloatArray:
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


def _make_fit(
    system: System, fit: ModeFit, trials: Sequence[_Trial], chosen: _Trial, likely: Sequence[FittedForm]
) -> SystemFit:
    """Return the fit of the first of the likely ends of the search of the chosen form."""
    found, has_rivals = likely[0], len(likely) > 1
    near = [trials[index] for index in list_near(*_list_errors(trials))]
    others = [each.found for each in near if each.found.form != chosen.found.form]
    spread = _find_spread(found, [*others, *likely])
    freed = _free_scales(system, found)
    by_scale = _find_error_by_scale(found, freed) if freed else 0.0
    more = spread**2 + _find_model_errors(found) ** 2 + by_scale**2
    found = replace(found, covariance=found.covariance + np.diag(more))
    std = iter(found.std.tolist())
    estimates: dict[int, list[Estimate]] = {}
    for mode, values in found.values.own.items():
        estimates[mode] = [Estimate.normal(value, next(std)) for value in values.flatten()]
    couplings = tuple(Coupling(each, Estimate.normal(k, next(std))) for each, k in found.values.couplings.items())
    ratios = {mode: Estimate.normal(value, next(std)) for mode, value in found.values.ratios.items()}
    rungs = tuple(
        LawTrial(
            each.terms,
            each.found.form.size,
            find_rms(each.found.errors),
            float(np.std(each.found.errors, ddof=1)) / each.found.errors.size**0.5,
            each is chosen,
        )
        for each in trials
    )
    missed = dict(zip(system.numbers, found.missed.tolist(), strict=True))
    at = dict(zip(system.numbers, system.largest.tolist(), strict=True))
    driven = {mode: _make_law(found, mode, each, at[mode]) for mode, each in estimates.items() if mode != fit.mode}
    updated = _update_mode_fit(fit, found, estimates[fit.mode])
    made = SystemFit(system.numbers, updated, driven, couplings, ratios, missed, rungs, ())
    warnings = [*_warn_of_fit(made, found, has_rivals), *(_warn_of_scales(freed) if freed else ())]
    return replace(made, warnings=tuple(warnings))


def _find_spread(chosen: FittedForm, near: Sequence[FittedForm]) -> FloatArray:
    """Return how far forms that explain the tests as well put the values of the chosen one, rms.

    Each value is weighted by its variance in its form: a form that leaves a value open says little against another.
    """
    values, labels = chosen.values.flatten(), chosen.values.labels
    has_std = chosen.std > 0.0
    squares = np.zeros(values.size)
    weights = np.where(has_std, 1.0 / np.where(has_std, chosen.std, 1.0) ** 2, np.inf)
    for each in near:
        if each is chosen:
            continue
        place = {label: index for index, label in enumerate(each.values.labels)}
        theirs = each.values.flatten()
        for index, label in enumerate(labels):
            if label in place and each.std[place[label]] > 0.0:
                weight = 1.0 / each.std[place[label]] ** 2
                squares[index] += weight * (theirs[place[label]] - values[index]) ** 2
                weights[index] += weight
    return np.sqrt(squares / weights)


def _find_model_errors(found: FittedForm) -> FloatArray:
    """Return standard deviations of the values, flattened, by what the model of friction cannot know."""
    errors = np.zeros(len(found.covariance))
    first = 0
    for values in found.values.own.values():
        first += len(values.flatten())
        errors[first - 3] = SIMULATED.friction_std * values.joint.friction
    return errors


def _make_law(found: FittedForm, mode: int, estimates: list[Estimate], largest: float) -> DrivenLaw:
    terms = found.form.own[mode]
    n_k, n = len(terms.powers.k), len(terms.powers.k) + len(terms.powers.c)
    return DrivenLaw(
        dict(zip(terms.powers.k, estimates, strict=False)),
        dict(zip(terms.powers.c, estimates[n_k:], strict=False)),
        estimates[n] if terms.has_friction else Estimate(),
        estimates[n + 1] if terms.has_slip else Estimate(),
        estimates[n + 2] if terms.has_slip else Estimate(),
        largest,
    )


def _update_mode_fit(fit: ModeFit, found: FittedForm, estimates: list[Estimate]) -> ModeFit:
    """Return the fit of the mode under test with the law by simulation."""
    terms, values = found.form.own[fit.mode], found.values.own[fit.mode]
    explained = {mode for each in found.values.couplings for mode in each.modes}
    n_k, n = len(values.stiffness), len(values.stiffness) + len(values.damping)
    covariance, vector = found.covariance[: n + 3, : n + 3], np.array(values.flatten())
    k, c, joint = terms.powers.k, terms.powers.c, values.joint

    def slip_force(at: FloatArray, own: FloatArray) -> FloatArray:
        slip, chi = own[n + 1], own[n + 2]
        return slip * at ** (2 + chi) / ((1 + chi) * (2 + chi))

    def stiffness_force(at: FloatArray, own: FloatArray) -> FloatArray:
        return sum((own[i] * at**power for i, power in enumerate(k) if power > 1), -slip_force(at, own))

    def damping_force(at: FloatArray, own: FloatArray) -> FloatArray:
        powers = (own[n_k + i] * at**power for i, power in enumerate(c) if power > 1)
        return sum(powers, own[n] * (at > 0))

    curves = []
    for curve, force, corrected in (
        (fit.stiffness_curve, stiffness_force, values.stiffness.get(1, 0.0)),
        (fit.damping_curve, damping_force, values.damping.get(1, 0.0)),
    ):
        at = curve.position
        slopes = differentiate(lambda own, at=at, force=force: force(at, own), vector)  # type: ignore[misc]
        half = 1.96 * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))
        middle = force(at, vector)
        before = float(fit.stiffness[1].value or 0.0) if curve is fit.stiffness_curve and 1 in fit.stiffness else 0.0
        if curve is fit.damping_curve and 1 in fit.damping:
            before = float(fit.damping[1].value or 0.0)
        linear = curve.linear + (corrected - before) * at
        curves.append(replace(curve, force=middle, low=middle - half, high=middle + half, linear=linear))
    amplitude = curves[0].position
    square = (2 * np.pi * fit.frequency_hz) ** 2 + linearised(k, values.stiffness.values(), amplitude)
    omega = np.sqrt(np.maximum(square - joint.find_softening(amplitude), 0.0))
    viscous = 4 * np.pi * fit.damping_ratio * fit.frequency_hz
    damping = viscous + linearised(c, values.damping.values(), omega * amplitude)
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = damping + np.where(amplitude > 0, joint.find_damping(amplitude) / omega, 0.0)
    updated = replace(
        fit,
        stiffness_order=terms.powers.orders[0],
        damping_order=terms.powers.orders[1],
        free_linear=1 in k,
        residual_fraction=float(found.missed[0]),
        stiffness=dict(zip(k, estimates, strict=False)),
        damping=dict(zip(c, estimates[n_k:], strict=False)),
        friction=estimates[n] if terms.has_friction else Estimate(),
        slip=estimates[n + 1] if terms.has_slip else Estimate(),
        slip_exponent=estimates[n + 2] if terms.has_slip else Estimate(),
        stiffness_curve=curves[0],
        damping_curve=curves[1],
        frequency_at_hz=omega / (2 * np.pi),
        damping_at=damping / np.maximum(2 * omega, 1e-300),
        interactions=tuple(each for each in fit.interactions if each.other not in explained),
    )
    outdated = {*warn_of_fit(fit), *(each.sentence for each in fit.interactions if each.other in explained)}
    kept = [text for text in fit.warnings if text not in outdated]
    return replace(updated, warnings=(*kept, *warn_of_fit(updated)))


def _warn_of_fit(fit: SystemFit, found: FittedForm, has_rivals: bool) -> Iterator[str]:
    names = ("modes " if len(fit.modes) > 1 else "mode ") + " and ".join(str(mode) for mode in fit.modes)
    for mode, missed in fit.missed.items():
        if missed > SIMULATED.warned_missed:
            yield (
                f"the law of {names} by simulation misses {100 * missed:.0f} % of the motion of mode {mode}: "
                "a term is not among those that were tried, or the linear modes are of another state"
            )
    if has_rivals:
        yield (
            f"{names}: joints that are stretched in opposite directions explain the tests as well, and the intervals "
            "hold both; give tests at higher levels"
        )
    if not found.minimum.is_converged:
        yield f"the search for the law of {names} did not come to an end: use its values with care"
    small = [
        each.product.name
        for each in fit.couplings
        if abs(float(each.coefficient.value or 0.0)) < 2 * float(each.coefficient.std or 0.0)
    ]
    if small:
        yield f"these tests cannot tell the coupling(s) {', '.join(small)} from zero"


def _free_scales(system: System, found: FittedForm) -> FittedForm | None:
    """Return the fit in which the measured motion of each driven mode has a scale of its own; None without couplings.

    No force shows the modal mass of a driven mode, but what it pulls back does: with a wrong shape no potential fits
    both equations.
    """
    if not found.values.couplings:
        return None
    ones = np.ones(len(system.numbers) - 1)
    with suppress(InputError):
        return fit_form(system, replace(found.form, has_scales=True), np.append(found.vector, ones), is_near=True)
    return None


def _list_wrong_scales(freed: FittedForm) -> dict[int, tuple[float, float]]:
    """Return the scales that are not 1 beyond doubt, with their standard deviations, by the number of the mode."""
    std = freed.std[-len(freed.values.scales) :].tolist()
    found = {mode: (scale, own) for (mode, scale), own in zip(freed.values.scales.items(), std, strict=True)}
    return {mode: each for mode, each in found.items() if abs(each[0] - 1) > MODAL.joint_sigma * each[1]}


def _find_error_by_scale(found: FittedForm, freed: FittedForm) -> FloatArray | float:
    """Return how far a scale that is not 1 beyond doubt moves the values, flattened."""
    values = found.values.flatten()
    return freed.values.flatten()[: values.size] - values if _list_wrong_scales(freed) else 0.0


def _warn_of_scales(freed: FittedForm) -> Iterator[str]:
    """Warn of driven modes whose motion is measured too large or too small."""
    for mode, (scale, std) in _list_wrong_scales(freed).items():
        if abs(scale - 1) > MODAL.warned_mass:
            yield (
                f"the motion of mode {mode} is {scale:.3g} times what its pull on the other mode asks for (standard "
                f"deviation {std:.1g}): its shape may be {1 / scale:.3g} times too large, and the couplings are wrong "
                "by powers of this; check the scale of the shape"
            )
