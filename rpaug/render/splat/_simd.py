"""Sixteen float32 lanes as one value inside numba kernels: AVX-512, 2 AVX, 4 SSE or 4 NEON registers.

numba leaves vectorising to LLVM's loop passes, which give up on compositing. Here the vector is a type of
its own, so that each operation below is one LLVM vector instruction. No operation carries fast-math flags:
forward and backward must round alike, and comparisons with NaN must mean something. `Lanes` add, subtract,
multiply, divide and compare with each other and with scalars; a comparison gives a `Mask`.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import extending
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

intrinsic: Any = extending.intrinsic  # its stub knows the definition's signature, not the call's

WIDTH = 16
_FLOAT, INT = ir.FloatType(), ir.IntType(32)
VECTOR = ir.VectorType(_FLOAT, WIDTH)
_MASK = ir.VectorType(ir.IntType(1), WIDTH)


class Lanes(types.Type):
    """Type of sixteen float32 values."""

    def __init__(self) -> None:
        super().__init__("Lanes")


class Mask(types.Type):
    """Type of sixteen truth values."""

    def __init__(self) -> None:
        super().__init__("Mask")


lanes, mask = Lanes(), Mask()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _MASK)


def constant(values: list[float]) -> ir.Constant:
    return ir.Constant(VECTOR, values)


def shuffle(builder: Any, a: Any, b: Any, picks: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(INT, len(picks)), picks))


def spread(builder: Any, value: Any) -> Any:
    none = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(INT, 0))
    return shuffle(builder, first, none, [0] * WIDTH)


def _as_lanes(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, Lanes):
        return value
    return spread(builder, context.cast(builder, value, kind, types.float32))


def _is_number(kind: Any) -> bool:
    return isinstance(kind, (Lanes, types.Float, types.Integer))


def _operation(
    symbol: Callable[..., Any], result: types.Type, emit: Callable[[Any, Any, Any], Any]
) -> None:
    """Let `symbol` take Lanes on at least one side."""

    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) == 2 and any(isinstance(a, Lanes) for a in args):
                return signature(result, *args) if all(map(_is_number, args)) else None
            return None

    infer_global(symbol)(_Template)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (_as_lanes(context, builder, k, v) for k, v in zip(sig.args, args, strict=True))
        return emit(builder, a, b)

    for other in (Lanes, types.Float, types.Integer):
        lower_builtin(symbol, Lanes, other)(lower)
        if other is not Lanes:
            lower_builtin(symbol, other, Lanes)(lower)


_operation(operator.add, lanes, lambda builder, a, b: builder.fadd(a, b))
_operation(operator.sub, lanes, lambda builder, a, b: builder.fsub(a, b))
_operation(operator.mul, lanes, lambda builder, a, b: builder.fmul(a, b))
_operation(operator.truediv, lanes, lambda builder, a, b: builder.fdiv(a, b))
_operation(operator.lt, mask, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_operation(operator.le, mask, lambda builder, a, b: builder.fcmp_ordered("<=", a, b))
_operation(operator.gt, mask, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_operation(operator.ge, mask, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))


@infer_global(operator.and_)
class _And(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if len(args) == 2 and all(isinstance(a, Mask) for a in args):
            return signature(mask, *args)
        return None


@lower_builtin(operator.and_, Mask, Mask)
def _lower_and(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.and_(*args)


@intrinsic
def broadcast(typing: Any, value: Any) -> Any:
    """All lanes equal to one number."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _as_lanes(context, builder, sig.args[0], args[0])

    return lanes(value), emit


@intrinsic
def block_columns(typing: Any) -> Any:
    """Column of each lane in a 4x4 block: 0 1 2 3 0 1 2 3 ..."""
    return lanes(), lambda *_: constant([float(lane % 4) for lane in range(WIDTH)])


@intrinsic
def block_rows(typing: Any) -> Any:
    """Row of each lane in a 4x4 block: 0 0 0 0 1 1 1 1 ..."""
    return lanes(), lambda *_: constant([float(lane // 4) for lane in range(WIDTH)])


@intrinsic
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a * b + c, fused where the machine can, the same everywhere in one process."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.fmuladd.v16f32")
        values = (_as_lanes(context, builder, k, v) for k, v in zip(sig.args, args, strict=True))
        return builder.call(function, list(values))

    return lanes(a, b, c), emit


@intrinsic
def minimum(typing: Any, a: Any, b: Any) -> Any:
    """The smaller of each pair; b where either is NaN."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x, y = (_as_lanes(context, builder, k, v) for k, v in zip(sig.args, args, strict=True))
        return builder.select(builder.fcmp_ordered("<", x, y), x, y)

    return lanes(a, b), emit


@intrinsic
def select(typing: Any, where: Any, a: Any, b: Any) -> Any:
    """a in the lanes of the mask, b elsewhere."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x = _as_lanes(context, builder, sig.args[1], args[1])
        y = _as_lanes(context, builder, sig.args[2], args[2])
        return builder.select(args[0], x, y)

    return lanes(where, a, b), emit


@intrinsic
def maximum(typing: Any, a: Any, b: Any) -> Any:
    """The larger of each pair; b where either is NaN."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x, y = (_as_lanes(context, builder, k, v) for k, v in zip(sig.args, args, strict=True))
        return builder.select(builder.fcmp_ordered(">", x, y), x, y)

    return lanes(a, b), emit


@intrinsic
def negative(typing: Any, a: Any) -> Any:
    """-a, lane by lane."""
    return lanes(a), lambda context, builder, sig, args: builder.fneg(args[0])


@intrinsic
def absolute(typing: Any, a: Any) -> Any:
    """|a|, lane by lane."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.fabs.v16f32")
        return builder.call(function, args)

    return lanes(a), emit


@intrinsic
def bits(typing: Any, where: Any) -> Any:
    """A mask as an integer: bit i is lane i. Zero if no lane is set."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        packed = builder.bitcast(args[0], ir.IntType(WIDTH))
        return builder.zext(packed, ir.IntType(64))

    return types.int64(where), emit


@intrinsic
def lowest_bit(typing: Any, value: Any) -> Any:
    """Place of the lowest bit set in an int64; 64 if there is none."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 0))

    return types.int64(types.int64), emit


def pointer_to(
    context: Any, builder: Any, kind: Any, array: Any, index_kind: Any, index: Any
) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [context.cast(builder, index, index_kind, types.intp)])


def is_flat(array: Any, ndim: int = 1) -> bool:
    """Whether this is a float32 array that lies in memory as one row after the other."""
    return (
        isinstance(array, types.Array)
        and array.dtype == types.float32
        and array.layout == "C"
        and array.ndim == ndim
    )


def read_vector(builder: Any, pointer: Any) -> Any:
    value = builder.load(builder.bitcast(pointer, VECTOR.as_pointer()))
    value.align = 4
    return value


def write_vector(builder: Any, pointer: Any, value: Any) -> None:
    builder.store(value, builder.bitcast(pointer, VECTOR.as_pointer())).align = 4


@intrinsic
def prefetch(typing: Any, array: Any, row: Any) -> Any:
    """Ask for `array[row]` before it is needed, for reading. Harmless if never used."""
    if not is_flat(array, 2):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, INT, INT, INT])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        view = context.make_array(sig.args[0])(context, builder, args[0])
        columns = cgutils.unpack_tuple(builder, view.shape)[1]
        index = context.cast(builder, args[1], sig.args[1], types.intp)
        at = builder.bitcast(builder.gep(view.data, [builder.mul(index, columns)]), byte)
        builder.call(function, [at, *(ir.Constant(INT, flag) for flag in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, row), emit


@intrinsic
def load(typing: Any, array: Any, at: Any) -> Any:
    """Sixteen values of a flat float32 array, from element `at` on. Bounds are the caller's care."""
    if not is_flat(array):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array_kind, at_kind = sig.args
        return read_vector(
            builder, pointer_to(context, builder, array_kind, args[0], at_kind, args[1])
        )

    return lanes(array, at), emit


@intrinsic
def store(typing: Any, array: Any, at: Any, value: Any) -> Any:
    """Write sixteen values into a flat float32 array, from element `at` on."""
    if not is_flat(array):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = pointer_to(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        write_vector(builder, pointer, _as_lanes(context, builder, sig.args[2], args[2]))
        return context.get_dummy_value()

    return types.void(array, at, value), emit


@intrinsic
def next_ticket(typing: Any, counter: Any) -> Any:
    """Take a number, atomically: the value of counter[0] before it goes up by one. `counter` is int64."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        return builder.atomic_rmw("add", data, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter), emit
