"""Sixteen float32 lanes as one value inside numba kernels: AVX-512, 2 AVX, 4 SSE or 4 NEON registers.

numba leaves vectorising to LLVM's loop passes, which give up on compositing. Here the vector is a type of
its own, so that each operation below is one LLVM vector instruction. No operation carries fast-math flags:
forward and backward must round alike, and comparisons with NaN must mean something. `Lanes` add, subtract,
multiply, divide and compare with each other and with scalars; a comparison gives a `Mask`. A *bank* is a
tuple of `Lanes`, one per channel; its length is known when a kernel is compiled.
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
_FLOAT, _INT = ir.FloatType(), ir.IntType(32)
_LANES = ir.VectorType(_FLOAT, WIDTH)
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
        super().__init__(manager, kind, _LANES)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _MASK)


def _constant(values: list[float]) -> ir.Constant:
    return ir.Constant(_LANES, values)


def _shuffle(builder: Any, a: Any, b: Any, picks: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_INT, len(picks)), picks))


def _broadcast(builder: Any, value: Any) -> Any:
    none = ir.Constant(_LANES, ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(_INT, 0))
    return _shuffle(builder, first, none, [0] * WIDTH)


def _as_lanes(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, Lanes):
        return value
    return _broadcast(builder, context.cast(builder, value, kind, types.float32))


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
    return lanes(), lambda *_: _constant([float(lane % 4) for lane in range(WIDTH)])


@intrinsic
def block_rows(typing: Any) -> Any:
    """Row of each lane in a 4x4 block: 0 0 0 0 1 1 1 1 ..."""
    return lanes(), lambda *_: _constant([float(lane // 4) for lane in range(WIDTH)])


@intrinsic
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a * b + c, fused where the machine can, the same everywhere in one process."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_LANES, [_LANES] * 3)
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
        kind = ir.FunctionType(_LANES, [_LANES])
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


def _pointer(context: Any, builder: Any, kind: Any, array: Any, index_kind: Any, index: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [context.cast(builder, index, index_kind, types.intp)])


def _is_flat(array: Any, ndim: int = 1) -> bool:
    """Whether this is a float32 array that lies in memory as one row after the other."""
    return (
        isinstance(array, types.Array)
        and array.dtype == types.float32
        and array.layout == "C"
        and array.ndim == ndim
    )


def _read(builder: Any, pointer: Any) -> Any:
    value = builder.load(builder.bitcast(pointer, _LANES.as_pointer()))
    value.align = 4
    return value


def _write(builder: Any, pointer: Any, value: Any) -> None:
    builder.store(value, builder.bitcast(pointer, _LANES.as_pointer())).align = 4


@intrinsic
def prefetch(typing: Any, array: Any, row: Any) -> Any:
    """Ask for `array[row]` before it is needed, for reading. Harmless if never used."""
    if not _is_flat(array, 2):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, _INT, _INT, _INT])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        view = context.make_array(sig.args[0])(context, builder, args[0])
        columns = cgutils.unpack_tuple(builder, view.shape)[1]
        index = context.cast(builder, args[1], sig.args[1], types.intp)
        at = builder.bitcast(builder.gep(view.data, [builder.mul(index, columns)]), byte)
        builder.call(function, [at, *(ir.Constant(_INT, flag) for flag in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, row), emit


@intrinsic
def load(typing: Any, array: Any, at: Any) -> Any:
    """Sixteen values of a flat float32 array, from element `at` on. Bounds are the caller's care."""
    if not _is_flat(array):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array_kind, at_kind = sig.args
        return _read(builder, _pointer(context, builder, array_kind, args[0], at_kind, args[1]))

    return lanes(array, at), emit


@intrinsic
def store(typing: Any, array: Any, at: Any, value: Any) -> Any:
    """Write sixteen values into a flat float32 array, from element `at` on."""
    if not _is_flat(array):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        _write(builder, pointer, _as_lanes(context, builder, sig.args[2], args[2]))
        return context.get_dummy_value()

    return types.void(array, at, value), emit


@intrinsic
def bank_of_zeros(typing: Any, count: Any) -> Any:
    """`count` channels of zeros; `count` must be a constant."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    kind = types.UniTuple(lanes, count.literal_value)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.make_tuple(builder, kind, [_constant([0.0] * WIDTH)] * kind.count)

    return kind(count), emit


@intrinsic
def load_bank(typing: Any, array: Any, at: Any, count: Any) -> Any:
    """`count` channels that lie one after the other, sixteen values each."""
    if not (_is_flat(array) and isinstance(count, types.IntegerLiteral)):
        return None
    kind = types.UniTuple(lanes, count.literal_value)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        base = _pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        steps = [ir.Constant(_INT, WIDTH * channel) for channel in range(kind.count)]
        channels = [_read(builder, builder.gep(base, [step])) for step in steps]
        return context.make_tuple(builder, kind, channels)

    return kind(array, at, count), emit


@intrinsic
def store_bank(typing: Any, array: Any, at: Any, bank: Any) -> Any:
    """Write a bank's channels one after the other, sixteen values each."""
    if not _is_flat(array):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        base = _pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        for channel, value in enumerate(cgutils.unpack_tuple(builder, args[2])):
            _write(builder, builder.gep(base, [ir.Constant(_INT, WIDTH * channel)]), value)
        return context.get_dummy_value()

    return types.void(array, at, bank), emit


@intrinsic
def broadcast_bank(typing: Any, array: Any, row: Any, count: Any) -> Any:
    """One number per channel from `array[row, :count]`, each in all lanes."""
    if not (_is_flat(array, 2) and isinstance(count, types.IntegerLiteral)):
        return None
    kind = types.UniTuple(lanes, count.literal_value)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        view = context.make_array(sig.args[0])(context, builder, args[0])
        columns = cgutils.unpack_tuple(builder, view.shape)[1]
        index = context.cast(builder, args[1], sig.args[1], types.intp)
        base = builder.gep(view.data, [builder.mul(index, columns)])
        channels = [
            _broadcast(builder, builder.load(builder.gep(base, [ir.Constant(_INT, channel)])))
            for channel in range(kind.count)
        ]
        return context.make_tuple(builder, kind, channels)

    return kind(array, row, count), emit


@intrinsic
def bank_fma(typing: Any, a: Any, bank: Any, added: Any) -> Any:
    """a * bank + added in every channel."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_LANES, [_LANES] * 3)
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.fmuladd.v16f32")
        pairs = zip(*(cgutils.unpack_tuple(builder, value) for value in args[1:]), strict=True)
        channels = [builder.call(function, [args[0], b, c]) for b, c in pairs]
        return context.make_tuple(builder, sig.return_type, channels)

    return bank(a, bank, added), emit


@intrinsic
def bank_dot(typing: Any, a: Any, b: Any) -> Any:
    """Sum over the channels of a * b, lane by lane."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_LANES, [_LANES] * 3)
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.fmuladd.v16f32")
        pairs = list(zip(*(cgutils.unpack_tuple(builder, value) for value in args), strict=True))
        total = builder.fmul(*pairs[0])
        for pair in pairs[1:]:
            total = builder.call(function, [*pair, total])
        return total

    return lanes(a, b), emit


def _totals(builder: Any, vectors: list[Any]) -> Any:
    """One vector whose lane i is the sum of the lanes of vector i; up to sixteen vectors.

    Two vectors fold into one whose halves belong to either, and so on: sixteen sums cost fifteen folds
    of two shuffles and an addition, against sixty-four when each vector is summed alone.
    """
    vectors = vectors + [_constant([0.0] * WIDTH)] * (WIDTH - len(vectors))
    owners, width = 1, WIDTH  # a vector holds partial sums of `owners` vectors, `width` lanes each
    while width > 1:
        half = width // 2
        low = [owner * width + lane for owner in range(owners) for lane in range(half)]
        low += [WIDTH + lane for lane in low]
        high = [lane + half for lane in low]
        vectors = [
            builder.fadd(_shuffle(builder, a, b, low), _shuffle(builder, a, b, high))
            for a, b in zip(vectors[::2], vectors[1::2], strict=True)
        ]
        owners, width = owners * 2, half
    return vectors[0]


@intrinsic
def store_totals(typing: Any, array: Any, at: Any, moments: Any, bank: Any) -> Any:
    """Write the lane sums of two banks, one after the other, padded with zeros to full vectors."""
    if not _is_flat(array):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        base = _pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        vectors = [v for value in args[2:] for v in cgutils.unpack_tuple(builder, value)]
        for start in range(0, len(vectors), WIDTH):
            sums = _totals(builder, vectors[start : start + WIDTH])
            _write(builder, builder.gep(base, [ir.Constant(_INT, start)]), sums)
        return context.get_dummy_value()

    return types.void(array, at, moments, bank), emit


@intrinsic
def next_ticket(typing: Any, counter: Any) -> Any:
    """Take a number, atomically: the value of counter[0] before it goes up by one. `counter` is int64."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        return builder.atomic_rmw("add", data, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter), emit
