"""MuJoCo's model of a mechanism, with all that the mechanism does not need turned off."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco import rollout

from adaptctl.arrays import Array
from adaptctl.description import GROUND, Closure, Description, Link
from adaptctl.description.inertia import inertia_tensor
from adaptctl.dynamics import Mechanism

INTEGRATORS = {"RK4": mujoco.mjtIntegrator.mjINT_RK4, "semi-implicit": mujoco.mjtIntegrator.mjINT_EULER}

STIFF = (-2.5e5, -1.0e3)
"""Stiffness (1/s^2) and damping (1/s) of closures: critically damped, with the time constant of two steps of 1 ms."""
HARD = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Share of a closure's force that acts: nearly all, at any gap."""

_UNUSED = ("ACTUATION", "CONTACT", "DAMPER", "EULERDAMP", "FILTERPARENT", "FRICTIONLOSS", "LIMIT", "MIDPHASE",
           "REFSAFE", "SENSOR", "SPRING", "AUTORESET", "ISLAND")  # fmt: skip
_UNUSED_BY_TREES = ("CONSTRAINT", "EQUALITY", "WARMSTART")


SOLVERS = {"Newton": mujoco.mjtSolver.mjSOL_NEWTON, "PGS": mujoco.mjtSolver.mjSOL_PGS, "CG": mujoco.mjtSolver.mjSOL_CG}
"""MuJoCo's solvers of constraints."""


def mujoco_model(mechanism: Mechanism, step: float, integrator: str, solver: str = "Newton") -> mujoco.MjModel:
    """The same arm, its loops closed by `connect`; `step` in s. Torques are applied to its joints (`qfrc_applied`).

    Constraints are solved by one iteration: they are equalities, so one of Newton's method is exact.
    """
    description, spec = mechanism.description, mujoco.MjSpec()
    bodies = {GROUND: spec.worldbody}
    for i, link in enumerate(description.links):
        bodies[i] = _add_body(bodies[link.parent], link)
    closures = description.loops.closures if description.loops is not None else ()
    for closure in closures:
        _connect(spec, description, closure, bodies)
    option = spec.option
    option.timestep, option.gravity, option.integrator = step, description.gravity, INTEGRATORS[integrator]
    option.solver, option.iterations, option.tolerance = SOLVERS[solver], 1, 0.0
    unused = _UNUSED if closures else _UNUSED + _UNUSED_BY_TREES
    option.disableflags = sum(int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")) for name in unused)
    return spec.compile()


def _add_body(parent: mujoco.MjsBody, link: Link) -> mujoco.MjsBody:
    """A link: its frame is the body's, its joint stands where the link's far end begins."""
    pose, back, mass = link.parent_to_joint @ link.joint_to_link, link.joint_to_link.inverse, float(link.inertia[0])
    body = parent.add_body(name=link.name, pos=pose.translation, quat=_quaternion(pose.rotation))
    kind = mujoco.mjtJoint.mjJNT_HINGE if link.joint.kind.is_revolute else mujoco.mjtJoint.mjJNT_SLIDE
    axis = back.rotation @ link.joint.axis
    body.add_joint(name=link.joint.name, type=kind, axis=axis, pos=back.translation)
    center = link.inertia[1:4] / mass
    tensor = inertia_tensor(link.inertia) - mass * (center @ center * np.eye(3) - np.outer(center, center))
    moments, axes = np.linalg.eigh(tensor)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    body.explicitinertial, body.mass, body.ipos = True, mass, center
    body.inertia, body.iquat = moments, _quaternion(axes)
    return body


def _connect(
    spec: mujoco.MjSpec, description: Description, closure: Closure, bodies: dict[int, mujoco.MjsBody]
) -> None:
    """A closure as an equality between two points."""
    links = [link.name for link in description.links]
    ends = ((closure.first, closure.first_frame), (closure.second, closure.second_frame))
    names = [f"{closure.name} {k}" for k in range(2)]
    for name, (link, frame) in zip(names, ends, strict=True):
        bodies[GROUND if link is None else links.index(link)].add_site(name=name, pos=frame.translation)
    equality = spec.add_equality(name1=names[0], name2=names[1], solref=STIFF, solimp=HARD)
    equality.type, equality.objtype = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE


def _quaternion(rotation: Array) -> Array:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    return quaternion


class Physics:
    """Many arms without any controller, in `mujoco.rollout` on one thread: q and v (arms, n), torque (arms, n) held."""

    def __init__(self, model: mujoco.MjModel, q: Array, v: Array, torque: Array, steps: int) -> None:
        self.model, self.data, self.n = model, mujoco.MjData(model), model.nv
        size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self.initial = np.zeros((len(q), size))
        self.initial[:, 1 : 1 + 2 * self.n] = np.hstack((q, v))
        self.torque = np.broadcast_to(torque[:, None, :], (len(q), steps, self.n)).copy()
        self.states, self.steps = np.zeros((len(q), steps, size)), steps

    def run(self) -> None:
        """All steps of all arms, from the same beginning."""
        rollout.rollout(
            self.model,
            [self.data],
            self.initial,
            self.torque,
            control_spec=int(mujoco.mjtState.mjSTATE_QFRC_APPLIED),
            nstep=self.steps,
            state=self.states,
        )

    @property
    def q(self) -> Array:
        """Joints (arms, steps, n) after each step."""
        return self.states[..., 1 : 1 + self.n]

    @property
    def v(self) -> Array:
        """Velocities (arms, steps, n) after each step."""
        return self.states[..., 1 + self.n : 1 + 2 * self.n]
