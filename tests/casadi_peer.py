"""CasADi's C of a law's graph, to be timed beside ours."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any

from adaptctl.codegen.interface import Interface
from adaptctl.control import Controller


def casadi_source(law: Controller[Any], folder: Path) -> Path | None:
    """CasADi's C of the same graph; None without CasADi."""
    try:
        import casadi as ca
    except ImportError:
        return None
    from adaptctl.compilation import Op
    from adaptctl.compilation.graph import Expression

    routine = Interface(law).law
    given = [ca.SX.sym(f"in{k}", max(n, 1)) for k, n in enumerate(routine.inputs)]
    simple: dict[Op, Any] = {
        Op.ADD: lambda x, y: x + y, Op.SUBTRACT: lambda x, y: x - y, Op.MULTIPLY: lambda x, y: x * y,
        Op.DIVIDE: lambda x, y: x / y, Op.NEGATE: lambda x: -x, Op.SIN: ca.sin, Op.COS: ca.cos, Op.SQRT: ca.sqrt,
        Op.ABSOLUTE: ca.fabs, Op.MINIMUM: ca.fmin, Op.MAXIMUM: ca.fmax, Op.LESS: lambda x, y: x < y,
        Op.LESS_EQUAL: lambda x, y: x <= y, Op.SELECT: ca.if_else, Op.ROUND: lambda x: ca.floor(x + 0.5),
    }  # fmt: skip
    known: dict[int, Any] = {}
    for x in routine.body:
        operands = [known[y.index] if isinstance(y, Expression) else y for y in x.operands]
        known[x.index] = given[x.detail[0]][x.detail[1]] if x.op is Op.INPUT else simple[x.op](*operands)
    values = [known[y.index] if isinstance(y, Expression) else y for y in routine.outputs]
    made = []
    for place in routine.layout.places:
        made.append(ca.vertcat(*values[place]) if place.stop > place.start else ca.SX(0, 1))
    function = ca.Function("casadi_law", given, made)
    here = Path.cwd()
    os.chdir(folder)
    try:
        function.generate("casadi_law.c")
    finally:
        os.chdir(here)
    return folder / "casadi_law.c"


@cache
def casadi_driver() -> str:
    """A loop over ticks around CasADi's function, which reads one memory and writes another in turns."""
    return """
#include <string.h>
int casadi_law(const double **, double **, long long *, double *, int);
static double memory[2][1 << 14];
static int now;
void casadi_begin(const double *first, int count) { memcpy(memory[0], first, sizeof(double) * count); now = 0; }
void casadi_run(const double *ticks, double *torque, int count, int joints, int reference, int parts, const int *sizes,
                const double *gains)
{
    static double w[1 << 16];
    static long long iw[1 << 12];
    for (int k = 0; k < count; k++, ticks += 2 * joints + 3 * reference, torque += joints) {
        const double *arg[128] = {ticks, ticks + joints, ticks + 2 * joints, ticks + 2 * joints + reference,
                                  ticks + 2 * joints + 2 * reference};
        double *res[128] = {torque};
        const double *from = memory[now];
        double *to = memory[1 - now];
        for (int j = 0; j < parts; j++) {
            arg[5 + j] = from;
            res[1 + j] = to;
            from += sizes[j];
            to += sizes[j];
        }
        arg[5 + parts] = gains;
        casadi_law(arg, res, iw, w, 0);
        now = 1 - now;
    }
}
"""
