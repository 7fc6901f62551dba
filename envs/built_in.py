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
    ## Description

    A tracking environment: the PUMA 560, six revolute joints, is to follow sinusoids in all of them: center (0, -0.6,
    0.8, 0, 0.5, 0) rad, amplitudes (0.5, 0.4, 0.4, 0.4, 0.4, 0.4) rad, frequencies (0.1, 0.125, 0.15, 0.175, 0.2,
    0.225) Hz, faded in from rest over 2 s. It starts 0.1 rad off in every joint. Everything else is as in
    `TrackingEnv`, whose card holds here too.

    ```python
    import gymnasium
    env = gymnasium.make("adaptctl.envs:adaptctl/Puma560Tracking-v0")
    ```

    ## Action space

    `Box(-limit, limit, (6,), float64)`, torques in N m, as are the limits; others are clipped.

    | Num | Joint    | Limit |
    |-----|----------|-------|
    | 0   | waist    | 97.6  |
    | 1   | shoulder | 186.4 |
    | 2   | elbow    | 89.4  |
    | 3   | wrist    | 24.2  |
    | 4   | wrist    | 20.1  |
    | 5   | flange   | 21.3  |

    ## Observation space

    `Box(-1e6, 1e6, (42,), float64)`: positions in rad, velocities in rad/s, accelerations in rad/s^2;
    `observation_slices` has slices by name.

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

    *r = -(sum(e^2) + 0.1 sum(e'^2) + 0.001 sum((applied torque / limit)^2))*, no unit, with the errors e of positions
    (rad) and e' of velocities (rad/s), and 1000 less when terminated.

    ## Starting state

    On the reference at time zero, at rest, `initial_error` = 0.1 rad off in every joint.

    ## Episode end

    Terminated when a joint's error passes 1 rad. Truncated at 20 s, which is 20,000 steps.

    ## Arguments

    Those of `TrackingEnv`, and its errors. `robot="puma560"` has the inertial parameters of Sheu and Walker (1991),
    Table 6. No rigid bodies have them (five of six links violate the pseudo-inertia condition), yet the mass matrix
    they give is positive definite (eigenvalues above 0.06 kg m^2 in 2,000 random configurations), so the motion is well
    defined. Because this is stated here, loading them for this environment does not warn. `robot="puma560_measured"`
    has consistent values measured by Armstrong, Khatib and Burdick (1986), without motor inertias: choose it when the
    physics matter. Another number of joints than six needs a `reference` of its own, else `InputError` is raised.

    ## Options at reset

    Those of `TrackingEnv`: `payload` (kg), fixed at the origin of the last link's frame, the flange, `trajectory`,
    `initial_error` (rad) and `parameters` (P,), the P true inertial and friction parameters, in SI units and the order
    of `Mechanism.parameter_names`.

    ## Version history

    * v0: first version
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
    ## Description

    A tracking environment: the semi-direct-drive arm of Asada and Youcef-Toumi (1983), a five-bar linkage behind a
    vertical axis, is to follow sinusoids in its three driven joints: center (0, -pi/2, -pi) rad, amplitudes (0.6, 0.4,
    0.4) rad, frequencies (0.15, 0.2, 0.25) Hz, faded in from rest over 2 s. It starts 0.1 rad off in every joint. The
    loop is closed to round-off after every step. Everything else is as in `TrackingEnv`, whose card holds here too.

    ```python
    import gymnasium
    env = gymnasium.make("adaptctl.envs:adaptctl/SemiDirectDriveTracking-v0")
    ```

    ## Action space

    `Box(-limit, limit, (3,), float64)`, torques in N m, as are the limits; others are clipped.

    | Num | Joint                         | Limit |
    |-----|-------------------------------|-------|
    | 0   | the vertical axis             | 660   |
    | 1   | upper arm (link 2), on link 1 | 230   |
    | 2   | crank (link 3), on link 1     | 230   |

    ## Observation space

    `Box(-1e6, 1e6, (21,), float64)`: positions in rad, velocities in rad/s, accelerations in rad/s^2;
    `observation_slices` has slices by name.

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

    *reward = -(sum(e^2) + 0.1 sum(e'^2) + 0.001 sum((applied torque / limit)^2))*, no unit, with the errors e of
    positions (rad) and e' of velocities (rad/s), and 1000 less when terminated.

    ## Starting state

    On the reference at time zero, at rest, `initial_error` = 0.1 rad off in every joint.

    ## Episode end

    Terminated when a joint's error passes 1 rad, when the upper arm's position less the crank's leaves 0.5236 to 2.618
    rad (Sheu and Walker 1991, Table 9), or near a singularity of the loop. Truncated at 20 s, which is 20,000 steps.

    ## Arguments

    Those of `TrackingEnv`: `robot`, `reference` (the sinusoids above), `duration` (20 s), `control_period` (0.001 s),
    `substeps`, `integrator`, `look_ahead` (0.05 and 0.2 s), `error_bound` (1 rad), `reward_weights`, `initial_error`
    (0.1 rad), `torque_limits` (N m), `effects`, `render_mode`. Lengths and inertias are assigned (the papers print
    none): `robot="semi_direct_drive"` has generic lengths, `"semi_direct_drive_parallelogram"` equal opposite sides.
    A robot of another number of joints than three needs a `reference` of its own. Raises `InputError` for bad values,
    `NotFoundError` for an unknown built-in or mode, `FileError` for a bad file.

    ## Options at reset

    Those of `TrackingEnv`: `payload` (kg, fixed to the last link), `trajectory` (a reference, a seed or `"random"`),
    `initial_error` (rad), `parameters` (P,), the P true inertial and friction ones, in SI units and the order of
    `Mechanism.parameter_names`.

    ## Version history

    * v0: first version
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
