"""One run as the model takes it: the drive, what is to be predicted, and how either moves with the sensors' faults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import integrate, interpolate

from opid.errors import InputError
from opid.mechanics.driven import half_steps
from opid.signals.recording import FloatArray
from opid.signals.spectra import ComplexArray
from opid.suspensions.band_lines import BAND_HZ, at_lines, band_lines, places_of
from opid.suspensions.sensor_facts import IDEAL, SensorPair


@dataclass(frozen=True, eq=False)
class DrivenRun:
    """One run, ready for the model.

    Args:
        unsprung: (n,) spindle acceleration x1'', mean removed, m/s^2.
        sprung: (n,) airframe acceleration x2'', mean removed, m/s^2.
        leaks: (n, n_leaks) further axes that leak in, mean removed, m/s^2.
        omega: (n_lines,) lines of the residual that count, rad/s.
        fs: sampling rate, Hz.
        mass_change_kg: sprung mass of this run minus that of the reference, kg.
        sensors: what is known of the sensors.
        finer: how many times finer than recorded the run is sampled, so that a step of the model is short enough.
    """

    unsprung: FloatArray
    sprung: FloatArray
    leaks: FloatArray
    omega: FloatArray
    fs: float
    mass_change_kg: float
    sensors: SensorPair = field(default_factory=SensorPair)
    finer: int = 1

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.sprung.size

    @property
    def lines(self) -> slice:
        """Places of the lines of the band among all lines of the transform."""
        return places_of(self.omega, self.n_samples, self.fs)

    def transform(self, samples: FloatArray) -> ComplexArray:
        """Fourier lines along the last axis, scaled so that unit white noise has unit parts."""
        return at_lines(samples, self.omega, self.fs)

    def drive(self, nuisance: Mapping[str, float]) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Return the true spindle acceleration at half steps, (2 n - 1,) m/s^2, and its derivatives by name.

        The leak is taken out, the AC coupling undone (u + 2 pi f_c integral of u), the gain divided out.

        Args:
            nuisance: values of the sensors' faults by name, see `SensorPair.nuisances`.
        """
        return self._corrected("unsprung", self._drive, nuisance)

    def measured(self, nuisance: Mapping[str, float]) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Return the airframe acceleration, (n,) m/s^2, and its derivatives by name, likewise.

        Args:
            nuisance: values of the sensors' faults by name.
        """
        lag = nuisance.get("lag_s")
        if lag is None:
            return self._corrected("sprung", self._answer, nuisance)
        time = np.clip(self._time + lag, 0.0, self._time[-1])
        answer = dict(zip(self._answer, self._spline(time).T, strict=True)) if lag else self._answer
        value, by = self._corrected("sprung", answer, nuisance)
        slope = dict(zip(self._answer, self._spline(time, 1).T, strict=True))
        by["lag_s"], _ = self._corrected("sprung", slope, nuisance)
        return value, by

    @cached_property
    def _drive(self) -> dict[str, FloatArray]:
        return {name: half_steps(samples) for name, samples in self._parts("unsprung").items()}

    @cached_property
    def _answer(self) -> dict[str, FloatArray]:
        return self._parts("sprung")

    @cached_property
    def _time(self) -> FloatArray:
        return np.arange(self.n_samples) / self.fs

    @cached_property
    def _spline(self) -> interpolate.BSpline:
        """Of all parts of the answer, a column each."""
        return interpolate.make_interp_spline(self._time, np.stack([*self._answer.values()], axis=1), k=5)

    def _parts(self, side: str) -> dict[str, FloatArray]:
        """The signal of a side and of what leaks into it, and their integrals where the sensor is AC coupled."""
        parts = {"signal": self.unsprung if side == "unsprung" else self.sprung}
        for place, leak in enumerate(self.sensors.leaks):
            if leak.into == side:
                parts[f"leak[{place}]"] = self.leaks[:, place]
        if getattr(self.sensors, side).corner_hz:
            integral = {
                f"integral of {name}": integrate.cumulative_trapezoid(part, dx=1 / self.fs, initial=0.0)
                for name, part in parts.items()
            }
            parts |= {name: part - part.mean() for name, part in integral.items()}
        return parts

    def _corrected(
        self, side: str, parts: Mapping[str, FloatArray], nuisance: Mapping[str, float]
    ) -> tuple[FloatArray, dict[str, FloatArray]]:
        facts = getattr(self.sensors, side)
        gain = nuisance.get(f"gain_{side}", 1.0)
        omega_c = 2 * np.pi * nuisance.get(f"corner_{side}_hz", facts.corner_hz)

        def undone(name: str) -> FloatArray:
            whole = parts[name]
            return whole + omega_c * parts[f"integral of {name}"] if omega_c else whole

        leaks = [name for name in parts if name.startswith("leak")]
        value, by = undone("signal") / gain, {}
        for name in leaks:
            by[name] = -undone(name) / gain
            value = value + nuisance[name] * by[name]
        if f"gain_{side}" in nuisance:
            by[f"gain_{side}"] = -value / gain
        if f"corner_{side}_hz" in nuisance:
            slope = parts["integral of signal"] - sum(nuisance[name] * parts[f"integral of {name}"] for name in leaks)
            by[f"corner_{side}_hz"] = 2 * np.pi * slope / gain
        return value, by


def driven_run(
    unsprung: ArrayLike,
    sprung: ArrayLike,
    *,
    fs: float,
    band_hz: tuple[float, float] = BAND_HZ,
    mass_change_kg: float = 0.0,
    sensors: SensorPair | None = None,
    leaks: ArrayLike | None = None,
) -> DrivenRun:
    """Prepare one run for the model.

    Only the residual is restricted to the band. The drive keeps its slow motion: a nonlinear law needs it.

    Args:
        unsprung: (n,) acceleration x1'', m/s^2.
        sprung: (n,) acceleration x2'', m/s^2.
        fs: sampling rate, Hz.
        band_hz: lowest and highest line to compare, Hz; cut at 0.4 fs.
        mass_change_kg: sprung mass of this run minus that of the reference, kg.
        sensors: what is known of the sensors; ideal ones where left out.
        leaks: (n, n_leaks) the further axes of `sensors.leaks`, m/s^2.

    Raises:
        InputError: arrays of different lengths, or a band that is none or has fewer than 20 lines.
    """
    sensors = sensors or SensorPair(IDEAL, IDEAL)
    lower, upper = np.asarray(unsprung, dtype=np.float64), np.asarray(sprung, dtype=np.float64)
    if lower.shape != upper.shape or lower.ndim != 1:
        raise InputError(f"unsprung has shape {lower.shape} and sprung {upper.shape}: give runs of one length")
    across = np.empty((lower.size, 0)) if leaks is None else np.asarray(leaks, dtype=np.float64)
    if across.shape != (lower.size, len(sensors.leaks)):
        needed = (lower.size, len(sensors.leaks))
        raise InputError(f"leaks has shape {across.shape} where {needed} is needed: give one column for each leak")
    lines = band_lines(lower.size, fs=fs, band_hz=band_hz)
    return DrivenRun(
        unsprung=lines.prepared(lower),
        sprung=lines.prepared(upper),
        leaks=lines.prepared(across) if across.size else np.empty((lines.n_samples * lines.finer, 0)),
        omega=lines.omega,
        fs=float(fs) * lines.finer,
        finer=lines.finer,
        mass_change_kg=float(mass_change_kg),
        sensors=sensors,
    )
