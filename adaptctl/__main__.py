"""Entry point of the command."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, NoReturn

from adaptctl.cli.heartbeat import heartbeat
from adaptctl.cli.interruption import keep_without_terminal, not_ignored, raised, repeated_where_lost

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import Any

    Handler = Callable[[int, FrameType | None], Any] | signal.Handlers

INTERRUPTED = 130
COLLECTED = 1_000_000, 10, 10
"""Thresholds of the collector of cycles, which equations do not have: to look for them took a tenth of a command."""


def run() -> NoReturn:
    """Run the command line and exit with its code."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # more only wait for each other, at matrices of this size
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")  # its own keeps what is freed
    os.environ.setdefault("MIMALLOC_PURGE_DELAY", "0")  # as rerun's does
    _on_signals(_leave)  # while packages are imported, there is nothing to keep
    gc.set_threshold(*COLLECTED)
    keep_without_terminal()
    heartbeat.start()
    main = _main()
    code = INTERRUPTED
    with suppress(KeyboardInterrupt):  # between two commands' own ways to take it
        repeated_where_lost()
        _on_signals(raised)
        code = main()
    _on_signals(signal.SIG_IGN)  # all is done; packages close
    heartbeat.stop()
    _exit_at_once(code)


def _exit_at_once(code: int) -> NoReturn:
    """Exit without taking apart what was computed, which is done object by object and takes up to seconds."""
    atexit._run_exitfuncs()
    for stream in filter(None, (sys.stdout, sys.stderr)):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def _main() -> Callable[[], int]:
    """Command line, imported at need."""
    from adaptctl.errors import MissingExtraError
    from adaptctl.optional_packages import needed

    try:
        with needed("the command line"):
            from adaptctl.cli.main import main
    except MissingExtraError as error:
        sys.exit(f"adaptctl: {error}")
    return main


def _on_signals(handler: Handler) -> None:
    for number in not_ignored():
        signal.signal(number, handler)


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    heartbeat.stop()
    with suppress(OSError):  # The terminal may be gone.
        os.write(2, b"adaptctl: interrupted\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    run()
