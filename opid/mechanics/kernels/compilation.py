"""Two decorators that say how numba compiles a function: `kernel` for what Python calls, `part` for what kernels call.

numba keeps the machine code of a kernel on disk and makes it anew when the file of the kernel changes, but not when
another file changes whose functions are compiled into it. The name under which it is kept therefore holds a digest of
all sources that kernels are made of: code of other sources has another name.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Literal

from numba import njit

from opid.mechanics.laws import kind, kinds, memory_kinds

Freedom = Literal["none", "fused", "any order"]
# what LLVM may do with sums and products, in its own words
_FLAGS: dict[Freedom, Any] = {"none": False, "fused": {"contract"}, "any order": {"reassoc", "nsz", "contract"}}


def part(*, inline: bool, freedom: Freedom = "none") -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator for a function that kernels call; it is compiled with the first kernel that calls it.

    Args:
        inline: whether its code is put in place of each call. A call with many arrays takes longer than what a short
            function computes; a long function that is put in at several places takes longer to compile.
        freedom: what the compiler may do beyond the letter of the arithmetic: "none"; "fused", a product and a sum in
            one instruction, rounded once; "any order", sums in any order besides, so that it takes several numbers at
            once.
    """
    # Python does not call it, and the wrappers that numba would make for that lengthen the compilation
    no_wrappers: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(error_model="numpy", fastmath=_FLAGS[freedom], forceinline=inline, **no_wrappers)


def kernel(*, freedom: Freedom = "none") -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator for a function that Python calls; what is compiled of it is kept on disk."""

    def compile_at_first_call(function: Callable[..., Any]) -> Any:
        function.__qualname__ = f"{function.__qualname__}_{_digest()}"
        return njit(function, error_model="numpy", fastmath=_FLAGS[freedom], cache=True)

    return compile_at_first_call


@cache
def _digest() -> str:
    """Short digest of the kinds of law and of all files in this folder."""
    of_kinds = [Path(str(module.__file__)) for module in (kind, kinds, memory_kinds)]
    sources = [*of_kinds, *sorted(Path(__file__).parent.glob("*.py"))]
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:12]
