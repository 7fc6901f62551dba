"""Entry point of the command: interruptions end it in one line, from its first moment to its last."""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from types import FrameType

INTERRUPTED = 130


def run() -> NoReturn:
    """Run the command line and exit with its code."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)  # while packages are imported, there is nothing to keep
    from adaptctl.cli.main import main

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    code = main()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # all is done; packages close
    sys.exit(code)


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    os.write(2, b"adaptctl: interrupted\n")
    os._exit(INTERRUPTED)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


if __name__ == "__main__":
    run()
