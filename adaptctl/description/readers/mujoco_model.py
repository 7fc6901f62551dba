"""Reader of mechanisms in compiled MuJoCo models."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.link import GROUND, Link
from adaptctl.description.loops import Closure, ClosureKind, Coupling, Loops, given_once
from adaptctl.description.pose import Pose
from adaptctl.description.readers.entries import MAX_LINKS, validate_at_most, warn_of_repeated
from adaptctl.description.readers.mujoco_arm import WORLD, MujocoArm, is_disabled, model_name, pose
from adaptctl.errors import InputError, NotFoundError

if TYPE_CHECKING:
    import mujoco

CONNECT, WELD, OF_JOINTS = range(3)
"""MuJoCo's numbers of kinds of equalities (mjtEq)."""
SITE = 6
"""MuJoCo's number of sites among objects (mjtObj)."""
NO_EQUALITY = "mjDSBL_EQUALITY"
MIN_INDEPENDENT = 1e-7
"""of the largest singular value, below which constraints do not bind a joint"""


def from_mujoco(model: mujoco.MjModel, body: str | None = None) -> Description:
    """Description of a body with all bodies on it, and the loops of the equalities."""
    arm = MujocoArm.of(model, body)
    links = tuple(arm.links())
    validate_at_most(len(links), MAX_LINKS, "moving links")
    where = f"MuJoCo model, body {arm.body_name(arm.root)!r}"
    loops = loops_of(arm, links, where)
    arm.warn(where, links, arm.undriven(links, loops))
    name = arm.body_name(arm.root) if body is not None or not model_name(model) else model_name(model)
    return Description(name, links, arm.gravity, "MuJoCo model", loops)


def loops_of(arm: MujocoArm, links: Sequence[Link], where: str, floating: Sequence[str] = ()) -> Loops | None:
    """Loop constraints, that the active equalities of MuJoCo's model make on an `arm`."""
    found = _Equalities(arm, [link.name for link in links], [link.joint.name for link in links])
    loops, repeated = found.loops(floating)
    warn_of_repeated(where, repeated)
    return loops


@dataclass
class _Equalities:
    """Reads the equalities that hold on to an arm."""

    arm: MujocoArm
    links: Sequence[str]
    joints: Sequence[str]
    """Names of the arm's joints."""

    def loops(self, floating: Sequence[str]) -> tuple[Loops | None, tuple[str, ...]]:
        """Loops, and the names of constraints that were given twice."""
        closures: list[Closure] = []
        couplings: list[Coupling] = []
        model, driven = self.arm.model, self._driven(floating)
        active = [] if is_disabled(model, NO_EQUALITY) else [e for e in range(model.neq) if model.eq_active0[e]]
        for number, e in enumerate(active):
            tag = ("connect", "weld", "joint")[model.eq_type[e]] if model.eq_type[e] <= OF_JOINTS else ""
            name = model.equality(e).name or f"{tag or 'equality'}{number + 1}"
            if not self._touched(e):
                continue
            with self.arm.at_line(e):
                if tag == "joint":
                    couplings.append(self._coupling(e, name, driven))
                elif (closure := self._closure(e, name)) is not None:
                    closures.append(closure)
        if not closures and not couplings:
            return None, ()
        once, repeated = given_once(closures)
        geared, more = given_once(couplings)
        coordinates = {name: float(model.qpos0[model.jnt_qposadr[j]]) for j, name in self._named()}
        reference = {name: value for name, value in coordinates.items() if value != 0.0}
        loops = Loops(tuple(self._primary(geared, driven)), once, geared, reference)
        return loops, (*repeated, *more)

    def _named(self) -> Iterator[tuple[int, str]]:
        yield from zip(self.arm.joints, self.joints, strict=True)

    def _driven(self, floating: Sequence[str]) -> list[str]:
        on = {int(self.arm.model.actuator_trnid[i, 0]) for i in self.arm.actuators}
        return [name for j, name in self._named() if j in on or name in floating]

    def _ends(self, e: int) -> list[int]:
        model = self.arm.model
        ends = [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
        sites = model.eq_type[e] != OF_JOINTS and model.eq_objtype[e] == SITE
        return [int(model.site_bodyid[s]) for s in ends] if sites else ends

    def _touched(self, e: int) -> bool:
        own = self.arm.joints if self.arm.model.eq_type[e] == OF_JOINTS else self.arm.bodies
        return self.arm.model.eq_type[e] <= OF_JOINTS and any(end in own for end in self._ends(e))

    def _primary(self, couplings: Sequence[Coupling], driven: list[str]) -> list[str]:
        """Driven joints, and others that these and the loops do not determine: of each loop those nearest the base."""
        followers = [coupling.follower for coupling in couplings]
        free = [name for name in self.joints[::-1] if name not in driven and name not in followers]
        J, dependent = self._jacobian(), list[str]()
        for name in (*followers, *free):
            columns = [self.joints.index(one) for one in (*dependent, name)]
            if _rank(J[:, columns]) == len(columns):
                dependent.append(name)
        return [name for name in self.joints if name not in dependent and name not in followers]

    def _jacobian(self) -> Array:
        """Derivatives (rows, n) of the equalities with respect to the arm's joints, at the reference."""
        import mujoco

        model = copy.copy(self.arm.model)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        J: Array = data.efc_J.reshape(-1, model.nv)[rows]
        return J[:, [int(model.jnt_dofadr[j]) for j in self.arm.joints]]

    def _closure(self, e: int, name: str) -> Closure | None:
        model, data = self.arm.model, self.arm.model.eq_data[e]
        first, second = self._ends(e)
        weld = model.eq_type[e] == WELD
        if model.eq_objtype[e] == SITE:
            sites = (int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))
            one, other = (pose(model.site_pos[s], model.site_quat[s]) for s in sites)
        elif weld:
            one, other = pose(data[3:6], data[6:10]), Pose(np.eye(3), np.array(data[:3]))
        else:
            one, other = (Pose(np.eye(3), np.array(anchor)) for anchor in (data[:3], data[3:6]))
        (link, at), (link2, at2) = self._stand(first, name), self._stand(second, name)
        if link == link2 is None and self.arm.held:
            return None  # it held the base that is held anyway
        if link == link2:
            raise InputError(
                f"equality {name!r}: both ends are on the same rigid body, {link or 'the world'}; remove it"
            )
        return Closure(name, link, link2, at @ one, at2 @ other, ClosureKind.WELD if weld else ClosureKind.POINT)

    def _stand(self, i: int, name: str) -> tuple[str | None, Pose]:
        arm = self.arm
        if i in arm.carriers:
            carrier = arm.carriers[i]
            return None if carrier == GROUND else self.links[carrier], arm.places[i]
        if arm.model.body_weldid[i] == WORLD:
            return None, arm.still(i)
        raise NotFoundError(
            f"equality {name!r}: body {arm.body_name(i)!r} is not part of the mechanism; remove the equality"
        )

    def _coupling(self, e: int, name: str, driven: Sequence[str]) -> Coupling:
        """Coupling q1 - ref1 = c0 + c1 (q2 - ref2); the first joint follows, unless it alone is driven."""
        model, names, where = self.arm.model, dict(self._named()), f"equality {name!r}"
        first, second = self._ends(e)
        if second < 0:
            raise InputError(f"{where}: fixes joint {names[first]!r}; remove the joint, or give joint2")
        if first not in names or second not in names:
            raise NotFoundError(f"{where}: a joint is not part of the mechanism; joints: {', '.join(self.joints)}")
        c0, c1, *higher = model.eq_data[e, :5].tolist()
        if any(higher) or c1 == 0.0:
            given = [c0, c1, *higher]
            raise InputError(f"{where}: polycoef: expected a linear relation, c0 c1 0 0 0, got {given}")
        at, at2 = (float(model.qpos0[model.jnt_qposadr[j]]) for j in (first, second))
        offset, follower, leader = at + c0 - c1 * at2, names[first], names[second]
        try:
            if follower in driven and leader not in driven:
                return Coupling(name, leader, follower, 1.0 / c1, -offset / c1)
            return Coupling(name, follower, leader, c1, offset)
        except InputError as error:
            raise InputError(f"{where}: {error}") from error


def _rank(matrix: Array) -> int:
    values = np.linalg.svd(matrix, compute_uv=False)
    return int((values > MIN_INDEPENDENT * values.max(initial=1e-300)).sum())
