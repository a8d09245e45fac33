"""The whole of Song et al. (2021) on its own virtual data, beside the paper's numbers: tables 1 to 4, figures 4 to 12.

Run `python benchmarks/song_side_by_side.py OUT`: it prints the tables in Markdown and writes OUT/side_by_side.html with
its figures as PNG. 14 curves of mode 1 and 5 of mode 2 are measured by virtual control-based continuation with noise
(truth: class 2, theta = 1.58, moduli 0.88 and 0.31, 0.3 % modal damping), then both phases run in the paper's form and
in the recommended one. What the paper gives as a picture only is described in words, not in numbers.
"""

import argparse
import base64
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from time import perf_counter
from typing import Any

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from jinja2 import Environment

from opid import plots
from opid.mechanics.backbones.quadrature_curves import MeasuredCurve
from opid.mechanics.backbones.specimen import Specimen
from opid.plots.style import VERMILION
from opid.signals.files import write_together
from opid.studies.updating_study import FACTOR_PRIOR
from opid.updating.identification import update_study
from opid.updating.model_class import PAPER_CLASSES, PAPER_THETA
from opid.updating.result import BackboneBand, ClassPosterior, Updating
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import ReductionErrors, craig_bampton, modes_of, reduction_errors
from opid.updating.study import UpdatingStudy
from opid.virtual.backbone_tests.control_based_continuation import measured_curve
from opid.virtual.backbone_tests.measured import AMPLITUDE_M, BENCH_NOISE, BENDING_MODES, convert_curve
from opid.virtual.backbone_tests.wing_engine import UPDATED, WingEngine, wing_engine_structure

TRUTH = PAPER_CLASSES[1]
CONTROLLED, DRIVE, DAMPING_RATIO = "10", "7", 0.003
CURVES, N_POINTS, LEAST_SHARE = (14, 5), 20, 0.9
PYLONS = ("9", "10", "11", "12", "13", "14")
FORMS = {"paper": (1,), "recommended": (1, 3)}
HEADINGS = {"paper": "paper's form", "recommended": "recommended form"}
FUNCTIONS = {
    "class 1": "c 0.216 sign(x) x²", "class 2": "c 0.068 x³", "class 3": "c 0.03 sign(x) x⁴",
    "class 4": "c₁ 0.0884 x³ − c₂ 0.0027 sign(x) x⁴", "class 5": "c₁ 0.0748 x³ − c₂ 0.00084 x⁵",
}  # fmt: skip
# Song Tables 1 to 4
PAPER_LINEAR = {"E_aluminium": (0.88, 3.93e-3), "E_steel": (0.31, 0.39e-3)}
PAPER_MODES = ((22.78, 14.75, 14.65, 0.788, 0.999), (30.91, 17.50, 17.71, 0.968, 0.985))
PAPER_EVIDENCE = {"class 1": 452.9, "class 2": 619.2, "class 3": 476.8, "class 4": 617.2, "class 5": 617.1}
PAPER_STD = {
    "class 1": (0.017,), "class 2": (0.016,), "class 3": (0.012,), "class 4": (0.046, 0.443),
    "class 5": (0.049, 0.391),
}  # fmt: skip

# classes 4 and 5 hold the truth, with a second coefficient of 0
TRUE = {"class 2": (1.58,), "class 4": (1.58 * 0.068 / 0.0884, 0.0), "class 5": (1.58 * 0.068 / 0.0748, 0.0)}

Table = list[list[str]]


@dataclass(frozen=True, eq=False)
class Figure:
    """One figure of the paper: what it shows there, what is shown here, and pictures (heading, PNG)."""

    title: str
    there: str
    here: str
    pictures: tuple[tuple[str, bytes], ...]


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def measured(specimen: Specimen, seed: int) -> Iterator[MeasuredCurve]:
    """The curves that reach quadrature, the pylons first, up to the number of the paper's."""
    rng = np.random.default_rng(seed)
    for mode, (least, most), wanted in zip(BENDING_MODES, AMPLITUDE_M, CURVES, strict=True):
        reached = 0
        for sensor in reversed(specimen.system.sensors):
            if reached == wanted:
                break
            curve = measured_curve(
                specimen, mode=mode, sensor=sensor, controlled_sensor=CONTROLLED, rng=rng, noise=BENCH_NOISE,
                amplitude=np.linspace(least, most, N_POINTS),
            )  # fmt: skip
            n = int(curve.converged.sum())
            say(f"mode {mode}: quadrature at sensor {sensor}, {n} of {N_POINTS} levels {curve.reason}")
            if n >= LEAST_SHARE * N_POINTS:
                reached += 1
                yield curve


def updated(structure: AffineStructure, curves: Sequence[MeasuredCurve], form: str, seed: int) -> Updating:
    """Both phases in one form of the likelihood."""
    study = UpdatingStudy(
        "Song et al. (2021) on virtual data", structure, tuple(convert_curve(curve, DRIVE) for curve in curves),
        PAPER_CLASSES, parameters=dict.fromkeys(UPDATED, FACTOR_PRIOR), form=form, harmonics=FORMS[form], seed=seed,  # type: ignore[arg-type]
    )  # fmt: skip
    begun = perf_counter()
    result = update_study(study)
    say(f"{HEADINGS[form]}: {perf_counter() - begun:.1f} s, {result.best_class} is best")
    return result


def paired(mean: Any, std: Any) -> str:
    return f"{float(mean):.3f} ± {float(std):.3g}"


def of(value: float | None) -> float:
    return float("nan") if value is None else value


def table_1(results: dict[str, Updating]) -> Table:
    table = [["share of nominal", "paper", *(HEADINGS[form] for form in results), "truth"]]
    for name, (mean, std) in PAPER_LINEAR.items():
        found = [result.linear.estimates[name] for result in results.values() if result.linear]
        here = [paired(of(each.value), of(each.std)) for each in found]
        table.append([name, f"{mean:.2f} ± {std:.3g}", *here, f"{UPDATED[name]:g}"])
    return table


def table_2(results: dict[str, Updating]) -> Table:
    heads = ["initial Hz", "updated Hz", "identified Hz", "initial MAC", "updated MAC"]
    table = [["mode, source", *heads]]
    for number, paper in enumerate(PAPER_MODES):
        table.append([f"{number + 1}, paper", *(f"{value:.2f}" for value in paper[:3]), *(str(v) for v in paper[3:])])
        for form, result in results.items():
            if result.linear:
                row = result.linear.modes[number]
                hz = (row.initial_hz, row.updated_hz, row.identified_hz)
                macs = (f"{row.initial_mac:.4f}", f"{row.updated_mac:.4f}")
                table.append([f"{number + 1}, {HEADINGS[form]}", *(f"{value:.3f}" for value in hz), *macs])
    return table


def table_3(results: dict[str, Updating]) -> Table:
    heads = ["paper", "paper less class 2", *(HEADINGS[form] for form in results)]
    table = [["class", "force, N and mm", *heads]]
    for number, (name, value) in enumerate(PAPER_EVIDENCE.items()):
        here = [r.classes[number].log_evidence - r.classes[1].log_evidence for r in results.values()]
        there = [f"{value:.1f}", f"{value - PAPER_EVIDENCE['class 2']:.1f}"]
        table.append([name, FUNCTIONS[name], *there, *(f"{difference:.1f}" for difference in here)])
    return table


def table_4(results: dict[str, Updating]) -> Table:
    table = [["parameter", "paper", *(HEADINGS[form] for form in results), "truth"]]
    for number, (name, means) in enumerate(PAPER_THETA.items()):
        for k, mean in enumerate(means):
            found = [result.classes[number].estimates[f"theta_{k + 1}"] for result in results.values()]
            here = [paired(of(each.value), of(each.std)) for each in found]
            truth = f"{TRUE[name][k]:.3f}" if name in TRUE else "-"
            table.append([f"{name}, c{k + 1}", f"{mean:.2f} ± {PAPER_STD[name][k]:g}", *here, truth])
    return table


def png(axes: Any) -> bytes:
    return plots.png(plots.figure_of(axes))


def measured_figure(curves: Sequence[MeasuredCurve], mode: int, number: int, there: str, beside: str) -> Figure:
    """Backbones of a mode at the pylons, with the first harmonic and with all seven."""
    own = [curve for curve in curves if curve.mode == mode]
    grid = plots.measured_backbones([convert_curve(curve, DRIVE) for curve in own], mode, sensors=PYLONS)
    phase = np.exp(2j * np.pi * np.outer(np.arange(1, 8), np.arange(128) / 128))
    for ax, sensor in zip(grid.ravel(), PYLONS, strict=True):
        # the unit of the axis is that of the plot function
        factor = 1e6 if "µm" in ax.get_ylabel() else 1e3
        for curve in own:
            motion = (curve.harmonics[curve.converged, curve.sensors.index(sensor)] @ phase).real
            ax.plot(
                curve.frequency_hz[curve.converged], factor * np.abs(motion).max(axis=1), color=VERMILION,
                linewidth=0.8, linestyle="--",
            )  # fmt: skip
        ax.set_ylim(0, None)
    ax = grid[0, 0]
    styles = (ax.lines[0].get_color(), "-"), (VERMILION, "--")
    handles = [ax.plot([], [], color=color, linestyle=style)[0] for color, style in styles]
    ax.legend(handles, ["first harmonic", "largest of all seven"], loc="lower right", fontsize=7)
    held = np.linspace(*AMPLITUDE_M[BENDING_MODES.index(mode)], N_POINTS)[1:-1]
    backbones = [convert_curve(curve, DRIVE) for curve in own]
    hz = np.array([np.interp(held, one.controlled_amplitude, one.frequency_hz) for one in backbones])
    first = np.array([one.frequency_hz[0] for one in backbones])
    top = np.abs(np.mean([one.amplitude[-1] for one in backbones], axis=0))
    ratio = [top[int(tip) - 1] / top[int(root) - 1] for tip, root in (("10", "9"), ("13", "12"))]
    third = [np.abs(c.harmonics[:, 9, 2] / c.harmonics[:, 9, 0])[c.converged] for c in own]
    worst = max(range(len(own)), key=lambda k: third[k].max())
    at = own[worst].frequency_hz[own[worst].converged][int(np.argmax(third[worst]))]
    last = np.mean([one.frequency_hz[-1] for one in backbones])
    names = ", ".join(curve.sensor for curve in own)
    here = (
        f"{len(own)} curves (quadrature at {names}). They begin at {first.mean():.2f} Hz ({first.min():.3f} to "
        f"{first.max():.3f}) and end at {last:.2f} Hz; at one amplitude they scatter by "
        f"{100 * (hz.std(axis=0, ddof=1) / hz.mean(axis=0)).mean():.3f} % of the frequency. Sensors 10 and 13 move "
        f"{ratio[0]:.2g} and {ratio[1]:.2g} times as far as 9 and 12. The third harmonic at sensor 10 is at most "
        f"{100 * third[worst].max():.2g} % of the first, at {at:.2f} Hz. {beside}"
    )
    return Figure(f"Figure {number}. Measured backbones of mode {number - 3}", there, here, (("measured", png(grid)),))


def linear_figure(results: dict[str, Updating]) -> Figure:
    pictures, texts = [], []
    for form, result in results.items():
        linear = result.linear
        if linear is None:
            continue
        truth = [UPDATED[name] for name in linear.names]
        pictures.append(
            (f"{HEADINGS[form]}, (a)", png(plots.parameter_samples(linear.samples, linear.names, truth=truth)))
        )
        pictures.append((f"{HEADINGS[form]}, (b)", png(plots.running_moments(linear.samples, linear.names))))
        found = "; ".join(f"{n} {paired(of(e.value), of(e.std))}" for n, e in linear.estimates.items())
        texts.append(f"{HEADINGS[form]}: {len(linear.samples)} samples, {found}")
    there = (
        "3500 samples, 500 dropped. (a) scatter of both factors around 0.88 and 0.31, along the contours of a "
        "Gaussian; (b) running mean and standard deviation, which settle (final ones in table 1: 3.93e-3 and 0.39e-3)."
    )
    return Figure("Figure 6. Samples of the linear parameters", there, ". ".join(texts) + ".", tuple(pictures))


def reduction_picture(errors: ReductionErrors, n_dof: tuple[int, int]) -> Figure:
    error, mac = 100 * np.abs(errors.relative), np.asarray(errors.mac)
    there = (
        "29 degrees of freedom instead of 6876. Frequencies, their errors and MAC over the modes: very good for the "
        "first 9 modes, much worse above."
    )
    here = (
        f"{n_dof[1]} degrees of freedom instead of {n_dof[0]}. Modes 1 to 6 are of the suspension. Largest frequency "
        f"error of the first 9 vibration modes (7 to 15) {error[6:15].max():.2g} %, least MAC "
        f"{mac[6:15].min():.5f}; of modes 16 to 22 {error[15:].max():.2g} % and {mac[15:].min():.2f} (with the mode of "
        "the same number; a cross where another is more alike)."
    )
    drawn = (("fixed-interface Craig-Bampton", png(plots.reduction_figure(errors))),)
    return Figure("Figure 7. Reduced and whole structure", there, here, drawn)


def class_figure(results: dict[str, Updating], number: int, names: Sequence[str], there: str) -> Figure:
    pictures, texts = [], []
    for name in names:
        k = [each.name for each in PAPER_CLASSES].index(name)
        for form, result in results.items():
            each = result.classes[k]
            shown = plots.parameter_samples(each.samples, each.labels, truth=TRUE.get(name))
            pictures.append((f"{name}, {HEADINGS[form]}", png(shown)))
            texts.append(f"{name}, {HEADINGS[form]}: {moments(each)}")
    if number == 8:
        for form, result in results.items():
            each = result.classes[0]
            drawn = png(plots.running_moments(each.samples, each.labels))
            pictures.append((f"class 1, {HEADINGS[form]}, (b)", drawn))
    title = f"Figure {number}. Samples of {' and '.join(names)}"
    return Figure(title, there, "; ".join(texts) + ".", tuple(pictures))


def moments(each: ClassPosterior) -> str:
    values = ", ".join(paired(of(e.value), of(e.std)) for e in each.estimates.values())
    if len(each.estimates) < 2:
        return values
    return f"{values}, correlation {np.asarray(np.corrcoef(each.samples.T))[0, 1]:.3f}"


def prediction_figure(results: dict[str, Updating], mode: int, number: int, there: str) -> Figure:
    pictures, texts = [], []
    for form, result in results.items():
        grid = plots.predicted_backbones(result.prediction, result.measured, mode)
        pictures.append((HEADINGS[form], png(grid)))
        bands = {band.mode: band for band in result.prediction}
        texts.append(f"{HEADINGS[form]}: {band_text(bands[mode], result)}")
    title = f"Figure {number}. Predicted backbones of mode {number - 10} with 95 % bands"
    return Figure(title, there, ". ".join(texts) + ".", tuple(pictures))


def band_text(band: BackboneBand, result: Updating) -> str:
    width = 100 * (band.high_hz - band.low_hz) / band.frequency_hz
    out = []
    for curve in (curve for curve in result.measured if curve.mode == band.mode):
        low, high = (np.interp(curve.controlled_amplitude, band.amplitude, end) for end in (band.low_hz, band.high_hz))
        inside = ((curve.frequency_hz >= low) & (curve.frequency_hz <= high)).mean()
        if inside < 0.9:
            out.append(f"{curve.name.rsplit(' ', 1)[1]} ({100 * inside:.0f} %)")
    beyond = (
        f"less than 90 % of them at quadrature of sensor {', '.join(out)}" if out else "at least 90 % of each curve"
    )
    return (
        f"{result.best_class} predicts; {100 * band.coverage:.0f} % of the points within, {beyond}; the band is "
        f"{width[0]:.2f} % of the frequency wide at the smallest amplitude and {width[-1]:.2f} % at the largest"
    )


def figures(
    curves: Sequence[MeasuredCurve],
    results: dict[str, Updating],
    errors: ReductionErrors,
    n_dof: tuple[int, int],
    leaf_asymmetry: float,
) -> Iterator[Figure]:
    yield measured_figure(
        curves, BENDING_MODES[0], 4,
        "14 curves, one for each sensor in quadrature, over sensors 9 to 14; identified at 14.65 Hz at the lowest "
        "level. Sensors 10, 11, 13 and 14 move an order of magnitude farther than 9 and 12. With all seven harmonics "
        "the amplitude peaks near 15.3 Hz, where the mode interacts with a higher one.",
        "The leaf springs of the pylons are unequal: an interaction near 15.3 Hz is there, narrow beside these levels."
        if leaf_asymmetry
        else "The pylons are symmetric here: there is no interaction near 15.3 Hz.",
    )  # fmt: skip
    yield measured_figure(
        curves, BENDING_MODES[1], 5,
        "5 curves; the other nine sensors do not reach quadrature within 5e-3 rad. Identified at 17.71 Hz at the "
        "lowest level. "
        "The curves scatter more than those of mode 1.",
        "As many curves as in the paper, the pylons first. Three times 19.37 Hz is the thirteenth mode: the curves "
        "part as "
        "they come near it.",
    )  # fmt: skip
    yield linear_figure(results)
    yield reduction_picture(errors, n_dof)
    settings = "5500 samples, 500 dropped, by Metropolis-Hastings. "
    yield class_figure(
        results, 8, ("class 1",), settings + "(a) histogram with its Gaussian, 1.63 ± 0.017; (b) running mean and "
        "standard deviation, which settle.",
    )  # fmt: skip
    yield class_figure(
        results, 9, ("class 2", "class 3"), settings + "Histograms with their Gaussians: class 2 1.58 ± 0.016, class 3 "
        "1.09 ± 0.012.",
    )  # fmt: skip
    yield class_figure(
        results, 10, ("class 4", "class 5"), settings + "Scatter with contours of the Gaussian: class 4 1.34 ± 0.046 "
        "and 1.26 ± 0.443, class 5 1.49 ± 0.049 and 0.51 ± 0.391; both pairs strongly correlated (no number is given).",
    )  # fmt: skip
    yield prediction_figure(
        results, BENDING_MODES[0], 11, "200 draws of class 2, the band from the 6th to the 195th of them; the measured "
        "curves lie within in general, those of sensors 9 and 13 slightly outside.",
    )  # fmt: skip
    yield prediction_figure(
        results, BENDING_MODES[1], 12, "200 draws of class 2; the band is wider than that of mode 1, as the curves "
        "scatter more; they lie within in general.",
    )  # fmt: skip


PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Song et al. (2021), side by side</title>
<style>{{ style }}
  body { max-width: 76rem; } p { max-width: none; }
  .two { display: grid; grid-template-columns: 1fr 1fr; gap: 0 2rem; align-items: start; }
  .two img { max-width: 100%; } .one img { max-width: 52rem; }
  @media (max-width: 50rem) { .two { grid-template-columns: 1fr; } }
</style></head><body>
<h1>Song et al. (2021), side by side</h1>
<p class="quiet">The paper's measurement, updating and prediction on virtual data. Left: what the paper says. Right, and
in the pictures: what is found here, on a finite-element surrogate of its structure.</p>
<p>{{ basis }}</p>
{% for title, table in tables %}
<section><h2>{{ title }}</h2><div class="scroll"><table>
<thead><tr>{% for cell in table[0] %}<th>{{ cell }}</th>{% endfor %}</tr></thead>
<tbody>{% for row in table[1:] %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>{% endfor %}</tbody>
</table></div></section>
{% endfor %}
{% for figure in figures %}
<section><h2>{{ figure.title }}</h2>
<div class="two"><p><strong>Paper.</strong> {{ figure.there }}</p><p><strong>Here.</strong> {{ figure.here }}</p></div>
<div class="{{ 'two' if figure.pictures|length > 1 else 'one' }}">{% for heading, image in figure.pictures %}
<figure><figcaption class="quiet">{{ heading }}</figcaption>
<img alt="{{ figure.title }}, {{ heading }}" src="data:image/png;base64,{{ image|base64 }}"></figure>
{% endfor %}</div></section>
{% endfor %}
</body></html>
"""


def page(basis: str, tables: dict[str, Table], drawn: Sequence[Figure]) -> bytes:
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["base64"] = lambda image: base64.b64encode(image).decode()
    style = resources.files("opid.report").joinpath("templates", "style.css").read_text(encoding="utf-8")
    template = environment.from_string(PAGE)
    return template.render(style=style, basis=basis, tables=tables.items(), figures=drawn).encode()


def markdown(title: str, table: Table) -> str:
    lines = [f"| {' | '.join(row)} |" for row in table]
    return "\n".join([f"\n{title}\n", lines[0], "|" + "---|" * len(table[0]), *lines[1:]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="a directory")
    parser.add_argument("--seed", type=int, default=0, help="of noise and sampling")
    parser.add_argument("--leaf-asymmetry", type=float, default=0.0, help="of the pylons' leaf springs, 0.05 say")
    args = parser.parse_args()
    begun = perf_counter()
    structure = wing_engine_structure(WingEngine(leaf_asymmetry=args.leaf_asymmetry))
    reduced = craig_bampton(structure, UPDATED)
    system = modes_of(reduced)
    laws = tuple(TRUTH.laws(system.joints, PAPER_THETA[TRUTH.name]).values())
    specimen = Specimen(system, laws, DAMPING_RATIO, DRIVE)
    curves = list(measured(specimen, args.seed))
    measuring = perf_counter() - begun
    say(f"{len(curves)} curves in {measuring:.0f} s")
    results = {form: updated(structure, curves, form, args.seed) for form in FORMS}
    tables = {
        "Table 1. Linear parameters": table_1(results),
        "Table 2. Linear modes before and after": table_2(results),
        "Table 3. Log evidence of the classes, here less that of class 2": table_3(results),
        "Table 4. Coefficients": table_4(results),
    }
    for title, table in tables.items():
        print(markdown(title, table))
    errors = reduction_errors(structure, reduced, 22, factors=UPDATED)
    drawn = []
    for figure in figures(curves, results, errors, (structure.n_dof, reduced.n_dof), args.leaf_asymmetry):
        say(figure.title)
        print(f"\n{figure.title}. Paper: {figure.there} Here: {figure.here}")
        drawn.append(figure)
    of_mode = [sum(curve.mode == mode for curve in curves) for mode in BENDING_MODES]
    taken = perf_counter() - begun
    basis = (
        f"{of_mode[0]} and {of_mode[1]} curves of {N_POINTS} levels by virtual control-based continuation with noise, "
        f"seed {args.seed}; one force at sensor {DRIVE}, {100 * DAMPING_RATIO:g} % damping. Truth: "
        f"leaf asymmetry {args.leaf_asymmetry:g}, {TRUTH.name}, coefficient {TRUE['class 2'][0]:g}, factors of both "
        "moduli 0.88 and 0.31. The paper's form takes one harmonic, the recommended one two. The paper's modes "
        "1 and 2 are the seventh and eighth here, after six of the suspension. "
        f"Measured in {measuring:.0f} s, all in {taken:.0f} s."
    )
    names = [f"figure_{number}" for number in range(4, 13)]
    files = {
        f"{name}{chr(ord('a') + k) if len(figure.pictures) > 1 else ''}.png": image
        for name, figure in zip(names, drawn, strict=True)
        for k, (_, image) in enumerate(figure.pictures)
    }
    write_together(args.out, {"side_by_side.html": page(basis, tables, drawn), **files})
    print(f"\n{basis}\n{args.out / 'side_by_side.html'}")


if __name__ == "__main__":
    main()
