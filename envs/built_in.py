"""Tracking environments of two built-in arms."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs.random_reference import Trajectory
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.errors import PhysicalConsistencyWarning

PUMA560_REFERENCE = Sinusoids(
    center=np.array([0.0, -0.6, 0.8, 0.0, 0.5, 0.0]),
    amplitude=np.array([0.5, 0.4, 0.4, 0.4, 0.4, 0.4]),
    frequency=np.array([0.1, 0.125, 0.15, 0.175, 0.2, 0.225]),
    start_time=2.0,
)


class Puma560TrackingEnv(TrackingEnv):
    """
    Tracking task of the PUMA 560, six revolute joints that follow sinusoids.

    Parameters
    ----------
    robot : str, Path or Mechanism, default "puma560"
        Name, file or mechanism of a robot with six joints; Notes name the two built-in parameter sets.
    reference : Reference, int, "random" or None, optional
        Trajectory. Default: sinusoids about (0, -0.6, 0.8, 0, 0.5, 0) rad of amplitudes (0.5, 0.4, 0.4, 0.4, 0.4, 0.4)
        rad and frequencies (0.1, 0.125, 0.15, 0.175, 0.2, 0.225) Hz, faded in from rest over 2 s.
    initial_error : array_like, default 0.1
        Position error in rad at the start of an episode, one number or (6,). The default is a tenth of the error at
        which an episode terminates.
    **settings : object
        Other arguments of `TrackingEnv`.

    Raises
    ------
    InputError
        If a robot of other than six joints has no `reference` of its own; also the errors of `TrackingEnv`.

    Notes
    -----
    All else is as in `TrackingEnv`.

    ## Action space

    `Box(-limit, limit, (6,), float64)`: torques with limits 97.6, 186.4, 89.4, 24.2, 20.1 and 21.3 N m.

    ## Observation space

    `Box(-1e6, 1e6, (42,), float64)` in rad, rad/s and rad/s^2.

    ## Reward

    Weights 1, 0.1 and 0.001; 1000 less at termination.

    ## Starting state

    At rest, 0.1 rad off the reference in every joint.

    ## Episode end

    Terminated at an error above 1 rad. Truncated at 20 s.

    ## Robots

    Five of six links of "puma560" [1]_ violate the pseudo-inertia condition, yet its mass matrix is positive definite.
    "puma560_measured" [2]_ is physically consistent, without motor inertias.

    ## Options at reset

    `payload` (at the flange), `trajectory`, `initial_error`, `parameters`.

    References
    ----------
    .. [1] P.-T. Sheu, M. W. Walker, 1991.
    .. [2] B. Armstrong, O. Khatib, J. Burdick, "The explicit dynamic model and inertial parameters of the PUMA 560
       arm", 1986.

    Examples
    --------
    >>> import gymnasium
    >>> gymnasium.make("adaptctl.envs:adaptctl/Puma560Tracking-v0").observation_space.shape
    (42,)
    """

    def __init__(
        self,
        robot: str | Path | Mechanism = "puma560",
        reference: Trajectory = PUMA560_REFERENCE,
        *,
        initial_error: Any = 0.1,
        **settings: Any,
    ) -> None:
        with warnings.catch_warnings():
            if robot == "puma560":
                warnings.simplefilter("ignore", PhysicalConsistencyWarning)
            mechanism = robot if isinstance(robot, Mechanism) else load(robot)
        super().__init__(mechanism, reference, initial_error=initial_error, **settings)


FIVE_BAR_REFERENCE = Sinusoids(
    center=np.array([0.0, -0.5 * np.pi, -np.pi]),
    amplitude=np.array([0.6, 0.4, 0.4]),
    frequency=np.array([0.15, 0.2, 0.25]),
    start_time=2.0,
)
"""p2 - p3 stays between 0.77 and 2.37 rad."""


class SemiDirectDriveTrackingEnv(TrackingEnv):
    """
    Tracking task of a semi-direct-drive arm, a five-bar linkage behind a vertical axis.

    Parameters
    ----------
    robot : str, Path or Mechanism, default "semi_direct_drive"
        Robot; "semi_direct_drive_parallelogram" has equal opposite sides. Lengths and inertias are assigned, as the
        papers print none.
    reference : Reference, int, "random" or None, optional
        Trajectory. Default: sinusoids about (0, -pi/2, -pi) rad of amplitudes (0.6, 0.4, 0.4) rad and frequencies
        (0.15, 0.2, 0.25) Hz, faded in from rest over 2 s.
    initial_error : array_like, default 0.1
        Error of the positions at the start in rad, one number or (3,). 0.1 is to be corrected first, a tenth of the
        bound.
    **settings : object
        Other arguments of `TrackingEnv`.

    Raises
    ------
    InputError
        If a robot of other than three joints has no `reference` of its own; also the errors of `TrackingEnv`.

    Notes
    -----
    The arm is that of [1]_. All else is as in `Puma560TrackingEnv`.

    ## Action space

    `Box(-limit, limit, (3,), float64)`: torques of vertical axis, upper arm and crank; limits 660, 230 and 230 N m.

    ## Observation space

    `Box(-1e6, 1e6, (21,), float64)` in rad, rad/s and rad/s^2, of the driven joints.

    ## Episode end

    Terminated at an error above 1 rad, near a singularity, or when the upper arm's position less the crank's leaves
    0.5236 to 2.618 rad [2]_. Truncated at 20 s.

    References
    ----------
    .. [1] H. Asada, K. Youcef-Toumi, 1983.
    .. [2] P.-T. Sheu, M. W. Walker, 1991, Table 9.

    Examples
    --------
    >>> import gymnasium, adaptctl.envs
    >>> gymnasium.spec("adaptctl/SemiDirectDriveTracking-v0").entry_point
    'adaptctl.envs.built_in:SemiDirectDriveTrackingEnv'
    """

    def __init__(
        self,
        robot: str | Path | Mechanism = "semi_direct_drive",
        reference: Trajectory = FIVE_BAR_REFERENCE,
        *,
        initial_error: Any = 0.1,
        **settings: Any,
    ) -> None:
        super().__init__(robot, reference, initial_error=initial_error, **settings)
