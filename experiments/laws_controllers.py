"""Adaptation laws and control laws by name, for the experiment that sets them side by side."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from adaptctl import control
from adaptctl.arrays import Array
from adaptctl.control import Controller, Gradient, SlotineLi
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.contest import ADAPTATION_OFF
from adaptctl.experiments.disturbed_arm import DisturbedArm
from adaptctl.experiments.laws_measures import deviations
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis

BOUNDS = 4.0
"""deviations of the rough model to which `Projection` keeps"""


def first_estimate(of: DisturbedArm, model: ReducedModel) -> Array:
    """Initial estimate (k,) of a `model`'s k parameters: that of the rough model, and zero for friction."""
    estimate = np.array(model.regrouping @ of.rough(model.mechanism))
    estimate[[k for k, _ in friction_columns(model)]] = 0.0
    return estimate


def unknown(of: DisturbedArm, model: ReducedModel) -> Array:
    """Standard deviations (k,) of a `model`'s k parameters: of a rough model's links and rotors, of a payload like the
    one that comes, and the prior ranges of friction."""
    mechanism = model.mechanism
    found = deviations(model, of.rough(mechanism), of.parameter_error)
    if of.recovers:
        nothing = np.zeros(len(mechanism.parameter_names))
        loaded = of.body().added_to(nothing, len(mechanism.description.bodies) - 1)
        found = np.hypot(found, deviations(model, loaded, 1.0))
    for k, joint in friction_columns(model):
        found[k] = of.friction_range * finite_torque_limits(mechanism)[joint]
    return found


def controller(of: DisturbedArm, name: str, model: ReducedModel) -> Controller[Any]:
    """Controller of that `name` with the settings of the experiment `of`, on the `model` or on what it takes instead;
    behind guards where motors are weak. Raises `GainError` for gains too large for the control period."""
    found = _unguarded(of, name, model)
    if not of.is_weak:
        return found
    return control.Guarded(
        replace(found, torque_limits=np.inf) if isinstance(found, SlotineLi) else found,
        of.motors(model.mechanism),
        of.rate_limit or np.inf,
        stop_damping=of.gains(model.mechanism).damping,
        freeze=name != "never-frozen",
    )


def _unguarded(of: DisturbedArm, name: str, model: ReducedModel) -> Controller[Any]:
    mechanism, gains, first = model.mechanism, of.gains(model.mechanism), first_estimate(of, model)
    gain = of.rate * unknown(of, model) ** 2

    def slotine_li(on: ReducedModel, law: Any, estimate: Array) -> SlotineLi:
        own = of.gains(on.mechanism)
        return SlotineLi(on, own.bandwidth, own.damping, law, estimate, of.control_period)

    if name == "natural":
        return slotine_li(ReducedModel.full(mechanism), *_natural(of, mechanism))
    if name == "consistent-lift":
        natural, bodies = _natural(of, mechanism)
        lift = control.ConsistentLift(natural.rate, bodies, _weight(of, model), of.cutoff)
        return slotine_li(model, lift, model.regrouping @ bodies)
    if name == "no-friction-columns":
        smooth = without_friction(mechanism)
        bare = ReducedModel(smooth, fundamental_basis(essential_space(smooth, seed=of.seed)))
        return slotine_li(bare, of.rate * unknown(of, bare) ** 2, first_estimate(of, bare))
    if name == "computed-torque-true":
        return control.ComputedTorque(mechanism, gains.bandwidth)
    if name == "computed-torque-smooth":
        return control.ComputedTorque(without_friction(mechanism), gains.bandwidth)
    if name == "computed-torque":
        return control.ComputedTorque.on(model, gains.bandwidth, parameters=first)
    if name == "pd-gravity":
        return control.PDGravity.on(model, gains.bandwidth * gains.damping, gains.damping, first)
    if name == "passivity-integral":
        return control.PassivityIntegral(model, gains.bandwidth, gains.damping, gain, first, of.control_period)
    if name == "adaptive-computed-torque":
        law = _projected(of, model, of.acceleration_gain * gain, first)
        return control.AdaptiveComputedTorque(model, gains.bandwidth, first, law, period=of.control_period)
    return slotine_li(model, _law(of, name, model, gain, first), first)


def _law(of: DisturbedArm, name: str, model: ReducedModel, gain: Array, first: Array) -> Any:
    """Adaptation law for Slotine and Li's control law; None for adaptation off."""
    predicting = gain, _weight(of, model), of.cutoff
    match name:
        case "composite":
            return control.Composite(*predicting)
        case "gradient-euler":
            return Gradient(gain, theta=0.0, cap=0.0)
        case "sigma-modification":
            return control.SigmaModification(gain, of.leakage, first)
        case "e-modification":
            return control.EModification(gain, of.sliding_leakage, first)
        case "dead-zone":
            return control.DeadZone(gain, np.full(model.mechanism.dof, of.dead_zone))
        case "projection":
            return _projected(of, model, gain, first)
        case "bounded-gain-forgetting":
            return control.BoundedGainForgetting(*predicting, of.forgetting)
        case "cushioned-floor":
            return control.CushionedFloor(*predicting, of.forgetting)
        case "composite-learning":
            return control.CompositeLearning(*predicting, of.forgetting, of.recall, of.excitation, of.alarm)
        case "concurrent-learning":
            return control.ConcurrentLearning(*predicting, of.samples, of.novelty)
    return None if name == ADAPTATION_OFF else Gradient(gain)


def _weight(of: DisturbedArm, model: ReducedModel) -> Array:
    """Weight (r,) of torque prediction errors, 1/(N m s)."""
    return np.asarray(of.prediction / finite_torque_limits(model.mechanism) ** 2)


def _projected(of: DisturbedArm, model: ReducedModel, gain: Array, first: Array) -> control.Projection[Any]:
    reach = BOUNDS * unknown(of, model)
    return control.Projection(Gradient(gain), first - reach, first + reach)


def _natural(of: DisturbedArm, mechanism: Mechanism) -> tuple[control.Natural, Array]:
    """Natural adaptation and its first bodies (P,): the rough model's, with half a payload in the hand, whose rate is
    the greater, the less is known of it."""
    rough, rate = of.rough(mechanism), of.rate * of.parameter_error**2
    if not of.recovers:
        return control.Natural(rate), rough
    last = len(mechanism.description.bodies) - 1
    first = of.body(0.5).added_to(rough, last)
    rates = np.full(len(first) - 9 * (last + 1), float(rate))
    rates[last] = of.rate * (np.hypot(of.parameter_error * rough[10 * last], of.payload) / first[10 * last]) ** 2
    return control.Natural(rates), first


def without_friction(mechanism: Mechanism) -> Mechanism:
    """Mechanism without viscous and Coulomb friction in its joints; rotor inertias stay."""
    return mechanism.with_drives([Drive(link.joint.drive.rotor_inertia) for link in mechanism.links])


def friction_columns(model: ReducedModel) -> Iterator[tuple[int, int]]:
    """Index of each friction parameter among a `model`'s, and of its joint."""
    joints = [joint.name for joint in model.mechanism.primary_joints]
    for k, name in enumerate(model.names):
        owner, _, kind = name.rpartition(".")
        if kind in ("viscous", "coulomb"):
            yield k, joints.index(owner)
