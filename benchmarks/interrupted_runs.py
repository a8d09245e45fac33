"""Commands that a signal ends at any moment: how many leave a half result, a mixture of two, or anything else behind.

Run `python benchmarks/interrupted_runs.py --runs 200`, or `--runs 40 --commands law decay --seed 2`. A run takes about
as long as its command; several such scripts may run at once.

Each run starts a command with `--out out --force`, in a directory without `out` or in one with an older result of the
same command and a file of the user, and sends SIGINT, SIGTERM or SIGKILL: in half of the runs at a random time of the
work, in the other half a random time after it has begun to write. Afterwards `out` must be as it was, or as the whole
command leaves it, to the byte; after SIGKILL an older result may be incomplete if result.json (or the like) is missing,
and hidden files may stay, until the next command reserves `out`: then all must be as it was or as it should be. On
stderr there may be one sentence. A campaign keeps the flights that it has finished: each must be whole or absent.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from small_folders import SHORT, give_speeds, write_bench, write_hit

from opid.errors import InputError
from opid.signals.files import reserve_directory

SIGNALS = {name: getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGKILL")}
LATEST_S = 0.1  # after the beginning of the writing; the shortest time is a thousandth of it
LONGEST_S = 500.0
LAW = ("--law", "arctan_velocity")


@dataclass(frozen=True)
class Command:
    """A command that writes, with the words of its older result, those of its new one, and what it needs before."""

    older: tuple[str, ...]
    newer: tuple[str, ...]
    needs: tuple[str, ...] = ()
    last: str = "result.json"
    is_out_named: bool = True

    def words(self, given):
        return [*given, "--out", "out"] if self.is_out_named else [*given, "out"]


def simulated(what, older, newer):
    return Command(("simulate", what, *older), ("simulate", what, *newer), last="study.toml", is_out_named=False)


COMMANDS = {
    "taxi": simulated("taxi", SHORT, (*SHORT, "--seed", "2")),
    "aircraft": simulated("aircraft", SHORT, (*SHORT, "--seed", "2")),
    "backbones": simulated(
        "backbones",
        ("--points", "3", "--curves", "1", "1"),
        ("--points", "4", "--curves", "2", "1", "--matrices", "mtx"),
    ),
    "resonance_logs": simulated("resonance", ("--levels", "3"), ("--levels", "4", "--curves", "1")),
    "inspect": Command(
        ("inspect", "taxi/heavy.csv", "--png"), ("inspect", "taxi/heavy.csv", "taxi/light.csv", "--png"), ("taxi",)
    ),
    "identify": Command(
        ("identify", "taxi/study.toml", *LAW, "--png"),
        ("identify", "taxi/study.toml", "--law", "linear", "--png"),
        ("taxi",),
    ),
    "sense": Command(
        ("sense", "taxi/study.toml", "identified"),
        ("sense", "taxi/study.toml", "identified", "--run", "light"),
        ("taxi", "identified"),
    ),
    "wheel": Command(
        ("wheel", "driven/study.toml", "identified"),
        ("wheel", "driven/study.toml", "identified", "--png"),
        ("taxi", "identified", "driven"),
    ),
    "compare": Command(
        ("compare", "identified", "identified_2"),
        ("compare", "identified", "identified_2", "--false-alarm", "0.01", "--png"),
        ("taxi", "identified", "taxi_2", "identified_2"),
        last="comparison.json",
    ),
    "plan": Command(
        ("plan", "taxi/study.toml", "--target", "sprung_mass=50%", *LAW, "--mass-change", "-200", "--duration", "20"),
        ("plan", "taxi/study.toml", "--target", "sprung_mass=60%", *LAW, "--mass-change", "-200", "--duration", "20"),
        ("taxi",),
    ),
    "law": Command(
        ("law", "bench.csv", "--force-channel", "load", "--travel-channel", "stroke"),
        ("law", "bench.csv", "--force-channel", "load", "--travel-channel", "stroke", "--piston-area", "0.004"),
        ("bench.csv",),
    ),
    "decay": Command(
        ("decay", "hit.csv", "--channel", "az", "--stiffness-order", "3", "--damping-order", "2"),
        ("decay", "hit.csv", "--channel", "az", "--stiffness-order", "1", "--damping-order", "2", "--png"),
        ("hit.csv",),
    ),
    "modes": Command(
        ("modes", "beats/impact_1.csv", "--drive-point", "case_x", "--band", "50", "500"),
        ("modes", "beats/impact_1.csv", "--drive-point", "case_x", "--band", "50", "400", "--png"),
        ("beats",),
    ),
    "modal": Command(("modal", "beats/study.toml"), ("modal", "beats/study.toml", "--damping-order", "2"), ("beats",)),
    "resonance": Command(("resonance", "levels/study.toml"), ("resonance", "levels/study.toml", "--png"), ("levels",)),
    "update": Command(
        ("update", "wing/study.toml", "--samples", "1000", "--sampler", "transitional"),
        ("update", "wing/study.toml", "--samples", "1000", "--sampler", "transitional", "--seed", "3", "--chains"),
        ("wing",),
    ),
    "demo": Command(("demo",), ("demo", "--seed", "2"), last="study.toml"),
    "campaign": Command(("campaign", "fleet", "--workers", "1"), ("campaign", "fleet", "--workers", "1"), ("fleet",)),
}

MADE_BY = {
    "taxi": ("simulate", "taxi", "taxi", *SHORT),
    "taxi_2": ("simulate", "taxi", "taxi_2", *SHORT, "--seed", "2"),
    "identified": ("identify", "taxi/study.toml", *LAW, "--out", "identified", "--no-figures"),
    "identified_2": ("identify", "taxi_2/study.toml", *LAW, "--out", "identified_2", "--no-figures"),
    "beats": ("simulate", "sine-beats", "beats"),
    "levels": ("simulate", "resonance", "levels", "--levels", "10"),
    "wing": ("simulate", "backbones", "wing", "--points", "5", "--curves", "2", "1"),
}


def start(words, folder):
    """Start a command; what it writes of a time is always the same, and it leads a group of processes."""
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000", "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", "opid", *words],
        cwd=folder,
        env=environment,
        text=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def run(words, folder):
    process = start(words, folder)
    said = process.communicate(timeout=LONGEST_S)[1]
    if process.returncode not in (0, 1, 3):
        raise RuntimeError(f"opid {' '.join(words)}: {said}")


def make(name, folder):
    """Make a file or a folder that commands need, unless it is there."""
    path = folder / name
    if path.exists():
        return
    if name in MADE_BY:
        run(MADE_BY[name], folder)
    elif name == "driven":
        shutil.copytree(folder / "taxi", path)
        give_speeds(path / "study.toml")
    elif name == "fleet":
        for number in (1, 2, 3):
            run(("simulate", "taxi", f"fleet/f{number}", *SHORT, "--seed", str(number)), folder)
    elif name == "bench.csv":
        write_bench(path)
    elif name == "hit.csv":
        write_hit(path)


def read_files(folder):
    """Return the hash of each file below a folder by its path; None of a folder that is not there."""
    if not folder.exists():
        return None
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest() for path in files}


def find_hidden(folder):
    """Return what stands under a hidden name beside the result or in it."""
    return [*folder.glob(".*.part"), *folder.glob("out/**/*.part")]


def is_hidden(name):
    return name.endswith(".part") or ".part/" in name


def prepare(name, folder):
    """Return the files of the older result with one of the user, of the newer one in its place, and alone; a time."""
    command = COMMANDS[name]
    for each in command.needs:
        make(each, folder)
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    began = time.monotonic()
    run(command.words(command.newer), folder)
    took = time.monotonic() - began
    alone = read_files(out)
    shutil.rmtree(out)
    run(command.words(command.older), folder)
    (out / "mine.txt").write_text("mine")
    older = read_files(out)
    shutil.copytree(out, folder / f"older_{name}")
    run([*command.words(command.newer), "--force"], folder)
    return older, read_files(out), alone, took


def wait_for_writing(folder, process):
    """Wait until the command writes into its hidden folder, or has ended."""
    while process.poll() is None:
        if any(path.name == "new" for path in (*folder.glob(".*.part/new"), *folder.glob("out/.*.part/new"))):
            return
        time.sleep(2e-4)


def interrupt(name, folder, prepared, rng, signal_name=None):
    """Interrupt one run of a command, and return the words for what it has left, all of which are wrong, and when."""
    command, (older, newer, alone, took) = COMMANDS[name], prepared
    out, is_on_older = folder / "out", rng.random() < 0.6
    shutil.rmtree(out, ignore_errors=True)
    if is_on_older:
        shutil.copytree(folder / f"older_{name}", out)
    before, after = (older, newer) if is_on_older else (None, alone)
    signal_name = signal_name or rng.choice([*SIGNALS])
    process = start([*command.words(command.newer), "--force"], folder)
    if is_late := rng.random() < 0.5:
        wait_for_writing(folder, process)
        time.sleep(LATEST_S * 10 ** -rng.uniform(0, 3))
    else:
        time.sleep(rng.uniform(0, 1.05 * took))
    number = SIGNALS[signal_name]
    if process.poll() is None:
        # Ctrl-C reaches the whole group of a terminal
        (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
    said = process.communicate(timeout=LONGEST_S)[1]
    is_killed = process.returncode == -signal.SIGKILL
    wrong = []
    lines = [line for line in said.splitlines() if line.strip()]
    if any("Traceback" in line or "Exception ignored" in line for line in lines):
        wrong.append("traceback")
    elif len(lines) > 1 and name != "campaign":
        wrong.append("more than one sentence")
    wrong += judge(name, folder, before, after, is_killed, is_repaired=False)
    hidden = find_hidden(folder)
    if hidden and not is_killed:
        wrong.append("hidden files stay")
    state = "hidden files, until the next run" if hidden else "nothing hidden"
    try:
        with reserve_directory(out):
            pass
    except InputError as error:
        wrong.append(f"the next run is refused: {error}")
    if name != "campaign" and find_hidden(folder):
        wrong.append("hidden files stay after the next run")
    wrong += [f"{each} after the next run" for each in judge(name, folder, before, after, is_killed, is_repaired=True)]
    when = "while it writes" if is_late else "at any time"
    return wrong, (signal_name, when, state), said


def judge(name, folder, before, after, is_killed, *, is_repaired):
    """Yield what is wrong with the result as it stands."""
    found = read_files(folder / "out")
    if found is not None:
        if "mine.txt" in (before or {}) and "mine.txt" not in found:
            yield "a file of the user is lost"
        found = {path: each for path, each in found.items() if not is_hidden(path)}
    if name == "campaign":
        yield from judge_campaign(folder / "out")
        return
    if found in (before, after) or (name == "demo" and is_half_demo(found, before, after)):
        return
    is_stated = is_killed and not is_repaired and COMMANDS[name].last not in (found or {})
    if not is_stated:
        yield f"half a result {sorted(set((found or {}).items()) ^ set((after or {}).items()))}"[:300]
    elif any(each not in set(before or {}).union(after) for each in found):
        yield "unknown files"
    elif not (found.items() <= (before or {}).items() or found.items() <= after.items()):
        yield "a mixture without result.json"


def is_half_demo(found, before, after):
    """A demo writes its test, and after that its report: the report may still be the older one, or not be there."""
    if found is None:
        return False
    split = [
        {path: each for path, each in files.items() if path.startswith("report/") == is_report}
        for is_report, files in ((False, found), (False, after), (True, found), (True, before or {}))
    ]
    return split[0] == split[1] and split[2] == split[3]


def judge_campaign(out):
    """Yield what is wrong with the flights of a campaign: one with an outcome has the result that it tells of."""
    for outcome in out.rglob("flights/**/outcome.json"):
        told, result = json.loads(outcome.read_text())["result_sha256"], outcome.with_name("result.json")
        if told is not None and (not result.exists() or sha256(result.read_bytes()).hexdigest() != told):
            yield "a flight is not whole"
    if (out / "campaign.json").exists() and not (out / "index.html").exists():
        yield "half a result"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200, help="of all commands together")
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=[*COMMANDS])
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    # A shell that starts this script in the background has told it, and so its commands, to ignore an interrupt.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rng, wrong_of, states, counts = random.Random(options.seed), Counter(), Counter(), Counter()
    with tempfile.TemporaryDirectory() as directory:
        for number, name in enumerate(options.commands):
            folder = Path(directory, name)
            folder.mkdir()
            prepared = prepare(name, folder)
            share, more = divmod(options.runs, len(options.commands))
            for _ in range(share + (number < more)):
                wrong, state, said = interrupt(name, folder, prepared, rng)
                counts[name] += 1
                states[state] += 1
                wrong_of[bool(wrong)] += 1
                if wrong:
                    print(f"{name}, {state[0]} {state[1]}: {'; '.join(wrong)}\n{said}", flush=True)
            print(f"{name}: {counts[name]} runs interrupted, each whole {prepared[3]:.1f} s", flush=True)
            shutil.rmtree(folder)
    print("\n| signal | when | what stays | runs |\n|---|---|---|---|")
    for state, n in sorted(states.items()):
        print(f"| {' | '.join(state)} | {n} |")
    print(f"\n{sum(counts.values())} runs interrupted, {wrong_of[True]} with something wrong")


if __name__ == "__main__":
    main()
