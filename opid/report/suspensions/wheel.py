"""The report of wheel, tyre and road of a gear."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from opid.estimate import Estimate, format_number, rounded, with_std
from opid.report.document import Document, Figure, Paragraph, Row, Table, build_columns, build_warnings, format_count
from opid.suspensions.wheel.result import WheelIdentification

_NAMES = {
    "unsprung_mass_kg": "unsprung mass M1",
    "tyre_stiffness_n_per_m": "tyre stiffness K1",
    "tyre_damping_n_s_per_m": "tyre damping C1",
    "hop_frequency_hz": "wheel hop, frequency",
    "hop_damping_ratio": "wheel hop, damping ratio",
    "footprint_m": "footprint of the tyre",
    "road_slope": "slope of the road",
}
_LEGEND = (
    "The wheel hops between tyre and strut, with the mean slopes of the law of the strut. The road's displacement "
    "spectrum is Gd(n0) (n/n0)^-slope at n cycles/m, n0 = 0.1, averaged over the footprint; ISO 8608 has slope 2."
)


def build_document(result: WheelIdentification) -> Document:
    """Return the report of wheel, tyre and road: their numbers, the road of each run, checks and warnings."""
    found, units = result.parameters, result.units
    mass, tyre = found.unsprung_mass_kg, found.tyre_stiffness_n_per_m
    blocks = (
        Table(
            build_columns("quantity", "value", "95 % interval", "unit", left=(0, 3)),
            tuple((_NAMES[name], *_write_cells(each), units[name]) for name, each in found.items()),
            note="± is one standard deviation.",
            legend=_LEGEND,
        ),
        Table(
            build_columns("run", "speed [m/s]", "roughness Gd(n0) [m^3]", "ISO 8608", left=(0, 3)),
            tuple(_list_roads(result)),
            title="Road",
        ),
        build_warnings(result.warnings),
        Paragraph(" ".join(_say_quality(result))),
    )
    return Document(
        result.title or "Wheel, tyre and road",
        "wheel, tyre and road",
        f"The unsprung mass is {with_std(mass.value, mass.std)} {units['unsprung_mass_kg']}, and the tyre has "
        f"{with_std(tyre.value, tyre.std)} {units['tyre_stiffness_n_per_m']}.",
        result.not_determined,
        () if result.not_determined else blocks,
        lambda: () if result.not_determined else _list_figures(result),
        source="study",
    )


def _write_cells(estimate: Estimate) -> tuple[str, str]:
    ends, std = estimate.interval95, estimate.std
    between = "-" if ends is None else f"{rounded(ends[0], std)} .. {rounded(ends[1], std)}"
    return with_std(estimate.value, std), between


def _list_roads(result: WheelIdentification) -> Iterator[Row]:
    for road in result.roads:
        first, _, last = (format_number(each, 3) for each in road.speed_m_per_s)
        speed = first if first == last else f"{first} to {last}"
        yield road.run, speed, with_std(road.roughness_m3.value, road.roughness_m3.std), road.road_class


def _say_quality(result: WheelIdentification) -> Iterator[str]:
    yield (
        f"{format_count(result.n_lines, 'line')} of all blocks were compared. The least probable part of their spectra "
        f"has a probability of {format_number(result.unusual, 2)}, multiplied by the number of parts."
    )
    if result.bounds is not None:
        mass, stiffness, damping = (format_number(100 * each, 2) for each in result.bounds)
        yield (
            "On a random road these runs tell M1, K1 and C1 no better than to standard deviations of "
            f"{mass}, {stiffness} and {damping} % if the strut is linear (Cramer and Rao)."
        )
    changes = (
        (result.stiffer_by_load, "by the change of load"),
        (result.stiffer_by_force, "at the rms of its force"),
    )
    told = [
        f"{with_std(100 * each.value, 100 * each.std)} % {words}"
        for each, words in changes
        if each.value is not None and each.std is not None
    ]
    if told:
        yield f"The tyre becomes stiffer by {', '.join(told)}."


def _list_figures(result: WheelIdentification) -> Iterable[Figure]:
    from opid import plots

    yield Figure(
        "force_spectra",
        "Force through the tyre",
        "Spectrum of the rate of the force through the tyre, which is that of both masses together, and of the "
        "fitted road under the fitted tyre. The band holds 95 % of the lines if the fit is right.",
        lambda: plots.force_spectra(result),
    )
