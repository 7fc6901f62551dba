"""Exported controllers, built by whatever compilers are here, on ticks recorded from Python."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from adaptctl.codegen import export
from adaptctl.codegen.exporting import Exported
from adaptctl.control import Controller
from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.experiments.build_grid import build_grid
from adaptctl.experiments.experiment import Experiment, setting, stated
from adaptctl.files import write_json, write_text
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import Progress, Result
from adaptctl.recording.page import embedded, rendered
from adaptctl.recording.verdict import Failure, Verdict
from adaptctl.tuning import tune
from adaptctl.tuning.named_laws import LAWS, guarded, named_law

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing

COMPILERS = {
    "cc": ("cc",),
    "clang": ("clang",),
    "tcc": ("tcc",),
    "zig cc": (sys.executable, "-m", "ziglang", "cc"),
}
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
PATIENCE = 300.0
"""s for a compiler, or for what it made"""


@dataclass(frozen=True)
class Build:
    """A build of an exported law by one compiler, with one kind of number: whether it repeated the recorded ticks, and
    its message."""

    law: str
    scalar: str
    compiler: str
    passed: bool
    message: str


@dataclass(frozen=True)
class ExportCheck(Experiment):
    """Experiment on exports of laws, each built by every compiler that is found, each build run on its own test
    vectors."""

    name: ClassVar[str] = "export-check"
    title: ClassVar[str] = "{robot}: exported controllers, compiled and compared"

    robot: str = setting("puma560_geared", "a built-in robot or a file (.urdf, .xml, .toml)")
    laws: tuple[str, ...] = setting(LAWS, "which laws are exported")
    scalars: tuple[str, ...] = setting(("double", "float"), "kinds of number")
    control_period: float = setting(1e-3, "time a torque is held, s", symbol="T_c", low=1e-4, high=0.02)

    def run(self, progress: Progress) -> Result:
        """Result of all builds. Raises `InputError` where no compiler is found."""
        compilers = found_compilers()
        if not compilers:
            raise InputError(f"export-check: no compiler is found; install one of: {', '.join(COMPILERS)}")
        builds: list[Build] = []
        complete = False
        try:
            for build in self._builds(compilers, progress):
                builds.append(build)
            complete = True
        except KeyboardInterrupt:
            if not builds:
                raise
        failed = [
            (Failure.DIFFERS, f"{b.law} ({b.scalar}) by {b.compiler}: {b.message}.") for b in builds if not b.passed
        ]
        verdict = Verdict.of(failed)
        missing = [name for name in COMPILERS if name not in compilers]
        answer = f"{sum(b.passed for b in builds)} of {len(builds)} builds repeat what Python did."
        facts = (
            ("Laws", f"{len(self.laws)}"),
            ("Compilers", ", ".join(compilers)),
            ("Not found", ", ".join(missing) or "none"),
            ("Builds that agree", f"{sum(b.passed for b in builds)} of {len(builds)}"),
        )
        headline = verdict.before(answer)

        def write(folder: Path, _progress: Progress) -> None:
            from adaptctl.recording.drawing import write_drawings

            title, passed = self.title.format(robot=self.robot), verdict.passed
            write_json(
                folder / "summary.json",
                {"schema": "adaptctl/export-check/1", "experiment": self.name, "robot": self.robot, "seed": self.seed,
                 "complete": complete, "passed": passed, "missing": missing, "builds": [asdict(b) for b in builds]},
            )  # fmt: skip
            (folder / "figures").mkdir(exist_ok=True)
            drawings = list(drawn(builds))
            figures = embedded(drawings, write_drawings(folder / "figures", drawings))
            content: dict[str, Any] = {
                "facts": facts, "title": title, "verdict": headline, "builds": builds, "figures": figures,
            }  # fmt: skip
            page = rendered("export_check.html", settings=list(stated(self)), flags=" ".join(FLAGS), **content)
            write_text(folder / "report.html", page)

        return Result(complete, headline, facts, verdict, write, failed=not verdict.passed)

    def _builds(self, compilers: list[str], progress: Progress) -> Iterator[Build]:
        mechanism = load(self.robot)
        tuning = tune(mechanism, period=self.control_period, seed=self.seed)
        model = ReducedModel(mechanism, fundamental_basis(essential_space(mechanism, seed=self.seed)))
        count = len(self.laws) * len(self.scalars)
        with tempfile.TemporaryDirectory() as place:
            for k, (law, scalar) in enumerate((law, scalar) for law in self.laws for scalar in self.scalars):
                progress("Exporting and compiling", k / count)
                controller: Controller[Any] = guarded(named_law(law, tuning, model), tuning)
                done = export(
                    controller, Path(place) / f"{k}", name="arm", scalar=scalar, reference=tuning.reference  # type: ignore[arg-type]  # refused if it is none
                )  # fmt: skip
                for compiler in compilers:
                    yield built(done, law, scalar, compiler)
        progress("Exporting and compiling", 1.0)


def drawn(builds: Sequence[Build]) -> Iterator[Drawing]:
    """Figure of which builds agree."""
    from adaptctl.recording.drawing import Drawing

    caption = "Laws, and the compilers and kinds of number with which they repeat what Python did."
    yield Drawing("builds", caption, partial(build_grid, builds))


def found_compilers() -> list[str]:
    """Names of the compilers that are installed."""
    return [name for name, command in COMPILERS.items() if _answers(command)]


def _answers(command: tuple[str, ...]) -> bool:
    if shutil.which(command[0]) is None:
        return False
    flag = "-v" if command[0] == "tcc" else "--version"
    return subprocess.run([*command, flag], capture_output=True, check=False, timeout=PATIENCE).returncode == 0


def built(done: Exported, law: str, scalar: str, compiler: str) -> Build:
    """The build of a package's own test by a compiler, run."""
    sources = [f"{done.name}.c", f"test_{done.name}.c"]
    program = done.directory / f"test_{compiler.replace(' ', '_')}"
    flags = FLAGS if compiler != "tcc" else FLAGS[:1]
    made = _run([*COMPILERS[compiler], *flags, *sources, "-lm", "-o", str(program)], done.directory)
    if made.returncode != 0:
        return Build(law, scalar, compiler, False, f"does not compile: {made.stderr.strip()[:200]}")
    ran = _run([str(program)], done.directory)
    return Build(law, scalar, compiler, ran.returncode == 0, " ".join(ran.stdout.split())[:200])


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE)
