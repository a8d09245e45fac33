"""What a report says of predictions of an updating: coverage, every sensor, harmonics, modes without curves, forces."""

from __future__ import annotations

import math
from collections.abc import Iterator

from opid import plots
from opid.estimate import format_number
from opid.report.document import Figure, Row, Table, build_columns
from opid.report.estimates import build_estimate_row, tabulate_estimates
from opid.updating.result import SensorBand, Updating

# titles of the parts of the page that a reader opens
_MOTIONS = "Motion of every sensor"
_HARMONICS = "Higher harmonics of every sensor"


def tabulate_coverage(result: Updating) -> Table:
    """Return the fraction of measured points within the predicted band, with a row a sensor and a column a mode."""
    measured = [band for band in result.prediction if band.is_measured]
    modes = sorted({band.mode for band in measured})
    rows: list[Row] = []
    for sensor in dict.fromkeys(band.sensor for band in measured):
        own = [band for band in measured if band.sensor == sensor]
        # a cell shows all bands of a mode and a sensor
        rows.append(
            (f"sensor {sensor}", *(_join(band.coverage for band in own if band.mode == mode) for mode in modes))
        )
        for words, name in (
            ("its curves left out in turn", "left_out"),
            ("all curves of the mode left out", "mode_left_out"),
        ):
            found = {mode: [getattr(band, name) for band in own if band.mode == mode] for mode in modes}
            if any(value is not None for values in found.values() for value in values):
                rows.append((words, *(_join(value for value in found[mode] if value is not None) for mode in modes)))
    within = result.harmonics_within
    unseen = " No class was fitted to higher harmonics." if within else ""
    for order in sorted({order for _, order in within}):
        cells = (format_fraction(within.get((mode, order), math.nan)) for mode in modes)
        rows.append((f"harmonic {order}, all sensors", *cells))
    gaps = "".join(
        f" The band of mode {band.mode} has no frequency at {band.n_missing} of its {band.amplitude.size} "
        "amplitudes, where most draws of the parameters have no backbone; its figure has a gap there."
        for band in result.prediction
        if band.n_missing
    )
    others = (
        " The last row is the test of the law: the other modes alone give the band, with the errors of the structure "
        "and of the curves that are stated; a wrong law or a larger error shows there."
        if any(band.mode_left_out is not None for band in measured)
        else ""
    )
    return Table(
        build_columns("within the band", *(f"mode {mode}" for mode in modes)),
        tuple(rows),
        note="Fraction of the measured points within the 95 % band of the best class. The class was fitted to these "
        "points: it shows whether the errors are as large as assumed. Curves that are left out in turn, and judged by "
        f"the band that the others give, are new to it: 92 to 98 % is as it should be.{others}{unseen}{gaps}",
    )


def tabulate_motions(result: Updating) -> Table:
    """Return the fraction of measured motions within the predicted bands, with a row a sensor and a column a mode."""
    bands = [band for band in result.prediction if any(math.isfinite(own.coverage) for own in band.sensors)]
    found = {(own.sensor, band.mode): own for band in bands for own in band.sensors if math.isfinite(own.coverage)}
    modes = [band.mode for band in bands]
    rows = [
        (f"sensor {sensor}", *(_format_sensor(found.get((sensor, mode))) for mode in modes))
        for sensor in dict.fromkeys(sensor for sensor, _ in found)
    ]
    return Table(
        build_columns("motion within its band", *(f"mode {mode}" for mode in modes)),
        tuple(rows),
        note="Fraction of the measured motions of each sensor, at the amplitudes of the controlled one, within the "
        "95 % band that the other curves give, each curve left out in turn; in brackets within that of all curves.",
        fold=_MOTIONS,
    )


def tabulate_harmonics(result: Updating) -> Table:
    """Return the fraction of points of higher harmonics within their bands, with a row a sensor and a column a mode."""
    found: dict[tuple[str, int], dict[int, list[float]]] = {}
    for band in result.harmonics:
        found.setdefault((band.sensor, band.order), {}).setdefault(band.mode, []).append(band.coverage)
    modes = sorted({band.mode for band in result.harmonics})
    return Table(
        build_columns("harmonic within its band", *(f"mode {mode}" for mode in modes)),
        tuple(
            (f"sensor {sensor}, harmonic {order}", *(_join(iter(own.get(mode, ()))) for mode in modes))
            for (sensor, order), own in found.items()
        ),
        note="Fraction of the measured points of each higher harmonic within the 95 % band of the best class. No class "
        "was fitted to them. Errors of the structure are common to all points of a sensor, so that most sensors have "
        "nearly all of their points within the band, and a few have none.",
        fold=_HARMONICS,
    )


def tabulate_unmeasured(result: Updating) -> Table:
    """Return the bands of modes without curves at their smallest and largest amplitude."""
    rows = []
    for band in (each for each in result.prediction if not each.is_measured):
        for at in (0, -1):
            hz = band.frequency_hz[at], band.low_hz[at], band.high_hz[at]
            cells = [f"{each:.3f}" if math.isfinite(each) else "-" for each in hz]
            height = format_number(1e3 * float(band.amplitude[at]), 3)
            rows.append((str(band.mode), band.sensor, height, cells[0], f"{cells[1]} to {cells[2]}"))
    return Table(
        build_columns("predicted mode", "sensor", "amplitude, mm", "frequency, Hz", "95 % band, Hz"),
        tuple(rows),
        "Modes without curves",
        note="No curve of these modes was measured, and none corrects the error of the linear structure there: it is "
        "taken as large as it is stated. Their bands are those of the backbone itself.",
    )


def tabulate_responses(result: Updating) -> Table:
    """Return the resonance of each response to a force: frequency and amplitude with their intervals."""
    rows: list[Row] = []
    for each in result.responses:
        beyond = "; a joint moves farther than in the tests" if each.is_extrapolated else ""
        rows.append((f"{each.words}{beyond}",))
        rows.append(build_estimate_row("resonance", "Hz", each.peak_hz))
        rows.append(build_estimate_row("amplitude there", "m", each.peak_amplitude))
    return tabulate_estimates(
        rows,
        title="Response to a force",
        legend="The largest motion that a shaker with this force makes near the mode, by the best class. The intervals "
        "hold the laws and the damping, the error of the linear structure, and the calibration of the force. Where a "
        "joint moves farther than in the tests, the laws are extrapolated.",
    )


def list_predicted_figures(result: Updating) -> Iterator[Figure]:
    """Yield the figures of the prediction: the backbone of each mode, then the motions, which a reader opens."""
    predicted = sorted({band.mode for band in result.prediction if not band.is_measured})
    for mode in predicted:
        yield Figure(
            f"predicted_mode_{mode}",
            f"Mode {mode}: what the best class predicts without a measured curve",
            "Backbone of a mode that was not measured, with its 95 % band: the uncertainty of the law and the stated "
            "error of the linear structure, at the smallest amplitudes the latter alone."
            + (" Where it breaks off, most draws of the parameters have no backbone." if _has_gap(result, mode) else "")
            if mode == predicted[0]
            else "",
            lambda mode=mode: plots.predicted_backbones(result.prediction, (), mode),  # type: ignore[misc]
        )
    if result.responses:
        yield Figure(
            "forced_responses",
            "Response to a force",
            "Amplitude over the frequency when a shaker moves the structure, by the best class: the median over the "
            "phase, some draws of the parameters, and the resonance with its 95 % intervals. Where a curve turns back "
            "over the frequency, the motion jumps.",
            lambda: plots.forced_responses(result.responses),
        )
    moved = [band for band in result.prediction if band.sensors]
    for number, band in enumerate(moved):
        yield Figure(
            f"motions_mode_{band.mode}",
            f"Mode {band.mode}: motion of every sensor",
            f"Motion of each sensor over that of sensor {band.sensor}, which is controlled, and its 95 % band; below 0 "
            "they move against each other. A line that is not level is a shape that changes with the "
            "amplitude. Points are the measured curves; where there are none, the band is that of the motion itself."
            if number == 0
            else f"Relative to sensor {band.sensor}.",
            lambda band=band: plots.predicted_motions(band, result.measured),  # type: ignore[misc]
            fold=_MOTIONS,
        )


def list_harmonic_figures(result: Updating) -> Iterator[Figure]:
    """Yield a figure for each mode and higher harmonic that was measured, which a reader opens."""
    for number, (mode, order) in enumerate(result.harmonics_within):
        bands = [band for band in result.harmonics if (band.mode, band.order) == (mode, order)]
        yield Figure(
            f"harmonic_{order}_mode_{mode}",
            f"Mode {mode}: harmonic {order} of every sensor",
            "Points are the measured amplitudes at the multiple of the frequency, over that of the controlled sensor; "
            "below 0 the motion is smallest where the controlled sensor is farthest out. The line is the median of "
            "what the best class predicts at these points, to which it was not fitted, and the band holds 95 % of it. "
            "It opens where the harmonic meets another mode. Points that leave it ask for another law, or for that "
            "mode elsewhere."
            if number == 0
            else "",
            lambda bands=bands: plots.higher_harmonics(bands),  # type: ignore[misc]
            fold=_HARMONICS,
        )


def _has_gap(result: Updating, mode: int) -> bool:
    return any(band.n_missing for band in result.prediction if band.mode == mode)


def _join(values: Iterator[float]) -> str:
    return ", ".join(format_fraction(value) for value in values) or "-"


def _format_sensor(own: SensorBand | None) -> str:
    if own is None:
        return "-"
    left_out = "-" if own.left_out is None else format_fraction(own.left_out)
    return f"{left_out} ({format_fraction(own.coverage)})"


def format_fraction(value: float) -> str:
    """Return a fraction in per cent; "-" where it is nan."""
    return f"{100 * value:.0f} %" if math.isfinite(value) else "-"
