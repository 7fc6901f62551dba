"""Tracking environments of two built-in arms: the PUMA 560, and the semi-direct-drive arm."""

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
"""Every joint at least 0.4 rad at 0.1 Hz and above, within the joint limits, from rest."""


class Puma560TrackingEnv(TrackingEnv):
    """
    Tracking task of the PUMA 560, six revolute joints that follow sinusoids.

    Parameters
    ----------
    robot : str, Path or Mechanism, default "puma560"
        Robot, see Robots.
    reference : Reference, int, "random" or None, optional
        Trajectory. Default: sinusoids about (0, -0.6, 0.8, 0, 0.5, 0) rad of amplitudes (0.5, 0.4, 0.4, 0.4, 0.4, 0.4)
        rad and frequencies (0.1, 0.125, 0.15, 0.175, 0.2, 0.225) Hz, faded in from rest over 2 s.
    initial_error : array_like, default 0.1
        Error of the positions at the start in rad.
    **settings : object
        Other arguments of `TrackingEnv`.

    Raises
    ------
    InputError
        If a robot of other than six joints has no `reference` of its own; also the errors of `TrackingEnv`.

    Notes
    -----
    Reward, information and all else are as in `TrackingEnv`, whose card holds here too.

    ## Action space

    `Box(-limit, limit, (6,), float64)`, torques in N m; others are clipped.

    | Num | Joint    | Limit |
    |-----|----------|-------|
    | 0   | waist    | 97.6  |
    | 1   | shoulder | 186.4 |
    | 2   | elbow    | 89.4  |
    | 3   | wrist    | 24.2  |
    | 4   | wrist    | 20.1  |
    | 5   | flange   | 21.3  |

    ## Observation space

    `Box(-1e6, 1e6, (42,), float64)` in rad, rad/s and rad/s^2; `observation_slices` has slices by name.

    | Num   | Observation                                       |
    |-------|---------------------------------------------------|
    | 0-5   | positions                                         |
    | 6-11  | velocities                                        |
    | 12-17 | the reference's positions now                     |
    | 18-23 | the reference's velocities now                    |
    | 24-29 | the reference's accelerations now                 |
    | 30-35 | the reference's positions 0.05 s ahead            |
    | 36-41 | the reference's positions 0.2 s ahead             |

    ## Reward

    *reward = -(sum(e^2) + 0.1 sum(e'^2) + 0.001 sum((applied torque / limit)^2))*, and 1000 less when terminated.

    ## Starting state

    On the reference at time zero, at rest, 0.1 rad off in every joint.

    ## Episode end

    Terminated when a joint's error passes 1 rad. Truncated at 20 s, which is 20,000 steps.

    ## Robots

    "puma560" has the inertial parameters of Sheu and Walker [1]_, Table 6. No rigid bodies have them (five of six links
    violate the pseudo-inertia condition), yet the mass matrix is positive definite (eigenvalues above 0.06 kg m^2 in
    2,000 random configurations); loading them here does not warn. "puma560_measured" has consistent values [2]_ without
    motor inertias: choose it when the physics matter.

    ## Options at reset

    Those of `TrackingEnv`: `payload` (at the flange), `trajectory`, `initial_error` and `parameters`.

    ## Version history

    * v0: first version

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
"""Every joint at least 0.4 rad at 0.15 Hz and above, from rest; p2 - p3 stays between 0.77 and 2.37 rad."""


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
        Error of the positions at the start in rad.
    **settings : object
        Other arguments of `TrackingEnv`.

    Raises
    ------
    InputError
        If a robot of other than three joints has no `reference` of its own; also the errors of `TrackingEnv`.

    Notes
    -----
    The arm is that of Asada and Youcef-Toumi [1]_. Its loop is closed to round-off after every step. Reward,
    information and all else are as in `TrackingEnv`, whose card holds here too.

    ## Action space

    `Box(-limit, limit, (3,), float64)`, torques in N m; others are clipped.

    | Num | Joint                         | Limit |
    |-----|-------------------------------|-------|
    | 0   | the vertical axis             | 660   |
    | 1   | upper arm (link 2), on link 1 | 230   |
    | 2   | crank (link 3), on link 1     | 230   |

    ## Observation space

    `Box(-1e6, 1e6, (21,), float64)` in rad, rad/s and rad/s^2; `observation_slices` has slices by name.

    | Num   | Observation                                       |
    |-------|---------------------------------------------------|
    | 0-2   | positions of the driven joints                    |
    | 3-5   | velocities of the driven joints                   |
    | 6-8   | the reference's positions now                     |
    | 9-11  | the reference's velocities now                    |
    | 12-14 | the reference's accelerations now                 |
    | 15-17 | the reference's positions 0.05 s ahead            |
    | 18-20 | the reference's positions 0.2 s ahead             |

    ## Reward

    *reward = -(sum(e^2) + 0.1 sum(e'^2) + 0.001 sum((applied torque / limit)^2))*, and 1000 less when terminated.

    ## Starting state

    On the reference at time zero, at rest, 0.1 rad off in every joint.

    ## Episode end

    Terminated when a joint's error passes 1 rad, when the upper arm's position less the crank's leaves 0.5236 to 2.618
    rad [2]_, or near a singularity of the loop. Truncated at 20 s, which is 20,000 steps.

    ## Options at reset

    Those of `TrackingEnv`: `payload` (fixed to the last link), `trajectory`, `initial_error` and `parameters`.

    ## Version history

    * v0: first version

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
