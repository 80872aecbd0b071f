"""Fused multiply-adds, and the product of a mode's matrix with its inputs made of them, eight rows at a time.

Numba's own loops leave these short sums scalar, so they are put together here from vectors of four numbers. A fused
multiply-add rounds once on every machine (one without it computes the same bits, slowly), so a seed gives the same run
everywhere.
"""

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import PrimitiveModel, register_default
from numba.np.arrayobj import make_array

from microstage_ros.model.plant_record import INPUTS, LEVELS, OUTPUTS
from microstage_ros.numerics.compiled import intrinsic

LANES = 4
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_PARTS = OUTPUTS // LANES
_ROWS = 6                      # rows handed on: i ω θ v x and ω at the middle
AXES = 8                   # axes that are stepped side by side, see `lanes`


class Lanes(types.Type):
    """A vector of float64, or of truth values, one per axis stepped side by side (`lanes`)."""

    def __init__(self, element):
        self.element = element
        super().__init__(f"Lanes({element})")


@register_default(Lanes)
class _LanesModel(PrimitiveModel):
    def __init__(self, dmm, fe_type):
        # a mask: all ones or all zeros
        element = ir.DoubleType() if fe_type.element == types.float64 else ir.IntType(64)
        super().__init__(dmm, fe_type, ir.VectorType(element, AXES))


LANES_TYPE, MASK_TYPE = Lanes(types.float64), Lanes(types.boolean)


def lanes_of(builder, value):
    """The LLVM vector, shape (AXES,), with ``value`` [any unit] in the lane of every axis; made by ``builder``."""
    kind = ir.VectorType(ir.DoubleType(), AXES)
    vector = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(vector, ir.Constant(kind, ir.Undefined),
                                  ir.Constant(ir.VectorType(ir.IntType(32), AXES), [0] * AXES))


@intrinsic
def fused(typingctx, a, b, c):
    """A b + c, rounded once; of numbers, or of lanes and numbers."""
    if LANES_TYPE in (a, b, c):
        def build_lanes(context, builder, signature, arguments):
            kind = ir.FunctionType(arguments[0].type, [arguments[0].type] * 3)
            return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{AXES}f64"), arguments)

        return LANES_TYPE(LANES_TYPE, LANES_TYPE, LANES_TYPE), build_lanes

    def build(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), build


@intrinsic
def mode_rows(typingctx, matrices, slot, level, i, omega, v, u, t0, t1, f0):
    """Rows (i, ω, θ, v, x, ω at the middle) of a mode's matrix times its inputs.

    ``matrices``: work.matrix (SLOTS, LEVELS, INPUTS, OUTPUTS). The voltage is added last: a controller's
    comes late, and everything else is done by then.
    """
    def build(context, builder, signature, arguments):
        i, omega, v, u, t0, t1, f0 = arguments[3:]
        nothing = [ir.Constant(_VECTOR, [0.0] * LANES)] * _PARTS
        start = _start(context, builder, signature, arguments)
        state = _add(builder, start, nothing, [(i, 0), (omega, 1), (v, 2)])
        driven = _add(builder, start, nothing, [(t1, 5), (f0, 7), (t0, 4)])
        sums = [builder.fadd(*pair) for pair in zip(state, driven)]
        return _rows_out(context, builder, signature, _add(builder, start, sums, [(u, 3)]))

    return types.UniTuple(types.float64, _ROWS)(matrices, slot, level, *[types.float64] * 7), build


@intrinsic
def add_columns(typingctx, rows, matrices, slot, level, first, a, second, b):
    """``rows`` + column ``first`` · a + column ``second`` · b of the mode's matrix."""
    def build(context, builder, signature, arguments):
        _, _, _, _, first, a, second, b = arguments
        values = cgutils.unpack_tuple(builder, arguments[0])
        values += [ir.Constant(ir.DoubleType(), 0.0)] * (OUTPUTS - _ROWS)
        sums = []
        for part in range(_PARTS):
            vector = ir.Constant(_VECTOR, ir.Undefined)
            for lane in range(LANES):
                vector = builder.insert_element(vector, values[part * LANES + lane], ir.Constant(ir.IntType(32), lane))
            sums.append(vector)
        inner = signature.args[1:]
        start = _start(context, builder, types.void(*inner), arguments[1:])
        return _rows_out(context, builder, signature, _add(builder, start, sums, [(a, first), (b, second)]))

    words = (types.int64, types.float64, types.int64, types.float64)
    return types.UniTuple(types.float64, _ROWS)(rows, matrices, slot, level, *words), build


@intrinsic
def mix_rows(typingctx, out, row, a, b, c, d, e, source):
    """out[row] = a source[0] + b source[1] + … + e source[4], of arrays (…, OUTPUTS)."""
    def build(context, builder, signature, arguments):
        target, start = (make_array(signature.args[k])(context, builder, arguments[k]).data for k in (0, 7))
        sums = [ir.Constant(_VECTOR, [0.0] * LANES)] * _PARTS
        _write_row(builder, target, arguments[1], _add(builder, start, sums, list(zip(arguments[2:7], range(5)))))
        return context.get_dummy_value()

    return types.void(out, types.int64, *[types.float64] * 5, source), build


@intrinsic
def add_row(typingctx, out, row, factor, source, other):
    """out[row] += factor · source[other], of arrays (…, OUTPUTS)."""
    def build(context, builder, signature, arguments):
        target, start = (make_array(signature.args[k])(context, builder, arguments[k]).data for k in (0, 3))
        before = [builder.load(at, align=8) for at in _parts(builder, target, arguments[1])]
        _write_row(builder, target, arguments[1], _add(builder, start, before, [(arguments[2], arguments[4])]))
        return context.get_dummy_value()

    return types.void(out, types.int64, types.float64, source, types.int64), build


def _write_row(builder, target, row, sums):
    for at, total in zip(_parts(builder, target, row), sums):
        builder.store(total, at, align=8)


def _parts(builder, start, row):
    """Pointers to the vectors of a row."""
    first = builder.mul(row, ir.Constant(ir.IntType(64), OUTPUTS))
    places = [builder.gep(start, [builder.add(first, ir.Constant(ir.IntType(64), part * LANES))])
              for part in range(_PARTS)]
    return [builder.bitcast(at, _VECTOR.as_pointer()) for at in places]


def _start(context, builder, signature, arguments):
    """Pointer to the first number of the matrix of a slot and level."""
    matrices = make_array(signature.args[0])(context, builder, arguments[0])
    size = ir.Constant(ir.IntType(64), INPUTS * OUTPUTS)
    place = builder.add(builder.mul(arguments[1], ir.Constant(ir.IntType(64), LEVELS)), arguments[2])
    return builder.gep(matrices.data, [builder.mul(place, size)])


def _add(builder, start, sums, columns):
    """The vectors ``sums`` + Σ value · column, fused, in the order given."""
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
    fused = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{LANES}f64")
    for value, column in columns:
        if isinstance(column, int):
            column = ir.Constant(ir.IntType(64), column)
        spread = _spread(builder, value)
        sums = [builder.call(fused, [builder.load(at, align=8), spread, total]) for at,
                total in zip(_parts(builder, start, column), sums)]
    return sums


def _spread(builder, value):
    """A vector with ``value`` in every lane."""
    vector = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(vector, ir.Constant(_VECTOR, ir.Undefined), zeros)


def _rows_out(context, builder, signature, sums):
    """The first rows as a tuple."""
    lanes = [builder.extract_element(sums[k // LANES], ir.Constant(ir.IntType(32), k % LANES)) for k in range(_ROWS)]
    return context.make_tuple(builder, signature.return_type, lanes)
