"""Prediction errors of a driven suspension and their derivatives, as functions of one vector.

The spindle's noise drives the model too. Every reading of the airframe therefore corrects the simulated motion by as
much as both noise levels make right (`opid.mechanics.prediction`): the errors that are left are white whatever the
law. The lines of a band of them are compared, so that what the sensors do below and above does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from opid.mechanics.driven import Interface, UnboundedResponseError
from opid.mechanics.laws import LINEAR, Law
from opid.mechanics.prediction import Noise, Prediction, predict
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.law_parameters import free_bounds, from_free
from opid.suspensions.one_gear.driven_run import DrivenRun
from opid.suspensions.sensor_facts import Nuisance, nuisance_values

# a record may begin this many rms motions from rest, one standard deviation
START_RMS = 2.0
# the body itself, above the mean of the ground
START_DISPLACEMENT_M, START_BODY_VELOCITY_M_PER_S = 0.05, 0.3
# offset that is left in an acceleration once its mean is removed; an AC coupling forgets more
OFFSET_M_PER_S2, OFFSET_AC_M_PER_S2 = 0.03, 0.1
# the start of a run is looked for on a grid of this many rms motions: all are predicted for a short while, then the
# best so many of them for longer
START_GRID, START_ROUNDS = np.linspace(-2.5, 2.5, 9), ((0.5, 16), (2.0, 1))
N_OWN = 2
# no fault of a sensor lies farther from what was known of it
FARTHEST_STD = 8.0

_Signal = tuple[FloatArray, dict[str, FloatArray]]
_Corrected = tuple[dict[str, float], _Signal, _Signal]


@dataclass(frozen=True, eq=False)
class Errors:
    """Whitened prediction errors of all runs at one place.

    Args:
        stacked: (n_data + n_priors,) real and imaginary parts of the lines, then the departures from what was known.
        jacobian: (n_data + n_priors, n_unknowns).
        lines: one complex array (n_lines,) a run.
        predictions: of each run.
    """

    stacked: FloatArray
    jacobian: FloatArray
    lines: tuple[ComplexArray, ...]
    predictions: tuple[Prediction, ...]


@dataclass(frozen=True, eq=False)
class Model:
    """Prediction errors and their derivatives as functions of one vector.

    k2, c2, [k3], law (positive entries as logarithms), [1/M2], sensors' faults; then travel and velocity at the start
    of each run.

    Args:
        runs: one `DrivenRun` a run.
        law: says which terms.
        ground: whether the ground spring is free.
        held_inverse_mass: 1/M2 where it is not fitted, 1/kg (0: runs of one mass); None if it is.
        noise: of the spindle's and the airframe's sensor, m/s^2.
        motion_rms: rms travel (m) and velocity (m/s), roughly.
    """

    runs: tuple[DrivenRun, ...]
    law: Law
    ground: bool
    held_inverse_mass: float | None
    noise: tuple[float, float]
    motion_rms: tuple[float, float]

    @cached_property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The sensors' faults that are fitted."""
        return self.runs[0].sensors.nuisances

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the shared parameters."""
        names = ["stiffness_per_mass", "damping_per_mass"] + ["ground_stiffness_per_mass"] * self.ground
        names += [f"law[{i}]" for i in range(self.law.vector.size)] + ["inverse_mass"] * self.mass_free
        return (*names, *(nuisance.name for nuisance in self.nuisances))

    @property
    def mass_free(self) -> bool:
        """Whether 1/M2 is fitted."""
        return self.held_inverse_mass is None

    @property
    def n_head(self) -> int:
        """Parameters before those of the law."""
        return 2 + self.ground

    def bounds(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the vector, infinite but for scales and damping.

        Args:
            damping: start value of C2/M2, 1/s.
        """
        lower = np.full(len(self.names) + N_OWN * len(self.runs), -np.inf)
        upper = -lower
        of_law = slice(self.n_head, self.n_head + self.law.vector.size)
        lower[of_law], upper[of_law] = free_bounds(
            self.law, travel_rms=self.motion_rms[0], velocity_rms=self.motion_rms[1]
        )
        # a driven system that feeds itself has no response to compare
        lower[1] = -max(abs(damping), 1.0)
        for nuisance in self.nuisances:
            place = self.names.index(nuisance.name)
            lower[place] = nuisance.nominal - FARTHEST_STD * nuisance.std
            upper[place] = nuisance.nominal + FARTHEST_STD * nuisance.std
            if nuisance.kind in ("gain", "corner"):
                lower[place] = max(lower[place], 0.2 * nuisance.nominal)
        return lower, upper

    def looked_for_start(self, shared: FloatArray) -> FloatArray:
        """Return travel and velocity, (n_runs, 2), from which the first seconds of each run are predicted best.

        Args:
            shared: the shared part of the vector.
        """
        step = START_GRID[1] - START_GRID[0]
        std = step / 2 * np.array(self.motion_rms)
        z_rms, v_rms = self.motion_rms
        found = []
        for place in range(len(self.runs)):
            cells = [np.array([z * z_rms, v * v_rms]) for z in START_GRID for v in START_GRID]
            corrected = self._corrected(shared, place)
            for seconds, n_kept in START_ROUNDS:
                costs = [self._start_cost(shared, place, corrected, cell, std, seconds) for cell in cells]
                cells = [cells[k] for k in np.argsort(costs, kind="stable")[:n_kept]]
            found.append(cells[0])
        return np.array(found)

    def _start_cost(
        self, shared: FloatArray, place: int, corrected: _Corrected, cell: FloatArray, std: FloatArray, seconds: float
    ) -> float:
        n = min(self.runs[place].n_samples, round(seconds * self.runs[place].fs))
        try:
            begun = self._predict(shared, place, corrected, cell, start_std=std, n=n, sensitivity=False)[0]
        except UnboundedResponseError:
            return np.inf
        return float(np.sum(begun.innovation**2) + 2 * np.sum(np.log(begun.spread)))

    def _corrected(self, shared: FloatArray, place: int) -> _Corrected:
        """The sensors' faults, and what they leave of the drive and of the readings of one run."""
        nuisance = nuisance_values(self.names, shared, self.runs[place].sensors)
        return nuisance, self.runs[place].drive(nuisance), self.runs[place].measured(nuisance)

    def _predict(
        self,
        shared: FloatArray,
        place: int,
        corrected: _Corrected,
        own: FloatArray,
        *,
        start_std: FloatArray | None = None,
        n: int | None = None,
        sensitivity: bool = True,
    ) -> tuple[Prediction, FloatArray]:
        """Predict one run; also give the derivatives of its innovation by the whole vector, (n_unknowns, n)."""
        run, n_law = self.runs[place], self.law.vector.size
        law, slope = from_free(self.law, shared[self.n_head : self.n_head + n_law]) if n_law else (LINEAR, np.empty(0))
        mu = float(shared[self.n_head + n_law]) if self.held_inverse_mass is None else self.held_inverse_mass
        share = 1.0 / (1.0 + mu * run.mass_change_kg)
        nuisance, (drive, by_drive), (measured, by_measured) = corrected
        n = n or run.n_samples
        start, std = self._start(run, own, start_std)
        prediction = predict(
            [Interface(float(shared[0]), float(shared[1]), float(shared[2]) if self.ground else 0.0, law)],
            [[share]],
            drive[: 2 * n - 1, np.newaxis],
            measured[:n, np.newaxis],
            fs=run.fs,
            noise=self._noise(run, nuisance),
            start=start,
            start_std=std,
            accelerance_directions=[[[1.0]]],
            drive_directions=_columns(by_drive, 2 * n - 1),
            measured_directions=_columns(by_measured, n),
            ground=self.ground,
            sensitivity=sensitivity,
        )
        by = np.zeros((len(self.names) + N_OWN * len(self.runs), n if sensitivity else 0))
        if sensitivity:
            change = prediction.sensitivity[0]
            by[: self.n_head] = change[: self.n_head]
            by[self.n_head : self.n_head + n_law] = change[3 : 3 + n_law] * slope[:, np.newaxis]
            if self.mass_free:
                by[self.n_head + n_law] = change[3 + n_law] * (-(share**2) * run.mass_change_kg)
            for row, name in enumerate([*by_drive, *by_measured], start=4 + n_law):
                by[self.names.index(name)] = change[row]
            first = 4 + n_law + len(by_drive) + len(by_measured)
            by[len(self.names) + N_OWN * place :][:N_OWN] = change[first : first + N_OWN]
            self._add_spread(by, prediction, nuisance, run.finer)
        return prediction, by

    def _add_spread(self, by: FloatArray, prediction: Prediction, nuisance: dict[str, float], finer: int) -> None:
        """Add what a gain does to the innovation by way of its spread: both gains together change nothing."""
        gains = [nuisance.get(f"gain_{side}", 1.0) for side in ("unsprung", "sprung")]
        share = finer * (self.noise[1] / gains[1] / prediction.spread[0]) ** 2
        for side, gain, part in zip(("unsprung", "sprung"), gains, (1 - share, share), strict=True):
            if f"gain_{side}" in nuisance:
                by[self.names.index(f"gain_{side}")] += prediction.innovation[0] * part / gain

    def _start(self, run: DrivenRun, own: FloatArray, start_std: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Start state and its uncertainty: travel and velocity are fitted, the rest is left to the filter."""
        rows, std = [*own], [1e-9, 1e-9] if start_std is None else [*start_std]
        if self.ground:
            rows += [0.0, 0.0]
            std += [START_DISPLACEMENT_M, START_BODY_VELOCITY_M_PER_S]
        for facts in (run.sensors.unsprung, run.sensors.sprung):
            rows.append(0.0)
            std.append(OFFSET_AC_M_PER_S2 if facts.corner_hz else OFFSET_M_PER_S2)
        return np.array(rows)[:, np.newaxis], np.array(std)[:, np.newaxis]

    def _noise(self, run: DrivenRun, nuisance: dict[str, float]) -> Noise:
        """The sensors' noise behind their gains; an AC coupling that was undone adds up its own."""
        levels, walks = [], []
        for side, level in zip(("unsprung", "sprung"), self.noise, strict=True):
            corner_hz = nuisance.get(f"corner_{side}_hz", getattr(run.sensors, side).corner_hz)
            # the noise is that of the reading: a large gain must not make the errors look small
            # and white noise sampled finer has the same density only at a higher level
            levels.append(level * float(np.sqrt(run.finer)) / nuisance.get(f"gain_{side}", 1.0))
            walks.append(2 * np.pi * corner_hz / run.fs * levels[-1])
        return Noise(*levels, *walks)

    def evaluate(self, theta: FloatArray, *, sensitivity: bool = True) -> Errors:
        """Return errors, Jacobian and predictions at a vector.

        Args:
            theta: the vector.
            sensitivity: whether the Jacobian is wanted; it is empty otherwise.
        """
        n_shared = len(self.names)
        lines, blocks, predictions = [], [], []
        for place, run in enumerate(self.runs):
            own = theta[n_shared + N_OWN * place :][:N_OWN]
            corrected = self._corrected(theta[:n_shared], place)
            prediction, by = self._predict(theta[:n_shared], place, corrected, own, sensitivity=sensitivity)
            lines.append(run.transform(prediction.innovation[0]))
            predictions.append(prediction)
            if sensitivity:
                blocks.append(run.transform(by).T)
        departure, by_prior = self._known_before(theta)
        stacked = np.concatenate([part for e in lines for part in (e.real, e.imag)] + [departure])
        jacobian = np.concatenate([part for b in blocks for part in (b.real, b.imag)] + [by_prior])
        return Errors(stacked, jacobian, tuple(lines), tuple(predictions))

    def _known_before(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What was known before the data: the sensors' tolerances, and roughly how a run begins."""
        nominal = [nuisance.nominal for nuisance in self.nuisances] + [0.0] * (N_OWN * len(self.runs))
        std = [nuisance.std for nuisance in self.nuisances]
        std += [START_RMS * rms for rms in self.motion_rms] * len(self.runs)
        first = theta.size - len(std)
        jacobian = np.zeros((len(std), theta.size))
        jacobian[np.arange(len(std)), first + np.arange(len(std))] = 1 / np.array(std)
        return (theta[first:] - nominal) / np.array(std), jacobian

    def log_likelihood(self, errors: Errors, theta: FloatArray) -> float:
        """Logarithm of the likelihood of the lines, with the noise level at its estimate, up to a constant.

        The spread of a line is that of both noises, the spindle's passed through the transmissibility T with the
        mean slopes of the law: s2^2 + |T|^2 s1^2.

        Args:
            errors: at a vector.
            theta: the vector.
        """
        n_data = 2 * sum(line.size for line in errors.lines)
        cost = sum(float(np.sum(np.abs(line) ** 2)) for line in errors.lines)
        n_law = self.law.vector.size
        law = from_free(self.law, theta[self.n_head : self.n_head + n_law])[0] if n_law else LINEAR
        mu = float(theta[self.n_head + n_law]) if self.held_inverse_mass is None else self.held_inverse_mass
        spread = 0.0
        for run, prediction in zip(self.runs, errors.predictions, strict=True):
            by_z, by_v = (float(np.mean(slope)) for slope in law.gradient(prediction.travel, prediction.velocity))
            share, omega = 1.0 / (1.0 + mu * run.mass_change_kg), run.omega
            spring = share * (theta[0] + by_z + 1j * omega * (theta[1] + by_v))
            ratio = spring / (spring + share * (theta[2] if self.ground else 0.0) - omega**2)
            gains = nuisance_values(self.names, theta[: len(self.names)], run.sensors)
            # of the airframe's reading: the spindle's noise comes by way of both gains
            through = gains.get("gain_sprung", 1.0) / gains.get("gain_unsprung", 1.0) * np.abs(ratio)
            spread += float(np.sum(np.log(self.noise[1] ** 2 + through**2 * self.noise[0] ** 2)))
        return -0.5 * n_data * float(np.log(cost / n_data)) - spread


def _columns(by: dict[str, FloatArray], n: int) -> FloatArray | None:
    return np.stack([each[:n] for each in by.values()], axis=1)[:, :, np.newaxis] if by else None
