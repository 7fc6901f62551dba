"""Settings, plant, reference and gains of a disturbed arm."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains, Reference, Sinusoids, StoppedReference, excitation_trajectory, typical_inertia
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NotFoundError, suggested_name
from adaptctl.experiments.contest import FromFile, chosen_gains, listed
from adaptctl.experiments.experiment import DIVERGENCE_ERROR, setting
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import Failure, Setting
from adaptctl.tuning.verification import scaled_links

if TYPE_CHECKING:
    from adaptctl.simulation.effects import Effect, Payload

CENTER, AMPLITUDES, SINGLE = Puma560Adaptive.center, Puma560Adaptive.amplitude, Puma560Adaptive.frequency
"""rad and Hz of its sinusoids: elbow bent"""
FREQUENCIES = (0.15, 0.3, 0.55, 0.85, 1.2)
"""Hz, each drawn 20 % up or down for every joint, with amplitudes as 1/sqrt(frequency)"""
SAMPLES = 400
"""sampled states of a reference"""
WINDOW = 2.0
"""s over which errors are averaged"""
DAMPING_FACTOR, DAMPING_RATIO, STRIBECK_SPEED = 2.0, 0.05, 0.1
"""damping over bandwidth times typical inertia; damping ratio of springs; rad/s at which the Stribeck excess is half"""
RANDOM, EXCITING, SINGLES, REST = MOTIONS = ("random", "exciting", "single", "rest")
FILE: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("disturbances.toml").read_text("utf-8"))
LABELS: dict[str, str] = FILE["labels"]
LAWS, OTHERS = tuple(LABELS)[:16], tuple(LABELS)[16:-1]
"""Default laws, and others."""
DISTURBANCES: dict[str, dict[str, Any]] = {
    name: {key: tuple(value) if isinstance(value, list) else value for key, value in chosen.items()}
    for name, chosen in FILE["settings"].items()
}
"""Default settings of each disturbance."""


@dataclass(frozen=True, kw_only=True)
class DisturbedArm(FromFile):
    """Base class of experiments on a roughly known arm with disturbances."""

    disturbance: str = setting("none", f"preset of the settings below for a disturbance: {', '.join(DISTURBANCES)}")
    laws: tuple[str, ...] = setting(LAWS, f"laws to run, the subject first; others: {', '.join(OTHERS)}")
    robot: str = setting("puma560_geared", "a built-in robot or a file with physically consistent links")
    duration: float = setting(20.0, "duration of every run, s", low=0.01, high=1000.0)
    bandwidth: float = setting(8.0, "bandwidth, the decay rate of errors, 1/s", symbol="Λ", low=0.1, high=2000.0)
    gain_scale: float = setting(
        5.0,
        "adaptation gain of each parameter divided by the variance of its prior, 1/J",
        symbol="Γ",
        low=1e-6,
        high=1e6,
    )
    parameter_error: float = setting(
        0.5, "relative error of the links' inertias in the rough model", low=0.01, high=0.9
    )
    initial_error: float = setting(0.0, "initial error of every joint, rad or m", low=-1.0, high=1.0)

    motion: str = setting(
        RANDOM,
        f"{RANDOM}: five random sinusoids per joint; {EXCITING}: optimised excitation trajectory within the joint "
        f"limits; {SINGLES}: one sinusoid per joint, for six joints; {REST}: none",
    )
    amplitude: float = setting(0.25, f"amplitude of the {RANDOM} term at 0.2 Hz, rad", low=0.0, high=2.0)
    reference_stop: float = setting(0.0, "time at which the motion stops, s; 0 for never", low=0.0, high=300.0)

    payload: float = setting(0.0, "mass of the payload that is picked up and released, kg", low=0.0, high=1e3)
    payload_size: float = setting(0.1, "edge length of the payload, a cube, m", low=0.0, high=10.0)
    payload_offset: float = setting(0.05, "distance of its centre from the flange, m", low=-10.0, high=10.0)
    payload_start: float = setting(10.0, "time of the pickup, s", low=0.0, high=300.0)
    payload_stop: float = setting(25.0, "time of the release, s", low=0.0, high=300.0)
    payload_cycles: int = setting(1, "number of pickups and releases, in equal parts of the run", low=1, high=100)

    torque_limit_scale: float = setting(
        1.0, "torque limits of the motors divided by their nominal ones", low=0.01, high=1.0
    )
    torque_rate_limit: float = setting(0.0, "torque-rate limit, N m/s; 0 for no limit", low=0.0, high=1e9)
    encoder_resolution: float = setting(0.0, "resolution of the joint encoders, rad", low=0.0, high=0.1)
    position_noise: float = setting(
        0.0, "standard deviation of the position noise before quantisation, rad", low=0.0, high=0.1
    )
    velocity_noise: float = setting(0.0, "standard deviation of the velocity noise, rad/s", low=0.0, high=1.0)
    velocity_cutoff: float = setting(
        0.0, "cut-off of filtered differences for velocities, Hz; 0: measured velocities", low=0.0, high=1e4
    )
    delay: int = setting(0, "delay from measurement to torque, in control periods", low=0, high=64)
    drive_time_constant: float = setting(0.0, "time constant of the drives, s; 0 for none", low=0.0, high=1.0)
    stribeck: float = setting(0.0, "Stribeck friction divided by Coulomb friction", low=0.0, high=10.0)
    joint_stiffness: tuple[float, ...] = setting(
        (0.0,), "stiffness of every joint, N m/rad; 0 for rigid joints", low=0.0, high=1e9
    )
    encoder_side: str = setting("link", "position of the encoders: link or motor")
    trial_duration: float = setting(
        3.0, "duration of a trial for the stable bandwidth with elastic joints, s", low=0.05, high=60.0
    )

    leakage: float = setting(
        0.05, "leakage rate of sigma-modification to the rough model, 1/s", symbol="σ", low=1e-6, high=10.0
    )
    dead_zone: float = setting(0.02, "width of the dead zone of the sliding error s, rad/s", low=1e-6, high=10.0)
    prediction_weight: float = setting(
        1e3, "weight of the torque prediction error, normalised by the limits, N m/s", low=1e-6, high=1e9
    )
    forgetting: float = setting(2.0, "forgetting rate of least squares, 1/s", low=0.0, high=100.0)
    excitation_threshold: float = setting(
        5.0, "excitation threshold for samples that composite learning stores, 1/s", low=0.0, high=1e9
    )
    stack_size: int = setting(24, "number of samples in the stack of concurrent learning", low=1, high=64)
    novelty_threshold: float = setting(
        100.0, "novelty threshold for samples that concurrent learning stores, 1/s", low=1e-9, high=1e9
    )
    acceleration_gain: float = setting(
        1.0, "gain of adaptive computed torque divided by that of the other laws", low=1e-6, high=1.0
    )

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.__init__ = DisturbedArm.__init__  # type: ignore[method-assign]  # else a dataclass makes its own

    def __init__(self, **given: Any) -> None:
        asked = given.get("disturbance", "none")
        if asked not in DISTURBANCES:
            raise NotFoundError(f"disturbance: expected one of {', '.join(DISTURBANCES)}, got {asked!r}")
        chosen = {entry.name: entry.default for entry in fields(self)} | DISTURBANCES[asked] | given
        if unknown := chosen.keys() - {entry.name for entry in fields(self)}:
            guess = suggested_name(min(unknown), chosen.keys() - unknown)
            raise TypeError(f"{type(self).__name__} has no setting {min(unknown)!r}{guess}")
        for name, value in chosen.items():
            object.__setattr__(self, name, value)
        self.__post_init__()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.motion not in MOTIONS:
            raise NotFoundError(f"motion: expected {', '.join(MOTIONS)}, got {self.motion!r}")
        for name in self.laws:
            if name not in (*LAWS, *OTHERS):
                hint = "; a law of a file enters `adaptctl contest`" if ".py" in name else ""
                hint = "; several are separated by blanks" if "," in name else hint
                raise NotFoundError(f"laws: unknown law {name!r}{hint}; laws: {', '.join((*LAWS, *OTHERS))}")
        if len(set(self.laws)) < len(self.laws):
            raise InputError(f"laws: expected each at most once, got {', '.join(self.laws)}")
        if 0.0 in self.joint_stiffness and len(self.joint_stiffness) > 1:
            raise InputError("joint_stiffness: expected positive numbers, or only 0 for rigid joints")
        before = WINDOW if self.recovers else 0.0
        if self.payload and not before <= self.payload_start < self.payload_stop <= self.turn:
            part = "" if self.payload_cycles == 1 else f"each of {self.payload_cycles} parts of "
            raise InputError(
                f"payload_start, payload_stop: expected a pickup at {before:g} s or later, and a release "
                f"after it within {part}the {self.duration:g} s of the run, got {self.payload_start:g} and "
                f"{self.payload_stop:g}"
            )

    @property
    def turn(self) -> float:
        """Length (s) of a part of the run, with one pickup and drop."""
        return self.duration / self.payload_cycles

    @property
    def has_springs(self) -> bool:
        """True for elastic joints."""
        return self.joint_stiffness != (0.0,)

    @property
    def is_weak(self) -> bool:
        """True for weak motors."""
        return self.torque_limit_scale < 1.0 or self.torque_rate_limit > 0.0

    @property
    def recovers(self) -> bool:
        """True where laws can recover from a payload."""
        return self.payload > 0.0 and not self.is_weak

    @property
    def expected(self) -> Mapping[Failure, str]:
        """Failures of the first law that the disturbance is to show."""
        if self.has_springs:
            return dict.fromkeys(Failure, "elastic joints oscillate")
        weak = {Failure.SATURATED: "the motors are too weak"} if self.torque_limit_scale < 1.0 else {}
        return weak | ({Failure.NO_BETTER: "nothing excites the arm"} if self.motion == REST else {})

    @property
    def purpose(self) -> str:
        """Question of the experiment."""
        asked = FILE["asks"].get(self.disturbance, "").format(**vars(self))
        return FILE["asks"]["all"].format(asked=asked, **vars(self))

    def environment(self, mechanism: Mechanism) -> Any:
        """Tracking environment with the disturbances."""
        return self.plant_env(mechanism, self.followed(mechanism), max(self.joint_stiffness))

    def plant_env(self, mechanism: Mechanism, reference: Reference, stiffness: float) -> Any:
        """Environment with springs of a `stiffness`, N m/rad, none for 0."""
        return self.tracking(
            mechanism,
            reference,
            initial_error=self.initial_error,
            error_bound=self.error_bound,
            torque_limits=self.motors(mechanism),
            effects=tuple(self.effects(mechanism, stiffness)),
        )

    @property
    def error_bound(self) -> float:
        """Error, rad or m, that ends a run."""
        return 1.0 if self.disturbance == "none" else DIVERGENCE_ERROR

    def motors(self, mechanism: Mechanism) -> Array:
        """Torque limits (r,), N m (N)."""
        return self.torque_limit_scale * finite_torque_limits(mechanism)

    def effects(self, mechanism: Mechanism, stiffness: float) -> Iterator[Effect]:
        """Effects that no controller knows."""
        from adaptctl.simulation import effects

        if stiffness:
            yield self._elastic(mechanism, stiffness)
        if self.payload:
            for k in range(self.payload_cycles):
                yield effects.PayloadHeld(
                    self.body(), self.payload_start + k * self.turn, self.payload_stop + k * self.turn
                )
        if self.torque_rate_limit:
            yield effects.TorqueRateLimit(self.torque_rate_limit)
        if self.stribeck:
            yield self._friction(mechanism)
        if self.encoder_resolution or self.position_noise or self.velocity_noise:
            yield effects.Encoder(self.encoder_resolution, self.position_noise, self.velocity_noise)
        if self.velocity_cutoff:
            yield effects.FilteredDifferences(self.velocity_cutoff)
        if self.delay:
            yield effects.ControlDelay(self.delay)
        if self.drive_time_constant:
            yield effects.ActuatorLag(self.drive_time_constant)

    def body(self, share: float = 1.0) -> Payload:
        """Cube before the flange, with a share of the payload's mass."""
        from adaptctl.simulation.effects import Payload

        mass = share * self.payload
        return Payload(mass, np.array([0.0, 0.0, self.payload_offset]), mass * self.payload_size**2 / 6.0 * np.eye(3))

    def _friction(self, mechanism: Mechanism) -> Effect:
        from adaptctl.simulation.effects import Friction

        drives = [joint.drive for joint in mechanism.primary_joints]
        if not any(drive.coulomb or drive.viscous for drive in drives):
            raise InputError(
                f"robot: {mechanism.name} has no joint friction: add viscous or coulomb to its file, or "
                "use puma560_friction"
            )
        excess = self.stribeck * np.array([drive.coulomb or 0.0 for drive in drives])
        return Friction(stribeck=excess, stribeck_speed=STRIBECK_SPEED)

    def _elastic(self, mechanism: Mechanism, stiffness: float) -> Effect:
        """Springs of one stiffness, damped by joint."""
        from adaptctl.simulation.effects import ElasticJoints

        inertia, known = typical_inertia(mechanism), mechanism.parameter_names
        names = [f"{joint.name}.rotor_inertia" for joint in mechanism.primary_joints]
        if missing := [name for name in names if name not in known]:
            raise InputError(
                f"robot: {mechanism.name} has no {missing[0]}: elastic joints need rotor inertias; use an arm with "
                "rotors"
            )
        rotors = mechanism.inertial_parameters[[known.index(name) for name in names]]
        together = np.maximum(inertia - rotors, 1e-3 * inertia) * rotors / inertia
        return ElasticJoints(stiffness, 2.0 * DAMPING_RATIO * np.sqrt(stiffness * together), encoders=self.encoder_side)

    def reference(self, mechanism: Mechanism, amplitude: float | None = None) -> Sinusoids:
        """Motion before any stop."""
        if self.motion == EXCITING:
            return most_exciting(mechanism, self.seed)
        dof, loops = mechanism.dof, mechanism.description.loops is not None
        if dof > len(CENTER) or (self.motion == SINGLES and dof != len(CENTER)):
            many = "6" if self.motion == SINGLES else "up to 6"
            raise InputError(
                f"robot: {mechanism.name} has {dof} joints, but this experiment needs {many}; use the experiment "
                "'adaptive'"
            )
        if self.motion == SINGLES:
            return Sinusoids(np.array(CENTER), np.array(AMPLITUDES), np.array(SINGLE))
        if amplitude is None:
            amplitude = 0.0 if self.motion == REST else self.amplitude
        rng, shape = np.random.default_rng(self.seed), (len(FREQUENCIES), dof)
        frequency = np.array(FREQUENCIES)[:, None] * rng.uniform(0.8, 1.25, shape)
        phase = rng.uniform(-np.pi, np.pi, shape)
        center = mechanism.neutral_configuration if loops else np.array(CENTER[:dof])
        return Sinusoids(center, amplitude / np.sqrt(frequency / 0.2), frequency, phase)

    def followed(self, mechanism: Mechanism) -> Reference:
        """Motion with its halt."""
        moving = self.reference(mechanism)
        reference = StoppedReference(moving, self.reference_stop) if self.reference_stop else moving
        p = reference(np.linspace(0.0, self.duration, SAMPLES)).p
        apart = mechanism.continuation is not None and not mechanism.continuation.reachable(p).all()
        if apart or not mechanism.description.within_conditions(p).all():
            raise InputError(
                f"amplitude: {mechanism.name} would move farther than its loops allow; give less than "
                f"{self.amplitude:g} rad"
            )
        return reference

    def chosen(self, mechanism: Mechanism, env: Any) -> Iterator[Setting]:
        """Chosen settings: gains, rough model, reference."""
        share = f"{100 * self.parameter_error:.0f} %"
        rough = f"rough model: random link errors of ±{share}, no friction"
        rule = f"prior deviation: {share} of the size of each link and drive"
        yield from chosen_gains(self.gains(mechanism), f"{self.gain_scale:g} × (deviation)²", rule, rough)
        if self.motion == RANDOM:
            yield Setting("reference frequencies", listed(np.array(FREQUENCIES)), "Hz, ±20 % per joint, random")

    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains from the bandwidth and typical inertia."""
        return Gains.from_bandwidth(mechanism, self.bandwidth, DAMPING_FACTOR)

    def rough(self, mechanism: Mechanism) -> Array:
        """Parameters (P,) of the rough model, in SI units."""
        return scaled_links(mechanism, self.parameter_error, self.seed)


@lru_cache(maxsize=4)
def most_exciting(mechanism: Mechanism, seed: int) -> Sinusoids:
    """Fourier series within the limits. Raises `InputError` for loops or no limits."""
    if mechanism.description.loops is not None:
        raise InputError(f"motion: {EXCITING} is only for arms without loops, and {mechanism.name} has loops")
    basis = fundamental_basis(essential_space(mechanism, seed=seed))
    return excitation_trajectory(ReducedModel(mechanism, basis), seed=seed).reference
