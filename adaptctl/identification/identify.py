"""Identification of a robot from its logs, step by step."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.control.adaptation import PriorRanges
from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.identifiability.factorisation import one_thread
from adaptctl.identification.argument_words import in_arguments
from adaptctl.identification.arguments import file_paths, validate_different, validate_settings
from adaptctl.identification.choice import Choice, choose, judged_at, misfit_ratio
from adaptctl.identification.columns import JointLog, joint_columns, joint_log
from adaptctl.identification.contradictions import (
    contradictions,
    excess_misfit,
    implausible_links,
    poorly_predicted,
)
from adaptctl.identification.delay import delay_of, without_delay
from adaptctl.identification.drives_file import Drives, read_drives
from adaptctl.identification.fit import Fit, LogEvidence
from adaptctl.identification.friction_model import FrictionModel, unmoved_terms
from adaptctl.identification.gathering import gathered
from adaptctl.identification.held_out import HeldOut, late_blocks
from adaptctl.identification.hypotheses import compared_hypotheses, validate_meaning
from adaptctl.identification.identification import Identification
from adaptctl.identification.instruments import without_position_noise
from adaptctl.identification.lasting_errors import with_lasting_errors
from adaptctl.identification.log_checks import (
    checked_log,
    found_faults,
    still_joints,
    still_words,
    told_first,
    unmeasured,
    validate_signed,
)
from adaptctl.identification.log_files import read_log
from adaptctl.identification.one_way import one_way_words
from adaptctl.identification.own_gravity import validate_not_added, with_own_gravity
from adaptctl.identification.payloads import with_unknown_payloads
from adaptctl.identification.preparation import PreparationStep
from adaptctl.identification.springs import (
    is_answered,
    known_springs,
    left_out,
    spring_kinds,
    with_springs,
    with_untold_springs,
)
from adaptctl.identification.taking import with_instants
from adaptctl.identification.torque_constants import Completion, completed, is_complete, with_constants
from adaptctl.identification.uncertainty import combinations, essential_components, uncertainty
from adaptctl.identification.unknown_columns import unused_joints, validate_drives
from adaptctl.identification.validation import alternatives, validate_plausible
from adaptctl.logs.arrow import forget
from adaptctl.stages import stage

# Share of each log's blocks, from the end, that is held out where no log for validation is given.
HELD_OUT_SHARE = 0.4


@one_thread()
@in_arguments
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
    instrumental_variables: bool | None = None,
    payloads: Mapping[str, str] | None = None,
    payload_mass: float | None = None,
    payload_after: float | None = None,
    compensated: bool = False,
    trust_log: bool = False,
) -> Identification:
    """
    Identify a robot's inertial and friction parameters from logs of its motion.

    Parameters
    ----------
    logs : str, pathlib.Path or sequence of them
        Logs as text, Parquet or ROS bags.
    robot : Mechanism, str or pathlib.Path
        Mechanism, its file, or a built-in robot's name, as `load` reads it. Its inertial parameters are the prior.
    drives : Drives, str or pathlib.Path, optional
        Transmission between motors and joints, or its file. Default: none, for logs of joint positions and torques.
    validate : str, pathlib.Path or sequence of them, optional
        Logs to validate on. Default: the last 40 % of each of `logs`, which then plays no part in the fit.
    columns : mapping of str to str, optional
        Patterns of column names by "position", "torque", "velocity" and "time": `{joint}` is a joint's name, `{}` its
        number from 1, `{0}` from 0. Default: usual patterns are tried.
    units : mapping of str to str, optional
        Units by the same keys, such as "deg", "N m", "deg/s" and "ms". Default: those that the log states.
    sample_rate : float, optional
        Sample rate in Hz of evenly spaced rows. Default: the rows' time stamps count.
    topic : str, optional
        Topic of JointState messages in a ROS bag. Default: the only such topic.
    skip_steps : collection of str, optional
        Steps of preparation to leave out: "resample", "unwrap", "velocities", "limits", "standstill". None by default.
    friction : str, optional
        Terms of friction and springs, separated by commas: "viscous", "coulomb", "square_root", "stribeck", "offset",
        "stiffness", "sine", "cosine", "sine_2", "cosine_2". Default: chosen by cross-validation within the logs, which
        tries a spring at each joint, or the springs that the robot's file has.
    cutoff : float, optional
        Cut-off frequency in Hz of the low-pass filter. Default: chosen by cross-validation within the logs.
    prior_weight : float, optional
        Weight, without unit, of the prior against the logs. Default: chosen by cross-validation within the logs.
    instrumental_variables : bool, optional
        If true, instrumental variables remove the bias due to noise in measured positions, for coarse or noisy
        encoders; if false, regressors are taken as measured. Default: where such noise is above 0.5 % of the squares of
        a joint's accelerations at `cutoff`, or at the least one.
    payloads : mapping of str to str, optional
        Links or frames at which an unknown body is carried, by the logs in which it is; it is identified too. By
        default those of the drives file.
    payload_mass : float, optional
        Mass in kg of these bodies. Default: identified.
    payload_after : float, optional
        Time in s, in the log's stamps, at which they are taken. Default: the start, or found if no log is without one.
    compensated : bool, default False
        If true, the logged torques lack the gravity torques that the robot adds by itself, and those of the robot
        file's links are added. By default torques are whole, as in the logs of `drive`.
    trust_log : bool, default False
        If true, the log is taken as it is although it fits far better with another sign, order, scale or zero of its
        columns, or other gravity, which is a warning then. By default it is refused.

    Returns
    -------
    Identification
        Parameters fitted to the logs (without what is held out), with standard deviations and a validation.

    Raises
    ------
    FileError
        If a file cannot be read or used.
    InputError
        If an argument is wrong or contradicts another, columns or units are missing, or the logs are at rest, too
        short, sampled too slowly, of another robot, or of columns that mean something else.
    NotFoundError
        If a built-in robot is unknown.
    MissingExtraError
        If a ROS bag is given and rosbags is not installed.
    RankError
        If the number of identifiable parameters cannot be certified.
    LoopError
        If closed loops cannot be closed (`SingularityError` near a singularity).
    AdaptctlError
        If no physically consistent estimate is found.

    Notes
    -----
    Links stay physically consistent by an entropic prior; see :doc:`/identification`.

    Examples
    --------
    >>> time = np.arange(0.0, 8.0, 0.01)
    >>> positions, *rates = reference(time)
    >>> rows = np.column_stack([time, positions, arm.inverse_dynamics(positions, *rates)])
    >>> names = "time,position.shoulder,position.elbow,torque.shoulder,torque.elbow"
    >>> np.savetxt(tmp / "log.csv", rows, delimiter=",", header=names, comments="")
    >>> units = {"time": "s", "position": "rad", "torque": "N m"}
    >>> found = adaptctl.identify(tmp / "log.csv", arm, units=units, friction="viscous", cutoff=12.5, prior_weight=1.0)
    >>> found.validation.relative_error < 0.01
    True
    """
    given = file_paths(logs)
    if not given:
        raise InputError("logs: expected at least one log")
    validate_different(given, file_paths(validate))
    if drives is not None and (columns or units):
        raise InputError(f"columns, units: expected none, because the drives specify them, got {columns or units!r}")
    if sample_rate is not None:
        positive_number(sample_rate, "sample_rate: expected a positive number of Hz")
    validate_settings(cutoff, prior_weight)
    mechanism = load(robot) if not isinstance(robot, Mechanism) else robot
    known = read_drives(drives) if isinstance(drives, str | Path) else drives
    tables = [[read_log(path, topic) for path in paths] for paths in (given, file_paths(validate))]
    if known is None:
        known = joint_columns(mechanism, tables[0][0], columns, units, sample_rate is None)
    validate_drives(tables[0][0], known, mechanism)
    unused = unused_joints(tables[0][0], known, mechanism)
    tables[0][0] = replace(tables[0][0], notes=(*tables[0][0].notes, *unused))
    turned = with_unknown_payloads(known.ordered_like(mechanism), given, payloads, payload_mass, payload_after)
    train, test = ([joint_log(log, turned, sample_rate) for log in logs] for logs in tables)
    if compensated:
        for log in (*tables[0], *tables[1]):
            validate_not_added(log)
        train, test = ([with_own_gravity(log, mechanism, turned) for log in logs] for logs in (train, test))
    forget(tables)  # of which the logs have copies
    with told_first([f"{train[0].source}: {note}" for note in unused]):
        return identified(
            mechanism,
            turned,
            train,
            test,
            skip_steps=skip_steps,
            friction=None if friction is None else FrictionModel.named(friction),
            cutoff=cutoff,
            prior_weight=prior_weight,
            instrumental_variables=instrumental_variables,
            trust_log=trust_log,
        )


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
    instrumental_variables: bool | None = None,
    trust_log: bool = False,
) -> Identification:
    """Identification from logs that have been read."""
    validate_settings(cutoff, prior_weight)
    checks = [checked_log(log, mechanism) for log in (*train, *test)]
    facts = tuple(dict.fromkeys(fact for _, own in checks for fact in own))
    checked = [log for log, _ in checks]
    with told_first(found_faults((*train, *test), checked)):
        return _of_checked(
            mechanism,
            drives,
            checked[: len(train)],
            checked[len(train) :],
            facts,
            skip_steps=skip_steps,
            friction=friction,
            cutoff=cutoff,
            prior_weight=prior_weight,
            instrumental_variables=instrumental_variables,
            trust_log=trust_log,
        )


def _of_checked(
    mechanism: Mechanism,
    drives: Drives,
    train: Sequence[JointLog],
    test: Sequence[JointLog],
    facts: tuple[PreparationStep, ...],
    *,
    skip_steps: Collection[str],
    friction: FrictionModel | None,
    cutoff: float | None,
    prior_weight: float | None,
    instrumental_variables: bool | None,
    trust_log: bool,
) -> Identification:
    """Identification from logs whose impossible rows are filled, and from facts about them."""
    if not trust_log:
        validate_signed((*train, *test), mechanism)
    whole = _completed(mechanism, drives, train, skip_steps)
    train, test = ([with_constants(log, drives, whole.drives.constants) for log in logs] for logs in (train, test))
    drives = whole.drives
    springs, mechanism = known_springs(mechanism, friction), with_springs(mechanism, friction)
    measured, steps, remarks = gathered(mechanism, drives, train, skip_steps, cutoff)
    still = still_joints(train, mechanism)
    evidence, noisy = without_position_noise(measured, cutoff or measured.band, instrumental_variables)
    late = [] if test else late_blocks(evidence, HELD_OUT_SHARE)
    training = evidence.part([b for b in range(evidence.blocks) if b not in late])
    cutoffs = (judged_at(training), min(judged_at(training), evidence.band))
    if late:
        judged = replace(measured, edges=evidence.edges).part(late)
    else:
        judged = gathered(mechanism, drives, test, skip_steps, cutoffs=cutoffs, band=evidence.band)[0]
    delay = delay_of(training, springs)
    meaning = compared_hypotheses(measured, delay, () if late else judged.motions, springs)
    first = unmeasured((*train, *test), mechanism) if meaning.sentence else ()
    doubts = validate_meaning(meaning, trust_log, first)
    with told_first(doubts):
        validate_plausible(training, train[0].source, judged_at(training), spring_kinds(mechanism))
    training, judged, delayed, late_torques = without_delay(delay, training, judged, springs)
    choice = choose(training, friction, prior_weight, cutoff, unmoved_terms(training.mechanism, still))
    with stage("fitting links and friction"):
        fit = training.fit(choice.settings, range(training.blocks))
    origin = f"the last 40 % of {'each' if train[1:] else 'the'} log" if late else ", ".join(log.source for log in test)
    held_out = HeldOut(judged, origin, *cutoffs, choice.settings.left_out)
    read = dict.fromkeys(note for log in (*train, *test) for note in log.notes)
    doubts = () if is_answered(meaning, choice.settings.friction, bool(late_torques)) else doubts
    excess = excess_misfit(training, fit, held_out)
    notes = (
        *doubts,
        *([f"{meaning.slopes.name}: {meaning.slopes.outcome}"] if meaning.other_side else ()),
        *read,
        *still_words(still),
        *one_way_words(training),
        *remarks,
        *whole.words,
        *left_out(choice.settings, springs, meaning),
        *filter(None, [late_torques, excess.warning]),
        *noisy,
        *contradictions(training, fit, meaning.other_side),
    )
    told = (*facts, meaning.slopes, meaning.alike, delayed, *steps, excess.step)
    result = _result(mechanism, training, fit, held_out, choice, told, notes)
    poor = poorly_predicted(training, fit, result.validation_in_band)
    warnings = (*implausible_links(result.mechanism, mechanism), *poor, *result.warnings)
    return replace(result, warnings=warnings, hypotheses=meaning.tried, payloads=whole.payloads)


def _completed(mechanism: Mechanism, drives: Drives, train: Sequence[JointLog], skip: Collection[str]) -> Completion:
    if is_complete(drives):
        return Completion(drives, (), ())
    evidence = gathered(mechanism, drives, train, skip := {*skip, "limits"})[0]
    timed, words = with_instants(evidence, judged_at(evidence))
    evidence = gathered(mechanism, timed, train, skip)[0] if words else evidence
    found = completed(evidence, judged_at(evidence))
    return found._replace(words=(*words, *found.words))


@stage("validating the fit")
def _result(
    file: Mechanism,
    evidence: LogEvidence,
    fit: Fit,
    held_out: HeldOut,
    choice: Choice,
    steps: tuple[PreparationStep, ...],
    remarks: tuple[str, ...],
) -> Identification:
    identified = identified_mechanism(evidence, fit, file)
    model = ReducedModel(identified)
    places = [evidence.mechanism.parameter_names.index(name) for name in identified.parameter_names]
    onto = np.zeros((len(model.columns), len(fit.x)))
    onto[:, places] = model.regrouping
    spread = with_untold_springs(with_lasting_errors(uncertainty(evidence, fit), evidence, fit), evidence, fit)
    rough = PriorRanges().for_parameters(model.names) * np.isin(model.names, fit.settings.untold)
    kept = [places[c] for c in model.columns]
    space, components = essential_components(*_states(identified, evidence))
    common, band = held_out.judged(identified)
    return Identification(
        identified,
        model,
        spread.of(onto) + rough,
        spread.nominal_of(onto) + rough,
        common,
        band,
        held_out,
        {other.name: held_out.of(other.x) for other in alternatives(evidence, fit)},
        choice,
        steps,
        remarks,
        misfit_ratio(evidence, fit),
        fit.residual,
        space,
        components,
        tuple(combinations(fit.curvature[np.ix_(kept, kept)], model.names)),
        tuple(evidence.motions),
        evidence.drives,
        interval_deviations=np.where(rough > 0.0, np.inf, spread.for_intervals(onto)),
    )


def identified_mechanism(evidence: LogEvidence, fit: Fit, file: Mechanism) -> Mechanism:
    """Mechanism with a fit's links and friction; friction of drives that do not move is the file's."""
    full = evidence.mechanism
    mask = fit.settings.columns(full)
    names = [name for name, kept in zip(full.parameter_names, mask, strict=True) if kept]
    values = dict(zip(full.parameter_names, fit.x.tolist(), strict=True))
    known = dict(zip(file.parameter_names, file.inertial_parameters.tolist(), strict=True))
    kept = (name for name in fit.settings.untold if name in known)
    unmoved = {name: known[name] for name in kept if not DriveParameter(name.rsplit(".", 1)[1]).is_spring}
    names, values = [*names, *unmoved], values | unmoved
    drives = [_with_terms(link.joint.drive, link.joint.name, names) for link in full.links]
    shaped = full.with_drives(drives)
    return shaped.with_parameters([values[name] for name in shaped.parameter_names])


def _with_terms(drive: Drive, joint: str, names: Sequence[str]) -> Drive:
    """The drive with those of its terms that have a name among the parameters, zero each."""
    return drive.with_terms({kind: 0.0 if f"{joint}.{kind.value}" in names else None for kind in DriveParameter})


def _states(mechanism: Mechanism, evidence: LogEvidence) -> tuple[Mechanism, Array, Array]:
    """Mechanism with the logs' positions and velocities."""
    p = np.concatenate([motion.position for motion in evidence.motions])
    v = np.concatenate([motion.velocity for motion in evidence.motions])
    return mechanism, p, v
