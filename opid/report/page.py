"""The report: result.json, a page that opens offline, and its figures, all written or none."""

from __future__ import annotations

import base64
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

from opid.report.as_json import json_text, result_json
from opid.report.as_text import columns, limits, rows
from opid.report.directory import write_together
from opid.suspensions.one_gear.result import Identification
from opid.suspensions.paper.classical import RunEvidence

Truth = Mapping[str, Any]
# takes a result, returns Axes
Draw = Callable[[Any, Truth | None], Any]


@dataclass(frozen=True)
class Picture:
    """One figure of the report.

    Args:
        name: of its PNG file, without the ending.
        heading: what it is about.
        text: what to see in it.
        draw: makes it from the result and the truth of a simulated run.
        of_model: whether only the driven model has it.
    """

    name: str
    heading: str
    text: str
    draw: Draw
    of_model: bool = False


def write_report(
    result: Identification,
    directory: str | os.PathLike[str],
    truth: Truth | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write result.json, report.html and the figures as PNG, and return the path of the page.

    Everything is made before the first file is written, and the files appear together. Files of an older report are
    replaced, any other file in the directory stays.

    Args:
        result: the identification.
        directory: made if it is not there.
        truth: of a simulated run, as in truth.json: shown beside the estimates.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a place that cannot be written to.
    """
    images = drawn(_pictures_of(result), result, truth, progress=progress)
    contents = {f"{name}.png": image for name, image in images.items()}
    contents["report.html"] = _page(result, truth, images).encode()
    # last, so that a result.json is never there without its report
    contents["result.json"] = json_text(result_json(result)).encode()
    write_together(directory, contents)
    return Path(directory) / "report.html"


def pictures() -> tuple[Picture, ...]:
    """Return the figures of the report in the order of the chain."""
    from opid import plots

    return (
        Picture(
            "accelerations",
            "What was recorded",
            "The spindle (grey) follows the road; the airframe above the strut (in colour) moves less and slower. If "
            "the grey signal is the quieter one, the sensors are swapped.",
            lambda result, truth: plots.accelerations(result),
        ),
        Picture(
            "integration",
            "From acceleration to motion",
            "Removing the mean before each integration leaves a parabola that hides the motion, for the mean of a "
            "velocity over a finite run is not its constant of integration. The steps of the paper below rest on "
            "the other curve, which keeps only the band in which the motion can be known; the driven model integrates "
            "no acceleration.",
            lambda result, truth: plots.integration(reference_run(result)),
        ),
        Picture(
            "restoring_force_surface",
            "Restoring force",
            "The force on the sprung mass over travel and velocity, averaged over cells, before any law is assumed. "
            "A linear suspension gives a plane; a step or a bend is the nonlinearity.",
            lambda result, truth: plots.restoring_force_surface(reference_run(result)),
        ),
        Picture(
            "restoring_force_map",
            "The same from above, and where the data are",
            "Left, straight and evenly spaced contours mean a linear law; a kink at zero velocity is friction. Right, "
            "no law is known where no samples are.",
            lambda result, truth: plots.restoring_force_map(reference_run(result)),
        ),
        Picture(
            "slices",
            "Stiffness curve and damping curve",
            "Slices through the surface near zero velocity and near zero travel, with an arctangent fitted to each "
            "and what it leaves over (Figs. 6 and 7 of the paper).",
            lambda result, truth: plots.slices(reference_run(result)),
        ),
        Picture(
            "law_ladder",
            "Which law",
            "Each law is fitted to all runs at once. A good one comes down to the noise floor of the sensors (dashed); "
            "a further term is kept only if it lowers the error, also of a run left out of the fit (diamonds).",
            lambda result, truth: plots.law_ladder(result),
        ),
        Picture(
            "force_sections",
            "The law against the force without a law",
            "Measured force on the predicted motion, less stiffness and damping, averaged in bins near zero velocity "
            "and near zero travel with two standard errors; the line is the law.",
            lambda result, truth: plots.force_sections(result.evidence.model.surface),
            of_model=True,
        ),
        Picture(
            "force_departures",
            "Where the law and the force disagree",
            "Mean measured force less that of the model in each visited cell, in standard errors. Speckle is chance; a "
            "patch of one colour is a term that the law lacks.",
            lambda result, truth: plots.force_departures(result.evidence.model.surface),
            of_model=True,
        ),
        Picture(
            "law_curves",
            "The law that was found",
            "The nonlinear force beside the linear one. Beyond the shaded range, and above all beyond the drawn one, "
            "the law is an extrapolation.",
            lambda result, truth: plots.law_curves(result, truth=truth),
        ),
        Picture(
            "transmissibility",
            "Transmissibility",
            "Ratio of airframe to spindle. With the nonlinear force taken out it should follow the dashed curve of the "
            "fitted suspension, which has one resonance; other peaks of the measured ratio are friction and chance.",
            lambda result, truth: plots.transmissibilities(result),
        ),
        Picture(
            "equation_residual",
            "What is left over",
            "The misfit of the equation of motion, expressed as the sensor noise that would cause it. Near the dashed "
            "line the model explains all that the sensors can show; a hump names the band in which it does not.",
            lambda result, truth: plots.equation_residual(result),
        ),
        Picture(
            "estimates",
            "Every method side by side",
            "Mass from two runs of known mass difference, and the ratios to it, with 95 % intervals. Values beyond the "
            "frame stand at its edge. The peak formula is the paper's; hollow marks come from peaks that the mass "
            "change cannot have moved so.",
            lambda result, truth: plots.estimates(result, truth=truth),
        ),
    )


def reference_run(result: Identification) -> RunEvidence:
    """Return the run without a mass change, or the first one.

    Args:
        result: the identification.
    """
    runs = result.evidence.runs
    return next((run for run in runs if run.mass_change_kg == 0), runs[0])


def drawn(
    pictures: Sequence[Picture], result: Any, truth: Truth | None, *, progress: Callable[[str], None] | None = None
) -> dict[str, bytes]:
    """Return the figures of a report as PNG, by their names.

    Args:
        pictures: to draw.
        result: that they show.
        truth: of a simulation: shown beside it.
        progress: called with the name of each figure as it is drawn.
    """
    from opid.plots.style import figure_of, png

    say = progress or (lambda step: None)
    images: dict[str, bytes] = {}
    for picture in pictures:
        say(f"figure {picture.name}")
        images[picture.name] = png(figure_of(picture.draw(result, truth)))
    return images


def rendered(template: str, images: Mapping[str, bytes], **values: Any) -> str:
    """Return a template of this package filled in, with the figures inside.

    Args:
        template: name of its file.
        images: PNG by the name of the figure: `source` in the template.
        values: what else it names.
    """
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    from opid.plots.style import pretty

    def text(name: str) -> str:
        return resources.files("opid.report").joinpath(name).read_text(encoding="utf-8")

    environment = Environment(
        loader=FunctionLoader(text), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["pretty"] = pretty
    source = {name: "data:image/png;base64," + base64.b64encode(image).decode() for name, image in images.items()}
    return environment.get_template(template).render(source=source, version=version("opid"), **values)


def _pictures_of(result: Identification) -> list[Picture]:
    return [picture for picture in pictures() if result.evidence.model is not None or not picture.of_model]


def _page(result: Identification, truth: Truth | None, images: Mapping[str, bytes]) -> str:
    return rendered(
        "page.html.jinja",
        images,
        title=result.title or "Identification",
        result=result,
        truth=truth,
        columns=columns(truth),
        rows=rows(result, truth),
        limits=limits(result),
        runs=result.diagnostics["runs"],
        pictures=_pictures_of(result),
        command=_command(result),
        python=_python(result),
    )


def _command(result: Identification) -> str:
    """The command that gives this result."""
    settings = result.diagnostics["settings"]
    low, high = settings["band_hz"]
    law = "" if settings["law"] == "searched" else f" --law {settings['law']}"
    ground = "" if settings["ground"] else " --no-ground"
    options = f"--method {result.method} --band {low:g} {high:g} --high-pass {settings['high_pass_hz']:g}"
    if settings["study"]:
        return f"opid identify {settings['study']} {options}{law}{ground}"
    first, *others = result.diagnostics["runs"]
    logs = " ".join(f"{run['name']}.csv" for run in (first, *others))
    changes = "".join(f" --mass-change {run['mass_change_kg'] - first['mass_change_kg']:g}" for run in others)
    channels = f"--sprung {settings['sprung']} --unsprung {settings['unsprung']}{changes}"
    return f"opid identify {logs} {channels} {options}{law}{ground}"


def _python(result: Identification) -> str:
    """The lines of Python that give this result from its study."""
    settings = result.diagnostics["settings"]
    law = "" if settings["law"] == "searched" else f'    law="{settings["law"]}",\n'
    study = f'opid.read_study("{settings["study"]}")' if settings["study"] else "study"
    return f"""import opid

result = opid.identify_study(
    {study},
    method="{result.method}",
{law}    band_hz={tuple(settings["band_hz"])},
    high_pass_hz={settings["high_pass_hz"]},
    ground={settings["ground"]},
)"""
