"""The law of a mode from its free decays alone: powers of displacement and velocity, dry friction, a joint.

    q'' + c0 q' + k0 q + sum c_n q'|q'|^(n-1) + sum k_n q|q|^(n-1) + F sgn(q') + (the force of a joint) = 0

Start values come from the harmonic linearisation of frequency and damping over amplitude (`law_search`). Then amplitude
and phase of each decay are fitted to the measured ones over all its time, by the slow flow of the law (`slow_flow`).
Several forms of the law are fitted; the values at zero amplitude contain the choice among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.modal.decay.answer import describe_law
from opid.modal.decay.close_line import CloseLine, LawAlone, find_close_line
from opid.modal.decay.form_fit import FitWithout, FormFit
from opid.modal.decay.forms import DecayProblem, FittedForms, TriedForms, try_forms, weigh_fits
from opid.modal.decay.law import CloseModesError, DecayLaw, withhold_intervals
from opid.modal.decay.law_search import LawForm, Linearisation, score_misfit
from opid.modal.decay.scaled_track import FitUnits, ScaledTrack
from opid.modal.decay.slow_flow import CloseModes, fit_close_modes
from opid.modal.decay.track import Track
from opid.modal.forced.restoring_fit import find_jackknife
from opid.modal.joint_terms import JOINT_KINDS, JointKind, read_memory
from opid.modal.power_laws import HIGHEST_ORDER
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

UNTOLD = (
    "the law misses the decay beyond its noise and cannot be fitted without a stretch of it, so that no interval is "
    "given: record with less noise, or lower the orders"
)


def find_backbone(track: Track, derivative: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return displacement amplitude, natural frequency (rad/s), its std, c = 2 zeta omega (1/s) and its std, each (n,).

    From phase and amplitude of a free vibration A(t) cos phi(t) (Feldman 1994, Mech. Syst. Signal Process. 8, eq. 6)

        omega^2 = phi'^2 - A''/A - c A'/A,   c = -2 A'/A - phi''/phi',

    where A = B / |j phi' - delta|^m for the m-th derivative of the displacement that the track shows.
    """
    rate = track.rate + derivative * track.chirp / track.omega
    damping = 2.0 * rate + -track.chirp / track.omega
    amplitude = track.amplitude / (track.omega**2 + rate**2) ** (0.5 * derivative)
    order = np.argsort(track.time_s)
    smooth = np.polyfit(track.time_s[order], rate[order], 1, w=1.0 / np.maximum(track.rate_std[order], 1e-300))[0]
    natural = np.sqrt(np.maximum(track.omega**2 - rate**2 + smooth + damping * rate, 1e-300))
    drift_std = MODAL.drift_error * (2 * derivative - 1) * track.chirp / track.omega
    return amplitude, natural, track.omega_std, damping, np.hypot(2.0 * track.rate_std, drift_std)


def fit_decays(
    tracks: Sequence[Track],
    *,
    derivative: int = 2,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    friction: bool | None = None,
    memory: bool | str | None = None,
    gain_std: float = 0.0,
) -> DecayLaw:
    """Fit one law to one or several free decays of a mode.

    The tracks are of accelerations, or of velocities (`derivative` 1) or displacements (0). An order of 1 is linear;
    where an order is None, the one with the lowest Bayesian criterion is taken. So are dry friction and an Iwan joint,
    if the order of the damping is found; where it is given, they are only there if asked for. Where nothing is given
    and these laws miss the decays beyond noise, a joint of a named kind is tried (`_prefer_joint`). The memory may be
    the name of a kind of joint, which the law then has (`read_memory`): the laws without it are its rivals.

    Several decays are repeats: k0 and c0 may differ between them, the other coefficients are common. The intervals of
    k0, c0 and of the values at zero amplitude then hold the mean of such repeats. The intervals of the coefficients
    allow for a common gain of all amplitudes of the standard deviation `gain_std`, as a fraction.

    Raises:
        InputError: orders outside 1 to 5, or a memory that is no kind of joint.
        NotDeterminedError: fewer windows than coefficients, a law that does not decay, or two linear modes that explain
            the decays better (`CloseModesError`).
    """
    problem = _make_problem(tracks, derivative, stiffness_order, damping_order, gain_std)
    close = _find_close_modes(problem.decays)
    try:
        if isinstance(memory, str):
            fitted = _fit_named_joint(problem, friction, memory)
        else:
            free = None if damping_order is None else False
            asked = [free if each is None else each for each in (friction, memory)]
            fitted = _add_terms_beside_friction(problem, _fit_what_is_asked(problem, *asked), *asked)
            if {stiffness_order, damping_order, friction, memory} == {None}:
                fitted = _prefer_joint(problem, fitted)
    except NotDeterminedError:
        _refuse_close_modes(problem, close, None)
        raise
    fitted = _allow_for_higher_orders(problem, fitted)
    is_rival = _refuse_close_modes(problem, close, fitted.best)
    fitted = _doubt_without_friction(problem, fitted) if friction is None and not isinstance(memory, str) else fitted
    if is_rival:
        return _withhold_for_rival(describe_law(problem, fitted), close[0].scaled(problem.units.rate))
    return describe_law(problem, _add_model_error(problem, fitted))


def find_line_beside(
    track: Track,
    law: DecayLaw | None,
    *,
    derivative: int,
    stiffness_order: int | None,
    damping_order: int | None,
) -> CloseLine | None:
    """Return a close line that explains what the law of a decay misses beyond noise; None where nothing shows one.

    Args:
        track: the decay.
        law: its law without a line; None where none was found.
        derivative: the derivative of the displacement that was measured.
        stiffness_order: order that is asked for; it and `damping_order` are those of `fit_decays`.
    """
    problem = _make_problem([track], derivative, stiffness_order, damping_order, 0.0)
    if law is None:
        return find_close_line(problem, track, None)
    form = LawForm(
        len(law.stiffness), len(law.damping), law.joint_estimates.friction.value is not None, law.joint_estimates.kind
    )
    values = [*law.stiffness.values(), *law.damping.values()]
    values += [law.joint_estimates.friction] * form.has_friction + list(law.joint_estimates.values)
    vector = np.array([float(each.value or 0.0) for each in values])
    vector = vector / problem.units.find_factors(form, vector)
    squares = law.misfit**2 * max(problem.n_data - form.size - 2, 1)
    if not problem.is_beyond_noise(squares, form.size + 2, MODAL.chance_line):
        return None
    return find_close_line(problem, track, LawAlone(form, vector, squares))


def _make_problem(
    tracks: Sequence[Track], derivative: int, stiffness_order: int | None, damping_order: int | None, gain_std: float
) -> DecayProblem:
    """Return decays in units in which the coefficients of all powers have similar sizes."""
    for word, order in (("stiffness_order", stiffness_order), ("damping_order", damping_order)):
        if order is not None and not 1 <= order <= HIGHEST_ORDER:
            raise InputError(f"{word} is {order}, give 1 (linear) to {HIGHEST_ORDER}")
    amplitude, natural, natural_std, damping, damping_std = (
        np.concatenate(parts) for parts in zip(*(find_backbone(each, derivative) for each in tracks), strict=True)
    )
    length, rate = float(amplitude.max()), float(np.median(natural))
    level, square = amplitude / length, (natural / rate) ** 2
    seen = Linearisation(
        level,
        square,
        2.0 * natural_std * natural / rate**2,
        level * natural / rate,
        damping / rate,
        damping_std / rate,
    )
    return DecayProblem(
        seen,
        [ScaledTrack.from_track(track, length, rate, derivative) for track in tracks],
        FitUnits(length, rate, derivative, gain_std),
        stiffness_order,
        damping_order,
    )


def _fit_what_is_asked(problem: DecayProblem, friction: bool | None, memory: bool | None) -> FittedForms:
    """Return the forms that describe the decays; where a joint is not determined, the best ones without it."""
    tried = try_forms(problem, problem.search_forms(friction, memory))
    if tried.fits:
        return FittedForms(weigh_fits(problem, tried.fits), False, ())
    if friction is not None and memory is not None:
        raise tried.failed or NotDeterminedError("no law describes the decay: lower the orders")
    simpler = try_forms(problem, problem.search_forms(friction or False, memory or False))
    if not simpler.fits:
        raise tried.failed or NotDeterminedError("no law describes the decay: lower the orders")
    fits = weigh_fits(problem, simpler.fits)
    is_doubted = bool(problem.score([fits[0][0], *tried.undetermined])[0] > MODAL.decisive)
    return FittedForms(
        fits,
        is_doubted,
        (
            "the curves suggest dry friction or a joint that slips, which this decay does not determine: the law is "
            "the best one without, for these amplitudes only"
            + (", and the damping at zero amplitude is not told" if is_doubted else "")
            + "; record with less noise or a stronger impact",
        ),
    )


def _add_terms_beside_friction(
    problem: DecayProblem, fitted: FittedForms, friction: bool | None, memory: bool | None
) -> FittedForms:
    """Return a law with terms of damping beside friction, where only they explain the decays within their noise.

    Few windows hardly tell such terms from friction, so that they are not tried first (`windows_per_term`).
    """
    best = fitted.best
    if friction is False or problem.damping_order is not None or not problem.find_unexplained(best):
        return fitted
    try:
        forms = problem.search_forms(True, memory, may_imitate=True)
    except NotDeterminedError:
        return fitted
    n_windows, most = problem.n_data // 2, MODAL.most_terms_with_friction
    forms = [each for each in forms if each[0].is_imitated_by_friction(n_windows) and each[0].n_damping <= most]
    found = try_forms(problem, forms).fits
    found = [fit for fit in found if not (problem.find_unexplained(fit) or fit.is_at_edge or fit.is_active)]
    if not found or float(problem.score([best, *found])[0]) <= MODAL.decisive:
        return fitted
    return FittedForms(weigh_fits(problem, [*found, *(fit for fit, _ in fitted.fits)]), False, ())


def _fit_named_joint(problem: DecayProblem, friction: bool | None, memory: str) -> FittedForms:
    """Return laws with a named joint, with the laws that are tried without a name as rivals that widen the intervals.

    Powers and friction imitate the softening and the loss of a joint, so that they stand beside it only if asked for.
    """
    own = _fit_joint(problem, friction or False, memory)
    if not own:
        raise NotDeterminedError(
            f"the decay does not determine {memory}: its largest force and the travel at which all of it slides are "
            "only told by motions to both sides of that travel; hit harder, record with less noise, or leave memory out"
        )
    chosen = weigh_fits(problem, own)[0][0]
    try:
        free = None if problem.damping_order is None else False
        others = try_forms(problem, problem.search_forms(free if friction is None else friction, free)).fits
    except NotDeterminedError:
        others = []
    fits = [chosen, *(each for each in (*own, *others) if each is not chosen and not each.is_at_edge)]
    fits = [each for each in fits if not each.is_active or each is chosen]
    behind = problem.score(fits)
    least = min((float(score) for score, fit in zip(behind, fits, strict=True) if fit in others), default=np.inf)
    gain, warnings = least - float(behind[0]), []
    if gain < -MODAL.decisive:
        warnings.append(
            f"laws without {memory} explain the decay better (by {-gain:.3g} in the Bayesian criterion, "
            f"{MODAL.decisive:g} is decisive), so that no intervals of joint and damping are told: leave memory out, "
            "or ask for powers beside the joint (stiffness_order, damping_order), of which it has none by itself"
        )
    elif gain < MODAL.decisive:
        warnings.append(
            f"the decay hardly tells {memory} from laws without it (by {gain:.3g} in the Bayesian criterion, "
            f"{MODAL.decisive:g} is decisive): the intervals of the curves contain the choice, those of the joint hold "
            "only if it is of this kind; record a larger range of amplitudes"
        )
    return FittedForms(
        list(zip(fits, problem.weigh(fits).tolist(), strict=True)), gain < -MODAL.decisive, tuple(warnings)
    )


def _fit_joint(problem: DecayProblem, friction: bool, memory: str) -> list[FormFit]:
    """Return the forms with a named joint that the decays determine, without powers that are not asked for."""
    alone = replace(problem, stiffness_order=problem.stiffness_order or 1, damping_order=problem.damping_order or 1)
    found: list[FormFit] = []
    ranked: set[JointKind | None] = set()
    with suppress(NotDeterminedError):
        ranked |= {form.memory for form, _ in alone.search_forms(friction, memory)}
    # Each kind is tried by itself, for one that the harmonic linearisation ranks low may explain all.
    for kind in read_memory(memory):
        with suppress(NotDeterminedError):
            fits = try_forms(alone, alone.search_forms(friction, kind)).fits
            found += [fit for fit in fits if kind in ranked or not problem.find_unexplained(fit)]
    return found


def _prefer_joint(problem: DecayProblem, fitted: FittedForms) -> FittedForms:
    """Return a law with a joint of a kind that has a name, where it alone explains the decays within their noise."""
    if not problem.find_unexplained(fitted.best):
        return fitted
    tried = [fit for name in JOINT_KINDS for fit in _fit_joint(problem, False, name)]
    found = [fit for fit in tried if not (problem.find_unexplained(fit) or fit.is_at_edge or fit.is_active)]
    # A joint that yields sharply is hardly told from one slider, which is the simpler one.
    found = [fit for fit in found if not fit.form.is_sharp(fit.vector)] or found
    behind = problem.score([*found, *(fit for fit, _ in fitted.fits)])
    gain = float(behind[len(found) :].min() - behind[: len(found)].min(initial=np.inf))
    if gain <= MODAL.decisive:
        return fitted
    fits = weigh_fits(problem, [*found, *(fit for fit, _ in fitted.fits)])
    kind = fits[0][0].form.memory
    assert kind is not None
    is_other = np.array([fit.form.memory is not None and fit.form.memory.name != kind.name for fit in found])
    apart = float(behind[: len(found)][is_other].min(initial=np.inf) - behind[: len(found)].min())
    is_sure = apart > MODAL.decisive
    warning = (
        f"powers, dry friction and slip do not explain the decay, but {kind.words} does (by {gain:.3g} in the Bayesian "
        f"criterion, {MODAL.decisive:g} is decisive)"
        + ("" if is_sure else f"; a joint of another kind does almost as well (by {apart:.3g}): its kind is not told")
    )
    return FittedForms(fits, False, (warning,))


def _allow_for_higher_orders(problem: DecayProblem, fitted: FittedForms) -> FittedForms:
    """Return a law with the one of an order less as a rival that counts fully, where the highest order was chosen.

    The decay might ask for more powers, or for none but a fractional one, so the last step of the orders shows how far
    the curves and the values at zero amplitude still move.
    """
    best, lower = fitted.best, []
    asked = (problem.stiffness_order, problem.damping_order)
    for number, order in enumerate((best.form.stiffness_order, best.form.damping_order)):
        if asked[number] is not None or order < HIGHEST_ORDER:
            continue
        n_k, n_c = best.form.stiffness_order - (number == 0), best.form.damping_order - (number == 1)
        form = LawForm(n_k, n_c, best.form.has_friction, best.form.memory)
        guess = np.delete(best.vector, n_k if number == 0 else n_k + n_c)
        with suppress(NotDeterminedError):
            lower.append(problem.fit(form, guess))
    lower = [fit for fit in lower if not fit.is_at_edge]
    own = [(fit, weight) for fit, weight in fitted.fits if fit.form not in {each.form for each in lower}]
    return replace(fitted, fits=[*own, *((fit, MODAL.last_step**2) for fit in lower)])


def _doubt_without_friction(problem: DecayProblem, fitted: FittedForms) -> FittedForms:
    """Return a law from which given orders exclude dry friction, with friction as a rival that widens its intervals.

    The law is doubted where friction explains decisively more. The powers of damping beside friction may be fewer than
    those asked for.
    """
    best, order = fitted.best, problem.damping_order
    if order is None or best.form.has_friction:
        return fitted
    try:
        rivals = replace(problem, damping_order=None).search_forms(True, False)
    except NotDeterminedError:
        return fitted
    likely = [each for each in rivals if each[0].damping_order <= order][: MODAL.rivals_with_friction]
    fits = [best, *(each for each in try_forms(problem, likely).fits if not each.is_at_edge)]
    gain = float(problem.score(fits)[0])
    if gain <= MODAL.decisive:
        return replace(fitted, fits=list(zip(fits, problem.weigh(fits).tolist(), strict=True)))
    return FittedForms(
        fitted.fits,
        True,
        (
            *fitted.warnings,
            f"dry friction explains the decay better than powers of the damping_order {order} (by {gain:.3g} in the "
            f"Bayesian criterion, {MODAL.decisive:g} is decisive): neither damping at zero amplitude nor intervals of "
            "the damping are told; leave damping_order out, so that the law may have friction",
        ),
    )


def _add_model_error(problem: DecayProblem, fitted: FittedForms) -> FittedForms:
    """Return a law that misses the decays beyond noise with intervals that hold what it misses.

    A true law is the same in each stretch of a decay. So each stretch is left out in turn, and the scatter of the
    answers counts as far as noise does not explain the misfit. So does what the law misses of the measured curves.
    """
    part = problem.find_unexplained(fitted.best)
    if not part or fitted.best.is_at_edge:
        return fitted
    likely = [(fit, weight) for fit, weight in fitted.fits if weight or fit is fitted.best]
    fits = [(_fit_without_stretches(problem, fit), weight) for fit, weight in likely]
    if fits[0][0].is_untold:
        return replace(fitted, warnings=(*fitted.warnings, UNTOLD), is_untold=True)
    told = (
        f"the law misses amplitude and phase by {fitted.best.misfit:.2g} standard deviations of their noise: all "
        "intervals hold what changes where a stretch of the decay is left out, and how far the curves of the law are "
        "from the measured ones"
    )
    fitted = replace(fitted, part=part)
    if fitted.is_another_kind:
        told += "; the damping at zero amplitude, to which only a law leads, is not told"
    fits = [(fit, weight) for fit, weight in fits if not fit.is_untold]
    return replace(fitted, fits=fits, warnings=(*fitted.warnings, told))


def _fit_without_stretches(problem: DecayProblem, fit: FormFit) -> FormFit:
    """Return a form with its fits to the decays without one of some stretches, and their scatter in its covariance."""
    part = problem.find_unexplained(fit)
    if not part:
        return fit
    without = []
    for number in range(MODAL.n_blocks):
        decays = [each.leave_out(number) for each in problem.decays]
        logs = np.concatenate([each.log_amplitude for each in decays])
        try:
            vector = replace(problem, decays=decays).fit(fit.form, fit.vector).vector
        except (NotDeterminedError, np.linalg.LinAlgError):
            return replace(fit, is_untold=True)
        without.append(FitWithout(vector, float(logs.min()), float(logs.max())))
    steps = np.array([each.vector for each in without]) - fit.vector
    return replace(fit, model_error=part * find_jackknife(steps), part=part, without=tuple(without))


def _find_close_modes(decays: Sequence[ScaledTrack]) -> list[CloseModes]:
    """Return the two linear modes that explain each decay; none where they do not."""
    found = [
        fit_close_modes(each.time, each.log_amplitude, each.phase, each.root)
        for each in decays
        if 2 * each.time.size > CloseModes.SIZE + 2
    ]
    return found if len(found) == len(decays) and all(each.is_plausible for each in found) else []


def _refuse_close_modes(problem: DecayProblem, close: Sequence[CloseModes], best: FormFit | None) -> bool:
    """Refuse decays that two linear modes explain better than the best law, None without one.

    Returns:
        Whether they explain the decays as well as the law, so that nothing tells which is right.
    """
    if not close:
        return False
    # A law of other terms than those that are asked for speaks against two modes, too.
    free = replace(problem, stiffness_order=None, damping_order=None)
    try:
        others = try_forms(free, free.search_forms(None, None))
    except NotDeterminedError:
        others = TriedForms([], [], None)
    laws = [*([] if best is None else [best]), *others.fits, *others.undetermined]
    if laws:
        best = laws[int(np.argmin(problem.score(laws)))]
        squares = [best.squares, sum(each.squares for each in close)]
        scores = score_misfit(squares, problem.n_data, [best.form.size * len(close), CloseModes.SIZE * len(close)])
        better = float(scores[0] + best.form.prior_score - scores[1] - MODAL.joint_evidence)
        if better < MODAL.joint_evidence:
            return better > -MODAL.bare_mention
    modes = close[0].scaled(problem.units.rate)
    low, high = modes.frequency_hz
    raise CloseModesError(
        f"two linear modes at {low:.6g} and {high:.6g} Hz, whose beat is slow, explain the decay better than a law of "
        "one mode: frequency and damping over amplitude are those of their sum; separate the modes with several "
        "sensors (a modal filter), or hit where one of them hardly moves",
        modes,
    )


def _withhold_for_rival(law: DecayLaw, close: CloseModes) -> DecayLaw:
    """Return a law without intervals, because two close modes explain the decays as well."""
    low, high = close.frequency_hz
    told = (
        f"the decay is too short to tell this law from two linear modes at {low:.6g} and {high:.6g} Hz, so that no "
        "interval is given: add decays of other heights from other places, or separate the modes with several sensors "
        "(a modal filter)"
    )
    return replace(withhold_intervals(law), warnings=(*law.warnings, told), close_modes=close)
