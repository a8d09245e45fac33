"""Arrays that a kernel works in: the compiler takes those of known size apart into numbers, which stay in registers."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.np.arrayobj import make_array, populate_array

# Any: the function it decorates takes one argument less than it states
_intrinsic: Any = extending.intrinsic


@_intrinsic
def small_zeros(_: Any, several: Any, remembered: Any, shape: Any) -> Any:
    """Compile np.zeros(shape), which for one interface lies on the stack of the kernel; a kernel must not return it.

    Args:
        several: the number of interfaces, or None for one.
        remembered: a tuple with a number for each memory of one interface.
        shape: tuple of whole numbers. For one interface with m memories the largest have 6 + m states by as many, or
            what m memories do at five stages, 40 m.
    """
    array = types.Array(types.float64, len(shape), "C")

    def make_on_heap(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        return context.compile_internal(builder, lambda shape: np.zeros(shape), array(shape), arguments[2:])

    def make_on_stack(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        n_memories = len(remembered)
        room = ir.ArrayType(ir.DoubleType(), max((6 + n_memories) ** 2, 40 * n_memories))
        start = cgutils.alloca_once_value(builder, room(None), zfill=True)
        sizes = cgutils.unpack_tuple(builder, arguments[2])
        strides = [context.get_constant(types.intp, 8)]
        for size in sizes[:0:-1]:
            strides.insert(0, builder.mul(strides[0], size))
        made = make_array(array)(context, builder)
        data = builder.bitcast(start, ir.DoubleType().as_pointer())
        item_bytes = context.get_constant(types.intp, 8)
        populate_array(made, data=data, shape=sizes, strides=strides, itemsize=item_bytes, meminfo=None)
        return made._getvalue()

    return array(several, remembered, shape), make_on_stack if several is types.none else make_on_heap
