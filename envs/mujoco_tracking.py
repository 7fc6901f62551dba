"""Tracking environment simulated by MuJoCo (extra `mujoco`)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from adaptctl.control.gains.gains import torque_limits as own_limits
from adaptctl.dynamics import Mechanism
from adaptctl.envs.random_reference import Trajectory
from adaptctl.envs.task import LOOK_AHEAD, RewardWeights, control_period_of, validate_reference
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.simulation.mujoco_plant import MuJoCoPlant, as_mujoco, warn_of_contacts

if TYPE_CHECKING:
    import mujoco


class MuJoCoTrackingEnv(TrackingEnv):
    """
    Tracking task with MuJoCo as the plant: contacts, joint stops and all else of its scene.

    Parameters
    ----------
    robot : str, Path, Mechanism or mujoco.MjModel, default "puma560_measured"
        MJCF scene (``.xml``) or model; or a built-in's name, another file or a mechanism, of which a MuJoCo model is
        made.
    reference : Reference, int, "random" or None, default None
        Trajectory as in `TrackingEnv`. One on which the arm touches itself or the scene warns (`ReferenceWarning`).
    body : str, optional
        Root body of the arm. Default: the only root body that moves.
    servos_off : bool, default False
        Switches off the arm's actuators that are no torques, such as position servos, which are refused otherwise.
    duration : float, default 20.0
        Length of an episode in s. 20 s are two periods of the slowest sinusoid of random references.
    control_period : float, default 0.001
        Time in s for which a torque is held; MuJoCo's steps are no longer than its model's own.
    look_ahead : sequence of float, default (0.05, 0.2)
        Times (L,) in s at which the reference ahead is observed.
    error_bound : array_like, default 1.0
        Error in rad (m), one number or (r,), beyond which an episode ends; infinity for never.
    reward_weights : RewardWeights, optional
        Weights of errors and torques in the reward, and the penalty for termination. Default: `RewardWeights()`.
    initial_error : array_like, default 0.0
        Error of the positions at the start in rad (m), one number or (r,). Zero starts on the reference.
    torque_limits : array_like, optional
        Limits in N m (N), one number or (r,). Default: as in `TrackingEnv`.
    render_mode : {"human", "rgb_array"}, optional
        As in `TrackingEnv`. Default: neither.

    Raises
    ------
    InputError
        If a value is bad, an actuator is refused, the arm has ball joints, equalities or a floating base, or several
        root bodies move and none is named.
    NotFoundError
        If there is no such built-in, body or mode.
    FileError
        If the file cannot be read.
    MissingExtraError
        If MuJoCo is not installed.

    Notes
    -----
    Spaces, reward, episode end and options are those of `TrackingEnv`. Controllers use the model of
    `Mechanism.from_mujoco`, without contacts, stops and springs. Torques act at the joints.

    Examples
    --------
    >>> import gymnasium, adaptctl.envs
    >>> gymnasium.spec("adaptctl/MuJoCoTracking-v0").entry_point
    'adaptctl.envs.mujoco_tracking:MuJoCoTrackingEnv'
    """

    def __init__(
        self,
        robot: str | Path | Mechanism | mujoco.MjModel = "puma560_measured",
        reference: Trajectory = None,
        *,
        body: str | None = None,
        servos_off: bool = False,
        duration: float = 20.0,
        control_period: float = 1e-3,
        look_ahead: Sequence[float] = LOOK_AHEAD,
        error_bound: ArrayLike = 1.0,
        reward_weights: RewardWeights | None = None,
        initial_error: ArrayLike = 0.0,
        torque_limits: ArrayLike | None = None,
        render_mode: str | None = None,
    ) -> None:
        period, model = control_period_of(control_period), as_mujoco(robot)
        mechanism = robot if isinstance(robot, Mechanism) else Mechanism.from_mujoco(model, body)
        limits = own_limits(mechanism, torque_limits, finite=True)
        plant = MuJoCoPlant(mechanism, period, torque_limits=limits, model=model, body=body, servos_off=servos_off)
        validate_reference(reference, mechanism.dof)
        if callable(reference):
            warn_of_contacts(plant, reference)
        self._set_task(plant, reference, duration, look_ahead, error_bound, reward_weights, initial_error, render_mode)
