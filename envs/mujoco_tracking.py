"""The tracking environment whose arm MuJoCo moves; needs the extra `mujoco`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from adaptctl.control.gains.gains import torque_limits as own_limits
from adaptctl.dynamics import Mechanism
from adaptctl.envs.random_reference import Trajectory
from adaptctl.envs.task import RewardWeights, control_period_of, validate_reference
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.simulation.mujoco_plant import MuJoCoPlant, as_mujoco, warn_of_contacts

if TYPE_CHECKING:
    import mujoco


class MuJoCoTrackingEnv(TrackingEnv):
    """
    ## Description

    A tracking environment, the task of `TrackingEnv`, with MuJoCo as the plant: it moves the arm in its scene, with
    contacts, joint stops, equality constraints of other bodies and all else in its model. The controller's model of the
    arm is the mechanism that `Mechanism.from_mujoco` reads, which has no contacts, stops or springs. Actions (r,),
    torques of r joints in N m (N if prismatic), observations (5r + r L,), in rad, rad/s, rad/s^2 (m, m/s, m/s^2 if
    prismatic), for L look-ahead times, reward, episode end, information and options at reset are those of
    `TrackingEnv`, whose card holds here.

    ```python
    import gymnasium
    env = gymnasium.make("adaptctl.envs:adaptctl/MuJoCoTracking-v0", robot="scene.xml", body="arm_base")
    ```

    Torques act at the arm's joints, clipped to the limits of its motors, which get no control themselves. Actuators of
    the arm that are no torques, such as position servos, are refused by name, or switched off with `servos_off`.

    ## Arguments

    | Argument         | Default              | Meaning                                                        |
    |------------------|----------------------|----------------------------------------------------------------|
    | `robot`          | `"puma560_measured"` | an MJCF scene (`.xml`), a `mujoco.MjModel`; or a built-in's name, another file or a `Mechanism`, of which a MuJoCo model is made |
    | `reference`      | `None`               | as in `TrackingEnv`                                            |
    | `body`           | `None`               | the arm's root body, by name, where more than one root body moves; `None` where one does |
    | `servos_off`     | `False`              | switch off the arm's actuators that are no torques             |
    | `duration`, `look_ahead`, `error_bound`, `reward_weights`, `initial_error`, `torque_limits`, `render_mode` | | as in `TrackingEnv` |
    | `control_period` | 0.001                | s a torque is held; MuJoCo takes steps no longer than its model's own in it |

    ## Errors

    `InputError` for bad values, actuators that are refused, an arm with ball or free joints or with equalities, and
    several root bodies that move with none named; `NotFoundError` for an unknown built-in, `body` or mode; `FileError`
    for a bad file; `MissingExtraError` without MuJoCo. Warns (`ReferenceWarning`) of a `Reference` on which the arm
    touches itself or the scene.

    ## Version history

    * v0: first version
    """  # noqa: E501  # tables

    def __init__(
        self,
        robot: str | Path | Mechanism | mujoco.MjModel = "puma560_measured",
        reference: Trajectory = None,
        *,
        body: str | None = None,
        servos_off: bool = False,
        duration: float = 20.0,
        control_period: float = 1e-3,
        look_ahead: Sequence[float] = (0.05, 0.2),
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
