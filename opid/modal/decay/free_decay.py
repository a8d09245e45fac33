"""Free decays: frequency and damping over amplitude, and the law of the mode, from one signal and no force."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError, NotDeterminedError, nearest, require_fraction
from opid.estimate import Estimate, format_percent
from opid.json_values import plain
from opid.mechanics.laws.law import Law
from opid.modal.decay.close_line import CloseLine
from opid.modal.decay.fit import find_backbone, find_line_beside, fit_decays
from opid.modal.decay.law import CloseModesError, DecayLaw
from opid.modal.decay.slow_flow import CloseModes, find_joint_fall
from opid.modal.decay.stretch import (
    ActingForce,
    Beginning,
    Stretch,
    find_free_part,
    find_hum,
    find_mains,
    find_stretch,
)
from opid.modal.decay.track import Track, track_decay, widen_by_hum
from opid.modal.forced.mode_tests import ShapeCheck, check_shapes
from opid.modal.linear.modes import ModalTest
from opid.modal.power_laws import coefficient_rows, coefficients_json
from opid.modal.settings import MODAL
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray

SCHEMA = "opid.decay/1"
Quantity = Literal["displacement", "velocity", "acceleration"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
"""The index of each is the number of its derivative of the displacement."""
UNITS = ("m", "m/s", "m/s^2")
Length = Literal["m", "rad", "strain"]
LENGTHS: tuple[Length, ...] = get_args(Length)
"""Units that take the place of "m" in `UNITS`: an angle or a strain is as good as a length."""


@dataclass(frozen=True, eq=False, repr=False)
class Decay(Result):
    """Frequency, damping and law of a mode from one free decay.

    Args:
        name: the name of the record.
        mode: number of the mode, from 1; None for a raw channel.
        amplitude: (n,) displacement amplitude, largest first, in `amplitude_unit`.
        frequency_hz: (n,) natural frequency at these amplitudes, Hz.
        frequency_std_hz: (n,) standard deviation of the frequency, Hz.
        damping_ratio: (n,) damping ratio c / (2 omega) at these amplitudes.
        damping_std: (n,) standard deviation of the damping ratio.
        amplitude_unit: "m kg^1/2" in modal coordinates, "m", "rad" or "strain" for a raw channel.
        start_s: start of the decay that was used, s from the first sample.
        stop_s: end of the decay that was used, s from the first sample.
        time_s: (m,) times of the points that are plotted, s.
        signal: (m,) the record as given, in `signal_unit`.
        envelope: (m,) amplitude of the fundamental in the same unit; nan outside the stretch that was used.
        signal_unit: "m/s^2 kg^1/2" in modal coordinates, else "m", "m/s", "m/s^2", or the same of "rad" or "strain".
        law: restoring force of the powers 2 and up, per unit mass (modal force in modal coordinates); None if no law
            was found.
        stiffness: k_n by its power n, where 1 is k0, per unit mass.
        damping: c_n by its power n, where 1 is c0, per unit mass.
        frequency_low_hz: natural frequency in the limit of zero amplitude, Hz.
        damping_low: damping ratio in that limit.
        residual_fraction: rms of the residual over that of the record.
        law_misfit: rms error of amplitude and phase by the law over its standard deviation; nan without a law.
        track: amplitude and phase as they were measured, for a law of several decays (`law_of_decays`).
        derivative: 2 where the signal is an acceleration, 1 where it is a velocity, 0 where it is a displacement.
        fitted: the law with its friction and joint, and its curves; of all repeats where there are several.
        warnings: one sentence for each warning about the result.
        beginning: where the decay begins: "given", or found after an "impact", after a steady motion that something
            drove ("drive"), or after the end of a measured "force".
        repeats: the single decays, where several were pooled; the curves over amplitude are those of the largest.
        settings: the options of `opid decay` by their names, and `log`; empty if another program made the result.
        files: the files that the record was read from.
        gain_std: standard deviation of the gain of all amplitudes, as a fraction, which is in the intervals: by the
            calibration of the sensors and by the motion that the shapes do not explain.
    """

    name: str
    mode: int | None
    amplitude: FloatArray
    frequency_hz: FloatArray
    frequency_std_hz: FloatArray
    damping_ratio: FloatArray
    damping_std: FloatArray
    amplitude_unit: str
    start_s: float
    stop_s: float
    time_s: FloatArray
    signal: FloatArray
    envelope: FloatArray
    signal_unit: str
    law: Law | None
    stiffness: Mapping[int, Estimate]
    damping: Mapping[int, Estimate]
    frequency_low_hz: Estimate
    damping_low: Estimate
    residual_fraction: float
    law_misfit: float
    track: Track
    derivative: int
    fitted: DecayLaw | None
    warnings: tuple[str, ...]
    beginning: Beginning = "impact"
    repeats: tuple[Decay, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    files: tuple[ReadFile, ...] = ()
    gain_std: float = 0.0

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return frequency and damping at the largest and at zero amplitude, and the coefficients of the law."""
        return (
            SummaryRow.of("frequency_hz", Estimate.normal(self.frequency_hz[0], self.frequency_std_hz[0]), "Hz"),
            SummaryRow.of("damping_ratio", Estimate.normal(self.damping_ratio[0], self.damping_std[0]), "1"),
            SummaryRow.of("frequency_low_hz", self.frequency_low_hz, "Hz"),
            SummaryRow.of("damping_low", self.damping_low, "1"),
            *coefficient_rows(self.stiffness, self.damping, length=self.length),
            *(SummaryRow.of(name, estimate, unit) for name, estimate, unit in self.list_joint()),
        )

    @property
    def length(self) -> str:
        """Unit of the displacement of a sensor, "m", "rad" or "strain"; "" in modal coordinates."""
        return self.amplitude_unit if self.mode is None else ""

    def list_joint(self) -> list[tuple[str, Estimate, str]]:
        """Return name, estimate and unit of the friction and of the joint with memory that were found."""
        if self.fitted is None:
            return []
        force = f"{self.length}/s^2" if self.mode is None else "N/kg^1/2"
        return list(self.fitted.joint_estimates.list_values(force, self.amplitude_unit))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, which docs/schemas/decay-1.schema.json describes."""
        return plain({"schema": SCHEMA, **self.fields_json(), "settings": self.settings})

    def fields_json(self) -> dict[str, Any]:
        """Return the fields without the record; `k` and `c` by power, 1 is k0 and c0."""
        names = (
            *("name", "mode", "amplitude", "amplitude_unit", "frequency_hz", "frequency_std_hz", "damping_ratio"),
            *("damping_std", "gain_std", "start_s", "stop_s", "beginning", "law_misfit", "warnings"),
        )
        return {
            **{name: getattr(self, name) for name in names},
            "residual_share": self.residual_fraction,
            "frequency_low_hz": asdict(self.frequency_low_hz),
            "damping_low": asdict(self.damping_low),
            **coefficients_json(self.stiffness, self.damping, length=self.length),
            "joint": None if self.fitted is None else self.fitted.joint_json(),
            "repeats": [each.fields_json() for each in self.repeats],
        }

    def _write_headline(self) -> str:
        return f"{self.name!r} from {self.start_s:.4g} to {self.stop_s:.4g} s, amplitudes in {self.amplitude_unit}"


def decay_of(
    test: ModalTest,
    mode: int,
    *,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    friction: bool | None = None,
    memory: bool | str | None = None,
    gain_tolerance: float = MODAL.gain_tolerance,
) -> Decay:
    """Return the free decay of one mode of a test, in modal coordinates, as `free_decay` does of a signal.

    Args:
        test: the test; the decay begins after the end of the forces that its recording holds, channels in N.
        mode: number of the mode, from 1; it is searched near its linear frequency.
        stiffness_order: order of the stiffness; it and `damping_order`, `start_s`, `stop_s`, `friction`, `memory` are
            those of `free_decay`.
        gain_tolerance: standard deviation of the gains of the sensors by their calibration, as a fraction.

    Raises:
        InputError: no such mode, a rigid-body mode, a motion that no sum of the shapes can make, or what `free_decay`
            refuses.
        NotDeterminedError: what `free_decay` cannot determine.
    """
    frequency = float(test.modes.frequency_hz[test.modes.index(mode)])
    if not frequency > 0.0:
        raise InputError(f"mode {mode} is a rigid-body mode (0 Hz): it does not ring; name an elastic mode")
    check = check_shapes(test, mode, (0.8 * frequency, 1.2 * frequency), gain_tolerance=gain_tolerance)
    if check.faults:
        raise InputError("; ".join(check.faults))
    forces = [test.recording.channel(each.name) for each in test.recording.channels if each.unit == "N"]
    found = free_decay(
        test.modal_acceleration(mode),
        fs=test.fs,
        near_hz=frequency,
        force=np.stack(forces, axis=1) if forces else None,
        stiffness_order=stiffness_order,
        damping_order=damping_order,
        start_s=start_s,
        stop_s=stop_s,
        friction=friction,
        memory=memory,
        name=test.name,
        mode=mode,
        gain_tolerance=check.gain_std,
    )
    return replace(found, warnings=(*found.warnings, *_warn_of_shapes(check, test.name)))


def _warn_of_shapes(check: ShapeCheck, name: str) -> Iterator[str]:
    yield from check.warnings
    if check.is_gain_doubtful:
        yield (
            f"{format_percent(check.outside, 2)} of the motion of test {name!r} outside the shapes leaves the "
            f"amplitude of the mode uncertain by {format_percent(check.gain_std, 2)} (standard deviation): the "
            "intervals of the coefficients above the power 1, and of friction and slip, allow for it"
        )


def free_decay(
    samples: ArrayLike,
    *,
    fs: float,
    quantity: Quantity = "acceleration",
    near_hz: float | None = None,
    band_hz: tuple[float, float] | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    force: ArrayLike | None = None,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    friction: bool | None = None,
    memory: bool | str | None = None,
    length: Length = "m",
    name: str = "decay",
    mode: int | None = None,
    gain_tolerance: float = MODAL.gain_tolerance,
) -> Decay:
    """Return frequency and damping over amplitude of a free decay, and the law of the mode, from one signal.

    The largest impact of the record, or the steady motion that something drives before the decay, is found and left
    out; the decay after it is followed until it reaches the noise or the next impact. Amplitudes are those of
    displacement, whichever quantity was measured.

    Args:
        samples: (n,) the signal, in SI units.
        fs: sampling rate, Hz.
        quantity: "acceleration", "velocity" or "displacement".
        length: unit of the displacement: "m", "rad" for an angle, or "strain" for a strain gauge.
        near_hz: frequency of the mode, within a tenth, Hz; where None, the strongest mode that decays is taken.
        band_hz: band of the mode, Hz, instead of `near_hz`.
        start_s: start of the free decay, s from the first sample; found where None.
        stop_s: end of the free decay, s from the first sample; found where None.
        force: (n,) force that was measured with the signal, or (n, m) several: the decay begins after their end.
        stiffness_order: N_s of k_n q|q|^(n-1), n = 2 .. N_s, 1 for a linear spring; where None, the Bayesian criterion
            chooses it.
        damping_order: N_d of c_n q'|q'|^(n-1), 1 for linear damping; where None, the Bayesian criterion chooses it.
        friction: whether there is dry friction F sgn(q'); where None, the criterion chooses, if it chooses the orders.
        memory: whether there is an Iwan joint that slips, likewise; or the name of a kind of joint, which the law then
            has: "iwan_friction", of which a slider with a spring is a limit, "dahl_friction", or "bouc_wen" of the
            shape 1/2. Powers and friction then stand beside it only if they are asked for. Where this, both orders and
            `friction` are None, such joints are tried if the other laws miss the decay beyond its noise; one that
            explains it is taken.
        name: the name of the record.
        mode: number of the mode, if the signal is a modal coordinate.
        gain_tolerance: standard deviation of the gain of the signal by its calibration, as a fraction, by which all
            intervals that depend on the amplitude become wider; 0 for an exact one.

    Raises:
        InputError: samples that are no series of finite numbers, an unknown quantity, a band or times out of range.
        NotDeterminedError: no decay that stands out of the noise, or one of fewer than ten cycles.

    >>> t = np.arange(4096) / 1024.0
    >>> decay = free_decay(np.exp(-1.5 * t) * np.cos(2 * np.pi * 40.0 * t), fs=1024.0)
    >>> round(decay.frequency_low_hz.value, 2), round(decay.damping_low.value, 4)
    (40.0, 0.006)
    """
    require_fraction("gain_tolerance", gain_tolerance)
    series = _read_series(samples, fs, quantity)
    derivative = QUANTITIES.index(quantity)
    acting = None if force is None else find_free_part(series, force, fs=fs)
    limits = _Limits(near_hz, band_hz, start_s, stop_s)
    track, beginning, early = _follow_free(series, fs, limits, acting)
    orders: dict[str, Any] = {"stiffness_order": stiffness_order, "damping_order": damping_order}
    choices = {**orders, "friction": friction, "memory": memory}
    law, of_law, close = _find_law(track, derivative, choices, gain_tolerance)
    if close is None:
        line = find_line_beside(track, law, derivative=derivative, **orders)
        if line is not None:
            track = line.subtract(track)
            law, of_law, close = _find_law(track, derivative, choices, gain_tolerance)
            early = [*early, _tell_line(line)]
    amplitude, natural, natural_std, damping, damping_std = _find_curves(track, derivative, law, close, gain_tolerance)
    of_size = _warn_of_size(amplitude, natural) if length == "m" and mode is None else ()
    warnings = [*early, *_warn_of_track(track, amplitude), *of_size, *of_law]
    order = np.argsort(-amplitude)
    time_s, signal, envelope = _thin_for_plot(series, track, fs)
    return Decay(
        name=name,
        mode=mode,
        amplitude=amplitude[order],
        frequency_hz=natural[order] / (2.0 * np.pi),
        frequency_std_hz=natural_std[order] / (2.0 * np.pi),
        damping_ratio=(damping / (2.0 * natural))[order],
        damping_std=(damping_std / (2.0 * natural))[order],
        amplitude_unit=length if mode is None else "m kg^1/2",
        start_s=track.start_s,
        stop_s=track.stop_s,
        time_s=time_s,
        signal=signal,
        envelope=envelope,
        signal_unit=length + UNITS[derivative][1:] + ("" if mode is None else " kg^1/2"),
        law=None if law is None else law.law,
        stiffness={} if law is None else law.stiffness,
        damping={} if law is None else law.damping,
        frequency_low_hz=Estimate() if law is None else law.frequency_low_hz,
        damping_low=Estimate() if law is None else law.damping_low,
        residual_fraction=track.residual_fraction,
        law_misfit=np.nan if law is None else law.misfit,
        track=track,
        derivative=derivative,
        fitted=law,
        warnings=tuple(warnings),
        beginning=beginning,
        gain_std=gain_tolerance,
    )


def law_of_decays(
    decays: Sequence[Decay],
    *,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    memory: bool | str | None = None,
) -> DecayLaw:
    """Return one law for several free decays of the same mode, measured in the same place.

    Args:
        decays: one or several decays.
        stiffness_order: order of the stiffness; it, `damping_order` and `memory` are those of `free_decay`.

    Raises:
        InputError: no decay, or decays of different modes or quantities.
        NotDeterminedError: what `opid.modal.decay.fit.fit_decays` cannot determine.
    """
    if not decays:
        raise InputError("there is no free decay to fit a law to: give at least one")
    if len({(decay.mode, decay.derivative) for decay in decays}) > 1:
        raise InputError("the decays are of different modes or quantities: give those of one mode, measured alike")
    return fit_decays(
        [decay.track for decay in decays],
        derivative=decays[0].derivative,
        stiffness_order=stiffness_order,
        damping_order=damping_order,
        memory=memory,
        gain_std=max(decay.gain_std for decay in decays),
    )


def pool_decays(
    decays: Sequence[Decay],
    *,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    memory: bool | str | None = None,
) -> Decay:
    """Return several decays of one mode as one: the curves of the largest, and the law and its intervals of all.

    Frequency and damping at zero amplitude are means of the repeats, whose scatter is in the intervals.

    Args:
        decays: two or more repeats, measured in the same place.
        stiffness_order: order of the stiffness; it, `damping_order` and `memory` are those of `free_decay`.

    Raises:
        InputError: fewer than two decays, or decays of different modes or quantities.
        NotDeterminedError: what `opid.modal.decay.fit.fit_decays` cannot determine.
    """
    if len(decays) < 2:
        raise InputError(f"{len(decays)} decay was given: give two or more repeats to pool")
    low, high = (f(float(np.median(each.frequency_hz)) for each in decays) for f in (min, max))
    if high > (1.0 + MODAL.searched) * low:
        raise InputError(
            f"the decays ring between {low:.4g} and {high:.4g} Hz, which are different modes: name one with near_hz"
        )
    law = law_of_decays(decays, stiffness_order=stiffness_order, damping_order=damping_order, memory=memory)
    largest = max(decays, key=lambda each: float(each.amplitude[0]))
    warnings = [f"{each.name}: {text}" for each in decays for text in each.warnings]
    return replace(
        largest,
        law=law.law,
        stiffness=law.stiffness,
        damping=law.damping,
        frequency_low_hz=law.frequency_low_hz,
        damping_low=law.damping_low,
        law_misfit=law.misfit,
        fitted=law,
        warnings=(*warnings, *law.warnings),
        repeats=tuple(decays),
        gain_std=max(each.gain_std for each in decays),
    )


def _find_law(
    track: Track, derivative: int, choices: Mapping[str, Any], gain_std: float
) -> tuple[DecayLaw | None, list[str], CloseModes | None]:
    """Return the law of a decay, what to doubt in it, and two close modes that explain the decay as well or better."""
    try:
        law = fit_decays([track], derivative=derivative, **choices, gain_std=gain_std)
    except CloseModesError as why:
        return None, [f"no law: {why}"], why.modes
    except NotDeterminedError as why:
        return None, [f"no law: {why}"], None
    warnings = list(law.warnings)
    if law.misfit > MODAL.most_misfit:
        warnings.append(
            f"the misfit of the law is {law.misfit:.2g} times what noise would leave: the mode follows another kind of "
            "law, use this one only within these amplitudes"
        )
    return law, warnings, law.close_modes


def _find_curves(
    track: Track, derivative: int, law: DecayLaw | None, close: CloseModes | None, gain_std: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return amplitude, natural frequency, its standard deviation, damping and its, as `find_backbone`, (n,) each.

    The standard deviations contain the gain of the amplitude, and what a falling amplitude changes in a joint of the
    law, for steady cycles have other curves. Where no law holds they contain the scatter about a smooth curve, too, and
    where two close modes may make the curves, the distance from their values.
    """
    amplitude, natural, natural_std, damping, damping_std = find_backbone(track, derivative)
    logs = np.log(amplitude)
    logs = logs - logs.mean()
    is_doubtful = law is None or law.misfit > MODAL.most_misfit or _has_beat(track)
    stds = []
    for values, std in ((natural, natural_std), (damping, damping_std)):
        # The slope of a smooth curve is taken, for that from window to window is noise.
        curve = _fit_curve(logs, values, min(2, logs.size - 1), 1.0 / np.maximum(std, 1e-12 * np.abs(values)))
        wider = np.ones(values.size)
        if is_doubtful:
            # The scatter is that of seven windows, as for the noise.
            squares = _measure_swing(amplitude, values, std, 1e-9 * float(np.median(natural))) ** 2
            wider = (
                np.array([max(float(np.mean(squares[max(0, k - 3) : k + 4])), 1.0) for k in range(values.size)]) ** 0.5
            )
        stds.append(np.hypot(wider * std, gain_std * np.polyval(np.polyder(curve), logs)))
    if law is not None:
        fall = 0.5 * damping / natural * find_joint_fall(law.joint.terms, amplitude)
        stds = [np.hypot(stds[0], 0.5 * fall.real / natural), np.hypot(stds[1], fall.imag / natural)]
    if close is not None:
        of_natural, of_rate = close.measure_distance(natural, 0.5 * damping)
        stds = [np.hypot(stds[0], of_natural), np.hypot(stds[1], 2.0 * of_rate)]
    return amplitude, natural, stds[0], damping, stds[1]


def _fit_curve(x: FloatArray, y: FloatArray, degree: int, weight: FloatArray) -> FloatArray:
    """Return the coefficients of a polynomial, the smallest ones where the amplitudes tell too little."""
    columns = np.vander(x, degree + 1) * weight[:, np.newaxis]
    sizes = np.sqrt(np.sum(columns**2, axis=0))
    found = np.linalg.lstsq(columns / sizes, y * weight, rcond=x.size * np.finfo(float).eps)[0]
    return np.asarray(found / sizes, dtype=np.float64)


def _measure_swing(amplitude: FloatArray, values: FloatArray, std: FloatArray, least_std: float) -> FloatArray:
    """Return the departures of values from a smooth curve over the amplitude, in their standard deviations, (n,)."""
    root = np.sqrt(amplitude / amplitude.max())
    degree = min(3, values.size // 3)
    weight = 1.0 / np.maximum(std, least_std)
    departure = values - np.polyval(_fit_curve(root, values, degree, weight), root)
    return departure * weight * np.sqrt(values.size / max(values.size - degree - 1, 1))


def _read_series(samples: ArrayLike, fs: float, quantity: str) -> FloatArray:
    try:
        series = np.asarray(samples, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("the samples are not numbers: give one series of numbers") from None
    if series.ndim != 1 or series.size < 16:
        raise InputError(f"the samples have shape {series.shape}: give one series of 16 or more")
    if not np.isfinite(series).all():
        raise InputError(
            f"{int((~np.isfinite(series)).sum())} samples are not finite: give a stretch without gaps, or fill them"
        )
    if not (np.isfinite(fs) and fs > 0.0):
        raise InputError(f"fs is {fs} Hz: give the sampling rate, a positive number")
    if quantity not in QUANTITIES:
        raise InputError(f"there is no quantity {quantity!r}: {nearest(quantity, QUANTITIES)}")
    if np.ptp(series) == 0.0:
        raise NotDeterminedError("the signal is constant: nothing decays in it")
    largest = float(np.abs(series).max())
    # Outside this range the square of the signal or the logarithm of its envelope would overflow.
    if not 1e-30 < largest < 1e30:
        raise InputError(
            f"the signal reaches {largest:.3g}, which no structure does in SI units: check its unit and scale"
        )
    return series


@dataclass(frozen=True)
class _Limits:
    """The band and the times of a decay as they were given."""

    near_hz: float | None
    band_hz: tuple[float, float] | None
    start_s: float | None
    stop_s: float | None


def _follow_free(
    series: FloatArray, fs: float, limits: _Limits, acting: ActingForce | None
) -> tuple[Track, Beginning, list[str]]:
    """Return the track of the decay after the end of a measured force, where it begins, and warnings of the choice."""

    def follow(free: tuple[int, int] | None) -> tuple[Track, Beginning, list[str]]:
        stretch = find_stretch(series, fs=fs, free=free, **vars(limits))
        hum = find_hum(series, stretch, fs=fs)
        if hum is None:
            track, late = _track_late_if_needed(series, stretch, fs, limits.start_s is None)
            return track, stretch.beginning, [*stretch.warnings, *late, *_warn_of_hidden_hum(stretch, track)]
        clean = series - hum.make_line(series.size, fs)
        stretch = find_stretch(clean, fs=fs, free=free, **vars(limits))
        track, late = _track_late_if_needed(clean, stretch, fs, limits.start_s is None)
        told = (
            f"the end of the record holds a steady line at {hum.frequency_hz:.4g} Hz, where this mode and the mains "
            f"are, of {100.0 * abs(hum.phasor) / track.amplitude.max():.2g} % of the largest amplitude: it was taken "
            "for hum and subtracted; check the cables"
        )
        track = widen_by_hum(track, hum)
        return track, stretch.beginning, [told, *stretch.warnings, *late]

    if acting is None:
        return follow(None)
    try:
        found = follow(acting.free if acting.ends and limits.start_s is None else None)
    except NotDeterminedError:
        if not acting.ends or limits.start_s is not None:
            raise
        found = follow(None)
    track, beginning, warnings = found
    used = slice(round(track.start_s * fs), round(track.stop_s * fs) + 1)
    if acting.acts[used].any():
        until = track.start_s + float(np.flatnonzero(acting.acts[used])[-1]) / fs
        warnings.append(
            f"the measured force is {100 * acting.fraction[used].max():.2g} % of its largest value in the stretch that "
            f"is used, and acts until {until:.4g} s: if it drives the structure, this is no free decay; give start_s "
            "after its end"
        )
    return track, beginning, warnings


def _warn_of_hidden_hum(stretch: Stretch, track: Track) -> Iterator[str]:
    """Yield a sentence where hum in the frequency of a mode would not show, for the record ends within the decay."""
    own, mains = stretch.frequency_hz, find_mains(stretch.frequency_hz)
    last = track.time_s.size - 1
    ends_loud = (
        track.amplitude[last] > MODAL.left_at_end * track.amplitude.max()
        and track.covariance[last, last] < (1.0 / MODAL.loud_end) ** 2
    )
    if abs(mains - own) <= MODAL.hum_width * mains and ends_loud:
        yield (
            f"the mode is at {own:.4g} Hz and the mains are at {mains:g} Hz, and the record ends before the mode has "
            "decayed: hum would not show, and a part of a percent of it looks like friction or powers; record until "
            "the mode is gone"
        )


def _track_late_if_needed(series: FloatArray, stretch: Stretch, fs: float, may_wait: bool) -> tuple[Track, list[str]]:
    """Return the track of a decay; its first quarter is left out where other oscillations disturb it too much."""
    try:
        return track_decay(series, stretch, fs=fs), []
    except NotDeterminedError as first:
        if not may_wait:
            raise
        start = stretch.start + (stretch.sure_stop - stretch.start) // 4
        try:
            track = track_decay(series, replace(stretch, start=start), fs=fs)
        except NotDeterminedError:
            raise first from None
        return track, [
            f"before {start / fs:.4g} s other oscillations disturb the mode too much: that part of the record is left "
            "out"
        ]


def _tell_line(line: CloseLine) -> str:
    return (
        f"a line at {line.frequency_hz:.5g} Hz, {100.0 * line.ratio:.2g} % of the mode at the start and too close to "
        "be separated by a window, explains what a law alone misses: it is another mode, hum, or a force that still "
        "acts; it was subtracted, and its error is in the intervals; separate modes with several sensors (a modal "
        "filter), check the cables, or begin later (start_s)"
    )


def _warn_of_size(amplitude: FloatArray, natural: FloatArray) -> Iterator[str]:
    """Yield a sentence where displacements, m, at angular frequencies are those of no structure."""
    largest = int(np.argmax(amplitude * natural**2))
    acceleration = float(amplitude[largest] * natural[largest] ** 2)
    if acceleration > MODAL.most_acceleration:
        yield (
            f"the motion reaches {amplitude[largest]:.3g} m at {natural[largest] / (2.0 * np.pi):.4g} Hz, an "
            f"acceleration of {acceleration / 9.80665:.2g} g: check the unit of the channel"
        )


def _warn_of_track(track: Track, amplitude: FloatArray) -> Iterator[str]:
    own = float(np.median(track.omega)) / (2.0 * np.pi)
    for frequency in track.unresolved_hz:
        yield (
            f"another mode at {frequency:.4g} Hz is too close to the one of {own:.4g} Hz to be separated in this "
            "record: frequency and damping swing with their beat; separate the modes with several sensors (a modal "
            "filter)"
        )
    yield from _warn_of_lines(track, own)
    if _has_beat(track):
        yield (
            "frequency or amplitude swings as it does when two modes beat: the curves over amplitude are not those of "
            "one mode; separate the modes with several sensors (a modal filter)"
        )
    if track.residual_fraction > MODAL.most_residual:
        yield (
            f"{100 * track.residual_fraction:.0f} % of the record is neither this mode nor a neighbour that was found: "
            "the mode is weak beside noise and other modes; excite it more strongly, or choose another sensor"
        )
    log_std = np.sqrt(np.diag(track.covariance)[: amplitude.size])
    if (np.diff(np.log(amplitude)) > 0.1 + 5.0 * np.maximum(log_std[1:], log_std[:-1])).any():
        yield "the amplitude rises in between: something still drives the mode, or two modes beat; give another stretch"


def _warn_of_lines(track: Track, own: float) -> Iterator[str]:
    """Yield a sentence for each frequency beside the mode that is mains hum, or a partner of the mode."""
    for frequency in track.neighbours_hz:
        mains = [
            (base, round(frequency / base))
            for base in (50.0, 60.0)
            if frequency > 0.9 * base and abs(frequency - base * round(frequency / base)) < MODAL.mains_width * base
        ]
        if mains:
            base, multiple = mains[0]
            yield (
                f"the line at {frequency:.4g} Hz lies at {multiple} x {base:.0f} Hz: it may be mains hum and no mode; "
                "check the cables"
            )
    swept = track.omega / (2.0 * np.pi)
    for frequency in track.neighbours_hz:
        for ratio in (2, 3):
            near = MODAL.partner_width * ratio * own
            if ratio * swept.min() - near < frequency < ratio * swept.max() + near:
                yield (
                    f"a line at {frequency:.4g} Hz lies near {ratio} times the frequency of this mode, {own:.4g} Hz: "
                    "another mode there may exchange energy with this one, and the law of one mode would not hold"
                )


def _has_beat(track: Track) -> bool:
    """Return whether rate or frequency swings about a smooth curve by more than noise, and the rate from the start."""
    if track.time_s.size < 12:
        return False
    least_std = 1e-6 * float(np.abs(np.median(track.omega)))
    swings = any(
        np.sqrt(np.mean(_measure_swing(track.amplitude, values, std, least_std) ** 2)) > MODAL.beating
        for values, std in ((track.rate, track.rate_std), (track.omega, track.omega_std))
    )
    # A beat shows from the start on; noise at low amplitude has little weight here.
    trust = 1.0 / np.maximum(track.rate_std, 1e-2 * float(np.median(np.abs(track.rate)))) ** 2
    mean = float(np.average(track.rate, weights=trust))
    return swings and float(np.average((track.rate - mean) ** 2, weights=trust)) > (1.5 * mean) ** 2


def _thin_for_plot(series: FloatArray, track: Track, fs: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    step = max(1, -(-series.size // 20_000))  # a plot does not need more points
    time = np.arange(0, series.size, step) / fs
    log_amplitude = np.interp(time, track.time_s, np.log(track.amplitude))
    inside = (time >= track.start_s) & (time <= track.stop_s)
    return time, series[::step].copy(), np.where(inside, np.exp(log_amplitude), np.nan)
