"""Exported C, built by whatever compilers are here, against the native code that Python runs: `make check-export`.

Bit for bit over 20,000 ticks of every law where nothing fuses; within 1e-12 N m in closed loop, in parts of the largest
torque where that is above 1, where products and sums are fused; without warnings; without data of its own; refused
where arithmetic is careless; how long a tick takes; and on a Cortex-M4F, counted by qemu, how much code, stack and how
many instructions. Names each tool that is missing, and what is not checked without it. With `--publish`
a run over all laws is kept in benchmarks/export.json, and docs/export.md shows it.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from every_law import LAWS, REDUCED, guarded, law_named
from export_builds import CARELESS, GCC, GNU, HARNESS, STRICT, TOOLCHAINS, Package, Toolchain, run, sections
from export_published import ARMS, Figures, publish
from export_ticks import TICKS, Ticks, Trial
from export_times import pointer, timed

import adaptctl
from adaptctl.compilation.native import Processor
from adaptctl.control import Controller, ReferencePoint
from benchmarks.machine import Machine
from benchmarks.tasks import puma, semi_direct_drive

CORTEX = ("-mthumb", "-ffunction-sections", "-nostartfiles", "--specs=nosys.specs", "-Wl,--gc-sections")
M4F = ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
FUSING = Toolchain("gcc fusing", ("gcc",), ("-std=c99", "-O2", "-mfma", "-ffp-contract=fast"))
BOUND = 1e-12
"""of torques, N m, in parts of the largest where that is above 1"""
TIMED = tuple(ARMS)


def cases() -> dict[str, Controller[Any]]:
    """Every law on a small arm, on one with drives and on a loop; and the arms that are timed."""
    arms = {"puma": puma().controller, "semi_direct": semi_direct_drive().controller}
    small = {re.sub(r"\W+", "_", name): law_named(name) for name in (*LAWS, *REDUCED)}
    return {**arms, "puma_guarded": guarded(puma().controller, torque=400.0), **small}


def differing(tool: Toolchain, package: Package, ticks: Ticks) -> str:
    """How a build differs from the ticks' torques and last memory; nothing where it is the same bit for bit."""
    given = ticks.given[0, : package.joints].tobytes() + ticks.given.tobytes()
    numbers = np.frombuffer(run([*tool.runner, str(package.replay(tool))], given))
    torque, memory = numbers[: ticks.torque.size].reshape(ticks.torque.shape), numbers[ticks.torque.size :]
    if np.array_equal(torque, ticks.torque) and np.array_equal(memory, ticks.memory):
        return ""
    return f"differs by {np.abs(torque - ticks.torque).max():.3g} N m"


def fused_off(package: Package, trial: Trial) -> tuple[float, float]:
    """The largest difference of torques (N m) of two closed loops, one driven by a build that fuses, one by Python; and
    the largest torque."""
    code, law, plant, points = package.library(FUSING), trial.law, trial.plant, trial.points()
    start = trial.started(points)
    ours = theirs = plant.init(start, np.zeros(law.dof))
    state, worst, largest = law.init(start, np.zeros(law.dof)), 0.0, 0.0
    code.begin(pointer(start))
    torque = np.zeros(law.dof)
    for k in range(TICKS):
        point = ReferencePoint(*(part[k] for part in points))
        given = theirs.p.copy(), theirs.v.copy(), np.concatenate(point)
        code.run_once(*map(pointer, given), pointer(torque))
        expected, state = law.step(state, ours.p, ours.v, point)
        worst, largest = max(worst, np.abs(torque - expected).max()), max(largest, np.abs(expected).max())
        ours, theirs = plant.step(ours, expected), plant.step(theirs, torque.copy())
    return float(worst), float(largest)


def on_cortex_m(package: Package) -> dict[str, int]:
    """Flash, stack and instructions of a package on a Cortex-M4F."""
    folder, name = package.folder, package.name
    out, source = folder / "m4f.elf", str(folder / f"{name}.c")
    compiler = ("arm-none-eabi-gcc", "-O2", *M4F, *CORTEX)
    run([*compiler, *STRICT, *GNU, *package.told, "-c", source, "-o", str(folder / "m4f.o")])
    script = ["-T", str(HARNESS / "cortex_m.ld")]
    run([*compiler, *package.told, source, str(HARNESS / "cortex_m.c"), *script, "-lm", "-o", str(out)])
    machine = ["qemu-system-arm", "-M", "mps2-an386", "-nographic", "-semihosting", "-icount", "shift=0"]
    told = run(["sh", "-c", f"{' '.join(machine)} -kernel {out} 2>&1"]).decode()
    symbols = run(["arm-none-eabi-nm", "-S", str(out)]).decode()
    flash = sum(int(size, 16) for size in re.findall(rf"^\w+ (\w+) [tTrR] {name}_", symbols, re.MULTILINE))
    counted = {key: int(value) for key, value in re.findall(r"^(\w+) (\d+)\s*$", told, re.MULTILINE)}
    return sections(folder / "m4f.o", "arm-none-eabi-size") | {"flash": flash} | counted


class Check:
    """What was found of all laws so far: `lines` tell of one law each."""

    def __init__(self, place: Path, host: Processor, found: Figures) -> None:
        self.place, self.host, self.found = place, host, found
        self.tools = [tool for tool in TOOLCHAINS if not tool.missing]
        self.failed: list[str] = []
        self.worst = 0.0

    def lines(self, name: str, law: Controller[Any]) -> Iterator[str]:
        """What was found of one law."""
        made = adaptctl.export(law, self.place / name, name=name, without_safety_filter=True, large_stack=True)
        package, trial = Package(made.directory, name, law.dof), Trial(law)
        ticks = trial.recorded()
        found = {tool.name: differing(tool, package, ticks) for tool in self.tools}
        wrong = {tool: what for tool, what in found.items() if what}
        own = sections(package.compiled(GCC))
        off, largest = fused_off(package, trial)
        for tool in self.tools:
            run([*tool.runner, str(package.tests(tool))])
        bad = bool(wrong) or own["data"] != 0 or own["bss"] != 0 or off > BOUND * max(1.0, largest)
        self.failed += [name] if bad else []
        self.found.count(len(found), len(wrong))
        self.worst = max(self.worst, off)
        yield (
            f"{name}: {made.manifest['flops']} flops; {len(found) - len(wrong)} of {len(found)} builds are the same "
            f"bit for bit over {TICKS} ticks{f' ({wrong})' if wrong else ''}; fused, in closed loop, {off:.2g} of "
            f"{largest:.3g} N m off; text {own['text']}, data {own['data']}, bss {own['bss']} B; stack "
            f"{package.stack()} B by gcc, about {made.manifest['stack_bytes_about']} by export"
        )
        if name in TIMED:
            times = self.found.times[name] = timed(package, trial, ticks, self.host)
            yield "  ns per tick: " + ", ".join(
                f"{label} {ns:.0f} ({ns / times['native']:.2f})" for label, ns in times.items()
            )
            yield from self._single(name, law)

    def _single(self, name: str, law: Controller[Any]) -> Iterator[str]:
        """What single precision takes on a microcontroller."""
        made = adaptctl.export(law, self.place / f"{name}_float", name=name, scalar="float", without_safety_filter=True)
        if shutil.which("arm-none-eabi-gcc") and shutil.which("qemu-system-arm"):
            self.found.cortex[name] = on_cortex_m(Package(made.directory, name, law.dof))
            yield f"  Cortex-M4F, float: {self.found.cortex[name]}"
        else:
            yield "  missing: arm-none-eabi-gcc and qemu-system-arm: no microcontroller is checked"

    def careless(self) -> Iterator[str]:
        """What is built with arithmetic that is not IEEE's."""
        made = adaptctl.export(law_named("guarded"), self.place / "careless", name="careless")
        accepted = list(Package(made.directory, "careless", 3).accepted())
        self.failed += accepted
        for compiler in CARELESS:
            if shutil.which(compiler) is None:
                yield f"missing: {compiler}: nothing is built by it with careless arithmetic"
        flags = sum(len(flags) for compiler, flags in CARELESS.items() if shutil.which(compiler))
        told = f", not: {', '.join(accepted)}" if accepted else ""
        yield f"careless arithmetic: refused by #error with {flags - len(accepted)} of {flags} flags{told}"


def report(chosen: Sequence[str], host: Processor, figures: Figures) -> Iterator[str]:
    """Lines of what was checked; ends in SystemExit where something failed."""
    yield f"{Machine.here()}; load {os.getloadavg()[0]:.1f}"
    for tool in TOOLCHAINS:
        if tool.missing:
            yield f"missing: {tool.missing}: {tool.name} is not checked"
    laws = cases()
    if unknown := set(chosen) - {*laws, "careless"}:
        raise SystemExit(f"check-export: no law is named {', '.join(sorted(unknown))}; laws: {', '.join(laws)}")
    with tempfile.TemporaryDirectory() as place:
        check = Check(Path(place), host, figures)
        for name, law in laws.items():
            if not chosen or name in chosen:
                yield from check.lines(name, law)
        if not chosen or "careless" in chosen:
            yield from check.careless()
    spent = os.times()
    yield (
        f"{figures.laws} laws, {figures.agree} of {figures.builds} builds the same bit for bit over {TICKS} ticks "
        f"each; fused at most {check.worst:.2g} N m off; {sum(spent[:4]):.0f} s of processor time, "
        f"{time.monotonic() - BEGUN:.0f} s"
    )
    if check.failed:
        raise SystemExit(f"check-export: FAILED: {', '.join(check.failed)}")


BEGUN = time.monotonic()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("laws", nargs="*", help="names of laws, or careless; all of them unless given")
    parser.add_argument("--publish", action="store_true", help="keep the figures, and show them in docs/export.md")
    warnings.simplefilter("ignore")
    if shutil.which("gcc") is None:
        raise SystemExit("check-export: missing: gcc, without which nothing is checked")
    given, host, figures = parser.parse_args(), Processor.host(), Figures()
    if given.laws and given.publish:
        raise SystemExit("check-export: figures of some laws are not published: give --publish alone")
    os.environ["ADAPTCTL_PROCESSOR"] = "sse2"  # a loop's first configuration is computed without fused operations too
    for line in report(given.laws, host, figures):
        print(line, flush=True)
    if given.publish:
        publish(figures.kept())


if __name__ == "__main__":
    main()
