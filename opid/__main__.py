"""`python -m opid` is the `opid` command."""

import os
import signal
import sys
from typing import Any

# The libraries of linear algebra read these variables when they are loaded.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

# Others are read when numba or matplotlib is loaded, and a command needs neither debugged code nor a window.
UNUSED = ("NUMBA_DISABLE_JIT", "NUMBA_NUM_THREADS", "MPLBACKEND")
TIME = "SOURCE_DATE_EPOCH"


class Interrupt(KeyboardInterrupt):
    """The user pressed Ctrl-C.

    Where a KeyboardInterrupt itself passes through `exec`, as of a dataclass that is made, Python ends by the signal
    and not by the status that is asked for. It does not with this one.
    """


def _interrupt(*_: Any) -> None:
    raise Interrupt


def _settle_environment() -> None:
    """Set the variables that libraries read when they are loaded; end where the time of writing is none.

    numpy reads that time, too.
    """
    os.environ.update(dict.fromkeys(THREADS, "1"))
    for name in UNUSED:
        os.environ.pop(name, None)
    stated = os.environ.get(TIME)
    if stated == "":
        del os.environ[TIME]
    elif stated is not None and not (stated.isascii() and stated.isdecimal() and len(stated) <= 11):
        sys.stderr.write(
            f"Error: the environment variable {TIME} is {stated[:40]!a}: give a whole number of seconds since 1970 "
            "of at most 11 digits, or unset it\n"
        )
        sys.exit(2)


def _open_what_is_closed() -> None:
    """Put nothing in the place of input, output or errors that whoever started the command has closed.

    The first file that is opened would take its place, and what is printed would go into that file.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
            setattr(sys, name, open(descriptor, "w" if number else "r", encoding="utf-8", errors="replace"))  # noqa: SIM115


def main() -> None:
    """Run the command; an interrupt before it has begun or after it has ended shows no traceback.

    Sums that several threads share depend on their number in the last digits, and a result shall not: linear algebra
    has one thread. Its matrices are small, so that more would not be faster.
    """
    _open_what_is_closed()
    _settle_environment()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # one that is ignored stays ignored
        signal.signal(signal.SIGINT, _interrupt)
    try:
        from opid.cli import main as run_command

        run_command()
    except KeyboardInterrupt:
        sys.stderr.write("Error: interrupted\n")
        sys.exit(130)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


if __name__ == "__main__":
    main()
