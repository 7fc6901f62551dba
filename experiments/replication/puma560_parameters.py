"""Items of Tables 4 to 8: the parameters of the PUMA 560, real, essential and independent."""

from __future__ import annotations

import numpy as np

from adaptctl.description.inertia import pseudo_inertia
from adaptctl.experiments.replication.null_combinations import NULL_COMBINATIONS, combination, torque_share
from adaptctl.experiments.replication.paper_layout import index, kept, name, parameters, sign
from adaptctl.experiments.replication.printed import BLANK, printed
from adaptctl.experiments.replication.printed_rounding import excess
from adaptctl.experiments.replication.right_angles import QUARTERS, rounded_set
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.verdict import (
    Claim,
    Item,
    Outturn,
    Relations,
    compared,
    evidence,
    given,
    judged,
    marked,
)
from adaptctl.identifiability.energy_matrix import energy_differences
from adaptctl.identifiability.factorisation import singular_values
from adaptctl.identifiability.sampling import random_states
from adaptctl.identifiability.scaled_rank import NumericalRank

REPORTED = "3.14159/2"
"""The rounded right angle whose vector stands beside Table 8."""


def table4(study: Study) -> Item:
    """Replication of Table 4 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    order in which the PUMA 560's parameters are removed. It is an input, checked against the order that this package
    uses."""
    table, names = printed().tables["table4"], study.puma.mechanism.parameter_names
    order = study.priority("table4", study.puma.mechanism).indices(names)
    places = {names[j]: i + 1 for i, j in enumerate(order)}
    checks = tuple(given(row, link, text, places[name(row, link)]) for row, link, text in table.entries())
    return Item(
        "table4",
        table.title,
        Outturn.GIVEN,
        "An input. Its rule, kind by kind and link by link, is the default priority of adaptctl for any mechanism.",
        checks=checks,
    )


def table5(study: Study) -> Item:
    """Replication of Table 5 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    PUMA 560's set of independent parameters. Each cross and blank is checked against the set computed from `study`, and
    the rank of the printed set is computed. Raises `RankError` where the arm's number of identifiable parameters cannot
    be certified."""
    table, space, basis = printed().tables["table5"], study.puma.space, study.puma_basis
    columns, priority = kept(table), study.priority("table4", study.puma.mechanism)
    states = random_states(study.puma.mechanism, 4 * len(space.parameter_names), np.random.default_rng(study.seed))
    found = NumericalRank.of(
        singular_values((energy_differences(study.puma.mechanism, states) * space.scales)[:, columns])
    )
    rounded = {text: rounded_set(study.puma.mechanism, x, priority) for text, x in QUARTERS.items()}
    checks = tuple(marked(row, link, text, index(row, link) in basis.columns) for row, link, text in table.entries())
    return Item(
        "table5",
        table.title,
        judged(checks),
        "The 36 printed parameters are not independent: three combinations of them change no torque, and I_yz of links "
        "3, 4 and 5, left out here, cannot be. The table comes back, cross by cross, when pi/2 is rounded: the rule "
        "then takes 1e-6 for independence.",
        chosen=(
            "the PUMA's Denavit-Hartenberg lengths (m), which the paper does not print: a2 0.4318, a3 -0.0203, d2 "
            "0.14909, d4 0.4331, d6 0.05625; the rank below is 33 for any lengths",
        ),
        checks=checks,
        claims=(
            Claim(
                printed().claims["puma_independent"],
                "rank of the energies, and number of parameters that Table 4's rule keeps with exact right angles",
                f"{space.rank} and {basis.rank}; but not the 36 of Table 5",
                Outturn.REPRODUCED,
            ),
        ),
        evidence=(
            evidence("The columns of Table 5's 36 parameters have rank {}, with a gap of {}.", found.rank, found.gap),
            *(
                evidence(f"{text} changes torques by {{}} of what its terms could.", torque_share(study.puma, text))
                for text in NULL_COMBINATIONS
            ),
            *(
                evidence(
                    f"With {text} for pi/2 the paper's rule gives Table 5 in {{}} of 60 cells, at a condition of F2' "
                    "V2 of {}; the right set has {}.",
                    60 - len(set(one.kept) ^ set(columns)),
                    one.condition,
                    basis.condition,
                )
                for text, one in rounded.items()
            ),
        ),
        relations=(
            Relations("Within Table 5, these change no torque (the paper's names)", NULL_COMBINATIONS),
            Relations("The set that Table 4 yields with exact right angles", basis.equations()),
        ),
    )


def table6(study: Study) -> Item:
    """Replication of Table 6 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    PUMA 560's assigned inertial parameters. They are inputs, checked against those of the arm in `study`, and shown to
    be those of no rigid bodies. Raises `RankError` where the arm's number of identifiable parameters cannot be
    certified."""
    table, D, space = printed().tables["table6"], study.puma.parameters, study.puma.space
    checks = tuple(given(row, link, text, sign(row) * D[index(row, link)]) for row, link, text in table.entries())
    lowest = [float(np.linalg.eigvalsh(pseudo_inertia(ten))[0]) for ten in D.reshape(-1, 10)]
    wrist = combination(UNPHYSICAL)
    return Item(
        "table6",
        table.title,
        Outturn.ERRATUM,
        "Inputs, used as printed; but no rigid bodies have them. The paper says that they are assigned. It matters "
        "wherever physics does: puma560_measured has consistent values.",
        checks=checks,
        evidence=(
            evidence(
                "{} of 6 links cannot be rigid bodies. The smallest eigenvalues of their pseudo-inertias, link by "
                "link: {}, {}, {}, {}, {}, {}; they would have to be positive.",
                sum(value <= 0.0 for value in lowest),
                *lowest,
            ),
            evidence(
                "Nor does any consistent arm move alike. (I_x4 + I_y4 - I_z4) + (I_x5 + I_z5 - I_y5) is twice the "
                "integral of z² over link 4 and of y² over link 5, so it cannot be negative; it is {} kg m². Every arm "
                "with the same torques has the same value: its part outside the essential space is {}.",
                float(wrist @ D),
                np.abs(space.null_basis.T @ wrist).max(),
            ),
        ),
    )


UNPHYSICAL = "I_x4 + I_y4 - I_z4 + I_x5 - I_y5 + I_z5"


def table7(study: Study) -> Item:
    """Replication of Table 7 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    PUMA 560's essential parameters D_E = V1 V1' D. Each printed number is checked against the one computed. V1 (P, k)
    is the basis of the k directions of parameters that change energies, D (P,) the inertial parameters of the arm in
    `study`. Raises `RankError` where k cannot be certified."""
    table, space = printed().tables["table7"], study.puma.space
    real, D = printed().tables["table6"], study.puma.parameters
    essential = space.project(D)
    checks = tuple(
        compared(row, link, text, sign(row) * essential[index(row, link)]) for row, link, text in table.entries()
    )
    free = (parameters(real) != 0.0) & (np.arange(len(D)) % 10 != 0)
    off = np.abs(essential - parameters(table)).max()
    return Item(
        "table7",
        table.title,
        judged(checks),
        f"{sum(check.exact for check in checks)} of 60 entries to the last digit, the others to within {off:.1e}; and "
        "all 60 follow from Table 6 once the digits that neither table prints are allowed for.",
        chosen=("Denavit-Hartenberg lengths of the PUMA 560, which the paper does not print",),
        checks=checks,
        evidence=(
            evidence(
                "Where 1 half unit of the last digit is agreement, Table 6 as printed misses Table 7 by at most {} "
                "half units; with first moments and inertias anywhere that rounds to Table 6 (masses exact, zeros "
                "zero), by {}.",
                excess(space, real, table, np.zeros(len(D), dtype=bool)),
                excess(space, real, table, free),
            ),
        ),
    )


def table8(study: Study) -> Item:
    """Replication of Table 8 of Sheu and Walker (1991), an `Item` (verdict, checks of entries and judged claims): the
    values of the PUMA 560's independent parameters on the set of Table 5. Each printed number is checked against the
    one computed from `study` with pi/2 rounded, as the paper seems to have done. Raises `RankError` where the arm's
    number of identifiable parameters cannot be certified."""
    table, essential = printed().tables["table8"], parameters(printed().tables["table7"])
    mechanism, space, vector = study.puma.mechanism, study.puma.space, parameters(table)
    rounded = rounded_set(mechanism, QUARTERS[REPORTED], study.priority("table4", mechanism)).independent
    checks = tuple(
        compared(row, link, text, sign(row) * rounded[index(row, link)])
        for row, link, text in table.entries()
        if text != BLANK
    )
    motion, basis = study.puma_motion, study.puma_basis
    torque, other = motion.Y @ study.puma.parameters, motion.Y @ vector
    nonzero = [int(np.count_nonzero(np.abs(D) >= 0.0005)) for D in (vector, study.puma.parameters, essential)]
    beta = zip(basis.names, basis.fundamental_parameters(study.puma.parameters), strict=True)
    return Item(
        "table8",
        table.title,
        judged(checks),
        f"{sum(check.exact for check in checks)} of 36 entries to the last digit, the others to 0.0011, with pi/2 "
        f"rounded to {REPORTED} as in Table 5. Its set is not independent, yet with these values it moves the arm as "
        "Table 7 does.",
        chosen=(f"{REPORTED} for pi/2: with exact right angles Table 5's columns do not determine the values",),
        checks=checks,
        claims=(
            Claim(
                printed().claims["fewer_nonzero"],
                "entries of Tables 8, 6 and 7 that are not zero to three decimals",
                "{} against {} and {}".format(*nonzero),
                Outturn.REPRODUCED if nonzero[0] < min(nonzero[1:]) else Outturn.NOT_REPRODUCED,
            ),
        ),
        evidence=(
            evidence(
                "Table 8 projected onto the essential space differs from Table 7 by at most {}; along the stated "
                "sinusoid its torques differ from Table 6's by at most {} of the largest.",
                np.abs(space.project(vector) - essential).max(),
                np.abs(other - torque).max() / np.abs(torque).max(),
            ),
        ),
        relations=(
            Relations(
                "Values on the right set (SI units, the tensor's own entries); the others of its 36 are zero",
                tuple(f"{key} = {value:.4f}" for key, value in beta if abs(value) > 1e-9),
            ),
        ),
    )
