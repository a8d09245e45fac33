"""Draw the error of the mass of every random gear by four methods, from the files of `model_figures.py --out`.

Run `python benchmarks/draw_mass_errors.py FILE.jsonl ... --png docs/mass_errors.png`.
"""

import argparse
from pathlib import Path

import numpy as np
from campaign import read_records

from opid.plots.style import GREY, INK, RUN_COLORS, figure_of, house_style, panels, plain_numbers, png

METHODS = {
    "model": "opid, driven model\nlaw searched",
    "classical": "opid, the paper's chain mended\nlaw searched",
    "least squares": "integrate and least squares\nlaw known",
    "pysindy": "integrate and pysindy\nlaw searched",
}
LOWEST, HIGHEST = 1e-3, 100.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+", metavar="FILE")
    parser.add_argument("--png", default="mass_errors.png")
    options = parser.parse_args()
    records = [record for record in read_records(options.files) if record.scenario == "random"]
    with house_style():
        ax = panels(None, 1, height_in=3.4)[0, 0]
        for row, method in enumerate(METHODS):
            trials = [record.trial for record in records if record.method == method]
            error = np.array([abs(each.percent("M2")) for each in trials])
            given = error[np.isfinite(error)]
            # spread over the row so that no point hides another, in the order of the seeds
            height = row + 0.6 * (np.argsort(np.argsort(np.modf(np.arange(given.size) * 0.618)[0])) / given.size - 0.5)
            color = RUN_COLORS[0] if method == "model" else GREY
            look = {"linestyle": "none", "marker": "o", "markersize": 3.5, "alpha": 0.7}
            ax.plot(np.clip(given, LOWEST, HIGHEST), height, color=color, **look)
            median, tail = np.percentile(given, [50, 95])
            ax.plot([median, median], [row - 0.38, row + 0.38], color=INK, linewidth=2)
            missing = f", {error.size - given.size} without an answer" if given.size < error.size else ""
            median_told, tail_told, worst_told = (
                f"{x:.0f}" if x >= 10 else f"{x:.2g}" for x in (median, tail, given.max())
            )
            text = f"median {median_told} %, 95 % within {tail_told} %, worst {worst_told} %{missing}"
            ax.annotate(text, (1.0, row - 0.42), xycoords=("axes fraction", "data"), ha="right", fontsize=8)
        ax.set_xscale("log")
        ax.set_xlim(LOWEST, HIGHEST)
        plain_numbers(ax.xaxis)
        ax.set_xticks([0.001, 0.01, 0.1, 1, 10, 100])
        ax.set_yticks(range(len(METHODS)), list(METHODS.values()))
        ax.set_ylim(len(METHODS) - 0.45, -0.65)
        ax.set_xlabel("error of the sprung mass [%]")
        n_gears = len({record.trial.seed for record in records})
        ax.set_title(f"The same {n_gears} random gears, two 40 s runs each")
        Path(options.png).write_bytes(png(figure_of(ax)))


if __name__ == "__main__":
    main()
