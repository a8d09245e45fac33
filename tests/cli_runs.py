"""The command as tests drive it: in this process or in one of its own, and how it refuses."""

import os
import shlex
import struct
import subprocess
import sys
from contextlib import suppress

import click
import pytest
from click.testing import CliRunner

from opid import cli

N_PICTURES = 13
"""In the report of one gear that the model explains."""
CHANNELS = ("--sprung", "upper_z", "--unsprung", "lower_z")


def shell(*arguments, cwd=None):
    """Run the command in a process of its own."""
    command = [sys.executable, "-W", "error", "-m", "opid", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", cwd=cwd)


def opid(*arguments):
    """Run the command in this process; an exception that would be a traceback is raised here."""
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments], catch_exceptions=False)


def run_on_terminal(*arguments, cwd=None):
    """Run Python with stderr on a terminal of 80 columns; return what is written to it, and to stdout."""
    pty = pytest.importorskip("pty")
    fcntl, termios = pytest.importorskip("fcntl"), pytest.importorskip("termios")
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    command = [sys.executable, *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, text=True, cwd=cwd) as process:
        os.close(theirs)
        shown = b""
        with suppress(OSError):  # Linux ends a terminal that nobody writes to with an error.
            while part := os.read(ours, 65536):
                shown += part
        os.close(ours)
        told = process.stdout.read()
    assert process.returncode == 0, shown
    return shown.decode(), told


def lines_drawn(shown):
    """Return what a terminal showed in one line after the other, each drawn over the one before."""
    return [line.rstrip(" ") for line in shown.split("\r") if line.strip()]


def commands(group=cli.main, words=("opid",)):
    """Yield every command with the words that call it, groups of commands among them."""
    yield words, group
    for name, each in getattr(group, "commands", {}).items():
        yield from commands(each, (*words, name))


def parsed(line):
    """Read a command line as it is read before anything runs; a fault in it raises click.UsageError."""
    command, (_, *words) = cli.main, shlex.split(line)
    while isinstance(command, click.Group):
        command = command.commands[words.pop(0)]
    return command.make_context(command.name, words)


def not_determined(done, *words):
    """Check that a command ended with status 1 and gave the reason, which has these words, once: in the text."""
    refused(done, "not determined, for the reason above", status=1)
    text = " ".join(done.stdout.split())
    assert text.count("Not determined: ") == 1
    for word in words:
        assert word in text


def refused(done, *words, status=2):
    """Check that a command ended with one sentence on stderr that has these words, and return the sentence."""
    assert done.exit_code == status, done.output
    lines = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert len(lines) == 1
    assert done.stderr.rstrip().endswith(lines[0])
    assert "Traceback" not in done.output
    for word in words:
        assert word in lines[0]
    return lines[0]
