"""The tracking environment of the PUMA 560."""

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

REFERENCE = Sinusoids(
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
        reference: Trajectory = REFERENCE,
        *,
        initial_error: Any = 0.1,
        **settings: Any,
    ) -> None:
        with warnings.catch_warnings():
            if robot == "puma560":
                warnings.simplefilter("ignore", PhysicalConsistencyWarning)
            mechanism = robot if isinstance(robot, Mechanism) else load(robot)
        super().__init__(mechanism, reference, initial_error=initial_error, **settings)
