"""Exported C, built by whatever compilers are here, against the native code that Python runs: `make check-export`.

Bit for bit over 20,000 ticks of every law where nothing fuses; within 1e-12 N m in closed loop where products and sums
are fused; without warnings; without data of its own; how long a tick takes; and on a Cortex-M4F, counted by qemu, how
much code, stack and how many instructions. Names each tool that is missing, and what is not checked without it.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from casadi_peer import casadi_driver, casadi_source
from exported_laws import LAWS, LOOPED, guarded, law_named

import adaptctl
from adaptctl.arrays import Array
from adaptctl.codegen.interface import Interface
from adaptctl.codegen.recorded import default_reference
from adaptctl.compilation import compile_step
from adaptctl.compilation.processor import Processor
from adaptctl.control import Controller, ReferencePoint
from adaptctl.control.memory import leaves
from adaptctl.simulation import Plant
from adaptctl.simulation.closed_loop import ClosedLoop, Sample
from adaptctl.simulation.sampled_references import REFERENCE
from benchmarks.machine import Machine
from benchmarks.tasks import puma, semi_direct_drive

HARNESS = Path(__file__).parent / "export_harness"
TICKS, BLOCK, BLOCKS = 20_000, 500, 400
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wdouble-promotion", "-Werror"]
UNFUSED = ["-ffp-contract=off"]
GNU = [*UNFUSED, "-fno-tree-slp-vectorize"]
CORTEX = ["-mthumb", "-ffunction-sections", "-nostartfiles", "--specs=nosys.specs", "-Wl,--gc-sections"]
M4F = ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]


@dataclass(frozen=True)
class Toolchain:
    """A compiler with its flags, and what runs what it makes."""

    name: str
    command: tuple[str, ...]
    flags: tuple[str, ...]
    runner: tuple[str, ...] = ()

    @property
    def missing(self) -> str:
        """The first tool that is not here; nothing if all are."""
        for tool in (self.command[0], *self.runner[:1]):
            if shutil.which(tool) is None:
                return tool
        if "ziglang" in self.command:
            asked = subprocess.run([*self.command[:3], "version"], capture_output=True, check=False)
            return "" if asked.returncode == 0 else "ziglang"
        return ""


STATIC = ("-static",)
TOOLCHAINS = (
    Toolchain("gcc -O2", ("gcc",), ("-O2", *STRICT, *GNU)),
    Toolchain("clang -O2", ("clang",), ("-O2", *STRICT, *UNFUSED)),
    Toolchain("tcc", ("tcc",), ("-std=c99", "-Wall", "-Werror")),
    Toolchain("zig cc -O2", (sys.executable, "-m", "ziglang", "cc"), ("-O2", *STRICT, *UNFUSED)),
    Toolchain("aarch64 gcc -O2", ("aarch64-linux-gnu-gcc",), ("-O2", *STRICT, *GNU, *STATIC), ("qemu-aarch64",)),
    Toolchain("riscv64 gcc -O2", ("riscv64-linux-gnu-gcc",), ("-O2", *STRICT, *GNU, *STATIC), ("qemu-riscv64",)),
)


@dataclass(frozen=True)
class Recording:
    """Ticks of a closed loop, and what native code without fused operations makes of them."""

    ticks: Array
    """(T, 2r + 3m)"""
    torque: Array
    """(T, r)"""
    memory: Array
    """all numbers of the last memory"""


def cases() -> dict[str, Controller[Any]]:
    """Every law on a small arm and on a loop, and the arms that are timed."""
    arms = {"puma": puma().controller, "semi_direct": semi_direct_drive().controller}
    small = {re.sub(r"\W+", "_", name): law_named(name) for name in (*LAWS, *LOOPED)}
    return {**arms, "puma_guarded": guarded(puma().controller, torque=400.0), **small}


def recorded(law: Controller[Any], ticks: int = TICKS) -> Recording:
    """A closed loop of the law on its own arm, repeated without fused operations."""
    interface = Interface(law)
    mechanism: Any = interface.mechanism
    plant = Plant(mechanism, interface.period)
    loop = ClosedLoop(plant, law)
    reference = default_reference(interface)(interface.period * np.arange(ticks))
    start = np.asarray(reference.p[0] if interface.follows_joints else law.home) + 0.0
    arms = loop.compiled().ensemble(1)
    loop.begin(arms, plant.init(start, np.zeros(law.dof)), law.init(start, np.zeros(law.dof)))
    arms.held["parameters"] = mechanism.inertial_parameters
    points = dict(zip(REFERENCE, reference, strict=True))
    sample = Sample(*(x[:, 0] for x in arms.run(ticks, points | {"noise": np.zeros((ticks, 0))}, record=True)))
    rows = np.concatenate([plant.positions(sample.q), sample.v, *reference], axis=1)
    return _repeated(law, np.ascontiguousarray(rows))


def _repeated(law: Controller[Any], rows: Array) -> Recording:
    stepper = _stepper(law, Processor.host().limited("sse2"))
    arms, r = stepper.ensemble(1), law.dof
    for name, value in zip(law._memory_sizes, leaves(law.init(rows[0, :r], np.zeros(r))), strict=True):
        arms.state[_plain(name)] = value
    if law.gain_sizes:
        arms.held["gains"] = law.packed
    (torque,) = arms.run(len(rows), signals(law, rows), record=True)
    memory = np.concatenate([arms.state[_plain(name)][0] for name in law._memory_sizes])
    return Recording(rows, np.array(torque[:, 0]), np.array(memory))


def signals(law: Controller[Any], rows: Array) -> dict[str, Array]:
    """Columns of ticks by name."""
    ends = np.cumsum(list(law._given_sizes.values()))
    names = (f"given_{name}" for name in law._given_sizes)
    return {n: np.ascontiguousarray(x) for n, x in zip(names, np.split(rows, ends[:-1], axis=1), strict=True)}


def _plain(name: str) -> str:
    return name.replace(".", "_")


def _stepper(law: Controller[Any], processor: Processor | None = None) -> Any:
    """The law again and again in native code, one arm at a time."""
    equation = law._equation()

    def step(**columns: Any) -> tuple[Any, ...]:
        named = {name: columns[f"given_{name}"] for name in law._given_sizes}
        kept = {name: columns[_plain(name)] for name in law._memory_sizes}
        torque, *after = equation(**named, **kept, **{name: columns[name] for name in law.gain_sizes})
        return (*after, torque)

    return compile_step(
        step,
        state={_plain(name): size for name, size in law._memory_sizes.items()},
        held=law.gain_sizes,
        shared={f"given_{name}": size for name, size in law._given_sizes.items()},
        lanes=1,
        name="law",
        processor=processor,
    )


def defined(folder: Path, name: str, joints: int) -> list[str]:
    """What the harness is told."""
    return [f"-DNAME={name}", f'-DHEADER="{name}.h"', f"-DJOINTS={joints}", f"-I{folder}"]


def built(tool: Toolchain, folder: Path, name: str, joints: int, *more: str) -> Path:
    """A program of the harness and a package."""
    out = folder / f"replay_{re.sub(r'[^a-z0-9]', '_', tool.name)}{'_lib' if '-shared' in more else ''}"
    sources = [str(folder / f"{name}.c"), str(HARNESS / "replay.c")]
    run([*tool.command, *tool.flags, *more, *defined(folder, name, joints), *sources, "-lm", "-o", str(out)])
    return out


def run(command: Sequence[str], data: bytes | None = None) -> bytes:
    done = subprocess.run(command, input=data, capture_output=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}\n{done.stdout.decode(errors='replace')}{done.stderr.decode()}")
    return done.stdout


def same_bits(tool: Toolchain, folder: Path, name: str, recording: Recording) -> str:
    """Whether a build makes the recording's torques and memory bit for bit; what differs, if not."""
    r = recording.torque.shape[1]
    program = built(tool, folder, name, r)
    given = recording.ticks[0, :r].tobytes() + recording.ticks.tobytes()
    numbers = np.frombuffer(run([*tool.runner, str(program)], given))
    torque, memory = numbers[: recording.torque.size].reshape(-1, r), numbers[recording.torque.size :]
    if np.array_equal(torque, recording.torque) and np.array_equal(memory, recording.memory):
        return ""
    return f"differs by {np.abs(torque - recording.torque).max():.3g} N m"


def library(folder: Path, name: str, joints: int, command: str, *flags: str) -> Any:
    """A build as a library in this process."""
    tool = Toolchain(f"{command} {' '.join(flags)}", tuple(command.split()), ("-std=c99", *flags))
    path = built(tool, folder, name, joints, "-shared", "-fPIC", "-DLIBRARY")
    return ctypes.CDLL(str(path))


def pointer(array: Array) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


def fused_off(folder: Path, name: str, law: Controller[Any]) -> tuple[float, float]:
    """The largest difference of torques (N m) of two closed loops, one driven by a build that fuses, one by Python; and
    the largest torque."""
    code = library(folder, name, law.dof, "gcc", "-O2", "-mfma", "-ffp-contract=fast")
    interface = Interface(law)
    mechanism: Any = interface.mechanism
    plant = Plant(mechanism, interface.period)
    points = default_reference(interface)(interface.period * np.arange(TICKS))
    start = np.asarray(points.p[0] if interface.follows_joints else law.home) + 0.0
    ours = theirs = plant.init(start, np.zeros(law.dof))
    state, worst, largest = law.init(start, np.zeros(law.dof)), 0.0, 0.0
    code.begin(pointer(start))
    torque = np.zeros(law.dof)
    for k in range(TICKS):
        point = ReferencePoint(*(part[k] for part in points))
        packed = np.concatenate(point)
        code.run_once(pointer(theirs.p.copy()), pointer(theirs.v.copy()), pointer(packed), pointer(torque))
        expected, state = law.step(state, ours.p, ours.v, point)
        worst, largest = max(worst, np.abs(torque - expected).max()), max(largest, np.abs(expected).max())
        ours, theirs = plant.step(ours, expected), plant.step(theirs, torque.copy())
    return worst, largest


def timed(folder: Path, name: str, law: Controller[Any], recording: Recording) -> dict[str, float]:
    """ns a tick: the 2nd percentile over blocks of ticks, taken in turns."""
    r, rows = law.dof, recording.ticks
    answers = np.zeros((BLOCK, r))
    stepper = _stepper(law)
    arms = stepper.ensemble(1)
    first = leaves(law.init(rows[0, :r], np.zeros(r)))
    for key, value in zip(law._memory_sizes, first, strict=True):
        arms.state[_plain(key)] = value
    if law.gain_sizes:
        arms.held["gains"] = law.packed
    addresses = arms.state.address, arms.held.address

    def native(k: int) -> None:  # with nothing of Python around it
        given, made = rows[k : k + BLOCK].ctypes.data, answers.ctypes.data
        stepper.native(0, 1, BLOCK, rows.shape[1], 0, r, *addresses, given, 0, made)

    runs: dict[str, Any] = {"native": native}
    builds = {
        "gcc -O2 -march=native": ("gcc", "-O2", "-march=native"),
        "gcc -O3 -march=native": ("gcc", "-O3", "-march=native"),
        "gcc -O2": ("gcc", "-O2", *GNU),
        "clang -O2 -march=native": ("clang", "-O2", "-march=native"),
        "zig cc -O2 -march=native": (f"{sys.executable} -m ziglang cc", "-O2", "-march=native"),
    }
    for label, (command, *flags) in builds.items():
        if Toolchain("", tuple(command.split()), ()).missing:
            continue
        code = library(folder, name, r, command, *flags)
        code.begin(pointer(rows[0, :r].copy()))
        runs[label] = lambda k, code=code: code.run(pointer(rows[k : k + BLOCK]), pointer(answers), BLOCK)
    source = casadi_source(law, folder)
    if source is not None:
        (folder / "driver.c").write_text(casadi_driver())
        sizes = np.array(list(law._memory_sizes.values()), dtype=np.int32)
        begun = np.concatenate([np.ravel(x) for x in first])
        m = law.reference_size
        for label, more in {"CasADi, gcc -O2 -march=native": ["-march=native"], "CasADi, gcc -O2": GNU}.items():
            out = folder / f"casadi{len(runs)}.so"
            run(["gcc", "-O2", *more, "-shared", "-fPIC", str(source), str(folder / "driver.c"), "-lm", "-o", str(out)])
            other = ctypes.CDLL(str(out))
            other.casadi_begin(pointer(begun), len(begun))
            gains = law.packed.copy()
            runs[label] = lambda k, other=other, gains=gains, sizes=sizes: other.casadi_run(
                pointer(rows[k : k + BLOCK]), pointer(answers), BLOCK, r, m, len(sizes), pointer(sizes), pointer(gains)
            )
            other.casadi_run(pointer(rows), pointer(answers), BLOCK, r, m, len(sizes), pointer(sizes), pointer(gains))
            assert np.abs(answers - recording.torque[:BLOCK]).max() < 1e-9 * np.abs(recording.torque).max()
            other.casadi_begin(pointer(begun), len(begun))
    taken: dict[str, list[float]] = {label: [] for label in runs}
    for turn in range(BLOCKS):
        k = (turn * BLOCK) % (len(rows) - BLOCK)
        for label, call in runs.items():
            begin = time.perf_counter_ns()
            call(k)
            taken[label].append((time.perf_counter_ns() - begin) / BLOCK)
    return {label: float(np.quantile(times, 0.02)) for label, times in taken.items()}


def sections(object_file: Path, tool: str = "size") -> dict[str, int]:
    """Bytes of text, data and bss."""
    head, row = run([tool, str(object_file)]).decode().splitlines()[:2]
    return {name: int(value) for name, value in zip(head.split()[:3], row.split()[:3], strict=True)}


def on_cortex_m(folder: Path, name: str, joints: int) -> dict[str, Any]:
    """Flash, stack and instructions of a package on a Cortex-M4F."""
    out, given = folder / "m4f.elf", defined(folder, name, joints)
    compiler = ["arm-none-eabi-gcc", "-O2", *M4F, *CORTEX]
    run([*compiler, *STRICT, *GNU, *given, "-c", str(folder / f"{name}.c"), "-o", str(folder / "m4f.o")])
    script = ["-T", str(HARNESS / "cortex_m.ld")]
    run([*compiler, *given, str(folder / f"{name}.c"), str(HARNESS / "cortex_m.c"), *script, "-lm", "-o", str(out)])
    machine = ["qemu-system-arm", "-M", "mps2-an386", "-nographic", "-semihosting", "-icount", "shift=0"]
    told = run(["sh", "-c", f"{' '.join(machine)} -kernel {out} 2>&1"]).decode()
    symbols = run(["arm-none-eabi-nm", "-S", str(out)]).decode()
    flash = sum(int(size, 16) for size in re.findall(rf"^\w+ (\w+) [tTrR] {name}_", symbols, re.MULTILINE))
    return (
        sections(folder / "m4f.o", "arm-none-eabi-size")
        | {"flash": flash}
        | {key: int(value) for key, value in re.findall(r"^(\w+) (\d+)\s*$", told, re.MULTILINE)}
    )


def report(chosen: Sequence[str]) -> Iterator[str]:
    """Lines of what was checked; ends in SystemExit where something failed."""
    yield f"{Machine.here()}; load {os.getloadavg()[0]:.1f}"
    available = [tool for tool in TOOLCHAINS if not tool.missing]
    for tool in TOOLCHAINS:
        if tool.missing:
            yield f"missing: {tool.missing}: {tool.name} is not checked"
    failed = False
    with tempfile.TemporaryDirectory() as place:
        for name, law in cases().items():
            if chosen and name not in chosen:
                continue
            folder = Path(place) / name
            made = adaptctl.export(law, folder, name=name, unguarded=True, large_stack=True)
            recording = recorded(law)
            found = {tool.name: same_bits(tool, folder, name, recording) for tool in available}
            wrong = {tool: what for tool, what in found.items() if what}
            own = sections(_object(folder, name))
            empty = own["data"] == own["bss"] == 0
            off, largest = fused_off(folder, name, law)
            run([str(_tests(folder, name))])
            failed |= bool(wrong) or not empty or off > 1e-12 * max(1.0, largest)
            yield (
                f"{name}: {made.manifest['flops']} flops; {len(found) - len(wrong)} of {len(found)} builds are the "
                f"same bit for bit over {TICKS} ticks{f' ({wrong})' if wrong else ''}; fused, in closed loop, "
                f"{off:.2g} of {largest:.3g} N m off; text {own['text']}, data {own['data']}, bss {own['bss']} B; "
                f"stack {_stack(folder, name)} B by gcc, about {made.manifest['stack_bytes_about']} by export"
            )
            if name.startswith(("puma", "semi")):
                times = timed(folder, name, law, recording)
                yield "  ns a tick: " + ", ".join(
                    f"{label} {ns:.0f} ({ns / times['native']:.2f})" for label, ns in times.items()
                )
                single = Path(place) / f"{name}_float"
                adaptctl.export(law, single, name=name, scalar="float", unguarded=True)
                if shutil.which("arm-none-eabi-gcc") and shutil.which("qemu-system-arm"):
                    yield f"  Cortex-M4F, float: {on_cortex_m(single, name, law.dof)}"
                else:
                    yield "  missing: arm-none-eabi-gcc and qemu-system-arm: no microcontroller is checked"
    if failed:
        raise SystemExit("check-export: FAILED")


def _object(folder: Path, name: str) -> Path:
    out = folder / "own.o"
    run(["gcc", "-O2", "-fstack-usage", *STRICT, *GNU, "-c", str(folder / f"{name}.c"), "-o", str(out)])
    return out


def _stack(folder: Path, name: str) -> int:
    """The frames of a step, its law, and the largest other function of the law."""
    usage = [line.split("\t") for line in (folder / "own.su").read_text().splitlines()]
    frames = {row[0].rsplit(":", 1)[1]: int(row[1]) for row in usage}
    outer = sum(frames.get(f"{name}_{part}", 0) for part in ("step", "law"))
    inner = [size for part, size in frames.items() if re.match(rf"{name}_(law_\d+|\w+_\d+|sincos)", part)]
    return outer + max(inner, default=0)


def _tests(folder: Path, name: str) -> Path:
    out = folder / "tests"
    sources = [str(folder / f"{name}.c"), str(folder / f"test_{name}.c")]
    run(["gcc", "-O2", *STRICT, *GNU, *sources, "-lm", "-o", str(out)])
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("laws", nargs="*", help="names of laws; all of them unless given")
    warnings.simplefilter("ignore")
    if shutil.which("gcc") is None:
        raise SystemExit("check-export: missing: gcc, without which nothing is checked")
    for line in report(parser.parse_args().laws):
        print(line, flush=True)


if __name__ == "__main__":
    main()
