"""Sine and cosine in C: the same operations as in native code here, so that results are the same bit for bit."""

from __future__ import annotations

from adaptctl.codegen.c_function import CStatements
from adaptctl.codegen.c_number import CNumber
from adaptctl.compilation.graph import Expression
from adaptctl.compilation.llvm import Piece
from adaptctl.compilation.routine import trace
from adaptctl.compilation.sine import Sine, sine_for


def sine_source(prefix: str, number: CNumber) -> str:
    """The C function, as text, of sine and cosine of an angle, `static void` and named `prefix` and "_sincos": its
    parameters are the angle x in rad and pointers to where the sine and the cosine are to go, in this order. `number`
    is the kind of number, double or float; the operations are those of the native code in Python. It gives NaN for
    angles beyond about 1e6 rad in double, 8192 rad in float. Nothing is raised."""
    sine = sine_for(number.precision)
    near, far = _near(prefix, number, sine), sine.farthest
    bits, within = f"uint{8 * number.size}_t", "2 ulp" if number.kind == "double" else "1.2e-7"
    return f"""\
/* Sine and cosine, within {within} up to {far:.0f} rad and NaN beyond: Cody and Waite's reduction by quarter turns.
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


def _near(prefix: str, number: CNumber, sine: Sine) -> str:
    """The statements up to `near_s`, `near_c` and `shifted`."""
    routine = trace(lambda x: sine.reduced(x[0]), {"x": 1})
    code = CStatements(prefix, number, Piece(routine.body, {}, {}), {}, lambda _part, _k: "x")
    wanted = {x.index for x in routine.outputs if isinstance(x, Expression)}
    for x in routine.body:
        code.compute(x, named=x.index in wanted)
    for name, value in zip(("near_s", "near_c", "shifted"), routine.outputs, strict=True):
        code.lines.append(f"const {prefix}_real {name} = {code.operand(value)};")
    return "".join(f"    {line}\n" for line in code.lines)
