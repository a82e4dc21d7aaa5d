"""Bits of words of 64."""

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, overload


def lowest_bit(word: Any) -> int:
    """Position of the lowest bit of a word, not 0, that is set."""
    return (int(word) & -int(word)).bit_length() - 1


@intrinsic
def _count_trailing_zeros(typing_context, word):  # noqa: ARG001 - Numba passes them
    def generate(context, builder, signature, arguments):  # noqa: ARG001 - Numba passes them
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return types.uint64(types.uint64), generate


@overload(lowest_bit, inline="always")
def _lowest_bit(word):  # noqa: ARG001 - Numba matches the names
    def implementation(word):
        return _count_trailing_zeros(word)

    return implementation
