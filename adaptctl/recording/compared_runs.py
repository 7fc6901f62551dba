"""Comparisons of runs that were made elsewhere: on a bench, in another simulator, in a loop of one's own."""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import ArrayLike

from adaptctl.arrays import per_joint
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NotFoundError, validate_kind
from adaptctl.identifiability import FundamentalBasis, essential_space, fundamental_basis
from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.simulation.run import Rollout

NOT_STATED = ""


def compared_runs(
    mechanism: Mechanism,
    runs: Mapping[str, Rollout],
    *,
    title: str = "",
    purpose: str = "",
    adaptation_off: str | None = None,
    basis: FundamentalBasis | None = None,
    torque_limits: ArrayLike | None = None,
    truth_known: bool = False,
) -> Comparison:
    """A `Comparison` of `runs` of one `mechanism`, such as logs of a bench, for `write_artifacts`; the first run is its
    subject, the one that recording and report are about.

    `runs` maps labels, for legends, to runs (`Rollout`) of the mechanism's r primary (independent) joints. `title` is
    the report's, where empty the mechanism's name and the first label; `purpose` is a sentence for the report, or
    empty. `adaptation_off` is the label of the run with adaptation off, None if there is none. `basis` is the
    fundamental basis (base parameters) of the estimates (T, k), T samples of k parameters: the basis's and then
    friction's; None for the mechanism's own, `fundamental_basis` with the default order of removing dependent
    parameters. `torque_limits` (r,), or one for all, N m (N for a prismatic joint), must be positive and finite; None
    for the mechanism's effort limits, and where a joint has none four times its largest torque in random states, at
    least 1 N m (N). Unless `truth_known`, the mechanism's parameters are not taken for those of the arm: recording and
    report show estimates without true values.

    Raises `InputError` for empty `runs`, for a run without samples or of another number of joints, where the first run
    has estimates of another number of parameters than k, for a basis of another mechanism, and for limits of another
    shape, not above 0 or not numbers (`NonFiniteError` for NaN and infinity); `NotFoundError` for an `adaptation_off`
    that is no run's label; `RankError` where the number of identifiable parameters cannot be certified; `LoopError`
    where the mechanism's kinematic loops cannot be closed.
    """
    if not runs:
        raise InputError("compared_runs: expected at least one run")
    for label, rollout in runs.items():
        validate_kind(rollout, Rollout, f"run {label!r}", "as simulate(...) gives one")
        if not len(rollout.time):
            raise InputError(f"run {label!r}: expected at least one sample, got none")
    if adaptation_off is not None and adaptation_off not in runs:
        raise NotFoundError(f"adaptation_off: there is no run {adaptation_off!r}; runs: {', '.join(runs)}")
    space = essential_space(mechanism)
    own = fundamental_basis(space) if basis is None else basis
    limits = finite_torque_limits(mechanism) if torque_limits is None else torque_limits
    made = tuple(
        ControllerRun(name=f"run{k}", label=label, knows=NOT_STATED, rollout=rollout)
        for k, (label, rollout) in enumerate(runs.items(), 1)
    )
    off = next((run.name for run in made if run.label == adaptation_off), "")
    compared = Comparison(
        experiment="runs",
        title=title or f"{mechanism.name}: {made[0].label}",
        purpose=purpose,
        mechanism=mechanism,
        space=space,
        basis=own,
        runs=made,
        torque_limits=per_joint(limits, mechanism.dof, "torque_limits"),
        settings=(),
        seed=0,
        duration=made[0].duration,
        complete=all(run.rollout.complete for run in made),
        without_adaptation=off,
        truth_known=truth_known,
    )
    _validate_fit(compared)
    return compared


def _validate_fit(compared: Comparison) -> None:
    dof, known = compared.mechanism.dof, len(compared.model.names)
    for run in compared.runs:
        if run.rollout.p.shape[1] != dof:
            raise InputError(f"run {run.label!r}: expected {dof} joints, got {run.rollout.p.shape[1]}")
    if (given := compared.subject.rollout.estimate.shape[1]) not in (0, known):
        raise InputError(
            f"run {compared.subject.label!r}: expected estimates of {known} parameters or none, got {given}"
        )
