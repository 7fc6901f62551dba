"""The finished replication: told in a few lines, and kept in a folder like every experiment's result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from adaptctl.experiments.replication.counts import Counts, marks, numbers
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.verdict import Item, Verdict
from adaptctl.recording import Setting
from adaptctl.recording.artifacts import FIGURES, RECORDING, REPORT, SUMMARY, TRACE

INCOMPLETE = "This run was interrupted. What was computed until then is shown; it is not the whole paper."


@dataclass(frozen=True, eq=False)
class Replication:
    """What of the paper was computed again, in its order."""

    experiment: str
    title: str
    study: Study
    items: tuple[Item, ...]
    settings: tuple[Setting, ...]
    seconds: float
    complete: bool = True

    @property
    def numbers(self) -> Counts:
        """Printed numbers by verdict."""
        return numbers(self.items)

    @property
    def marks(self) -> Counts:
        """Printed crosses and blanks by verdict."""
        return marks(self.items)

    @property
    def errata(self) -> tuple[str, ...]:
        """Names of the items that are wrong somewhere."""
        return tuple(item.name for item in self.items if item.verdict is Verdict.ERRATUM)

    def headline(self) -> str:
        """The outcome in a sentence or two."""
        n, depending = self.numbers, self.numbers.in_shape + self.numbers.not_reproduced
        computable = n.reproduced + n.errata
        said = [] if self.complete else [INCOMPLETE]
        if n.given:
            said.append(f"{n.given} of {n.printed} printed numbers are inputs, used as printed.")
        if computable:
            said.append(
                f"Of {computable} that can be computed as they stand, {n.reproduced} come out, "
                f"{n.to_the_last_digit} to the last digit."
            )
        if depending:
            said.append(
                f"Of {depending} that depend on samples, motions or an arm that are not printed, {n.in_shape} lie "
                f"among those of {self.study.seeds} seeds."
            )
        if self.errata:
            said.append(f"Wrong, with a proof by numbers: {', '.join(self.errata)}.")
        return " ".join(said) or f"Computed: {', '.join(item.name for item in self.items)}."

    def facts(self) -> Iterator[tuple[str, str]]:
        """What a person asks first, and the answers."""
        n, m = self.numbers, self.marks
        yield "Printed numbers", f"{n.printed}, {n.given} of them inputs"
        yield "Reproduced", f"{n.reproduced}, {n.to_the_last_digit} to the last digit"
        yield "Reproduced in shape", f"{n.in_shape}"
        yield "Errata", f"{len(self.errata)} of {len(self.items)} items"
        yield "Not reproduced", f"{n.not_reproduced}"
        yield "Crosses and blanks", f"{m.reproduced} of {m.printed}"
        yield "Draws of random states", f"{self.study.seeds} where the paper made one"
        yield "Computed in", f"{self.seconds:.1f} s"

    def write(self, folder: Path, progress: Callable[[str, float], object]) -> None:
        """Write summary, draws, figures, recording and report."""
        from adaptctl.experiments.replication.draws_table import write_draws
        from adaptctl.experiments.replication.recording import write_recording
        from adaptctl.experiments.replication.report import write_report
        from adaptctl.experiments.replication.summary import write_summary
        from adaptctl.recording.drawing import write_drawings

        progress("summary", 0.0)
        write_summary(folder / SUMMARY, self)
        write_draws(folder / TRACE, self.study)
        (folder / FIGURES).mkdir(exist_ok=True)
        progress("figures", 0.1)
        drawings = [drawing for item in self.items for drawing in item.drawings]
        figures = write_drawings(folder / FIGURES, drawings)
        progress("recording", 0.7)
        write_recording(folder / RECORDING, self, figures)
        progress("report", 0.9)
        write_report(folder / REPORT, self, figures)
        progress("report", 1.0)
