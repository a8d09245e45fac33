"""The figures of merit of `method = "model"` beside the classical chain and two plain ones, as a Markdown table.

Run `python benchmarks/model_figures.py`: it simulates every scenario of `scenarios.py` for all its seeds and takes
an hour or more. In parts:

    python benchmarks/model_figures.py --rows nominal,bound --seeds 10
    python benchmarks/model_figures.py --rows random --jobs 2 --out random.jsonl
    python benchmarks/model_figures.py --from random.jsonl nominal.jsonl

Seeds count from 0 and none is dropped: what was refused or not determined is counted beside the figures of the rest.
With `--out` each trial is written as it ends, and what the file holds already is not run again. `--law given` tells
opid the law wherever it is otherwise searched. The plain least squares (`plain_chain.py`) always knows the law, pysindy
always searches it, and neither gives intervals.
"""

import argparse
import os
import sys
from collections import Counter
from collections.abc import Callable, Sequence

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from campaign import Record, as_line, missing_jobs, read_records, read_timings, run_jobs
from harness import quantiles, read_names, share, short, table_head, table_row
from identification import REFUSAL, Timing, timings
from scenarios import FAULTS, SCENARIOS
from trials import METHODS, PLAIN, Trial

TITLES = {
    "model": "opid, model",
    "classical": "opid, classical",
    "least squares": "integrate and least squares, law known",
    "pysindy": "integrate and pysindy",
}
WRONG_MINIMUM_PERCENT = 2.0


class Trials:
    """The trials of one scenario by one method, and the figures that are made of them."""

    def __init__(self, records: Sequence[Record]) -> None:
        self.all = [record.trial for record in records]
        self.bounds = [record.bound for record in records]
        self.given = [each for each in self.all if each.reason is None and np.isfinite(each.error["M2"])]

    def percents(self, name: str) -> np.ndarray:
        """Errors in %, of the trials in which the mass is given and the parameter is estimated."""
        values = [100 * each.error[name] / each.truth[name] for each in self.given if name in each.truth]
        return np.array([value for value in values if np.isfinite(value)])

    def with_failures(self, text: str) -> str:
        failed, crashed = len(self.all) - len(self.given), sum(each.crashed for each in self.all)
        text += f" ({failed} of {len(self.all)} without an answer)" if failed else ""
        return f"{text} ({crashed} crashed)" if crashed else text

    def quantiles(self, name: str, *shares: float) -> str:
        """Of the absolute errors in %, 0.5 the median and 1 the worst."""
        return self.with_failures(quantiles(self.percents(name), *shares))

    def spread(self, name: str) -> str:
        """Standard deviation of the error in %, and the mean where it is more than three of its deviations off."""
        errors = self.percents(name)
        if errors.size < 2:
            return "-"
        std = float(errors.std(ddof=1))
        bias = float(errors.mean())
        return short(std) + (f", mean {bias:+.2g}" if abs(bias) > 3 * std / np.sqrt(errors.size) else "")

    def over_bound(self, name: str) -> str:
        """Rms error over the Cramer-Rao bound of the same seed, with the deviation of such a figure."""
        pairs = zip(self.all, self.bounds, strict=True)
        ratio = np.array([t.error[name] / b[name] for t, b in pairs if t in self.given and np.isfinite(t.error[name])])
        if ratio.size < 2:
            return "-"
        rms = float(np.sqrt(np.mean(ratio**2)))
        return self.with_failures(f"{rms:.2f} +- {rms / np.sqrt(2 * ratio.size):.2f}")

    def law_right(self) -> str:
        return share(each.law_right for each in self.all)

    def law_right_by_kind(self) -> str:
        """How often the law is right, kind by kind, and what a wrong one was taken for."""
        found: dict[str, list[Trial]] = {}
        for each in self.all:
            found.setdefault("+".join(sorted(_terms(each))) or "linear", []).append(each)
        said = []
        for kind, own in sorted(found.items()):
            text = f"{kind} {share(each.law_right for each in own)}"
            taken = Counter(
                "no answer" if each not in self.given else each.law_name for each in own if not each.law_right
            )
            text += f" ({', '.join(f'{name} {n}' for name, n in taken.most_common())})" if taken else ""
            said.append(text)
        return "; ".join(said) or "-"

    def law_contained(self) -> str:
        """How often all true terms are among those that were found."""
        return share(_terms(each) <= set(each.law_name.split("+")) for each in self.all)

    def wrong_minima(self) -> str:
        wrong = np.abs(self.percents("M2")) > WRONG_MINIMUM_PERCENT
        seeds = [each.seed for each, is_wrong in zip(self.given, wrong, strict=True) if is_wrong]
        named = f" (seeds {', '.join(map(str, seeds))})" if 0 < len(seeds) < 6 else ""
        return f"{len(seeds)} of {len(self.given)}{named}"

    def not_determined(self) -> str:
        return share(each not in self.given for each in self.all)

    def coverage(self, names: Callable[[Trial], Sequence[str]]) -> str:
        """Share of 95 % intervals that hold the truth, and how many were given."""
        held = [each.holds[name] for each in self.all for name in names(each) if each.holds[name] is not None]
        if not held:
            return "no interval"
        # the deviation of a share, with two cases added on either side so that it is not zero for all or none
        n, near = len(held), (sum(held) + 2) / (len(held) + 4)
        return f"{100 * np.mean(held):.0f} +- {100 * np.sqrt(near * (1 - near) / (n + 4)):.0f} % of {n}"


def _terms(each: Trial) -> set[str]:
    return {name.split(".")[0] for name in each.truth if "." in name}


def _law_parameters(each: Trial) -> list[str]:
    """The parameters of the law; of a law that was not found none can be held."""
    return [name for name in each.truth if "." in name] if each.law_right else []


# a line of the table: its scenario, the case in words, what is asked of it, and the figure made of its trials
Line = tuple[str, str, str, Callable[[Trials], str]]


def mass(trials: Trials) -> str:
    return trials.quantiles("M2", 0.5, 1.0)


def nominal_lines() -> list[Line]:
    friction = "arctan_velocity"
    return [
        ("nominal", "nominal gear, mass: median / worst, %", "0.1 / 0.4; the bound", mass),
        ("nominal", "its K2: standard deviation, %", "0.1; the bound", lambda t: t.spread("K2")),
        ("nominal", "its C2: standard deviation, %", "0.15; the bound", lambda t: t.spread("C2")),
        ("nominal", "its friction force, %", "0.3; the bound", lambda t: t.spread(f"{friction}.amplitude_n")),
        ("nominal", "its friction scale, %", "0.3; the bound", lambda t: t.spread(f"{friction}.scale_m_per_s")),
        ("nominal", "its law right", "-", Trials.law_right),
    ]


def bound_lines() -> list[Line]:
    return [
        ("linear", f"linear gear, {name}: rms error / Cramer-Rao bound", "1.1; 1.03", lambda t, n=name: t.over_bound(n))
        for name in ("M2", "K2", "C2")
    ]


def random_lines() -> list[Line]:
    mass_quantiles = "random gears, mass: median / 95th percentile / worst, %"
    return [
        ("random", mass_quantiles, "0.06 / 0.3 / 1; -", lambda t: t.quantiles("M2", 0.5, 0.95, 1.0)),
        ("random", "their law right", "95 %; 98 %", Trials.law_right),
        ("random", "mass more than 2 % off (wrong minimum)", "-; 0", Trials.wrong_minima),
        ("random", "not determined or refused", "-", Trials.not_determined),
    ]


def all_kinds_lines() -> list[Line]:
    return [
        ("all kinds", "gears of all kinds, law right", "95 %; -", Trials.law_right),
        ("all kinds", "law right by kind (what else was found)", "-", Trials.law_right_by_kind),
        (
            "all kinds",
            "mass: median / 95th percentile / worst, %",
            "-; worst 1",
            lambda t: t.quantiles("M2", 0.5, 0.95, 1.0),
        ),
        ("all kinds", "mass more than 2 % off (wrong minimum)", "-; 0", Trials.wrong_minima),
        ("all kinds", "not determined or refused", "-", Trials.not_determined),
        ("all kinds", "95 % intervals of the mass that hold", "92-98 %; -", lambda t: t.coverage(lambda each: ["M2"])),
    ]


def two_law_lines() -> list[Line]:
    return [
        ("two laws", "two laws at once, both found and no other", "90 %; 97 %", Trials.law_right),
        ("two laws", "both found, perhaps with others", "-", Trials.law_contained),
        ("two laws", "mass: median / 95th percentile / worst, %", "0.15; -", lambda t: t.quantiles("M2", 0.5, 0.95, 1)),
        ("two laws", "mass more than 2 % off (wrong minimum)", "-", Trials.wrong_minima),
    ]


def paper_lines() -> list[Line]:
    lines: list[Line] = []
    for name in ("paper, friction", "paper, travel"):
        case = f"K3 = 1.67e5 N/m, {name.split(', ')[1]} arctangent"
        lines.append((name, f"{case}, mass: median / worst, %", "0.15; 0.05", mass))
        lines.append((name, f"{case}, K3: median / worst, %", "0.3; 0.1", lambda t: t.quantiles("K3", 0.5, 1.0)))
    return lines


def sensor_lines() -> list[Line]:
    lines: list[Line] = []
    for fault in FAULTS:
        asked = "0.5; 0.1" if fault == "all three" else "0.2; 0.1"
        for stated in ("stated", "not stated"):
            case = f"sensors, {fault}, {stated}, mass: median / worst, %"
            lines.append((f"{fault}, {stated}", case, asked if stated == "stated" else "-", mass))
    return lines


def leak_lines() -> list[Line]:
    lines: list[Line] = []
    for recorded, asked in (("recorded", "0.1"), ("not recorded", "-")):
        scenario, case = f"leak, {recorded}", f"cross-axis leak 3 %, fore-aft {recorded}"
        lines.append((scenario, f"{case}, mass: median / worst, %", asked, mass))
        asked = "95 %" if recorded == "not recorded" else "-"
        lines.append((scenario, f"{case}, interval of the mass holds", asked, lambda t: t.coverage(lambda e: ["M2"])))
    return lines


def coverage_lines() -> list[Line]:
    words = {"M2": ["M2"], "K2": ["K2"], "C2": ["C2"], "law parameters": None}
    return [
        (
            scenario,
            f"95 % intervals that hold, {scenario} gears, {what}",
            "92-98 %; 94-96 %",
            lambda t, n=names: t.coverage(_law_parameters if n is None else lambda each: n),
        )
        for scenario in ("nominal", "random")
        for what, names in words.items()
    ]


ROWS: dict[str, Callable[[], list[Line]]] = {
    "nominal": nominal_lines,
    "bound": bound_lines,
    "random": random_lines,
    "all kinds": all_kinds_lines,
    "two": two_law_lines,
    "paper": paper_lines,
    "sensors": sensor_lines,
    "leak": leak_lines,
    "coverage": coverage_lines,
}


def print_table(
    lines: Sequence[Line], records: Sequence[Record], laws: dict[str, str], measured: Sequence[Timing]
) -> None:
    """Print the lines of which there are trials, then the times."""
    print(table_head("case", "asked: reach; aim", *TITLES.values()))
    for scenario, case, asked, figure in lines:
        cells, n = [], 0
        for method in METHODS:
            own = [r for r in records if r.scenario == scenario and r.method == method]
            own = [r for r in own if method in PLAIN or r.law == laws[scenario]]
            trials = Trials(sorted(own, key=lambda record: record.trial.seed))
            n = max(n, len(trials.all))
            cells.append(figure(trials) if trials.all else "")
        if n:
            print(table_row(f"{case} ({n} seeds, law {laws[scenario]})", asked, *cells))
    way = {(each.method, each.law): each for each in measured}
    asked_for = (("given", "0.4; 0.15"), ("searched", "0.8; -"), (REFUSAL, "5; -"))
    for law, asked in asked_for if way else ():
        own = [way.get((method, law)) for method in METHODS]
        busy = [f"{each.busy_s:.2f}" if each else "" for each in own]
        seconds = [f"{each.seconds:.2f}" if each else "" for each in own]
        memory = [f"{each.peak_mib:.0f}" if each else "" for each in own]
        print(table_row(f"one identification after compilation, law {law}, processor time, s", asked, *busy))
        print(table_row("the same, by the clock on the wall, s", "-", *seconds))
        print(table_row("peak memory of its process, libraries and compiler included, MiB", "-", *memory))


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    known = [*ROWS, "times"]
    parser.add_argument("--rows", help=f"names joined by commas, of {', '.join(known)}; all where left out")
    parser.add_argument("--seeds", type=int, help="of each scenario; where left out, as many as the table asks for")
    parser.add_argument("--law", choices=("given", "searched"), help="for opid, where it is not the scenario's own")
    parser.add_argument("--methods", help=f"names joined by commas, of {', '.join(METHODS)}; all where left out")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", metavar="FILE", help="keep each trial as a line of JSON; what is there is not rerun")
    parser.add_argument("--from", dest="sources", nargs="+", metavar="FILE", help="print from such files, run nothing")
    options = parser.parse_args()
    options.rows = read_names(parser, options.rows, known, "row")
    options.methods = read_names(parser, options.methods, METHODS, "method")
    return options


def main() -> None:
    options = arguments()
    lines = [line for row in options.rows if row in ROWS for line in ROWS[row]()]
    laws = {name: scenario.law for name, scenario in SCENARIOS.items()}
    if options.law:
        # a linear gear has nothing to be bounded once its law is searched
        laws = {name: law if name == "linear" else options.law for name, law in laws.items()}
    if options.sources:
        times = read_timings(options.sources) if "times" in options.rows else []
        print_table(lines, read_records(options.sources), laws, times)
        return
    wanted = {scenario: options.seeds or SCENARIOS[scenario].n_seeds for scenario, *_ in lines}
    kept = [options.out] if options.out and os.path.exists(options.out) else []
    records = read_records(kept)
    with open(options.out or os.devnull, "a") as file:
        for record in run_jobs(missing_jobs(wanted, laws, options.methods, records), n_processes=options.jobs):
            records.append(record)
            if record.trial.crashed:
                print(f"{record.scenario}, seed {record.trial.seed}: {record.trial.reason}", file=sys.stderr)
            print(as_line(record), file=file, flush=True)
        times = []
        for timing in timings() if "times" in options.rows else ():
            times.append(timing)
            print(as_line(timing), file=file, flush=True)
    print_table(lines, [r for r in records if r.trial.seed < wanted.get(r.scenario, 0)], laws, times)


if __name__ == "__main__":
    main()
