"""A tick on nested memories, written out for their layout, as `NamedTuple` writes out its own methods.

A memory's leaves are found, and put into a new one, by a few lines of Python made once, instead of by a search at every
tick that takes longer than the tick itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any


def written_out(tick: Callable[..., Sequence[Any]], memory: tuple[Any, ...]) -> Callable[..., tuple[Any, Any]]:
    """`step(state, p, v, reference)`: the torque and the state after it, from a tick that takes p, v, the reference's
    parts and the leaves of a state like `memory`, and returns the torque and the leaves after."""
    names: dict[str, Any] = {"tick": tick, "new": tuple.__new__}
    given: list[str] = []

    def taken_apart(part: Any) -> tuple[str, str]:
        """What a part is assigned to before the tick, and what it is made of after it."""
        if not isinstance(part, tuple):
            given.append(f"given{len(given)}")
            return given[-1], given[-1].replace("given", "after")
        if not part:
            kept = f"kept{len(names)}"
            names[kept] = part
            return "_", kept
        kind = f"kind{len(names)}"
        names[kind] = type(part)
        before, after = zip(*map(taken_apart, part), strict=True)
        return f"({', '.join(before)},)", f"new({kind}, ({', '.join(after)},))"

    before, after = taken_apart(memory)
    results = ", ".join(["torque", *(name.replace("given", "after") for name in given)])
    lines = (
        "def step(state, p, v, reference):",
        f"    {before} = state",
        "    reference_p, reference_v, reference_a = reference",
        f"    {results}, = tick({', '.join(['p, v, reference_p, reference_v, reference_a', *given])})",
        f"    return torque, {after}",
    )
    exec("\n".join(lines), names)
    step: Callable[..., tuple[Any, Any]] = names["step"]
    return step
