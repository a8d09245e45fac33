"""The choice among the kinds of law, inside compiled code.

A built-in kind has the code of its index in `BUILT_IN` and is compiled into the kernels. A user's own kind is compiled
alone and its code is the address of what was compiled: no kernel is compiled anew for it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from llvmlite import ir
from numba import carray, cfunc, extending, njit, types
from numba.core import cgutils

from opid.mechanics.kernels.compilation import part
from opid.mechanics.laws.kinds import BUILT_IN, LAWS, Kind

# Any: the functions it decorates take one argument less than they state
_intrinsic: Any = extending.intrinsic
_NUMBER = types.float64
_CODES = {kind.name: code for code, kind in enumerate(BUILT_IN)}


def code_of(name: str) -> int:
    """Return the number by which compiled code knows a kind of law."""
    return _CODES[name] if name in _CODES else int(_compile_own(LAWS[name]).address)


@cache
def _compile_own(kind: Kind) -> Any:
    """Compile a user's kind; the cache keeps the machine code as long as the process lives."""
    evaluate_own = njit(kind.function, error_model="numpy")

    def write_values(z: Any, v: Any, a: Any, b: Any, out: Any) -> None:
        values = carray(out, 5)
        values[0], values[1], values[2], values[3], values[4] = evaluate_own(z, v, a, b)

    return cfunc(types.void(*[_NUMBER] * 4, types.CPointer(_NUMBER)), error_model="numpy")(write_values)


@cache
def _inline(function: Callable[..., Any]) -> Any:
    return part(inline=True)(function)


@_intrinsic
def evaluate(_typing: Any, code: Any, z: Any, v: Any, a: Any, b: Any) -> Any:
    """Compile a call of the kind with this code: (code, z, v, a, b) -> force for unit amplitude and its derivatives.

    Args:
        code: see `code_of`.
        z: extension, m.
        v: its rate, m/s.
        a: first inner value.
        b: second inner value.
    """
    functions = {code: kind.function for code, kind in enumerate(BUILT_IN)}
    return _compiled_choice(_typing, functions, n_in=4, n_out=5)


@_intrinsic
def evolve(_typing: Any, code: Any, h: Any, v: Any, a: Any, b: Any, c: Any, u: Any) -> Any:
    """Compile a call of the kind with memory of this code: (code, h, v, a, b, c, u) -> h', by h, v, a, b, c.

    Args:
        code: see `code_of`, of a built-in kind with memory.
        h: what the kind remembers.
        v: rate of the extension, m/s.
        a: first inner value.
        b: second inner value.
        c: third inner value.
        u: element.
    """
    functions = {code: kind.memory for code, kind in enumerate(BUILT_IN) if kind.memory is not None}
    return _compiled_choice(_typing, functions, n_in=6, n_out=6)


def _compiled_choice(typing: Any, functions: dict[int, Callable[..., Any]], *, n_in: int, n_out: int) -> Any:
    """Signature and code of a call of one of several functions of numbers, by its key.

    Compiled code cannot index a tuple of functions, so the choice is written in the language of LLVM: one branch a
    function, and one for an address.
    """
    answer_type = types.UniTuple(_NUMBER, n_out)
    parts = {key: typing.resolve_value_type(_inline(function)) for key, function in functions.items()}
    signatures = {key: each.get_call_type(typing, (_NUMBER,) * n_in, {}) for key, each in parts.items()}

    def write_choice(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        code, *numbers = arguments
        own, done = builder.append_basic_block("own"), builder.append_basic_block("done")
        choice = builder.switch(code, own)
        answers = []
        for key, signature in signatures.items():
            block = builder.append_basic_block(f"case_{key}")
            choice.add_case(key, block)
            builder.position_at_end(block)
            call = context.get_function(parts[key], signature)
            context.add_linking_libs(getattr(call, "libs", ()))
            answer = context.cast(builder, call(builder, numbers), signature.return_type, answer_type)
            answers.append((cgutils.unpack_tuple(builder, answer, n_out), builder.block))
            builder.branch(done)
        builder.position_at_end(own)
        answers.append((_call_address(context, builder, code, numbers, answer_type), builder.block))
        builder.branch(done)
        builder.position_at_end(done)
        values = [builder.phi(ir.DoubleType()) for _ in range(n_out)]
        for answer, block in answers:
            for value, incoming in zip(values, answer, strict=True):
                value.add_incoming(incoming, block)
        return context.make_tuple(builder, answer_type, values)

    return answer_type(types.int64, *(_NUMBER,) * n_in), write_choice


def _call_address(context: Any, builder: Any, address: Any, numbers: Any, answer_type: Any) -> Any:
    double, pointer = ir.DoubleType(), ir.DoubleType().as_pointer()
    takes = [double] * len(numbers) + [pointer]
    function = builder.inttoptr(address, ir.FunctionType(ir.VoidType(), takes).as_pointer())
    room = cgutils.alloca_once(builder, context.get_value_type(answer_type))
    builder.call(function, [*numbers, builder.bitcast(room, pointer)])
    return cgutils.unpack_tuple(builder, builder.load(room), len(answer_type))
