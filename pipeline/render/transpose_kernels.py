# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Rows turned into columns: of eight vectors of eight, and of 64 words of 32 bits."""

from __future__ import annotations

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import types
from numba.core.types.containers import UniTuple
from numba.extending import intrinsic

from pipeline.render.simd_kernels import LANES

_I8, _I32 = ir.IntType(8), ir.IntType(32)

# The numbers of two vectors (8 and up: the second) that each step of a transposition takes: pairs, fours, halves.
_PAIRS = ([0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15])
_FOURS = ([0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15])
_HALVES = ([0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15])


@intrinsic
def transposed(typing_context, a, b, c, d, e, f, g, h):
    """Return eight vectors: lane 0 of all arguments, lane 1 of all, and so on."""

    def emit(context, builder, sig, rows):
        def mix(one, other, places):
            return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(_I32, LANES), places))

        pairs = [[mix(rows[k], rows[k + 1], places) for places in _PAIRS] for k in (0, 2, 4, 6)]
        upper, lower = (
            [mix(one, other, places) for one, other in zip(pairs[k], pairs[k + 1], strict=True) for places in _FOURS]
            for k in (0, 2)
        )
        columns = [mix(one, other, places) for places in _HALVES for one, other in zip(upper, lower, strict=True)]
        return context.make_tuple(builder, sig.return_type, columns)

    return UniTuple(a, LANES)(a, a, a, a, a, a, a, a), emit


@intrinsic
def lane_sums(typing_context, a, b, c, d, e, f, g, h):
    """Return one vector: the sum of the lanes of `a`, that of `b`, and so on; always added in the same order."""

    def emit(context, builder, sig, rows):
        def halved(one, other, places):
            left, right = (
                builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(_I32, LANES), half)) for half in places
            )
            return builder.fadd(left, right)

        pairs = [halved(rows[k], rows[k + 1], _PAIRS) for k in (0, 2, 4, 6)]
        return halved(halved(pairs[0], pairs[1], _FOURS), halved(pairs[2], pairs[3], _FOURS), _HALVES)

    return a(a, a, a, a, a, a, a, a), emit


@intrinsic
def transpose_bits(typing_context, words, masks):
    """Write 32 uint64 to `masks`: bit k of mask b is bit b of the k-th of the 64 uint32 in `words`."""

    def emit(context, builder, sig, args):
        source, target = (
            context.make_array(kind)(context, builder, value).data for kind, value in zip(sig.args, args, strict=True)
        )
        wide, bytes64 = ir.VectorType(_I32, 64), ir.VectorType(_I8, 64)
        rows = builder.load(builder.bitcast(source, wide.as_pointer()), align=4, typ=wide)
        zero = ir.Constant(bytes64, [0] * 64)
        for byte in range(4):
            shifted = builder.lshr(rows, ir.Constant(wide, [8 * byte] * 64))
            plane = builder.trunc(shifted, bytes64)
            # The signs of 64 bytes are one instruction or two; doubling moves the next bit there.
            for bit in range(7, -1, -1):
                signs = builder.icmp_signed("<", plane, zero)
                place = ir.Constant(_I32, byte * 8 + bit)
                builder.store(builder.bitcast(signs, ir.IntType(64)), builder.gep(target, [place]))
                plane = builder.add(plane, plane)
        return context.get_dummy_value()

    return types.none(words, masks), emit
