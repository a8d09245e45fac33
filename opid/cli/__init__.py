"""The `opid` command: each subcommand is a few public calls.

Exit status 0: done. 1: the data do not determine the answer (what was determined is written). 2: bad input or usage. 3:
`opid compare` flags a change. 70: opid itself is at fault. 130: interrupted. 143: ended by a signal of the system.
Heavy imports stand inside the commands, so that help and usage errors come at once.
"""

from opid.cli import campaign, logs, modal, plan, sensing, suspensions, update, virtual_structures, virtual_tests
from opid.cli.group import main

# Importing the other modules adds their commands to `main`.
__all__ = [
    "campaign",
    "logs",
    "main",
    "modal",
    "plan",
    "sensing",
    "suspensions",
    "update",
    "virtual_structures",
    "virtual_tests",
]
