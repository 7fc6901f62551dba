"""Entry of a law that is somebody's own, in a process of its own, which the law may end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from typing import IO, cast

import msgspec

from adaptctl.contest.entries import ContestEntry, Row


def rows_alone(entry: ContestEntry) -> list[Row]:
    """Rows of an entry, computed in a process that ends with this one."""
    asked = [sys.executable, "-m", "adaptctl.contest.own_process"]
    with subprocess.Popen(asked, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        asking, answering = cast("IO[bytes]", child.stdin), cast("IO[bytes]", child.stdout)
        asking.write(msgspec.json.encode(entry) + b"\n")
        asking.flush()
        answer = answering.read()
        code = child.wait()  # before its input ends
    if code or not answer:
        reason = f"ended the process that ran it, with code {code}"
        return [row for name in entry.conditions for row in entry.failed(name, reason)]
    rows: list[Row] = json.loads(answer)
    return rows


def _end_with_parent() -> None:
    while os.read(0, 1):
        pass
    os._exit(1)


def main() -> None:
    """Write the rows of the entry that is the first line of the input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # which ends the parent, and so this process
    with os.fdopen(os.dup(1), "w") as answer:
        os.dup2(2, 1)  # what a law prints is no answer
        entry = msgspec.json.decode(sys.stdin.buffer.readline(), type=ContestEntry)
        threading.Thread(target=_end_with_parent, daemon=True).start()
        json.dump(entry.rows(), answer)


if __name__ == "__main__":
    main()
