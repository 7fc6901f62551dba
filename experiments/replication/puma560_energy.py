"""Items of Tables 1 to 3: the PUMA 560's ranges, its singular values, and torque errors of fewer components."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication import drawings
from adaptctl.experiments.replication.arms import FASTEST, FROM, TO
from adaptctl.experiments.replication.draws import Draws
from adaptctl.experiments.replication.paper_rank import THRESHOLD, rank_claim
from adaptctl.experiments.replication.printed import Number, printed
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.torque_tables import checked_torque_errors, fewest_components, medians
from adaptctl.experiments.replication.verdict import (
    Check,
    Claim,
    Item,
    Outturn,
    drawn,
    evidence,
    given,
    judged,
    percent,
    vanishing,
)

FIRST = 34
"""The singular values that the paper calls almost equally significant."""


def table1(study: Study) -> Item:
    """Replication of Table 1 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    PUMA 560's ranges of positions and velocities. They are inputs, checked against those of this package's arm, which
    `study`, a `Study`, has."""
    table, limits = printed().tables["table1"], [joint.limits for joint in study.puma.mechanism.primary_joints]
    used = {
        FROM: [x.lower for x in limits],
        TO: [x.upper for x in limits],
        "velocity from [rad/s]": [-x.velocity for x in limits],
        FASTEST: [x.velocity for x in limits],
    }
    checks = tuple(given(row, joint, text, used[row][int(joint) - 1]) for row, joint, text in table.entries())
    lower, upper, fastest = table.values(FROM, TO, FASTEST)
    rates = fastest / np.maximum(np.abs(lower), np.abs(upper))
    return Item(
        "table1",
        table.title,
        Outturn.GIVEN,
        "Inputs. The built-in puma560 has exactly these limits.",
        checks=checks,
        evidence=(
            evidence(
                "Every velocity bound is {} to {} 1/s times the joint's larger position bound, as for sinusoids of 9 "
                "rad/s about zero.",
                rates.min(),
                rates.max(),
            ),
        ),
    )


def table2(study: Study) -> Item:
    """Replication of Table 2 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    PUMA 560's singular values of energy differences. Each printed one is checked against those of many random draws of
    states in `study`, since the paper's one draw is not known. Raises `RankError` where the arm's number of
    identifiable parameters cannot be certified."""
    table, draws = printed().tables["table2"], study.puma_draws
    k, values = draws.rank, draws.singular_values
    texts = [text for _, _, text in table.entries()]
    bound = THRESHOLD * float(texts[0])
    checks = []
    for i, (row, column, text) in enumerate(table.entries()):
        beyond = vanishing(row, column, text, float(np.median(values[:, i])), bound)
        checks.append(drawn(row, column, text, values[:, i]) if i < k else beyond)
    literal = Draws.of(study.puma, range(study.seed, study.seed + study.seeds), study.samples, 1.0)
    numbers = np.array([float(text) for text in texts[:k]])
    return Item(
        "table2",
        table.title,
        judged(checks),
        "The spectrum has the printed scale and form: 34 values within a factor of 30, two more than a decade lower "
        "that gravity alone makes, then nothing but round-off. The rank is 36 on every seed.",
        chosen=study.choices,
        checks=tuple(checks),
        claims=(rank_claim("puma_rank", values, k), _first_34(draws)),
        evidence=(
            evidence(
                "Computed over printed, geometric means: {} of the first 34, {} of the last two.",
                _scale(values, numbers, 0, FIRST),
                _scale(values, numbers, FIRST, k),
            ),
            evidence(
                "With velocities up to Table 1's bound, as the text can be read, the first 34 come out at {} of the "
                "printed ones.",
                _scale(literal.singular_values, numbers, 0, FIRST),
            ),
        ),
        drawings=(drawings.singular_values(draws, numbers),),
    )


def table3(study: Study) -> Item:
    """Replication of Table 3 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    PUMA 560's energy and torque errors by the number of essential components (the parameters' parts along the right
    singular vectors of energy differences) that are kept. Each printed one is checked against those of many random
    draws of states in `study`, torques along a sinusoid chosen here. Raises `RankError` where the arm's number of
    identifiable parameters cannot be certified."""
    table, draws = printed().tables["table3"], study.puma_draws
    checks = checked_torque_errors(table, draws.percent_errors, study.puma_torque_errors)
    return Item(
        "table3",
        table.title,
        judged(checks),
        f"With one sinusoid of one frequency for all joints, {sum(c.verdict is Outturn.IN_SHAPE for c in checks)} of "
        f"{len(checks)} printed errors lie among those of the seeds; with all 36 components only round-off is left, as "
        "printed.",
        chosen=(*study.choices, study.motion_choice),
        checks=checks,
        claims=(fewest_components("puma_torque", FIRST, draws, study.puma_torque_errors, study.puma_motion),),
        evidence=(
            evidence(
                "Median over printed torque errors, geometric means: {} at 10, 25, 30 and 34 components, {} at 35. "
                "There the error is one number, the weight of the least component, and the printed draw has it "
                "unusually small (0.002 %).",
                _geometric_mean(checks, ("10", "25", "30", "34")),
                _geometric_mean(checks, ("35",)),
            ),
        ),
        relations=(medians(draws.percent_errors, study.puma_torque_errors),),
        drawings=(drawings.torque_errors("table-3", table, study.puma_torque_errors),),
    )


def _first_34(draws: Draws) -> Claim:
    """Claim that 34 directions stand apart: by singular values they do, by weights they do not."""
    values, weights = draws.singular_values[:, : draws.rank], draws.weights
    ratios = values[:, :-1] / values[:, 1:]
    apart = (ratios.argmax(axis=1) == FIRST - 1) & (ratios[:, FIRST - 1] > 10.0)
    spread = np.median(values[:, 0] / values[:, FIRST - 1]), np.median(weights[:, 0] / weights[:, FIRST - 1])
    return Claim(
        printed().claims["puma_first_34"],
        "the largest fall of the singular values is after the 34th, and tenfold",
        f"holds on {percent(float(apart.mean()))} of the seeds. But not “almost equally”: the 1st is "
        f"{spread[0]:.0f} times the 34th among singular values, and {spread[1]:.0f} times among energy contributions",
        Outturn.IN_SHAPE,
        float(apart.mean()),
    )


def _scale(values: Array, numbers: Array, start: int, stop: int) -> float:
    return float(np.exp(np.mean(np.log(np.median(values[:, start:stop], axis=0) / numbers[start:stop]))))


def _geometric_mean(checks: tuple[Check, ...], columns: tuple[str, ...]) -> float:
    ratios = [
        float(check.computed) / Number.of(check.printed).value
        for check in checks
        if check.column in columns and check.row != "energy error [%]"
    ]
    return float(np.exp(np.mean(np.log(ratios))))
