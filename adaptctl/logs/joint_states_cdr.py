"""ROS 2's joint states in CDR, many of one layout at a time, as rosbags takes long to decode each by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array

LITTLE_ENDIAN, BODY, STAMPS = b"\x00\x01\x00\x00", 4, 8
"""head of a message, and bytes of it and of the stamp after it"""
FIELDS = ("position", "velocity", "effort")
AT_ONCE, MAX_LAYOUTS = 1024, 8
"""messages that are decoded at a time, and layouts that are known"""
Message: TypeAlias = tuple[int, bytes]
"""time in ns at which a message was logged, and its bytes"""


class JointStates(NamedTuple):
    """Messages of the same joints: stamps (n,) in ns, of the message and of the log, and numbers (n, k) by field."""

    name: Sequence[str]
    stamps: NDArray[np.int64]
    logged: NDArray[np.int64]
    rows: dict[str, Array]


class _Layout(NamedTuple):
    """Layout of messages: what is the same in all of them, and the places of their numbers."""

    name: Sequence[str]
    same: tuple[tuple[slice, bytes], ...]
    places: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, raw: bytes, message: Any) -> _Layout | None:
        """Layout of a message and of what it is decoded to; None of any that is not as expected."""
        place = BODY + STAMPS
        for text in (message.header.frame_id, None, *message.name):
            place = -(-place // 4) * 4 + 4 + (0 if text is None else len(text.encode()) + 1)
        fixed, places = [slice(0, BODY)], []
        start = BODY + STAMPS
        for field in FIELDS:
            values = np.asarray(getattr(message, field), dtype="<f8")
            place = -(-place // 4) * 4 + 4
            fixed.append(slice(start, place))
            place += (place - BODY) % 8 if len(values) else 0
            places.append((place, len(values)))
            if raw[place : place + values.nbytes] != values.tobytes():
                return None
            start = place = place + values.nbytes
        if raw[:BODY] != LITTLE_ENDIAN or len(raw) != place:
            return None
        return cls(message.name, tuple((part, raw[part]) for part in fixed), tuple(places))

    def has(self, raw: NDArray[np.uint8]) -> bool:
        """True if all messages (n, bytes) of a size are of this layout."""
        return all(bool((raw[:, part] == np.frombuffer(known, dtype=np.uint8)).all()) for part, known in self.same)

    def decoded(self, logged: Sequence[int], raw: NDArray[np.uint8]) -> JointStates:
        """Messages (n, bytes) of this layout."""
        sec = np.ascontiguousarray(raw[:, BODY : BODY + 4]).view("<i4")[:, 0].astype(np.int64)
        nanosec = np.ascontiguousarray(raw[:, BODY + 4 : BODY + 8]).view("<u4")[:, 0]
        each = zip(FIELDS, self.places, strict=True)
        rows = {field: np.ascontiguousarray(raw[:, a : a + 8 * k]).view("<f8") for field, (a, k) in each}
        return JointStates(self.name, sec * 1_000_000_000 + nanosec, np.array(logged, dtype=np.int64), rows)


def joint_states(
    messages: Iterable[Message], decode: Callable[[bytes], Any]
) -> Iterator[tuple[int, Any] | JointStates]:
    """Messages, many at a time where those of a size have one layout, else one by one."""
    left, known = iter(messages), dict[int, _Layout]()
    while part := list(islice(left, AT_ONCE)):
        sizes = {len(raw) for _, raw in part}
        each = [part] if len(sizes) == 1 else [[one for one in part if len(one[1]) == size] for size in sizes]
        found = [_alike(own, decode, known) for own in each]
        alike = [states for states in found if states is not None]
        # Messages of the same joints stay in order.
        if len({frozenset(states.name) for states in alike}) == len(sizes):
            yield from alike
        else:
            yield from ((time, decode(raw)) for time, raw in part)


def _alike(
    messages: Sequence[Message], decode: Callable[[bytes], Any], known: dict[int, _Layout]
) -> JointStates | None:
    """Messages of one size, if all have one layout, which is known or that of the first."""
    logged, each = zip(*messages, strict=True)
    raw = np.frombuffer(b"".join(each), dtype=np.uint8).reshape(len(each), len(each[0]))
    layout = known.get(len(each[0]))
    if layout is None or not layout.has(raw):
        layout = _Layout.of(each[0], decode(each[0]))
    if layout is None or not layout.has(raw):
        return None
    if len(known) == MAX_LAYOUTS:
        known.clear()
    known[len(each[0])] = layout
    return layout.decoded(logged, raw)
