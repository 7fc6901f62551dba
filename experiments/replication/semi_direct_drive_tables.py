"""Items of Tables 9 to 12: the semi-direct-drive arm, whose lengths and inertias the paper does not print."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import load
from adaptctl.experiments.replication import drawings
from adaptctl.experiments.replication.arms import SampledArm, near_parallelogram, semi_direct_drive
from adaptctl.experiments.replication.paper_layout import index, name
from adaptctl.experiments.replication.paper_rank import paper_rank, rank_claim
from adaptctl.experiments.replication.printed import BLANK, printed
from adaptctl.experiments.replication.right_angles import QUARTERS, with_base_tilt
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.torque_tables import checked_torque_errors, fewest_components, medians
from adaptctl.experiments.replication.verdict import (
    Claim,
    Item,
    Outturn,
    Relations,
    evidence,
    given,
    judged,
    marked,
    percent,
)

AT_LEAST = 20
"""Components that the paper finds necessary."""
INEQUALITIES = (1e-3, 1e-5, 1e-7, 1e-9)
"""By how much link 4 is longer than its opposite, where the paper's rank is looked at."""


def table9(study: Study) -> Item:
    """Replication of Table 9 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    semi-direct-drive arm's ranges of positions and velocities. They are inputs, checked against those of this package's
    arm, which `study`, a `Study`, has."""
    table, arm = printed().tables["table9"], study.five_bar
    checks = tuple(given(*entry, _limit(arm, *entry[:2])) for entry in table.entries() if entry[2] != BLANK)
    bends = np.linspace(arm.lower[2], arm.upper[2], 200)
    p = np.stack([np.zeros(200), np.zeros(200), -bends], axis=-1)
    regularity = _regularity(arm, p)
    return Item(
        "table9",
        table.title,
        Outturn.GIVEN,
        "Inputs. The built-in semi_direct_drive has these limits and closes over all of them.",
        chosen=(
            "link lengths 0.45, 0.30, 0.37 and 0.41 m for links 2 to 5, and inertias of tubes, rotors and a payload: "
            "the paper prints none",
        ),
        checks=checks,
        evidence=(
            evidence(
                "Over the whole range of p2 - p3 the loop's smallest singular value stays above {} of the reference's.",
                regularity,
            ),
            evidence(
                "The bounds of p2 - p3 are {} and {} degrees, 30 from either flat configuration: those are the "
                "singular positions of a parallelogram. A generic five-bar locks elsewhere.",
                np.degrees(arm.lower[2]),
                np.degrees(arm.upper[2]),
                digits=4,
            ),
        ),
    )


def table10(study: Study) -> Item:
    """Replication of Table 10 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    semi-direct-drive arm's energy and torque errors by the number of essential components (the parameters' parts along
    the right singular vectors of energy differences) that are kept. Each printed one is checked against those of many
    random draws of states in `study`, with lengths and a sinusoid chosen here. Raises `RankError` where an arm's number
    of identifiable parameters cannot be certified."""
    table = printed().tables["table10"]
    near, generic = study.nearly_parallel_draws, study.five_bar_draws
    checks = checked_torque_errors(table, near.percent_errors, study.nearly_parallel_torque_errors)
    other = checked_torque_errors(table, generic.percent_errors, study.five_bar_torque_errors)
    inside = [sum(check.verdict is Outturn.IN_SHAPE for check in one) for one in (checks, other)]
    tilted = _tilt_error(study)
    claims = (
        fewest_components(
            "arm_torque", AT_LEAST, near, study.nearly_parallel_torque_errors, study.nearly_parallel_motion
        ),
    )
    return Item(
        "table10",
        table.title,
        judged(checks, claims),
        f"{len(checks) - inside[0]} of {len(checks)} entries lie outside of what any seed gives. The fall of the "
        f"errors with the number of components is met by an arm, chosen to fit, whose sides are equal but for "
        f"{percent(study.unequal)} ({inside[0]} of {len(checks)} entries among the seeds' values) better than by one "
        f"of generic lengths ({inside[1]}). Inertias are not printed either.",
        chosen=(
            *study.choices,
            study.motion_choice,
            f"the built-in semi_direct_drive_parallelogram with link 4 longer by {percent(study.unequal)}",
        ),
        checks=checks,
        claims=claims,
        evidence=(
            evidence(
                "With all 26 components the paper still prints 5.5E-9 for joint 1, against 1E-24 in Table 3; here {} "
                "is left.",
                np.median(study.nearly_parallel_torque_errors[:, -1, 0]),
                digits=2,
            ),
            evidence(
                f"With the base tilted by the rounding of {TILT} for pi/2, the paper's threshold finds rank {{}} "
                "and leaves {} on joint 1: a rounded right angle, as behind Table 5, would explain such a rest.",
                *tilted,
                digits=2,
            ),
        ),
        relations=(medians(near.percent_errors, study.nearly_parallel_torque_errors),),
        drawings=(drawings.torque_errors("table-10", table, study.nearly_parallel_torque_errors),),
    )


def table11(study: Study) -> Item:
    """Replication of Table 11 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    order in which the semi-direct-drive arm's parameters are removed. It is an input, checked against the order that
    this package uses."""
    table, names = printed().tables["table11"], study.five_bar.mechanism.parameter_names
    order = study.priority("table11", study.five_bar.mechanism).indices(names)
    places = {names[j]: i + 1 for i, j in enumerate(order)}
    checks = tuple(given(row, link, text, places[name(row, link)]) for row, link, text in table.entries())
    return Item("table11", table.title, Outturn.GIVEN, "An input, of the same rule as Table 4.", checks=checks)


def table12(study: Study) -> Item:
    """Replication of Table 12 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    semi-direct-drive arm's set of independent parameters. Each cross and blank is checked against the set computed from
    `study`. Raises `RankError` where the arm's number of identifiable parameters cannot be certified."""
    table, basis, draws = printed().tables["table12"], study.five_bar_basis, study.five_bar_draws
    checks = tuple(
        marked(row, link, text, index(row, link) in basis.columns, Outturn.NOT_REPRODUCED)
        for row, link, text in table.entries()
    )
    parallelogram = semi_direct_drive(load("semi_direct_drive_parallelogram"))
    saying = printed().claims["arm_independent"]
    return Item(
        "table12",
        table.title,
        judged(checks),
        f"{sum(check.exact for check in checks)} of {len(checks)} cells: the same 26 parameters, when the y axis of "
        "link 1 is the vertical one. But 26 is the number of a generic linkage; with equal opposite sides it is 18.",
        chosen=("link 1's y axis along joint 1", "lengths as in Table 9; any generic ones give the same set"),
        checks=checks,
        claims=(
            Claim(
                saying,
                "rank of the energies, and number of parameters that Table 11's rule keeps",
                f"{study.five_bar.space.rank} and {basis.rank}",
                Outturn.REPRODUCED if basis.rank == int(saying.numbers) else Outturn.NOT_REPRODUCED,
            ),
            rank_claim("arm_rank", draws.singular_values, draws.rank),
        ),
        evidence=(
            evidence("The gap behind the 26th singular value is {}.", study.five_bar.space.certificate.gap),
            evidence(
                "A true parallelogram has rank {}. With link 4 longer than link 2 by "
                f"{', '.join(f'{share:.0e}' for share in INEQUALITIES)} of that, the paper's threshold finds {{}}, "
                "{}, {} and {}: it cannot tell a rounded parallelogram from a generic linkage.",
                parallelogram.space.rank,
                *(_rank(study, semi_direct_drive(near_parallelogram(share))) for share in INEQUALITIES),
            ),
        ),
        relations=(Relations("The independent parameters of the built-in arm", basis.equations()),),
    )


TILT = "3.14159/2"


def _limit(arm: SampledArm, row: str, column: str) -> float:
    """The built-in arm's limit that an entry of Table 9 gives."""
    end = "upper" if " to " in row else "lower"
    if column == "p2 - p3":
        loops = arm.mechanism.description.loops
        return float(getattr(loops.conditions[0], end)) if loops else np.nan
    limits = arm.mechanism.primary_joints[int(column) - 1].limits
    if row.startswith("velocity"):
        return limits.velocity if end == "upper" else -limits.velocity
    return float(getattr(limits, end))


def _regularity(arm: SampledArm, p: Array) -> float:
    """Smallest distance of the loop to locking, over the motion."""
    continuation = arm.mechanism.continuation
    return float(continuation.regularity(arm.mechanism.configuration(p)).min()) if continuation else 1.0


def _differences(study: Study, arm: SampledArm) -> Array:
    """H of one draw."""
    generator = np.random.default_rng(study.seed)
    return np.diff(arm.energies(*arm.states(generator, study.samples, study.velocity_scale)), axis=0)


def _rank(study: Study, arm: SampledArm) -> int:
    """The rank that the paper's threshold finds in one draw."""
    return int(paper_rank(np.asarray(np.linalg.svd(_differences(study, arm), compute_uv=False))))


def _tilt_error(study: Study) -> tuple[int, float]:
    """The paper's rank with a tilted base, and joint 1's mean square torque error with as many components."""
    arm = semi_direct_drive(with_base_tilt(study.five_bar.mechanism, QUARTERS[TILT]))
    _, values, right = np.linalg.svd(_differences(study, arm))
    rank = int(paper_rank(np.asarray(values)))
    motion, basis = arm.sinusoid(study.frequency, study.motion_samples), right[:rank].T
    missing = basis @ (basis.T @ arm.parameters) - arm.parameters
    return rank, float(np.mean((motion.Y[:, 0] @ missing) ** 2))
