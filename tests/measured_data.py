"""Measured data that lie beside the project, in shared/data, not in it: a test that needs them is skipped elsewhere."""

from pathlib import Path

import pytest

DATA = Path(__file__).parents[2] / "shared" / "data"
# of recorders of many makes
SAMPLES = DATA / "reader_samples"


def reason(name):
    return f"the measured data {name} are not beside the project"


def needs_data(name):
    """A mark for tests that need a file or a folder of the data."""
    return pytest.mark.skipif(not (DATA / name).exists(), reason=reason(name))


needs_samples = needs_data("reader_samples")


def measured(name):
    """The path of a file or a folder of the data; the test that asks is skipped where it is not there."""
    path = DATA / name
    if not path.exists():
        pytest.skip(reason(name))
    return path
