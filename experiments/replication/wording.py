"""The replication in a few lines: its outcome, and the answers to what a person asks first."""

from __future__ import annotations

from collections.abc import Iterator

from adaptctl.experiments.replication.result import Replication
from adaptctl.recording.fact import Fact

INCOMPLETE = "This run was interrupted. What was computed until then is shown; it is not the whole paper."


def headline(replication: Replication) -> str:
    """Summary of a `replication` of Sheu and Walker (1991) in a few sentences: how many printed numbers were computed
    again with the same result, and which tables, figures and sections of the paper are wrong or not reproduced. Nothing
    is checked."""
    n, depending = replication.numbers, replication.numbers.in_shape + replication.numbers.not_reproduced
    computable = n.reproduced + n.errata
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
    """Iterator over the facts of a `replication` of Sheu and Walker (1991), a `Fact` each, questions that a person asks
    first with their answers: counts of printed numbers by verdict, of crosses and blanks, of random draws of states,
    and the time taken, s. Nothing is checked."""
    n, m = replication.numbers, replication.marks
    yield Fact("Printed numbers", f"{n.printed}, {n.given} of them inputs")
    yield Fact("Reproduced", f"{n.reproduced}, {n.to_the_last_digit} to the last digit")
    yield Fact("Reproduced in shape", f"{n.in_shape}")
    yield Fact("Errata", f"{len(replication.errata)} of {len(replication.items)} items")
    yield Fact("Not reproduced", f"{n.not_reproduced} numbers, {len(replication.not_reproduced)} items as a whole")
    yield Fact("Crosses and blanks", f"{m.reproduced} of {m.printed}")
    yield Fact("Draws of random states", f"{replication.study.seeds} where the paper made one")
    yield Fact("Computed in", f"{replication.seconds:.1f} s")
