"""Items of Table 13 and of the conclusions: the two arms beside each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.replication.arms import SampledArm
from adaptctl.experiments.replication.printed import printed
from adaptctl.experiments.replication.puma560_energy import table3
from adaptctl.experiments.replication.semi_direct_drive_tables import table10
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.verdict import Check, Claim, Item, Outturn, compared, evidence, judged
from adaptctl.identifiability import essential_space
from adaptctl.identifiability.energy_matrix import energies
from adaptctl.identifiability.factorisation import singular_values
from adaptctl.identifiability.sampling import random_states
from adaptctl.identifiability.scaled_rank import NumericalRank


def table13(study: Study) -> Item:
    """Replication of Table 13 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims):
    numbers of links, joints and parameters of two arms of three degrees of freedom, one serial and one with a closed
    loop. Each printed entry is checked against the computed one. `study`, a `Study`, has the arms. Raises `RankError`
    where a number of identifiable parameters cannot be certified."""
    table, rank = printed().tables["table13"], study.arm3_space.rank
    arms = (_counts(study.arm3, rank), _counts(study.five_bar.mechanism, study.five_bar.space.rank))
    counts = dict(zip(table.columns, arms, strict=True))
    checks = tuple(_checked(row, column, text, counts[column][row]) for row, column, text in table.entries())
    return Item(
        "table13",
        table.title,
        judged(checks),
        f"All entries but one. The three-joint PUMA has {rank} independent parameters, not 16: that is what energies "
        "give which are not subtracted from each other, for they carry the constant potential.",
        chosen=("the first three joints of the PUMA as in Table 5; generic lengths of the other arm",),
        checks=checks,
        evidence=(
            evidence(
                "Rank of energy differences of the first three joints: {}; of the energies themselves: {}.",
                rank,
                _undifferenced(study.arm3),
            ),
            evidence(
                "Torques give {} too, and so does 7 N - 6 for N = 3. The gap behind the 15th singular value is {}.",
                study.arm3_space.certificate.rank_torque or 0,
                study.arm3_space.certificate.gap,
            ),
            evidence(
                "Undifferenced, the whole PUMA would have {} and the arm with a loop {}. The paper has 36 and 26: "
                "there it subtracted.",
                _undifferenced(study.puma.mechanism),
                _loop_undifferenced(study),
            ),
        ),
    )


def conclusions(study: Study) -> Item:
    """Replication of section 6 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): its
    conclusions on numbers of independent parameters, and of essential components that accurate torques need, judged by
    what is computed. `study`, a `Study`, has the arms and random draws of states. Raises `RankError` where a number of
    identifiable parameters cannot be certified."""
    sayings, rank = printed().claims, study.arm3_space.rank
    two = essential_space(_first_joints(study.arm3, 2)).rank
    eight, arm = sayings["eight"].numbers.split()
    torque = [claim for item in (table3(study), table10(study)) for claim in item.claims]
    return Item(
        "conclusions",
        "Section 6: what the paper concludes",
        Outturn.ERRATUM,
        f'"Eight" parameters for three joints contradicts Table 13\'s 16 and the true {rank}. Eight is what the first '
        f"two joints of the PUMA have.",
        checks=(
            Check("independent parameters", "three-joint PUMA", eight, str(rank), Outturn.ERRATUM),
            compared("independent parameters", "semi-direct-drive", arm, study.five_bar.space.rank),
        ),
        claims=(
            Claim(
                sayings["eight"],
                "rank of energies and of torques",
                f"{rank} against {study.five_bar.space.rank}",
                Outturn.ERRATUM,
            ),
            Claim(
                sayings["torque_34_20"],
                "as under Tables 3 and 10",
                "PUMA 560: {}; semi-direct-drive: {}".format(*(claim.found for claim in torque)),
                Outturn.IN_SHAPE
                if all(claim.verdict is Outturn.IN_SHAPE for claim in torque)
                else Outturn.NOT_REPRODUCED,
            ),
        ),
        evidence=(
            evidence(
                "The first two joints of the PUMA have {} (7 N - 6 for N = 2), the first three {}, and {} without "
                "gravity.",
                two,
                rank,
                essential_space(_weightless(study.arm3)).rank,
            ),
        ),
    )


def _counts(mechanism: Mechanism, rank: int) -> dict[str, int]:
    loops = mechanism.description.loops
    return {
        "links": len(mechanism.links),
        "joints": len(mechanism.links) + (len(loops.closures) if loops else 0),
        "primary joints": mechanism.dof,
        "actuators": mechanism.dof,
        "dimension of essential space": rank,
        "inertial parameters": len(mechanism.parameter_names),
    }


def _checked(row: str, column: str, text: str, computed: int) -> Check:
    check = compared(row, column, text, computed)
    return check if check.exact else replace(check, verdict=Outturn.ERRATUM, digits=None, of_digits=None)


def _undifferenced(mechanism: Mechanism) -> int:
    """The rank of energies that are not subtracted from each other."""
    states = random_states(mechanism, 4 * len(mechanism.parameter_names), np.random.default_rng(0))
    return _scaled_rank(energies(mechanism, states), essential_space(mechanism).scales)


def _loop_undifferenced(study: Study) -> int:
    arm: SampledArm = study.five_bar
    E = arm.energies(*arm.states(np.random.default_rng(study.seed), 4 * len(arm.parameters), 1.0))
    return _scaled_rank(E, arm.space.scales)


def _scaled_rank(E: Array, scales: Array) -> int:
    return NumericalRank.of(singular_values(E * scales)).rank


def _first_joints(mechanism: Mechanism, joints: int) -> Mechanism:
    """Serial arm without the links behind its first joints."""
    name, links = f"{mechanism.name} to joint {joints}", mechanism.description.links[:joints]
    return Mechanism(replace(mechanism.description, name=name, links=links))


def _weightless(mechanism: Mechanism) -> Mechanism:
    return Mechanism(replace(mechanism.description, gravity=np.zeros(3)))
