"""Springs and harmonics of the angle that a fit may have, and those that a log does not tell from gravity."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.fit import Fit, FitSettings, LogEvidence
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.hypotheses import LogMeaning
from adaptctl.identification.least_squares import weighted_least_squares
from adaptctl.identification.listed_hypotheses import COUNTERBALANCE, DELAY, SPRING
from adaptctl.identification.uncertainty import Uncertainty, inverse_curvature, scaled_inverse

# Share of a column's squares that other columns leave, below which it is one of them; nominal deviations that a term
# must be below (those of rows are too small by about three, as errors last), as a share of the joint's torque.
LEAST_LEFT, DEVIATIONS, MAX_TORQUE_SHARE = 1e-9, 3.0, 0.2

ANSWERS = {SPRING: DriveParameter.STIFFNESS, COUNTERBALANCE: DriveParameter.SINE}


def with_springs(mechanism: Mechanism, friction: FrictionModel | None) -> Mechanism:
    """Mechanism with the springs that are tried: those named, else the file's own, else one at each primary joint."""
    own = {kind for _, kind in mechanism.description.drive_parameters if kind.is_spring}
    if friction is None and own:
        return mechanism
    kinds = {DriveParameter.STIFFNESS} if friction is None else {kind for kind in friction.kinds if kind.is_spring}
    primary = {joint.name for joint in mechanism.primary_joints}
    each = []
    for link in mechanism.links:
        turns = link.joint.kind.is_revolute
        tried = {kind for kind in kinds if turns or not kind.is_harmonic} if link.joint.name in primary else set()
        each.append(_with(link.joint.drive, tried))
    return mechanism.with_drives(each)


def _with(drive: Drive, kinds: set[DriveParameter]) -> Drive:
    springs = [kind for kind in DriveParameter if kind.is_spring]
    return drive.with_terms({kind: 0.0 if kind in kinds else None for kind in springs})


def known_springs(mechanism: Mechanism, friction: FrictionModel | None) -> tuple[DriveParameter, ...]:
    """Kinds of springs that were asked for, or that the mechanism's file has."""
    return spring_kinds(mechanism) if friction is None else tuple(kind for kind in friction.kinds if kind.is_spring)


def spring_kinds(mechanism: Mechanism) -> tuple[DriveParameter, ...]:
    """Kinds of springs that a mechanism's primary joints have, in their order."""
    primary = {joint.name for joint in mechanism.primary_joints}
    found = {k for i, k in mechanism.description.drive_parameters if mechanism.links[i].joint.name in primary}
    return tuple(kind for kind in DriveParameter if kind in found and kind.is_spring)


def untold_springs(evidence: LogEvidence, settings: FitSettings) -> tuple[str, ...]:
    """Names of springs' parameters that the log does not tell from the others, the worst left out first."""
    names, untold = evidence.mechanism.parameter_names, settings.untold
    equations = evidence.equations(settings, range(evidence.blocks))
    columns = evidence.independent(settings)
    _, deviations = weighted_least_squares(equations, columns)
    A, _ = equations.whitened(deviations)
    torque = np.sqrt(equations.square.sum(axis=0) / np.maximum(equations.count.sum(axis=0), 1.0))
    springs = _springs(evidence, columns)
    while springs:
        doubts = _doubts(A, columns, springs, evidence, settings.cutoff, torque)
        worst = int(np.argmax(doubts))
        if doubts[worst] <= MAX_TORQUE_SHARE:
            break
        untold = (*untold, names[springs[worst][0]])
        columns = columns[columns != springs.pop(worst)[0]]
    return untold


def _springs(evidence: LogEvidence, columns: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Indices of springs' parameters among some columns, with those of their primary joints."""
    mechanism = evidence.mechanism
    primary = [joint.name for joint in mechanism.primary_joints]
    first = len(mechanism.parameter_names) - len(mechanism.description.drive_parameters)
    pairs = ((first + k, i, kind) for k, (i, kind) in enumerate(mechanism.description.drive_parameters))
    kept = set(columns.tolist())
    return [(c, primary.index(mechanism.links[i].joint.name)) for c, i, kind in pairs if kind.is_spring and c in kept]


def _doubts(
    A: Array,
    columns: NDArray[np.int64],
    springs: list[tuple[int, int]],
    evidence: LogEvidence,
    cutoff: float,
    torque: Array,
) -> list[float]:
    """Torque that is not told from other terms, for each spring, over that of its joint."""
    own = A[np.ix_(columns, columns)]
    size = np.sqrt(np.diag(own))
    size[size == 0.0] = 1.0
    inverse = np.linalg.inv(own / np.outer(size, size) + 0.1 * LEAST_LEFT * np.eye(len(columns)))
    found, places = [], columns.tolist()
    for c, j in springs:
        k = places.index(c)
        left = 1.0 / inverse[k, k]
        swing = float(np.std(evidence.rows[cutoff].regressor[:, j, c]))
        doubt = DEVIATIONS * float(np.sqrt(inverse[k, k])) / float(size[k]) * swing / float(torque[j] or 1.0)
        found.append(doubt if left > LEAST_LEFT else np.inf)
    return found


def with_untold_springs(found: Uncertainty, evidence: LogEvidence, fit: Fit) -> Uncertainty:
    """Uncertainty with what springs would change that are left out as untold, but are not quite other terms."""
    names, kinds = evidence.mechanism.parameter_names, fit.settings.friction.kinds
    A, b = evidence.equations(fit.settings, range(evidence.blocks)).whitened(fit.deviations)
    columns = evidence.independent(fit.settings)
    told, bias = scaled_inverse(A, columns), found.bias
    for c in (names.index(name) for name in fit.settings.untold if DriveParameter(name.rsplit(".", 1)[1]) in kinds):
        left = float(A[c, c] - A[c] @ told @ A[c])
        if left > LEAST_LEFT * A[c, c]:
            effect = inverse_curvature(evidence, fit)[0] @ A[c]
            square = (float(b[c] - A[c] @ fit.x) / left) ** 2 + DEVIATIONS**2 / left
            bias = bias + square * np.outer(effect, effect)
    return replace(found, bias=bias)


def told_kinds(mechanism: Mechanism, untold: tuple[str, ...]) -> tuple[DriveParameter, ...]:
    """Kinds of springs that a mechanism has, and the log tells at some joint."""
    kinds = {name.rsplit(".", 1)[1] for name in mechanism.parameter_names if name not in untold}
    return tuple(kind for kind in spring_kinds(mechanism) if kind.value in kinds)


def validate_told(friction: FrictionModel, mechanism: Mechanism, untold: tuple[str, ...]) -> None:
    """Raise `InputError` where a log tells none of the springs of a kind that was asked for."""
    told = told_kinds(mechanism, untold)
    for kind in spring_kinds(mechanism):
        if kind in friction.kinds and kind not in told:
            raise InputError(
                f"friction: the log does not tell {kind.value} from the gravity of links and other terms at any joint; "
                "record a motion of a wider range, or leave it out"
            )


def is_answered(meaning: LogMeaning, friction: FrictionModel, freed: bool) -> bool:
    """True if the hypothesis that a log names is a spring that the model has, or a delay that it was freed of."""
    return bool(_named_springs(meaning) & set(friction.kinds)) or (freed and DELAY in _named(meaning))


def _named_springs(meaning: LogMeaning) -> set[DriveParameter]:
    """Kinds of springs that a log names."""
    return {ANSWERS[kind] for kind in _named(meaning) if kind in ANSWERS}


def _named(meaning: LogMeaning) -> set[str]:
    return {one.kind for one in meaning.tried if one.named}


def left_out(settings: FitSettings, known: Collection[DriveParameter], meaning: LogMeaning) -> Iterator[str]:
    """Sentences on kinds of springs that are known or that a log names, and have no estimate at some joint."""
    expected = {*known, *_named_springs(meaning)} & set(settings.friction.kinds)
    for name in settings.untold:
        joint, kind = name.rsplit(".", 1)
        if DriveParameter(kind) in expected:
            yield (
                f"{joint}: the log does not tell {kind} from the gravity of links and other terms, so it has none; "
                "a wider range of the joint's motion may"
            )
