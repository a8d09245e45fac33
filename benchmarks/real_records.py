"""Records of structures measured on both sides of their suspensions: what is told of them, and how far.

Run `python benchmarks/real_records.py --data ../shared/data`; in parts `--sets shake_table_frame`. The studies are the
files in `examples/real_records`, their logs those that `examples/real_records.py` writes. Sets whose records are
repeated trials are identified record by record, with a row that says how far the answers agree and what was aimed at,
and all at once, as the others are. "Unexplained" is what the free motion leaves of
the body's rms acceleration in the band, "left out" the same of a run that the others predict, "inside" its lines inside
the band that is to hold 95 %. Frequencies and damping ratios are those of the equivalent straight suspension.
"""

import argparse
import os
import sys
import time
from pathlib import Path

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
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
AIMED_FREQUENCY, AIMED_LAG_S = 0.005, 0.2e-3


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


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds the sets")
    parser.add_argument("--sets", help=f"names joined by commas, of {', '.join(CASES)}; all where left out")
    options = parser.parse_args()
    titles = ("record", "law", "limited by", "frequency, Hz", "damping ratio", "lag, ms", "unexplained", "left out")
    print(table_head(*titles, "inside, %", "processor, s"))
    for name in options.sets.split(",") if options.sets else CASES:
        print_rows(name, options.data)


if __name__ == "__main__":
    main()
