"""Several axes at once: a number per lane of a processor's vector, for compiled code.

A value of type `LANES_TYPE` holds `LANES` float64; + − · / and comparisons act lane by lane, with a plain number in
every lane. A comparison gives a mask: &, |, ~, `any_lane`, `choose`. Every lane computes the bits that a float64 would.
"""

import operator

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typing.templates import AbstractTemplate, infer_global, signature

from microstage_ros.numerics.compiled import intrinsic
from microstage_ros.solver.vectors import AXES, LANES_TYPE, MASK_TYPE, lanes_of

LANES = AXES
_WORD = ir.IntType(64)
_WORDS = ir.VectorType(_WORD, LANES)
_NUMBERS = ir.VectorType(ir.DoubleType(), LANES)
_QUAD = ir.VectorType(ir.DoubleType(), 4)


def _number(kind):
    return kind == LANES_TYPE or isinstance(kind, (types.Float, types.Integer))


def _binary(function, result, build):
    """Let ``function`` act on two values of which one has lanes."""
    class Pair(AbstractTemplate):
        key = function

        def generic(self, args, kws):
            if len(args) == 2 and LANES_TYPE in args and all(map(_number, args)):
                return signature(result, LANES_TYPE, LANES_TYPE)

    infer_global(function)(Pair)
    lower_builtin(function, LANES_TYPE, LANES_TYPE)(lambda context, builder, sig, args: build(builder, *args))


def _of_masks(function, build):
    class Masks(AbstractTemplate):
        key = function

        def generic(self, args, kws):
            if args and all(kind == MASK_TYPE for kind in args):
                return signature(MASK_TYPE, *args)

    infer_global(function)(Masks)
    for count in (1, 2):
        lower_builtin(function, *[MASK_TYPE] * count)(lambda context, builder, sig, args: build(builder, *args))


def _unary(function, build):
    class One(AbstractTemplate):
        key = function

        def generic(self, args, kws):
            if args == (LANES_TYPE,):
                return signature(LANES_TYPE, LANES_TYPE)

    infer_global(function)(One)
    lower_builtin(function, LANES_TYPE)(lambda context, builder, sig, args: build(builder, *args))


def _call(name):
    def build(builder, *arguments):
        kind = ir.FunctionType(_NUMBERS, [_NUMBERS] * len(arguments))
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64"), arguments)

    return build


for _function, _build in ((operator.add, ir.IRBuilder.fadd), (operator.sub, ir.IRBuilder.fsub),
                          (operator.mul, ir.IRBuilder.fmul),
                          (operator.truediv, ir.IRBuilder.fdiv)):
    _binary(_function, LANES_TYPE, _build)
for _function, _sign in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
                         (operator.eq, "==")):
    _binary(_function, MASK_TYPE, lambda builder, a, b,
            sign=_sign: builder.sext(builder.fcmp_ordered(sign, a, b), _WORDS))
_of_masks(operator.and_, ir.IRBuilder.and_)
_of_masks(operator.or_, ir.IRBuilder.or_)
_of_masks(operator.invert, ir.IRBuilder.not_)
_unary(abs, _call("fabs"))
_unary(operator.neg, ir.IRBuilder.fneg)


@lower_cast(types.Float, LANES_TYPE)
@lower_cast(types.Integer, LANES_TYPE)
def _from_number(context, builder, source, target, value):
    return lanes_of(builder, context.cast(builder, value, source, types.float64))


def _truth(builder, mask):
    return builder.icmp_signed("<", mask, ir.Constant(_WORDS, [0] * LANES))


@intrinsic
def nearest(typingctx, a):
    """The nearest whole number, as ``numpy.rint``."""
    return LANES_TYPE(LANES_TYPE), lambda context, builder, sig, args: _call("rint")(builder, *args)


@intrinsic
def choose(typingctx, mask, a, b):
    """A where the mask is set, b elsewhere."""
    return LANES_TYPE(MASK_TYPE, LANES_TYPE,
                      LANES_TYPE), lambda context, builder, sig, args: builder.select(_truth(builder, args[0]),
                                                                                      *args[1:])


@intrinsic
def lanes_set(typingctx, mask):
    """The mask as an integer: bit k is lane k."""
    def build(context, builder, sig, args):
        return builder.zext(builder.bitcast(_truth(builder, args[0]), ir.IntType(LANES)), _WORD)

    return types.int64(MASK_TYPE), build


@intrinsic
def load(typingctx, start, row):
    """Row ``row`` of a float64 array whose last axis has `LANES` entries.

    ``start``: its address (an array would be counted).
    """
    def build(context, builder, sig, args):
        return builder.load(_place(builder, *args), align=8)

    return LANES_TYPE(types.intp, types.intp), build


@intrinsic
def store(typingctx, start, row, value):
    """Write a value into a row, see `load`."""
    def build(context, builder, sig, args):
        builder.store(args[2], _place(builder, *args[:2]), align=8)
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, LANES_TYPE), build


def _place(builder, start, row):
    at = builder.add(start, builder.mul(row, ir.Constant(_WORD, 8 * LANES)))
    return builder.inttoptr(at, _NUMBERS.as_pointer())


@intrinsic
def table_pieces(typingctx, tables, w, shift, mask, entries):
    """Of each lane's own table: (inside, d, c_0 … c_7), see `contact.sliding_table`.

    ``tables``: address of int64 (2, LANES), the tables' addresses and first cells; w > 0: speeds; ``shift``, ``mask``,
    ``entries``: how cell and lower edge are read off a speed's bits, and the number of cells. Where w is on no cell,
    the first is taken.
    """
    def build(context, builder, sig, args):
        tables, w = args[:2]
        base, first = (builder.load(builder.bitcast(_place(builder, tables, ir.Constant(_WORD, k)),
                                                    _WORDS.as_pointer()), align=8) for k in (0, 1))
        shift, mask, entries = (_spread_word(builder, word) for word in args[2:])
        bits = builder.bitcast(w, _WORDS)
        cell = builder.sub(builder.lshr(bits, shift), first)
        inside = builder.icmp_unsigned("<", cell, entries)
        cell = builder.select(inside, cell, ir.Constant(_WORDS, [0] * LANES))
        d = builder.fsub(w, builder.bitcast(builder.and_(bits, mask), _NUMBERS))
        address = builder.add(base, builder.mul(cell, ir.Constant(_WORDS, [64] * LANES)))
        rows = [builder.inttoptr(builder.extract_element(address, ir.Constant(ir.IntType(32), k)), _QUAD.as_pointer())
                for k in range(LANES)]
        columns = []
        for half in range(2):
            quads = [builder.load(builder.gep(row, [ir.Constant(_WORD, half)]), align=8) for row in rows]
            columns += _turned(builder, quads)
        return context.make_tuple(builder, sig.return_type, [builder.sext(inside, _WORDS), d, *columns])

    return types.Tuple([MASK_TYPE] + [LANES_TYPE] * 9)(types.intp, LANES_TYPE, types.int64, types.int64,
                                                       types.int64), build


def _turned(builder, quads):
    """Four vectors over the lanes from one vector of four per lane."""
    groups = [_turned_four(builder, quads[k : k + 4]) for k in range(0, LANES, 4)]
    if LANES == 4:
        return groups[0]
    return [_shuffled(builder, low, high, range(8)) for low, high in zip(*groups)]


def _turned_four(builder, quads):
    a, b, c, d = quads
    even_low, odd_low = (_shuffled(builder, a, b, order) for order in ((0, 4, 2, 6), (1, 5, 3, 7)))
    even_high, odd_high = (_shuffled(builder, c, d, order) for order in ((0, 4, 2, 6), (1, 5, 3, 7)))
    first, last = (0, 1, 4, 5), (2, 3, 6, 7)
    return [_shuffled(builder, low, high, order) for low, high, order in (
        (even_low, even_high, first), (odd_low, odd_high, first), (even_low, even_high, last),
        (odd_low, odd_high, last))]


def _shuffled(builder, a, b, order):
    order = list(order)
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), len(order)), order))


def _spread_word(builder, value):
    vector = builder.insert_element(ir.Constant(_WORDS, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return _shuffled(builder, vector, ir.Constant(_WORDS, ir.Undefined), [0] * LANES)
