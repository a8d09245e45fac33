"""How many measured points lie within the predicted bands, and where a band has no points."""

from __future__ import annotations

import math

import numpy as np

from opid.updating.result import BackboneBand, Updating


def coverage_table(result: Updating) -> list[tuple[str, ...]]:
    """Return the share of measured points within the predicted band, one row a sensor and one column a mode.

    Where several bands are of one mode and sensor, all their shares stand in one cell.

    Args:
        result: the updating.
    """
    modes = sorted({band.mode for band in result.prediction})
    table = [("within the band", *(f"mode {mode}" for mode in modes))]
    for sensor in dict.fromkeys(band.sensor for band in result.prediction):
        own = [band for band in result.prediction if band.sensor == sensor]
        shares = [[_share(band.coverage) for band in own if band.mode == mode] for mode in modes]
        table.append((f"sensor {sensor}", *(", ".join(each) or "-" for each in shares)))
    return table


def coverage_note(result: Updating) -> str:
    """Return what the coverage says and what it does not, and where a band has no points.

    Args:
        result: the updating.
    """
    note = (
        "Share of the measured points within the 95 % band of the best class. The class was fitted to these points: "
        "the share tells whether the errors are as large as assumed, and is no test on new data."
    )
    for band in result.prediction:
        n_missing = missing_points(band)
        if n_missing:
            note += (
                f" The band of mode {band.mode} has no frequency at {n_missing} of its {band.amplitude.size} "
                "amplitudes, where most draws of the parameters have no backbone; its figure has a gap there."
            )
    return note


def missing_points(band: BackboneBand) -> int:
    """Return at how many amplitudes of a band there is no frequency.

    Args:
        band: of one mode.
    """
    return int((~np.isfinite(band.frequency_hz)).sum())


def _share(value: float) -> str:
    return f"{100 * value:.0f} %" if math.isfinite(value) else "-"
