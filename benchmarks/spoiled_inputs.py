"""Spoiled inputs through every command that reads files: how many end in a traceback, without an end, or in a riddle.

Run `python benchmarks/spoiled_inputs.py --cases 8000 --jobs 2`: about an hour on two cores. `--only COMMAND:NUMBER
--seed S` repeats a case and shows what it said; `--sentences FILE` writes a refusal of each kind, to be read. Needs
Linux.

For each command there is a folder of small sound files (`tests/small_folders.py`). A case spoils one of them
(`tests/spoilers.py`), or puts something else in its place, or gives an option of the command an absurd value, and runs
the command in a process that is forked from this one, where all code is loaded and compiled. What is right: status 0 or
3, status 1 (the data do not determine the answer), or status 2 with one sentence on one line that begins with "Error:"
and names the file or the option.
What is wrong: an exception, a process that dies, no end after 60 s of the processor or 300 s of waiting, a sentence
that names neither file nor option or that no terminal can show, a warning of Python on stderr, words printed past the
command, and a result after status 2.
"""

import argparse
import gc
import json
import logging
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

# before numpy is loaded
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import click
from click.testing import CliRunner
from small_folders import make_folders, run
from small_logs import WRITERS
from spoilers import NUMBERS, PLACES, TEXTS, spoil

from opid import cli
from opid.cli import group

LONGEST_S, LONGEST_WAIT_S = 60.0, 300.0
MEMORY_BYTES = 6 << 30
LONGEST_SENTENCE = 1500
CHANCE_OF_OPTION, CHANCE_OF_PLACE, CHANCE_OF_FIGURES = 0.08, 0.08, 0.1
PACKAGE = str(Path(cli.__file__).parents[1])
RIGHT = ("answered", "not determined", "refused")


@dataclass(frozen=True)
class Command:
    """A command line with the folder that it runs in, the files that may be spoiled, and how often it is run."""

    words: tuple[str, ...]
    folder: str
    files: tuple[str, ...]
    weight: int = 4
    is_warm: bool = field(default=True)


def command(line, folder, *files, weight=4, is_warm=True):
    return Command(tuple(line.split()), folder, files, weight, is_warm)


ONE = "--stiffness-order 1 --damping-order 2"
BENCH = "--force-channel load --travel-channel stroke"
PLAN = "--target sprung_mass=50% --law linear --mass-change -200 --duration 20"
COMMANDS = {
    "inspect": command("inspect taxi/heavy.csv", "taxi", "taxi/heavy.csv", weight=8),
    "inspect formats": command("inspect run.npz", "logs", *(f"run{each}" for each in WRITERS), weight=3),
    "identify": command(
        "identify taxi/study.toml --law linear",
        "taxi",
        "taxi/study.toml",
        "taxi/study.toml",
        "taxi/heavy.csv",
        weight=8,
    ),
    "identify logs": command(
        "identify taxi/heavy.csv taxi/light.csv --sprung upper_z --unsprung lower_z --mass-change -220 --law linear",
        *("taxi", "taxi/light.csv"),
    ),
    "identify paper": command("identify taxi/study.toml --method paper", "taxi", "taxi/study.toml", "taxi/heavy.csv"),
    "identify classical": command(
        "identify taxi/study.toml --method classical --law linear", "taxi", "taxi/study.toml", "taxi/heavy.csv"
    ),
    "identify truth": command(
        "identify taxi/study.toml --law linear --method classical --truth taxi/truth.json", "taxi", "taxi/truth.json"
    ),
    "identify body": command("identify plane/study.toml --law linear", "plane", "plane/study.toml", weight=1),
    "law": command(f"law bench.csv {BENCH}", "bench", "bench.csv", weight=8),
    "law study": command("law bench.toml", "bench", "bench.toml", weight=6),
    "modes": command("modes impact.csv --drive-point case_x --band 50 500", "modal", "impact.csv", weight=6),
    "modal": command("modal study.toml", "modal", "study.toml", "modes.npz", "modes.npz", "beat_1.csv", weight=8),
    "modal csv": command("modal csv.toml", "modal", "modes.csv", weight=4),
    "modal truth": command("modal study.toml --truth truth.json", "modal", "truth.json", weight=2),
    "resonance": command(
        *("resonance study.toml", "levels", "study.toml", "modes.npz", "curve_1.csv", "curve_1.csv"), weight=8
    ),
    "resonance truth": command("resonance study.toml --truth truth.json", "levels", "truth.json"),
    "decay": command(f"decay hit.csv --channel az {ONE}", "bench", "hit.csv", weight=6),
    "decay study": command(f"decay beat_1.csv --study study.toml --mode 3 {ONE}", "modal", "study.toml", "modes.npz"),
    "update": command(
        *("update study.toml --samples 1000 --sampler transitional", "chain", "study.toml"),
        *("structure.npz", "structure.npz", "first.csv", "first.csv"),
        weight=10,
    ),
    "update matrices": command(
        "update matrices.toml --samples 1000 --sampler transitional",
        *("chain", "mass.npz", "part_E.mtx", "dofs.csv", "matrices.toml"),
    ),
    "update truth": command(
        "update study.toml --samples 1000 --sampler transitional --truth truth.json", "chain", "truth.json"
    ),
    "compare": command("compare one two", "flights", "one/result.json", "two/result.json", weight=10),
    "compare bodies": command("compare b1 b2 b3", "flights", "b1/result.json", "b2/result.json", weight=6),
    "compare campaign": command("compare fleet", "fleet", "fleet/dataset/PART", weight=2),
    "campaign": command(
        *("campaign fleet.toml --workers 1", "campaign", "fleet.toml", "flights.csv", "f1/study.toml"),
        weight=1,
        is_warm=False,
    ),
    "sense": command("sense taxi/study.toml one", "flights", "one/result.json", "taxi/study.toml", weight=10),
    "sense log": command(
        "sense taxi/study.toml one taxi/light.csv --like light --unsprung-mass 100+-2", "flights", "taxi/light.csv"
    ),
    "wheel": command("wheel driven/study.toml one", "flights", "one/result.json", "driven/study.toml", weight=6),
    "plan": command(f"plan taxi/study.toml {PLAN}", "taxi", "taxi/study.toml", "taxi/heavy.csv"),
    "plan guess": command("plan guess.toml --target sprung_mass=50%", "taxi", "guess.toml", weight=4),
}


# ---- one case --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """What is spoiled in a case, in words, with the names of which the answer has to tell one."""

    words: tuple[str, ...]
    what: str
    names: tuple[str, ...]


def prepare(name, number, seed, places, folder):
    """Copy the sound files of a command into an empty folder, spoil something, and return the case."""
    rng, line = random.Random(f"{seed}/{name}/{number}"), COMMANDS[name]
    source = places[line.folder]
    for path in sorted(source.rglob("*")):
        target = folder / path.relative_to(source)
        if path.is_dir():
            target.mkdir(parents=True)
        else:
            target.symlink_to(path)
    words = [*line.words, "--out", "out"] if line.words[0] != "inspect" else [*line.words]
    if rng.random() >= CHANCE_OF_FIGURES:
        words.append("--no-figures")
    if rng.random() < CHANCE_OF_OPTION:
        return spoil_option(line, words, rng)
    file = rng.choice(line.files)
    if file.endswith("PART"):
        file = str(rng.choice(sorted(path.relative_to(source) for path in source.rglob("*.parquet"))))
    if name == "inspect formats":
        words[1] = file
    path = folder / file
    names = (path.name, file, str(path.parent.name), *([path.stem] if path.stem not in ("study", "result") else []))
    names = tuple(each for each in (*names, words[1]) if each != folder.name)
    if rng.random() < CHANCE_OF_PLACE:
        put = rng.choice(PLACES)
        if put.__name__ == "put_unreadable":
            path.unlink()
            shutil.copyfile(source / file, path)
        put(path)
        return Case(tuple(words), f"{put.__name__} {file}", names)
    content = (source / file).read_bytes()
    spoilt, done = spoil(content, path.suffix, rng)
    path.unlink()
    path.write_bytes(spoilt)
    return Case(tuple(words), f"{' and '.join(done)} {file}", names)


def spoil_option(line, words, rng):
    """Give one option, or the first argument, an absurd value."""
    own = cli.main.commands[line.words[0]]
    options = [each for each in own.params if isinstance(each, click.Option) and not each.is_flag]
    option = rng.choice([*options, None])
    if option is None:
        words[1] = rng.choice([each for each in TEXTS if "\ud800" not in each])
        return Case(tuple(words), f"argument {words[1]!r}", (group.as_line(words[1])[:60], "there is no file"))
    flag = option.opts[-1]
    is_number = "float" in option.type.name or "int" in option.type.name or option.type.name == "number"
    values = [rng.choice(NUMBERS if is_number or rng.random() < 0.3 else TEXTS) for _ in range(option.nargs)]
    own_words = [each for each in flag.strip("-").split("-") if len(each) > 3]
    # the beginning is enough: a long word loses its middle, counted with what the sentence writes behind it
    # an empty name is that of the folder in which one is
    names = (flag, words[1], *((group.as_line(each)[:150] or " . ") for each in values), *own_words)
    return Case((*words, flag, *values), f"{flag} {values!r}"[:200], names)


def run_case(case, folder):
    """Run a command in this process, which ends with it, and leave its outcome in a file."""
    os.setsid()
    os.chdir(folder)
    printed = os.open("printed", os.O_RDWR | os.O_CREAT)
    for number in (1, 2):
        os.dup2(printed, number)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY_BYTES,) * 2)
    # What opid says of its own faults is replaced by their tracebacks.
    logging.getLogger().handlers.clear()  # some library of logs, all of which are loaded here, sets one
    group.Unexpected.show = lambda error, file=None: traceback.print_exception(error.__cause__, file=sys.stderr)
    done = CliRunner().invoke(cli.main, list(case.words))
    found = {"status": done.exit_code, "stdout": done.stdout[-3000:], "stderr": done.stderr[-20_000:]}
    if done.exc_info is not None and not isinstance(done.exc_info[1], SystemExit):
        found["traceback"] = "".join(traceback.format_exception(*done.exc_info))[-20_000:]
    sys.stdout.flush()
    found["printed"] = Path("printed").read_bytes()[:2000].decode("utf-8", "replace")
    Path("outcome.json").write_text(json.dumps(found), encoding="utf-8", errors="surrogateescape")


def judge(case, folder, found):
    """Return the kind of an outcome, and a list of what is wrong with it."""
    if found is None:
        return "died", ["the process died"]
    said = found["stderr"]
    wrong = []
    if "traceback" in found or found["status"] == group.Unexpected.exit_code:
        return "traceback", [found.get("traceback", said)]
    if warned := re.findall(r"\w*Warning: .*", said):
        wrong.append(f"warning: {warned[0]}")
    if found["printed"]:
        wrong.append(f"printed past the command: {found['printed'][:300]!r}")
    kind = {0: "answered", 3: "answered", 1: "not determined", 2: "refused"}.get(found["status"], "died")
    if kind == "died":
        wrong.append(f"status {found['status']}: {said[-300:]}")
    if found["status"] == 2:
        errors = [line for line in said.splitlines() if line.startswith("Error: ")]
        if len(errors) != 1 or not said.rstrip().endswith(errors[0]):
            wrong.append(f"not one line: {said[-600:]!r}")
        else:
            sentence = errors[0]
            if len(sentence) > LONGEST_SENTENCE:
                wrong.append(f"{len(sentence)} characters: {sentence[:300]}")
            if not sentence.isprintable():
                wrong.append(f"characters that no terminal shows: {sentence[:300]!r}")
            if not any(each in sentence for each in case.names):
                wrong.append(f"names neither file nor option: {sentence[:400]}")
        if (folder / "out").exists():
            wrong.append("there is a result")
    elif "Traceback" in said:
        wrong.append(f"traceback on stderr: {said[-600:]}")
    return kind, wrong


# ---- all cases -------------------------------------------------------------------------------------


def list_cases(n, names):
    """Return command and number of each case: commands by their weights."""
    weights = [COMMANDS[each].weight for each in names]
    counts = [max(1, round(n * weight / sum(weights))) for weight in weights]
    return [(name, number) for name, count in zip(names, counts, strict=True) for number in range(count)]


def run_all(cases, seed, places, top, jobs, tell):
    """Run cases in forked processes, at most `jobs` at a time, and tell the outcome of each."""
    waiting, running = list(reversed(cases)), {}
    while waiting or running:
        while waiting and len(running) < jobs:
            name, number = waiting.pop()
            folder = Path(tempfile.mkdtemp(dir=top, prefix="case"))
            case = prepare(name, number, seed, places, folder)
            process = os.fork()
            if not process:
                try:
                    run_case(case, folder)
                finally:
                    os._exit(0)
            running[process] = (name, number, case, folder, time.monotonic())
        time.sleep(0.003)
        for process in list(running):
            name, number, case, folder, began = running[process]
            waited = time.monotonic() - began
            is_late = waited > LONGEST_S and (waited > LONGEST_WAIT_S or count_seconds(process) > LONGEST_S)
            if is_late:
                os.kill(process, signal.SIGKILL)
            ended, _ = os.waitpid(process, 0 if is_late else os.WNOHANG)
            if not ended:
                continue
            del running[process]
            with suppress(ProcessLookupError):
                os.killpg(process, signal.SIGKILL)
            outcome = folder / "outcome.json"
            found = json.loads(outcome.read_text()) if outcome.is_file() else None
            kind, wrong = ("no end", ["no end"]) if is_late and found is None else judge(case, folder, found)
            tell(name, number, case, kind, wrong, found, time.monotonic() - began)
            shutil.rmtree(folder, ignore_errors=True)


def count_seconds(process):
    """Return the time of the processor that a process has taken, s: others use this machine, too."""
    times = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(map(int, times)) / os.sysconf("SC_CLK_TCK")


def signature(wrong):
    """Return what alike failures have in common: of a traceback its last lines in opid."""
    text = re.sub(r"\d[\d.e+-]*", "N", wrong)
    if "Traceback" in wrong:
        frames = re.findall(rf'File "{PACKAGE}/(\S+\.py)", line (\d+), in (\S+)', wrong)
        place = " < ".join(f"{path}:{line} {function}" for path, line, function in frames[:-4:-1])
        return f"{place}: {wrong.strip().splitlines()[-1][:160]}"
    return re.sub(r"'[^']*'", "'...'", text)[:160]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=8000, help="of all commands together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=[*COMMANDS])
    parser.add_argument("--only", nargs="+", default=[], metavar="COMMAND:NUMBER", help="repeat these cases, and show")
    parser.add_argument("--sentences", type=Path, help="file for one refusal of each kind")
    parser.add_argument("--answers", type=Path, help="file for what was spoiled and answered even so")
    parser.add_argument("--keep", type=Path, help="keep the sound files in this folder, and take them from it")
    options = parser.parse_args()
    kinds, failures, sentences, answers = defaultdict(Counter), defaultdict(list), {}, []

    def tell(name, number, case, kind, wrong, found, took):
        where = f"{name}:{number}"
        kinds[name][kind] += 1
        kinds[name]["time"] += took
        for each in wrong:
            kinds[name]["wrong"] += kind in RIGHT
            if (name, signature(each)) not in failures:
                print(f"{where} {case.what[:100]!r}: {signature(each)}", file=sys.stderr, flush=True)
            failures[name, signature(each)].append((where, case.what, each))
        if found and kind == "refused":
            sentence = found["stderr"].strip().splitlines()[-1:]
            sentences.setdefault(signature("".join(sentence)), (where, case.what, "".join(sentence)))
        if kind in ("answered", "not determined"):
            answers.append(f"{where} | {kind} | {case.what[:160]!r}")
        if options.only:
            print(where, kind, case.what[:300], *case.words, f"{took:.1f} s", sep="\n  ")
            print(json.dumps(found, indent=1).replace("\\n", "\n"), *wrong, sep="\n")

    with tempfile.TemporaryDirectory() as directory:
        top = Path(directory)
        sound = options.keep or top / "sound"
        if not sound.exists():
            sound.mkdir()
            make_folders(sound)
        places = {each.folder: sound / each.folder for each in COMMANDS.values()}
        cases = [(each.rpartition(":")[0], int(each.rpartition(":")[2])) for each in options.only]
        cases = cases or list_cases(options.cases, options.commands)
        for name in dict.fromkeys(name for name, _ in cases):
            if COMMANDS[name].is_warm:
                words = () if name.startswith("inspect") else ("--out", str(top / "warm"))
                run((*COMMANDS[name].words, *words), sound / COMMANDS[name].folder)
                shutil.rmtree(top / "warm", ignore_errors=True)
        gc.collect()
        gc.freeze()
        began = time.monotonic()
        run_all(cases, options.seed, places, top, options.jobs, tell)
        took = time.monotonic() - began
    for (_, what), found in sorted(failures.items()):
        name, number = found[0][0].rsplit(":", 1)
        print(f"\n{len(found)} x {what}\n  {found[0][1][:300]!r}; {', '.join(each[0] for each in found[:5])}")
        print(f"  python benchmarks/spoiled_inputs.py --seed {options.seed} --only '{name}:{number}'")
    if options.sentences:
        lines = [f"{where} | {what[:120]!r}\n    {said[:1500]}" for where, what, said in sorted(sentences.values())]
        options.sentences.write_text("\n".join(lines) + "\n", encoding="utf-8", errors="backslashreplace")
    if options.answers:
        options.answers.write_text("\n".join(answers) + "\n", encoding="utf-8", errors="backslashreplace")
    print_table(kinds)
    print(f"\nseed {options.seed}, {took / 60:.0f} minutes")


def print_table(kinds):
    columns = (*RIGHT, "traceback", "died", "no end", "wrong")
    print(f"\n| command | tried | {' | '.join(columns[:-1])} | other faults | s each |\n|---|{'---|' * 9}")
    whole = Counter()
    for name, counts in kinds.items():
        whole.update(counts)
        print(row(name, counts, columns))
    print(row("all", whole, columns))


def row(name, counts, columns):
    n = sum(counts[each] for each in columns[:-1])
    return f"| {name} | {n} | {' | '.join(str(counts[each]) for each in columns)} | {counts['time'] / max(n, 1):.2f} |"


if __name__ == "__main__":
    main()
