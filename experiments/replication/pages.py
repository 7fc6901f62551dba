"""Replication as it is shown: outcome, summary, report and table of draws."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.experiments.replication.cases import Study
from adaptctl.experiments.replication.judging import Check, Item
from adaptctl.experiments.replication.printed import Outturn, words
from adaptctl.recording import Progress, Result, Setting
from adaptctl.recording.page import (
    Cell,
    Lines,
    Note,
    Part,
    Report,
    Section,
    Table,
    TableLayout,
    Tone,
    files_section,
    settings_section,
)
from adaptctl.recording.result import TRACE, Fact, Verdict
from adaptctl.recording.trace import Quantity, write_columns

INCOMPLETE = "This run was interrupted. What was computed until then is shown; it is not the whole paper."
TONES = dict(zip(Outturn, (Tone.QUIET, Tone.GOOD, Tone.FAIR, Tone.ODD, Tone.BAD), strict=True))
PAPER = (
    "S.-Y. Sheu and M. W. Walker, Identifying the Independent Inertial Parameter Space of Robot Manipulators, "
    "International Journal of Robotics Research 10(6), 1991."
)


@dataclass(frozen=True)
class Counts:
    """Counts by verdict of entries: all `printed`; `given`; `reproduced`, of them `to_the_last_digit` (crosses and
    blanks among them) and `one_digit_short`; `in_shape`; `errata`; and `not_reproduced`."""

    printed: int
    given: int
    reproduced: int
    to_the_last_digit: int
    one_digit_short: int
    in_shape: int
    errata: int
    not_reproduced: int

    @classmethod
    def of(cls, checks: Sequence[Check]) -> Counts:
        """Counts by verdict of `checks`."""
        by = Counter(check.verdict for check in checks)
        short = [(c.of_digits or 0) - (c.digits or 0) for c in checks if c.verdict is Outturn.REPRODUCED]
        given, reproduced, in_shape, errata, not_reproduced = (by[verdict] for verdict in Outturn)
        last, one = short.count(0), short.count(1)
        return cls(len(checks), given, reproduced, last, one, in_shape, errata, not_reproduced)


@dataclass(frozen=True, eq=False)
class Replication:
    """Replication of the paper, finished or interrupted: `items` in the paper's order; the `study` behind them; the
    experiment's name, `title` and `settings`; the `seconds` that it took; and `complete`, False where interrupted."""

    experiment: str
    title: str
    study: Study
    items: tuple[Item, ...]
    settings: tuple[Setting, ...]
    seconds: float
    complete: bool = True

    @property
    def numbers(self) -> Counts:
        """Counts by verdict of all printed numbers."""
        return Counts.of([check for item in self.items for check in item.checks if not check.is_mark])

    @property
    def marks(self) -> Counts:
        """Counts by verdict of all crosses and blanks, which Tables 5 and 12 have."""
        return Counts.of([check for item in self.items for check in item.checks if check.is_mark])

    @property
    def errata(self) -> tuple[str, ...]:
        """Names of the items that are wrong."""
        return self._named(Outturn.ERRATUM)

    @property
    def not_reproduced(self) -> tuple[str, ...]:
        """Names of the items that are neither reproduced nor shown to be wrong."""
        return self._named(Outturn.NOT_REPRODUCED)

    def _named(self, verdict: Outturn) -> tuple[str, ...]:
        return tuple(item.name for item in self.items if item.verdict is verdict)

    @property
    def result(self) -> Result:
        """Result as the command line shows it; no controller runs, so its verdict is empty."""
        return Result(self.complete, headline(self), tuple(facts(self)), Verdict(), self.write)

    def write(self, folder: Path, progress: Progress) -> Path:
        """Write summary, draws, figures, recording and report into a `folder`, all or none, and return it; `progress`
        is called with what is written and the fraction done. Raises `FileError` where a file cannot be written."""
        tables = {TRACE: lambda path: write_draws(path, self.study)}
        return report(self).write(folder, summary(self), tables=tables, progress=progress)


def headline(replication: Replication) -> str:
    """Outcome in a few sentences: how many printed numbers come out, and which items are wrong or not reproduced."""
    n = replication.numbers
    computable, depending = n.reproduced + n.errata, n.in_shape + n.not_reproduced
    said = [] if replication.complete else [INCOMPLETE]
    if computable:
        said.append(
            f"Of {computable} printed numbers that can be computed as they stand, {n.reproduced} come out, "
            f"{n.to_the_last_digit} to the last digit."
        )
    if depending:
        said.append(
            f"Of {depending} that depend on samples, motions or an arm that are not printed, {n.in_shape} lie "
            "among those of random draws."
        )
    if replication.errata:
        said.append(f"Wrong, with a proof by numbers: {', '.join(replication.errata)}.")
    if replication.not_reproduced:
        said.append(f"Not reproduced, and not shown to be wrong: {', '.join(replication.not_reproduced)}.")
    return " ".join(said) or f"Computed: {', '.join(item.name for item in replication.items)}."


def facts(replication: Replication) -> Iterator[Fact]:
    """Iterator over what a person asks first, with answers: counts, draws, and the time taken."""
    n, m, items = replication.numbers, replication.marks, replication.items
    yield Fact("Printed numbers", f"{n.printed}, {n.given} of them inputs")
    yield Fact("Reproduced", f"{n.reproduced}, {n.to_the_last_digit} to the last digit")
    yield Fact("Reproduced in shape", f"{n.in_shape}")
    yield Fact("Errata", f"{len(replication.errata)} of {len(items)} items")
    yield Fact("Not reproduced", f"{n.not_reproduced} numbers, {len(replication.not_reproduced)} items as a whole")
    yield Fact("Crosses and blanks", f"{m.reproduced} of {m.printed}")
    yield Fact("Draws of random states", f"{replication.study.seeds} where the paper made one")
    yield Fact("Computed in", f"{replication.seconds:.1f} s")


def summary(replication: Replication) -> dict[str, Any]:
    """Summary in JSON's types: counts, and every printed entry beside the computed one with its verdict."""
    return {
        "schema": "adaptctl/replication/1",
        "complete": replication.complete,
        "experiment": replication.experiment,
        "seed": replication.study.seed,
        "seeds": replication.study.seeds,
        "seconds": replication.seconds,
        "numbers": asdict(replication.numbers),
        "marks": asdict(replication.marks),
        "items_by_verdict": {v.value: sum(item.verdict is v for item in replication.items) for v in Outturn},
        "errata": list(replication.errata),
        "not_reproduced": list(replication.not_reproduced),
        "items": {item.name: _item_summary(item) for item in replication.items},
        "settings": {setting.name: setting.value for setting in replication.settings},
    }


def _item_summary(item: Item) -> dict[str, Any]:
    return {
        "title": item.title,
        "verdict": item.verdict.value,
        "summary": item.summary,
        "chosen": list(item.chosen),
        "claims": [
            {
                "section": claim.saying.where,
                "quote": claim.saying.quote,
                "measured": claim.measured,
                "found": claim.found,
                "verdict": claim.verdict.value,
                "share_of_seeds": claim.share,
            }
            for claim in item.claims
        ],
        "evidence": [{"sentence": one.sentence, "values": list(one.values)} for one in item.evidence],
        "relations": {heading: list(lines) for heading, lines in item.relations.items()},
        "checks": [asdict(check) | {"verdict": check.verdict.value} for check in item.checks],
    }


def report(replication: Replication) -> Report:
    """Report: an overview, a section for every item with its entries, figures, claims and evidence, and settings."""
    rows = [(Cell(item.label), badge(item.verdict), item.summary) for item in replication.items]
    meanings = [(badge(verdict), words().meanings[verdict]) for verdict in Outturn]
    beside = "In the tables below a cell shows what was computed, with the printed entry under it where that reads "
    overview = (
        Table(("item", "verdict", "why"), rows, note=f"{beside}otherwise."),
        Table(("verdict", "meaning"), meanings),
    )
    files = files_section(
        "The figures beside all that is said of them.",
        "Every printed entry beside the computed one with its verdict, and all counts.",
        {TRACE: "Every draw: singular values, weights and energy errors of all seeds."},
    )
    own = [Section(one.label, list(parts(one)), badge(one.verdict), one.name) for one in replication.items]
    return Report(
        replication.experiment,
        replication.title,
        headline(replication),
        list(facts(replication)),
        [Section("At a glance", overview), *own, settings_section(replication.settings), files],
        about=f"{replication.study.seeds} seeds from {replication.study.seed}",
        seed=replication.study.seed,
        complete=replication.complete,
        incomplete=INCOMPLETE,
        source=PAPER,
    )


def badge(verdict: Outturn) -> Cell:
    """Label with a `verdict`, in its colour."""
    return Cell(verdict.value, tone=TONES[verdict], badge=True)


def parts(item: Item) -> Iterator[Part]:
    """Iterator over what the section of an `item` holds: its entries as in the paper, figures, claims, evidence."""
    yield item.title
    yield item.summary
    if item.checks:
        place = {(check.row, check.column): check for check in item.checks}
        rows, columns = (list(dict.fromkeys(key[i] for key in place)) for i in (0, 1))
        cells = [[Cell(row), *(_cell(place.get((row, column))) for column in columns)] for row in rows]
        yield Table(("entry", *columns), cells, align="l" + "r" * len(columns), layout=TableLayout.WIDE)
    yield from item.drawings
    for claim in item.claims:
        yield Note(f"“{claim.saying.quote}”", f"Section {claim.saying.where}:")
        yield Note(f"{claim.found}. Measured: {claim.measured}.", f"{claim.verdict.value.capitalize()}:")
    if item.evidence:
        yield Lines([str(one) for one in item.evidence], bullets=True)
    for heading, lines in item.relations.items():
        yield Note(heading)
        yield Lines(lines)
    if item.chosen:
        yield Note(f"{'; '.join(item.chosen)}.", "Chosen:")


def _cell(check: Check | None) -> Cell:
    if check is None:
        return Cell("")
    if check.is_mark:
        printed = "" if check.computed == check.printed else f"printed {check.printed or 'blank'}"
        return Cell(check.computed or "·", printed, TONES[check.verdict])
    seeds = "" if check.low is None else f"all seeds: {check.low:.2g} to {check.high:.2g}"
    return Cell(check.computed, "" if check.reads_alike else check.printed, TONES[check.verdict], hint=seeds)


def write_draws(path: str | Path, study: Study) -> None:
    """Write a Parquet file at `path` of all draws that a `study` has made so far, a row for each arm, seed and
    component, with its singular value, weight and energy error. Raises `FileError` where it cannot be written."""
    draws = list(study.drawn.values())
    arms = [np.full(one.weights.size, label, dtype=np.str_) for label, one in study.drawn.items()]
    seeds = np.arange(study.seed, study.seed + study.seeds)
    columns = [
        Quantity("arm", "1", "which arm", np.concatenate([np.zeros(0, dtype=np.str_), *arms])),
        Quantity("seed", "1", "of the draw", _joined([np.repeat(seeds, one.rank) for one in draws])),
        Quantity(
            "number", "1", "1 for the largest", _joined([np.tile(np.arange(1, d.rank + 1), study.seeds) for d in draws])
        ),
        Quantity(
            "singular_value",
            "J per SI unit",
            "of the energy differences H",
            _joined([one.singular_values[:, : one.rank] for one in draws]),
        ),
        Quantity("weight", "J", "|beta_j| of equation 19, by falling size", _joined([one.weights for one in draws])),
        Quantity(
            "percent_error",
            "%",
            "energy error when this many components are kept (equation 23)",
            _joined([one.percent_errors[:, 1:] for one in draws]),
        ),
    ]
    about = {"samples": str(study.samples), "velocity_scale": repr(study.velocity_scale)}
    write_columns(path, columns, {"schema": "adaptctl/replication-draws/1", **about})


def _joined(parts: Sequence[NDArray[Any]]) -> Array:
    return np.concatenate([np.zeros(0), *(np.ravel(part) for part in parts)])
