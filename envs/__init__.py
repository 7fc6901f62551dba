"""Gymnasium environments, registered on import."""

from gymnasium.envs.registration import register

from adaptctl.envs.baselines import baselines
from adaptctl.envs.built_in import Puma560TrackingEnv, SemiDirectDriveTrackingEnv
from adaptctl.envs.contact import ContactEnv
from adaptctl.envs.controlled import ResidualEnv, ResidualVectorEnv
from adaptctl.envs.gain_tuning import TuningEnv, TuningVectorEnv
from adaptctl.envs.learning import LearningEnv, LearningVectorEnv
from adaptctl.envs.live import LiveView
from adaptctl.envs.many.vector_tracking import (
    Puma560VectorTrackingEnv,
    SemiDirectDriveVectorTrackingEnv,
    VectorTrackingEnv,
)
from adaptctl.envs.minari_set import write_minari
from adaptctl.envs.mujoco_tracking import MuJoCoTrackingEnv
from adaptctl.envs.random_reference import random_sinusoids
from adaptctl.envs.task import RewardWeights
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.envs.video import VideoRecorder
from adaptctl.simulation.effects import Payload

__all__ = [
    "ContactEnv",
    "LearningEnv",
    "LearningVectorEnv",
    "LiveView",
    "MuJoCoTrackingEnv",
    "Payload",
    "Puma560TrackingEnv",
    "Puma560VectorTrackingEnv",
    "ResidualEnv",
    "ResidualVectorEnv",
    "RewardWeights",
    "SemiDirectDriveTrackingEnv",
    "SemiDirectDriveVectorTrackingEnv",
    "TrackingEnv",
    "TuningEnv",
    "TuningVectorEnv",
    "VectorTrackingEnv",
    "VideoRecorder",
    "baselines",
    "random_sinusoids",
    "write_minari",
]

# The environments check actions and the order of calls themselves, so the wrappers that do are left out: at
# a step of some 20 microseconds they would cost more than the physics.
# Thresholds are returns of Slotine and Li's law from zero estimates (see `baselines`), where the task is one.
for _id, _kind, _module, _threshold in (
    ("adaptctl/Puma560Tracking-v0", "Puma560", "built_in", -30.9),
    ("adaptctl/SemiDirectDriveTracking-v0", "SemiDirectDrive", "built_in", -14.3),
    ("adaptctl/Tracking-v0", "", "tracking", None),
):
    register(
        _id,
        f"adaptctl.envs.{_module}:{_kind}TrackingEnv",
        vector_entry_point=f"adaptctl.envs.many.vector_tracking:{_kind}VectorTrackingEnv",
        reward_threshold=_threshold,
        order_enforce=False,
        disable_env_checker=True,
    )

for _id, _place in (
    ("adaptctl/MuJoCoTracking-v0", "mujoco_tracking:MuJoCoTrackingEnv"),
    ("adaptctl/Contact-v0", "contact:ContactEnv"),
):
    register(_id, f"adaptctl.envs.{_place}", order_enforce=False, disable_env_checker=True)

for _id, _name, _threshold in (
    ("adaptctl/Puma560Learning-v0", "puma560_learning", -2.5),
    ("adaptctl/Learning-v0", "learning", None),
):
    register(
        _id,
        f"adaptctl.envs.learning:{_name}",
        vector_entry_point=f"adaptctl.envs.learning:many_{_name}",
        reward_threshold=_threshold,
        order_enforce=False,
        disable_env_checker=True,
    )
