"""The equation of the sprung mass, line by line, with noise on both channels.

With accelerations A1, A2 and a nonlinear force F per unit of sprung mass, eq. (4) of Iwaniec & Uhl (2007) reads at
every line of the Fourier transform of a run

    R = (k2 + j w c2) A1 - (k2 + k3 - w^2 + j w c2) A2 + w^2 F = N A1 - D A2 + w^2 F = 0,

which is w^2 T = k2 (T - 1) + j w c2 (T - 1) + k3 T for T = A2/A1 and F = 0. Three things make it exact on real runs:

- noise of variance s1^2, s2^2 on A1, A2 gives R the variance s1^2 |N|^2 + s2^2 |D|^2: dividing by its root makes least
  squares the maximum-likelihood, errors-in-variables estimate (Pintelon & Schoukens, System Identification, ch. 8).
  Both sensors are taken to be equally noisy, s1 = s2, and its size is estimated;
- a run neither starts nor ends at rest. Without a window the transform of a derivative differs from j w times the
  transform by end terms only, a polynomial in j w with real coefficients (Pintelon & Schoukens, 6.3.2): these few
  unknowns are projected out, and nothing leaks;
- nothing is integrated but the motion inside F.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from opid.errors import InputError
from opid.mechanics.laws.law import FitOfOneLaw, Law, Term
from opid.signals.motion import relative_motion
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.fitting.least_squares import clustered_covariance
from opid.suspensions.model.law_parameters import free_bounds, from_free, positive, to_free
from opid.suspensions.paper.settings import PaperSettings

RATIOS = ("stiffness_per_mass", "damping_per_mass", "ground_stiffness_per_mass")
"""K2/M2 in 1/s^2, C2/M2 in 1/s, K3/M2 in 1/s^2."""

# number of real coefficients of the end terms: displacement and velocity at both ends need two, sampling one more
_N_END_TERMS = 3


@dataclass(frozen=True, eq=False)
class FittedValues:
    """Fitted values by their names.

    Args:
        names: (n,) names of the values.
        value: (n,) values.
        covariance: (n, n) covariance of the values.
    """

    names: tuple[str, ...]
    value: FloatArray
    covariance: FloatArray

    @property
    def std(self) -> FloatArray:
        """(n,) standard deviations."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0))

    def std_of(self, name: str) -> float:
        """Return the standard deviation of the value called `name`, which was fitted."""
        return float(self.std[self.names.index(name)])

    def _read_value(self, name: str) -> float:
        return float(self.value[self.names.index(name)]) if name in self.names else 0.0


class FittedRatios(FittedValues):
    """Values fitted per unit of mass: `RATIOS` and others."""

    @property
    def ratios(self) -> tuple[float, float, float]:
        """The values of `RATIOS`; 0 for one that was not fitted."""
        stiffness, damping, ground = map(self._read_value, RATIOS)
        return stiffness, damping, ground


@dataclass(frozen=True, eq=False)
class JointFit(FittedRatios, FitOfOneLaw):
    """A fit of one or several runs at once, per unit of the reference sprung mass.

    Its values are those of `RATIOS`, "law[i]" for entry i of `law.vector`, and "inverse_mass" (1/kg) where it is free.

    Args:
        law: the nonlinear law per unit of sprung mass.
        frequency_hz: one array (n_lines,) a run.
        residual: one complex array (n_lines,) a run, what the fit leaves, expressed as white noise on each channel,
            m/s^2 (its mean square is `noise_m_per_s2` squared).
        noise_m_per_s2: white noise on each channel that would explain the residual, m/s^2.
        log_likelihood: up to a constant, with the noise at its estimate.
        n_data: real numbers fitted, end terms subtracted.
    """

    law: Law
    frequency_hz: tuple[FloatArray, ...]
    residual: tuple[ComplexArray, ...]
    noise_m_per_s2: float
    log_likelihood: float
    n_data: int

    @property
    def inverse_mass(self) -> float:
        """1/M2, 1/kg; 0 if it was not fitted."""
        return self._read_value("inverse_mass")

    @property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz 1978): smaller is better."""
        return float(len(self.value) * np.log(self.n_data) - 2 * self.log_likelihood)

    @property
    def error_rms(self) -> float:
        """Rms of the residual, as a search compares laws, m/s^2."""
        return self.noise_m_per_s2


@dataclass(frozen=True, eq=False)
class EquationLines:
    """One run, ready for the equation: Fourier lines of both accelerations and the motion that drives the law.

    Args:
        omega: (n_lines,) rad/s.
        unsprung: (n_lines,) transform of x1'', scaled so that unit white noise has unit parts, m/s^2.
        sprung: (n_lines,) transform of x2'', scaled in the same way, m/s^2.
        travel: (n,) z, m.
        velocity: (n,) z', m/s.
        fs: sampling rate, Hz.
        band_hz: lowest and highest line, Hz.
        mass_change_kg: sprung mass of this run minus that of the reference, kg.
    """

    omega: FloatArray
    unsprung: ComplexArray
    sprung: ComplexArray
    travel: FloatArray
    velocity: FloatArray
    fs: float
    band_hz: tuple[float, float]
    mass_change_kg: float

    @property
    def lines(self) -> slice:
        """Indices of the lines of the band among all lines of the transform."""
        first = round(float(self.omega[0]) / (2 * np.pi) * self.travel.size / self.fs)
        return slice(first, first + self.omega.size)

    def transform(self, samples: FloatArray) -> ComplexArray:
        """Fourier lines of a signal of this run, in its unit, scaled so that unit white noise has unit parts."""
        return fft.rfft(samples)[self.lines] / np.sqrt(self.travel.size / 2)


def equation_lines(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    *,
    fs: float,
    band_hz: tuple[float, float] = PaperSettings.band_hz,
    high_pass_hz: float = PaperSettings.high_pass_hz,
    mass_change_kg: float = 0.0,
) -> EquationLines:
    """Transform one run, without a window, after cutting the ends in which the motion has not settled.

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        fs: sampling rate, Hz.
        band_hz: lowest and highest line to use, Hz.
        high_pass_hz: corner of the integration that gives the motion inside the law, Hz.
        mass_change_kg: sprung mass of this run minus that of the reference, kg.

    Raises:
        InputError: a band outside (0, fs/2), or fewer than 20 lines in it.

    >>> rng = np.random.default_rng(0)
    >>> lines = equation_lines(*rng.standard_normal((2, 5120)), fs=256.0, band_hz=(1, 10))
    >>> lines.omega.size == lines.unsprung.size > 100
    True
    """
    low, high = float(band_hz[0]), float(band_hz[1])
    if not 0 < low < high <= fs / 2:
        raise InputError(f"band_hz is ({low:g}, {high:g}): give 0 < low < high <= fs/2 = {fs / 2:g} Hz")
    motion = relative_motion(unsprung, sprung, fs=fs, high_pass_hz=high_pass_hz)
    inside = _choose_fast_length(motion.interior)
    frequency_hz = fft.rfftfreq(max(inside.stop - inside.start, 1), 1 / fs)
    keep = np.flatnonzero((frequency_hz >= low) & (frequency_hz <= high))
    if keep.size < 20:
        raise InputError(
            f"the band {low:g} to {high:g} Hz holds {keep.size} lines of a run of "
            f"{len(motion.acceleration) / fs:.3g} s ({2 * motion.settle_s:.3g} s of it settling): give a longer run "
            "or a wider band"
        )
    lower, upper = (np.asarray(samples, dtype=np.float64)[inside] for samples in (unsprung, sprung))
    return EquationLines(
        omega=2 * np.pi * frequency_hz[keep],
        unsprung=fft.rfft(lower)[keep] / np.sqrt(lower.size / 2),
        sprung=fft.rfft(upper)[keep] / np.sqrt(upper.size / 2),
        travel=motion.displacement[inside],
        velocity=motion.velocity[inside],
        fs=float(fs),
        band_hz=(low, high),
        mass_change_kg=float(mass_change_kg),
    )


def fit_equation(
    runs: Sequence[EquationLines],
    law: Law,
    *,
    stiffness_per_mass: float,
    damping_per_mass: float,
    ground: bool = True,
    inverse_mass: float | None = None,
    cluster_hz: float = PaperSettings.cluster_hz,
) -> JointFit:
    """Fit the equation to all runs at once by weighted nonlinear least squares.

    With q_r = 1/(1 + mu dM_r), mu = 1/M2, every force per unit of mass in run r is q_r times that of the reference.
    With mu free and at least two different mass changes the absolute mass follows; with mu held only ratios are fitted.

    Args:
        runs: one `EquationLines` a run.
        law: the nonlinear law per unit of sprung mass to start from; `Law()` for a linear suspension.
        stiffness_per_mass: start value of K2/M2, 1/s^2.
        damping_per_mass: start value of C2/M2, 1/s.
        ground: whether the ground spring K3 is free (else it is 0).
        inverse_mass: start value of mu, 1/kg, or None to fit ratios only.
        cluster_hz: width of neighbouring lines that are taken together in the covariance, Hz.

    Raises:
        InputError: no run, or a free mass although all mass changes are equal.
    """
    from scipy import optimize

    if not runs:
        raise InputError("no run was given: give at least one")
    if inverse_mass is not None and len({run.mass_change_kg for run in runs}) < 2:
        raise InputError("all runs have the same mass change: only ratios to the mass can be fitted")
    model = _Model(tuple(runs), law, ground, inverse_mass is not None)
    start = model.encode(stiffness_per_mass, damping_per_mass, inverse_mass or 0.0)
    lower, upper = model.bounds()
    start = np.clip(start, lower + 1e-3, upper - 1e-3)
    solution = optimize.least_squares(
        model.stacked,
        start,
        x_scale=model.typical(start),
        bounds=(lower, upper),
        max_nfev=60,
        xtol=1e-9,
        ftol=1e-10,
    )
    residual = tuple(model.residuals(solution.x))
    n_data = sum(2 * r.size - _N_END_TERMS for r in residual)
    variance = 2 * solution.cost / max(n_data - solution.x.size, 1)
    value, slope = model.decode(solution.x)
    covariance = clustered_covariance(solution.jac, solution.fun, _index_cells(runs, cluster_hz)) * np.outer(
        slope, slope
    )
    return JointFit(
        names=model.names,
        value=value,
        covariance=covariance,
        law=model.law_at(solution.x)[0],
        frequency_hz=tuple(r.omega / (2 * np.pi) for r in runs),
        # A line has a real and an imaginary part.
        residual=tuple(r / np.sqrt(2) for r in residual),
        noise_m_per_s2=float(np.sqrt(variance)),
        log_likelihood=float(-0.5 * n_data * np.log(2 * solution.cost / n_data)),
        n_data=n_data,
    )


def differentiate(
    runs: Sequence[EquationLines], fit: JointFit, terms: Sequence[Term]
) -> tuple[FloatArray, FloatArray, FloatArray, list[FloatArray]]:
    """Return the residual of a fit and its derivatives by differences, with real and imaginary parts of lines apart.

    The derivatives are those by each entry of the law, (n, n_law), by all other fitted values, (n, n_others), and by
    the amplitude of each further term, (n,), which are too weak to change the residual.
    """
    model = _Model(tuple(runs), fit.law, RATIOS[2] in fit.names, "inverse_mass" in fit.names)
    theta = fit.value.copy()
    theta[model.law_part] = to_free(fit.law)
    residual = model.stacked(theta)
    steps = 1e-6 * model.typical(theta)
    jacobian = np.stack([(model.stacked(theta + step) - residual) / step.sum() for step in np.diag(steps)], axis=1)
    by_terms = []
    for term in terms:
        larger = replace(model, law=fit.law + Law((term,)))
        moved = np.concatenate([theta[: model.law_part.start], to_free(larger.law), theta[model.law_part.stop :]])
        by_terms.append((larger.stacked(moved) - residual) / term.amplitude)
    own = np.arange(theta.size)[model.law_part]
    return residual, jacobian[:, own], np.delete(jacobian, own, axis=1), by_terms


@dataclass(frozen=True, eq=False)
class _Model:
    """The residual as a function of one vector: k2, c2, [k3], law (scales as logarithms), [1/M2]."""

    runs: tuple[EquationLines, ...]
    law: Law
    ground: bool
    has_free_mass: bool

    @property
    def names(self) -> tuple[str, ...]:
        of_law = (f"law[{i}]" for i in range(self.law.vector.size))
        return (*RATIOS[: 2 + self.ground], *of_law, *["inverse_mass"] * self.has_free_mass)

    def encode(self, stiffness: float, damping: float, inverse_mass: float) -> FloatArray:
        head = [stiffness, damping] + [0.0] * self.ground
        return np.array([*head, *to_free(self.law), *[inverse_mass] * self.has_free_mass])

    @property
    def law_part(self) -> slice:
        """Indices of the law in the vector."""
        return slice(2 + self.ground, 2 + self.ground + self.law.vector.size)

    def law_at(self, theta: FloatArray) -> tuple[Law, FloatArray]:
        """Return the law, and the derivatives of its vector by theta."""
        return from_free(self.law, theta[self.law_part])

    def decode(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the values in the order of the names, and their derivatives by theta."""
        value, slope = theta.copy(), np.ones_like(theta)
        law, by_free = self.law_at(theta)
        value[self.law_part], slope[self.law_part] = law.vector, by_free
        return value, slope

    def typical(self, theta: FloatArray) -> FloatArray:
        """Return typical sizes of the entries."""
        size = np.maximum(np.abs(theta), 1e-3)
        size[2 : 2 + self.ground] = 0.1 * size[0]
        size[self.law_part][positive(self.law)] = 0.3
        if self.has_free_mass:
            size[-1] = max(abs(float(theta[-1])), 1e-3 / max(abs(r.mass_change_kg) for r in self.runs))
        return size

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        lower = np.full(len(self.names), -np.inf)
        upper = -lower
        travel, velocity = (np.concatenate([getattr(r, name) for r in self.runs]) for name in ("travel", "velocity"))
        lower[self.law_part], upper[self.law_part] = free_bounds(
            self.law, travel_rms=float(travel.std()), velocity_rms=float(velocity.std())
        )
        return lower, upper

    def residuals(self, theta: FloatArray) -> list[ComplexArray]:
        """R over its standard deviation for unit noise, end terms projected out, one array a run."""
        stiffness, damping = theta[0], theta[1]
        ground = theta[2] if self.ground else 0.0
        law, _ = self.law_at(theta)
        result = []
        for run in self.runs:
            mass_ratio = 1.0 / (1.0 + theta[-1] * run.mass_change_kg) if self.has_free_mass else 1.0
            numerator = mass_ratio * (stiffness + 1j * run.omega * damping)
            denominator = numerator + mass_ratio * ground - run.omega**2
            residual = numerator * run.unsprung - denominator * run.sprung
            if law.terms:
                force = run.transform(law.force(run.travel, run.velocity))
                residual = residual + mass_ratio * run.omega**2 * force
                # Noise also passes through the law: its statistical linearisation (mean slopes) enters the weight.
                by_travel, by_velocity = (float(np.mean(g)) for g in law.gradient(run.travel, run.velocity))
                tangent = mass_ratio * (by_travel + 1j * run.omega * by_velocity)
                numerator, denominator = numerator + tangent, denominator + tangent
            weight = 1.0 / np.sqrt(np.abs(numerator) ** 2 + np.abs(denominator) ** 2)
            result.append(_project_out_end_terms(residual * weight, run.omega, weight))
        return result

    def stacked(self, theta: FloatArray) -> FloatArray:
        return np.concatenate([part for r in self.residuals(theta) for part in (r.real, r.imag)])


def _project_out_end_terms(residual: ComplexArray, omega: FloatArray, weight: FloatArray) -> ComplexArray:
    """Project a polynomial in j omega with real coefficients out of a residual."""
    columns = weight[:, np.newaxis] * (1j * omega[:, np.newaxis] / omega[-1]) ** np.arange(_N_END_TERMS)
    basis, _ = np.linalg.qr(np.concatenate([columns.real, columns.imag]))
    flat = np.concatenate([residual.real, residual.imag])
    flat = flat - basis @ (basis.T @ flat)
    return flat[: residual.size] + 1j * flat[residual.size :]


def _index_cells(runs: Sequence[EquationLines], width_hz: float) -> NDArray[np.int64]:
    """Return the cell of neighbouring lines of one run to which each real number of the residual belongs."""
    cells = []
    for index, run in enumerate(runs):
        cell = np.floor(run.omega / (2 * np.pi * width_hz)).astype(np.int64) + 1_000_000 * index
        cells += [cell, cell]
    return np.concatenate(cells)


def _choose_fast_length(inside: slice) -> slice:
    """Drop a few samples so that the transform is fast: lengths with large prime factors are slow."""
    return slice(inside.start, inside.start + fft.prev_fast_len(max(inside.stop - inside.start, 1), real=True))
