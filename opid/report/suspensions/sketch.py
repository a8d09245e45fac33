"""A sketch of one gear with its numbers on it, as the page shows it before any table."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

from opid.estimate import Estimate, with_std
from opid.plots.style import format_law, format_units
from opid.report.document import Sketch
from opid.suspensions.paper.result import AnyIdentification
from opid.suspensions.result import GearParameters, GearRatios

# one line of words stands this far below the other
_LINE_PX = 24
# a ground spring is drawn if it differs from zero by this many standard deviations
_SEEN_STD = 3.0


def build_sketch(result: AnyIdentification) -> Sketch | None:
    """Return the sketch of a gear; None for a body on several suspensions, and where no number is reported."""
    values, ratios = result.parameters, result.ratios
    if result.is_refused or not isinstance(values, GearParameters) or not isinstance(ratios, GearRatios):
        return None
    mass = values.sprung_mass_kg
    if mass.value is None:
        head = "M₂ is not determined"
        numbers = [("K₂/M₂", ratios.stiffness_per_mass, "1/s^2"), ("C₂/M₂", ratios.damping_per_mass, "1/s")]
        ground = ("K₃/M₂", ratios.ground_stiffness_per_mass, "1/s^2")
    else:
        head = f"M₂ = {with_std(mass.value, mass.std)} kg"
        numbers = [
            ("K₂", values.suspension_stiffness_n_per_m, "N/m"),
            ("C₂", values.suspension_damping_n_s_per_m, "N s/m"),
        ]
        ground = ("K₃", values.ground_stiffness_n_per_m, "N/m")
    words = [_format_equation(*each) for each in numbers]
    words.append("law: " + (format_law(result.law.name) if result.law.terms else "none, the suspension is linear"))
    if has_ground := _is_seen(ground[1]):
        words.append(_format_equation(*ground))
    words.append("± one standard deviation")
    alt = "; ".join([head, *words])
    return Sketch("\n".join(_draw_gear(head, words, has_ground=has_ground)), alt)


def _is_seen(estimate: Estimate) -> bool:
    return estimate.value is not None and estimate.std is not None and abs(estimate.value) > _SEEN_STD * estimate.std


def _format_equation(symbol: str, estimate: Estimate, unit: str) -> str:
    if estimate.value is None:
        return f"{symbol} is not determined"
    return f"{symbol} = {with_std(estimate.value, estimate.std)} {format_units(unit)}"


def _draw_gear(head: str, words: list[str], *, has_ground: bool) -> Iterator[str]:
    """Lines of an SVG in the colour of the page's text: mass, spring, damper, spindle, and the words beside them."""
    yield '<svg viewBox="0 0 620 250" fill="none" stroke="currentColor" stroke-width="1.6">'
    yield '<rect x="20" y="24" width="270" height="56" rx="3"/>'
    yield _draw_text(155, 58, head, "middle", weight="bold")
    # below the mass stand the spring, and the damper with the law of the suspension
    zigzag = " ".join(f"{90 + (-1) ** k * 11},{108 + 12 * k}" for k in range(6))
    yield f'<polyline points="90,80 90,98 {zigzag} 90,180 90,198"/>'
    yield '<path d="M220 80V128M202 128H238M202 118V158H238V118M220 158V198"/>'
    yield _draw_text(66, 144, "K₂", "end") + _draw_text(248, 144, "C₂, f", "start")
    yield '<path d="M40 198H270" stroke-width="5"/><circle cx="155" cy="216" r="14"/>'
    yield '<path d="M20 231H290" stroke-dasharray="5 4"/>'
    if has_ground:
        ground = " ".join(f"{306 + (-1) ** k * 8},{94 + 20 * k}" for k in range(6))
        yield f'<polyline points="290,52 306,52 306,80 {ground} 306,206 306,231"/>' + _draw_text(
            318, 200, "K₃", "start"
        )
    for x, y, label in ((40, 24, "ẍ₂"), (255, 198, "ẍ₁")):
        yield f'<rect x="{x - 6}" y="{y - 12}" width="12" height="12" fill="currentColor"/>'
        yield _draw_text(x + 12, y - 3, f"{label} measured", "start", size=12)
    for number, line in enumerate(words):
        yield _draw_text(340, 60 + _LINE_PX * number, line, "start")
    yield "</svg>"


def _draw_text(x: int, y: int, words: str, anchor: str, *, size: int = 15, weight: str = "normal") -> str:
    look = f'text-anchor="{anchor}" font-size="{size}" font-weight="{weight}"'
    return f'<text x="{x}" y="{y}" {look} fill="currentColor" stroke="none">{escape(words)}</text>'
