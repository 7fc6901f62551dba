"""Names of a log's columns for each joint, from patterns, lists and numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise, product
from shlex import quote

from adaptctl.errors import InputError
from adaptctl.logs.table import LogTable

RANGE = re.compile(r"(\d+)(?:-(\d+))?$")
WORDS = {
    "position": ("position", "pos", "q", "p", "theta", "angle", "act"),
    "torque": ("torque", "trq", "tor", "tau", "effort", "moment", "current", "cur", "m"),
    "time": ("time", "timestamp", "stamp", "t", "seconds", "secs", "sec", "ms", "us", "ns"),
}
"""words in names of columns of each kind, the likeliest first"""
CURRENTS = ("current", "currents", "cur", "amps", "ampere")
"""words in names of what is only proportional to a torque"""
WANTED = ("target", "desired", "reference", "ref", "command", "commanded", "cmd")
"""words in names of what was asked for, not measured"""
NAMES, UNIT_TO_GIVE = "NAMES", "UNIT"
"""what stands where names of columns tell neither which are meant nor their unit"""
WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
UNIT = re.compile(r"[\[(][^\d\])]*[\])]")


def joint_names(pattern: str, joints: list[str], log: LogTable, what: str = "columns") -> list[str]:
    """Names of columns, one for each joint: by a pattern with {joint}, {} or {0}, or a list of names and numbers."""
    if "{" in pattern:
        return [
            pattern.replace("{joint}", joint).replace("{}", str(j + 1)).replace("{0}", str(j))
            for j, joint in enumerate(joints)
        ]
    found = [name for part in pattern.split(",") for name in _listed(part.strip(), log)]
    if pattern in log.columns or (len(found) == 1 and "," not in pattern):
        return (found[:1] if len(found) == 1 else [pattern]) * len(joints)
    if len(found) != len(joints):
        raise InputError(
            f"{log.source}: columns: {what}: {pattern} has {len(found)} columns, but the robot {len(joints)} joints "
            f"({', '.join(joints)})"
        )
    return found


def column_name(given: str, log: LogTable) -> str:
    """Name of one column, given by its name or number."""
    found = list(_listed(given, log))
    return found[0] if len(found) == 1 else given


def _listed(part: str, log: LogTable) -> Iterator[str]:
    """Names of a part of a list: a name, or a number from 1, or a range of such."""
    ends = RANGE.match(part)
    if part in log.columns or ends is None:
        yield part
        return
    names, first, last = list(log.columns), int(ends[1]), int(ends[2] or ends[1])
    if not 1 <= first <= last <= len(names):
        raise InputError(f"{log.source}: columns: {part}: expected numbers from 1 to {len(names)}, the first the least")
    yield from names[first - 1 : last]


def likely_pair(what: str, joints: list[str], log: LogTable) -> str:
    """Word of --columns for positions or torques, by a pattern that the log has columns of, else NAMES to replace."""
    found = (
        pattern
        for name in _likely(what, log)
        for text, mark in (("1", "{}"), ("0", "{0}"), (joints[0], "{joint}"))
        if text in name and (pattern := mark.join(name.rsplit(text, 1)))
        if all(other in log.columns for other in joint_names(pattern, joints, log))
    )
    return as_word(f"{what}={next(found, NAMES)}")


def likely_time(log: LogTable) -> str:
    """Word of --columns for the time, by a column that may have it."""
    return as_word(f"time={next(_likely('time', log), 'NAME')}")


def _likely(what: str, log: LogTable) -> Iterator[str]:
    """Names of columns with a word for a quantity, the likeliest first and those of wanted values last."""
    words = {name: words_of(name) for name in log.columns}
    others = [word for other, kinds in WORDS.items() if other != what for word in kinds if len(word) > 1]
    for wanted, kind in product((False, True), WORDS[what]):
        for name, own in words.items():
            told = len(kind) == 1 and any(word in others for word in own)  # a letter counts where no word does
            if kind in own and not told and wanted == any(word in WANTED for word in own):
                yield name


def words_of(name: str) -> list[str]:
    """Words of a column's name without its unit, in small letters."""
    return [word.lower() for word in WORD.findall(UNIT.sub("", name))]


def as_word(pair: str) -> str:
    """Pair as a shell takes it."""
    return quote(pair) if re.search(r"[\s()&;|<>*?$`'\"!#]", pair) else pair


def offer(log: LogTable, joints: int) -> str:
    """Mapping by numbers that a log without names may have, in the words of --columns."""
    whole, rest = divmod(len(log.columns), joints)
    parts = {2: ("position", "torque"), 3: ("position", "velocity", "torque")}.get(whole)
    if parts is None or rest > 1:
        return "--columns time=1 position=2-4 torque=5-7, with the numbers of its columns"
    ends = [rest + joints * k for k in range(whole + 1)]
    ranges = [f"{a + 1}-{b}" if joints > 1 else f"{b}" for a, b in pairwise(ends)]
    pairs = " ".join(f"{part}={numbers}" for part, numbers in zip(parts, ranges, strict=True))
    kinds = {2: "positions, torques", 3: "positions, velocities, torques"}[whole]
    if rest:
        return f"if they are time, {kinds}: --columns time=1 {pairs}"
    return f"if they are {kinds}: --columns {pairs} --sample-rate HZ"
