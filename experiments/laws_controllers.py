"""Controllers of the experiment `laws`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl import control
from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.control import Controller, Gains, Gradient, SlotineLi
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.contest import ADAPTATION_OFF
from adaptctl.experiments.disturbed_arm import DisturbedArm
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis

BOUNDS = 4.0
"""standard deviations of the bounds of `Projection`"""
FRICTION_RANGE = 0.1
"""prior range of Coulomb friction over the torque limit; of viscous friction, at 1 rad/s"""
SLIDING_LEAKAGE = 0.5
"""1/rad, e-modification"""
CUTOFF, RECALL, ALARM = 5.0, 2.0, 0.2
"""rad/s of torque filters; 1/s, rate of composite learning; W missed at which it forgets"""


@dataclass(frozen=True, eq=False)
class Draft:
    """First estimate and gains of a law on a `model`."""

    of: DisturbedArm
    model: ReducedModel

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism of the model."""
        return self.model.mechanism

    @cached_property
    def gains(self) -> Gains:
        """Gains of the tracking loop."""
        return self.of.gains(self.mechanism)

    @cached_property
    def first(self) -> Array:
        """Initial estimate (k,), zero for friction."""
        estimate = np.array(self.model.regrouping @ self.of.rough(self.mechanism))
        estimate[[k for k, _ in friction_columns(self.model)]] = 0.0
        return estimate

    @cached_property
    def unknown(self) -> Array:
        """Standard deviations (k,) of the prior."""
        of, mechanism = self.of, self.mechanism
        found = deviations(self.model, of.rough(mechanism), of.parameter_error)
        if of.recovers:
            nothing = np.zeros(len(mechanism.parameter_names))
            loaded = of.body().added_to(nothing, len(mechanism.description.bodies) - 1)
            found = np.hypot(found, deviations(self.model, loaded, 1.0))
        for k, joint in friction_columns(self.model):
            found[k] = FRICTION_RANGE * finite_torque_limits(mechanism)[joint]
        return found

    @cached_property
    def gain(self) -> Array:
        """Adaptation gain (k,)."""
        return np.asarray(self.of.gain_scale * self.unknown**2)

    @property
    def predicting(self) -> tuple[Array, Array, float]:
        """Gain, weight (r,), 1/(N m s), and filter cutoff, rad/s, for torque prediction errors."""
        return self.gain, self.of.prediction_weight / finite_torque_limits(self.mechanism) ** 2, CUTOFF

    def slotine_li(self, law: Any = None, first: Array | None = None) -> SlotineLi:
        """Slotine and Li's law with an adaptation `law`."""
        start, period = self.first if first is None else first, self.of.control_period
        return SlotineLi(self.model, self.gains.bandwidth, self.gains.damping, law, start, period)

    def projected(self, share: float = 1.0) -> control.Projection[Any]:
        """Gradient law with a `share` of the gain and bounds."""
        reach = BOUNDS * self.unknown
        return control.Projection(Gradient(share * self.gain), self.first - reach, self.first + reach)

    def natural(self) -> tuple[control.Natural, Array]:
        """Natural adaptation and its first bodies (P,), with half a payload."""
        of, rough = self.of, self.of.rough(self.mechanism)
        rate = of.gain_scale * of.parameter_error**2
        if not of.recovers:
            return control.Natural(rate), rough
        last = len(self.mechanism.description.bodies) - 1
        first = of.body(0.5).added_to(rough, last)
        rates = np.full(len(first) - 9 * (last + 1), float(rate))
        rates[last] = (
            of.gain_scale * (np.hypot(of.parameter_error * rough[10 * last], of.payload) / first[10 * last]) ** 2
        )
        return control.Natural(rates), first


def controller(of: DisturbedArm, name: str, model: ReducedModel) -> Controller[Any]:
    """Controller of a name."""
    draft = Draft(of, model)
    found = _control_law(draft, name) or draft.slotine_li(_adaptation_law(draft, name))
    if not of.is_weak:
        return found
    return control.SafetyFilter(
        replace(found, torque_limits=np.inf) if isinstance(found, SlotineLi) else found,
        of.motors(model.mechanism),
        of.torque_rate_limit or np.inf,
        stop_damping=draft.gains.damping,
        freeze=name != "never-frozen",
    )


def _adaptation_law(draft: Draft, name: str) -> Any:
    of, gain, predicting = draft.of, draft.gain, draft.predicting
    match name:
        case "composite":
            return control.Composite(*predicting)
        case "gradient-euler":
            return Gradient(gain, theta=0.0, cap=0.0)
        case "sigma-modification":
            return control.SigmaModification(gain, of.leakage, draft.first)
        case "e-modification":
            return control.EModification(gain, SLIDING_LEAKAGE, draft.first)
        case "dead-zone":
            return control.DeadZone(gain, np.full(draft.mechanism.dof, of.dead_zone))
        case "projection":
            return draft.projected()
        case "bounded-gain-forgetting":
            return control.BoundedGainForgetting(*predicting, of.forgetting)
        case "cushioned-floor":
            return control.CushionedFloor(*predicting, of.forgetting)
        case "composite-learning":
            return control.CompositeLearning(*predicting, of.forgetting, RECALL, of.excitation_threshold, ALARM)
        case "concurrent-learning":
            return control.ConcurrentLearning(*predicting, of.stack_size, of.novelty_threshold)
    return None if name == ADAPTATION_OFF else Gradient(gain)


def _control_law(draft: Draft, name: str) -> Controller[Any] | None:
    """Control law, or None for Slotine and Li's."""
    of, model, mechanism, first = draft.of, draft.model, draft.mechanism, draft.first
    bandwidth, damping = draft.gains.bandwidth, draft.gains.damping
    match name:
        case "natural":
            return replace(draft, model=ReducedModel.full(mechanism)).slotine_li(*draft.natural())
        case "consistent-adaptation":
            natural, bodies = draft.natural()
            lift = control.ConsistentAdaptation(natural.gain, bodies, *draft.predicting[1:])
            return draft.slotine_li(lift, model.regrouping @ bodies)
        case "no-friction-columns":
            smooth = without_friction(mechanism)
            bare = Draft(of, ReducedModel(smooth, fundamental_basis(essential_space(smooth, seed=of.seed))))
            return bare.slotine_li(Gradient(bare.gain))
        case "computed-torque-true":
            return control.ComputedTorque(mechanism, bandwidth)
        case "computed-torque-smooth":
            return control.ComputedTorque(without_friction(mechanism), bandwidth)
        case "computed-torque":
            return control.ComputedTorque.from_model(model, bandwidth, parameters=first)
        case "pd-gravity":
            return control.PDGravity.from_model(model, bandwidth * damping, damping, first)
        case "passivity-integral":
            return control.PassivityIntegral(model, bandwidth, damping, draft.gain, first, of.control_period)
        case "adaptive-computed-torque":
            law = draft.projected(of.acceleration_gain)
            return control.AdaptiveComputedTorque(model, bandwidth, first, law, control_period=of.control_period)
    return None


def deviations(model: ReducedModel, parameters: ArrayLike, share: float) -> Array:
    """Standard deviations (k,) at a relative error."""
    values, bodies = np.asarray(parameters, dtype=np.float64), len(model.mechanism.description.bodies)
    sizes = np.abs(values)
    for i in range(0, 10 * bodies, 10):
        matrix = pseudo_inertia(values[i : i + 10])
        mass, second = float(matrix[3, 3]), float(np.trace(matrix[:3, :3]))
        sizes[i : i + 10] = [mass, *[np.sqrt(mass * second)] * 3, *[second] * 6]
    return share * np.sqrt(model.regrouping**2 @ sizes**2)


def without_friction(mechanism: Mechanism) -> Mechanism:
    """Mechanism without joint friction; rotor inertias stay."""
    return mechanism.with_drives([Drive(link.joint.drive.rotor_inertia) for link in mechanism.links])


def friction_columns(model: ReducedModel) -> Iterator[tuple[int, int]]:
    """Indices of each friction parameter and its joint."""
    joints = [joint.name for joint in model.mechanism.primary_joints]
    for k, name in enumerate(model.names):
        owner, _, kind = name.rpartition(".")
        if kind in ("viscous", "coulomb"):
            yield k, joints.index(owner)
