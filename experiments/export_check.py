"""Exported controllers, built by whatever compilers are here, on ticks recorded from Python."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from adaptctl.codegen import export
from adaptctl.control import Controller
from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.experiments.build_grid import build_grid
from adaptctl.experiments.experiment import Experiment, setting, stated
from adaptctl.experiments.exported_builds import COMPILERS, FLAGS, Build, built, found_compilers
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import Fact, Failure, Progress, Result, Verdict
from adaptctl.recording.page import Report, Section, Table, TableLayout, files_section, settings_section
from adaptctl.recording.wording import number, scientific
from adaptctl.tuning import tune
from adaptctl.tuning.named_laws import LAWS, guarded, named_law

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing


@dataclass(frozen=True)
class ExportCheck(Experiment):
    """Experiment on exported control laws: each of `laws` (names of control laws, by default all that have a name) is
    exported as C for each kind of number in `scalars` ("double", "float"), built by every compiler that is found, and
    run on test vectors (states and torques) recorded from Python. Raises `InputError` at construction for a setting of
    the wrong type or out of its bounds, `NonFiniteError` for NaN or infinity."""

    name: ClassVar[str] = "export-check"
    title: ClassVar[str] = "{robot}: exported controllers, compiled and compared"

    robot: str = setting("puma560_geared", "a built-in robot or a file (.urdf, .xml, .toml)")
    laws: tuple[str, ...] = setting(LAWS, "which laws are exported")
    scalars: tuple[str, ...] = setting(("double", "float"), "kinds of number")
    control_period: float = setting(1e-3, "time a torque is held, s", symbol="T_c", low=1e-4, high=0.02)

    def run(self, progress: Progress) -> Result:
        """Result of all builds of exported control laws, a `Result`: outcome in words, facts (questions with answers),
        a verdict with each build that differs from Python, and a function that writes summary, figure, recording and
        report into a folder that it is given. `progress(what, share)` is called with the step's name and the fraction
        done, 0 to 1. Ctrl-C keeps the builds done; where there are none, `KeyboardInterrupt` is raised. Raises
        `InputError` where no compiler is found, a kind of number is unknown or no gains stabilise a joint under a held
        torque, `NotFoundError` for an unknown law or robot, `FileError` for a robot's file that cannot be used,
        `RankError` where the number of base parameters cannot be certified, `subprocess.TimeoutExpired` for a compiler
        or program that takes more than 300 s."""
        compilers = found_compilers()
        if not compilers:
            raise InputError(f"export-check: no compiler is found; install one of: {', '.join(COMPILERS)}")
        builds: list[Build] = []
        complete = False
        try:
            for build in self._builds(list(compilers), progress):
                builds.append(build)
            complete = True
        except KeyboardInterrupt:
            if not builds:
                raise
        return Checked(self, compilers, tuple(builds), complete).result()

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


@dataclass(frozen=True, eq=False)
class Checked:
    """Finished check of exported control laws: `of`, the `ExportCheck`, the experiment with its settings; `compilers`,
    the version of each compiler found, by its name; `builds`, a `Build` each, in the order in which they were run; and
    `complete`, False where the experiment was interrupted. Nothing is checked at construction."""

    of: ExportCheck
    compilers: dict[str, str]
    builds: tuple[Build, ...]
    complete: bool

    @property
    def experiment(self) -> str:
        """Name of the experiment, "export-check", as the command line takes it."""
        return self.of.name

    @property
    def title(self) -> str:
        """Title of the export check's report and recording, with the robot's name or file as set."""
        return self.of.title.format(robot=self.of.robot)

    @property
    def seed(self) -> int:
        """Seed of all random numbers of the export check, its setting `seed`."""
        return self.of.seed

    @property
    def verdict(self) -> Verdict:
        """Verdict on all builds of exported control laws, a `Verdict`: a fault for each build that does not compile, or
        does not reproduce Python's torques within the tolerance of its own test."""
        wrong = [build for build in self.builds if not build.passed]
        return Verdict.of((Failure.DIFFERS, f"{b.law} ({b.scalar}) by {b.compiler}: {b.message}.") for b in wrong)

    @property
    def missing(self) -> list[str]:
        """Names of the compilers, among cc, clang, tcc and zig cc, that were not found on this computer."""
        return [name for name in COMPILERS if name not in self.compilers]

    def result(self) -> Result:
        """Result of the export check, a `Result`, as the command line shows it: outcome in words, facts (questions with
        answers), verdict, and a function that writes the result files into a folder; its `failed` is True where a build
        differs from Python."""
        verdict = self.verdict
        return Result(
            self.complete, self.headline(), self.facts(), verdict, self.write, failed=not verdict.passed
        )  # fmt: skip

    def headline(self) -> str:
        """Summary of the export check in one or two sentences, failures first: how many builds of exported laws
        reproduce Python's torques, and the largest difference for each kind of number, N m (N if prismatic)."""
        repeated = f"{self._passed} of {len(self.builds)} builds repeat Python's torques"
        off = " and ".join(f"{scientific(worst, 2)} N m ({scalar})" for scalar, worst in self._worst().items())
        largest = max((build.largest or 0.0 for build in self.builds), default=0.0)
        return self.verdict.before(
            f"{repeated}, of up to {number(largest)} N m, within {off}." if off else f"{repeated}."
        )

    def facts(self) -> tuple[Fact, ...]:
        """Facts of the export check, questions with answers, a `Fact` each, for terminal and report: how many builds
        agree with Python, the largest difference of these builds' torques (N m) for each kind of number, the number of
        laws, and the compilers found and not found."""
        worst = [Fact(f"Off at most, {scalar}", f"{scientific(off, 2)} N m") for scalar, off in self._worst().items()]
        return (
            Fact("Builds that agree", f"{self._passed} of {len(self.builds)}"),
            *worst,
            Fact("Laws", f"{len(self.of.laws)}"),
            Fact("Compilers", ", ".join(self.compilers)),
            Fact("Not found", ", ".join(self.missing) or "none"),
        )

    @property
    def _passed(self) -> int:
        return sum(build.passed for build in self.builds)

    def _worst(self) -> dict[str, float]:
        """Largest difference of torques with each kind of number, of the builds that agree."""
        found: dict[str, float] = {}
        for build in self.builds:
            if build.passed and build.difference is not None:
                found[build.scalar] = max(found.get(build.scalar, 0.0), build.difference)
        return found

    def write(self, folder: Path, progress: Progress) -> None:
        """Write summary.json, the figure, report.html and recording.rrd of the export check into a `folder`, all or
        none; nothing is returned. `progress(what, share)` is called with what is written and the fraction done. Raises
        `FileError` where a file cannot be written."""
        self.report().write(folder, self.summary(), progress=progress)

    def report(self) -> Report:
        """Report of the export check, a `Report`: the compilers found, and every build with what its own test says."""
        told = (
            "Every law was written as C99, with guards of torques and speeds around it, compiled with "
            f"{' '.join(FLAGS)}, and run on ticks that were recorded from Python's own controller, with a copied "
            "state, with NaN, and with states and gains that it is to refuse."
        )
        found = [*self.compilers.items(), *((name, "not found") for name in self.missing)]
        compilers = Table(("compiler", "version"), found, align="cl", layout=TableLayout.STACKED)
        rows = [(b.law, b.scalar, b.compiler, "yes" if b.passed else "no", b.message) for b in self.builds]
        heads = ("law", "number", "compiler", "agrees", "its test says")
        builds = Table(heads, rows, layout=TableLayout.ROWS)
        return Report(
            experiment=self.of.name,
            title=self.title,
            outcome=self.headline(),
            facts=self.facts(),
            sections=(
                Section("What was built", (told, self.drawing(), compilers, builds)),
                settings_section(stated(self.of)),
                files_section("The outcome and the figure.", "Every build with what its test said, and the compilers."),
            ),
            seed=self.of.seed,
            complete=self.complete,
            incomplete="It was interrupted: these are the builds until then.",
        )

    def summary(self) -> dict[str, Any]:
        """Summary of the export check as a dict in JSON's types: "schema", "experiment" (its name), "robot", "seed",
        "complete", "passed" (of all builds), the versions of "compilers" found by name, "missing" ones, and "builds", a
        dict for each with "law", "scalar", "compiler", "passed", "message", "difference" (the largest of its torques
        from Python's, N m) and "largest" (of Python's torques, N m), these two None where not known."""
        told = [{**asdict(b), "difference": b.difference, "largest": b.largest} for b in self.builds]
        about = {"schema": "adaptctl/export-check/2", "experiment": self.of.name, "robot": self.of.robot}
        passed = {"seed": self.of.seed, "complete": self.complete, "passed": self.verdict.passed}
        return {**about, **passed, "compilers": self.compilers, "missing": self.missing, "builds": told}

    def drawing(self) -> Drawing:
        """Drawing for the export check's report, a `Drawing` with name, caption and a function that makes the figure: a
        grid of laws and compilers that shows which builds reproduce Python's torques."""
        from adaptctl.recording.drawing import Drawing

        caption = (
            "Largest difference of a build's torques from those that Python recorded: blue where the build agrees."
        )
        return Drawing("builds", caption, partial(build_grid, self.builds))
