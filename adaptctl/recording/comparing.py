"""Comparisons of runs that were made elsewhere."""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import ArrayLike

from adaptctl.arrays import per_joint
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NotFoundError, validate_kind
from adaptctl.identifiability import FundamentalBasis, essential_space, fundamental_basis
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.controller_run import ControllerRun
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
    """
    Make a comparison of runs of one mechanism, such as logs from a test bench.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r primary (independent) joints.
    runs : mapping of str to Rollout
        Runs by label; the first is the subject that recording and report are about.
    title : str, default ""
        Title of the report; the mechanism's name and the first label where it is empty.
    purpose : str, default ""
        Sentence for the report.
    adaptation_off : str, optional
        Label of the run with adaptation off. Default: None, for logs without such a run.
    basis : FundamentalBasis, optional
        Basis of the estimates, friction following; the mechanism's own in the default order by default.
    torque_limits : array_like, optional
        Limits, one or (r,), in N m (N); the mechanism's by default, or four times the largest torque of random states.
    truth_known : bool, default False
        True where the mechanism's parameters are the arm's, so that estimates are shown against them.

    Returns
    -------
    Comparison
        Comparison for `write_artifacts`.

    Raises
    ------
    InputError
        If there are no runs, one has no samples or other joints, the basis does not fit, or limits are not positive.
    NotFoundError
        If `adaptation_off` is no run's label.
    RankError
        If the number of identifiable parameters cannot be certified.
    LoopError
        If closed loops cannot be closed.

    Examples
    --------
    >>> from adaptctl.recording import compared_runs
    >>> comparison = compared_runs(arm, {"adaptive": run})
    >>> round(comparison.subject.duration, 3)
    0.2
    """
    if not runs:
        raise InputError("compared_runs: expected at least one run")
    for label, rollout in runs.items():
        validate_kind(rollout, Rollout, f"run {label!r}", "as simulate(...) gives one")
        if not len(rollout.time):
            raise InputError(f"run {label!r}: expected at least one sample")
    if adaptation_off is not None and adaptation_off not in runs:
        raise NotFoundError(f"adaptation_off: unknown run {adaptation_off!r}; runs: {', '.join(runs)}")
    space = essential_space(mechanism)
    own = fundamental_basis(space) if basis is None else basis
    limits = finite_torque_limits(mechanism) if torque_limits is None else torque_limits
    made = tuple(
        ControllerRun(name=f"run{k}", label=label, prior_knowledge=NOT_STATED, rollout=rollout)
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
        complete=not any(run.rollout.interrupted for run in made),
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
