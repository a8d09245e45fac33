"""Records of structures measured on both sides of their suspensions: what is told of them, and how far.

Run `python benchmarks/real_records.py --data ../shared/data`; in parts `--sets shake_table_frame`. The studies are the
files in `examples/real_records`, their logs those that `examples/real_records.py` writes. Sets whose records are
repeated trials are identified record by record, with a row that says how far the answers agree and what was aimed at,
and all at once, as the others are. "Unexplained" is what the free motion leaves of
the body's rms acceleration in the band, "left out" the same of a run that the others predict, "inside" its lines inside
the band that is to hold 95 %. Frequencies and damping ratios are those of the equivalent straight suspension.

With `--as-recorded` the studies are those of docs/real_records.md that name the files of a set as they are: each record
alone, with the law `linear` and with a law that is searched, and how far lags and angles of the sensors agree.
"""

import argparse
import os
import re
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
import tomli_w
from harness import table_head, table_row

import opid

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from real_records import SETS, read_set, records_of

# laws that are given, None to search one; whether each record is identified alone, too
CASES = {
    "isolated_building": (("linear", "dahl_friction", "arctan_displacement+dahl_friction", None), False),
    "shake_table_frame": (("linear", None), True),
    "flexible_frame": (("linear", None), False),
    "sliding_isolators": (("linear", "coulomb_friction", "dahl_friction"), False),
    "quarter_car_bench": (("linear", "coulomb_friction", "dahl_friction"), False),
}
# what is asked of a set, and what is aimed at, in the columns of the table; nothing of the others
ASKED = {
    "isolated_building": "| asked (aim) | | not refused | | | | | 0.22 (0.15) | 90 | |",
}
# of repeated trials: between the highest and the lowest frequency over their mean, and between the lags, s
AIMED_FREQUENCY, AIMED_LAG_S, AIMED_ANGLE_DEG = 0.005, 0.2e-3, 0.5

DOCS = Path(__file__).parents[1] / "docs" / "real_records.md"
# the folder of each study that names files as they were recorded, and the band in which the set tells of its suspension
AS_RECORDED = {
    "friction frame, as recorded": ("friction_frame", None),
    "quarter car, as recorded": ("quarter_car_bench", None),
    "stiff frame, as recorded": ("shake_table_frame", (0.5, 30.0)),
    "stiff frame, as exported": ("shake_table_frame", (0.5, 30.0)),
    "flexible frame, as recorded": ("shake_table_frame", (0.5, 6.0)),
}


def print_rows(name: str, data: Path) -> None:
    """Print a row for each record of a set under each law, below what is asked of it."""
    laws, alone = CASES[name]
    if name in ASKED:
        print(ASKED[name])
    for law in laws:
        if alone:
            print_agreement([print_answer(name, data, law, (record,)) for record in records_of(name)])
        print_answer(name, data, law)


def print_answer(
    name: str, data: Path, law: str | None, records: tuple[str, ...] = ()
) -> opid.suspensions.Identification:
    """Print a row for each record that is identified, those of the study where none are given; return the answer."""
    study = read_set(name, data, records)
    begun = time.process_time()
    found = opid.identify(study, law=law, band_hz=SETS[name].band_hz)
    busy_s = time.process_time() - begun
    left_out = {each.run: each for error in _errors(found) for each in error.left_out}
    lag = found.evidence[0].fit.value("lag_s")
    for place, run in enumerate(found.runs):
        (frequency, ratio), other = _swing(found, place), left_out.get(place)
        cells = (
            run.name + (" (alone)" if records else ""),
            f"`{found.law.name}`" if law else f"`{found.law.name}` (searched)",
            (found.limited_by or "-") + (", refused" if found.is_refused else ""),
            _shown(frequency),
            _shown(ratio),
            f"{1e3 * lag:.2f}" if lag else "-",
            f"{run.unexplained:.3f}",
            "-" if other is None else f"{other.unexplained:.3f}",
            "-" if other is None else f"{100 * other.inside:.0f}",
            f"{busy_s:.1f}",
        )
        print(table_row(*cells), flush=True)
    return found


def print_agreement(answers: list[opid.suspensions.Identification]) -> None:
    """Print a row that says how far records that were identified alone agree, with the aims."""
    frequencies = np.array([_swing(each)[0].value for each in answers], dtype=float)
    lags_s = [each.evidence[0].fit.value("lag_s") for each in answers]
    laws = len({each.law.name for each in answers})
    apart = np.ptp(frequencies) / frequencies.mean()
    print(
        f"| between them | {laws} {'law' if laws == 1 else 'laws'} (aim 1) | - | {100 * apart:.2f} % (aim "
        f"{100 * AIMED_FREQUENCY:g} %) | - | {1e3 * np.ptp(lags_s):.2f} (aim {1e3 * AIMED_LAG_S:g}) | - | - | - | - |",
        flush=True,
    )


def _swing(found: opid.suspensions.Identification, place: int = 0) -> tuple[opid.Estimate, opid.Estimate]:
    """Natural frequency and damping ratio of the equivalent straight suspension of a run."""
    told = found.equivalents[place] if found.equivalents else found.ratios
    return told.natural_frequency_hz, told.damping_ratio


def _errors(found: opid.suspensions.Identification) -> list:
    return [each.error for each in found.evidence if each.error is not None]


def _shown(estimate: opid.Estimate) -> str:
    if estimate.value is None:
        return "-"
    return f"{estimate.value:.4g}" + (f" ({1.96 * estimate.std:.2g})" if estimate.std is not None else "")


def _swing_of_law(found: opid.suspensions.Identification) -> tuple[opid.Estimate, opid.Estimate]:
    """Natural frequency and damping ratio of a law that is linear, or of the equivalent suspension of another one."""
    return (found.ratios.natural_frequency_hz, found.ratios.damping_ratio) if not found.law.terms else _swing(found)


def _with_interval(estimate: opid.Estimate) -> str:
    """Half of the interval in brackets; a value whose interval is withheld says nothing."""
    return "-" if estimate.std is None else _shown(estimate)


def studies_as_recorded() -> dict[str, str]:
    """Return the text of each study of the docs that names files as they were recorded, by its title."""
    blocks = re.findall(r"```toml\n(title = .*?)```", DOCS.read_text(encoding="utf-8"), re.S)
    texts = {tomllib.loads(text)["title"]: text for text in blocks}
    return {title: texts[title] for title in AS_RECORDED}


def studies_of_records(text: str, folder: Path) -> Iterator[tuple[str, dict]]:
    """Yield the name and the study of each record of a folder alone, as a study says, with the files where they are."""
    document = tomllib.loads(text)
    pattern = document["channels"]["unsprung"]["file"]
    begin, end = pattern.split("{run}")
    for each in document["channels"].values():
        each["file"] = str(folder.resolve() / each["file"])
    for path in sorted(folder.glob(pattern.replace("{run}", "*"))):
        name = path.name[len(begin) : len(path.name) - len(end)]
        yield name, document | {"runs": [document["runs"][0] | {"name": name}]}


def identify_document(
    document: dict, law: str | None, band_hz: tuple[float, float] | None
) -> opid.suspensions.Identification:
    """Identify a study from its file alone."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "study.toml"
        path.write_text(tomli_w.dumps(document), encoding="utf-8")
        options = {} if band_hz is None else {"band_hz": band_hz}
        return opid.identify(opid.read_study(path), law=law, **options)


def angle_deg(found: opid.suspensions.Identification) -> float | None:
    """Return how far the upper of two three-axis sensors is turned about the vertical against the lower one."""
    mounted = found.study.runs[0].orientations
    if not mounted:
        return None
    headings = [np.arctan2(each.along[1], each.along[0]) for each in (mounted["unsprung"], mounted["sprung"])]
    return float(np.degrees(headings[0] - headings[1]))


def print_as_recorded(data: Path) -> None:
    """Print a row for each record that a study names as it is, and how far the records of a set agree."""
    titles = ("record", "law", "limited by, or why not", "lag, ms", "angle, degrees", "frequency, Hz")
    print(table_head(*titles, "damping ratio", "unexplained", "processor, s"))
    for title, text in studies_as_recorded().items():
        folder, band_hz = AS_RECORDED[title]
        for law in ("linear", None):
            lags_ms, angles = [], []
            for name, document in studies_of_records(text, data / folder):
                begun = time.process_time()
                found = identify_document(document, law, band_hz)
                busy_s = time.process_time() - begun
                lag_ms, angle = 1e3 * found.evidence[0].fit.value("lag_s"), angle_deg(found)
                if found.study.runs[0].clocks:
                    lag_ms -= 1e3 * found.study.runs[0].clocks[0].offset_s
                cells = (
                    f"{title.replace(', as', ' as')}, {name}",
                    f"`{found.law.name}`" if law or found.is_refused else f"`{found.law.name}` (searched)",
                    found.not_determined if found.is_refused else found.limited_by or "-",
                    "-" if found.is_refused else f"{lag_ms:.2f}",
                    "-" if angle is None else f"{angle:.2f}",
                    *(_with_interval(each) for each in _swing_of_law(found)),
                    f"{found.runs[0].unexplained:.2f}",
                    f"{busy_s:.1f}",
                )
                print(table_row(*cells), flush=True)
                if not found.is_refused:
                    lags_ms.append(lag_ms)
                    angles += [] if angle is None else [angle]
            if len(lags_ms) > 1:
                turned = f"{np.ptp(angles):.2f} (aim {AIMED_ANGLE_DEG:g})" if angles else "-"
                told = f"{np.ptp(lags_ms):.2f} (aim {1e3 * AIMED_LAG_S:g})"
                print(table_row("between them", "", "", told, turned, "", "", "", ""), flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds the sets")
    parser.add_argument("--sets", help=f"names joined by commas, of {', '.join(CASES)}; all where left out")
    parser.add_argument("--as-recorded", action="store_true", help="studies that name the files of a set as they are")
    options = parser.parse_args()
    if options.as_recorded:
        print_as_recorded(options.data)
        return
    titles = ("record", "law", "limited by", "frequency, Hz", "damping ratio", "lag, ms", "unexplained", "left out")
    print(table_head(*titles, "inside, %", "processor, s"))
    for name in options.sets.split(",") if options.sets else CASES:
        print_rows(name, options.data)


if __name__ == "__main__":
    main()
