"""Reaction of a service to SIGTERM, SIGINT and SIGHUP, on a separate thread.

A Python signal handler runs between two instructions of the main thread: not while a library compiles or waits there,
and an exception raised in it may pass through foreign code, which aborts the process. Here the handlers do nothing;
the interpreter writes each signal's number into a pipe, and a thread that reads the pipe acts.
"""

import os
import signal
import threading
from collections.abc import Callable

ENDS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
"""Signals that end a service in order; SIGHUP, of a terminal that is closed, unless `nohup` has it ignored."""


class Ending:
    """Reaction to the signals `ENDS`: exit at once with code 0, until `prepared` sets a function to call instead."""

    def __init__(self) -> None:
        self._stop: Callable[[], None] | None = None
        self._asked = self._watching = False
        self._lock = threading.Lock()

    def watch(self) -> None:
        """Begin to react to signals; call on the main thread, before other imports. A second call does nothing."""
        if self._watching:
            return
        self._watching = True
        reader, writer = os.pipe()
        os.set_blocking(writer, False)
        for number in ENDS:
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, _nothing)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        threading.Thread(target=self._read, args=(reader,), name="ending", daemon=True).start()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDS)  # whoever starts services holds them back until here

    def prepared(self, stop: Callable[[], None]) -> None:
        """Let a signal call ``stop`` on a separate thread in place of an exit; call it now if a signal came before."""
        with self._lock:
            self._stop = stop
            asked = self._asked
        if asked:
            stop()

    def _read(self, reader: int) -> None:
        while True:
            for number in os.read(reader, 64):
                if number in ENDS:
                    self._act()

    def _act(self) -> None:
        with self._lock:
            self._asked, stop = True, self._stop
            if stop is None:
                os._exit(0)  # still preparing: nothing to finish
        stop()


def _nothing(number: int, frame: object) -> None:
    return


ENDING = Ending()
"""Handler of the signals `ENDS` of this process."""
