"""Torque constants of motors, and payloads, from logs (Gautier and Briot 2014)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from msgspec import structs

from adaptctl.arrays import Array
from adaptctl.description.inertia import LOWER, transformed
from adaptctl.description.readers.entries import Tensor
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.identification.drives_content import PayloadEntry
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.fit import LogEvidence
from adaptctl.identification.identified_payload import ENTRIES, IdentifiedPayload
from adaptctl.identification.least_squares import least_squares
from adaptctl.identification.loaded_equations import loaded_equations
from adaptctl.identification.loaded_fit import LoadedEquations, LoadedFit, loaded_fit
from adaptctl.identification.payloads import payload_place
from adaptctl.logs.on_disk import rowwise
from adaptctl.stages import stage

# Relative deviation of a torque constant or a payload's mass from which on it has no number.
MAX_DEVIATION = 0.25
# Deviation (m) of a payload's centre from which on it has no number.
MAX_CENTER_DEVIATION = 0.05
# Error of logs by one robot over that by a robot for each, from which on they are not of one.
MAX_ERROR_RATIO = 2.0


class Completion(NamedTuple):
    """Drives with torque constants and payloads that were unknown, how these were found, and the payloads."""

    drives: Drives
    words: tuple[str, ...]
    payloads: tuple[IdentifiedPayload, ...]


def is_complete(drives: Drives) -> bool:
    """True if all torque constants and payloads are known."""
    return not np.isnan(drives.constants).any() and all(payload.is_known for payload in drives.payloads)


@stage("identifying torque constants and payloads")
def completed(evidence: LogEvidence, cutoff: float) -> Completion:
    """Drives whose torque constants and payloads are known, by a consistent fit to both and to the links."""
    drives, unknown = evidence.drives, bool(np.isnan(evidence.drives.constants).any())
    fitted = tuple(payload for payload in drives.payloads if unknown or not payload.is_known)
    problem = loaded_equations(evidence, cutoff, fitted)
    found = loaded_fit(problem)
    if any(not payload.is_known for payload in fitted):
        validate_one_robot(problem, found, evidence)
    for k, payload in enumerate(fitted):
        validate_payload(problem, found, k, payload, evidence)
    words, constants = _constants(drives, problem, found) if unknown else ((), drives.constants)
    bodies = {id(one): _identified(evidence, found, k, one) for k, one in enumerate(fitted) if not one.is_known}
    payloads = tuple(_stated(one, bodies.get(id(one))) for one in drives.payloads)
    whole = replace(known_drives(drives, constants) if unknown else drives, payloads=payloads)
    return Completion(whole, (*words, *(body.words for body in bodies.values())), tuple(bodies.values()))


def _constants(drives: Drives, problem: LoadedEquations, found: LoadedFit) -> tuple[tuple[str, ...], Array]:
    """Sentence on the torque constants that were unknown, and all constants (r,)."""
    names = [drives.motors[i].name for i in problem.unknown.tolist()]
    relative = _relative_deviations(found, problem, _is_scaled(drives))
    worst = int(np.argmax(relative))
    if not relative[worst] < MAX_DEVIATION:
        raise InputError(
            f"torque constants of {', '.join(names)}: the log does not distinguish them ({names[worst]} is known to "
            f"{relative[worst]:.0%}); record a motion of more joints at once, or one with a known payload"
        )
    constants = drives.constants.copy()
    constants[problem.unknown] = 1.0 / found.c[problem.unknown]
    each = zip(names, constants[problem.unknown].tolist(), relative.tolist(), strict=True)
    told = ", ".join(f"{name} {k:.4g} (deviation {abs(k) * off:.1g})" for name, k, off in each)
    return (f"torque constants {told} are identified {_by(drives)}",), constants


def _identified(evidence: LogEvidence, found: LoadedFit, number: int, payload: PayloadEntry) -> IdentifiedPayload:
    """Body in the frame of its entry, with its covariance."""
    own = slice(first := evidence.prior.tens.size + 10 * number, first + 10)
    back = payload_place(payload, evidence.mechanism).pose.inverse
    turn = np.stack([transformed(e, back) for e in np.eye(10)], axis=-1)
    covariance = found.student.quantile_ratio**2 * turn @ found.covariance[own, own] @ turn.T
    return IdentifiedPayload(payload.log, payload.link, turn @ found.x[own], covariance)


def _stated(payload: PayloadEntry, found: IdentifiedPayload | None) -> PayloadEntry:
    """Entry of a payload with what was found of it."""
    if found is None:
        return payload
    x, y, z = found.center_of_mass.tolist()
    inertia = found.inertia_at_center
    tensor = Tensor(**{name: float(inertia[place]) for name, place in zip(ENTRIES, LOWER, strict=True)})
    return structs.replace(payload, mass=found.mass, center_of_mass=(x, y, z), inertia_at_center=tensor)


def validate_one_robot(problem: LoadedEquations, found: LoadedFit, evidence: LogEvidence) -> None:
    """Raise `InputError` for logs that differ by more than the bodies carried: of other robots, or friction."""
    numbers = {motion.number: motion.log.source for motion in evidence.motions}
    sources = [numbers[log] for log, _ in evidence.edges]
    groups = [[b for b, own in enumerate(sources) if own == source] for source in dict.fromkeys(sources)]
    apart = sum(_least(problem, group) for group in groups)
    together = problem.squares(found.x, found.c)
    worst = float(np.sqrt(np.mean(together / np.maximum(apart, 1e-300))))
    if len(groups) > 1 and worst > MAX_ERROR_RATIO:
        raise InputError(
            f"{', '.join(dict.fromkeys(sources))}: one robot with the payloads given fits them {worst:.1f} times worse "
            "than a robot for each; check that all are of this robot, one tool and mounting, and which has the payload"
        )


def _least(problem: LoadedEquations, blocks: Sequence[int]) -> Array:
    """Sums (r,) of squared residuals of each motor's own least squares in some blocks."""
    own = problem.equations.over(blocks)
    N, m = own.normal[0], own.moment[0]
    x = np.stack([least_squares(N[k], m[k], problem.columns) for k in range(len(m))])
    fitted = 2.0 * np.einsum("kp,kp->k", m, x) - np.einsum("kp,kpq,kq->k", x, N, x)
    return np.maximum(own.square[0] - fitted, 1e-12 * own.square[0])


def validate_payload(
    problem: LoadedEquations, found: LoadedFit, number: int, payload: PayloadEntry, evidence: LogEvidence
) -> None:
    """Raise `InputError` for a payload whose weight the log hardly shows."""
    first = evidence.prior.tens.size + 10 * number
    one = np.zeros((4, len(found.covariance)))
    one[:, first : first + 4] = np.eye(4)
    off, mass = found.deviations(one), float(found.x[first])
    if not (off[0] < MAX_DEVIATION * mass and off[1:].max() < MAX_CENTER_DEVIATION * mass):
        raise InputError(
            f"payload in {payload.log}: the log hardly shows it (mass {mass:.2g} kg with a deviation of {off[0]:.1g} "
            f"kg, centre with {off[1:].max() / mass:.1g} m); record a motion that turns it across gravity and further"
            + (f", or check that it is taken at {payload.after:g} s" if np.isfinite(payload.after) else "")
        )


def _is_scaled(drives: Drives) -> bool:
    """True if a known constant or the mass of a payload gives the constants a common scale."""
    return not np.isnan(drives.constants).all() or any(payload.mass is not None for payload in drives.payloads)


def _by(drives: Drives) -> str:
    if _is_scaled(drives):
        return "from the known constants and payloads"
    return (
        "up to a common scale, with the link masses of the robot file; a payload of known mass or one known constant "
        "determines the scale"
    )


def _relative_deviations(found: LoadedFit, problem: LoadedEquations, scaled: bool) -> Array:
    """Deviations of the unknown constants relative to them, of their ratios where nothing gives them a scale."""
    u = len(problem.unknown)
    own = np.zeros((u, len(found.covariance)))
    own[:, -u:] = np.diag(1.0 / found.c[problem.unknown])
    return found.deviations(own if scaled else own - own.mean(axis=0))


def with_constants(log: JointLog, drives: Drives, constants: Array) -> JointLog:
    """Log with joint torques by given torque constants, where the drives' are unknown."""
    unknown = np.isnan(drives.constants)
    if not unknown.any():
        return log
    factors, inverse = np.where(unknown, constants, 1.0), np.linalg.inv(drives.transmission)
    return replace(log, torque=rowwise(lambda torque: drives.torque(torque @ inverse * factors), log.torque))


def known_drives(drives: Drives, constants: Array) -> Drives:
    """Drives with given torque constants (r,)."""
    pairs = zip(drives.motors, constants.tolist(), strict=True)
    return replace(drives, motors=tuple(structs.replace(motor, torque_constant=k) for motor, k in pairs))
