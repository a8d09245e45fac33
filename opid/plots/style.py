"""The style of all figures, and what several of them draw alike."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.ticker import (
    FuncFormatter,
    LogLocator,
    NullFormatter,
)

from opid.errors import NotDeterminedError
from opid.estimate import RAISED, format_number
from opid.mechanics.truth import TaxiTruth
from opid.plots.texts import mend_texts
from opid.suspensions.paper.chain import RunEvidence
from opid.suspensions.paper.result import AnyIdentification
from opid.suspensions.study import Run

# the palette of Okabe & Ito (2008) is distinct for colour-blind readers
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
INK, GREY, PALE = "#222222", "#7A7A7A", "#C4C4C4"
RUN_COLORS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
SURFACE_MAP, COUNT_MAP = "RdBu_r", "cividis"
# a number that would cross a line has this box behind it
BEHIND = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
# the range in which most of the motion lies has this colour
SHADED = "#F1F1F1"
TRAVEL, VELOCITY = "travel z [mm]", "velocity z′ [m/s]"
WIDTH_IN, DPI = 7.4, 150
# this many points at most, about, are drawn in a scatter: more would only make a blot
N_POINTS = 4000

STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.5,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.formatter.use_mathtext": False,
    # a "$" in the name of a run is a dollar
    "text.parse_math": False,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "text.color": INK,
    "lines.linewidth": 1.5,
    "legend.fontsize": 8.5,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "agg.path.chunksize": 20000,
}


_DRAWN: ContextVar[list[Axes]] = ContextVar("drawn")


@contextmanager
def house_style() -> Iterator[None]:
    """Draw in the house style within the block; the settings of the user hold again after it.

    When the block ends, every text of the Axes that `panels` or `take_axes` gave is made fit for a figure: names of the
    user are shortened, and lose what no font can draw. Before it only names with less room than a line are (`shorten`).
    """
    drawn: list[Axes] = []
    token = _DRAWN.set(drawn)
    try:
        with rc_context(STYLE):
            yield
            for ax in dict.fromkeys(drawn):
                mend_texts(ax)
    finally:
        _DRAWN.reset(token)


def take_axes(axes: Iterable[Axes]) -> None:
    """Let the house style mend the texts of these Axes when its block ends."""
    if (drawn := _DRAWN.get(None)) is not None:
        drawn.extend(axes)


def panels(
    axes: Any, rows: int, columns: int = 1, *, height_in: float, width_in: float = WIDTH_IN, **settings: Any
) -> np.ndarray:
    """Return a (rows, columns) array of the given Axes, or of those of a new figure that no backend holds.

    Args:
        axes: an Axes, or Axes in any shape, or None for a new figure.
        rows: of panels.
        columns: of panels.
        height_in: of a new figure, inches.
        width_in: likewise.
        settings: keyword arguments of `matplotlib.figure.Figure.subplots`.

    Raises:
        ValueError: another number of Axes.

    >>> panels(None, 2, 1, height_in=3).shape
    (2, 1)
    """
    if axes is None:
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        made: np.ndarray = figure.subplots(rows, columns, squeeze=False, **settings)
        take_axes(made.ravel())
        return made
    given = np.atleast_1d(np.asarray(axes, dtype=object)).ravel()
    if given.size != rows * columns:
        raise ValueError(f"{given.size} Axes are given and the figure has {rows} x {columns}")
    take_axes(given)
    return given.reshape(rows, columns)


def png(figure: Figure, *, dpi: int = DPI) -> bytes:
    """Return a figure as the bytes of a PNG file.

    Args:
        figure: any figure.
        dpi: dots per inch.

    >>> png(Figure(figsize=(1, 1)))[1:4]
    b'PNG'
    """
    buffer = io.BytesIO()
    # some parts, such as ticks, are made only when a figure is drawn
    with house_style():
        figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def figure_of(axes: Axes | np.ndarray) -> Figure:
    """Return the figure that holds the Axes of a plot function.

    Args:
        axes: what a plot function returned.

    >>> float(figure_of(panels(None, 1, height_in=2)).get_figheight())
    2.0
    """
    figure = np.atleast_1d(np.asarray(axes, dtype=object)).ravel()[0].get_figure(root=True)
    assert isinstance(figure, Figure)
    return figure


def thin_samples(n_samples: int, n_points: int = N_POINTS) -> slice:
    """Return the slice that thins `n_samples` to fewer than twice `n_points`.

    >>> len(range(10000)[thin_samples(10000, 4000)])
    5000
    """
    return slice(None, None, max(1, n_samples // n_points))


def panels_in_rows(axes: Any, n_panels: int, columns: int, **settings: Any) -> np.ndarray:
    """Return panels in rows of so many `columns`, as `panels` does; those after the last one that is needed are off."""
    grid = panels(axes, -(-n_panels // columns), columns, **settings)
    for ax in grid.ravel()[n_panels:]:
        ax.set_axis_off()
    return grid


def write_note(ax: Axes, text: str, at: tuple[float, float], shift: tuple[float, float], **style: Any) -> None:
    """Write a text that is shifted by some points on paper from a position in the data."""
    ax.annotate(text, at, shift, textcoords="offset points", **{"fontsize": 8.5, **style})


def name_rows(ax: Axes, names: Sequence[str], colors: Sequence[str], *, chosen: Sequence[bool], **style: Any) -> None:
    """Write names in their colours at the rows of an Axes, which are counted from the top; those chosen are bold."""
    ax.set_yticks(range(len(names)), names, **style)
    for label, color, is_chosen in zip(ax.get_yticklabels(), colors, chosen, strict=True):
        label.set_color(color)
        label.set_fontweight("bold" if is_chosen else "normal")
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.grid(False, axis="y")


def smooth_lines(frequency_hz: np.ndarray, residual: np.ndarray, width_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the rms of complex lines over a width in Hz, and the frequency in the middle of each, Hz."""
    n = max(1, min(frequency_hz.size, round(width_hz / float(frequency_hz[1] - frequency_hz[0]))))
    power = np.convolve(np.abs(residual) ** 2, np.ones(n), "valid") / n
    return np.convolve(frequency_hz, np.ones(n), "valid") / n, np.sqrt(power)


def build_motion(position: np.ndarray, along: str) -> tuple[np.ndarray, np.ndarray]:
    """Return travel and velocity along "travel" or "velocity", the other one zero: the arguments of a force.

    >>> build_motion(np.ones(1), "velocity")
    (array([0.]), array([1.]))
    """
    zero = np.zeros_like(position)
    return (position, zero) if along == "travel" else (zero, position)


def find_true_scale(truth: TaxiTruth | None, *, per_mass: bool) -> float:
    """Return the factor of true forces, which must be per kg of the sprung mass where those of the result are."""
    return 1.0 / truth.parameters.sprung_mass_kg if truth is not None and per_mass else 1.0


def format_law(name: str) -> str:
    """Return the name of a law with blanks, as it is written in a figure."""
    return name.replace("_", " ").replace("+", " + ")


def format_minus(text: str) -> str:
    """Return a text with the sign minus in the place of each hyphen."""
    return text.replace("-", "−")


def require_answer(result: AnyIdentification) -> None:
    """Refuse to draw a fit of which the identification gives no number.

    Raises:
        NotDeterminedError: it was refused.
    """
    if result.is_refused:
        reason = result.not_determined or f"it leaves {result.residual_over_noise:.0f} times the sensors' noise"
        raise NotDeterminedError(f"there is no fit to draw: {reason}")


def choose_run_colors(n_runs: int) -> list[str]:
    """Return one colour a run, from the palette over and over.

    >>> choose_run_colors(2) == [BLUE, VERMILION]
    True
    """
    return [RUN_COLORS[i % len(RUN_COLORS)] for i in range(n_runs)]


def format_run(run: RunEvidence | Run) -> str:
    """Return the name of a run with its mass against the reference."""
    change = (
        "reference mass"
        if run.mass_change_kg == 0
        else format_minus(f"{format_number(run.mass_change_kg, has_sign=True)} kg")
    )
    return f"run {run.name!r}, {change}"


def thicken(legend: Legend) -> None:
    """Show the colours of thin lines and small dots in a legend."""
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set_linewidth(max(handle.get_linewidth(), 2.0))
            handle.set_markersize(max(handle.get_markersize(), 5.0))
            handle.set_alpha(1)


_UNIT = r"(?<![^\W\d_])(?:[kMGmµucdn]?(?:m|s|g|N|Hz|Pa|V|J|W|A|rad)|in|ft|lbf|K)"


def format_units(unit: str, *, only: bool = False) -> str:
    """Return a unit, or a text with units, in print.

    Args:
        unit: the text.
        only: whether nothing but a power or a product of known units is changed, because the text may be a name.

    >>> format_units("N s^2/m^2"), format_units("a*b^2, kg*m^2", only=True)
    ('N s²/m²', 'a*b^2, kg·m²')
    """
    if only:
        powers = rf"{_UNIT}\^(?:\d+(?:\.\d+)?(?:/2)?|n)(?!\w)|{_UNIT}\*(?={_UNIT}(?!\w))"
        return re.sub(powers, lambda found: format_units(found[0]), unit)
    # exponents like "^2.5" and "^n" count, too: a raised point does not exist, so that a dot above stands for it
    raised = re.sub(r"\^(\d+(?:\.\d+)?|n)", lambda power: power[1].translate(RAISED), unit.replace("kg^1/2", "√kg"))
    return raised.replace("*", "·")


def plain_numbers(axis: Axis) -> None:
    """Write the numbers at a logarithmic axis without powers of ten, at 1, 2 and 5 of each decade."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: format_number(value)))
    axis.set_minor_formatter(NullFormatter())
