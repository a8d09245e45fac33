"""`python -m opid` is the `opid` command."""

import signal
import sys


def main() -> None:
    """Run the command; an interrupt before it has begun or after it has ended shows no traceback."""
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
