"""Items of Figures 1, 3, 4 and 6 of the paper."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication import drawings
from adaptctl.experiments.replication.arms import StatedMotion
from adaptctl.experiments.replication.draws import Draws
from adaptctl.experiments.replication.printed import Table, printed
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.torque_tables import ENERGY
from adaptctl.experiments.replication.verdict import (
    Check,
    Claim,
    Item,
    Outturn,
    Scene,
    drawn,
    evidence,
    held,
    judged,
    percent,
)

SLOPE, REAL = 0.5, np.array([3.0, 2.5])
"""c and D_R of the drawn example."""


def figure1(study: Study) -> Item:
    """Replication of Figure 1 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    real, essential and independent parameters in a plane. The paper's equations 27 to 30 are checked by projection in
    1000 random planes drawn by the seed of `study`."""
    essential, independent, closed_forms = _plane(SLOPE, REAL)
    rng = np.random.default_rng(study.seed)
    worst = max(_plane(float(c), M)[2] for c, M in zip(rng.normal(size=1000), rng.normal(size=(1000, 2)), strict=True))
    return Item(
        "figure1",
        "The transformations among three kinds of inertial parameter vectors",
        Outturn.REPRODUCED,
        "Equations 29 and 30 and the formula for b1 hold to round-off; drawn for one choice.",
        chosen=(f"c = {SLOPE:g}, M1 = {REAL[0]:g}, M2 = {REAL[1]:g}: the figure's own values cannot be read",),
        evidence=(
            evidence(
                "Closed forms against projection and null vector: off by {} in this example, by at most {} in 1000 "
                "random ones.",
                closed_forms,
                worst,
                digits=1,
            ),
        ),
        drawings=(drawings.two_parameters(SLOPE, REAL, essential, independent),),
    )


def figure3(study: Study) -> Item:
    """Replication of Figure 3 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    energy error, %, over the number of essential components (the parameters' parts along the right singular vectors of
    energy differences) that are kept. Printed numbers and claims are checked against the random draws of both arms'
    states in `study`. Raises `RankError` where a number of identifiable parameters cannot be certified."""
    panels = {
        "PUMA 560": study.puma_draws,
        "semi-direct-drive, generic": study.five_bar_draws,
        f"… sides equal but for {percent(study.unequal)}": study.nearly_parallel_draws,
    }
    bounds = {int(s): -float(text) for s, text in zip((11, 17), _sayings("arm_energy"), strict=True)}
    arm = _points(printed().tables["table10"]) | bounds
    points = dict(zip(panels, (_points(printed().tables["table3"]), arm, arm), strict=True))
    percents = study.puma_draws.percent_errors
    above = sum(value > percents[:, s].max() for s, value in _points(printed().tables["table3"]).items())
    checks = tuple(
        drawn("PUMA 560", str(s), text, percents[:, s])
        for s, text in zip((30, 34), _sayings("puma_energy"), strict=True)
    )
    claims = (_puma_energy(study.puma_draws, checks), *_arm_energy(study))
    return Item(
        "figure3",
        "The relations between %error and the number of inertial components, both arms",
        judged(checks, claims),
        f"{held(claims)} The PUMA's curve falls as printed, steadily to 34 components, then steeply; the printed draw "
        f"lies high: {above} of the five printed errors exceed those of all {study.seeds} seeds. The other arm's steep "
        "tail is that of a linkage that is nearly a parallelogram.",
        chosen=study.choices,
        checks=checks,
        claims=claims,
        evidence=(
            evidence(
                "The PUMA's largest errors over the seeds: {} % at 25 components (printed 11.3), {} % at 30 (5.3).",
                percents[:, 25].max(),
                percents[:, 30].max(),
            ),
        ),
        drawings=(drawings.percent_errors(panels, points),),
    )


def figure4(study: Study) -> Item:
    """Replication of Figure 4 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    torque, N m, of the PUMA 560's first joint with 10, 25 and 36 of its essential components (the parameters' parts
    along the right singular vectors of energy differences), those with the most energy, along a sinusoid chosen here.
    `study`, a `Study`, has the arm and random draws of its states. Raises `RankError` where the arm's number of
    identifiable parameters cannot be certified."""
    return _torque_figure("figure4", "PUMA 560", study, 1, study.puma_draws, study.puma_motion, (10, 25, 36))


def figure6(study: Study) -> Item:
    """Replication of Figure 6 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    torque, N m, of the semi-direct-drive arm's second joint with 10, 20 and 26 of its essential components (the
    parameters' parts along the right singular vectors of energy differences), those with the most energy, along a
    sinusoid chosen here. `study`, a `Study`, has the arm and random draws of its states. Raises `RankError` where the
    arm's number of identifiable parameters cannot be certified."""
    draws, motion = study.nearly_parallel_draws, study.nearly_parallel_motion
    return _torque_figure("figure6", "semi-direct-drive arm", study, 2, draws, motion, (10, 20, 26))


def _torque_figure(
    name: str, label: str, study: Study, joint: int, draws: Draws, motion: StatedMotion, counts: tuple[int, ...]
) -> Item:
    actual = motion.Y @ draws.arm.parameters
    torques = {"actual parameters": actual} | {f"{s} components": draws.torque(motion, 0, s) for s in counts}
    errors = {key: float(np.mean((tau - actual)[:, joint - 1] ** 2)) for key, tau in torques.items()}
    curves = {
        key if tau is actual else f"{key}, {errors[key]:.1e} (N·m)²": tau[:, joint - 1] for key, tau in torques.items()
    }
    return Item(
        name,
        f"The relations between joint {joint} computed torques and the number of components, {label}",
        Outturn.IN_SHAPE,
        "A few components follow the torque roughly, more follow it closely, all follow it exactly. The mean square "
        f"errors are those of Table {'3' if joint == 1 else '10'}.",
        chosen=(*study.choices, study.motion_choice, f"the draw of seed {study.seed}"),
        drawings=(drawings.torques(name.replace("figure", "figure-"), joint, motion, curves),),
        scene=Scene(label, draws.arm.mechanism, motion.time, motion.p, torques),
    )


def _plane(c: float, real: Array) -> tuple[Array, Array, float]:
    """D_E and D_I by projection and null vector, and by how much equations 29 and 30 differ from them."""
    e, n = np.array([1.0, c]) / np.hypot(1.0, c), np.array([-c, 1.0]) / np.hypot(1.0, c)
    essential = (real @ e) * e
    b = -essential[1] / n[1]
    independent = essential + b * n
    total = real[0] + c * real[1]
    forms = np.concatenate([total / (1.0 + c * c) * np.array([1.0, c]), [total, 0.0, -total * c / np.hypot(1.0, c)]])
    return essential, independent, float(np.abs(forms - [*essential, *independent, b]).max())


def _sayings(claim: str) -> list[str]:
    return printed().claims[claim].numbers.split()


def _points(table: Table) -> dict[int, float]:
    """Printed energy errors by number of components; zero cannot be drawn."""
    texts = zip(table.columns, table.rows[ENERGY].split(), strict=True)
    return {int(s): float(text) for s, text in texts if float(text) > 0.0}


def _puma_energy(draws: Draws, checks: tuple[Check, ...]) -> Claim:
    middle = " and ".join(f"{np.median(draws.percent_errors[:, s]):.2g} %" for s in (30, 34))
    inside = [check.verdict is Outturn.IN_SHAPE for check in checks]
    return Claim(
        printed().claims["puma_energy"],
        "whether the printed errors lie among the seeds' at 30 and at 34 components",
        f"{'yes' if inside[0] else 'no'} and {'yes' if inside[1] else 'no'}; medians {middle}",
        Outturn.IN_SHAPE if all(inside) else Outturn.NOT_REPRODUCED,
        float(np.mean(draws.percent_errors[:, 30] >= float(checks[0].printed))),
    )


def _arm_energy(study: Study) -> tuple[Claim, ...]:
    """The two upper bounds of the text, on both arms that were tried."""
    saying, bounds = printed().claims["arm_energy"], [float(text) for text in _sayings("arm_energy")]
    claims = []
    for label, draws in (("generic", study.five_bar_draws), ("nearly parallel", study.nearly_parallel_draws)):
        fine = [draws.percent_errors[:, s] < bound for s, bound in zip((11, 17), bounds, strict=True)]
        shares = [float(np.mean(one)) for one in fine]
        both = float(np.mean(fine[0] & fine[1]))
        middle = " and ".join(f"{np.median(draws.percent_errors[:, s]):.2g} %" for s in (11, 17))
        claims.append(
            Claim(
                saying,
                f"energy errors at 11 and 17 components of the {label} arm",
                f"below the bounds on {percent(shares[0])} and {percent(shares[1])} of the seeds; medians {middle}",
                Outturn.IN_SHAPE if both >= 0.5 else Outturn.NOT_REPRODUCED,
                both,
            )
        )
    return tuple(claims)
