"""Adaptation laws and control laws by name, from one rough model and with one gain, for the experiment `laws`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl import control
from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.control import Controller, Gradient, SlotineLi
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.contest import ADAPTATION_OFF
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis

if TYPE_CHECKING:
    from adaptctl.experiments.laws import Laws

BOUNDS = 4.0
"""deviations of the rough model to which `Projection` keeps"""
FRICTION_RANGE = 0.1
"""prior range of Coulomb friction over the torque limit; of viscous friction, at 1 rad/s"""
SLIDING_LEAKAGE = 0.5
"""1/rad: that of e-modification"""
CUTOFF, RECALL, ALARM = 5.0, 2.0, 0.2
"""rad/s of torque filters; 1/s, how fast composite learning returns to its memory; W missed at which it forgets it"""


@dataclass(frozen=True, eq=False)
class Draft:
    """Draft of a law of the comparison `of` on a `model`: the rough model's first estimate, and gains."""

    of: Laws
    model: ReducedModel

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism of the model."""
        return self.model.mechanism

    @cached_property
    def first(self) -> Array:
        """Initial estimate (k,): that of the rough model, and zero for friction."""
        estimate = np.array(self.model.regrouping @ self.of.rough(self.mechanism))
        estimate[[k for k, _ in friction_columns(self.model)]] = 0.0
        return estimate

    @cached_property
    def unknown(self) -> Array:
        """Standard deviations (k,): of a rough model's links and rotors, of a payload like the one that comes, and the
        prior ranges of friction."""
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
        """Adaptation gain (k,) of all laws that have one."""
        return np.asarray(self.of.rate * self.unknown**2)

    @property
    def predicting(self) -> tuple[Array, Array, float]:
        """Gain, weight (r,) of torque prediction errors, 1/(N m s), and cutoff of the torque filter, rad/s."""
        return self.gain, self.of.prediction / finite_torque_limits(self.mechanism) ** 2, CUTOFF

    def slotine_li(self, law: Any = None, first: Array | None = None) -> SlotineLi:
        """Slotine and Li's control law with an adaptation `law`, None for none, from the `first` estimate."""
        gains, start = self.of.gains(self.mechanism), self.first if first is None else first
        return SlotineLi(self.model, gains.bandwidth, gains.damping, law, start, self.of.control_period)

    def projected(self, share: float = 1.0) -> control.Projection[Any]:
        """The gradient with a `share` of the gain, kept within bounds."""
        reach = BOUNDS * self.unknown
        return control.Projection(Gradient(share * self.gain), self.first - reach, self.first + reach)

    def natural(self) -> tuple[control.Natural, Array]:
        """Natural adaptation and its first bodies (P,): the rough model's, with half a payload in the hand, whose rate
        is the greater, the less is known of it."""
        of, rough = self.of, self.of.rough(self.mechanism)
        rate = of.rate * of.parameter_error**2
        if not of.recovers:
            return control.Natural(rate), rough
        last = len(self.mechanism.description.bodies) - 1
        first = of.body(0.5).added_to(rough, last)
        rates = np.full(len(first) - 9 * (last + 1), float(rate))
        rates[last] = of.rate * (np.hypot(of.parameter_error * rough[10 * last], of.payload) / first[10 * last]) ** 2
        return control.Natural(rates), first


def _lift(draft: Draft) -> SlotineLi:
    (natural, bodies), (_, weight, cutoff) = draft.natural(), draft.predicting
    return draft.slotine_li(
        control.ConsistentLift(natural.rate, bodies, weight, cutoff), draft.model.regrouping @ bodies
    )


def _remembering(draft: Draft) -> SlotineLi:
    of = draft.of
    return draft.slotine_li(control.CompositeLearning(*draft.predicting, of.forgetting, RECALL, of.excitation, ALARM))


def _accelerating(draft: Draft) -> Controller[Any]:
    law, gains = draft.projected(draft.of.acceleration_gain), draft.of.gains(draft.mechanism)
    return control.AdaptiveComputedTorque(
        draft.model, gains.bandwidth, draft.first, law, period=draft.of.control_period
    )


def _integrating(draft: Draft) -> Controller[Any]:
    gains, period = draft.of.gains(draft.mechanism), draft.of.control_period
    return control.PassivityIntegral(draft.model, gains.bandwidth, gains.damping, draft.gain, draft.first, period)


def _pd_gravity(draft: Draft) -> Controller[Any]:
    gains = draft.of.gains(draft.mechanism)
    return control.PDGravity.on(draft.model, gains.bandwidth * gains.damping, gains.damping, draft.first)


def _computed_torque(draft: Draft, model: Mechanism | None = None) -> Controller[Any]:
    """Computed torque with the rough model, or with all that a mechanism knows."""
    bandwidth = draft.of.gains(draft.mechanism).bandwidth
    if model is None:
        return control.ComputedTorque.on(draft.model, bandwidth, parameters=draft.first)
    return control.ComputedTorque(model, bandwidth)


def _without_columns(draft: Draft) -> SlotineLi:
    smooth = without_friction(draft.mechanism)
    basis = fundamental_basis(essential_space(smooth, seed=draft.of.seed))
    bare = Draft(draft.of, ReducedModel(smooth, basis))
    return bare.slotine_li(Gradient(bare.gain))


Made = Callable[[Draft], Controller[Any]]
NAMED: dict[str, tuple[str, Made]] = {
    "composite": ("Composite", lambda d: d.slotine_li(control.Composite(*d.predicting))),
    "gradient": ("Gradient", lambda d: d.slotine_li(Gradient(d.gain))),
    "sigma-modification": (
        "σ-modification",
        lambda d: d.slotine_li(control.SigmaModification(d.gain, d.of.leakage, d.first)),
    ),
    "e-modification": (
        "e-modification",
        lambda d: d.slotine_li(control.EModification(d.gain, SLIDING_LEAKAGE, d.first)),
    ),
    "dead-zone": (
        "Dead zone",
        lambda d: d.slotine_li(control.DeadZone(d.gain, np.full(d.mechanism.dof, d.of.dead_zone))),
    ),
    "projection": ("Projection", lambda d: d.slotine_li(d.projected())),
    "bounded-gain-forgetting": (
        "Least squares, bounded gain",
        lambda d: d.slotine_li(control.BoundedGainForgetting(*d.predicting, d.of.forgetting)),
    ),
    "cushioned-floor": (
        "Least squares, floor",
        lambda d: d.slotine_li(control.CushionedFloor(*d.predicting, d.of.forgetting)),
    ),
    "composite-learning": ("Composite learning", _remembering),
    "concurrent-learning": (
        "Concurrent learning",
        lambda d: d.slotine_li(control.ConcurrentLearning(*d.predicting, d.of.samples, d.of.novelty)),
    ),
    "natural": (
        "Natural, full parameters",
        lambda d: replace(d, model=ReducedModel.full(d.mechanism)).slotine_li(*d.natural()),
    ),
    "consistent-lift": ("Consistent lift", _lift),
    "adaptive-computed-torque": ("Adaptive computed torque", _accelerating),
    "passivity-integral": ("Integral action, gradient", _integrating),
    "computed-torque": ("Computed torque, rough model", _computed_torque),
    "pd-gravity": ("PD with rough gravity", _pd_gravity),
    "gradient-euler": ("Gradient, Euler", lambda d: d.slotine_li(Gradient(d.gain, theta=0.0, cap=0.0))),
    "never-frozen": ("Never frozen", lambda d: d.slotine_li(Gradient(d.gain))),
    "no-friction-columns": ("No friction columns", _without_columns),
    "computed-torque-true": ("Computed torque, true drives", lambda d: _computed_torque(d, d.mechanism)),
    "computed-torque-smooth": (
        "Computed torque, no friction",
        lambda d: _computed_torque(d, without_friction(d.mechanism)),
    ),
    ADAPTATION_OFF: ("Adaptation off", Draft.slotine_li),
}
"""Labels of laws, and how each is made."""
LABELS = {name: label for name, (label, _) in NAMED.items()}
LAWS, OTHERS = tuple(NAMED)[:16], tuple(NAMED)[16:-1]
"""Laws that run by default, and others, which show what these are better than."""


def controller(of: Laws, name: str, model: ReducedModel) -> Controller[Any]:
    """Controller of that `name` with the settings of the experiment `of`, on the `model` or on what it takes instead;
    behind guards where motors are weak. Raises `GainError` for gains too large for the control period."""
    found = NAMED[name][1](Draft(of, model))
    if not of.is_weak:
        return found
    return control.Guarded(
        replace(found, torque_limits=np.inf) if isinstance(found, SlotineLi) else found,
        of.motors(model.mechanism),
        of.rate_limit or np.inf,
        stop_damping=of.gains(model.mechanism).damping,
        freeze=name != "never-frozen",
    )


def deviations(model: ReducedModel, parameters: ArrayLike, share: float) -> Array:
    """Standard deviations (k,) of a model's k parameters, SI units, where those of every link and drive are off by the
    fraction `share` of their size, independently. `parameters` (P,) are all P, SI units, a link's as m, mc_x, ...,
    I_zz; with its pseudo-inertia's mass m and second moment t, the sizes are m, sqrt(m t) and t."""
    values, bodies = np.asarray(parameters, dtype=np.float64), len(model.mechanism.description.bodies)
    sizes = np.abs(values)
    for i in range(0, 10 * bodies, 10):
        matrix = pseudo_inertia(values[i : i + 10])
        mass, second = float(matrix[3, 3]), float(np.trace(matrix[:3, :3]))
        sizes[i : i + 10] = [mass, *[np.sqrt(mass * second)] * 3, *[second] * 6]
    return share * np.sqrt(model.regrouping**2 @ sizes**2)


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
