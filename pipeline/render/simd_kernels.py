# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators, allow-subclassing-any
"""Eight-lane vectors for the kernels: `Floats8`, `Doubles8`, `Ints8` and `Mask8` map straight to LLVM vectors.

Kernels written on these types cannot fall back to scalar code when a compiler changes its mind: eight pixels or
eight Gaussians go through every instruction together (AVX2: one ymm register), and `fma` is fused wherever it is
written and nowhere else, so two kernels that share a formula get the same bits from it.

Arithmetic uses the operators; the functions below do the rest. Loads and stores take a flat array and an offset in
elements and check nothing.

The file is long because it is one vocabulary: each function is ten lines of declaration around one instruction, on
types that are private to it.
"""

from __future__ import annotations

import operator

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 8
_F32, _F64, _I32, _I1 = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(1)


class _Vector(types.Type):
    def __init__(self, name, element):
        super().__init__(name=name)
        self.element = element


class _Floats8(_Vector):
    pass


class _Doubles8(_Vector):
    pass


class _Ints8(_Vector):
    pass


class _Mask8(_Vector):
    pass


floats8 = _Floats8("Floats8", _F32)
doubles8 = _Doubles8("Doubles8", _F64)
ints8 = _Ints8("Ints8", _I32)
mask8 = _Mask8("Mask8", _I1)
_SCALAR_OF = {floats8: types.float32, doubles8: types.float64, ints8: types.int32}
_VECTOR_OF = {scalar: vector for vector, scalar in _SCALAR_OF.items()}


@register_model(_Floats8)
@register_model(_Doubles8)
@register_model(_Ints8)
@register_model(_Mask8)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(kind.element, LANES))


def _define(function, result, operands, emit):
    """Give `function` (an operator) a meaning for these operand types."""

    @infer_global(function)
    class _Typing(ConcreteTemplate):
        cases = (signature(result, *operands),)

    @lower_builtin(function, *operands)
    def _lower(context, builder, sig, args):
        return emit(builder, *args)


for _kind in (floats8, doubles8):
    _define(operator.add, _kind, (_kind, _kind), lambda b, x, y: b.fadd(x, y))
    _define(operator.sub, _kind, (_kind, _kind), lambda b, x, y: b.fsub(x, y))
    _define(operator.mul, _kind, (_kind, _kind), lambda b, x, y: b.fmul(x, y))
    _define(operator.truediv, _kind, (_kind, _kind), lambda b, x, y: b.fdiv(x, y))
    _define(operator.neg, _kind, (_kind,), lambda b, x: b.fneg(x))
    # Ordered comparisons: any lane with a NaN is False.
    _define(operator.lt, mask8, (_kind, _kind), lambda b, x, y: b.fcmp_ordered("<", x, y))
    _define(operator.le, mask8, (_kind, _kind), lambda b, x, y: b.fcmp_ordered("<=", x, y))
    _define(operator.gt, mask8, (_kind, _kind), lambda b, x, y: b.fcmp_ordered(">", x, y))
    _define(operator.ge, mask8, (_kind, _kind), lambda b, x, y: b.fcmp_ordered(">=", x, y))
_define(operator.add, ints8, (ints8, ints8), lambda b, x, y: b.add(x, y))
_define(operator.sub, ints8, (ints8, ints8), lambda b, x, y: b.sub(x, y))
_define(operator.lshift, ints8, (ints8, ints8), lambda b, x, y: b.shl(x, y))
_define(operator.rshift, ints8, (ints8, ints8), lambda b, x, y: b.ashr(x, y))
_define(operator.or_, ints8, (ints8, ints8), lambda b, x, y: b.or_(x, y))
_define(operator.le, mask8, (ints8, ints8), lambda b, x, y: b.icmp_signed("<=", x, y))
_define(operator.and_, mask8, (mask8, mask8), lambda b, x, y: b.and_(x, y))
_define(operator.or_, mask8, (mask8, mask8), lambda b, x, y: b.or_(x, y))
_define(operator.invert, mask8, (mask8,), lambda b, x: b.not_(x))


def _broadcast(builder, value):
    vector = ir.Constant(ir.VectorType(value.type, LANES), ir.Undefined)
    vector = builder.insert_element(vector, value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(
        vector, ir.Constant(vector.type, ir.Undefined), ir.Constant(ir.VectorType(_I32, LANES), [0] * LANES)
    )


def _element_pointer(context, builder, array_type, array, index):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [index])


_SUFFIX = {str(_F32): "v8f32", str(_F64): "v8f64", str(_I32): "v8i32"}


def _call(builder, name, *args, result=None):
    kinds = [value.type for value in args]
    function = ir.FunctionType(kinds[0] if result is None else result, kinds)
    full_name = f"{name}.{_SUFFIX[str(kinds[0].element)]}"
    return builder.call(cgutils.get_or_insert_function(builder.module, function, full_name), args)


@intrinsic
def splat(typing_context, value):
    """Return eight copies of a float32, float64 or int32."""

    def emit(context, builder, sig, args):
        return _broadcast(builder, args[0])

    return _VECTOR_OF[value](value), emit


@intrinsic
def splat_at(typing_context, array, index):
    """Return eight copies of `array[index]`."""

    def emit(context, builder, sig, args):
        return _broadcast(builder, builder.load(_element_pointer(context, builder, sig.args[0], *args)))

    return _VECTOR_OF[array.dtype](array, types.intp), emit


@intrinsic
def load(typing_context, array, index):
    """Return `array[index : index + 8]`."""
    vector = _VECTOR_OF[array.dtype]

    def emit(context, builder, sig, args):
        pointer = _element_pointer(context, builder, sig.args[0], *args)
        wide = ir.VectorType(vector.element, LANES)
        return builder.load(builder.bitcast(pointer, wide.as_pointer()), align=4, typ=wide)

    return vector(array, types.intp), emit


@intrinsic
def store(typing_context, array, index, value):
    """Write eight lanes to `array[index : index + 8]`."""

    def emit(context, builder, sig, args):
        pointer = _element_pointer(context, builder, sig.args[0], *args[:2])
        builder.store(args[2], builder.bitcast(pointer, args[2].type.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.none(array, types.intp, value), emit


@intrinsic
def lane_numbers(typing_context):
    """Return the floats 0, 1, ... 7."""

    def emit(context, builder, sig, args):
        return ir.Constant(ir.VectorType(_F32, LANES), [float(i) for i in range(LANES)])

    return floats8(), emit


@intrinsic
def block_columns(typing_context):
    """Return the column of each lane in a block of 4 x 2 pixels."""

    def emit(context, builder, sig, args):
        return ir.Constant(ir.VectorType(_F32, LANES), [float(i % 4) for i in range(LANES)])

    return floats8(), emit


@intrinsic
def block_rows(typing_context):
    """Return the row of each lane in a block of 4 x 2 pixels."""

    def emit(context, builder, sig, args):
        return ir.Constant(ir.VectorType(_F32, LANES), [float(i // 4) for i in range(LANES)])

    return floats8(), emit


@intrinsic
def nibble_shifts(typing_context):
    """Return the integers 0, 4, ... 28: where each lane's four bits go in a 32-bit word."""

    def emit(context, builder, sig, args):
        return ir.Constant(ir.VectorType(_I32, LANES), [4 * i for i in range(LANES)])

    return ints8(), emit


@intrinsic
def fma(typing_context, a, b, c):
    """Return a * b + c with one rounding."""

    def emit(context, builder, sig, args):
        return _call(builder, "llvm.fma", *args)

    return a(a, a, a), emit


@intrinsic
def square_root(typing_context, x):
    """Return the correctly rounded square root."""

    def emit(context, builder, sig, args):
        return _call(builder, "llvm.sqrt", *args)

    return x(x), emit


@intrinsic
def select(typing_context, mask, a, b):
    """Return `a` in the lanes where the mask is set and `b` elsewhere."""

    def emit(context, builder, sig, args):
        return builder.select(*args)

    return a(mask, a, a), emit


@intrinsic
def smaller(typing_context, a, b):
    """Return the smaller of each pair; `b` where either is NaN."""

    def emit(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered("<", *args), *args)

    return a(a, a), emit


@intrinsic
def larger(typing_context, a, b):
    """Return the larger of each pair; `b` where either is NaN."""

    def emit(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return a(a, a), emit


@intrinsic
def minus_magnitude(typing_context, x):
    """Return -|x|."""

    def emit(context, builder, sig, args):
        return builder.fneg(_call(builder, "llvm.fabs", *args))

    return x(x), emit


@intrinsic
def widen(typing_context, x):
    """Return float32 lanes as float64."""

    def emit(context, builder, sig, args):
        return builder.fpext(args[0], ir.VectorType(_F64, LANES))

    return doubles8(floats8), emit


@intrinsic
def narrow(typing_context, x):
    """Return float64 lanes rounded to float32."""

    def emit(context, builder, sig, args):
        return builder.fptrunc(args[0], ir.VectorType(_F32, LANES))

    return floats8(doubles8), emit


@intrinsic
def power_of_two(typing_context, x):
    """Return 2 to the power of int32 lanes from -126 to 127, as float32."""

    def emit(context, builder, sig, args):
        wide = args[0].type
        exponent = builder.add(args[0], ir.Constant(wide, [127] * LANES))
        return builder.bitcast(builder.shl(exponent, ir.Constant(wide, [23] * LANES)), ir.VectorType(_F32, LANES))

    return floats8(ints8), emit


@intrinsic
def truncate(typing_context, x):
    """Return float32 lanes as int32, towards zero; the lanes must fit."""

    def emit(context, builder, sig, args):
        return builder.fptosi(args[0], ir.VectorType(_I32, LANES))

    return ints8(floats8), emit


@intrinsic
def to_floats(typing_context, x):
    """Return int32 lanes as float32."""

    def emit(context, builder, sig, args):
        return builder.sitofp(args[0], ir.VectorType(_F32, LANES))

    return floats8(ints8), emit


@intrinsic
def union(typing_context, x):
    """Return the bitwise or of all eight lanes."""

    def emit(context, builder, sig, args):
        return _call(builder, "llvm.vector.reduce.or", *args, result=_I32)

    return types.uint32(ints8), emit


@intrinsic
def bits(typing_context, mask):
    """Return a mask as an integer, lane 0 in the lowest bit."""

    def emit(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), _I32)

    return types.uint32(mask8), emit


@intrinsic
def lowest_bit(typing_context, word):
    """Return the position of the lowest set bit of a uint32 or uint64 that is not 0."""

    def emit(context, builder, sig, args):
        place = builder.cttz(args[0], ir.Constant(_I1, 1))
        return place if word == types.uint64 else builder.zext(place, ir.IntType(64))

    return types.intp(word), emit


@intrinsic
def float_bits(typing_context, x):
    """Return the bit pattern of a float32."""

    def emit(context, builder, sig, args):
        return builder.bitcast(args[0], _I32)

    return types.uint32(types.float32), emit


@intrinsic
def prefetch(typing_context, array, index):
    """Ask for the cache line of `array[index]`; any index is safe."""

    def emit(context, builder, sig, args):
        pointer = builder.bitcast(_element_pointer(context, builder, sig.args[0], *args), ir.IntType(8).as_pointer())
        flags = [ir.Constant(_I32, value) for value in (0, 3, 1)]
        function = ir.FunctionType(ir.VoidType(), [pointer.type, _I32, _I32, _I32])
        builder.call(cgutils.get_or_insert_function(builder.module, function, "llvm.prefetch.p0"), [pointer, *flags])
        return context.get_dummy_value()

    return types.none(array, types.intp), emit


@intrinsic
def at(typing_context, array, index):
    """Return `array[index]`; unlike the brackets, never looks whether the index is negative."""

    def emit(context, builder, sig, args):
        return builder.load(_element_pointer(context, builder, sig.args[0], *args))

    return array.dtype(array, types.intp), emit


@intrinsic
def gather(typing_context, array, indices, offset):
    """Return the eight numbers `array[indices + offset]`; indices are int64s in memory, not bounds-checked."""

    def emit(context, builder, sig, args):
        vector = ir.Constant(ir.VectorType(_F32, LANES), ir.Undefined)
        for lane in range(LANES):
            place = ir.Constant(ir.IntType(64), lane)
            index = builder.load(_element_pointer(context, builder, sig.args[1], args[1], place))
            pointer = _element_pointer(context, builder, sig.args[0], args[0], builder.add(index, args[2]))
            vector = builder.insert_element(vector, builder.load(pointer), ir.Constant(_I32, lane))
        return vector

    return floats8(array, indices, types.intp), emit


@intrinsic
def put(typing_context, array, index, value):
    """Write `array[index]`; unlike the brackets, never looks whether the index is negative."""

    def emit(context, builder, sig, args):
        builder.store(args[2], _element_pointer(context, builder, sig.args[0], *args[:2]))
        return context.get_dummy_value()

    return types.none(array, types.intp, array.dtype), emit
