"""Search for bytes that a reader neither reads nor refuses.

Run `python benchmarks/fuzz_readers.py --format csv --seconds 60` for logs, `--reader "modes npz"` for a file beside a
study. It needs atheris (`pip install 'opid[fuzz]'`).

Coverage-guided (atheris, libFuzzer) over opid's own code in this process: what libraries read is read in another, and
changed blindly. It begins with the small sound log of the format in `tests/small_logs.py`, or with the sound file of
the reader in `tests/test_spoiled_inputs.py`, those of `tests/corpus` and some that `tests/spoilers.py` spoils. What is
wrong: any exception but `InputError`, a message that does not name the file, blocks of a wrong shape, more than 2 GiB
of memory, or more than 60 s. The bytes are then in the file `crash-...`, `timeout-...` or `oom-...` of the directory
`--finds`, to become a case in `tests/test_logs_bad_input.py` or, below 4 kB, a file of `tests/corpus`.
"""

import argparse
import random
import subprocess
import sys
import tempfile
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

READ_BY = ("opid.signals", "opid.studies", "opid.modal.linear", "opid.updating", "opid.virtual", "opid.suspensions")

with atheris.instrument_imports(include=[*READ_BY, "opid.result", "opid.json_values"]):
    from small_logs import WRITERS, all_of
    from spoilers import spoil
    from test_spoiled_inputs import READERS

    from opid.errors import InputError
    from opid.signals.logs import formats

    formats()

CORPUS = Path(__file__).parents[1] / "tests" / "corpus"
N_SPOILED = 40
"""Spoiled files with which the search for a reader begins."""


def search(path, read, directory, options):
    """Read what libFuzzer makes of the files in `directory`/corpus; it ends the process when the time is up."""

    def read_or_refuse(content):
        path.write_bytes(content)
        try:
            read(path)
        except InputError as error:
            if path.name not in str(error) or "\n" in str(error):
                raise RuntimeError(f"not one sentence that names the file: {error}") from error

    atheris.Setup([sys.argv[0], *options, str(directory / "corpus")], read_or_refuse)
    atheris.Fuzz()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--format", choices=[ending.removeprefix(".") for ending in WRITERS], help="of logs")
    what.add_argument("--reader", choices=READERS, help="of files beside a study")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--finds", type=Path, default=Path(), help="directory for what is found")
    parser.add_argument("--directory", type=Path, help=argparse.SUPPRESS)  # of the process that searches
    wanted = parser.parse_args()
    if wanted.directory is not None:
        options = [
            f"-max_total_time={wanted.seconds}",
            f"-seed={wanted.seed}",
            f"-max_len={2 * (wanted.directory / 'corpus' / 'sound').stat().st_size}",
            f"-artifact_prefix={wanted.finds.resolve()}/",
            "-timeout=60",
            "-rss_limit_mb=2048",
            "-print_final_stats=1",
            "-close_fd_mask=1",
        ]
        if wanted.reader:
            own = READERS[wanted.reader]
            search(own.make(wanted.directory), own.read, wanted.directory, options)
        search(wanted.directory / f"run.{wanted.format}", all_of, wanted.directory, options)
    else:
        with tempfile.TemporaryDirectory() as directory:
            corpus = Path(directory, "corpus")
            corpus.mkdir()
            if wanted.reader:
                rng, path = random.Random(wanted.seed), READERS[wanted.reader].make(Path(directory))
                (corpus / "sound").write_bytes(path.read_bytes())
                for found in (CORPUS / wanted.reader.replace(" ", "_")).iterdir():
                    (corpus / found.name).write_bytes(found.read_bytes())
                for number in range(N_SPOILED):
                    content, _ = spoil(path.read_bytes(), path.suffix, rng)
                    if len(content) < 2 * path.stat().st_size:
                        (corpus / f"spoiled_{number}").write_bytes(content)
            else:
                (corpus / "sound").write_bytes(WRITERS[f".{wanted.format}"][0]())
            again = [sys.executable, __file__, *sys.argv[1:], "--directory", directory]
            sys.exit(subprocess.run(again, check=False).returncode)


if __name__ == "__main__":
    main()
