"""The law of a mode from its free decays alone: powers of displacement and velocity, dry friction, an Iwan joint.

    q'' + c0 q' + k0 q + sum c_n q'|q'|^(n-1) + sum k_n q|q|^(n-1) + F sgn(q') + (what the joint slips) = 0

Start values come from the harmonic linearisation of frequency and damping over amplitude (`law_search`). Then amplitude
and phase of each decay are fitted to the measured ones over all its time, by the slow flow of the law (`slow_flow`).
Several forms of the law are fitted; the values at zero amplitude contain the choice among them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.laws.law import Law
from opid.modal.decay.law_search import LawForm, Linearisation, score_misfit, search_forms
from opid.modal.decay.repeats import pool_repeats
from opid.modal.decay.slow_flow import CloseModes, Flow, fit_close_modes, predict_decay, solve_slow_flow
from opid.modal.decay.track import Track
from opid.modal.forced.restoring_fit import find_jackknife, sum_lagged_products
from opid.modal.joint_terms import ModalJoint, joint_rows, make_joint
from opid.modal.power_laws import HIGHEST_ORDER, coefficients_json, make_fitted_law
from opid.modal.settings import MODAL
from opid.result import SummaryRow
from opid.signals.recording import FloatArray

AT_EDGE = (
    "the best law lies at the edge of those that decay over all amplitudes of the record, where nothing tells how well "
    "its coefficients are known: lower the orders, or give another stretch"
)
UNTOLD = (
    "the law misses the decay beyond its noise and cannot be fitted without a stretch of it, so that no interval is "
    "given: record with less noise, or lower the orders"
)
CURVE_STEP = 1e-5  # step of a coefficient, in the units of a fit, by which the slopes of the curves are found
IMPOSSIBLE = 1e8  # error of a law that does not vibrate or does not decay over all the record, standard deviations


class CloseModesError(NotDeterminedError):
    """Two close linear modes explain a decay, and no law of one mode does so as well."""

    def __init__(self, message: str, modes: CloseModes) -> None:
        super().__init__(message)
        self.modes = modes


@dataclass(frozen=True, eq=False)
class DecayLaw:
    """The restoring force of a mode from its free decays, without any measured force.

    The joint loses energy as `JointTerms` says. Where several decays were pooled, k0 and c0 belong to their mean, and
    `frequency_scatter_hz` and `damping_scatter` tell how far one repeat lies from it.

    Args:
        stiffness: k_n by its power n, where 1 is k0: force per unit mass (or modal force) over displacement^n.
        damping: c_n by its power n, where 1 is c0: force per unit mass (or modal force) over velocity^n.
        friction: dry friction F, force per unit mass (or modal force); empty where there is none.
        slip: R of an Iwan joint, force per unit mass (or modal force) over displacement^(2 + chi); empty without one.
        slip_exponent: chi of that joint; empty without one.
        frequency_low_hz: natural frequency at zero amplitude, Hz; empty where the decays do not reach so far.
        damping_low: damping ratio at zero amplitude; empty likewise, with dry friction, where it grows without end,
            and where the law is of another kind than the true one.
        frequency_scatter_hz: standard deviation of that frequency between repeats, Hz; 0 for one decay.
        damping_scatter: standard deviation of the damping ratio between repeats; 0 for one decay.
        amplitude: (n,) displacement amplitudes within those of the decays.
        frequency_hz: (n,) natural frequency at these amplitudes, Hz.
        damping_ratio: (n,) damping ratio at these amplitudes.
        frequency_std_hz: (n,) standard deviation of that frequency, Hz; nan where the law has no interval.
        damping_std: (n,) standard deviation of that damping ratio, likewise.
        covariance: covariance of k0, k_2 ..., c0, c_2 ..., F, R, chi in this order.
        misfit: rms error of amplitude and phase over its standard deviation; noise alone gives 1.
        phase_error: rms error of phase, rad, and of relative amplitude.
        warnings: one sentence for each warning about the law.
        close_modes: two close linear modes that explain the decays as well, so that the law has no interval; None where
            it explains them better.
    """

    stiffness: dict[int, Estimate]
    damping: dict[int, Estimate]
    friction: Estimate
    slip: Estimate
    slip_exponent: Estimate
    frequency_low_hz: Estimate
    damping_low: Estimate
    frequency_scatter_hz: float
    damping_scatter: float
    amplitude: FloatArray
    frequency_hz: FloatArray
    damping_ratio: FloatArray
    frequency_std_hz: FloatArray
    damping_std: FloatArray
    covariance: FloatArray
    misfit: float
    phase_error: float
    warnings: tuple[str, ...]
    close_modes: CloseModes | None = None

    @property
    def law(self) -> Law:
        """The nonlinear restoring force of the powers 2 and up, per unit mass, without friction and slip."""
        return make_fitted_law(self.stiffness, self.damping)

    @property
    def joint(self) -> ModalJoint:
        """Friction and slip, ready to be simulated."""
        return make_joint(self.friction, self.slip, self.slip_exponent, float(self.amplitude.max()))

    def joint_rows(self, name: str = "") -> Iterator[SummaryRow]:
        """Yield friction and slip as rows of a summary, where there are any."""
        return joint_rows(self.friction, self.slip, self.slip_exponent, name)

    def curves_at(self, amplitude: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return natural frequency, Hz, and damping ratio at displacement amplitudes, (n,) each.

        Beyond the amplitudes of the decays, where powers become unstable, the values at the nearest end are held.
        """
        at = np.asarray(amplitude, dtype=np.float64)
        return np.interp(at, self.amplitude, self.frequency_hz), np.interp(at, self.amplitude, self.damping_ratio)

    def joint_json(self) -> dict[str, Any]:
        """Return friction, slip and scatter as result.json holds them."""
        estimates = {name: asdict(getattr(self, name)) for name in ("friction", "slip", "slip_exponent")}
        return {
            **estimates,
            "frequency_scatter_hz": self.frequency_scatter_hz,
            "damping_scatter": self.damping_scatter,
        }

    def as_json(self) -> dict[str, Any]:
        """Return the law as result.json holds it."""
        return {
            **coefficients_json(self.stiffness, self.damping),
            "joint": self.joint_json(),
            "frequency_low_hz": asdict(self.frequency_low_hz),
            "damping_low": asdict(self.damping_low),
            **{name: getattr(self, name) for name in ("amplitude", "frequency_hz", "damping_ratio")},
            **{name: getattr(self, name) for name in ("frequency_std_hz", "damping_std", "misfit")},
            "warnings": self.warnings,
        }


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
    memory: bool | None = None,
    gain_std: float = 0.0,
) -> DecayLaw:
    """Fit one law to one or several free decays of a mode.

    The tracks are of accelerations, or of velocities (`derivative` 1) or displacements (0). An order of 1 is linear;
    where an order is None, the one with the lowest Bayesian criterion is taken. So are dry friction and an Iwan joint,
    if the order of the damping is found; where it is given, they are only there if asked for.

    Several decays are repeats: k0 and c0 may differ between them, the other coefficients are common. The intervals of
    k0, c0 and of the values at zero amplitude then hold the mean of such repeats. The intervals of the coefficients
    allow for a common gain of all amplitudes of the standard deviation `gain_std`, as a fraction.

    Raises:
        InputError: orders outside 1 to 5.
        NotDeterminedError: fewer windows than coefficients, a law that does not decay, or two linear modes that explain
            the decays better (`CloseModesError`).
    """
    for word, order in (("stiffness_order", stiffness_order), ("damping_order", damping_order)):
        if order is not None and not 1 <= order <= HIGHEST_ORDER:
            raise InputError(f"{word} is {order}, give 1 (linear) to {HIGHEST_ORDER}")
    amplitude, natural, natural_std, damping, damping_std = (
        np.concatenate(parts) for parts in zip(*(find_backbone(each, derivative) for each in tracks), strict=True)
    )
    # In these units the coefficients of all powers have similar sizes.
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
    problem = _Problem(
        seen,
        [_ScaledTrack.from_track(track, length, rate, derivative) for track in tracks],
        _Units(length, rate, derivative, gain_std),
        stiffness_order,
        damping_order,
    )
    free = None if damping_order is None else False
    close = _find_close_modes(problem.decays)
    try:
        fitted = _fit_what_is_asked(problem, free if friction is None else friction, free if memory is None else memory)
    except NotDeterminedError:
        _refuse_close_modes(problem, close, None)
        raise
    is_rival = _refuse_close_modes(problem, close, fitted.best)
    fitted = _doubt_without_friction(problem, fitted) if friction is None else fitted
    if is_rival:
        return _withhold_for_rival(_describe_law(problem, fitted), close[0].scaled(rate))
    return _describe_law(problem, _add_model_error(problem, fitted))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Decays in the units of a fit, their harmonic linearisation, and the orders that are asked for."""

    seen: Linearisation
    decays: Sequence[_ScaledTrack]
    units: _Units
    stiffness_order: int | None
    damping_order: int | None

    @property
    def n_data(self) -> int:
        """The number of amplitudes and phases."""
        return 2 * sum(each.time.size for each in self.decays)

    def find_unexplained(self, fit: _Fit) -> float:
        """Return the fraction of the squared misfit of a form that noise does not explain, 0 where it may."""
        freedom = max(self.n_data - (fit.form.size + 2) * fit.repeats, 1)
        explained = float(stats.chi2.ppf(1.0 - MODAL.chance_misfit, freedom)) / freedom
        return max(0.0, 1.0 - explained / max(fit.misfit**2, explained))

    def search_forms(self, friction: bool | None, memory: bool | None) -> list[tuple[LawForm, FloatArray]]:
        """Return forms of the orders that are asked for, with or without a joint, as `search_forms` does."""
        return search_forms(
            self.seen,
            stiffness_order=self.stiffness_order,
            damping_order=self.damping_order,
            friction=friction,
            memory=memory,
        )

    def score(self, fits: Sequence[_Fit]) -> FloatArray:
        """Return the Bayesian criterion of forms that were fitted to the decays above that of the best, (m,)."""
        sizes = [each.form.size * each.repeats for each in fits]
        scores = score_misfit([each.squares for each in fits], self.n_data, sizes)
        scores += [each.form.prior_score for each in fits]
        return scores - scores.min()

    def weigh(self, fits: Sequence[_Fit]) -> FloatArray:
        """Return the probabilities of forms by that criterion, (m,); those of unlikely ones are zero."""
        weights = np.exp(-0.5 * self.score(fits))
        weights = np.where(weights < MODAL.least_weight, 0.0, weights)
        return weights / weights.sum()


def _fit_what_is_asked(problem: _Problem, friction: bool | None, memory: bool | None) -> _Fitted:
    """Return the forms that describe the decays; where a joint is not determined, the best ones without it."""
    tried = _try_forms(problem, problem.search_forms(friction, memory))
    if tried.fits:
        return _Fitted(_weigh_fits(problem, tried.fits), False, ())
    if friction is not None and memory is not None:
        raise tried.failed or NotDeterminedError("no law describes the decay: lower the orders")
    simpler = _try_forms(problem, problem.search_forms(friction or False, memory or False))
    if not simpler.fits:
        raise tried.failed or NotDeterminedError("no law describes the decay: lower the orders")
    fits = _weigh_fits(problem, simpler.fits)
    is_doubted = bool(problem.score([fits[0][0], *tried.undetermined])[0] > MODAL.decisive)
    return _Fitted(
        fits,
        is_doubted,
        (
            "the curves suggest dry friction or a joint that slips, which this decay does not determine: the law is "
            "the best one without, for these amplitudes only"
            + (", and the damping at zero amplitude is not told" if is_doubted else "")
            + "; record with less noise or a stronger impact",
        ),
    )


def _doubt_without_friction(problem: _Problem, fitted: _Fitted) -> _Fitted:
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
    fits = [best, *(each for each in _try_forms(problem, likely).fits if not each.is_at_edge)]
    gain = float(problem.score(fits)[0])
    if gain <= MODAL.decisive:
        return replace(fitted, fits=list(zip(fits, problem.weigh(fits).tolist(), strict=True)))
    return _Fitted(
        fitted.fits,
        True,
        (
            *fitted.warnings,
            f"dry friction explains the decay better than powers of the damping_order {order} (by {gain:.3g} in the "
            f"Bayesian criterion, {MODAL.decisive:g} is decisive): neither damping at zero amplitude nor intervals of "
            "the damping are told; leave damping_order out, so that the law may have friction",
        ),
    )


def _add_model_error(problem: _Problem, fitted: _Fitted) -> _Fitted:
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


def _fit_without_stretches(problem: _Problem, fit: _Fit) -> _Fit:
    """Return a form with its fits to the decays without one of some stretches, and their scatter in its covariance."""
    part = problem.find_unexplained(fit)
    if not part:
        return fit
    without = []
    for number in range(MODAL.n_blocks):
        decays = [each.leave_out(number) for each in problem.decays]
        logs = np.concatenate([each.log_amplitude for each in decays])
        try:
            vector = _fit_form(replace(problem, decays=decays), fit.form, fit.vector).vector
        except (NotDeterminedError, np.linalg.LinAlgError):
            return replace(fit, is_untold=True)
        without.append(_Without(vector, float(logs.min()), float(logs.max())))
    steps = np.array([each.vector for each in without]) - fit.vector
    return replace(fit, model_error=part * find_jackknife(steps), part=part, without=tuple(without))


def _find_close_modes(decays: Sequence[_ScaledTrack]) -> list[CloseModes]:
    """Return the two linear modes that explain each decay; none where they do not."""
    found = [
        fit_close_modes(each.time, each.log_amplitude, each.phase, each.root)
        for each in decays
        if 2 * each.time.size > CloseModes.SIZE + 2
    ]
    return found if len(found) == len(decays) and all(each.is_plausible for each in found) else []


def _refuse_close_modes(problem: _Problem, close: Sequence[CloseModes], best: _Fit | None) -> bool:
    """Refuse decays that two linear modes explain better than the best law, None without one.

    Returns:
        Whether they explain the decays as well as the law, so that nothing tells which is right.
    """
    if not close:
        return False
    # A law of other terms than those that are asked for speaks against two modes, too.
    free = replace(problem, stiffness_order=None, damping_order=None)
    try:
        others = _try_forms(free, free.search_forms(None, None))
    except NotDeterminedError:
        others = _Tried([], [], None)
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
    return replace(_withhold_intervals(law), warnings=(*law.warnings, told), close_modes=close)


def _withhold_intervals(law: DecayLaw) -> DecayLaw:
    """Return a law without intervals."""
    names = ("friction", "slip", "slip_exponent", "frequency_low_hz", "damping_low")
    bare = {name: getattr(law, name).without_interval() for name in names}
    unknown = np.full(law.amplitude.size, np.nan)
    return replace(
        law,
        stiffness={power: each.without_interval() for power, each in law.stiffness.items()},
        damping={power: each.without_interval() for power, each in law.damping.items()},
        frequency_std_hz=unknown,
        damping_std=unknown,
        **bare,
    )


@dataclass(frozen=True, eq=False)
class _ScaledTrack:
    """A track in units of length and rate, with times and phases from the first window on and the root of its noise."""

    time: FloatArray
    log_amplitude: FloatArray
    phase: FloatArray
    root: FloatArray

    @classmethod
    def from_track(cls, track: Track, length: float, rate: float, derivative: int) -> _ScaledTrack:
        # A small addition to the diagonal limits the weight of every window.
        noise = track.covariance + np.diag(1e-6 * np.diag(track.covariance) + 1e-14)
        logs = np.log(track.amplitude / (length * rate**derivative))
        time, root = (track.time_s - track.time_s[0]) * rate, np.asarray(np.linalg.cholesky(noise), dtype=np.float64)
        return cls(time, logs, track.phase - track.phase[0], root)

    def leave_out(self, number: int) -> _ScaledTrack:
        """Return the track without the windows of one of `n_blocks` stretches, by its number from 0."""
        n = self.time.size
        kept = np.arange(n) * MODAL.n_blocks // n != number
        both = np.concatenate([kept, kept])
        covariance = (self.root @ self.root.T)[np.ix_(both, both)]
        time, phase = self.time[kept], self.phase[kept]
        root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        return _ScaledTrack(time - time[0], self.log_amplitude[kept], phase - phase[0], root)

    def errors(self, flow: Flow, start: float, shift: float, derivative: int) -> FloatArray | None:
        """Return the (2n,) errors of log-amplitude and phase of a law over their standard deviation."""
        from scipy.linalg import solve_triangular

        predicted = predict_decay(flow, self.time, start, derivative)
        if predicted is None:
            return None
        misfit = np.concatenate([self.log_amplitude - predicted[0], self.phase - predicted[1] - shift])
        return solve_triangular(self.root, misfit, lower=True)


@dataclass(frozen=True)
class _Units:
    """Length and rate by which a fit is scaled, the derivative that was measured, and how well its gain is known."""

    length: float
    rate: float
    derivative: int
    gain_std: float

    def find_factors(self, form: LawForm, vector: FloatArray) -> FloatArray:
        """Return (p,) factors from the coefficients of a form to SI units."""
        of_k = [self.rate**2 * self.length**-n for n in range(form.stiffness_order)]
        of_c = [self.rate * (self.length * self.rate) ** -n for n in range(form.damping_order)]
        of_friction = [self.rate**2 * self.length] * form.has_friction
        exponent = form.split(vector)[2].exponent
        return np.array(
            [*of_k, *of_c, *of_friction, *([self.rate**2 * self.length ** -(1 + exponent), 1.0] * form.has_memory)]
        )

    def find_gain_error(self, form: LawForm, vector: FloatArray) -> FloatArray:
        """Return (p,) by how much the coefficients of a form change by one standard deviation of the gain.

        A law of the power n of g q has a coefficient g^(1 - n) times that of q; friction is of the power 0.
        """
        above_one = [*range(form.stiffness_order), *range(form.damping_order), *[-1.0] * form.has_friction]
        above_one += [1.0 + form.split(vector)[2].exponent, 0.0] * form.has_memory
        return -self.gain_std * np.array(above_one) * vector


@dataclass(frozen=True, eq=False)
class _Without:
    """Coefficients that were fitted without a stretch of the decays, and the range of logarithms that was left."""

    vector: FloatArray
    log_low: float
    log_high: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """A form that was fitted: its coefficients, their covariance and scatter, and how well the decays follow it.

    Where noise does not explain the `part` of its squared misfit, the `model_error` is what `without` stretches of the
    decays adds to the covariance; `is_untold` where one of these fits failed.
    """

    form: LawForm
    vector: FloatArray
    covariance: FloatArray
    scatter: FloatArray
    misfit: float
    phase_error: float
    squares: float
    repeats: int
    repeat_misfit: float
    model_error: FloatArray
    part: float = 0.0
    without: tuple[_Without, ...] = ()
    is_untold: bool = False

    @property
    def whole_covariance(self) -> FloatArray:
        """The covariance with the model error."""
        return self.covariance + self.model_error

    @property
    def places(self) -> tuple[int, int]:
        """The indices of k0 and c0."""
        return 0, self.form.stiffness_order

    def find_low(self) -> tuple[FloatArray, FloatArray]:
        """Return k0, c0, root of k0 and damping ratio at zero amplitude, and their covariance, (4,) and (4, 4)."""
        k0, c0 = self.vector[list(self.places)]
        root = np.sqrt(k0)
        slopes = np.zeros((4, self.vector.size))
        slopes[:, self.places[0]] = 1.0, 0.0, 0.5 / root, -0.25 * c0 / k0**1.5
        slopes[:, self.places[1]] = 0.0, 1.0, 0.0, 0.5 / root
        return np.array([k0, c0, root, 0.5 * c0 / root]), slopes @ self.whole_covariance @ slopes.T

    @property
    def is_at_edge(self) -> bool:
        """Whether there is an impossible law beside this one, so that nothing tells how well it is known."""
        return bool(np.isnan(self.covariance).any())

    @property
    def is_active(self) -> bool:
        """Whether the mode gains energy at small amplitude, which no structure at rest does, beyond chance."""
        place = self.places[1]
        spread = 0.0 if self.is_at_edge else 2.0 * np.sqrt(self.covariance[place, place])
        return bool(self.vector[place] + spread < 0.0)


@dataclass(frozen=True, eq=False)
class _Tried:
    """Forms that were fitted, those whose joint is not determined, and why the first one failed."""

    fits: list[_Fit]
    undetermined: list[_Fit]
    failed: NotDeterminedError | None


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Forms with their weights, the chosen one first, and what is to be doubted.

    Args:
        fits: the forms and their weights.
        is_doubted: whether the damping at zero amplitude of the chosen form is to be doubted.
        warnings: one sentence for each warning.
        part: fraction of the squared misfit that noise does not explain.
        is_untold: whether nothing tells how far the law is from the true one.
    """

    fits: Sequence[tuple[_Fit, float]]
    is_doubted: bool
    warnings: tuple[str, ...]
    part: float = 0.0
    is_untold: bool = False

    @property
    def is_another_kind(self) -> bool:
        """Whether the law misses the decays by so much that it is of another kind than the true one."""
        return bool(self.part) and self.best.misfit > MODAL.most_misfit

    @property
    def best(self) -> _Fit:
        """The fit of the form that was chosen."""
        return self.fits[0][0]


def _try_forms(problem: _Problem, forms: Sequence[tuple[LawForm, FloatArray]]) -> _Tried:
    """Fit forms to all decays."""
    fits: list[_Fit] = []
    undetermined: list[_Fit] = []
    failed: NotDeterminedError | None = None
    for form, guess in forms:
        try:
            if problem.n_data <= (form.size + 2) * len(problem.decays) + 2:
                raise NotDeterminedError(
                    f"{problem.n_data} amplitudes and phases cannot determine {form.size} coefficients: lower the "
                    "orders"
                )
            fit = _fit_form(problem, form, guess)
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
    return _Tried(fits, undetermined, failed)


def _weigh_fits(problem: _Problem, fits: list[_Fit]) -> list[tuple[_Fit, float]]:
    """Return fits with their weights, first the simplest of the best criterion."""
    fits = [each for each in fits if not each.is_at_edge] or fits
    fits = [each for each in fits if not each.is_active] or fits
    chosen = min(np.flatnonzero(problem.score(fits) < MODAL.bare_mention), key=lambda j: fits[j].form.size)
    weighed = list(zip(fits, problem.weigh(fits).tolist(), strict=True))
    return [weighed[chosen], *weighed[:chosen], *weighed[chosen + 1 :]]


def _fit_form(problem: _Problem, form: LawForm, guess: FloatArray) -> _Fit:
    decays, derivative, damping = problem.decays, problem.units.derivative, float(np.median(problem.seen.damping))
    each_fit = [_refine(decay, form, guess, derivative, damping) for decay in decays]
    p, vector = form.size, each_fit[0][0]
    covariance, scatter, repeat_misfit = each_fit[0][1], np.zeros(p), 1.0
    if len(decays) > 1:
        if any(np.isnan(fit[1]).any() for fit in each_fit):
            raise NotDeterminedError(f"for one of the decays {AT_EDGE}")
        vectors, covariances = ([fit[j] for fit in each_fit] for j in (0, 1))
        pooled = pool_repeats(vectors, covariances, [0, form.stiffness_order])
        vector, covariance, scatter = pooled.vector, pooled.covariance, pooled.scatter
        repeat_misfit = pooled.misfit
    errors = np.concatenate([fit[2] for fit in each_fit])
    plain = np.concatenate([decay.root @ fit[2] for decay, fit in zip(decays, each_fit, strict=True)])
    squares, own = float(errors @ errors), (p + 2) * len(decays)
    return _Fit(
        form=form,
        vector=vector,
        covariance=covariance,
        scatter=scatter,
        misfit=float(np.sqrt(squares / max(errors.size - own, 1))),
        phase_error=float(np.sqrt(np.mean(plain**2))),
        squares=squares,
        repeats=len(decays),
        repeat_misfit=repeat_misfit,
        model_error=np.zeros((p, p)),
    )


def _refine(
    decay: _ScaledTrack, form: LawForm, guess: FloatArray, derivative: int, damping: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficients by amplitude and phase of one decay, (p,), their covariance and the errors, (2n,).

    The covariance is nan where the search ends at the edge of the laws that decay over all amplitudes of the record.
    """
    from scipy.optimize import least_squares

    low, high = _span([decay])

    def errors(vector: FloatArray) -> FloatArray:
        k, c, joint = form.split(vector)
        flow = solve_slow_flow(k, c, low, high, joint) if joint.exponent > -1.0 else None
        start, shift = vector[form.size :]
        found = None if flow is None else decay.errors(flow, start, shift, derivative)
        return np.full(2 * decay.time.size, IMPOSSIBLE) if found is None else found

    own = np.array([decay.log_amplitude[0], 0.0])
    start = np.concatenate([guess, own])
    if np.abs(errors(start)).max() >= IMPOSSIBLE:
        # The law of the start values does not vibrate or decay, but its linear part alone does.
        start[: form.size] = 0.0
        start[0], start[form.stiffness_order] = 1.0, max(damping, 1e-5)
    scale = np.full(start.size, 0.1)
    scale[: form.stiffness_order] = 1.0
    scale[form.stiffness_order : form.size] = max(abs(damping), 1e-4)
    if form.has_memory:
        scale[form.size - 1] = 0.3
    found = least_squares(errors, start, x_scale=scale, method="trf", xtol=1e-11, ftol=1e-11, gtol=1e-11, max_nfev=60)
    if not np.abs(found.fun).max() < IMPOSSIBLE:
        raise NotDeterminedError("no law of these orders decays over all amplitudes of the record: lower the orders")
    if _is_at_edge(found.jac, found.fun):
        return found.x[: form.size], np.full((form.size, form.size), np.nan), found.fun
    covariance = _find_covariance(found.jac, found.fun)
    return found.x[: form.size], covariance[: form.size, : form.size], found.fun


def _is_at_edge(jacobian: FloatArray, errors: FloatArray) -> bool:
    """Return whether a search ended at a law beside which there is an impossible one, or far from the least errors."""
    beyond = 1e-3 * IMPOSSIBLE / np.sqrt(np.finfo(float).eps)
    if np.abs(jacobian).max() > beyond:
        return True
    # At a minimum no step changes the squared errors to first order.
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    saved = float(np.sum((basis.T @ errors) ** 2))
    return saved > MODAL.least_saved + MODAL.fraction_saved * float(errors @ errors)


def _span(decays: Sequence[_ScaledTrack]) -> tuple[float, float]:
    """Return the logarithms of amplitude between which the law of some decays is solved."""
    low = min(float(each.log_amplitude.min()) for each in decays) - 0.7
    return low, max(float(each.log_amplitude.max()) for each in decays) + 0.4


def _describe_law(problem: _Problem, fitted: _Fitted) -> DecayLaw:
    """Return the best fit in SI units; what its rivals say otherwise widens the intervals."""
    best, units, lowest = fitted.best, problem.units, float(problem.seen.level.min())
    curves = _find_law_curves(problem, fitted)
    low, spread = best.find_low()
    few = _widen_few_windows(sum(each.log_amplitude.size for each in problem.decays), best.form.size)
    low_std = np.hypot(few * _widen(fitted.fits, low), curves.find_missed_low(low[2]))
    wider = np.full(best.vector.size, few)
    wider[list(best.places)] = low_std[:2] / np.sqrt(np.maximum(np.diag(spread)[:2], 1e-300))
    factors = units.find_factors(best.form, best.vector)
    by_gain = units.find_gain_error(best.form, best.vector)
    covariance = best.whole_covariance * np.outer(wider, wider) + np.outer(by_gain, by_gain)
    covariance = covariance * np.outer(factors, factors)
    n_k = best.form.stiffness_order
    stiffness, damping, (friction, slip, exponent) = _estimate_coefficients(
        fitted, factors, covariance, few, units.gain_std
    )
    # Slip falls as a power of the amplitude below 1, and is far from gone at the smallest one that was seen.
    reaches = lowest <= MODAL.reaches_zero and not best.form.has_memory
    has_no_ratio = best.form.has_friction or best.is_active or fitted.is_doubted or fitted.is_another_kind
    scale_hz = units.rate / (2.0 * np.pi)
    law = DecayLaw(
        stiffness=dict(enumerate(stiffness, start=1)),
        damping=dict(enumerate(damping, start=1)),
        friction=friction,
        slip=slip,
        slip_exponent=exponent,
        frequency_low_hz=_estimate(low[2] * scale_hz, low_std[2] * scale_hz, best.repeats) if reaches else Estimate(),
        damping_low=_estimate(low[3], low_std[3], best.repeats) if reaches and not has_no_ratio else Estimate(),
        frequency_scatter_hz=float(0.5 * best.scatter[0] / low[2] * scale_hz),
        damping_scatter=float(0.5 * best.scatter[n_k] / low[2]),
        amplitude=curves.level * units.length,
        frequency_hz=curves.natural * scale_hz,
        damping_ratio=curves.damping / (2.0 * curves.natural),
        frequency_std_hz=curves.natural_std * scale_hz,
        damping_std=curves.damping_std / (2.0 * curves.natural),
        covariance=covariance,
        misfit=best.misfit,
        phase_error=best.phase_error,
        warnings=(*_warn_of_law(best, lowest), *fitted.warnings),
    )
    return _withhold_intervals(law) if fitted.is_untold else law


@dataclass(frozen=True, eq=False)
class _LawCurves:
    """Natural frequency and damping of a law over the amplitude, in the units of the fit, (n,) each.

    `missed` holds what the law misses of frequency and of damping at the smallest amplitudes that were measured.
    """

    level: FloatArray
    natural: FloatArray
    natural_std: FloatArray
    damping: FloatArray
    damping_std: FloatArray
    missed: tuple[float, float]

    def find_missed_low(self, root: float) -> FloatArray:
        """Return what is missed of k0, c0, root of k0 and damping ratio, (4,), as in `_Fit.find_low`."""
        natural, damping = self.missed
        return np.array([2.0 * root * natural, damping, natural, 0.5 * damping / root])


def _find_law_curves(problem: _Problem, fitted: _Fitted) -> _LawCurves:
    """Return the curves of the best fit over the amplitudes of the decays, with their standard deviations."""
    best, units, seen = fitted.best, problem.units, problem.seen
    flow = _solve_flow(problem, best.form, best.vector)
    if flow is None:
        raise NotDeterminedError("no law of these orders decays over all amplitudes of the decays: lower the orders")
    shown = flow.log_amplitude + units.derivative * np.log(flow.natural)
    logs = np.concatenate([each.log_amplitude for each in problem.decays])
    inside = (shown >= logs.min()) & (shown <= logs.max())
    few = _widen_few_windows(logs.size, best.form.size)
    variance = np.zeros((2, flow.natural.size))
    for fit, weight in fitted.fits:
        variance += few**2 * weight * _find_curve_variance(problem, fit, flow)
    at, order = flow.log_amplitude[inside], np.argsort(seen.level)
    logs_seen, missed = np.log(seen.level[order]), []
    for values, measured, std in (
        (flow.natural, np.sqrt(seen.square), 0.5 * seen.square_std / np.sqrt(seen.square)),
        (flow.damping, seen.damping, seen.damping_std),
    ):
        off = measured[order] - np.interp(logs_seen, flow.log_amplitude, values)
        squares = np.maximum(off**2 - std[order] ** 2, 0.0)
        # The mean of three windows is taken, for a curve that crosses the true one misses nothing there.
        near = np.array([np.mean(squares[max(0, k - 1) : k + 2]) for k in range(squares.size)])
        missed.append(np.sqrt(fitted.part * near))
    stds = [
        np.sqrt(own[inside] + np.interp(at, logs_seen, each) ** 2) for own, each in zip(variance, missed, strict=True)
    ]
    return _LawCurves(
        level=np.exp(at),
        natural=flow.natural[inside],
        natural_std=stds[0],
        damping=flow.damping[inside],
        damping_std=stds[1],
        missed=(float(missed[0][0]), float(missed[1][0])),
    )


def _solve_flow(problem: _Problem, form: LawForm, vector: FloatArray) -> Flow | None:
    """Return the slow flow of a form over the amplitudes of all decays; None if it does not vibrate or decay."""
    k, c, joint = form.split(vector)
    return solve_slow_flow(k, c, *_span(problem.decays), joint)


def _find_curve_variance(problem: _Problem, fit: _Fit, about: Flow) -> FloatArray:
    """Return the variances of natural frequency and damping of a form about the curves of the best one, (2, n)."""
    own = _solve_flow(problem, fit.form, fit.vector)
    if own is None:
        return np.full((2, about.natural.size), np.nan)
    slopes = []
    for step in CURVE_STEP * np.eye(fit.vector.size):
        other = _solve_flow(problem, fit.form, fit.vector + step) or own
        slopes.append(np.stack([other.natural - own.natural, other.damping - own.damping]) / CURVE_STEP)
    by_gain = problem.units.find_gain_error(fit.form, fit.vector)
    covariance = fit.covariance + np.outer(by_gain, by_gain)
    off = np.stack([own.natural - about.natural, own.damping - about.damping])
    variance = np.einsum("jcn,jk,kcn->cn", slopes, covariance, slopes) + off**2
    if not fit.without:
        return np.asarray(variance, dtype=np.float64)
    shown = own.log_amplitude + problem.units.derivative * np.log(own.natural)
    steps = []
    for each in fit.without:
        other = _solve_flow(problem, fit.form, each.vector) or own
        # Beyond the amplitudes that are left the curve is an extrapolation, which tells nothing of the whole decay.
        is_left = (shown >= each.log_low) & (shown <= each.log_high)
        steps.append(is_left * np.stack([other.natural - own.natural, other.damping - own.damping]))
    of_model = [np.diag(find_jackknife(each)) for each in np.moveaxis(np.array(steps), 1, 0)]
    return np.asarray(variance + fit.part * np.array(of_model), dtype=np.float64)


def _estimate_coefficients(
    fitted: _Fitted, factors: FloatArray, covariance: FloatArray, few: float, gain_std: float
) -> tuple[list[Estimate], list[Estimate], tuple[Estimate, Estimate, Estimate]]:
    """Return k_n, c_n, and friction, slip and exponent of the best fit in SI units, empty where it has none.

    `factors` lead to SI units, in which the covariance is; `few` widens for few windows, and `gain_std` for the gain of
    the amplitudes.
    """
    best = fitted.best
    values, std = best.vector * factors, np.sqrt(np.diag(covariance))
    n_k, n_c = best.form.stiffness_order, best.form.damping_order
    estimates = [
        _estimate(value, each, best.repeats if j in best.places else 1)
        for j, (value, each) in enumerate(zip(values, std, strict=True))
    ]
    damping = estimates[n_k : n_k + n_c]
    if best.is_active:
        # No structure at rest has negative damping: what the record holds beside the decay is not known.
        damping[0] = damping[0].without_interval()
    if fitted.is_doubted:
        damping = [each.without_interval() for each in damping]
    rest = estimates[n_k + n_c :]
    friction = Estimate()
    if best.form.has_friction:
        rest.pop(0)
        # The gain of the amplitude changes friction by as much.
        spread = np.hypot(few * _widen_friction(fitted.fits), gain_std * best.vector[n_k + n_c])
        friction = Estimate.normal(values[n_k + n_c], spread * factors[n_k + n_c])
    slip, exponent = rest if rest else (Estimate(), Estimate())
    return estimates[:n_k], damping, (friction, slip, exponent)


def _widen(fits: Sequence[tuple[_Fit, float]], low: FloatArray) -> FloatArray:
    """Return (4,) standard deviations of the values at zero amplitude about those of the best fit, over all forms."""
    squares = np.zeros(low.size)
    for fit, weight in fits:
        values, spread = fit.find_low()
        squares += weight * (np.diag(spread) + (values - low) ** 2)
    return np.asarray(np.sqrt(squares), dtype=np.float64)


def _widen_few_windows(n_windows: int, n_coefficients: int) -> float:
    """Return the half width of an interval of Student's t over that of a normal one: few windows tell the noise badly.

    A window gives an amplitude and a phase, and each decay has a start value of both.
    """
    from scipy import special

    return float(special.stdtrit(max(2 * n_windows - n_coefficients - 2, 1), 0.975)) / 1.96


def _widen_friction(fits: Sequence[tuple[_Fit, float]]) -> float:
    """Return the standard deviation of friction about that of the best fit, over all forms that have friction."""
    best = fits[0][0].form.split(fits[0][0].vector)[2].friction
    total = weights = 0.0
    for fit, weight in fits:
        if fit.form.has_friction:
            place = fit.form.stiffness_order + fit.form.damping_order
            total += weight * (fit.whole_covariance[place, place] + (fit.vector[place] - best) ** 2)
            weights += weight
    return float(np.sqrt(total / weights))


def _estimate(value: float, std: float, repeats: int) -> Estimate:
    """Return a normal estimate, or one of Student's t where the scatter of a few repeats is in it."""
    if repeats == 1:
        return Estimate.normal(value, std)
    from scipy.stats import t

    half = float(t.ppf(0.975, repeats - 1)) * float(std)
    return Estimate(float(value), float(std), (float(value) - half, float(value) + half))


def _warn_of_law(best: _Fit, lowest: float) -> list[str]:
    warnings = []
    falls = f"the amplitude falls only by a factor of {1.0 / lowest:.2g}"
    if lowest > 1.0 / MODAL.least_range:
        warnings.append(
            f"{falls}: the powers above 1 are poorly determined, record a longer decay or a stronger impact"
        )
    if lowest > MODAL.reaches_zero:
        warnings.append(f"{falls}: frequency and damping at zero amplitude are not told, record a longer decay")
    if best.form.has_memory:
        warnings.append(
            "the joint still slips at the smallest amplitude: frequency and damping at zero amplitude are not told"
        )
    if best.repeat_misfit > MODAL.most_misfit:
        warnings.append(
            f"the laws of the single decays differ by {best.repeat_misfit:.2g} times what noise and the scatter of k0 "
            "and c0 leave: frequency and damping are no functions of the amplitude alone, as with two close modes or a "
            "structure that moved; the intervals are wider by as much"
        )
    if best.is_at_edge:
        warnings.append(f"no interval is given: {AT_EDGE}")
    if best.is_active:
        warnings.append(
            "the damping at small amplitude is negative, which no structure at rest has: the law only describes the "
            "amplitudes of the record, and its c1 is no damping; give a stretch that nothing drives"
        )
    return warnings


def _find_covariance(jacobian: FloatArray, errors: FloatArray) -> FloatArray:
    """Return the covariance of the parameters for white errors or, where that is larger, for correlated ones.

    The scores of windows up to the lag 2 n^(1/3) apart, amplitude and phase together, may be correlated.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    if not scale.min() > 0.0:
        raise NotDeterminedError("the decay does not show one of the coefficients: lower the orders")
    scaled = jacobian / scale
    sizes = np.linalg.svd(scaled, compute_uv=False)
    if sizes[-1] < MODAL.least_shown * sizes[0]:
        raise NotDeterminedError(
            "the decay cannot tell two of the coefficients apart: lower the orders, or record a larger range of "
            "amplitudes"
        )
    inverse = np.linalg.inv(scaled.T @ scaled)
    n, p = jacobian.shape
    white = inverse * max(float(errors @ errors) / max(n - p, 1), 1.0)
    both = (scaled * errors[:, None]).reshape(2, -1, p).sum(axis=0)
    meat = sum_lagged_products(both, int(2.0 * len(both) ** (1.0 / 3.0)))
    coloured = n / max(n - p, 1) * inverse @ meat @ inverse
    wider = np.sqrt(np.maximum(np.diag(coloured) / np.maximum(np.diag(white), 1e-300), 1.0))
    return white * np.outer(wider, wider) / np.outer(scale, scale)
