"""ROS 2's joint states in CDR, many of one layout at a time, as rosbags takes long to decode each by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array

LITTLE_ENDIAN, BODY, STAMPS = b"\x00\x01\x00\x00", 4, 8
"""head of a message, and bytes of it and of the stamp after it"""
FIELDS = ("position", "velocity", "effort")
AT_ONCE, MAX_LAYOUTS = 4096, 8
"""messages that are decoded at a time, and layouts that are known besides the last one"""


class JointStates(NamedTuple):
    """Messages of the same joints: stamps (n,) in ns, of the message and of the log, and numbers (n, k) by field."""

    name: Sequence[str]
    stamps: NDArray[np.int64]
    logged: NDArray[np.int64]
    rows: dict[str, Array]


class _Layout(NamedTuple):
    """Layout of messages: their size, what is the same in all of them, and the places of their numbers."""

    name: Sequence[str]
    size: int
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
            place += -(place - BODY) % 8 if len(values) else 0
            places.append((place, len(values)))
            if raw[place : place + values.nbytes] != values.tobytes():
                return None
            start = place = place + values.nbytes
        if raw[:BODY] != LITTLE_ENDIAN or len(raw) != place:
            return None
        return cls(message.name, len(raw), tuple((part, raw[part]) for part in fixed), tuple(places))

    def has(self, raw: bytes) -> bool:
        """True for a message of this layout."""
        return len(raw) == self.size and all(raw[part] == known for part, known in self.same)

    def decoded(self, logged: Sequence[int], messages: Sequence[bytes]) -> JointStates:
        """Messages of this layout."""
        raw = np.frombuffer(b"".join(messages), dtype=np.uint8).reshape(len(messages), -1)
        sec = np.ascontiguousarray(raw[:, BODY : BODY + 4]).view("<i4")[:, 0].astype(np.int64)
        nanosec = np.ascontiguousarray(raw[:, BODY + 4 : BODY + 8]).view("<u4")[:, 0]
        each = zip(FIELDS, self.places, strict=True)
        rows = {field: np.ascontiguousarray(raw[:, a : a + 8 * k]).view("<f8") for field, (a, k) in each}
        return JointStates(self.name, sec * 1_000_000_000 + nanosec, np.array(logged, dtype=np.int64), rows)


class _Waiting(NamedTuple):
    """Messages of one layout that wait to be decoded, with the times in ns at which they were logged."""

    layout: _Layout
    logged: list[int]
    messages: list[bytes]

    def decoded(self) -> Iterator[JointStates]:
        """The messages that waited, if any."""
        if self.messages:
            yield self.layout.decoded(self.logged, self.messages)
        self.logged.clear()
        self.messages.clear()


def joint_states(
    messages: Iterable[tuple[int, bytes]], decode: Callable[[bytes], Any]
) -> Iterator[tuple[int, Any] | JointStates]:
    """Messages with the times in ns at which they were logged: those like one before many at a time."""
    runs: dict[int, _Waiting] = {}
    for time, raw in messages:
        run = runs.get(len(raw))
        if run is not None and run.layout.has(raw):
            run.logged.append(time)
            run.messages.append(raw)
            if len(run.messages) == AT_ONCE:
                yield from run.decoded()
            continue
        for own in runs.values():
            yield from own.decoded()
        message = decode(raw)
        yield time, message
        if (layout := _Layout.of(raw, message)) is not None:
            # Messages of the same joints stay in order: at most one layout of them is known, and few of others.
            others = {size: own for size, own in runs.items() if set(own.layout.name) != set(layout.name)}
            runs = {**dict(list(others.items())[-MAX_LAYOUTS:]), layout.size: _Waiting(layout, [], [])}
    for own in runs.values():
        yield from own.decoded()
