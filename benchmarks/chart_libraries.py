"""Plotly and Bokeh for the charts of a page: its size, the time to write it and the time to open it.

    python benchmarks/chart_libraries.py [--repeats 5] [--seed 0] [--out FOLDER]

One gear is simulated and identified: two runs of 40 s at 512 Hz, two channels each. Four of its charts are written as
opid writes them for Plotly, with and without the surface that turns, and by hand for Bokeh from the same arrays: the
accelerations, transmissibilities, the law with its band, and the restoring force from above. Bokeh has no surface.
Both pages hold all samples of a long line in 16 bits, draw its least and largest values in each stretch, draw a chart
when it comes into view, and have their script inside, compressed in the same way. A fourth page is what `file_html` of
Bokeh writes without more: plain script, all charts at once.

Writing is processor time; opening is time in Chromium from the navigation on, and the processor time of its processes.
All are medians, and the pages take turns, so that what else the machine does falls upon all of them. It takes one
minute or two. `--out` keeps the pages.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from estimator import identify
from harness import table_head, table_row
from matplotlib import colormaps
from matplotlib.colors import to_hex
from packaging.requirements import Requirement
from scenarios import SCENARIOS
from trials import simulated, study_of

from opid.plots.charts.figure import build_chart
from opid.plots.style import COUNT_MAP, GREY, INK, PALE, RUN_COLORS, SURFACE_MAP, figure_of, format_run
from opid.report.document import Document, Figure
from opid.report.suspensions.figures import list_figures
from opid.report.writing import lay_out_page, pack_script
from opid.suspensions.paper.transmissibility import suspension_transmissibility

CHARTS = ("accelerations", "transmissibility", "force_sections", "restoring_force_map")
SURFACE = "restoring_force_surface"
MOST_POINTS = 3000  # of a line that is drawn, as in opid's page
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ["--no-sandbox", "--use-gl=swiftshader", "--enable-unsafe-swiftshader"]


@dataclass
class Page:
    """A page that is written and opened some times.

    Args:
        name: first cell of its row.
        write: returns the page, the bytes of the script in it, and processor seconds of each step.
        boxes: selector of the elements that hold its charts.
        is_drawn: JavaScript of whether the chart in `box` is drawn.
        html: as last written.
        script: bytes of its script.
        steps: processor seconds of each step of writing, by its name.
        first: seconds until its first chart is drawn.
        every: seconds until all charts are drawn, each one scrolled to.
        busy: processor seconds of all processes of the browser until then.
    """

    name: str
    write: Callable[[], tuple[str, int, dict[str, float]]]
    boxes: str = "[data-chart]"
    is_drawn: str = "box.dataset.drawn"
    html: str = ""
    script: int = 0
    steps: dict[str, list[float]] = field(default_factory=dict)
    first: list[float] = field(default_factory=list)
    every: list[float] = field(default_factory=list)
    busy: list[float] = field(default_factory=list)


def main() -> None:
    """Write and open the pages, and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5, help="times that each page is written and opened")
    parser.add_argument("--seed", type=int, default=0, help="of the roads and the noise")
    parser.add_argument("--out", type=Path, help="folder in which the pages are kept")
    options = parser.parse_args()

    case = SCENARIOS["nominal"].case(options.seed)
    result = identify(study_of(simulated(case, options.seed), case.sensors), law=case.gear.law.name)
    figures = {each.name: each for each in list_figures(result)}
    pages = [
        Page("Plotly, as opid", lambda: write_for_plotly([figures[name] for name in CHARTS])),
        Page("the same and a surface", lambda: write_for_plotly([figures[name] for name in (*CHARTS, SURFACE)])),
    ]
    if find_spec("bokeh") is None:
        print("Bokeh is not installed: its pages are left out.\n")
    else:
        whole = "window.Bokeh && Bokeh.documents.length && Bokeh.documents.every((each) => each.is_idle)"
        pages += [
            Page("Bokeh, as opid", lambda: write_for_bokeh(result)),
            Page("Bokeh, `file_html`", lambda: write_by_file_html(result), "body", whole),
        ]
    for page in pages:
        page.write()  # whatever is imported or compiled at the first time
    for _ in range(options.repeats):
        for page in pages:
            page.html, page.script, steps = page.write()
            for name, seconds in steps.items():
                page.steps.setdefault(name, []).append(seconds)
    with TemporaryDirectory() as temporary:
        folder = options.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        open_all(pages, folder, options.repeats)
    print_pages(pages)
    print_packages()


def print_pages(pages: list[Page]) -> None:
    """Print a row for each page."""
    steps = ["figures", "charts", "page"]
    titles = [
        "page, MB",
        "script in it, MB",
        *(f"{each}, s" for each in steps),
        "first chart, s",
        "all charts, s",
        "browser busy, s",
    ]
    print(table_head("", *titles))
    for page in pages:
        written = [f"{median(page.steps[each]):.3f}" if each in page.steps else "-" for each in steps]
        opened = [f"{median(each):.2f}" if each else "-" for each in (page.first, page.every, page.busy)]
        sizes = [f"{size / 1e6:.2f}" for size in (len(page.html.encode()), page.script)]
        print(table_row(page.name, *sizes, *written, *opened))
    print()


# ---- Plotly: opid's own code -------------------------------------------------------------------------


def write_for_plotly(figures: list[Figure]) -> tuple[str, int, dict[str, float]]:
    """Return the page that opid writes with these figures, with the bytes of its script and the time of each step."""
    pack_script.cache_clear()
    began = time.process_time()
    drawn = {each.name: figure_of(each.draw()) for each in figures}
    drew = time.process_time()
    charts = {name: build_chart(figure) for name, figure in drawn.items()}
    built = time.process_time()
    html = lay_out_page(Document("Charts", "drawn by Plotly", ""), figures, charts, None, directory=Path())
    ended = time.process_time()
    return html, len(pack_script()), {"figures": drew - began, "charts": built - drew, "page": ended - built}


# ---- Bokeh: the same charts by hand ------------------------------------------------------------------

# the least and the largest value of each stretch of what is in view, as in the page of opid
REFINE = """
const y = codes.data.y, first = Math.max(0, Math.floor(range.start / dt) - 1);
const last = Math.min(y.length, Math.ceil(range.end / dt) + 2);
const step = Math.max(1, Math.ceil(2 * (last - first) / most));
const xs = [], ys = [];
for (let k = first; k < last; k += step) {
  let least = k, largest = k;
  for (let j = k; j < Math.min(k + step, last); j++) {
    if (y[j] < y[least]) least = j;
    if (y[j] > y[largest]) largest = j;
  }
  const pair = step > 1 ? [Math.min(least, largest), Math.max(least, largest)] : [k];
  for (const j of pair) xs.push(j * dt), ys.push(low + y[j] * height);
}
shown.data = { x: xs, y: ys };
"""
CSV = """
const rows = ["curve,x,y"];
for (const [name, { data }] of Object.entries(sources))
  for (let k = 0; k < data.x.length; k++) rows.push([JSON.stringify(name), data.x[k], data.y[k]].join(","));
const link = document.createElement("a");
link.href = URL.createObjectURL(new Blob([rows.join("\\r\\n")], { type: "text/csv" })), link.download = file;
link.click();
"""
LAYOUT = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>Charts</title>
<style>body {{ max-width: 60rem; margin: auto; font-family: system-ui, sans-serif }}</style>
</head>
<body>
<h1>Charts</h1>
{sections}
<script type="text/plain" id="bokeh">{script}</script>
<script>
(async () => {{
  const bytes = Uint8Array.from(atob(document.getElementById("bokeh").textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);
  const show = async (box) => {{
    const views = await Bokeh.embed.embed_item(JSON.parse(box.querySelector("script").textContent), box);
    const {{ document }} = [...views][0].model;
    while (!document.is_idle) await new Promise(requestAnimationFrame);
    box.dataset.drawn = "yes";
  }};
  const watcher = new IntersectionObserver((entries) => {{
    for (const {{ target, isIntersecting }} of entries) if (isIntersecting) watcher.unobserve(target), show(target);
  }}, {{ rootMargin: "400px" }});
  document.querySelectorAll("[data-chart]").forEach((box) => watcher.observe(box));
}})();
</script>
</body>
</html>
"""


def write_for_bokeh(result: Any) -> tuple[str, int, dict[str, float]]:
    """Return a page of Bokeh that holds, compresses and draws as that of opid does."""
    from bokeh.embed import json_item

    began = time.process_time()
    charts = build_bokeh_charts(result)
    built = time.process_time()
    sections = []
    for name, chart in charts.items():
        text = json.dumps(json_item(chart), separators=(",", ":")).replace("<", "\\u003c")
        data = f'<script type="application/json">{text}</script>'
        sections.append(f'<h2>{name}</h2><div class="chart" data-chart="{name}">{data}</div>')
    script = pack_bokeh_script()
    html = LAYOUT.format(sections="\n".join(sections), script=script)
    return html, len(script), {"charts": built - began, "page": time.process_time() - built}


def write_by_file_html(result: Any) -> tuple[str, int, dict[str, float]]:
    """Return the page that Bokeh itself writes of the same charts."""
    from bokeh.embed import file_html
    from bokeh.layouts import column
    from bokeh.resources import INLINE

    began = time.process_time()
    chart = column(*build_bokeh_charts(result).values(), sizing_mode="stretch_width")
    built = time.process_time()
    html = file_html(chart, INLINE, "Charts")
    ended = time.process_time()
    return html, find_bokeh_script().stat().st_size, {"charts": built - began, "page": ended - built}


def find_bokeh_script() -> Path:
    """Return the path of the script of Bokeh without widgets, tables and WebGL."""
    import bokeh

    return Path(bokeh.__file__).parent / "server" / "static" / "js" / "bokeh.min.js"


def pack_bokeh_script() -> str:
    """Return the script of Bokeh as `pack_script` of opid packs that of Plotly."""
    import base64
    import gzip

    return base64.b64encode(gzip.compress(find_bokeh_script().read_bytes(), 6, mtime=0)).decode()


def build_bokeh_charts(result: Any) -> dict[str, Any]:
    """Return the charts of `CHARTS` as layouts of Bokeh."""
    chain, surface = result.paper_chain, next(iter(result.evidence[0].surfaces.values()))
    reference = next((run for run in chain.runs if run.mass_change_kg == 0), chain.runs[0])
    made = (
        build_accelerations(result),
        build_transmissibilities(result),
        build_sections(surface),
        build_map(reference),
    )
    return dict(zip(CHARTS, made, strict=True))


def open_figure(title: str, x: str, y: str, **settings: Any) -> Any:
    """Return an empty figure of Bokeh that can be zoomed."""
    from bokeh.plotting import figure

    tools = "pan,box_zoom,wheel_zoom,reset,save"
    return figure(title=title, x_axis_label=x, y_axis_label=y, tools=tools, active_scroll=None, **settings)


def arrange(rows: list[list[Any]], name: str) -> Any:
    """Return figures in a grid with one bar of tools, which also saves them as PNG and their lines as CSV."""
    from bokeh.layouts import gridplot
    from bokeh.models import CustomAction, CustomJS, GlyphRenderer, HoverTool, SaveTool

    figures = [each for row in rows for each in row]
    sources: dict[str, Any] = {}
    for each in figures:
        lines = [part for part in each.select(GlyphRenderer) if part.name and {"x", "y"} <= set(part.data_source.data)]
        each.add_tools(HoverTool(renderers=lines, tooltips=[("", "$name"), ("x", "$x"), ("y", "$y")]))
        sources |= {f"{each.title.text}: {part.name}": part.data_source for part in lines}
    figures[0].add_tools(
        CustomAction(description="CSV", callback=CustomJS(args={"sources": sources, "file": f"{name}.csv"}, code=CSV))
    )
    grid = gridplot(rows, sizing_mode="stretch_width", toolbar_location="above")
    for tool in grid.select({"type": SaveTool}):
        tool.filename = name
    return grid


def draw_line(
    ax: Any, x: np.ndarray, y: np.ndarray, name: str, color: str, *, has_entry: bool = True, **look: Any
) -> None:
    """Draw a curve with or without an entry of the legend, of single precision as opid writes it."""
    source = {"x": np.asarray(x, dtype="f4"), "y": np.asarray(y, dtype="f4")}
    entry = {"legend_label": name} if has_entry else {}
    ax.line("x", "y", source=source, name=name, color=color, **entry, **look)


def draw_record(ax: Any, y: np.ndarray, dt: float, name: str, color: str) -> None:
    """Draw a long line by its least and largest values in each stretch; the samples come where one zooms in."""
    from bokeh.models import ColumnDataSource, CustomJS

    low, height = float(y.min()), float(np.ptp(y)) / 65535
    codes = ColumnDataSource({"y": np.round((y - low) / height).astype("u2")})
    x, thinned = thin(y, dt)
    shown = ColumnDataSource({"x": x.astype("f4"), "y": thinned.astype("f4")})
    ax.line("x", "y", source=shown, name=name, legend_label=name, color=color, line_width=0.9)
    known = {"codes": codes, "shown": shown, "range": ax.x_range, "dt": dt, "low": low, "height": height}
    refine = CustomJS(args=known | {"most": MOST_POINTS}, code=REFINE)
    ax.x_range.js_on_change("start", refine)
    ax.x_range.js_on_change("end", refine)


def thin(y: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a long line as pairs of its least and largest values.

    >>> thin(np.arange(6000.0), 1.0)[1][:4]
    array([0., 3., 4., 7.])
    """
    step = -(-2 * y.size // MOST_POINTS)
    parts = np.pad(y, (0, -y.size % step), mode="edge").reshape(-1, step)
    ends = np.sort(np.stack([parts.argmin(axis=1), parts.argmax(axis=1)], axis=1), axis=1)
    at = np.minimum(ends + step * np.arange(len(parts))[:, np.newaxis], y.size - 1).ravel()
    return dt * at, y[at]


def build_accelerations(result: Any) -> Any:
    """Both channels of each run over one linked time axis."""
    from bokeh.models import Range1d

    time_s = result.study.runs[0].recording.time_s
    shared, rows = Range1d(float(time_s[0]), float(time_s[-1])), []
    for run, color in zip(result.study.runs, RUN_COLORS, strict=False):
        title = format_run(run)
        ax = open_figure(title, "time [s]", "acceleration − mean [m/s²]", x_range=shared, height=220)
        for channel, shade, name in (
            (result.study.unsprung, PALE, "spindle (unsprung)"),
            (result.study.sprung, color, "airframe (sprung)"),
        ):
            samples = run.recording.channel(channel)
            draw_record(ax, samples - samples.mean(), 1 / run.recording.fs, name, shade)
        rows.append([ax])
    return arrange(rows, "accelerations")


def build_transmissibilities(result: Any) -> Any:
    """Magnitude, phase and coherence of each run over one linked frequency axis."""
    from bokeh.models import Range1d

    shared, columns, ratios = Range1d(0.25, 40.0), [], result.ratios
    fitted_at, mass_kg = np.geomspace(0.25, 40.0, 400), result.parameters.sprung_mass_kg.value
    for run, color in zip(result.paper_chain.runs, RUN_COLORS, strict=False):
        inside = (run.T.frequency_hz >= 0.25) & (run.T.frequency_hz <= 40.0)
        at, common = run.T.frequency_hz[inside], {"x_axis_type": "log", "x_range": shared}
        title, scale = format_run(run), mass_kg / (mass_kg + run.mass_change_kg)
        magnitude = open_figure(title, "", "|T| = |X₂/X₁|", y_axis_type="log", height=300, **common)
        phase = open_figure("", "", "phase [°]", y_range=(-225, 45), height=180, **common)
        coherence = open_figure("", "frequency [Hz]", "coherence", y_range=(0, 1.05), height=160, **common)
        fitted = suspension_transmissibility(
            fitted_at,
            stiffness_per_mass=scale * ratios.stiffness_per_mass.value,
            damping_per_mass=scale * ratios.damping_per_mass.value,
            ground_stiffness_per_mass=scale * ratios.ground_stiffness_per_mass.value,
        )
        for name, x, value, look in (
            ("measured", at, run.T.value[inside], {"color": GREY}),
            ("force subtracted (the paper)", at, run.T_subtracted.value[inside], {"color": color, "alpha": 0.45}),
            ("force taken out (conditioned)", at, run.T_without_force.value[inside], {"color": color}),
            ("fitted suspension", fitted_at, fitted, {"color": INK, "line_dash": "dashed"}),
        ):
            draw_line(magnitude, x, np.abs(value), name, **look)
            if "paper" not in name:
                draw_line(phase, x, np.degrees(np.angle(1j * value)) - 90, name, has_entry=False, **look)
        for name, T, shade in (("spindle alone", run.T, GREY), ("spindle and force", run.T_without_force, color)):
            draw_line(coherence, at, T.coherence[inside], name, shade)
        peaks = [peak.frequency_hz for peak in run.peaks], [peak.magnitude for peak in run.peaks]
        magnitude.scatter(*peaks, marker="inverted_triangle", size=7, color="#009E73", legend_label="peaks")
        for ax in (magnitude, coherence):
            ax.legend.location = "bottom_left"
        columns.append([magnitude, phase, coherence])
    return arrange([list(row) for row in zip(*columns, strict=True)], "transmissibility")


def build_sections(surface: Any) -> Any:
    """The law along travel and velocity over the measured force with its band."""
    row: list[Any] = []
    for section, factor, label in (
        (surface.along_travel, 1e3, "travel z [mm]"),
        (surface.along_velocity, 1.0, "velocity z′ [m/s]"),
    ):
        linked = {"y_range": row[0].y_range} if row else {}
        ax = open_figure("", label, "force per mass less (K z + C z′) [m/s²]", height=330, **linked)
        known = np.isfinite(section.mean)
        x, mean, band = factor * section.position[known], section.mean[known], 2 * section.standard_error[known]
        ax.varea(x, mean - band, mean + band, color=PALE, legend_label="measured, 95 %")
        ax.scatter(x, mean, size=4, color=INK, legend_label="measured")
        draw_line(ax, factor * section.position, section.law, "law", RUN_COLORS[1], line_width=2.4)
        row.append(ax)
    return arrange([row], "force_sections")


def build_map(run: Any) -> Any:
    """The restoring force from above with its contours, and the samples in each cell."""
    from bokeh.models import ColorBar, LinearColorMapper, LogColorMapper

    binned = run.binned
    x, y = 1e3 * binned.travel_edges, binned.velocity_edges
    limit = float(np.nanmax(np.abs(binned.mean)))
    counts = np.where(binned.counts > 0, binned.counts, np.nan)
    clear, row = "rgba(0, 0, 0, 0)", []
    for title, values, mapper in (
        (
            "Mean force",
            binned.mean,
            LinearColorMapper(list_colors(SURFACE_MAP), low=-limit, high=limit, nan_color=clear),
        ),
        ("Samples", counts, LogColorMapper(list_colors(COUNT_MAP), low=1, high=np.nanmax(counts), nan_color=clear)),
    ):
        linked = {"x_range": row[0].x_range, "y_range": row[0].y_range} if row else {}
        ax = open_figure(title, "travel z [mm]", "velocity z′ [m/s]", height=400, **linked)
        where = {"x": x[0], "y": y[0], "dw": np.ptp(x), "dh": np.ptp(y)}
        ax.image([values.T.astype("f4")], color_mapper=mapper, **where)
        ax.add_layout(ColorBar(color_mapper=mapper), "below")
        row.append(ax)
    travel, velocity = binned.centres
    levels = np.linspace(-limit, limit, 11)[1:-1]
    row[0].contour(1e3 * travel, velocity, np.ma.masked_invalid(binned.mean), levels, line_color=INK, line_width=0.8)
    return arrange([row], "restoring_force_map")


def list_colors(name: Any) -> list[str]:
    """Return 256 colours of a colour map of matplotlib."""
    return [to_hex(each) for each in colormaps.get_cmap(name)(np.linspace(0, 1, 256))]


# ---- opening -----------------------------------------------------------------------------------------

# milliseconds from the navigation to the first chart, and to all, each one scrolled to
WATCH = """
window.watched = (async () => {
  const frame = () => new Promise(requestAnimationFrame), list = () => [...document.querySelectorAll("%s")];
  const isDrawn = (box) => %s;
  while (document.readyState === "loading" || !list().length || !isDrawn(list()[0])) await frame();
  await frame();
  const first = performance.now();
  for (const box of list()) {
    box.scrollIntoView();
    while (!isDrawn(box)) await frame();
  }
  await frame(), await frame();
  return [first, performance.now()];
})();
"""


def open_all(pages: list[Page], folder: Path, repeats: int) -> None:
    """Open each page some times, in turns, where there is a Chromium."""
    if find_spec("playwright") is None or CHROMIUM is None:
        print("There is no Chromium with Playwright: the pages are not opened.\n")
        return
    from playwright.sync_api import sync_playwright

    files = [folder / f"page_{k}.html" for k in range(len(pages))]
    for file, page in zip(files, pages, strict=True):
        file.write_text(page.html, encoding="utf-8")
    with sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        system = chromium.new_browser_cdp_session()

        def read_busy() -> dict[int, float]:
            return {each["id"]: each["cpuTime"] for each in system.send("SystemInfo.getProcessInfo")["processInfo"]}

        for turn in range(repeats + 1):
            for file, page in zip(files, pages, strict=True):
                before, context = read_busy(), chromium.new_context()
                shown = context.new_page()
                shown.on("pageerror", lambda error, page=page: sys.exit(f"{page.name}: {error}"))
                shown.add_init_script(WATCH % (page.boxes, page.is_drawn))
                shown.goto(file.resolve().as_uri())
                first, every = shown.evaluate("window.watched")
                busy = sum(spent - before.get(each, 0.0) for each, spent in read_busy().items())
                context.close()
                if turn:  # at the first one the file may not be in memory
                    page.first.append(1e-3 * first)
                    page.every.append(1e-3 * every)
                    page.busy.append(busy)
        chromium.close()


# ---- packages ----------------------------------------------------------------------------------------


def print_packages() -> None:
    """Print version, licence, sizes, and what loading its Python takes, of each library."""
    others = find_needed(name for name in list_requirements("opid") if name != "plotly")
    print("Plotly: opid takes its script and never imports its Python.\n")
    print(table_head("", "version", "licence", "package, MB", "with what only it needs, MB", "which", "import, s"))
    for name, module in (
        ("plotly", "plotly.io; from plotly.graph_objects import Figure, Heatmap, Mesh3d, Scatter"),
        ("bokeh", "bokeh.plotting, bokeh.embed"),
    ):
        if find_spec(name) is None:
            continue
        added = find_needed([name]) - others
        sizes = {each: measure_size(each) for each in added}
        total, which = sum(sizes.values()), ", ".join(sorted(added - {name})) or "-"
        told = distribution(name).metadata
        licence = told["License-Expression"] or told["License"]
        cells = (
            told["Version"],
            licence,
            f"{sizes[name] / 1e6:.1f}",
            f"{total / 1e6:.1f}",
            which,
            f"{time_import(module):.2f}",
        )
        print(table_row(name, *cells))


def list_requirements(name: str) -> list[str]:
    """Return what a package needs without extras."""
    needed = [Requirement(each) for each in distribution(name).requires or ()]
    return [each.name.lower() for each in needed if each.marker is None or each.marker.evaluate({"extra": ""})]


def find_needed(names: Iterable[str]) -> set[str]:
    """Return these packages and all that they need."""
    found: set[str] = set()
    open_ones = list(names)
    while open_ones:
        name = open_ones.pop()
        if name not in found:
            found.add(name)
            with suppress(PackageNotFoundError):
                open_ones += list_requirements(name)
    return found


def measure_size(name: str) -> int:
    """Return the bytes of the files of a package without bytecode."""
    files = [Path(str(each.locate())) for each in distribution(name).files or () if each.suffix != ".pyc"]
    return sum(each.lstat().st_size for each in files if each.is_file())


def time_import(modules: str, repeats: int = 5) -> float:
    """Return the processor seconds of an import, beyond what opid loads for a figure anyway."""
    code = (
        "import time, matplotlib.figure, jinja2; began = time.process_time(); "
        f"import {modules}; print(time.process_time() - began)"
    )
    command = [sys.executable, "-c", code]
    return median(
        float(subprocess.run(command, check=True, capture_output=True, env=os.environ).stdout) for _ in range(repeats)
    )


if __name__ == "__main__":
    main()
