"""The choice among the kinds of law, inside compiled code.

A built-in kind has the code of its place in `BUILT_IN` and is compiled into the kernels. A user's own kind is compiled
alone and its code is the address of what was compiled: no kernel is compiled anew for it.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from llvmlite import ir
from numba import carray, cfunc, extending, njit, types
from numba.core import cgutils

from opid.mechanics.kernels.compilation import part
from opid.mechanics.kinds import BUILT_IN, LAWS, Kind

# Any: the functions it decorates take one argument less than they state
_intrinsic: Any = extending.intrinsic
_NUMBER = types.float64
_FIVE = types.UniTuple(_NUMBER, 5)
_PLACES = {kind.name: place for place, kind in enumerate(BUILT_IN)}


def code_of(name: str) -> int:
    """Return the number by which compiled code knows a kind of law.

    Args:
        name: of a kind in `opid.mechanics.kinds.LAWS`.
    """
    return _PLACES[name] if name in _PLACES else int(_compile_own(LAWS[name]).address)


@cache
def _compile_own(kind: Kind) -> Any:
    """Compile a user's kind; the cache keeps the machine code as long as the process lives."""
    evaluate_own = njit(kind.function, error_model="numpy")

    def write_values(z: Any, v: Any, a: Any, b: Any, out: Any) -> None:
        values = carray(out, 5)
        values[0], values[1], values[2], values[3], values[4] = evaluate_own(z, v, a, b)

    return cfunc(types.void(*[_NUMBER] * 4, types.CPointer(_NUMBER)), error_model="numpy")(write_values)


@cache
def _inlined(kind: Kind) -> Any:
    return part(inline=True)(kind.function)


@_intrinsic
def evaluate(_typing: Any, code: Any, z: Any, v: Any, a: Any, b: Any) -> Any:
    """Compile a call of the kind with this code: (code, z, v, a, b) -> force for unit amplitude and its derivatives.

    Compiled code cannot index a tuple of functions, so the choice is written in the language of LLVM: one branch a
    kind, and one for an address.

    Args:
        code: see `code_of`.
        z: extension, m.
        v: its rate, m/s.
        a: first inner value.
        b: second inner value.
    """
    four = (_NUMBER,) * 4
    functions = [_typing.resolve_value_type(_inlined(kind)) for kind in BUILT_IN]
    signatures = [function.get_call_type(_typing, four, {}) for function in functions]

    def write_choice(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        code, *numbers = arguments
        own, done = builder.append_basic_block("own"), builder.append_basic_block("done")
        choice = builder.switch(code, own)
        answers = []
        for place, (kind, function, signature) in enumerate(zip(BUILT_IN, functions, signatures, strict=True)):
            block = builder.append_basic_block(kind.name)
            choice.add_case(place, block)
            builder.position_at_end(block)
            call = context.get_function(function, signature)
            context.add_linking_libs(getattr(call, "libs", ()))
            answer = context.cast(builder, call(builder, numbers), signature.return_type, _FIVE)
            answers.append((cgutils.unpack_tuple(builder, answer, 5), builder.block))
            builder.branch(done)
        builder.position_at_end(own)
        answers.append((_call_address(context, builder, code, numbers), builder.block))
        builder.branch(done)
        builder.position_at_end(done)
        values = [builder.phi(ir.DoubleType()) for _ in range(5)]
        for answer, block in answers:
            for value, incoming in zip(values, answer, strict=True):
                value.add_incoming(incoming, block)
        return context.make_tuple(builder, _FIVE, values)

    return _FIVE(types.int64, *four), write_choice


def _call_address(context: Any, builder: Any, address: Any, numbers: Any) -> Any:
    double, pointer = ir.DoubleType(), ir.DoubleType().as_pointer()
    function = builder.inttoptr(address, ir.FunctionType(ir.VoidType(), [double] * 4 + [pointer]).as_pointer())
    room = cgutils.alloca_once(builder, context.get_value_type(_FIVE))
    builder.call(function, [*numbers, builder.bitcast(room, pointer)])
    return cgutils.unpack_tuple(builder, builder.load(room), 5)
