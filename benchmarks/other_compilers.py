"""The same regressor, operation for operation, compiled by others: a C compiler, CasADi, numba, JAX.

Those that are not installed are skipped by name: `pip install casadi numba jax`, best into an environment of its own
beside adaptctl, and a `cc`; nothing else here needs them, and `make bench` does not run it. Then:
`python -m benchmarks.other_compilers`.
"""

from __future__ import annotations

import ctypes
import operator
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

os.environ["ADAPTCTL_CACHE"] = "off"  # nobody else's is used either
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import Op, Routine, compile_function, trace
from adaptctl.compilation.graph import Expression
from adaptctl.files import write_text
from benchmarks.interleaved import Effort, Statement, race
from benchmarks.machine import Machine
from benchmarks.published import ROOT, inserted, seconds, table
from benchmarks.regressor import ARGUMENTS, regressor

SAMPLES = 1024
SHAPE = (6, 36)

Call = Callable[[], Any]


class Compiled(NamedTuple):
    """A compiler's result: a call for one sample, and one for all; each was called once, which took `first` s."""

    one: Call
    all: Call
    first: float


def ours(_: Routine, samples: Array) -> Compiled:
    """The regressor by adaptctl, each call into a fresh array."""
    begin = time.perf_counter()
    kernel = compile_function(regressor, ARGUMENTS)
    kernel(*samples[:, 0])
    first = time.perf_counter() - begin
    p, v, v_r, a_r = samples[:, 0].copy()
    return Compiled(lambda: kernel(p, v, v_r, a_r), lambda: kernel.map(*samples), first)


def c(routine: Routine, samples: Array) -> Compiled:
    """The operations as a C function of as many lines, which may fuse as we do; called by ctypes with addresses that
    are made before."""
    begin = time.perf_counter()
    library = shared_library(c_source(routine))
    first = time.perf_counter() - begin
    given, result, results = samples[:, 0].copy(), np.empty(SHAPE), np.empty((SAMPLES, *SHAPE))
    addresses = [ctypes.c_void_p(x.ctypes.data) for x in (*given, result)]
    arrays = [ctypes.c_void_p(x.ctypes.data) for x in (*samples, results)]
    function, loop = library.regressor, library.regressors

    def one(_kept: object = given) -> Array:
        function(*addresses)
        return result

    def all_of_them(_kept: object = samples) -> Array:
        loop(SAMPLES, *arrays)
        return results

    return Compiled(one, all_of_them, first)


def shared_library(text: str) -> ctypes.CDLL:
    """A C file compiled for this processor, and loaded."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "regressor.c"
        path.write_text(text, encoding="utf-8")
        return ctypes.CDLL(str(compiled_c(path)))


def compiled_c(path: Path) -> Path:
    """The shared library of a C file, beside it."""
    made = path.with_suffix(".so")
    options = ("-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno", "-shared", "-fPIC")
    subprocess.run(["cc", *options, str(path), "-o", str(made), "-lm"], check=True)
    return made


def c_source(routine: Routine) -> str:
    """The routine's operations in C, one per line, and a loop over samples."""
    pointers = ", ".join(f"const double *restrict {name}" for name in ARGUMENTS)
    lines = [f"    const double {line};" for line in assignments(routine)]
    results = [f"    result[{k}] = {_name(x)};" for k, x in enumerate(routine.outputs)]
    body = "\n".join([*lines, *results])
    moved = ", ".join(f"{name} + {size} * k" for name, size in ARGUMENTS.items())
    return f"""#include <math.h>

void regressor({pointers}, double *restrict result) {{
{body}
}}

void regressors(int count, {pointers}, double *restrict results) {{
    for (int k = 0; k < count; ++k)
        regressor({moved}, results + {SHAPE[0] * SHAPE[1]} * k);
}}
"""


def casadi(routine: Routine, samples: Array) -> Compiled:
    """CasADi's virtual machine, called through buffers, which is its fastest way to be called."""
    begin = time.perf_counter()
    function = _casadi_function(routine)
    one = _buffered(function, samples[:, 0].copy(), SHAPE)
    one()
    first = time.perf_counter() - begin
    return Compiled(one, _buffered(function.map(SAMPLES), samples, (SAMPLES, *SHAPE)), first)


def casadi_c(routine: Routine, samples: Array) -> Compiled:
    """CasADi's C code by the C compiler, called by CasADi in the same way."""
    import casadi as ca

    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        code = ca.CodeGenerator("regressor.c")
        code.add(_casadi_function(routine))
        code.generate(f"{folder}/")
        function = ca.external("regressor", str(compiled_c(Path(folder) / "regressor.c")))
        one = _buffered(function, samples[:, 0].copy(), SHAPE)
        one()
        first = time.perf_counter() - begin
        return Compiled(one, _buffered(function.map(SAMPLES), samples, (SAMPLES, *SHAPE)), first)


def _casadi_function(routine: Routine) -> Any:
    """The routine as CasADi's function; its matrices run down the columns."""
    import casadi as ca

    symbols = [ca.SX.sym(name, n) for name, n in ARGUMENTS.items()]
    return ca.Function("regressor", symbols, [ca.vertcat(*replayed(routine, symbols, ca.sin, ca.cos))])


def _buffered(function: Any, given: Iterable[Array], shape: tuple[int, ...]) -> Call:
    """A call of CasADi's function through buffers of its numbers."""
    result, (buffer, evaluate) = np.empty(shape), function.buffer()
    for k, x in enumerate(given):
        buffer.set_arg(k, x.data)
    buffer.set_res(0, result.data)

    def call(_kept: object = (function, buffer, given)) -> Array:  # CasADi keeps none of them alive
        evaluate()
        return result

    return call


def numba(routine: Routine, samples: Array) -> Compiled:
    """numba, on the operations as a Python function of as many lines, which it may fuse as we do."""
    import numba as nb

    begin = time.perf_counter()
    names: dict[str, Any] = {"sin": np.sin, "cos": np.cos}
    exec(source(routine), names)
    compiled = nb.njit(names["regressor"], fastmath={"contract"})
    p, v, v_r, a_r = samples[:, 0].copy()
    result = np.empty(SHAPE)

    def one() -> Array:
        compiled(p, v, v_r, a_r, result)
        return result

    one()
    first = time.perf_counter() - begin

    def one_by_one(p: Array, v: Array, v_r: Array, a_r: Array, results: Array) -> None:
        for k in range(len(p)):
            compiled(p[k], v[k], v_r[k], a_r[k], results[k])

    loop = nb.njit(one_by_one)
    results = np.empty((SAMPLES, *SHAPE))

    def all_of_them() -> Array:
        loop(*samples, results)
        return results

    return Compiled(one, all_of_them, first)


def jax(routine: Routine, samples: Array) -> Compiled:
    """JAX on the processor, in double precision, on one thread, from arrays that are its own already."""
    import jax as jx
    import jax.numpy as jnp

    jx.config.update("jax_enable_x64", True)
    begin = time.perf_counter()

    def function(*arguments: Any) -> Any:
        return jnp.stack(replayed(routine, arguments, jnp.sin, jnp.cos)).reshape(SHAPE)

    compiled, given = jx.jit(function), [jnp.asarray(x) for x in samples[:, 0]]
    compiled(*given).block_until_ready()
    first = time.perf_counter() - begin
    mapped, every = jx.jit(jx.vmap(function)), [jnp.asarray(x) for x in samples]
    return Compiled(lambda: compiled(*given).block_until_ready(), lambda: mapped(*every).block_until_ready(), first)


class Peer(NamedTuple):
    """A compiler of the table, and what it needs: packages, and a C compiler or not."""

    compile: Callable[[Routine, Array], Compiled]
    package: str | None
    in_c: bool = False

    @property
    def missing(self) -> str:
        """Name of what is not installed; empty when all is."""
        if self.in_c and shutil.which("cc") is None:
            return "a C compiler (cc)"
        return self.package if self.package is not None and find_spec(self.package) is None else ""

    @property
    def version(self) -> str:
        """Version of the package, or of the C compiler."""
        if self.package is not None:
            return version(self.package)
        return subprocess.run(["cc", "-dumpversion"], check=True, capture_output=True, text=True).stdout.strip()


COMPILERS: Mapping[str, Peer] = {
    "adaptctl": Peer(ours, "adaptctl"),
    "C, cc -O3 -march=native": Peer(c, None, in_c=True),
    "casadi": Peer(casadi, "casadi"),
    "casadi, its C by cc": Peer(casadi_c, "casadi", in_c=True),
    "numba": Peer(numba, "numba"),
    "jax": Peer(jax, "jax"),
}

_ARITHMETIC: dict[Op, Callable[..., Any]] = {
    Op.ADD: operator.add,
    Op.SUBTRACT: operator.sub,
    Op.MULTIPLY: operator.mul,
    Op.DIVIDE: operator.truediv,
    Op.NEGATE: operator.neg,
}


def replayed(routine: Routine, arguments: Sequence[Any], sin: Callable[..., Any], cos: Callable[..., Any]) -> list[Any]:
    """The routine's outputs, its operations done one by one on another's numbers."""
    operations = _ARITHMETIC | {Op.SIN: sin, Op.COS: cos}
    known: dict[int, Any] = {}

    def value(x: Any) -> Any:
        return known[x.index] if isinstance(x, Expression) else x

    for x in routine.body:
        part, k = x.detail or (0, 0)
        known[x.index] = arguments[part][k] if x.op is Op.INPUT else operations[x.op](*map(value, x.operands))
    return [value(output) for output in routine.outputs]


def source(routine: Routine) -> str:
    """The routine's operations in Python, one per line; results go into the last argument."""
    lines = [f"def regressor({', '.join(ARGUMENTS)}, result):", *(f"    {line}" for line in assignments(routine))]
    lines += [f"    result[{k // SHAPE[1]}, {k % SHAPE[1]}] = {_name(x)}" for k, x in enumerate(routine.outputs)]
    return "\n".join(lines)


def assignments(routine: Routine) -> Iterator[str]:
    """The routine's operations, in what Python and C have in common."""
    for x in routine.body:
        operands = [_name(y) for y in x.operands]
        if x.op is Op.INPUT:
            text = f"{list(ARGUMENTS)[x.detail[0]]}[{x.detail[1]}]"
        elif x.op is Op.NEGATE:
            text = f"-{operands[0]}"
        else:
            text = f"{x.op}({operands[0]})" if x.op in (Op.SIN, Op.COS) else str(x.op).join(operands)
        yield f"{_name(x)} = {text}"


def _name(x: Any) -> str:
    return f"x{x.index}" if isinstance(x, Expression) else f"({x!r})"


def import_time(package: str) -> float:
    """Seconds that a fresh process needs to import it, less what it needs for NumPy."""

    def taken(what: str) -> float:
        begin = time.perf_counter()
        subprocess.run([sys.executable, "-c", f"import {what}"], check=True)
        return time.perf_counter() - begin

    taken(package)
    return float(np.median([taken(package) - taken("numpy") for _ in range(5)]))


def _imported_in(package: str | None) -> str:
    if package is None:
        return ""
    return f"{import_time('adaptctl.compilation' if package == 'adaptctl' else package):.2f} s"


def main() -> None:
    """The table, on the screen and in docs/speed.md."""
    routine = trace(regressor, ARGUMENTS)
    samples = np.random.default_rng(0).normal(size=(len(ARGUMENTS), SAMPLES, 6))
    made = {}
    for name, peer in COMPILERS.items():
        if peer.missing:
            print(f"{name}: skipped, for {peer.missing} is not installed", file=sys.stderr)
        else:
            made[name] = peer.compile(routine, samples)
    expected = np.array(made["adaptctl"].all())
    bound = 1e-12 * np.abs(expected).max()
    for name, compiled in made.items():
        np.testing.assert_allclose(compiled.one(), expected[0], rtol=0, atol=bound, err_msg=name)
        np.testing.assert_allclose(compiled.all(), expected, rtol=0, atol=bound, err_msg=name)
    ones = race({name: Statement(compiled.one) for name, compiled in made.items()}, Effort())
    alls = race({name: Statement(compiled.all, work=SAMPLES) for name, compiled in made.items()}, Effort())
    head = ("compiler", "imported in", "traced and compiled in", "a call", f"one of {SAMPLES:,} at once")
    rows = [
        (
            f"{name} {COMPILERS[name].version}",
            _imported_in(COMPILERS[name].package),
            f"{compiled.first:.2f} s",
            seconds(ones.time(name)),
            seconds(alls.time(name)),
        )
        for name, compiled in made.items()
    ]
    if len(made) < len(COMPILERS):
        print(f"{table(head, rows)}\nnot published: not all are installed")
        return
    text = f"{routine.operations.flops} operations; {Machine.here()}.\n\n{table(head, rows)}"
    print(text)
    page = ROOT / "docs" / "speed.md"
    write_text(page, inserted(page.read_text(encoding="utf-8"), text, "python -m benchmarks.other_compilers"))


if __name__ == "__main__":
    main()
