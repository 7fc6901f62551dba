"""File of a contest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import msgspec

from adaptctl.arrays import whole_count
from adaptctl.caching import cached_property
from adaptctl.contest.conditions import CONDITIONS
from adaptctl.contest.foreign_runs import fits
from adaptctl.contest.laws import LAWS
from adaptctl.contest.own_law import is_own, own_entrant, own_name
from adaptctl.contest.scene import loaded, robot_name
from adaptctl.dynamics.joint_units import either, position_units
from adaptctl.errors import InputError, NotFoundError, suggested_name
from adaptctl.files import hashed, read_toml
from adaptctl.optional_packages import needed

Plant = Literal["adaptctl", "mujoco", "drake"]
Draw = Literal["reference", "initial error"]
MIN_DURATION, MAX_DURATION = 0.1, 1000.0
"""s"""


class ContestFile(msgspec.Struct, forbid_unknown_fields=True):
    """
    Content of a contest's TOML file.

    Parameters
    ----------
    purpose : str
        Question in a sentence.
    robots : list of str
        Built-in names, or files; a path from {example-robot-data}/ on is of that package.
    laws : list of str
        Names of laws of the library, or file.py:Class for laws of one's own.
    conditions : list of str
        Names of conditions.
    seeds : list of int
        Seeds, which all laws share.
    duration : float, default 20.0
        Length of a run in s.
    draws : list of str
        What a seed draws beside noise and wrong links. Default: the reference's phases and the initial error's signs.
    plant : str, default "adaptctl"
        Engine of the simulation.
    tuned_on : str, default ""
        File of a contest on which constants were chosen, of whose robots and seeds there may be none here.
    families : dict of str to list of str
        Names of robots that are alike by the family's name. Default: each robot is a family.
    """

    purpose: str
    robots: list[str]
    laws: list[str]
    conditions: list[str]
    seeds: list[int]
    duration: float = 20.0
    draws: list[Draw] = msgspec.field(default_factory=lambda: list(get_args(Draw)))
    plant: Plant = "adaptctl"
    tuned_on: str = ""
    families: dict[str, list[str]] = msgspec.field(default_factory=dict)


@dataclass(frozen=True)
class Contest:
    """Checked contest, with the paths of its files."""

    asked: ContestFile
    source: Path

    @classmethod
    def of(cls, path: Path) -> Contest:
        """Contest of a file; paths in it are relative to its folder."""
        if Path(path).suffix == ".py":
            raise InputError(f'{path}: expected a TOML file, which names this law: laws = ["{path}:CLASS"]')
        asked = read_toml(path, ContestFile)
        asked.laws = [_placed(law, path, is_own(law)) for law in asked.laws]
        asked.robots = [_placed(robot, path, "/" in robot or "." in robot) for robot in asked.robots]
        found = cls(asked, path)
        found.validate()
        return found

    def validate(self) -> None:
        """Raise `InputError` for what cannot be a contest."""
        asked, where = self.asked, self.source
        for what in ("robots", "laws", "conditions", "seeds"):
            _validate_some(where, what, getattr(asked, what))
        _validate_known(where, "condition", asked.conditions, CONDITIONS)
        _validate_known(where, "law", [x for x in asked.laws if not is_own(x)], [law.name for law in LAWS])
        for law in filter(is_own, asked.laws):
            own_entrant(law)
        _validate_unlike(where, "laws", [(law_name(law), law) for law in asked.laws])
        _validate_unlike(where, "robots", [(robot_name(robot), robot) for robot in asked.robots])
        for seed in asked.seeds:
            whole_count(seed, f"{where}: seeds")
        if not MIN_DURATION <= asked.duration <= MAX_DURATION:
            raise InputError(
                f"{where}: duration: expected {MIN_DURATION:g} to {MAX_DURATION:g} s, got {asked.duration:g}"
            )
        _ = self.robot_hashes
        self._validate_disjoint()
        self._validate_families()
        unfit = [name for name in asked.conditions if asked.plant != "adaptctl" and not fits(asked.plant, name)]
        if unfit:
            fit = ", ".join(name for name in CONDITIONS if fits(asked.plant, name))
            raise InputError(f"{where}: the plant {asked.plant} has no {', '.join(unfit)}; it has {fit}")
        if asked.plant == "drake":
            with needed(f"{where}: the plant drake"):
                import pydrake  # noqa: F401

    def _validate_disjoint(self) -> None:
        """Raise `InputError` where constants were chosen on what is judged here."""
        if not self.asked.tuned_on:
            return
        other = read_toml(self.source.parent / self.asked.tuned_on, ContestFile)
        names = {robot_name(robot) for robot in other.robots}
        shared = [name for name in map(robot_name, self.asked.robots) if name in names]
        shared += [f"seed {seed}" for seed in self.asked.seeds if seed in other.seeds]
        if shared:
            raise InputError(f"{self.source}: {self.asked.tuned_on} has {', '.join(shared)} too: judge on others")

    def _validate_families(self) -> None:
        """Raise an error for a family of a robot that is not here, or is in another family too."""
        named = [name for members in self.asked.families.values() for name in members]
        _validate_known(f"{self.source}: families", "robot", named, [robot_name(robot) for robot in self.asked.robots])
        if twice := _repeated(named):
            raise InputError(f"{self.source}: families: {twice!r} is in two; a robot is of one family")

    @property
    def families(self) -> dict[str, str]:
        """Family of each robot that is in one, by its name."""
        return {name: family for family, members in self.asked.families.items() for name in members}

    @cached_property
    def robot_hashes(self) -> dict[str, str]:
        """Hash of each robot's description, of limits and all, by its name. Raises what `load` raises."""
        return {robot_name(robot): loaded(robot).description.sha256 for robot in self.asked.robots}

    @property
    def error_unit(self) -> str:
        """Unit of the errors of all joints of all robots, such as "mrad"."""
        return either(f"m{unit}" for robot in self.asked.robots for unit in position_units(loaded(robot)))

    @property
    def scoring(self) -> dict[str, Any]:
        """Set on which laws are judged: robots by their files' hashes and families, conditions, seeds and how."""
        asked = self.asked
        sets = {"robots": self.robot_hashes, "conditions": list(asked.conditions), "seeds": list(asked.seeds)}
        how = {"duration": asked.duration, "draws": list(asked.draws), "plant": asked.plant}
        return {**sets, **how, "families": asked.families}

    @property
    def scoring_hash(self) -> str:
        """SHA-256 hash of `scoring`, which no law has a part in."""
        return hashed(self.scoring)

    def only(self, chosen: Mapping[str, str | int | None]) -> Contest:
        """Contest with one law, robot, condition or seed of these alone."""
        asked = msgspec.structs.replace(self.asked)
        named: dict[str, Callable[[Any], Any]] = {"law": law_name, "robot": robot_name, "condition": str, "seed": int}
        for what, name in named.items():
            if chosen.get(what) is not None:
                values = [x for x in getattr(asked, f"{what}s") if name(x) == chosen[what]]
                if not values:
                    known = ", ".join(str(name(x)) for x in getattr(asked, f"{what}s"))
                    raise NotFoundError(f"--{what}: {self.source} has no {chosen[what]!r}; it has {known}")
                setattr(asked, f"{what}s", values)
        return Contest(asked, self.source)


def law_name(law: str) -> str:
    """Name of a law in tables."""
    return own_name(law) if is_own(law) else law


def _placed(name: str, path: Path, is_file: bool) -> str:
    if not is_file or name.startswith("{"):
        return name
    return str((path.parent / name).resolve())


def _validate_some(where: Path, what: str, values: Sequence[Any]) -> None:
    if not values:
        raise InputError(f"{where}: {what}: expected at least one")
    if (twice := _repeated(values)) is not None:
        raise InputError(f"{where}: {what}: {twice!r} is given twice")


def _repeated(values: Sequence[Any]) -> Any:
    """First value that is there a second time, None without one."""
    return next((x for k, x in enumerate(values) if x in values[:k]), None)


def _validate_known(where: Path | str, what: str, names: Sequence[str], known: Iterator[str] | Any) -> None:
    for name in names:
        if name not in known:
            hint = suggested_name(name, list(known))
            if what == "law" and name.endswith(".py"):
                hint = " (its class is missing: FILE.py:CLASS)"
            raise NotFoundError(f"{where}: unknown {what} {name!r}{hint}; {what}s: {', '.join(known)}")


def _validate_unlike(where: Path, what: str, named: Sequence[tuple[str, str]]) -> None:
    places: dict[str, str] = {}
    library = {law.name for law in LAWS} if what == "laws" else set()
    for name, place in named:
        if name in places or (is_own(place) and what == "laws" and name in library):
            other = places.get(name, "the library's")
            raise InputError(f"{where}: {what}: two are called {name!r}, {other} and {place}: rename one")
        places[name] = place
