"""The law of a mode from motions at one frequency: levels at phase resonance, and points of response curves, alike.

Each motion q of the mode balances its fundamental, with F the modal force and p the pole of the motion,

    F / q_1 - p^2 = k0 + c0 p + sum_n k_n <q|q|^(n-1)>_1 / q_1 + sum_n c_n <q'|q'|^(n-1)>_1 / q_1

(Pacini eq. 11 in one line of the spectrum), where <>_1 is the fundamental of a power over a period. It is linear in the
coefficients. A measured force is 1 + g + j theta times what moves the mode. Its gain g is known by its standard
deviation only, which widens the intervals; the phase theta is one more unknown. Levels held at quadrature alone cannot
show it, and it widens the interval of the stiffness; transients do show it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from opid.errors import NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.mechanics.laws.law import Law
from opid.mechanics.structure import ComplexArray
from opid.modal.forced.equation import Powers
from opid.modal.power_laws import HIGHEST_ORDER, coefficients_json, make_fitted_law, withhold_negative
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import SteadyState
from opid.modal.settings import MODAL
from opid.signals.recording import LEAST_SIZE, FloatArray

FEWEST_GROUPS = 3  # curves of which one can be left out and the others still show how frequency and damping move
N_TIMES = 64  # times of a period at which powers are sampled; enough for the fifth power of five harmonics


@dataclass(frozen=True, eq=False)
class LawCandidate:
    """One choice of powers that explains the motions, with how well it does.

    Args:
        stiffness: k_n by its power n, as in `ResonanceLaw`.
        damping: c_n by its power n.
        phase_rad: phase of the force against the accelerations, rad.
        covariance: of k_n, c_n and the phase, in this order.
        weight: its weight among the choices, by the Bayesian criterion; all weights together are 1.
    """

    stiffness: dict[int, float]
    damping: dict[int, float]
    phase_rad: float
    covariance: FloatArray
    weight: float

    def find_dynamic_stiffness(self, amplitude: FloatArray, omega: float) -> ComplexArray:
        """Return modal force over modal displacement at some amplitudes, 1/s^2, by harmonic linearisation."""
        k = sum(value * first_harmonic_factor(n) * amplitude ** (n - 1) for n, value in self.stiffness.items())
        c = sum(value * first_harmonic_factor(n) * (omega * amplitude) ** (n - 1) for n, value in self.damping.items())
        return np.asarray(k - omega**2 + 1j * omega * c, dtype=np.complex128)

    def with_state(self, ratio: float) -> LawCandidate:
        """Return the law of a structure whose frequencies are those of this one times a ratio."""
        return replace(self, stiffness={n: ratio**2 * value for n, value in self.stiffness.items()})

    def draw(self, rng: np.random.Generator) -> LawCandidate:
        """Return the same choice of powers with coefficients drawn from their distribution."""
        centre = np.array([*self.stiffness.values(), *self.damping.values(), self.phase_rad])
        # The coefficients differ by many orders of magnitude.
        scale = np.sqrt(np.maximum(np.diag(self.covariance), np.finfo(float).tiny))
        correlation = self.covariance / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(correlation)
        step = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(values.size))
        drawn, n = centre + scale * step, len(self.stiffness)
        return replace(
            self,
            stiffness=dict(zip(self.stiffness, drawn[:n].tolist(), strict=True)),
            damping=dict(zip(self.damping, drawn[n:-1].tolist(), strict=True)),
            phase_rad=float(drawn[-1]),
        )


@dataclass(frozen=True, eq=False)
class ResonanceLaw:
    """The restoring force of a mode from motions at one frequency.

    Args:
        stiffness: k_n by its power n, where 1 is k0: modal force over displacement^n.
        damping: c_n by its power n, where 1 is c0: modal force over velocity^n.
        amplitude: (n,) displacement amplitudes within those of the motions, m kg^1/2.
        frequency_hz: (n,) natural frequency at these amplitudes, Hz.
        frequency_std_hz: (n,) its standard deviation, Hz.
        damping_ratio: (n,) damping ratio at these amplitudes.
        damping_std: (n,) its standard deviation.
        force_phase_deg: phase of the force against the accelerations that the motions show, degrees.
        misfit: rms error of the equation over its standard deviation; noise alone gives 1.
        n_states: number of motions that were fitted.
        candidates: the choices of powers that count, the one that was chosen first.
    """

    stiffness: dict[int, Estimate]
    damping: dict[int, Estimate]
    amplitude: FloatArray
    frequency_hz: FloatArray
    frequency_std_hz: FloatArray
    damping_ratio: FloatArray
    damping_std: FloatArray
    force_phase_deg: Estimate
    misfit: float
    n_states: int
    candidates: tuple[LawCandidate, ...] = ()

    @property
    def is_withheld(self) -> bool:
        """Whether the law extrapolates to a negative k0 or c0, for which no interval is given."""
        linear = (self.stiffness[1], self.damping[1])
        return any(each.interval95 is None and (each.value or 0.0) < 0.0 for each in linear)

    @property
    def law(self) -> Law:
        """The nonlinear restoring force, powers 2 and up."""
        return make_fitted_law(self.stiffness, self.damping)

    def as_json(self) -> dict[str, Any]:
        """Return the law as result.json holds it."""
        names = ("amplitude", "frequency_hz", "frequency_std_hz", "damping_ratio", "damping_std", "misfit", "n_states")
        return {
            **coefficients_json(self.stiffness, self.damping),
            **{name: getattr(self, name) for name in names},
            "force_phase_deg": asdict(self.force_phase_deg),
        }


def fit_states(
    states: Sequence[SteadyState],
    settings: ResonanceSettings,
    *,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    measured_waves: bool = True,
    systematic: float = 0.0,
    known_phase_deg: Estimate | None = None,
    is_grouped: bool = False,
) -> ResonanceLaw:
    """Fit one law to the motions of a mode at one frequency each.

    Where an order is given, all powers up to it are fitted; where not, those with the lowest Bayesian criterion, and
    what the others of weight make of a coefficient widens its interval.

    Args:
        states: the motions.
        settings: how far the phase of the force is trusted, and what a law needs.
        stiffness_order: N_s, 1 to 5; chosen where None.
        damping_order: N_d, 1 to 5; chosen where None.
        measured_waves: whether the powers are those of the measured harmonics; otherwise, and for motions of which the
            fundamental alone was measured, of a fundamental with the harmonics that the law itself makes.
        systematic: standard deviation of an error of gain and phase that all motions share, as a fraction: motion that
            the shapes miss.
        known_phase_deg: phase of the force against the accelerations that other motions have shown; where None, that
            of the settings, until the motions contradict it.
        is_grouped: whether motions of one source share errors, as the points of a response curve do.

    Raises:
        InputError: an order outside 1 to 5.
        NotDeterminedError: too few motions, amplitudes too close to each other, or a negative damping among them.
    """
    amplitude = np.array([each.amplitude for each in states])
    if amplitude.size < settings.fewest_levels:
        raise NotDeterminedError(
            f"{amplitude.size} motion(s) at one frequency are left where a law needs {settings.fewest_levels}: record "
            "more levels"
        )
    if amplitude.max() < settings.least_range * amplitude.min():
        raise NotDeterminedError(
            f"the amplitudes differ by a factor of {amplitude.max() / amplitude.min():.2f} only where a law needs "
            f"{settings.least_range:g}: record lower levels, or higher ones"
        )
    given = (stiffness_order, damping_order)

    def fit(prior: tuple[float, float, float]) -> ResonanceLaw:
        return _fit_with_prior(states, settings, given, measured_waves, prior, is_grouped)

    gain = float(np.hypot(settings.gain_tolerance, systematic))
    phase = float(np.hypot(np.radians(settings.phase_tolerance_deg), systematic))
    if known_phase_deg is not None:
        centre, std = np.radians([known_phase_deg.value or 0.0, known_phase_deg.std or 0.0])
        law = fit((gain, float(std), float(centre)))
        # What powers do not describe weighs less against what is known of the phase, too.
        is_poor = law.misfit > settings.warned_misfit
        return fit((gain, float(std) / law.misfit, float(centre))) if is_poor else law
    law = fit((gain, phase, 0.0))
    if abs(np.radians(law.force_phase_deg.value or 0.0)) > settings.disbelief * phase:
        # The motions contradict what was believed of the phase: they alone tell it then.
        free = max(float(np.radians(settings.doubted_phase_deg)), phase)
        law = fit((gain, free, 0.0))
    return law


def reaches_zero(amplitude: FloatArray) -> bool:
    """Return whether motions tell what the mode does at zero amplitude, where powers alone would extrapolate."""
    return bool(amplitude.min() <= MODAL.reaches_zero * amplitude.max())


def explain_phase(law: ResonanceLaw, settings: ResonanceSettings) -> str:
    """Return why a law does not count: powers miss the motions and take a phase that no filter makes; "" if it does."""
    found = float(law.force_phase_deg.value or 0.0)
    if law.misfit <= settings.warned_misfit or abs(found) <= settings.doubted_phase_deg:
        return ""
    return (
        f"powers of one mode miss the motions by {law.misfit:.1f} standard deviations of their noise even with a phase "
        "of the force that no filter makes: the mode has a joint with memory, another mode moves with it, or the "
        "structure changed between the levels; use the single levels, and give `opid modal` sine beats or free decays, "
        "whose laws may have a joint"
    )


def _fit_with_prior(
    states: Sequence[SteadyState],
    settings: ResonanceSettings,
    orders: tuple[int | None, int | None],
    measured_waves: bool,
    prior: tuple[float, float, float],
    is_grouped: bool,
) -> ResonanceLaw:
    amplitude = np.array([each.amplitude for each in states])
    equations = Equations.of(states, prior, is_grouped=is_grouped)
    waves = [each.displacement if measured_waves else each.displacement[:1] for each in states]
    made = [at for at, wave in enumerate(waves) if wave.size == 1]
    # Harmonics by the law need the law: three rounds, for the third harmonic is small.
    for _ in range(3 if made else 1):
        columns = find_columns(states, waves)
        fits = _rank([_solve(equations, columns, powers) for powers in _list_powers(*orders)], equations.n_rows)
        for at in made:
            waves[at] = _add_harmonics(waves[at], states[at].pole.imag, fits[0])
    return _make_law(fits, equations, amplitude, settings)


# ---- the equations --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Equations:
    """Left sides (n,) over the scale of k0, their errors without those of the amplitude, and what the force is like.

    `inertia` is what multiplies the mass of the mode, p^2 of each motion over the scale.
    """

    left: ComplexArray
    force: ComplexArray
    std: tuple[FloatArray, FloatArray]
    amplitude_error: FloatArray
    prior: tuple[float, float, float]  # standard deviations of gain and phase, and the phase itself, rad
    scale: float
    inertia: ComplexArray
    length: float
    groups: NDArray[np.int64]  # numbers of the curves to which the motions belong; all 0 for levels of one structure

    @classmethod
    def of(
        cls, states: Sequence[SteadyState], prior: tuple[float, float, float], *, is_grouped: bool = False
    ) -> Equations:
        """Return the equations of some motions; see `fit_states` for the arguments."""
        names = [e.source if is_grouped else "" for e in states]
        pole, force = np.array([e.pole for e in states]), np.array([e.receptance_inverse for e in states])
        scale = float(np.median(pole.imag)) ** 2
        noise = np.abs(force) * np.hypot([e.force_error for e in states], [e.motion_error for e in states])
        of_pole = 2.0 * pole.imag * np.array([e.pole_std for e in states])
        std = np.maximum(np.hypot(noise, of_pole) / scale, 1e-9)
        return cls(
            np.asarray((force - pole**2) / scale, dtype=np.complex128),
            np.asarray(force / scale, dtype=np.complex128),
            (std, std),
            np.array([e.motion_error for e in states]),
            prior,
            scale,
            np.asarray(pole**2 / scale, dtype=np.complex128),
            max(e.amplitude for e in states),
            np.unique(names, return_inverse=True)[1].astype(np.int64),
        )

    @property
    def n_groups(self) -> int:
        """Number of the curves to which the motions belong."""
        return int(self.groups.max()) + 1

    @property
    def n_rows(self) -> int:
        """Number of real equations."""
        return 2 * self.left.size


def find_columns(states: Sequence[SteadyState], waves: Sequence[ComplexArray]) -> tuple[ComplexArray, ComplexArray]:
    """Return <q|q|^(n-1)>_1 / q_1 and <q'|q'|^(n-1)>_1 / q_1 of each motion, (n_states, 5) each."""
    stiffness, damping = np.zeros((2, len(states), HIGHEST_ORDER), dtype=complex)
    for row, (state, wave) in enumerate(zip(states, waves, strict=True)):
        q, v = sample_period(wave, state.pole.imag)
        for n in range(1, HIGHEST_ORDER + 1):
            stiffness[row, n - 1], damping[row, n - 1] = (
                # The mean of A^n over the window is larger than the n-th power of the mean of A by this factor.
                np.exp(0.5 * n * (n - 1) * state.spread) * find_first(motion * np.abs(motion) ** (n - 1)) / wave[0]
                for motion in (q, v)
            )
        # The power 1 of a motion that grows is the pole itself.
        damping[row, 0] = state.pole
    return stiffness, damping


def sample_period(wave: ComplexArray, omega: float) -> tuple[FloatArray, FloatArray]:
    """Return displacement and velocity over a period, (N_TIMES,) each."""
    numbers = np.arange(1, wave.size + 1)
    turn = np.exp(2j * np.pi / N_TIMES * np.outer(np.arange(N_TIMES), numbers))
    return (turn @ wave).real, (turn @ (1j * omega * numbers * wave)).real


def find_first(samples: FloatArray, number: int = 1) -> complex:
    """Return a harmonic of the samples of a period, the fundamental where no number is given."""
    return complex(2.0 * np.mean(samples * np.exp(-2j * np.pi * number / N_TIMES * np.arange(N_TIMES))))


def find_group_covariance(rows: FloatArray, left: FloatArray, groups: NDArray[np.int64]) -> FloatArray:
    """Return the covariance of a least-squares solution by errors that all equations of a group share.

    Errors of a curve are common to its points: its structure has another state, or the law misses its level. That is
    why the points of one curve say less than as many single motions. Their sums over each curve tell how much (the
    sandwich by clusters; Cameron and Miller 2015, A practitioner's guide to cluster-robust inference), widened as
    Student's distribution of so few groups asks for. It is zero for fewer than three groups.

    Args:
        rows: (n, n_values) equations over their standard deviations: real parts, imaginary parts, then what is believed
            beforehand, which no group shares.
        left: (n,) their left sides.
        groups: (n_motions,) the number of the group of each motion, from 0.
    """
    n = int(groups.max()) + 1
    if n < FEWEST_GROUPS:
        return np.zeros((rows.shape[1], rows.shape[1]))
    norms = np.maximum(np.linalg.norm(rows, axis=0), np.finfo(float).tiny)
    inverse = np.linalg.pinv(rows / norms, rcond=1e-12)
    missed = left - rows @ (inverse @ left / norms)
    of_row = np.concatenate([groups, groups, np.full(len(rows) - 2 * groups.size, -1)])
    pulls = np.array([inverse[:, of_row == group] @ missed[of_row == group] / norms for group in range(n)])
    widened = float(stats.t.ppf(0.975, n - 1)) / 1.96
    return np.asarray(n / (n - 1) * widened**2 * pulls.T @ pulls, dtype=np.float64)


# ---- the fit ------------------------------------------------------------------------------------------------

_ROUNDS = 5  # of the errors, and of the phase, which is found up to 60 degrees and more


@dataclass(frozen=True, eq=False)
class _Fit:
    """Coefficients of one choice of powers, in units of the length and the scale, then the phase of the force."""

    powers: Powers
    value: FloatArray
    covariance: FloatArray
    by_gain: FloatArray  # change of the values by one standard deviation of the gain
    misfit: float  # sum of squared errors over their variances
    score: float
    scales: FloatArray  # what each coefficient is multiplied by to be in SI units
    rows: FloatArray  # the last equations that were solved, each over its standard deviation
    left: FloatArray

    def estimates(self) -> tuple[dict[int, float], dict[int, float]]:
        """Return k_n and c_n by power in SI units."""
        return _split_by_power(self, self.value[:-1] * self.scales)


def _list_powers(stiffness_order: int | None, damping_order: int | None) -> list[Powers]:
    """Return the choices of powers: all up to an order that is given, otherwise every set with the power 1."""
    higher = range(2, HIGHEST_ORDER + 1)
    Powers.of(stiffness_order or 1, damping_order or 1, free_linear=True)  # refuses wrong orders
    both = [
        [(1, *more) for size in range(len(higher) + 1) for more in combinations(higher, size)]
        if order is None
        else [tuple(range(1, order + 1))]
        for order in (stiffness_order, damping_order)
    ]
    return [Powers(k, c) for k in both[0] for c in both[1]]


def _add_harmonics(wave: ComplexArray, omega: float, fit: _Fit) -> ComplexArray:
    """Return the fundamental of a motion with the third harmonic that the law makes of it."""
    k, c = fit.estimates()
    q, v = sample_period(wave, omega)
    force = sum(
        value * motion * np.abs(motion) ** (n - 1)
        for motion, values in ((q, k), (v, c))
        for n, value in values.items()
        if n > 1
    )
    third = -find_first(np.asarray(force) + 0.0 * q, 3) / (k[1] - 9.0 * omega**2 + 3j * omega * c[1])
    return np.array([wave[0], 0.0, third])


def _solve(equations: Equations, columns: tuple[ComplexArray, ComplexArray], powers: Powers) -> _Fit:
    """Return the coefficients of one choice of powers by least squares, each equation over its standard deviation."""
    length, speed = equations.length, equations.length * float(np.sqrt(equations.scale))
    scales = np.array(
        [equations.scale * length ** (1.0 - n) for n in powers.k]
        + [equations.scale * length * speed ** (-float(n)) for n in powers.c]
    )
    chosen = [columns[0][:, n - 1] for n in powers.k] + [columns[1][:, n - 1] for n in powers.c]
    matrix = np.column_stack(chosen) * scales / equations.scale
    prior = np.zeros((1, matrix.shape[1] + 1))
    prior[0, -1] = 1.0 / equations.prior[1]
    std, phase, value = equations.std, 0.0, np.zeros(matrix.shape[1] + 1)
    for _ in range(_ROUNDS):
        # The force is turned by the phase that was found, so that the last column holds what is left of it.
        phase += float(value[-1])
        force = equations.force * np.exp(-1j * phase)
        whole, sides = np.column_stack([matrix, 1j * force]), equations.left - equations.force + force
        rows = np.vstack([whole.real / std[0][:, None], whole.imag / std[1][:, None], prior])
        believed = [(equations.prior[2] - phase) / equations.prior[1]]
        left = np.concatenate([sides.real / std[0], sides.imag / std[1], believed])
        norms, std_last = np.linalg.norm(rows, axis=0), std
        inverse = np.linalg.pinv(rows / norms, rcond=1e-12)
        value = inverse @ left / norms
        # The equation moves with an error of the amplitude by as much as its terms depend on it.
        depends = np.array([n - 1.0 for n in (*powers.k, *powers.c)])
        slope = (matrix * depends) @ value[:-1]
        std = (
            np.hypot(equations.std[0], np.abs(slope.real) * equations.amplitude_error),
            np.hypot(equations.std[1], np.abs(slope.imag) * equations.amplitude_error),
        )
    covariance = inverse @ inverse.T / np.outer(norms, norms)
    misfit = float(np.sum((left - rows @ value) ** 2))
    # A gain stands in no column: the noise of the force would be mistaken for it.
    shared = np.concatenate([force.real / std_last[0], force.imag / std_last[1], [0.0]])
    by_gain = equations.prior[0] * (inverse @ shared) / norms
    # A gain of the motion scales the amplitudes of the powers, too.
    by_gain[:-1] += equations.prior[0] * depends * value[:-1]
    value[-1] += phase
    return _Fit(powers, value, covariance, by_gain, misfit, misfit, scales, rows, left)


def _rank(fits: Sequence[_Fit], n_rows: int) -> list[_Fit]:
    """Return the fits by their Bayesian criterion; where no law explains the motions, the best one sets the scale."""
    scale = max(min(fit.misfit / max(n_rows - fit.value.size + 1, 1) for fit in fits), 1.0)
    ranked = [replace(fit, score=fit.misfit / scale + fit.value.size * np.log(n_rows)) for fit in fits]
    return sorted(ranked, key=lambda fit: fit.score)


# ---- the answer ---------------------------------------------------------------------------------------------


def _make_law(
    fits: Sequence[_Fit], equations: Equations, amplitude: FloatArray, settings: ResonanceSettings
) -> ResonanceLaw:
    best = fits[0]
    freedom = max(equations.n_rows - best.value.size + 1, 1)
    ratio = float(np.sqrt(best.misfit / freedom))
    weights = np.exp(-0.5 * np.array([fit.score - best.score for fit in fits]))
    # Powers that hardly explain the motions may have lost all stiffness, where a damping ratio has no end.
    counts = weights >= settings.least_weight * weights.sum()
    fits, weights = [fit for fit, is_kept in zip(fits, counts, strict=True) if is_kept], weights[counts]
    a = np.linspace(float(amplitude.min()), float(amplitude.max()), settings.n_curve)
    curves = np.array([_find_curve(fit, a) for fit in fits])
    covariance = _find_covariance(best, equations, ratio)
    k, c = _split_by_power(best, np.sqrt(np.diag(covariance)[:-1]) * best.scales)
    tables: list[dict[int, Estimate]] = []
    for which, stds in enumerate((k, c)):
        tables.append({})
        for power, value in best.estimates()[which].items():
            others = [(w, f.estimates()[which]) for w, f in zip(weights, fits, strict=True)]
            spread = sum(w * (each[power] - value) ** 2 for w, each in others if power in each)
            total = sum(w for w, each in others if power in each)
            tables[-1][power] = Estimate.normal(value, float(np.hypot(stds[power], np.sqrt(spread / total))))
    gradient = _find_gradient(best, a)
    of_fit = np.sqrt(np.einsum("xan,nm,xam->xa", gradient, covariance, gradient))
    of_choice = np.sqrt(np.einsum("f,fxa->xa", weights / weights.sum(), (curves - curves[0]) ** 2))
    std = np.hypot(of_fit, of_choice)
    lost = np.flatnonzero(curves[0, 1] + 2.0 * std[1] < 0.0)
    if lost.size:
        raise NotDeterminedError(
            f"the motions show a negative damping, {100.0 * curves[0, 1, lost].min():.2g} % at the least, which no "
            "structure without a source of energy has: see what drives the mode beside the force, and whether force "
            "and accelerations have their signs and no delay"
        )
    if ratio > settings.warned_misfit and equations.n_groups < FEWEST_GROUPS:
        # The law is of another kind, and nothing but a factor shows what that does to coefficients; whole curves do.
        tables = [{power: each.without_interval() for power, each in table.items()} for table in tables]
    if not reaches_zero(amplitude):
        tables = [{n: each.without_interval() if n == 1 else each for n, each in table.items()} for table in tables]
    return ResonanceLaw(
        stiffness=withhold_negative(tables[0]),
        damping=withhold_negative(tables[1]),
        amplitude=a,
        frequency_hz=curves[0, 0],
        frequency_std_hz=std[0],
        damping_ratio=curves[0, 1],
        damping_std=std[1],
        force_phase_deg=Estimate.normal(*np.degrees([best.value[-1], np.sqrt(covariance[-1, -1])])),
        misfit=ratio,
        n_states=amplitude.size,
        candidates=tuple(_list_candidates(fits, equations, weights / weights.sum(), ratio)),
    )


def _find_covariance(fit: _Fit, equations: Equations, ratio: float) -> FloatArray:
    """Return the covariance of the values of a fit: by noise and misfit or by whole curves, and by the gain."""
    by_curves = find_group_covariance(fit.rows, fit.left, equations.groups)
    by_gain = np.outer(fit.by_gain, fit.by_gain)
    return np.asarray(fit.covariance * max(ratio, 1.0) ** 2 + by_curves + by_gain, dtype=np.float64)


def _list_candidates(
    fits: Sequence[_Fit], equations: Equations, weights: FloatArray, ratio: float
) -> Iterator[LawCandidate]:
    """Yield the choices of powers, each with its weight."""
    for fit, weight in zip(fits, weights.tolist(), strict=True):
        scales = np.append(fit.scales, 1.0)
        covariance = _find_covariance(fit, equations, ratio)
        k, c = fit.estimates()
        yield LawCandidate(k, c, float(fit.value[-1]), covariance * np.outer(scales, scales), weight)


def _find_curve(fit: _Fit, amplitude: FloatArray) -> FloatArray:
    """Return natural frequency, Hz, and damping ratio at some amplitudes, (2, n), by harmonic linearisation."""
    k, c = fit.estimates()
    square = sum(value * first_harmonic_factor(n) * amplitude ** (n - 1) for n, value in k.items())
    omega = np.sqrt(np.maximum(square, LEAST_SIZE))  # a lost stiffness has an endless damping ratio, but with a square
    damping = sum(value * first_harmonic_factor(n) * (omega * amplitude) ** (n - 1) for n, value in c.items())
    return np.array([omega / (2.0 * np.pi), damping / (2.0 * omega)])


def _find_gradient(fit: _Fit, amplitude: FloatArray) -> FloatArray:
    """Return the derivatives of the curves by the values of the fit, (2, n, n_values), by differences."""
    start, columns = _find_curve(fit, amplitude), []
    for j in range(fit.value.size):
        step = 1e-6 * max(abs(fit.value[j]), 1e-3)
        moved = fit.value.copy()
        moved[j] += step
        there = _find_curve(replace(fit, value=moved), amplitude)
        columns.append((there - start) / step)
    return np.stack(columns, axis=-1)


def _split_by_power(fit: _Fit, values: FloatArray) -> tuple[dict[int, float], dict[int, float]]:
    """Return what belongs to k_n and to c_n, by power, from values in the order of the coefficients."""
    n = len(fit.powers.k)
    both = ((fit.powers.k, values[:n]), (fit.powers.c, values[n:]))
    k, c = ({p: float(v) for p, v in zip(powers, of, strict=True)} for powers, of in both)
    return k, c
