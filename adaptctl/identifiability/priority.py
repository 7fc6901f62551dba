"""Priorities: the order in which parameters are removed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError, NotFoundError, printable
from adaptctl.files import read_toml

SCHEMA = "adaptctl/priority/1"

# Kinds in the order of Table 4 of Sheu and Walker (1991): the first kind is removed first, of all links.
KINDS = ("m", "mc_x", "mc_y", "mc_z", "I_xy", "I_xz", "I_yz", "I_xx", "I_yy", "I_zz")

# Our names by the paper's, which files may use.
PAPER_KINDS = {"I_x": "I_xx", "I_y": "I_yy", "I_z": "I_zz"}


@dataclass(frozen=True)
class Priority:
    """
    Order in which dependent inertial parameters are removed.

    Parameters that are not named come between `order` and `keep`, in the default order: by kind, m, mc_x, mc_y, mc_z,
    I_xy, I_xz, I_yz, I_xx, I_yy, I_zz, rotor inertia, and within a kind from first link to last. A parameter that is
    not determined by the others is kept, whatever the order.

    Parameters
    ----------
    order : tuple of str, optional
        Names such as ``link3.I_xx``, the first removed first. Default: none, the default order from its beginning.
    keep : tuple of str, optional
        Names to keep where possible, in descending order of importance. Default: none, the default order to its end.

    Raises
    ------
    InputError
        If `order` or `keep` is no list of names; `indices` checks the names. Friction is never removed and has no name.

    Examples
    --------
    >>> adaptctl.Priority(order=("lower.I_zz",)).indices(space.parameter_names)[0]
    19
    """

    order: tuple[str, ...] = ()
    keep: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("order", "keep"):
            given = getattr(self, name)
            if isinstance(given, str) or not isinstance(given, Iterable):
                raise InputError(f"priority: {name}: expected names of parameters, got {printable(repr(given))}")
            object.__setattr__(self, name, tuple(given))

    @classmethod
    def default(cls, mechanism: Mechanism) -> Priority:
        """
        Return the default order in which dependent parameters of a mechanism are removed.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism whose inertial parameters are ordered.

        Returns
        -------
        Priority
            Order of Table 4 of Sheu and Walker (1991): masses first, then first moments, then inertias.

        Examples
        --------
        >>> adaptctl.Priority.default(arm).order[:2]
        ('upper.m', 'lower.m')
        """
        return cls(_default_order(mechanism.parameter_names[: mechanism.num_energy_parameters]))

    @classmethod
    def read(cls, path: str | Path, mechanism: Mechanism) -> Priority:
        r"""
        Read a priority from a TOML file.

        Parameters
        ----------
        path : str or pathlib.Path
            File with ``schema = "adaptctl/priority/1"`` and one of three ways to state the order.
        mechanism : Mechanism
            Mechanism whose parameters are named.

        Returns
        -------
        Priority
            Order of removal; what is left out follows in the default order.

        Raises
        ------
        FileError
            If the file cannot be read, or an element is wrong or unknown, which the message names.

        Notes
        -----
        The order is a list ``order`` of names; or lists ``kinds`` and ``links``, kinds first unless ``first =
        "links"``; or a table ``[grid]`` as in Tables 4 and 11 of Sheu and Walker (1991): for each kind a number for
        each link, the lowest removed first. A list ``keep`` is allowed everywhere, and the paper's ``I_x`` for
        ``I_xx``.

        Examples
        --------
        >>> lines = ['schema = "adaptctl/priority/1"', 'kinds = ["I_xx", "I_yy"]', 'keep = ["lower.m"]']
        >>> _ = (tmp / "priority.toml").write_text("\n".join(lines))
        >>> adaptctl.Priority.read(tmp / "priority.toml", arm).order[:2]
        ('upper.I_xx', 'lower.I_xx')
        """
        table = read_toml(path, _Table)
        try:
            priority = _from_table(table, mechanism.parameter_names[: mechanism.num_energy_parameters])
            priority.indices(mechanism.parameter_names[: mechanism.num_energy_parameters])
        except InputError as error:
            raise FileError(f"{path}: {error}") from error
        return priority

    def indices(self, parameter_names: Sequence[str]) -> tuple[int, ...]:
        """
        Return the indices of the parameters in the order of their removal.

        Parameters
        ----------
        parameter_names : sequence of str
            Names of all P inertial parameters, without friction.

        Returns
        -------
        tuple of int
            Indices (P,), the first removed first.

        Raises
        ------
        NotFoundError
            If the priority names an unknown parameter.
        InputError
            If a name is given twice or is no inertial parameter.

        Examples
        --------
        >>> adaptctl.Priority(order=("b.m",), keep=("a.m",)).indices(("a.m", "a.mc_x", "b.m"))
        (2, 1, 0)
        """
        named = (*self.order, *self.keep)
        _validate_known(named, parameter_names, "parameter")
        _validate_once(named, "parameter")
        given = set(named)
        rest = [name for name in _default_order(parameter_names) if name not in given]
        place = {name: i for i, name in enumerate(parameter_names)}
        if len(place) < len(parameter_names):
            _validate_once(parameter_names, "parameter")
        return tuple(place[name] for name in (*self.order, *rest, *reversed(self.keep)))


def or_default(priority: Priority | None) -> Priority:
    """The given priority, or an empty one for None."""
    if not isinstance(priority, Priority | None):
        raise InputError(f"priority: expected a Priority or None, got {printable(repr(priority))}")
    return Priority() if priority is None else priority


class _Table(msgspec.Struct, forbid_unknown_fields=True):
    schema: Literal["adaptctl/priority/1"]
    order: list[str] | None = None
    keep: list[str] = []
    kinds: list[str] | None = None
    links: list[str] | None = None
    first: Literal["kinds", "links"] = "kinds"
    grid: dict[str, list[float]] | None = None


def _from_table(table: _Table, parameter_names: Sequence[str]) -> Priority:
    keep = tuple(_our_name(name) for name in table.keep)
    by_kind = table.grid is None and (table.kinds is not None or table.links is not None)
    if (table.order is not None) + (table.grid is not None) + by_kind > 1 or (table.grid and table.kinds):
        raise InputError("give one of: order; kinds and links; grid (with links, if they are in another order)")
    if table.grid is not None:
        return Priority(_grid_order(table.grid, _links(table, parameter_names), keep), keep)
    if by_kind:
        return Priority(_product_order(table, parameter_names, keep), keep)
    if table.order is None and not keep:
        raise InputError("empty priority; give order, keep, kinds, links or grid")
    return Priority(tuple(_our_name(name) for name in table.order or ()), keep)


def _links(table: _Table, parameter_names: Sequence[str]) -> list[str]:
    parts = (name.rpartition(".") for name in parameter_names)
    known = list(dict.fromkeys(link for link, _, kind in parts if kind in KINDS))
    links = known if table.links is None else table.links
    _validate_known(links, known, "link")
    _validate_once(links, "link")
    return links


def _product_order(table: _Table, parameter_names: Sequence[str], keep: Sequence[str]) -> tuple[str, ...]:
    links = _links(table, parameter_names)
    kinds = _kinds(KINDS if table.kinds is None else table.kinds)
    if table.first == "kinds":
        names = [f"{link}.{kind}" for kind in kinds for link in links]
    else:
        names = [f"{link}.{kind}" for link in links for kind in kinds]
    return tuple(name for name in names if name not in keep)


def _grid_order(grid: Mapping[str, Sequence[float]], links: Sequence[str], keep: Sequence[str]) -> tuple[str, ...]:
    numbers: dict[float, str] = {}
    for kind, (given, row) in zip(_kinds(grid), grid.items(), strict=True):
        if len(row) != len(links):
            raise InputError(f"grid: row {given} has {len(row)} numbers, expected {len(links)}: one for each link")
        for link, number in zip(links, row, strict=True):
            name = f"{link}.{kind}"
            if number in numbers:
                raise InputError(f"grid: the number {number:g} is given at {numbers[number]} and at {name}")
            numbers[number] = name
    return tuple(numbers[number] for number in sorted(numbers) if numbers[number] not in keep)


def _our_name(name: str) -> str:
    link, dot, kind = name.rpartition(".")
    return link + dot + PAPER_KINDS.get(kind, kind)


def _kinds(given: Iterable[str]) -> list[str]:
    kinds = [PAPER_KINDS.get(kind, kind) for kind in given]
    _validate_known(kinds, KINDS, "kind of parameter")
    _validate_once(kinds, "kind of parameter")
    return kinds


def _default_order(parameter_names: Sequence[str]) -> tuple[str, ...]:
    """Kind by kind, rotors last."""
    groups: dict[str, list[str]] = {kind: [] for kind in (*KINDS, "rotor_inertia")}
    for name in parameter_names:
        group = groups.get(name.rpartition(".")[2])
        if group is None:
            raise InputError(
                f"parameter_names: {printable(repr(name))}: expected an inertial parameter, such as 'link1.m', or a "
                "rotor inertia"
            )
        group.append(name)
    return tuple(name for group in groups.values() for name in group)


def _validate_known(given: Sequence[str], known: Sequence[str], what: str) -> None:
    for name in given:
        if name not in known:
            raise NotFoundError(f"unknown {what} {name!r}; {suggestion(name, known)}")


def _validate_once(given: Sequence[str], what: str) -> None:
    for name in given:
        if given.count(name) > 1:
            raise InputError(f"{what} {name!r} is given more than once")


def suggestion(name: str, known: Sequence[str]) -> str:
    """Return a hint for an unknown name: the closest known one, or a list."""
    from difflib import get_close_matches  # here, since only errors need it

    close = get_close_matches(name, known, n=1)
    return f"did you mean {close[0]!r}?" if close else f"known names: {_listed(known)}"


def _listed(names: Sequence[str], most: int = 20) -> str:
    shown = ", ".join(names[:most])
    return f"{shown}, ... ({len(names)} in all)" if len(names) > most else shown
