"""Small sound logs of every format with bytes flipped, cut, doubled, inserted and overwritten with extremes.

Whatever comes of it is read in the right shapes or refused in one sentence that names the file. The same examples are
drawn each time; `benchmarks/fuzz_readers.py` searches for as long as one likes.
"""

import pytest
from hypothesis import given, settings, strategies as st
from small_logs import WRITERS, all_of, ended_after, small_log

from opid.errors import InputError
from opid.signals.logs import apart

EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, (1 << 62) - 1, (1 << 64) - 1)
# most of what can go wrong stands in the header
place = st.integers(0, 400) | st.integers(0, 1 << 16)

change = st.one_of(
    st.tuples(st.just("flip"), place, st.integers(0, 7)),
    st.tuples(st.just("cut"), place, st.integers(1, 300)),
    st.tuples(st.just("double"), place, st.integers(1, 300)),
    st.tuples(st.just("insert"), place, st.binary(min_size=1, max_size=12)),
    st.tuples(st.just("overwrite"), place, st.tuples(st.sampled_from(EXTREMES), st.sampled_from((1, 2, 4, 8)))),
    st.tuples(st.just("digits"), place, st.sampled_from((b"9" * 20, b"-1", b"1e999", b"nan", b"\xff", b";", b"\n"))),
)


def changed(content, kind, at, how):
    at %= len(content) + 1
    if kind == "flip":
        at = min(at, len(content) - 1)
        return content[:at] + bytes([content[at] ^ 1 << how]) + content[at + 1 :]
    if kind == "cut":
        return content[:at] + content[at + how :]
    if kind == "double":
        return content[: at + how] + content[at:]
    if kind == "insert":
        return content[:at] + how + content[at:]
    if kind == "overwrite":
        value, size = how
        return content[:at] + (value & (1 << 8 * size) - 1).to_bytes(size, "little") + content[at + size :]
    return content[:at] + how + content[at + len(how) :]


@pytest.mark.parametrize("ending", WRITERS)
def test_a_damaged_log_is_read_or_refused(tmp_path, ending, capfd, monkeypatch):
    monkeypatch.setattr(apart, "BOUNDS", apart.ReadingBounds(seconds=5))
    whole = small_log(ending)
    path = tmp_path / f"run{ending}"

    @settings(max_examples=40, derandomize=True, database=None)
    @given(changes=st.lists(change, min_size=1, max_size=3))
    def read_or_refuse(changes):
        content = whole
        for each in changes:
            content = changed(content, *each) or b"\0"
        path.write_bytes(content)
        try:
            all_of(path)
        except InputError as error:
            message = str(error)
            assert path.name in message and "\n" not in message  # noqa: PT018

    with ended_after(120):
        read_or_refuse()
    assert capfd.readouterr() == ("", "")
