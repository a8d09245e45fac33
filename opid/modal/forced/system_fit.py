"""The law of a mode, or of several modes that drive each other, with friction, slip and couplings beyond powers.

Of the forms that were tried (`form_search`) the simplest good one is fitted to convergence, and becomes the law of the
mode under test, of the modes that it drives, and of their couplings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy import fft

from opid.errors import InputError, list_names, require_fraction
from opid.estimate import Estimate
from opid.mechanics.laws.law import Law
from opid.modal.couplings import Coupling, Product
from opid.modal.forced.equation import mode_lines
from opid.modal.forced.form_search import (
    Choice,
    Trial,
    choose_form,
    list_errors,
    list_joints,
    list_kinds,
    list_own,
    mirror,
    try_forms,
    try_other_joints,
)
from opid.modal.forced.mode_fit import ModeFit, is_delay_sure, widen_delay
from opid.modal.forced.mode_tests import Interaction
from opid.modal.forced.restoring_fit import find_common_gain, find_rms, find_shown_mass, list_near
from opid.modal.forced.simulated_fit import (
    FittedForm,
    estimate_joint,
    fit_force,
    fit_form,
    refine_form,
    update_mode_fit,
)
from opid.modal.forced.system import System, SystemValues, make_system
from opid.modal.joint_terms import TOO_SHARP, JointEstimates, ModalJoint
from opid.modal.linear.modes import ModalTest
from opid.modal.power_laws import coefficients_json, make_fitted_law
from opid.modal.settings import MODAL, SIMULATED
from opid.signals.recording import FloatArray


@dataclass(frozen=True)
class DrivenLaw:
    """The law of a driven mode by itself.

    Args:
        stiffness: k_n by its power n, (N/kg^1/2) / (m kg^1/2)^n; 1 is the correction of k0.
        damping: c_n by its power n, (N/kg^1/2) / (m/s kg^1/2)^n; 1 is the correction of c0.
        joint_estimates: friction and the joint with memory.
        largest: its largest displacement in the tests, m kg^1/2.
    """

    stiffness: Mapping[int, Estimate]
    damping: Mapping[int, Estimate]
    joint_estimates: JointEstimates
    largest: float

    @property
    def law(self) -> Law:
        """The nonlinear restoring force of the powers 2 and up."""
        return make_fitted_law(self.stiffness, self.damping)

    @property
    def joint(self) -> ModalJoint:
        """The joint, ready to be simulated."""
        return self.joint_estimates.make(self.largest)

    def as_json(self) -> dict[str, Any]:
        """Return the law as result.json holds it."""
        powers, joint = coefficients_json(self.stiffness, self.damping), self.joint_estimates.as_json("joint_")
        return {**powers, **joint, "largest": self.largest}


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
        dropped: why products or a joint that were named are not in the law, "" where all are, or none were named.
    """

    modes: tuple[int, ...]
    fit: ModeFit
    driven: Mapping[int, DrivenLaw]
    couplings: tuple[Coupling, ...]
    ratios: Mapping[int, Estimate]
    missed: Mapping[int, float]
    trials: tuple[LawTrial, ...]
    warnings: tuple[str, ...]
    dropped: str = ""

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
    memory: str | None = None,
    search_own: bool = True,
    free_linear: bool = True,
    gain_tolerance: float = MODAL.gain_tolerance,
) -> SystemFit:
    """Fit the law of a mode, and of the modes that it drives, by simulation.

    Args:
        tests: the tests that the mode was fitted to.
        fit: the mode by itself, whose powers are the start.
        interactions: the modes that it drives.
        products: the products by which they do, if they are known; searched where None.
        memory: the name of a kind of joint, which the law then has if the tests determine it (`read_memory`); None
            where it is not known: then joints of named kinds are tried where nothing else explains a mode alone.
        search_own: whether friction and slip are tried beside the powers.
        free_linear: whether k0 and c0 of the driven modes, and beside slip and joints, are corrected.
        gain_tolerance: standard deviation of the gains of force and accelerations, as in `fit_mode`.

    Raises:
        InputError: no form of the law could be fitted, or a memory that is no kind of joint.
    """
    require_fraction("gain_tolerance", gain_tolerance)
    bands = {fit.mode: fit.band_hz} | {each.other: each.band_hz for each in interactions}
    bands |= {
        mode: _choose_band(tests[0], mode) for product in products or () for mode in product.modes if mode not in bands
    }
    largest = {mode: max(mode_lines(test, mode, band).largest_q for test in tests) for mode, band in bands.items()}
    system = make_system(tests, bands, largest, step_rad=SIMULATED.first_step_rad)
    first = tuple(products) if products is not None else tuple(each.product for each in interactions)
    guesses = np.array([_guess_product(tests, bands, each) / system.measure_product(each) for each in first])
    kinds = list_kinds(memory)
    free: dict[str, bool] = {"search_own": search_own, "free_linear": free_linear}
    own = [*list_own(system, fit, **free), *list_joints(system, fit, kinds, **free)]
    trials = try_forms(system, own, first, guesses, has_joint=products is None, free_linear=free_linear)
    finer = make_system(tests, bands, largest, step_rad=SIMULATED.step_rad)
    asked = (memory, products or (), gain_tolerance)
    found = _choose_law(system, finer, fit, trials, *asked) if trials else None
    has_more = (search_own or kinds) and len(bands) == 1
    if has_more and (found is None or found.fit.misfit > SIMULATED.unexplained):
        more = try_other_joints(system, fit, kinds, found.fit.misfit if found else np.inf, **free)
        found = _choose_law(system, finer, fit, [*trials, *more], *asked) if more else found
    if found is None:
        raise InputError(_explain_unbounded(tests, fit, first))
    return found


def _choose_law(
    system: System,
    finer: System,
    fit: ModeFit,
    trials: Sequence[Trial],
    memory: str | None,
    products: Sequence[Product],
    gain_tolerance: float,
) -> SystemFit:
    """Return the fit of the simplest good form whose joint the tests determine, with what is to be told of it."""
    while True:
        choice = choose_form(trials, fit.mode, memory)
        likely = _refine_trial(system, finer, choice.trial)
        made = _make_fit(finer, fit, trials, choice.trial, likely, gain_tolerance)
        kept = [each for each in trials if each is not choice.trial]
        if made.fit.joint_estimates.stands_out or not kept:
            break
        # The joint is determined only as long as forms are compared.
        trials = kept
    dropped = [choice.dropped, _explain_dropped(products, trials, choice.trial)]
    return replace(_tell_joint(made, choice), dropped="; ".join(each for each in dropped if each))


def _refine_trial(system: System, finer: System, trial: Trial) -> list[FittedForm]:
    """Return the likely ends of the search of a form, the likeliest first, fitted to convergence with finer steps.

    Ends far from convergence get there with the longer steps, from where the finer ones are near.
    """
    ends = [trial.found]
    if trial.found.form.joint:
        # The form was found with one sign of its joint; the mirrored one may explain the tests as well, or better.
        with suppress(InputError):
            ends.append(fit_form(system, trial.found.form, mirror(trial.found), is_near=True))
    for steps in (system, finer):
        ends = sorted((refine_form(steps, each) for each in ends), key=lambda each: each.score)
        ends = [each for each in ends if each.score <= ends[0].score + MODAL.rival_score]
    return ends


def _tell_joint(made: SystemFit, choice: Choice) -> SystemFit:
    """Return a fit with what is to be told of its joint."""
    joint, warnings = made.fit.joint_estimates, [choice.warning] if choice.warning else []
    missed, named = made.missed[made.fit.mode], joint.named
    if named is not None and missed > SIMULATED.warned_missed:
        joint = joint.with_estimates(Estimate.without_interval)
        warnings.append(
            f"mode {made.fit.mode}: with a joint of the kind {named.name} the law still misses {100 * missed:.0f} % of "
            "the motion, so that its values have no intervals: it is of another kind, or powers stand beside it (give "
            "their orders)"
        )
    elif joint.kind and joint.kind.is_sharp(tuple(float(each.value or 0.0) for each in joint.values)):
        joint = replace(joint, values=(*joint.values[:-1], joint.values[-1].without_interval()))
        warnings.append(f"mode {made.fit.mode}: {TOO_SHARP}")
    fit = replace(made.fit, joint_estimates=joint)
    return replace(made, fit=fit, warnings=(*made.warnings, *warnings))


def _explain_unbounded(tests: Sequence[ModalTest], fit: ModeFit, products: Sequence[Product]) -> str:
    """Return why no law could be simulated: what the search was given, what it needs, and what to do."""
    powers = [f"k{n}" for n in fit.stiffness if n > 1] + [f"c{n}" for n in fit.damping if n > 1]
    terms = ", ".join([*powers, *(each.name for each in products)]) or "no nonlinear terms"
    return (
        f"no law of mode {fit.mode} could be simulated: with the values that the search begins with ({terms}, from the "
        "equation of motion) the model grows without bound under the forces of "
        f"{list_names(repr(each.name) for each in tests)}, which move the mode up to {fit.joint.largest:.3g} m kg^1/2, "
        "or no joint that was tried stands out, where a search needs a bounded motion in every test; give tests at "
        "lower levels, too, lower orders, or name fewer couplings"
    )


def _explain_dropped(products: Sequence[Product], trials: Sequence[Trial], chosen: Trial) -> str:
    """Return why the law that was chosen lacks products that were named, "" where it has them."""
    if {*products} <= {*chosen.found.values.couplings}:
        return ""
    names = ", ".join(each.name for each in products)
    with_them = [each for each in trials if {*products} <= {*each.found.values.couplings}]
    if not with_them:
        return (
            f"the coupling(s) {names} that the study names are left out of the law: with them no model of the tests "
            "stays bounded, or its terms are not determined; give tests at lower levels, too"
        )
    best = min(with_them, key=lambda each: find_rms(each.found.errors))
    without, having = (find_rms(each.found.errors) for each in (chosen, best))
    return (
        f"the coupling(s) {names} that the study names are left out of the law: each test in turn is missed by the law "
        f"of the others by {100 * without:.2g} % of the motion without them, and by {100 * having:.2g} % with them, so "
        "that these tests do not show them; give tests that move all of its modes, or leave it out of the study"
    )


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


def _make_fit(
    system: System,
    fit: ModeFit,
    trials: Sequence[Trial],
    chosen: Trial,
    likely: Sequence[FittedForm],
    gain_tolerance: float,
) -> SystemFit:
    """Return the fit of the first of the likely ends of the search of the chosen form."""
    system, likely, mass, delay = _correct_delay(system, fit, likely)
    found, has_rivals = likely[0], len(likely) > 1
    near = [trials[index] for index in list_near(*list_errors(trials))]
    others = [each.found for each in near if each.found.form != chosen.found.form]
    spread = _find_spread(found, [*others, *likely])
    freed = _free_scales(system, found)
    by_scale = _find_error_by_scale(found, freed) if freed else 0.0
    by_mass = _find_error_by_mass(system, found, find_shown_mass(mass))
    by_delay = _find_error_by_delay(system, found, delay)
    by_gain = find_common_gain(gain_tolerance) * (_count_factors(found.values) - 1.0) * found.values.flatten()
    more = spread**2 + _find_model_errors(system, found) ** 2 + by_scale**2 + by_mass**2 + by_delay**2 + by_gain**2
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
    updated = update_mode_fit(
        fit, found, estimates[fit.mode], misfit=found.find_excess(system), mass=mass, delay_s=delay
    )
    made = SystemFit(system.numbers, updated, driven, couplings, ratios, missed, rungs, ())
    warnings = [*_warn_of_fit(made, found, has_rivals), *(_warn_of_scales(freed) if freed else ())]
    return replace(made, warnings=tuple(warnings))


def _correct_delay(
    system: System, fit: ModeFit, likely: Sequence[FittedForm]
) -> tuple[System, Sequence[FittedForm], Estimate, Estimate]:
    """Return the system with forces that come later by the delay beside its law, its fits, the modal mass, that delay.

    The system is given with the delay that the powers show. A joint bends the phase of each level as powers do not, and
    what they make of that is mistaken for a delay.
    """
    given_s = float(fit.delay_s.value or 0.0) if fit.is_delayed else 0.0
    shifted, applied_s = system, given_s
    for step in range(SIMULATED.delay_steps):
        mass, left = fit_force(shifted, likely[0])
        if left.value is None:
            return system, likely, mass, fit.delay_s
        k0 = float(system.modes.stiffness()[0])
        delay = widen_delay(Estimate.normal(applied_s + left.value, float(left.std or 0.0)), k0)
        wanted_s = float(delay.value or 0.0) if is_delay_sure(delay) else 0.0
        if step + 1 == SIMULATED.delay_steps or abs(wanted_s - applied_s) < SIMULATED.delay_left * float(
            left.std or 0.0
        ):
            break
        shifted, applied_s = system.delay_forces(wanted_s - given_s), wanted_s
        likely = [refine_form(shifted, each) for each in likely]
    return shifted, likely, mass, delay


def _find_error_by_delay(system: System, found: FittedForm, delay: Estimate) -> FloatArray:
    """Return how far the error of a delay moves the values, flattened; see `restoring_fit.add_delay_error`."""
    values, value, std = found.values.flatten(), float(delay.value or 0.0), float(delay.std or 0.0)
    left_s = std if is_delay_sure(delay) else float(np.sqrt(max(value**2 - std**2, 0.0)))
    if not left_s:
        return np.zeros(values.size)
    try:
        return fit_form(system.delay_forces(left_s), found.form, found.vector, is_near=True).values.flatten() - values
    except InputError:
        return np.full(values.size, np.inf)


def _find_error_by_mass(system: System, found: FittedForm, mass: float) -> FloatArray:
    """Return how far a modal mass that is not 1 moves the values, flattened; see `restoring_fit.add_scale_error`."""
    values = found.values.flatten()
    if abs(mass - 1.0) < MODAL.least_mass_error:
        return np.zeros(values.size)
    scaled = replace(system, tests=tuple(replace(each, forces=each.forces / mass) for each in system.tests))
    try:
        by_force = fit_form(scaled, found.form, found.vector, is_near=True).values.flatten()
    except InputError:
        return np.full(values.size, np.inf)
    by_motion = by_force / mass ** (_count_factors(found.values) - 1.0)
    return np.hypot(by_force - values, by_motion - values)


def _count_factors(values: SystemValues) -> FloatArray:
    """Return how many factors of the motion the force of each value has, flattened; 1 of what has no unit of force."""
    counts: list[float] = []
    for own in values.own.values():
        counts += [*own.stiffness, *own.damping, *(0.0 for _ in own.friction)]
        counts += own.kind.count_powers(own.values) if own.kind else ()
    counts += [len(product.modes) - 1.0 for product in values.couplings]
    return np.array([*counts, *(1.0 for _ in (*values.ratios, *values.scales))])


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


def _find_model_errors(system: System, found: FittedForm) -> FloatArray:
    """Return standard deviations of the values, flattened, by steps of the simulation and by how friction sticks."""
    errors: list[float] = []
    linear = np.column_stack([system.modes.stiffness(), system.modes.damping()]).tolist()
    for (k0, c0), values in zip(linear, found.values.own.values(), strict=True):
        errors += [SIMULATED.stiffness_std * k0 if n == 1 else 0.0 for n in values.stiffness]
        errors += [SIMULATED.damping_std * c0 if n == 1 else 0.0 for n in values.damping]
        errors += [SIMULATED.friction_std * each for each in values.friction]
        of_joint = 0.0 if values.kind is None or values.kind.is_slip else SIMULATED.joint_std
        errors += [of_joint * each for each in values.values]
    return np.array([*errors, *(0.0 for _ in range(len(found.covariance) - len(errors)))])


def _make_law(found: FittedForm, mode: int, estimates: list[Estimate], largest: float) -> DrivenLaw:
    terms = found.form.own[mode]
    return DrivenLaw(*terms.split(estimates)[:2], estimate_joint(terms, estimates), largest)


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
    """Return the fit in which the measured motion of each driven mode has a scale of its own; None without such modes.

    No force shows the modal mass of a driven mode, but what it pulls back does: with a wrong shape no potential fits
    both equations.
    """
    if not found.values.couplings or len(system.numbers) == 1:
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
                f"deviation {std:.1g}): its shape may be {1 / scale:.3g} times the true one, and the couplings are "
                "wrong by powers of this, unless the law lacks a term; check the scale of the shape"
            )
