"""Gymnasium environments. Importing this registers them, which is Gymnasium's way."""

from gymnasium.envs.registration import register

from adaptctl.envs.puma560 import Puma560TrackingEnv
from adaptctl.envs.random_reference import random_sinusoids
from adaptctl.envs.reward import RewardWeights
from adaptctl.envs.semi_direct_drive import SemiDirectDriveTrackingEnv
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.simulation.effects import Payload

__all__ = [
    "Payload",
    "Puma560TrackingEnv",
    "RewardWeights",
    "SemiDirectDriveTrackingEnv",
    "TrackingEnv",
    "random_sinusoids",
]

# The environments check actions and the order of calls themselves, so the wrappers that do are left out: at
# a step of some 20 microseconds they would cost more than the physics.
for _id, _entry_point in (
    ("adaptctl/Puma560Tracking-v0", "adaptctl.envs.puma560:Puma560TrackingEnv"),
    ("adaptctl/SemiDirectDriveTracking-v0", "adaptctl.envs.semi_direct_drive:SemiDirectDriveTrackingEnv"),
    ("adaptctl/Tracking-v0", "adaptctl.envs.tracking:TrackingEnv"),
):
    register(_id, _entry_point, order_enforce=False, disable_env_checker=True)
