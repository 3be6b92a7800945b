"""Banks inside numba kernels: tuples of `Lanes`, one for each channel, as long as a constant says.

Loops over channels are written out when a kernel is compiled, so that a bank can live in registers.
"""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types

from rpaug.render.splat._simd import (
    INT,
    VECTOR,
    WIDTH,
    constant,
    intrinsic,
    is_flat,
    lanes,
    pointer_to,
    read_vector,
    shuffle,
    spread,
    write_vector,
)


@intrinsic
def bank_of_zeros(typing: Any, count: Any) -> Any:
    """`count` channels of zeros; `count` must be a constant."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    kind = types.UniTuple(lanes, count.literal_value)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.make_tuple(builder, kind, [constant([0.0] * WIDTH)] * kind.count)

    return kind(count), emit


@intrinsic
def load_bank(typing: Any, array: Any, at: Any, count: Any) -> Any:
    """`count` channels that lie one after the other, sixteen values each."""
    if not (is_flat(array) and isinstance(count, types.IntegerLiteral)):
        return None
    kind = types.UniTuple(lanes, count.literal_value)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        base = pointer_to(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        steps = [ir.Constant(INT, WIDTH * channel) for channel in range(kind.count)]
        channels = [read_vector(builder, builder.gep(base, [step])) for step in steps]
        return context.make_tuple(builder, kind, channels)

    return kind(array, at, count), emit


@intrinsic
def store_bank(typing: Any, array: Any, at: Any, bank: Any) -> Any:
    """Write a bank's channels one after the other, sixteen values each."""
    if not is_flat(array):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        base = pointer_to(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        for channel, value in enumerate(cgutils.unpack_tuple(builder, args[2])):
            write_vector(builder, builder.gep(base, [ir.Constant(INT, WIDTH * channel)]), value)
        return context.get_dummy_value()

    return types.void(array, at, bank), emit


@intrinsic
def broadcast_bank(typing: Any, array: Any, row: Any, count: Any) -> Any:
    """One number per channel from `array[row, :count]`, each in all lanes."""
    if not (is_flat(array, 2) and isinstance(count, types.IntegerLiteral)):
        return None
    kind = types.UniTuple(lanes, count.literal_value)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        view = context.make_array(sig.args[0])(context, builder, args[0])
        columns = cgutils.unpack_tuple(builder, view.shape)[1]
        index = context.cast(builder, args[1], sig.args[1], types.intp)
        base = builder.gep(view.data, [builder.mul(index, columns)])
        channels = [
            spread(builder, builder.load(builder.gep(base, [ir.Constant(INT, channel)])))
            for channel in range(kind.count)
        ]
        return context.make_tuple(builder, kind, channels)

    return kind(array, row, count), emit


@intrinsic
def bank_fma(typing: Any, a: Any, bank: Any, added: Any) -> Any:
    """a * bank + added in every channel."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.fmuladd.v16f32")
        pairs = zip(*(cgutils.unpack_tuple(builder, value) for value in args[1:]), strict=True)
        channels = [builder.call(function, [args[0], b, c]) for b, c in pairs]
        return context.make_tuple(builder, sig.return_type, channels)

    return bank(a, bank, added), emit


@intrinsic
def bank_dot(typing: Any, a: Any, b: Any) -> Any:
    """Sum over the channels of a * b, lane by lane."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
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
    vectors = vectors + [constant([0.0] * WIDTH)] * (WIDTH - len(vectors))
    owners, width = 1, WIDTH  # a vector holds partial sums of `owners` vectors, `width` lanes each
    while width > 1:
        half = width // 2
        low = [owner * width + lane for owner in range(owners) for lane in range(half)]
        low += [WIDTH + lane for lane in low]
        high = [lane + half for lane in low]
        vectors = [
            builder.fadd(shuffle(builder, a, b, low), shuffle(builder, a, b, high))
            for a, b in zip(vectors[::2], vectors[1::2], strict=True)
        ]
        owners, width = owners * 2, half
    return vectors[0]


@intrinsic
def store_totals(typing: Any, array: Any, at: Any, moments: Any, bank: Any) -> Any:
    """Write the lane sums of two banks, one after the other, padded with zeros to full vectors."""
    if not is_flat(array):
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        base = pointer_to(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        vectors = [v for value in args[2:] for v in cgutils.unpack_tuple(builder, value)]
        for start in range(0, len(vectors), WIDTH):
            sums = _totals(builder, vectors[start : start + WIDTH])
            write_vector(builder, builder.gep(base, [ir.Constant(INT, start)]), sums)
        return context.get_dummy_value()

    return types.void(array, at, moments, bank), emit
