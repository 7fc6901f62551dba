"""Effects: what real plants have besides rigid links, each a part that can be switched on."""

from adaptctl.simulation.effects.actuator_lag import ActuatorLag
from adaptctl.simulation.effects.control_delay import ControlDelay
from adaptctl.simulation.effects.effect import ActuatorEffect, Effect, JointEffect, LoadEffect, SensorEffect
from adaptctl.simulation.effects.elastic_joints import ElasticJoints
from adaptctl.simulation.effects.encoder import Encoder
from adaptctl.simulation.effects.filtered_differences import FilteredDifferences
from adaptctl.simulation.effects.friction import Friction
from adaptctl.simulation.effects.payload import Payload
from adaptctl.simulation.effects.payload_held import PayloadHeld
from adaptctl.simulation.effects.plant_effects import PlantEffects
from adaptctl.simulation.effects.torque_limit import TorqueLimit
from adaptctl.simulation.effects.torque_rate_limit import TorqueRateLimit

__all__ = [
    "ActuatorEffect",
    "ActuatorLag",
    "ControlDelay",
    "Effect",
    "ElasticJoints",
    "Encoder",
    "FilteredDifferences",
    "Friction",
    "JointEffect",
    "LoadEffect",
    "Payload",
    "PayloadHeld",
    "PlantEffects",
    "SensorEffect",
    "TorqueLimit",
    "TorqueRateLimit",
]
