"""Adaptive impedance of a tool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers, positive_number, positive_per_joint, stacked
from adaptctl.control.gains.workspace import sampled_configurations, workspace_of
from adaptctl.control.impedance import JointImpedance, validate_damping, validate_stiffness
from adaptctl.description.places import tool_point
from adaptctl.dynamics.recursion.kinematics import MovingPoint, frames, moving_point
from adaptctl.dynamics.recursion.mass_matrix import Factors, factorised
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Dual, Mat, Scalar, Vec, absolute, clip, column, dot

MOST_FORCE = 1e9
"""N, for springs without a limit"""
DIRECTIONS = ("x", "y", "z", "rotation about x", "rotation about y", "rotation about z")


class ToolSprings(NamedTuple):
    """Force and moment (3,) of the tool's springs in world axes, and their energy."""

    force: Vec
    moment: Vec
    energy: Scalar


@dataclass(frozen=True, eq=False)
class TaskImpedance(JointImpedance):
    r"""
    Adaptive controller under which a tool feels like springs and dampers along the world's axes.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of a tree with k parameters and r joints.
    stiffness : array_like
        Stiffness (r,) or one number in N m/rad (N/m), of motions that leave the tool where it is.
    damping : array_like
        Damping (r,) or one number in N m s/rad (N s/m), of the same motions.
    adaptation : AdaptationLaw or array_like, optional
        Adaptation law, or the gain of `Gradient`: its diagonal (k,) or the whole matrix (k, k), in units of the
        parameters squared per J. None switches adaptation off.
    initial : array_like, optional
        Initial estimate (k,) in SI units, zero unless given.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    workspace : Workspace, optional
        Joint positions for which the damping is checked. Unless given, all that the joints' limits allow.
    torque_limits : array_like, optional
        Limits in N m (N), one number or (r,). Nothing is learned from a period whose torque exceeds them; the
        mechanism's own limits unless given.
    tank : float, optional
        Energy in J that moving references, rising stiffness and wrong learning may give to the surroundings. Default:
        no limit.
    delay : int, default 0
        Control periods between a measurement and its torque.
    tool_stiffness : array_like
        Stiffness (6,) along and about the world's axes, in N/m and N m/rad. Where it and the damping are 0, the
        direction is free, and counts to what leaves the tool where it is.
    tool_damping : array_like
        Damping (6,) along and about the world's axes, in N s/m and N m s/rad.
    link : str, optional
        Link or frame of the tool, the last link unless given.
    tool : array_like, optional
        Point (3,) in the frame of the link in m, its origin unless given.
    most_force : array_like, default inf
        Force in N, one number or (3,), beyond which a spring along an axis does not grow.
    singularity : float, default 0.02
        Effect of the joints on the tool, as a share of the arm's greatest, below which a direction counts as lost.
    inertia : array_like, optional
        Target inertia (r,) or one number in kg m^2 (kg), of motions that leave the tool where it is; with
        `tool_inertia`. Default: the arm's own.
    force_cutoff : float, optional
        Corner frequency in rad/s of a filter of measured external torques, which then drive the target inertia: put
        them in the state's `controller_state.felt`, as `HeldState.feeling` does. Default: the observer of `adaptation`.
    surroundings : float, default 1e3
        Stiffness in N/m of what the tool may touch, up to which a target inertia is checked.
    tool_inertia : array_like, optional
        Target inertia (6,) along and about the world's axes, in kg and kg m^2, where the tool has springs or dampers.

    Raises
    ------
    GainError
        If a stiffness is above what the period carries, the sampling ratio of the dampers is above 1.5, or the arm
        would swing with the target inertia between springs.
    InputError
        If the mechanism has loops, a shape is wrong, a number out of range, or `JointImpedance` refuses it.

    Notes
    -----
    .. math:: \tau=Y\hat\beta-J^\top(f(x)+D_xJ\dot e)-N(KNe+DN\dot e),\quad N=(1+J^\top WJ)^{-1},

    References are in joints: the tool's pose is theirs, and motions that leave it where it is tend to theirs. No
    Jacobian is inverted: near a singularity the tool's spring loses its hold, and N gives the lost direction to the
    joints' own. With the rotation R from the desired to the actual pose, the moments are those of the energy
    :math:`\mathrm{tr}\,P(1-R)`, :math:`P=\tfrac12\mathrm{tr}(K_o)-K_o` [1]_, which grows up to half a turn.

    The target inertia is :math:`J^\top M_xJ+NM_0N` in joints, and what turns with J' is taken from its torque.

    References
    ----------
    .. [1] Bullo and Murray, European Control Conference, 1995.

    Examples
    --------
    >>> soft = adaptctl.control.TaskImpedance(
    ...     model, 20.0, [6.0, 2.0], tool_stiffness=[300.0, 300.0, 0, 0, 0, 0], tool_damping=[30.0, 30.0, 0, 0, 0, 0]
    ... )
    >>> soft.reference_size
    2
    """

    tunable = (*JointImpedance.tunable, "tool_stiffness", "tool_damping", "most_force")
    sparse = ("tool_stiffness", "tool_damping")

    tool_stiffness: Array | None = None
    tool_damping: Array | None = None
    link: str | None = None
    tool: Array | None = None
    most_force: ArrayLike = np.inf
    singularity: float = 0.02
    tool_inertia: Array | None = field(default=None, kw_only=True)
    _weights: ClassVar[tuple[float, ...]]
    _link: ClassVar[int]

    def __post_init__(self) -> None:
        self._validate_model()
        if not self.model.mechanism.is_plain_tree:
            raise InputError(f"task impedance: {self.model.mechanism.name} has loops; expected a tree of joints")
        for name in ("tool_stiffness", "tool_damping"):
            object.__setattr__(self, name, _six(getattr(self, name), name))
        object.__setattr__(self, "most_force", _forces(self.most_force))
        positive_number(self.singularity, "singularity: expected a positive share")
        given = frozen_array(np.zeros(3) if self.tool is None else self.tool, (3,), "tool")
        index, link, point = tool_point(self.model.mechanism.description, self.link, given, "task impedance")
        for name, value in (("_link", index), ("link", link), ("tool", frozen_array(point, (3,), "tool"))):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_weights", self._weighed())
        self._settle_tool_inertia()
        super().__post_init__()

    def _spring(self, q: Column, p: Column, goal: Column) -> tuple[Column, Scalar]:
        point, springs = self._moving(q), self._springs(q, goal)
        still = self._still(point)
        kept = still.solved(column(self.stiffness) * still.solved(p - goal))
        return point.torque(springs.force, springs.moment) + kept, springs.energy

    def _damper(self, q: Column, s: Column) -> Column:
        return self._along(self._moving(q), s, column(self.tool_damping), column(self.damping))

    def _linear_spring(self, q: Column, way: Column) -> Column:
        return self._along(self._moving(q), way, column(self.tool_stiffness), column(self.stiffness))

    @property
    def _surrounded(self) -> Array:
        return np.pad(np.concatenate((np.ones((1, 3)), np.eye(3))), ((0, 0), (0, 3)))

    def _touched(self, q: Column, way: Column, along: Array) -> Column:
        return self._along(self._moving(q), way, column(along), Column.zeros(self.dof))

    def _along(self, point: MovingPoint, x: Column, tool: Column, own: Column) -> Column:
        """Torque (r,) of so much of x (r,) along the tool's axes (6,), and of the joints' motions (r,) beside it."""
        still = self._still(point)
        return _weighed(point, (*point.velocity(x), *point.angular_velocity(x)), tool) + still.solved(
            own * still.solved(x)
        )

    def _accelerated(self, q: Column, v: Column, rate: Column, push: Column) -> Column:
        point, Mx = self._moving(q), column(np.asarray(self.tool_inertia))
        units, own = [column(unit) for unit in np.eye(self.dof)], column(np.asarray(self.inertia))
        rows = [list(self._along(point, unit, Mx, own)) for unit in units]
        turning = self._moving(Column(map(Dual, q, v)))
        slopes = [x.slope for x in (*turning.velocity(rate), *turning.angular_velocity(rate))]
        return factorised(rows).solved(push - _weighed(point, slopes, Mx))

    def _springs(self, q: Column, goal: Column) -> ToolSprings:
        """Forces of the springs between the pose at a goal (r,) and the tool's."""
        links, offset = self.model.mechanism.equations.links, Vec(*np.asarray(self.tool).tolist())
        here, there = (frames(links, at)[self._link] for at in (q, goal))
        way = (here.origin + here.rotation @ offset) - (there.origin + there.rotation @ offset)
        K, most = column(self.tool_stiffness), column(self.most_force)
        pulls = [_pull(K[i], most[i], x) for i, x in enumerate(way)]
        moment, turned = _turning(here.rotation @ there.rotation.T, Column(K[i] for i in (3, 4, 5)))
        return ToolSprings(Vec(*(force for force, _ in pulls)), moment, sum((u for _, u in pulls), turned))

    def _moving(self, q: Column) -> MovingPoint:
        return moving_point(self.model.mechanism.equations.links, q, self._link, Vec(*np.asarray(self.tool).tolist()))

    def _still(self, point: MovingPoint) -> Factors:
        """Factors of 1 + J' W J, whose inverse keeps the motions that leave the tool where it is."""
        rows = list(zip(*((*way, *turn) for way, turn in zip(point.columns, point.turns, strict=True)), strict=True))
        used = [(w, row) for w, row in zip(self._weights, rows, strict=True) if w > 0.0]
        r = self.dof
        gram: list[list[Any]] = [[float(i == j) for j in range(r)] for i in range(r)]
        for w, row in used:
            for i in range(r):
                for j in range(i + 1):
                    gram[i][j] = gram[i][j] + (w * row[i]) * row[j]
        return factorised([[gram[max(i, j)][min(i, j)] for j in range(r)] for i in range(r)])

    def _settle_tool_inertia(self) -> None:
        if (self.tool_inertia is None) != (self.inertia is None):
            raise InputError("tool_inertia: expected one with inertia, for motions that leave the tool where it is")
        if self.tool_inertia is None:
            return
        object.__setattr__(self, "tool_inertia", _six(self.tool_inertia, "tool_inertia"))
        if not np.array_equal(np.asarray(self.tool_inertia) > 0.0, np.asarray(self._weights) > 0.0):
            raise InputError("tool_inertia: expected it above 0 where the tool has springs or dampers, and 0 elsewhere")

    def _settled_inertia(self, given: ArrayLike) -> Array:
        return positive_per_joint(given, self.dof, "inertia")

    def _check_gains(self) -> None:
        mechanism, T = self.model.mechanism, self.control_period
        names = [*DIRECTIONS, *(f"joint {joint.name}" for joint in mechanism.primary_joints)]
        K = np.concatenate([np.asarray(self.tool_stiffness), self.stiffness])
        D = np.concatenate([np.asarray(self.tool_damping), self.damping])
        validate_stiffness(mechanism.name, names, K, D, T, self.delay)
        worst = workspace_of(mechanism, self.workspace).maximum(self._ratios)
        validate_damping(mechanism.name, worst, T, self.delay)

    def _ratios(self, p: Array) -> Array:
        """Sampling ratios (...) at positions (..., r)."""
        dampers = (self._damper(column(p), column(unit)) for unit in np.eye(self.dof))
        held = [stacked(list(torque), p.shape[:-1]) for torque in dampers]
        M = self.model.mechanism.mass_matrix(p)
        values = np.linalg.eigvals(np.linalg.solve(M, self.control_period * np.stack(held, axis=-1)))
        return np.asarray(values.real.max(axis=-1))

    def _weighed(self) -> tuple[float, ...]:
        """Weights (6,) of the tool's motions against the joints', 0 for free directions."""
        mechanism = self.model.mechanism
        point = self._moving(column(sampled_configurations(mechanism)))
        reach = max(float(np.max(np.sqrt(np.asarray(dot(way, way))))) for way in point.columns)
        bound = np.asarray(self.tool_stiffness) + np.asarray(self.tool_damping) > 0.0
        sizes = np.array([reach] * 3 + [1.0] * 3) * self.singularity
        return tuple(np.where(bound, 1.0 / sizes**2, 0.0).tolist())


def _six(given: Any, name: str) -> Array:
    values = frozen_array(given if given is not None else (), (6,), name)
    if (values < 0.0).any():
        raise InputError(f"{name}: expected numbers of at least 0, got {values.tolist()}")
    return values


def _forces(given: ArrayLike) -> Array:
    values = np.broadcast_to(numbers(given, "most_force"), (3,)) if np.size(given) in (1, 3) else np.zeros(0)
    if len(values) != 3 or not (values > 0.0).all():
        raise InputError(f"most_force: expected positive forces in N, one number or (3,), got {given!r}")
    return np.minimum(values, MOST_FORCE)


def _pull(stiffness: Any, most: Any, way: Any) -> tuple[Any, Any]:
    """Force of a spring that does not grow beyond a force, and its energy."""
    if isinstance(stiffness, float) and stiffness == 0.0:
        return 0.0, 0.0
    force = clip(stiffness * way, -most, most)
    return force, absolute(force) * (absolute(way) - 0.5 * (absolute(force) / stiffness))


def _turning(R: Mat, stiffness: Column) -> tuple[Vec, Any]:
    """Moment of springs about the world's axes against a rotation, and their energy."""
    half = 0.5 * (stiffness[0] + stiffness[1] + stiffness[2])
    x, y, z = (half - k for k in stiffness)
    moment = Vec(y * R.z.y - z * R.y.z, z * R.x.z - x * R.z.x, x * R.y.x - y * R.x.y)
    return moment, x * (1.0 - R.x.x) + y * (1.0 - R.y.y) + z * (1.0 - R.z.z)


def _weighed(point: MovingPoint, rates: Sequence[Any], tool: Column) -> Column:
    """Torque (r,) of a force and a moment, so much (6,) of six rates."""
    x, y, z, a, b, c = (gain * rate for gain, rate in zip(tool, rates, strict=True))
    return point.torque(Vec(x, y, z), Vec(a, b, c))
