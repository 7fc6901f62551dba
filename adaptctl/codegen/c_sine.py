"""Sine and cosine in C: the same operations as in native code here, so that results are the same bit for bit."""

from __future__ import annotations

from adaptctl.codegen.c_function import CStatements
from adaptctl.codegen.c_number import CNumber
from adaptctl.compilation.graph import Expression
from adaptctl.compilation.pieces import Piece
from adaptctl.compilation.routine import trace
from adaptctl.compilation.sine import FARTHEST, reduced

SINGLE_FARTHEST = 8192.0
"""rad; up to here the single-precision reduction holds."""

_SINGLE = """\
    const {p}_real shifted = x * 0.636619772f + 12582912.0f; /* 1.5 * 2^23: the nearest whole number */
    const {p}_real k = shifted - 12582912.0f;
    const {p}_real r = ((x - k * 1.5703125f) - k * 4.837512969970703125e-4f) - k * 7.54978995489188216e-8f;
    const {p}_real z = r * r;
    const {p}_real near_s = r + r * z * (-1.6666654611e-1f + z * (8.3321608736e-3f + z * -1.9515295891e-4f));
    const {p}_real near_c =
        (1.0f - 0.5f * z) + z * z * (4.166664568298827e-2f + z * (-1.388731625493765e-3f + z * 2.443315711809948e-5f));
"""
"""Cody and Waite's reduction and Cephes' polynomials."""


def sine_source(prefix: str, number: CNumber) -> str:
    """The C function `PREFIX_sincos`, sine and cosine: NaN where an angle is too far for its reduction."""
    near = _double(prefix, number) if number.kind == "double" else _SINGLE.format(p=prefix)
    far = FARTHEST if number.kind == "double" else SINGLE_FARTHEST
    bits = f"uint{8 * number.size}_t"
    return f"""\
/* Sine and cosine, within 2 ulp up to {far:.0f} rad and NaN beyond: Cody and Waite's reduction by quarter turns.
   After an odd number of them the two change places; the second bit of k and of k + 1 are their signs. */
static void {prefix}_sincos({prefix}_real x, {prefix}_real *{prefix.upper()}_RESTRICT s, \
{prefix}_real *{prefix.upper()}_RESTRICT c)
{{
    {bits} quarter;
    {prefix}_real first;
    {prefix}_real second;
{near}    (void)memcpy(&quarter, &shifted, sizeof quarter);
    first = ((quarter & 1u) != 0u) ? near_c : near_s;
    second = ((quarter & 1u) != 0u) ? near_s : near_c;
    *s = ((quarter & 2u) != 0u) ? -first : first;
    *c = (((quarter + 1u) & 2u) != 0u) ? -second : second;
    if (!(fabs{number.suffix}(x) <= {number.constant(far)})) {{
        *s = ({prefix}_real)NAN;
        *c = ({prefix}_real)NAN;
    }}
}}
"""


def _double(prefix: str, number: CNumber) -> str:
    """The statements up to `near_s`, `near_c` and `shifted`."""
    routine = trace(lambda x: reduced(x[0]), {"x": 1})
    code = CStatements(prefix, number, Piece(routine.body, {}, {}), {}, lambda _part, _k: "x")
    wanted = {x.index for x in routine.outputs if isinstance(x, Expression)}
    for x in routine.body:
        code.compute(x, named=x.index in wanted)
    for name, value in zip(("near_s", "near_c", "shifted"), routine.outputs, strict=True):
        code.lines.append(f"const {prefix}_real {name} = {code.operand(value)};")
    return "".join(f"    {line}\n" for line in code.lines)
