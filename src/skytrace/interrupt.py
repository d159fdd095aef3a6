"""Ctrl-C that is neither lost nor turned into something else: it waits where an exception would not be heard."""

from __future__ import annotations

import re
import signal
import threading
import time
from types import FrameType

_AGAIN_S = 0.02
_PATIENCE_S = 1.0
# llvmlite's C++ calls back into Python while it loads machine code, and an exception ends there unheard. Extension
# modules interrupted while they are imported turn it into an ImportError.
_DEAF = re.compile(r"-packages[/\\]llvmlite[/\\]|<frozen importlib\.")
# Numba's dispatcher turns an exception in its own Python parts into a SystemError. They take microseconds, but for
# the first call ever, which compiles: that is too long to wait for, and safe to interrupt.
_HARD_OF_HEARING = re.compile(r"-packages[/\\]numba[/\\]")


class _Handler:
    """Raises KeyboardInterrupt, or sends itself the signal again a little later."""

    def __init__(self) -> None:
        self._waiting_since_s: float | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        now_s = time.monotonic()
        if self._waiting_since_s is None:
            self._waiting_since_s = now_s
        patient = now_s - self._waiting_since_s < _PATIENCE_S
        if _within(_DEAF, frame) or (patient and _within(_HARD_OF_HEARING, frame)):
            again = threading.Timer(_AGAIN_S, _send, (number,))
            again.daemon = True
            again.start()
            return
        self._waiting_since_s = None
        raise KeyboardInterrupt


def install() -> None:
    """Handle SIGINT, unless whoever started the program chose to ignore it. Only for the main thread."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _Handler())


def ignore() -> None:
    """The work is done and told: Ctrl-C must not change the exit code while Python clears up."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _send(number: int) -> None:
    if hasattr(signal, "pthread_kill"):  # wakes the main thread from sleeping or waiting, too
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        signal.raise_signal(number)


def _within(files: re.Pattern[str], frame: FrameType | None) -> bool:
    """Whether a frame or one of its callers belongs to any of the files."""
    while frame is not None:
        if files.search(frame.f_code.co_filename):
            return True
        frame = frame.f_back
    return False
