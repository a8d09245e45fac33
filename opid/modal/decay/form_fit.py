"""One form of the law, fitted to amplitude and phase of decays by its slow flow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.errors import NotDeterminedError
from opid.modal.decay.law_search import LawForm
from opid.modal.decay.repeats import pool_repeats
from opid.modal.decay.scaled_track import ScaledTrack, find_span
from opid.modal.decay.slow_flow import solve_slow_flow
from opid.modal.forced.restoring_fit import sum_lagged_products
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

AT_EDGE = (
    "the best law lies at the edge of those that decay over all amplitudes of the record, where nothing tells how well "
    "its coefficients are known: lower the orders, or give another stretch"
)
IMPOSSIBLE = 1e8  # error of a law that does not vibrate or does not decay over all the record, standard deviations


@dataclass(frozen=True, eq=False)
class FitWithout:
    """Coefficients that were fitted without a stretch of the decays, and the range of logarithms that was left."""

    vector: FloatArray
    log_low: float
    log_high: float


@dataclass(frozen=True, eq=False)
class FormFit:
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
    without: tuple[FitWithout, ...] = ()
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


def fit_form(
    decays: Sequence[ScaledTrack], form: LawForm, guess: FloatArray, *, derivative: int, damping: float
) -> FormFit:
    """Fit a form to some decays, whose k0 and c0 may differ.

    Args:
        decays: the decays, in the units of the fit.
        form: the form.
        guess: (p,) its first coefficients.
        derivative: the derivative of the displacement that was measured.
        damping: rough c0, with which a search begins where the guess does not decay.

    Raises:
        NotDeterminedError: no such law decays over all amplitudes, or the decays do not determine it.
    """
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
    return FormFit(
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
    decay: ScaledTrack, form: LawForm, guess: FloatArray, derivative: int, damping: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficients by amplitude and phase of one decay, (p,), their covariance and the errors, (2n,).

    The covariance is nan where the search ends at the edge of the laws that decay over all amplitudes of the record.
    """
    from scipy.optimize import least_squares

    low, high = find_span([decay])

    def errors(vector: FloatArray) -> FloatArray:
        k, c, joint = form.split(vector)
        flow = solve_slow_flow(k, c, low, high, joint) if form.may_vibrate(vector) else None
        start, shift = vector[form.size :]
        found = None if flow is None else decay.errors(flow, start, shift, derivative)
        return np.full(2 * decay.time.size, IMPOSSIBLE) if found is None else found

    own = np.array([decay.log_amplitude[0], 0.0])
    start = np.concatenate([guess, own])
    has_named_joint = form.memory is not None and not form.memory.is_slip
    for _ in range(MODAL.slower_starts if has_named_joint else 0):
        if np.abs(errors(start)).max() < IMPOSSIBLE:
            break
        # Without its joint the law would end elsewhere: it only decays too fast.
        start[form.stiffness_order] *= 0.7
    if np.abs(errors(start)).max() >= IMPOSSIBLE:
        # The law of the start values does not vibrate or decay, but its linear part alone does.
        start[: form.size] = 0.0
        start[0], start[form.stiffness_order] = 1.0, max(damping, 1e-5)
    scale = np.full(start.size, 0.1)
    scale[: form.stiffness_order] = 1.0
    scale[form.stiffness_order : form.size] = max(abs(damping), 1e-4)
    if form.memory is not None:
        first = form.size - form.n_memory + form.memory.is_slip
        scale[first : form.size] = 0.3 if form.memory.is_slip else 0.1 * np.maximum(start[first : form.size], 1e-3)
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
