"""Joint states in CDR that are decoded many at a time are those that rosbags decodes one by one."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from adaptctl.logs import joint_states_cdr
from adaptctl.logs.joint_states_cdr import JointStates, joint_states
from adaptctl.logs.ros_bag import JOINT_STATE, joint_table

TYPES = get_typestore(Stores.LATEST)
STATE, HEADER = TYPES.types[JOINT_STATE], TYPES.types["std_msgs/msg/Header"]
STAMP = TYPES.types["builtin_interfaces/msg/Time"]
decode = partial(TYPES.deserialize_cdr, typename=JOINT_STATE)
rng = np.random.default_rng(1)


def raw(k: int, names: list[str], fields: str = "pve", frame: str = "") -> tuple[int, bytes]:
    """Message and the time at which it was logged."""
    stamp = STAMP(sec=1_726_000_000 + k, nanosec=4_000_000_000 - k)
    rows = {field: rng.normal(size=len(names) * (field[0] in fields)) for field in joint_states_cdr.FIELDS}
    message = STATE(header=HEADER(stamp=stamp, frame_id=frame), name=names, **rows)
    return 10**9 * k, bytes(TYPES.serialize_cdr(message, JOINT_STATE))


ARM, TURNED, HAND = ["a", "bc", "elbow"], ["elbow", "a", "bc"], ["finger"]
LOGS: dict[str, list[tuple[int, bytes]]] = {
    "alike": [raw(k, ARM) for k in range(20)],
    "two publishers": [raw(k, ARM if k % 3 else HAND, "pe") for k in range(30)],
    "fields that come and go": [raw(k, ARM, "pe" if k % 7 else "p") for k in range(30)],
    "as many numbers of another field": [raw(k, ARM, "pe" if k % 7 else "pv") for k in range(30)],
    "another order of joints": [raw(k, ARM if k < 9 else TURNED) for k in range(20)],
    "another frame": [raw(k, ARM, frame="base" if k % 5 else "wrist") for k in range(20)],
    "layouts of many sizes": [raw(k, [f"j{i}" for i in range(1 + k % 12)]) for k in range(36)],
}


@pytest.mark.parametrize("messages", LOGS.values(), ids=LOGS)
def test_tables_are_the_same(messages: list[tuple[int, bytes]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joint_states_cdr, "AT_ONCE", 4)
    many = 200 * [ARM] if messages is LOGS["layouts of many sizes"] else []  # of which one robot is the most frequent
    given = [*messages, *(raw(1000 + k, names) for k, names in enumerate(many))]
    found = joint_table("log", joint_states(given, decode))
    one_by_one = joint_table("log", ((time, decode(data)) for time, data in given))
    assert list(found.columns) == list(one_by_one.columns)
    assert found.notes == one_by_one.notes
    for name, values in one_by_one.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)


def test_most_messages_are_decoded_together(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bytes] = []

    def counted(data: bytes) -> Any:
        asked.append(data)
        return decode(data)

    parts = list(joint_states(LOGS["two publishers"], counted))
    assert len(asked) == 2
    assert sorted(len(part.stamps) for part in parts if isinstance(part, JointStates)) == [10, 20]
    monkeypatch.setattr(joint_states_cdr, "AT_ONCE", 4)
    asked.clear()
    parts = list(joint_states([raw(k, ARM, frame="base" if k < 8 else "hand") for k in range(16)], counted))
    assert [type(part) for part in parts] == [JointStates] * 4
    assert len(asked) == 2  # the first of each frame, which is as long as the other


@pytest.mark.parametrize("length", range(1, 10))
@pytest.mark.parametrize("fields", ["pve", "p", "ve"])
def test_names_and_frames_of_any_length_have_a_layout(length: int, fields: str) -> None:
    """Numbers are at whole eights of bytes from the head on, whatever is before them."""
    message = raw(0, ["j" * length, "k"], fields, frame="f" * (length % 4))
    assert [type(part) for part in joint_states([message], decode)] == [JointStates]


def test_messages_that_end_later_have_no_layout() -> None:
    whole = [raw(k, ARM) for k in range(3)]
    longer = [(time, data + bytes(8)) for time, data in whole]
    found = [joint_states(some, lambda data: decode(data[: len(whole[0][1])])) for some in (whole, longer)]
    assert [{isinstance(part, JointStates) for part in parts} for parts in found] == [{True}, {False}]


def test_other_encodings_are_left_to_rosbags() -> None:
    message = decode(raw(0, ARM)[1])
    big = [(k, bytes(TYPES.serialize_cdr(message, JOINT_STATE, little_endian=False))) for k in range(3)]
    assert not any(isinstance(part, JointStates) for part in joint_states(big, decode))
