"""`python -m opid` is the `opid` command."""

import os
import signal
import sys
from typing import Any

# The libraries of linear algebra read these variables when they are loaded.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


class Interrupt(KeyboardInterrupt):
    """The user pressed Ctrl-C.

    Where a KeyboardInterrupt itself passes through `exec`, as of a dataclass that is made, Python ends by the signal
    and not by the status that is asked for. It does not with this one.
    """


def _interrupt(*_: Any) -> None:
    raise Interrupt


def main() -> None:
    """Run the command; an interrupt before it has begun or after it has ended shows no traceback.

    Sums that several threads share depend on their number in the last digits, and a result shall not: linear algebra
    has one thread. Its matrices are small, so that more would not be faster.
    """
    os.environ.update(dict.fromkeys(THREADS, "1"))
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
