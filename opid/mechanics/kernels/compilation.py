"""Compilation by numba: the decorators of kernels and their parts, the choice among kinds of law, and small arrays.

numba keeps the machine code of a kernel on disk and makes it anew when the file of the kernel changes, but not when
another file changes whose functions are compiled into it. The name under which the code is kept therefore holds a
digest of all sources of the kernels: other sources give another name. Where the code can be neither kept nor read (a
full or read-only disk, no home), it is compiled in each process.

A built-in kind of law has the code of its index in `BUILT_IN` and is compiled into the kernels. A user's own kind is
compiled alone, and its code is the address of the compiled function: no kernel is compiled anew for it.
"""

from __future__ import annotations

import gc
import hashlib
import logging
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from llvmlite import ir
from numba import carray, cfunc, extending, njit, types
from numba.core import cgutils
from numba.core.caching import FunctionCache
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager
from numba.np.arrayobj import make_array, populate_array

from opid.mechanics.laws import kind, kinds, memory_kinds
from opid.mechanics.laws.kinds import BUILT_IN, LAWS, Kind

logger = logging.getLogger(__name__)

# A file of the cache may be cut off where the machine has lost its power.
_CACHE_FAILURES = (OSError, EOFError, ValueError, AttributeError, ImportError, IndexError, pickle.UnpicklingError)

Freedom = Literal["none", "fused", "any order"]
# freedom of LLVM with sums and products, in its own words
_FLAGS: dict[Freedom, Any] = {"none": False, "fused": {"contract"}, "any order": {"reassoc", "nsz", "contract"}}
# The type is Any, because the decorated functions take one argument less than they state.
_intrinsic: Any = extending.intrinsic
_NUMBER = types.float64
# Passes of numba's compiler that change nothing in the kernels, which have no closures, no expressions of whole arrays
# and nothing that numba would inline; without them a compilation takes a tenth less.
_UNNEEDED_PASSES = ("InlineClosureLikes", "InlineInlinables", "InlineOverloads", "NopythonRewrites")
_CODES = {kind.name: code for code, kind in enumerate(BUILT_IN)}


class _Cache(FunctionCache):
    """numba's cache of a function on disk, whose failures have no effect but that the function is compiled anew."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code for a signature, or None."""
        try:
            return super().load_overload(sig, target_context)
        except _CACHE_FAILURES as error:
            logger.info("cannot read compiled code: %s", error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code for a signature."""
        try:
            super().save_overload(sig, data)
        except _CACHE_FAILURES as error:
            logger.info("cannot keep compiled code: %s", error)


class _KernelCompiler(CompilerBase):
    """numba's compiler without passes that the kernels do not need, and without Python's search for cyclic garbage.

    A compilation makes millions of objects that live until its end. The search, which comes after every few hundred
    new objects, visits them again and again, and takes a tenth of the time.
    """

    def define_pipelines(self) -> list[Any]:
        """Return the passes, in order."""
        needed = PassManager("kernels")
        for compiler_pass, message in DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            if compiler_pass.__name__ not in _UNNEEDED_PASSES:
                needed.add_pass(compiler_pass, message)
        needed.finalize()
        return [needed]

    def compile_extra(self, func: Any) -> Any:
        """Compile a function."""
        was_enabled = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(func)
        finally:
            if was_enabled:
                gc.enable()


def part(*, inline: bool, freedom: Freedom = "none") -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator for a function that kernels call; numba compiles it with the first kernel that calls it.

    Args:
        inline: whether its code replaces each call. A call with many arrays takes longer than a short function does; a
            long function that is inlined at several places takes longer to compile.
        freedom: changes that the compiler may make in the arithmetic: "none"; "fused", a product and a sum in one
            instruction, rounded once; "any order", in addition sums in any order, so that it takes several numbers at
            once.
    """
    # Python never calls a part, and numba's wrappers for such calls would lengthen the compilation.
    no_wrappers: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

    def compile_with_kernels(function: Callable[..., Any]) -> Any:
        compiled: Any = njit(
            function,
            error_model="numpy",
            fastmath=_FLAGS[freedom],
            forceinline=inline,
            pipeline_class=_KernelCompiler,
            **no_wrappers,
        )
        find_template = compiled.get_call_template

        def find_general_template(positional: Any, named: Any) -> Any:
            # For numba the type of a constant contains its value. A part is compiled once for all values of a type;
            # where it is inlined, LLVM puts in the constant.
            return find_template([types.unliteral(each) for each in positional], named)

        compiled.get_call_template = find_general_template
        return compiled

    return compile_with_kernels


def kernel(*, freedom: Freedom = "none") -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator for a function that Python calls; its machine code is kept on disk."""

    def compile_at_first_call(function: Callable[..., Any]) -> Any:
        function.__qualname__ = f"{function.__qualname__}_{_compute_digest()}"
        # Without Python's lock, several tests are simulated at once in threads.
        compiled: Any = njit(
            function, error_model="numpy", fastmath=_FLAGS[freedom], nogil=True, pipeline_class=_KernelCompiler
        )
        try:
            compiled._cache = _Cache(compiled.py_func)
        except (OSError, RuntimeError) as error:  # numba finds no directory that it can write to
            logger.info("compiled code is not kept: %s", error)
        return compiled

    return compile_at_first_call


@cache
def _compute_digest() -> str:
    """Return a short digest of the kinds of law and of all files in this folder."""
    of_kinds = [Path(str(module.__file__)) for module in (kind, kinds, memory_kinds)]
    sources = [*of_kinds, *sorted(Path(__file__).parent.glob("*.py"))]
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:12]


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
        code: code of the kind, see `code_of`.
        z: extension, m.
        v: rate of the extension, m/s.
        a: first inner value.
        b: second inner value.
    """
    functions = {code: kind.function for code, kind in enumerate(BUILT_IN)}
    return _compile_choice(_typing, functions, n_in=4, n_out=5)


@_intrinsic
def evaluate_cycle(_typing: Any, code: Any, z: Any, reach: Any, a: Any, b: Any, c: Any) -> Any:
    """Compile a call of `Kind.cycle`: (code, z, reach, a, b, c) -> force for unit amplitude and its derivatives.

    Args:
        code: code of a built-in kind that has a cycle, see `code_of`.
        z: extension, m.
        reach: largest extension of the cycle, m.
        a: first inner value.
        b: second inner value.
        c: third inner value.
    """
    functions = {code: kind.cycle for code, kind in enumerate(BUILT_IN) if kind.cycle is not None}
    return _compile_choice(_typing, functions, n_in=5, n_out=6)


@_intrinsic
def evolve(_typing: Any, code: Any, h: Any, v: Any, a: Any, b: Any, c: Any, u: Any) -> Any:
    """Compile a call of the kind with memory of this code: (code, h, v, a, b, c, u) -> h', by h, v, a, b, c.

    Args:
        code: code of a built-in kind with memory, see `code_of`.
        h: memory of the kind.
        v: rate of the extension, m/s.
        a: first inner value.
        b: second inner value.
        c: third inner value.
        u: element.
    """
    functions = {code: kind.memory for code, kind in enumerate(BUILT_IN) if kind.memory is not None}
    return _compile_choice(_typing, functions, n_in=6, n_out=6)


def _compile_choice(typing: Any, functions: dict[int, Callable[..., Any]], *, n_in: int, n_out: int) -> Any:
    """Return signature and code of a call of one of several functions of numbers, chosen by its key.

    Compiled code cannot index a tuple of functions, so the choice is written in the language of LLVM: one branch for
    each function, and one for an address.
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
        answers.append((_find_call_address(context, builder, code, numbers, answer_type), builder.block))
        builder.branch(done)
        builder.position_at_end(done)
        values = [builder.phi(ir.DoubleType()) for _ in range(n_out)]
        for answer, block in answers:
            for value, incoming in zip(values, answer, strict=True):
                value.add_incoming(incoming, block)
        return context.make_tuple(builder, answer_type, values)

    return answer_type(types.int64, *(_NUMBER,) * n_in), write_choice


def _find_call_address(context: Any, builder: Any, address: Any, numbers: Any, answer_type: Any) -> Any:
    double, pointer = ir.DoubleType(), ir.DoubleType().as_pointer()
    takes = [double] * len(numbers) + [pointer]
    function = builder.inttoptr(address, ir.FunctionType(ir.VoidType(), takes).as_pointer())
    room = cgutils.alloca_once(builder, context.get_value_type(answer_type))
    builder.call(function, [*numbers, builder.bitcast(room, pointer)])
    return cgutils.unpack_tuple(builder, builder.load(room), len(answer_type))


@_intrinsic
def small_zeros(_: Any, several: Any, remembered: Any, shape: Any) -> Any:
    """Compile np.zeros(shape); for one interface it lies on the stack of the kernel, which must not return it.

    The compiler takes arrays of known size apart into numbers, which stay in registers.

    Args:
        several: the number of interfaces, or None for one.
        remembered: a tuple with a number for each memory of one interface, or None without memory.
        shape: tuple of whole numbers. For one interface with m memories the largest have (6 + m)^2 numbers, or 40 m
            numbers of m memories at five stages.
    """
    array = types.Array(types.float64, len(shape), "C")

    def make_on_heap(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        return context.compile_internal(builder, lambda shape: np.zeros(shape), array(shape), arguments[2:])

    def make_on_stack(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        n_memories = 0 if remembered is types.none else len(remembered)
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
