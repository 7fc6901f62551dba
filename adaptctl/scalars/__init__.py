"""Scalars of any kind, and vectors of them."""

from adaptctl.scalars.column import Column, column, each, spread
from adaptctl.scalars.dual import Dual
from adaptctl.scalars.scalar import (
    Scalar,
    absolute,
    angle,
    atan2,
    clip,
    cos,
    exp,
    log,
    maximum,
    minimum,
    nearest_whole,
    sin,
    sqrt,
    tanh,
    where,
)
from adaptctl.scalars.tunable import Keyed, Structure, Tunable
from adaptctl.scalars.vector import ZERO, Mat, Vec, cross, dot, product

__all__ = [
    "ZERO", "Column", "Dual", "Keyed", "Mat", "Scalar", "Structure", "Tunable", "Vec", "absolute", "angle", "atan2",
    "clip", "column", "cos", "cross", "dot", "each", "exp", "log", "maximum", "minimum", "nearest_whole", "product",
    "sin", "spread", "sqrt", "tanh", "where",
]  # fmt: skip
