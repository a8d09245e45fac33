"""The `opid` command: each subcommand is a few public calls.

Exit status 0: done. 1: the data do not determine the answer (what was determined is written). 2: bad input or usage. 3:
`opid compare` flags a change.
Heavy imports stand inside the commands, so that help and usage errors come at once.
"""

from opid.cli.bench import law
from opid.cli.compare import compare
from opid.cli.decay import decay
from opid.cli.group import main
from opid.cli.laws import laws
from opid.cli.logs import inspect
from opid.cli.modal import modal
from opid.cli.studies import identify
from opid.cli.update import update
from opid.cli.virtual_structures import backbones, sine_beats
from opid.cli.virtual_tests import aircraft, demo, simulate, taxi

__all__ = [
    "aircraft",
    "backbones",
    "compare",
    "decay",
    "demo",
    "identify",
    "inspect",
    "law",
    "laws",
    "main",
    "modal",
    "simulate",
    "sine_beats",
    "taxi",
    "update",
]
