"""Identification of a robot from its logs, step by step."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.identifiability.factorisation import one_thread
from adaptctl.identification.choice import BLOCKS, Choice, choose, cutoffs_for, judged_at, misfit_ratio
from adaptctl.identification.columns import JointLog, joint_columns, joint_log
from adaptctl.identification.drives_file import Drives, read_drives
from adaptctl.identification.entropic import EntropicPrior, prior_links
from adaptctl.identification.filtered_dynamics import Rows, SmoothMotion, motions_of, rows_of
from adaptctl.identification.fit import Fit, LogEvidence, positive_columns
from adaptctl.identification.friction_model import FrictionModel, with_all_friction
from adaptctl.identification.identification import Identification
from adaptctl.identification.least_squares import halves, joined_first_stage
from adaptctl.identification.log_files import read_log
from adaptctl.identification.normal_equations import block_edges
from adaptctl.identification.preparation import PreparationStep, prepare
from adaptctl.identification.torque_constants import known_drives, torque_constants, with_constants, without_payloads
from adaptctl.identification.uncertainty import combinations, essential_components, uncertainty
from adaptctl.identification.validation import Validation, alternatives, predicted_torques, validate_plausible

HELD_OUT = 0.4
"""Of the blocks, from the end, where no log for validation is given."""


@one_thread()
def identify(
    logs: str | Path | Sequence[str | Path],
    robot: Mechanism | str | Path,
    drives: Drives | str | Path | None = None,
    *,
    validate: str | Path | Sequence[str | Path] = (),
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    sample_rate: float | None = None,
    topic: str | None = None,
    skip_steps: Collection[str] = (),
    friction: str | None = None,
    cutoff: float | None = None,
    prior_weight: float | None = None,
    instrumental_variables: bool = False,
) -> Identification:
    """The identification, an `Identification`, of a robot's inertial and friction parameters from `logs` of its motion.

    Logs are one file or several (text, Parquet, ROS bags). `robot` is its mechanism, or its file or a built-in's name,
    of which angles between joint axes within 1e-3 rad of right ones are made exact; its links are a first guess.
    `drives`, or the path of their file, is the transmission between motors and joints. Where joints are measured
    directly it is None, and `columns` and `units` give, by "position", "torque", "velocity" and "time", patterns of
    column names (`{joint}` for a joint's name, `{}` for its number from 1, `{0}` from 0) and units ("deg", "N m",
    "deg/s", "ms"); None where the log itself states them. With a sampling `rate` (Hz) rows are taken as evenly spaced,
    else (None) by their stamps. Without logs to `validate` on, the last 40 % of the given ones are held out for it, and
    settings are chosen on the rest; the final estimate uses all.

    `topic` names that of a ROS bag with several (None: its only one), `skip` steps of the logs' preparation to leave
    out ("resample", "unwrap", "velocities", "limits", "standstill"), none by default. `friction` names the terms of the
    friction model ("viscous", "coulomb", "square_root", "stribeck", "offset", "load", separated by commas), `cutoff`
    (Hz) is the low-pass filter's, and `weight` (no unit) that of the prior, the first guess of the links, against the
    logs: an inner validation chooses each of the three that is None. With `instruments`, regressors are freed of noise
    by instrumental variables, for encoders that are coarse or noisy.

    Raises `FileError` for files that cannot be read or used, `NotFoundError` for an unknown built-in robot, `LoopError`
    for kinematic loops that cannot be closed, `MissingExtraError` for ROS bags without rosbags, and `InputError` for no
    logs, a log given twice or both to fit and to validate on, drives of other joints, missing or unknown columns or
    units and those given beside `drives`, unknown names in `skip` or `friction`, a `rate`, `cutoff` or `weight` that is
    not positive and finite, a `cutoff` that the logs do not allow, a link without mass, linear constraints on the
    robot's parameters, payloads of unknown links or with an inertia that no body has, torque constants that the logs do
    not determine, and logs that are at rest, too short or slow, or not this robot's; `RankError` where the robot's
    rank, the number of its identifiable parameters, cannot be certified, `SingularityError` near a singularity of
    kinematic loops, and `AdaptctlError` where no consistent estimate is found.
    """
    given = _paths(logs)
    if not given:
        raise InputError("logs: expected at least one log, got none")
    _validate_different(given, _paths(validate))
    if drives is not None and (columns or units):
        raise InputError(f"columns, units: expected none, as the drives name theirs, got {columns or units!r}")
    if sample_rate is not None:
        positive_number(sample_rate, "sample_rate: expected a positive number of Hz")
    _validate_settings(cutoff, prior_weight)
    mechanism = load(robot, snap=True) if not isinstance(robot, Mechanism) else robot
    known = read_drives(drives) if isinstance(drives, str | Path) else drives
    if known is None:
        known = joint_columns(mechanism, read_log(given[0], topic), columns, units)
    turned = known.of(mechanism)
    train = [joint_log(read_log(path, topic), turned, sample_rate) for path in given]
    test = [joint_log(read_log(path, topic), turned, sample_rate) for path in _paths(validate)]
    terms = None if friction is None else FrictionModel.named(friction)
    return identified(
        mechanism,
        turned,
        train,
        test,
        skip_steps=skip_steps,
        friction=terms,
        cutoff=cutoff,
        prior_weight=prior_weight,
        instrumental_variables=instrumental_variables,
    )


def _paths(given: str | Path | Sequence[str | Path]) -> list[str | Path]:
    if isinstance(given, str | Path):
        return [given]
    if not isinstance(given, Iterable):
        raise InputError(f"logs: expected files, got {given!r}")
    return list(given)


def _validate_different(logs: Sequence[str | Path], others: Sequence[str | Path]) -> None:
    """Raise `InputError` for a log that would count twice, or be judged by itself."""
    fitted = [Path(log).resolve() for log in logs]
    judged = [Path(log).resolve() for log in others]
    for what, given, places in (("logs", logs, fitted), ("validate", others, judged)):
        for i, place in enumerate(places):
            if place in places[:i]:
                raise InputError(f"{what}: {given[i]} is given twice; give each log once")
    for other, place in zip(others, judged, strict=True):
        if place in fitted:
            raise InputError(f"validate: {other} is one of the logs that are fitted; give another, or none")


def _validate_settings(cutoff: float | None, weight: float | None) -> None:
    if cutoff is not None:
        positive_number(cutoff, "cutoff: expected a positive number of Hz")
    if weight is not None:
        positive_number(weight, "prior_weight: expected a positive number")


def identified(
    mechanism: Mechanism,
    drives: Drives,
    train: Sequence[JointLog],
    test: Sequence[JointLog] = (),
    *,
    skip_steps: Collection[str] = (),
    friction: FrictionModel | None = None,
    cutoff: float | None = None,
    prior_weight: float | None = None,
    instrumental_variables: bool = False,
) -> Identification:
    """The identification, an `Identification`, of a robot's inertial and friction parameters from logs that have been
    read.

    `mechanism` is the robot with links as a first guess, `drives` its transmission in the order of its primary
    (independent) joints, as `Drives.of` makes it. `train` are the logs to fit, at least one, `test` those to validate
    on; where there are none, the last 40 % of the former are held out for it. `skip` names steps of the logs'
    preparation to leave out ("resample", "unwrap", "velocities", "limits", "standstill"), none by default. `friction`,
    the low-pass filter's `cutoff` (Hz) and the `weight` (unitless) of the first guess of the links against the logs are
    chosen by an inner validation where None. With `instruments` regressors are freed of encoder noise by instrumental
    variables (False by default).

    Raises `InputError` for a cutoff or weight that is not positive and finite, a cutoff that the logs do not allow,
    unknown steps, a link without mass, linear constraints on the mechanism's parameters, payloads of unknown links or
    with an inertia that no body has, logs that are at rest, too short or slow, or not this robot's, and unknown torque
    constants that they do not determine; `RankError` where the number of identifiable parameters cannot be certified,
    `SingularityError` near a singularity of kinematic loops, `AdaptctlError` where no consistent estimate is found.
    """
    _validate_settings(cutoff, prior_weight)
    drives, train, test, known = _with_constants(mechanism, drives, train, test, skip_steps)
    measured, steps, remarks = gathered(mechanism, drives, train, skip_steps, cutoff)
    evidence = freed_of_noise(measured) if instrumental_variables else measured
    held_out = [] if test else list(range(round((1.0 - HELD_OUT) * evidence.blocks), evidence.blocks))
    training = evidence.part([b for b in range(evidence.blocks) if b not in held_out])
    validate_plausible(training, train[0].source, judged_at(training))
    choice = choose(training, friction, prior_weight, cutoff)
    every = range(training.blocks)
    fit = training.fit(choice.settings, every)
    plain = _plain(training, fit)
    if held_out:
        judged = replace(measured, edges=evidence.edges).part(held_out)
    else:
        judged = gathered(mechanism, drives, test, skip_steps, cutoff)[0]
    origin = "the last 40 % of the logs, held out" if held_out else ", ".join(log.source for log in test)
    validation = _validated(judged, fit.x, origin)
    others = {other.name: _validated(judged, other.x, origin) for other in alternatives(training, fit, plain)}
    final = evidence.fit(choice.settings, range(evidence.blocks)) if held_out else fit
    own = _plain(evidence, final) if held_out else plain
    return _result(mechanism, evidence, own, final, validation, others, choice, steps, remarks + known)


def _with_constants(
    mechanism: Mechanism, drives: Drives, train: Sequence[JointLog], test: Sequence[JointLog], skip: Collection[str]
) -> tuple[Drives, Sequence[JointLog], Sequence[JointLog], tuple[str, ...]]:
    """Drives and logs whose torque constants are known, and in words how, where they were not."""
    if not np.isnan(drives.constants).any():
        return drives, train, test, ()
    evidence, _, _ = gathered(mechanism, drives, train, (*skip, "limits") if "limits" not in skip else skip)
    constants, words = torque_constants(evidence, judged_at(evidence))
    train, test = ([with_constants(log, drives, constants) for log in logs] for logs in (train, test))
    return known_drives(drives, constants), train, test, (words,)


def gathered(
    mechanism: Mechanism,
    drives: Drives,
    logs: Sequence[JointLog],
    skip: Collection[str] = (),
    cutoff: float | None = None,
) -> tuple[LogEvidence, tuple[PreparationStep, ...], tuple[str, ...]]:
    """The evidence of logs, the steps of their preparation, and remarks, three results. The evidence is a `LogEvidence`
    (filtered equations of motion in blocks of time), the steps are a tuple of `PreparationStep`, and the remarks a
    tuple of texts on links of the robot's file that were not physically consistent.

    `mechanism` is the robot with links as a first guess, `drives` its transmission in the order of its primary
    (independent) joints, `logs` are at least one. `skip` names steps of preparation to leave out, none by default;
    `cutoff` (Hz) is a cut-off of the low-pass filter that is added to the usual 12.5, 25 and 50 Hz, or to those of them
    that the logs allow; None adds none. Payloads are subtracted where all torque constants are known. Raises
    `InputError` for unknown steps, a cutoff that the logs do not allow, a link without mass, linear constraints on the
    mechanism's parameters, payloads of unknown links or with an inertia that no body has, and logs that are at rest,
    too short or slow, or not this robot's; `RankError` where the number of identifiable parameters cannot be certified,
    `SingularityError` near a singularity of kinematic loops.
    """
    prepared = [prepare(log, mechanism, skip) for log in logs]
    pieces = [piece for found, _ in prepared for piece in found]
    steps = tuple(dict.fromkeys(step for _, own in prepared for step in own))
    full, (tens, remarks) = with_all_friction(mechanism, drives), prior_links(mechanism)
    motions = list(motions_of(pieces))
    if cutoff is not None:
        _validate_between(cutoff, motions)
    cutoffs = cutoffs_for(min(piece.rate for piece in pieces))
    cutoffs = cutoffs if cutoff is None or cutoff in cutoffs else (*cutoffs, cutoff)
    rows = dict(zip(cutoffs, _rows_without_payloads(motions, full, drives, cutoffs), strict=True))
    _validate_enough(pieces[0].source, min(len(part) for part in rows.values()), full)
    positive, scales = positive_columns(full, tens)
    basis = fundamental_basis(essential_space(full))
    edges = block_edges(rows[cutoffs[0]], BLOCKS)
    prior = EntropicPrior(tens, positive, scales)
    return LogEvidence(full, basis, drives, prior, motions, rows, edges), steps, tuple(remarks)


def _rows_without_payloads(
    motions: Sequence[SmoothMotion], mechanism: Mechanism, drives: Drives, cutoffs: Sequence[float]
) -> list[Rows]:
    """Rows of filtered equations, with payloads subtracted where all torque constants are known."""
    rows = rows_of(motions, mechanism, cutoffs)
    if np.isnan(drives.constants).any():
        return rows
    return [without_payloads(own, motions, mechanism, drives) for own in rows]


def freed_of_noise(evidence: LogEvidence) -> LogEvidence:
    """A copy of the `evidence`, a `LogEvidence` (low-pass filtered equations of motion along logs), whose regressors
    are freed of encoder noise by instrumental variables. The regressors of the logs' even samples are replaced by their
    fitted values from a regression on those of the odd samples, which have the same motion and other noise. The copy
    has those cut-offs that are at most a tenth of half the logs' rate, blocks of time of its own, and payloads
    subtracted where all torque constants are known. Raises `InputError` where there are no such cut-offs, the logs
    being too slow, and where they are too short."""
    pairs = [halves(motion.log) for motion in evidence.motions]
    cutoffs = [cutoff for cutoff in evidence.rows if cutoff <= 0.1 * min(log.rate for log, _ in pairs)]
    if not cutoffs:
        raise InputError("instrumental_variables: the log is too slow to be split into even and odd samples")
    motions = [SmoothMotion.of(own, number) for number, (own, _) in enumerate(pairs)]
    others = [SmoothMotion.of(other, number) for number, (_, other) in enumerate(pairs)]
    own = _rows_without_payloads(motions, evidence.mechanism, evidence.drives, cutoffs)
    instruments = rows_of(others, evidence.mechanism, cutoffs)
    rows = dict(zip(cutoffs, joined_first_stage(own, instruments), strict=True))
    return replace(evidence, motions=motions, rows=rows, edges=block_edges(rows[cutoffs[0]], BLOCKS))


def _validate_between(cutoff: float, motions: Sequence[SmoothMotion]) -> None:
    """Raise `InputError` for a cut-off (Hz) that filters no motion: longer than one, or not below half its rate."""
    least, most = max(2.0 * m.rate / len(m.position) for m in motions), 0.5 * min(m.rate for m in motions)
    if not least < cutoff < most:
        raise InputError(f"cutoff: expected between {least:.3g} and {most:.3g} Hz for these logs, got {cutoff:g}")


def _validate_enough(source: str, rows: int, mechanism: Mechanism) -> None:
    if rows < 2 * BLOCKS:
        raise InputError(
            f"{source}: only {rows} independent instants of motion are left of the log; at least {2 * BLOCKS} are "
            "needed, a few seconds"
        )


def _plain(evidence: LogEvidence, fit: Fit) -> Fit:
    """The fit itself, or without the load-dependent friction that mechanisms do not have."""
    friction = fit.settings.friction
    if not friction.load:
        return fit
    return evidence.fit(replace(fit.settings, friction=replace(friction, load=False)), range(evidence.blocks))


def _validated(evidence: LogEvidence, x: Array, origin: str) -> Validation:
    rows = evidence.rows[judged_at(evidence)]
    P = len(evidence.mechanism.parameter_names)
    load = evidence.load(rows.cutoff, x) if np.any(x[P:]) else None
    return Validation(origin, rows.cutoff, rows.time, rows.torque, predicted_torques(rows, x, load))


def _result(
    mechanism: Mechanism,
    evidence: LogEvidence,
    own: Fit,
    final: Fit,
    validation: Validation,
    others: dict[str, Validation],
    choice: Choice,
    steps: tuple[PreparationStep, ...],
    remarks: tuple[str, ...],
) -> Identification:
    identified = identified_mechanism(evidence, own)
    P = len(evidence.mechanism.parameter_names)
    model = ReducedModel(identified, fundamental_basis(essential_space(identified)))
    places = [evidence.mechanism.parameter_names.index(name) for name in identified.parameter_names]
    onto = np.zeros((len(model.columns), len(own.x)))
    onto[:, places] = model.regrouping
    spread = uncertainty(evidence, own)
    kept = [places[c] for c in model.columns]
    space, components = essential_components(*_states(identified, evidence))
    return Identification(
        identified,
        model,
        spread.of(onto),
        spread.nominal_of(onto),
        final.x[P:],
        validation,
        others,
        choice,
        steps,
        remarks,
        misfit_ratio(evidence, own),
        space,
        components,
        tuple(combinations(own.curvature[np.ix_(kept, kept)], model.names)),
        tuple(evidence.motions),
        evidence.drives,
    )


def identified_mechanism(evidence: LogEvidence, fit: Fit) -> Mechanism:
    """The mechanism, a `Mechanism`, with the links of a `fit`, and drives with those friction terms that the fit's
    friction model has, without load-dependent friction (that grows with the joint's torque). `evidence` is that from
    which the fit was made. Raises `InputError` for parameters that no mechanism may have (not finite, above 1e20, or a
    rotor inertia, viscous or Coulomb friction below zero)."""
    full = evidence.mechanism
    mask = evidence.mask(fit.settings.friction)
    names = [name for name, kept in zip(full.parameter_names, mask, strict=False) if kept]
    values = dict(zip(full.parameter_names, fit.x.tolist(), strict=False))
    drives = [_with_terms(link.joint.drive, link.joint.name, names) for link in full.links]
    shaped = full.with_drives(drives)
    return shaped.with_parameters([values[name] for name in shaped.parameter_names])


def _with_terms(drive: Drive, joint: str, names: Sequence[str]) -> Drive:
    """The drive with those of its terms that have a name among the parameters, zero each."""
    return drive.with_terms({kind: 0.0 if f"{joint}.{kind.value}" in names else None for kind in DriveParameter})


def _states(mechanism: Mechanism, evidence: LogEvidence) -> tuple[Mechanism, Array, Array]:
    """The mechanism and a thinned selection of the logs' positions and velocities (about a thousand, r), for their
    energy."""
    p = np.concatenate([motion.position for motion in evidence.motions])
    v = np.concatenate([motion.velocity for motion in evidence.motions])
    every = max(1, len(p) // 1000)
    return mechanism, p[::every], v[::every]
