"""Integrate the model, not the data: fit the body that the measured spindle accelerations drive.

z'' = -x1'' - (K2 z + C2 z' + f(z, z') + K3 x2)/M2 is a damped system driven by what was measured. It is simulated,
the airframe acceleration is predicted, and mass, stiffness, damping and law of all runs are moved until
the prediction errors are white. No acceleration is integrated, so no slow motion is lost and nothing drifts.

The error of a line is that of the airframe sensor, and that of the spindle sensor passed through the transmissibility
of the model (its law replaced by its mean slopes): each line is divided by sqrt(s2^2 + |T|^2 s1^2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from opid.errors import InputError
from opid.identify.joint_fit import JointFit
from opid.identify.law_parameters import free_bounds, from_free, to_free
from opid.mechanics.driven import (
    DrivenResponse,
    Interface,
    UnboundedResponseError,
    driven_response,
    half_steps,
)
from opid.mechanics.laws import Law, Term
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray

# how far from rest relative to the body a record may begin: wide enough to be no information
START_TRAVEL_M, START_VELOCITY_M_PER_S = 0.02, 0.2
# offset that is left in an acceleration once its mean is removed
OFFSET_M_PER_S2 = 0.05
BAND_HZ = (0.3, 40.0)
N_START = 4


@dataclass(frozen=True, eq=False)
class DrivenRun:
    """One run, ready for the model.

    Args:
        drive: (2 n - 1, 1) spindle acceleration at half steps, mean removed, m/s^2.
        sprung: (n_lines,) transform of the airframe acceleration, mean removed, m/s.
        omega: (n_lines,) rad/s.
        n_samples: n.
        fs: sampling rate, Hz.
        mass_change_kg: sprung mass of this run minus that of the reference, kg.
    """

    drive: FloatArray
    sprung: ComplexArray
    omega: FloatArray
    n_samples: int
    fs: float
    mass_change_kg: float

    @property
    def lines(self) -> slice:
        """Places of the lines of the band among all lines of the transform."""
        first = round(float(self.omega[0]) / (2 * np.pi) * self.n_samples / self.fs)
        return slice(first, first + self.omega.size)

    def transform(self, samples: FloatArray) -> ComplexArray:
        """Fourier lines of signals of this run, one a column, scaled so that unit white noise has unit parts."""
        return fft.rfft(samples, axis=0)[self.lines] / np.sqrt(self.n_samples / 2)


@dataclass(frozen=True, eq=False)
class ModelFit(JointFit):
    """The fitted model, per unit of the reference sprung mass; beside what every joint fit has:

    Args:
        responses: the fitted motion of each run.
        start: (n_runs * n_own,) travel and velocity (and body displacement and velocity) at the start, and offset of
            the drive, run by run.
    """

    responses: tuple[DrivenResponse, ...]
    start: FloatArray


def driven_run(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    *,
    fs: float,
    band_hz: tuple[float, float] = BAND_HZ,
    mass_change_kg: float = 0.0,
) -> DrivenRun:
    """Prepare one run: the drive at half steps and the lines of the airframe acceleration.

    Only the residual is restricted to the band. The drive keeps its slow motion: a nonlinear law needs it.

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        fs: sampling rate, Hz.
        band_hz: lowest and highest line to compare, Hz; cut at 0.4 fs.
        mass_change_kg: sprung mass of this run minus that of the reference, kg.

    Raises:
        InputError: arrays of different lengths, or a band with fewer than 20 lines.
    """
    lower, upper = np.asarray(unsprung, dtype=np.float64), np.asarray(sprung, dtype=np.float64)
    if lower.shape != upper.shape or lower.ndim != 1:
        raise InputError(f"unsprung has shape {lower.shape} and sprung {upper.shape}: give runs of one length")
    n = fft.prev_fast_len(lower.size, real=True)
    frequency_hz = fft.rfftfreq(n, 1 / fs)
    low, high = float(band_hz[0]), min(float(band_hz[1]), 0.4 * fs)
    keep = np.flatnonzero((frequency_hz >= low) & (frequency_hz <= high) & (frequency_hz > 0))
    if keep.size < 20:
        raise InputError(
            f"the band {low:g} to {high:g} Hz holds {keep.size} lines of a run of {lower.size / fs:.3g} s: give a "
            "longer run or a wider band"
        )
    run = DrivenRun(
        drive=half_steps(lower[:n] - lower[:n].mean())[:, np.newaxis],
        sprung=np.empty(0, np.complex128),
        omega=2 * np.pi * frequency_hz[keep],
        n_samples=n,
        fs=float(fs),
        mass_change_kg=float(mass_change_kg),
    )
    object.__setattr__(run, "sprung", run.transform(upper[:n] - upper[:n].mean()))
    return run


def fit_model(
    runs: Sequence[DrivenRun],
    law: Law,
    *,
    stiffness_per_mass: float,
    damping_per_mass: float,
    ground: bool = False,
    ground_stiffness_per_mass: float = 0.0,
    inverse_mass: float | None = None,
    motion_rms: tuple[float, float] = (3e-3, 0.05),
) -> ModelFit:
    """Move the model until it predicts the airframe accelerations of all runs.

    Args:
        runs: one `DrivenRun` a run.
        law: the nonlinear law per unit of sprung mass to start from; `Law()` for a linear suspension.
        stiffness_per_mass: start value of K2/M2, 1/s^2.
        damping_per_mass: start value of C2/M2, 1/s.
        ground: whether the ground spring K3 is free (else it is 0).
        ground_stiffness_per_mass: start value of K3/M2, 1/s^2.
        inverse_mass: start value of 1/M2, 1/kg, or None to fit ratios only.
        motion_rms: rms travel (m) and velocity (m/s), which bound the scales of the law.

    Raises:
        InputError: no run, or a free mass although all mass changes are equal.
        UnboundedResponseError: the start values make a suspension that grows without bound.
    """
    from scipy import optimize

    if not runs:
        raise InputError("no run was given: give at least one")
    if inverse_mass is not None and len({run.mass_change_kg for run in runs}) < 2:
        raise InputError("all runs have the same mass change: only ratios to the mass can be fitted")
    model = _Model(tuple(runs), law, ground, inverse_mass is not None)
    start, lower, upper = model.start(
        stiffness_per_mass, damping_per_mass, ground_stiffness_per_mass, inverse_mass or 0.0, motion_rms
    )
    cache = _Remembered(model)
    solution = optimize.least_squares(
        cache.residual,
        np.clip(start, lower + 1e-6, upper - 1e-6),
        jac=cache.jacobian,
        x_scale="jac",
        bounds=(lower, upper),
        max_nfev=60,
        xtol=1e-9,
        ftol=1e-9,
    )
    return model.result(solution)


def score_of_term(runs: Sequence[DrivenRun], fit: ModelFit, term: Term) -> tuple[float, float]:
    """Return how far a term would lower the squared whitened error, and at what amplitude, to first order.

    The model is simulated with the term at amplitude zero. The derivative of the prediction by that amplitude, made
    orthogonal to those by all fitted parameters, takes (r . d)^2/(d . d) from the squared error (score test).

    Args:
        runs: one `DrivenRun` a run.
        fit: the model without the term.
        term: the term; its amplitude does not matter.
    """
    silent = Term(term.name, (0.0, *term.inner))
    model = _Model(
        tuple(runs), fit.law + Law((silent,)), "ground_stiffness_per_mass" in fit.names, "inverse_mass" in fit.names
    )
    theta = np.array(
        [
            *fit.value[: model.n_head],
            *to_free(model.law),
            *([fit["inverse_mass"]] if model.mass_free else []),
            *fit.start,
        ]
    )
    residual, jacobian, _, _ = model.evaluate(theta)
    place = model.n_head + next(
        i for i, owner in enumerate(t.name for t in model.law.terms for _ in t.values) if owner == term.name
    )
    # at amplitude zero the inner parameters of the term move nothing
    own = range(place, place + len(term.values))
    others = jacobian[:, [k for k in range(theta.size) if k not in own]]
    scale = np.maximum(np.sqrt(np.sum(others**2, axis=0)), 1e-300)
    basis, _ = np.linalg.qr(others / scale)
    direction = jacobian[:, place] - basis @ (basis.T @ jacobian[:, place])
    error = residual - basis @ (basis.T @ residual)
    size = float(direction @ direction)
    if size <= 1e-20 * float(jacobian[:, place] @ jacobian[:, place]):
        return 0.0, 0.0
    along = float(direction @ error)
    return along**2 / size, -along / size


@dataclass(frozen=True, eq=False)
class _Model:
    """Prediction errors and their derivatives as functions of one vector.

    k2, c2, [k3], law (positive entries as logarithms), [1/M2]; then for each run travel, velocity, [body displacement,
    body velocity] at the start and the offset of the drive.
    """

    runs: tuple[DrivenRun, ...]
    law: Law
    ground: bool
    mass_free: bool

    @property
    def names(self) -> tuple[str, ...]:
        names = ["stiffness_per_mass", "damping_per_mass"] + ["ground_stiffness_per_mass"] * self.ground
        names += [f"law[{i}]" for i in range(self.law.vector.size)]
        return (*names, *["inverse_mass"] * self.mass_free)

    @property
    def n_head(self) -> int:
        return 2 + self.ground

    @property
    def n_own(self) -> int:
        """Unknowns of each run: its start and its offset."""
        return 3 + 2 * self.ground

    def start(
        self, stiffness: float, damping: float, ground: float, inverse_mass: float, motion_rms: tuple[float, float]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        head = [stiffness, damping] + [ground] * self.ground
        start = np.array(
            [*head, *to_free(self.law), *[inverse_mass] * self.mass_free, *[0.0] * (self.n_own * len(self.runs))]
        )
        lower = np.full(start.size, -np.inf)
        upper = -lower
        law_part = slice(self.n_head, self.n_head + self.law.vector.size)
        lower[law_part], upper[law_part] = free_bounds(self.law, travel_rms=motion_rms[0], velocity_rms=motion_rms[1])
        # a driven system that feeds itself has no response to compare
        lower[1] = -abs(damping)
        return start, lower, upper

    def evaluate(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, list[ComplexArray], list[DrivenResponse]]:
        """Stacked whitened errors, their Jacobian, and per run the errors and the responses."""
        n_law = self.law.vector.size
        law, slope = from_free(self.law, theta[self.n_head : self.n_head + n_law])
        mu = float(theta[self.n_head + n_law]) if self.mass_free else 0.0
        ground = float(theta[2]) if self.ground else 0.0
        interface = Interface(float(theta[0]), float(theta[1]), ground, law)
        errors, blocks, responses = [], [], []
        for place, run in enumerate(self.runs):
            share = 1.0 / (1.0 + mu * run.mass_change_kg)
            own = slice(len(self.names) + self.n_own * place, len(self.names) + self.n_own * (place + 1))
            at_start = np.zeros((4, 1))
            at_start[: self.n_own - 1, 0] = theta[own][:-1]
            response = driven_response(
                [interface],
                [[share]],
                run.drive + theta[own][-1],
                fs=run.fs,
                accelerance_directions=[[[1.0]]],
                drive_directions=np.ones((run.drive.shape[0], 1, 1)),
                start=at_start,
            )
            weight = _whitening(run, interface, share, response)
            error = (run.sprung - run.transform(response.acceleration[:, 0])) * weight
            change = -run.transform(response.sensitivity[:, 0]) * weight[:, np.newaxis]
            block = np.zeros((run.omega.size, theta.size), dtype=np.complex128)
            n_joint = 3 + n_law
            block[:, :2] = change[:, :2]
            if self.ground:
                block[:, 2] = change[:, 2]
            block[:, self.n_head : self.n_head + n_law] = change[:, 3:n_joint] * slope
            if self.mass_free:
                block[:, self.n_head + n_law] = change[:, n_joint] * (-(share**2) * run.mass_change_kg)
            # after the accelerance and the offset of the drive come the motions at the start
            block[:, own] = change[:, [n_joint + 2 + i for i in range(self.n_own - 1)] + [n_joint + 1]]
            errors.append(error)
            blocks.append(block)
            responses.append(response)
        prior, by_prior = self._prior(theta)
        residual = np.concatenate([part for e in errors for part in (e.real, e.imag)] + [prior])
        jacobian = np.concatenate([part for b in blocks for part in (b.real, b.imag)] + [by_prior])
        return residual, jacobian, errors, responses

    def _prior(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Weak knowledge of the start and the offset: it keeps the optimiser from wandering where nothing is known."""
        size = [START_TRAVEL_M, START_VELOCITY_M_PER_S] * (1 + self.ground)
        own = np.tile([*size, OFFSET_M_PER_S2], len(self.runs))
        weight = self.typical_error() / own
        first = len(self.names)
        jacobian = np.zeros((own.size, theta.size))
        jacobian[np.arange(own.size), first + np.arange(own.size)] = weight
        return theta[first:] * weight, jacobian

    def typical_error(self) -> float:
        """Level that the errors will come down to, roughly: a hundredth of the airframe's rms."""
        return 0.01 * float(np.sqrt(np.mean([np.sum(np.abs(r.sprung) ** 2) / r.n_samples for r in self.runs])))

    def result(self, solution: object) -> ModelFit:
        theta = solution.x  # type: ignore[attr-defined]
        _, jacobian, errors, responses = self.evaluate(theta)
        n_shared, n_law = len(self.names), self.law.vector.size
        n_data = sum(2 * e.size for e in errors)
        cost = float(sum(np.sum(np.abs(e) ** 2) for e in errors))
        variance = cost / max(n_data - theta.size, 1)
        scale = np.maximum(np.sqrt(np.sum(jacobian**2, axis=0)), 1e-300)
        inverse = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale), rcond=1e-13, hermitian=True)
        covariance = variance * (inverse / np.outer(scale, scale))[:n_shared, :n_shared]
        value, slope = theta[:n_shared].copy(), np.ones(n_shared)
        law, by_free = from_free(self.law, theta[self.n_head : self.n_head + n_law])
        value[self.n_head : self.n_head + n_law] = law.vector
        slope[self.n_head : self.n_head + n_law] = by_free
        frequency_hz = tuple(run.omega / (2 * np.pi) for run in self.runs)
        return ModelFit(
            names=self.names,
            value=value,
            covariance=covariance * np.outer(slope, slope),
            law=law,
            frequency_hz=frequency_hz,
            residual=tuple(error / np.sqrt(2) for error in errors),
            noise_m_per_s2=float(np.sqrt(variance)),
            log_likelihood=float(-0.5 * n_data * np.log(cost / n_data)),
            n_data=n_data,
            n_evaluations=int(solution.nfev),  # type: ignore[attr-defined]
            band_hz=(float(frequency_hz[0][0]), float(frequency_hz[0][-1])),
            responses=tuple(responses),
            start=theta[n_shared:].copy(),
        )


class _Remembered:
    """The optimiser asks for errors and Jacobian at one place in two calls: simulate once."""

    def __init__(self, model: _Model) -> None:
        self._model = model
        self._theta: FloatArray | None = None
        self._answer: tuple[FloatArray, FloatArray] | None = None

    def _at(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self._theta is None or self._answer is None or not np.array_equal(theta, self._theta):
            try:
                self._answer = self._model.evaluate(theta)[:2]
            except UnboundedResponseError:
                if self._answer is None:
                    raise
                # a step too far: worse than anything, so that the optimiser shortens it
                self._answer = (np.full_like(self._answer[0], self._model.typical_error() * 1e3), self._answer[1])
            self._theta = theta.copy()
        return self._answer

    def residual(self, theta: FloatArray) -> FloatArray:
        return self._at(theta)[0]

    def jacobian(self, theta: FloatArray) -> FloatArray:
        return self._at(theta)[1]


def _whitening(run: DrivenRun, interface: Interface, share: float, response: DrivenResponse) -> FloatArray:
    """One over the standard deviation of each line for unit noise on both sensors."""
    by_z, by_v = (float(np.mean(g)) for g in interface.law.gradient(response.travel, response.velocity))
    spring = share * (interface.stiffness + by_z + 1j * run.omega * (interface.damping + by_v))
    ratio = spring / (spring + share * interface.ground_stiffness - run.omega**2)
    return 1.0 / np.sqrt(1.0 + np.abs(ratio) ** 2)
