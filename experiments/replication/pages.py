"""Outcome, summary, report and table of draws."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication.arms import Arm, Study
from adaptctl.experiments.replication.judging import Check, Item, Outturn
from adaptctl.recording import Progress, Result, Setting
from adaptctl.recording.page import (
    SHEU_WALKER,
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

INCOMPLETE = "This run was interrupted: the results are incomplete."
TONES = dict(zip(Outturn, (Tone.QUIET, Tone.GOOD, Tone.FAIR, Tone.ODD, Tone.BAD), strict=True))


@dataclass(frozen=True, eq=False)
class Replication:
    """Replication of the paper, finished or interrupted."""

    experiment: str
    title: str
    study: Study
    items: tuple[Item, ...]
    settings: tuple[Setting, ...]
    seconds: float
    complete: bool = True

    @property
    def numbers(self) -> Mapping[str, int]:
        """Counts by verdict of all printed numbers."""
        return counts(check for item in self.items for check in item.checks if not check.is_mark)

    @property
    def marks(self) -> Mapping[str, int]:
        """Counts by verdict of crosses and blanks (Tables 5 and 12)."""
        return counts(check for item in self.items for check in item.checks if check.is_mark)

    def named(self, verdict: Outturn) -> list[str]:
        """Names of the items with a `verdict`."""
        return [item.name for item in self.items if item.verdict is verdict]

    @property
    def result(self) -> Result:
        """Result for the command line."""
        return Result(self.complete, headline(self), tuple(facts(self)), Verdict(), self.write)

    def write(self, folder: Path, progress: Progress) -> Path:
        """Folder with all files, all or none."""
        tables = {TRACE: partial(write_draws, study=self.study)}
        return report(self).write(folder, summary(self), tables=tables, progress=progress)


def counts(checks: Iterable[Check]) -> dict[str, int]:
    """Counts of checks by verdict, and of reproduced ones by digits."""
    found = list(checks)
    by = Counter(check.verdict for check in found)
    short = [(c.of_digits or 0) - (c.digits or 0) for c in found if c.verdict is Outturn.REPRODUCED]
    return {
        "printed": len(found),
        "given": by[Outturn.GIVEN],
        "reproduced": by[Outturn.REPRODUCED],
        "to_the_last_digit": short.count(0),
        "one_digit_short": short.count(1),
        "in_shape": by[Outturn.IN_SHAPE],
        "errata": by[Outturn.ERRATUM],
        "not_reproduced": by[Outturn.NOT_REPRODUCED],
    }


def headline(replication: Replication) -> str:
    """Outcome in a few sentences."""
    n = replication.numbers
    computable, depending = n["reproduced"] + n["errata"], n["in_shape"] + n["not_reproduced"]
    wrong, missing = (", ".join(replication.named(one)) for one in (Outturn.ERRATUM, Outturn.NOT_REPRODUCED))
    said = {
        INCOMPLETE: not replication.complete,
        f"Of {computable} printed numbers that can be computed from the paper, {n['reproduced']} agree, "
        f"{n['to_the_last_digit']} to the last digit.": computable,
        f"Of {depending} that depend on unprinted samples, motions or arms, {n['in_shape']} are within the range of "
        "random draws.": depending,
        f"Wrong, with a numerical proof: {wrong}.": wrong,
        f"Neither reproduced nor proved wrong: {missing}.": missing,
    }
    sentences = [sentence for sentence, holds in said.items() if holds]
    return " ".join(sentences) or f"Computed: {', '.join(item.name for item in replication.items)}."


def facts(replication: Replication) -> Iterator[Fact]:
    """Facts: counts, draws, and the time taken."""
    n, m = replication.numbers, replication.marks
    wrong, missing = (len(replication.named(one)) for one in (Outturn.ERRATUM, Outturn.NOT_REPRODUCED))
    yield Fact("Printed numbers", f"{n['printed']}, {n['given']} of them inputs")
    yield Fact("Reproduced", f"{n['reproduced']}, {n['to_the_last_digit']} to the last digit")
    yield Fact("Reproduced in shape", f"{n['in_shape']}")
    yield Fact("Wrong", f"{wrong} of {len(replication.items)} items")
    yield Fact("Not reproduced", f"{n['not_reproduced']} numbers, {missing} items as a whole")
    yield Fact("Crosses and blanks", f"{m['reproduced']} of {m['printed']}")


def summary(replication: Replication) -> dict[str, Any]:
    """Summary in JSON's types."""
    return {
        "schema": "adaptctl/replication/1",
        "complete": replication.complete,
        "experiment": replication.experiment,
        "seed": replication.study.seed,
        "seeds": replication.study.seeds,
        "seconds": replication.seconds,
        "numbers": replication.numbers,
        "marks": replication.marks,
        "items_by_verdict": {verdict.value: len(replication.named(verdict)) for verdict in Outturn},
        "errata": replication.named(Outturn.ERRATUM),
        "not_reproduced": replication.named(Outturn.NOT_REPRODUCED),
        "items": {item.name: _item(item) for item in replication.items},
        "settings": {setting.name: setting.value for setting in replication.settings},
    }


def _item(item: Item) -> dict[str, Any]:
    plain = ("title", "verdict", "summary", "chosen", "checks")
    named = {name: [one._asdict() for one in getattr(item, name)] for name in ("claims", "evidence")}
    relations = {heading: list(map(str, lines)) for heading, lines in item.found.relations.items()}
    found: dict[str, Any] = msgspec.to_builtins({name: getattr(item, name) for name in plain} | named)
    return found | {"relations": relations}


def report(replication: Replication) -> Report:
    """Report: overview, a section per item, settings."""
    study = replication.study
    rows = [(_label(item), _badge(item.verdict), item.summary) for item in replication.items]
    meanings = [(_badge(verdict), study.paper.meanings[verdict]) for verdict in Outturn]
    beside = "Cells of the tables below have the computed value, and the printed entry below it if it differs."
    overview = (Table(("item", "verdict", "why"), rows, note=beside), Table(("verdict", "meaning"), meanings))
    own = [Section(_label(one), list(parts(one)), _badge(one.verdict), one.name) for one in replication.items]
    files = files_section(
        "The figures, with the statements about them.",
        "Every printed entry with the computed one and its verdict, and all counts.",
        {TRACE: "Singular values, weights and energy errors of all seeds."},
    )
    return Report(
        replication.experiment,
        replication.title,
        headline(replication),
        list(facts(replication)),
        [Section("Summary", overview), *own, settings_section(replication.settings), files],
        about=f"{study.seeds} seeds from {study.seed}",
        seed=study.seed,
        complete=replication.complete,
        incomplete=INCOMPLETE,
        source=f"{SHEU_WALKER}.",
    )


def _label(item: Item) -> str:
    """Name such as "Table 7" or "Section 5.3"."""
    return re.sub(r"(?<=[a-z])(?=\d)", " ", item.name).capitalize()


def _badge(verdict: Outturn) -> Cell:
    return Cell(verdict.value, tone=TONES[verdict], badge=True)


def parts(item: Item) -> Iterator[Part]:
    """Parts of an `item`: entries, figures, claims, evidence."""
    yield item.title
    yield item.summary
    if item.checks:
        place = {(check.row, check.column): check for check in item.checks}
        rows, columns = (list(dict.fromkeys(key[i] for key in place)) for i in (0, 1))
        cells = [[row, *(_cell(place.get((row, column))) for column in columns)] for row in rows]
        yield Table(("entry", *columns), cells, align="l" + "r" * len(columns), layout=TableLayout.WIDE)
    yield from item.found.drawings
    for claim in item.claims:
        yield Note(f"“{claim.quote}”", f"Section {claim.section}:")
        yield Note(f"{claim.found}. Measured: {claim.measured}.", f"{claim.verdict.value.capitalize()}:")
    if item.evidence:
        yield Lines([one.sentence for one in item.evidence], bullets=True)
    for heading, lines in item.found.relations.items():
        yield from (Note(heading), Lines(lines))
    if item.chosen:
        yield Note(f"{'; '.join(item.chosen)}.", "Chosen:")


def _cell(check: Check | None) -> str | Cell:
    if check is None:
        return ""
    printed, computed = ((text.lstrip("+") or "·") for text in (check.printed, check.computed))
    seeds = "" if check.low is None else f"all seeds: {check.low:.2g} to {check.high:.2g}"
    return Cell(computed, printed if printed != computed else "", TONES[check.verdict], hint=seeds)


def write_draws(path: str | Path, study: Study) -> None:
    """Write a Parquet file of all draws, a row for each arm, seed and component."""
    arms, columns = study.drawn, list[Quantity]()
    seeds = np.arange(study.seed, study.seed + study.seeds)[:, None]
    kinds: dict[tuple[str, str, str], Callable[[Arm], Array]] = {
        ("seed", "1", "seed of the draw"): lambda arm: seeds + 0.0 * arm.weights,
        ("number", "1", "1 for the largest"): lambda arm: np.arange(1, arm.space.rank + 1) + 0.0 * arm.weights,
        ("singular_value", "J per SI unit", "of the energy differences H"): lambda arm: arm.singular_values,
        ("weight", "J", "|beta_j| of equation 19, in descending order"): lambda arm: arm.weights,
        ("percent_error", "%", "energy error with this number of components (equation 23)"): lambda arm: (
            arm.percent_errors[:, 1:]
        ),
    }
    labels = [label for label, arm in arms.items() for _ in range(arm.weights.size)]
    columns.append(Quantity("arm", "1", "which arm", np.array(labels, dtype=np.str_)))
    for about, of in kinds.items():
        values = [np.ravel(of(arm)[:, : arm.space.rank]) for arm in arms.values()]
        columns.append(Quantity(*about, np.concatenate([np.zeros(0), *values])))
    made = {"samples": str(study.samples), "velocity_scale": repr(study.velocity_scale)}
    write_columns(path, columns, {"schema": "adaptctl/replication-draws/1", **made})
