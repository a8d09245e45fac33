"""Sketches of what was identified, with the numbers on it, as the page shows them before any table.

Every sketch is drawn from the same parts (mass, spring, damper, bar, words), in the colour of the text around it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from opid.errors import escape_invisible
from opid.estimate import Estimate, format_number, format_percent, with_std
from opid.plots.style import format_law, format_units
from opid.plots.texts import LONGEST_LINE, shorten
from opid.report.document import Sketch
from opid.suspensions.result import GearParameters, GearRatios, Identification, InterfaceEstimate, units_of_suspensions

if TYPE_CHECKING:
    from opid.modal.decay.free_decay import Decay
    from opid.modal.result import ModalIdentification
    from opid.suspensions.bench.law import BenchLaw
    from opid.suspensions.own_structure import StructureIdentification
    from opid.suspensions.paper.result import AnyIdentification
    from opid.updating.result import Updating

# lengths in the units of the drawing, which is 620 wide and nearly as many pixels
_WIDTH = 620
_LINE = 24
_SMALL_LINE = 19
_LETTER = 8.6  # mean width of a letter of the words, in the widest of the usual fonts
# words stand to the right of the drawing, or on both sides of a body seen from above
_WORDS_X = 340
_PLAN_X = (230, 390)
# a sentence, which may hold a name of the user, takes so many lines
_MOST_LINES = 5
# a ground spring is drawn if it differs from zero by this many standard deviations
_SEEN_STD = 3.0
# a sketch has room for the numbers of so many modes, and for so many joints
_MOST_MODES = 3
_MOST_JOINTS = 4
_CHANGE = "± one standard deviation"


# ---- the kinds of results --------------------------------------------------------------------------


def sketch_suspensions(result: AnyIdentification) -> Sketch | None:
    """Return the sketch of a gear, or of a body from above; None where no number is reported."""
    if result.is_refused:
        return None
    if isinstance(result, Identification) and not result.study.is_one_gear:
        return _sketch_body(result)
    values, ratios = result.parameters, result.ratios
    if not isinstance(values, GearParameters) or not isinstance(ratios, GearRatios):
        return None
    mass = values.sprung_mass_kg
    if mass.value is None:
        head = "M₂ is not determined"
        numbers = [("K₂/M₂", ratios.stiffness_per_mass, "1/s^2"), ("C₂/M₂", ratios.damping_per_mass, "1/s")]
        ground = ("K₃/M₂", ratios.ground_stiffness_per_mass, "1/s^2")
    else:
        head = _write_equation("M₂", mass, "kg")
        numbers = [
            ("K₂", values.suspension_stiffness_n_per_m, "N/m"),
            ("C₂", values.suspension_damping_n_s_per_m, "N s/m"),
        ]
        ground = ("K₃", values.ground_stiffness_n_per_m, "N/m")
    words = [*_write_equations(numbers), _write_law(result.law.name if result.law.terms else "")]
    has_ground = _is_seen(ground[1])
    words += [_write_equation(*ground)] * has_ground
    picture = [*_draw_column(head, "K₂", "C₂, f"), '<circle cx="155" cy="216" r="14"/>', _draw_road(231)]
    picture += [_draw_sensor(40, 24, "ẍ₂ measured")]
    picture += [_draw_sensor(255, 198, "ẍ₁ measured")] * result.study.is_driven
    struts = ["travel z measured"] * bool(result.study.travels) + ["force measured"] * bool(result.study.forces)
    picture += [_draw_sensor(255, 176 - 22 * number, words) for number, words in enumerate(struts)]
    if has_ground:
        picture += [_draw_spring(306, 52, 231, turn=20), '<path d="M290 52H306"/>', _draw_text(318, 200, "K₃")]
    return _write_sketch(picture, (head, *words, _CHANGE), n_drawn=1)


def sketch_structure(result: StructureIdentification) -> Sketch | None:
    """Return the sketch of a user's own structure with its masses, suspensions and joints; None without numbers."""
    unit = "of the first" if result.per_mass else "kg"
    units = units_of_suspensions(per_mass=result.per_mass)
    words = [_write_equation(f"mass of {name}", mass, unit) for name, mass in result.masses.items()]
    for name, spring in (*result.interfaces.items(), *result.joints.items()):
        words += [f"{name}:", *_write_equations([("K", spring.stiffness, units[0]), ("C", spring.damping, units[1])])]
        words += [_write_law(spring.law.name)] if spring.law.terms else []
    if all(mass.value is None for mass in result.masses.values()):
        return None
    picture = [*_draw_column("the structure", "K", "C, f"), _draw_sensor(255, 198, "measured")]
    return _write_sketch(picture, (*words, _CHANGE))


def sketch_bench(result: BenchLaw) -> Sketch | None:
    """Return the sketch of a specimen between force cell and motion; None where there is no law."""
    values = result.parameters
    if result.not_determined or values.stiffness_n_per_m.value is None:
        return None
    numbers = [
        ("K", values.stiffness_n_per_m, "N/m"),
        ("C", values.damping_n_s_per_m, "N s/m"),
        ("F₀", values.offset_n, "N"),
        ("m", values.moving_mass_kg or Estimate(), "kg"),
        ("energy of a cycle", result.cycle.area_j, "J"),
    ]
    words = [*_write_equations(each for each in numbers if each[1].value is not None), _write_law(result.law.name)]
    picture = [*_draw_column("force cell: F measured", "K", "C, f"), _draw_road(16), '<path d="M155 16V24"/>']
    # the piston below the specimen moves up and down
    picture += ['<path d="M155 206V238M149 214L155 206L161 214M149 230L155 238L161 230"/>']
    picture += [_draw_text(172, 227, "motion z measured", size=13)]
    return _write_sketch(picture, (*words, _CHANGE))


def sketch_decay(result: Decay) -> Sketch:
    """Return the sketch of the mass that rings, with frequency and damping at both ends of the decay."""
    name = "x" if result.mode is None else "q"
    words: list[str] = []
    unit = format_units(result.amplitude_unit)
    for label, k in (("largest", 0), ("smallest", -1)):
        words.append(f"{label}: {name} = {format_number(result.amplitude[k], 3)} {unit}")
        words.append(f"f = {with_std(result.frequency_hz[k], result.frequency_std_hz[k])} Hz")
        words.append(f"ζ = {with_std(100 * result.damping_ratio[k], 100 * result.damping_std[k])} %")
    head = "one mass" if result.mode is None else f"mode {result.mode}, modal mass 1"
    picture = _draw_column(head, f"k({name})", f"c({name})")
    return _write_sketch([*picture, _draw_sensor(40, 24, f"{name} measured")], (*words, _CHANGE))


def sketch_modes(result: ModalIdentification) -> Sketch | None:
    """Return the sketch of a modal mass with frequency and damping of each nonlinear mode; None if there is none."""
    ends: dict[int, list[tuple[float, float, float]]] = {}
    for fit in result.fits:
        position = fit.stiffness_curve.position
        ends[fit.mode] = [
            (float(position[k]), float(fit.frequency_at_hz[k]), float(fit.damping_at[k])) for k in (0, -1)
        ]
    for mode in result.modes_by_decays_alone:
        law = result.decay_laws[mode]
        order = sorted(zip(law.amplitude.tolist(), law.frequency_hz.tolist(), law.damping_ratio.tolist(), strict=True))
        ends[mode] = [order[0], order[-1]]
    words: list[str] = []
    for mode, states in list(ends.items())[:_MOST_MODES]:
        for q, hz, ratio in states:
            words.append(f"mode {mode} at q = {format_number(q, 3)}{format_units(' m kg^1/2') if q else ''}:")
            words.append(f"f = {hz:.2f} Hz, ζ = {format_percent(ratio, 3)}")
    if not words:
        return None
    more = len(ends) - _MOST_MODES
    words += [f"and {more} more in the table"] * (more > 0)
    picture = _draw_column("modal mass 1", "k(q)", "c(q)")
    return _write_sketch(picture, words)


def sketch_joints(result: Updating) -> Sketch | None:
    """Return the sketch of a structure on its nonlinear joints with the law of the best class; None without one."""
    best = result.best
    if best is None:
        return None
    words = [f"f(z): {best.model_class.law_in_words} ({result.best_class})"]
    words += [
        f"{each.words}: {with_std(estimate.value, estimate.std)} {format_units(each.unit)}"
        for each, estimate in best.coefficients.items()
    ]
    linear = {} if result.linear is None else result.linear.estimates
    joint = {each.key for each in best.model_class.factors}
    words += [_write_equation(name, value, "of nominal") for name, value in linear.items() if name not in joint]
    names = result.system.joints[:_MOST_JOINTS]
    more = len(result.system.joints) - len(names)
    words += [f"and {more} more joints"] * (more > 0)
    picture = [_draw_mass(20, 24, 270, 56, "linear structure")]
    for number, name in enumerate(names):
        x = round(20 + 270 * (number + 0.5) / len(names))
        half = min(60, round(120 / len(names)))
        picture += [_draw_spring(x, 80, 170), _draw_text(x + 18, 130, "f(z)", size=13)]
        picture += [_draw_mass(x - half, 170, 2 * half, 32, name, most=max(4, half // 4))]
    return _write_sketch(picture, (*words, _CHANGE))


# ---- a body from above -----------------------------------------------------------------------------


def _sketch_body(result: Identification) -> Sketch:
    """The body from above, its front upward, with the numbers of each suspension beside it and its own below."""
    values = result.parameters
    per = "/M" if result.per_mass else ""
    callouts = {each.name: _list_callout(each, per, result.units) for each in result.interfaces}
    places = {name: (x, y) for name, (x, y, *_) in result.places.items()}
    sides = _choose_sides(places)
    n_most = max(len(lines) for lines in callouts.values())
    slot = (n_most + 1) * _SMALL_LINE
    height = max(200, slot * max(map(len, sides)))
    at = _scale_places(places, height)
    centre = [sum(column) / len(at) for column in zip(*at.values(), strict=True)]
    picture = [
        f'<path d="M{x:.0f} {y:.0f}L{centre[0]:.0f} {centre[1]:.0f}" stroke-opacity=".4" stroke-width="5"/>'
        for x, y in at.values()
    ]
    for side, (x_words, anchor) in zip(sides, ((_PLAN_X[0] - 30, "end"), (_PLAN_X[1] + 30, "start")), strict=True):
        for number, name in enumerate(side):
            (x, y), top = at[name], height * (number + 0.5) / len(side) - slot / 2 + _SMALL_LINE
            edge = x_words + (6 if anchor == "end" else -6)
            picture.append(f'<path d="M{edge} {top - 5:.0f}L{x:.0f} {y:.0f}" stroke-dasharray="2 3" stroke-width="1"/>')
            picture.append(f'<circle cx="{x:.0f}" cy="{y:.0f}" r="7" fill="currentColor"/>')
            picture += [
                _draw_text(
                    x_words, round(top + k * _SMALL_LINE), line, anchor, size=13, weight="normal" if k else "bold"
                )
                for k, line in enumerate(callouts[name])
            ]
    picture.append(_draw_text(_WIDTH // 2, 12, "front", "middle", size=12))
    said = [_write_equation("M", values.sprung_mass_kg, "kg")]
    labels = {"roll_inertia_kg_m2": "Ixx", "pitch_inertia_kg_m2": "Iyy", "x_cg_m": "c.g. x", "y_cg_m": "c.g. y"}
    said += [
        _write_equation(labels[name], estimate, "m" if name.endswith("_m") else "kg m^2")
        for name, estimate in values.items()
        if name in labels and estimate.value is not None
    ]
    below = [", ".join(said[k : k + 3]) for k in range(0, len(said), 3)]
    picture += [
        _draw_text(_WIDTH // 2, round(height + (k + 1) * _LINE), line, "middle", weight="normal" if k else "bold")
        for k, line in enumerate((*below, _CHANGE))
    ]
    alt = "; ".join([*said, *(f"{lines[0]}: {', '.join(lines[1:])}" for lines in callouts.values()), _CHANGE])
    return Sketch(_wrap_svg(picture, height + (len(below) + 1.5) * _LINE), alt)


def _list_callout(interface: InterfaceEstimate, per: str, units: tuple[str, str]) -> list[str]:
    numbers = [(f"K{per}", interface.stiffness, units[0]), (f"C{per}", interface.damping, units[1])]
    if _is_seen(interface.ground_stiffness):
        numbers.append((f"K₃{per}", interface.ground_stiffness, units[0]))
    room = int(1.1 * (_PLAN_X[0] - 30) / _LETTER)
    return [
        shorten(interface.name, room),
        *_write_equations(numbers),
        *textwrap.wrap(_write_law(interface.law.name), room),
    ]


def _choose_sides(places: Mapping[str, tuple[float, float]]) -> tuple[list[str], list[str]]:
    """The interfaces whose words stand to the left and to the right, from the front to the back."""
    left: list[str] = []
    right: list[str] = []
    middle = sum(y for _, y in places.values()) / len(places)
    # those in the middle come last, and go where there is room
    for name, (_, y) in sorted(places.items(), key=lambda item: -abs(item[1][1] - middle)):
        is_left = y > middle if abs(y - middle) > 1e-3 else len(left) <= len(right)
        (left if is_left else right).append(name)
    return sorted(left, key=lambda name: -places[name][0]), sorted(right, key=lambda name: -places[name][0])


def _scale_places(places: Mapping[str, tuple[float, float]], height: float) -> dict[str, tuple[float, float]]:
    """Where the interfaces stand in the drawing, which is true to scale."""
    xs, ys = zip(*places.values(), strict=True)
    scale = min((_PLAN_X[1] - _PLAN_X[0]) / (max(ys) - min(ys) or 1e-9), (height - 60) / (max(xs) - min(xs) or 1e-9))
    middle = (max(xs) + min(xs)) / 2, (max(ys) + min(ys)) / 2
    return {
        name: (_WIDTH / 2 - scale * (y - middle[1]), height / 2 + 6 - scale * (x - middle[0]))
        for name, (x, y) in places.items()
    }


# ---- words -----------------------------------------------------------------------------------------


def _is_seen(estimate: Estimate) -> bool:
    return estimate.value is not None and estimate.std is not None and abs(estimate.value) > _SEEN_STD * estimate.std


def _write_equation(symbol: str, estimate: Estimate, unit: str) -> str:
    if estimate.value is None:
        return f"{symbol} is not determined"
    return f"{symbol} = {with_std(estimate.value, estimate.std)} {format_units(unit)}"


def _write_equations(numbers: Iterable[tuple[str, Estimate, str]]) -> list[str]:
    return [_write_equation(*each) for each in numbers]


def _write_law(name: str) -> str:
    is_linear = name in ("", "linear")
    return "law: none, the force is linear" if is_linear else f"law: {format_law(name)}"


# ---- the parts of a drawing ------------------------------------------------------------------------


def _write_sketch(picture: Iterable[str], words: Sequence[str], *, n_drawn: int = 0) -> Sketch:
    """The drawing with the words beside it, of which the first `n_drawn` stand in the drawing itself."""
    room = int((_WIDTH - _WORDS_X) / _LETTER)
    # the further lines of a sentence stand a little to the right
    said = [shorten(each, _MOST_LINES * room) for each in words[n_drawn:]]
    lines = [(14 * (k > 0), part) for each in said for k, part in enumerate(textwrap.wrap(each, room))]
    first = max(20, 140 - _LINE * len(lines) // 2)
    drawn = [_draw_text(_WORDS_X + shift, first + _LINE * k, line) for k, (shift, line) in enumerate(lines)]
    return Sketch(_wrap_svg((*picture, *drawn), max(250, first + _LINE * len(lines))), "; ".join(words))


def _wrap_svg(picture: Iterable[str], height: float) -> str:
    head = f'<svg viewBox="0 0 {_WIDTH} {height:.0f}" fill="none" stroke="currentColor" stroke-width="1.6">'
    return "\n".join((head, *picture, "</svg>"))


def _draw_column(head: str, spring: str, damper: str) -> Iterator[str]:
    """A mass on a spring and a damper, with their symbols, on a bar."""
    yield _draw_mass(20, 24, 270, 56, head)
    yield _draw_spring(90, 80, 198)
    yield '<path d="M220 80V128M202 128H238M202 118V158H238V118M220 158V198"/>'
    yield _draw_text(66, 144, spring, "end") + _draw_text(248, 144, damper)
    yield '<path d="M40 198H270" stroke-width="5"/>'


def _draw_mass(x: int, y: int, width: int, height: int, words: str, *, most: int = LONGEST_LINE) -> str:
    box = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="3"/>'
    return box + _draw_text(x + width // 2, y + height // 2 + 6, words, "middle", weight="bold", most=most)


def _draw_spring(x: int, top: int, bottom: int, *, turn: int = 12) -> str:
    ends = (bottom - top - 5 * turn) // 2
    zigzag = " ".join(f"{x + (-1) ** k * 11},{top + ends + turn * k}" for k in range(6))
    return f'<polyline points="{x},{top} {x},{top + ends - 8} {zigzag} {x},{bottom - ends + 8} {x},{bottom}"/>'


def _draw_road(y: int) -> str:
    return f'<path d="M20 {y}H290" stroke-dasharray="5 4"/>'


def _draw_sensor(x: int, y: int, words: str) -> str:
    square = f'<rect x="{x - 6}" y="{y - 12}" width="12" height="12" fill="currentColor"/>'
    return square + _draw_text(x + 12, y - 3, words, size=12)


def _draw_text(
    x: int,
    y: int,
    words: str,
    anchor: str = "start",
    *,
    size: int = 15,
    weight: str = "normal",
    most: int = LONGEST_LINE,
) -> str:
    """Write words, and where they do not stand there whole, all of them for a pointer that rests on them."""
    look = f'text-anchor="{anchor}" font-size="{size}" font-weight="{weight}"'
    shown = shorten(words, most)
    every = escape_invisible(words)
    whole = "" if shown == every else f"<title>{escape(every)}</title>"
    return f'<text x="{x}" y="{y}" {look} fill="currentColor" stroke="none">{whole}{escape(shown)}</text>'
