"""`exodrake` and `python -m exodrake`: Ctrl-C and SIGTERM end every command with one line and status 130."""

import contextlib
import logging
import os
import signal
import sys
import threading
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
AGAIN = 0.1  # s, for the callback to return: assumed
received: list[int] = []


class Interrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM. After a bare KeyboardInterrupt, even one that was caught, Python may end with SIGINT."""


def interrupt(number: int, _: Any) -> None:
    """Signal handler."""
    received.append(number)
    logging.disable()  # libraries that are interrupted while they are imported log it
    raise Interrupted


def raise_again(report: Any) -> None:
    """Raise an interrupt again that fell into a callback, where Python can only report it; `sys.unraisablehook`."""
    if isinstance(report.exc_value, Interrupted):
        main = threading.main_thread().ident
        threading.Timer(AGAIN, signal.pthread_kill, (main, signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(report)


def run() -> None:
    """Entry point of the console script."""
    while (last := os.open(os.devnull, os.O_RDWR)) <= 2:  # no file takes the place of a closed stream
        pass
    os.close(last)
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
            signal.signal(number, interrupt)
    sys.unraisablehook = raise_again
    try:
        from exodrake.cli.main import main

        main()
    except (KeyboardInterrupt, Exception) as error:  # an interrupted import of a library in C++ is an ImportError
        if not received and isinstance(error, Exception):
            raise
        leave()
        with contextlib.suppress(OSError):
            print("interrupted", file=sys.stderr)
        sys.exit(130)
    finally:
        leave()


def leave() -> None:
    """The work is done: signals no longer end it, and output that nobody takes (closed pipe, full disk) is dropped."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        except AttributeError:  # no such stream
            pass


if __name__ == "__main__":
    home = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
    if not sys.flags.safe_path and os.path.realpath(sys.path[0]) != home:
        del sys.path[0]  # the current folder, which `python -m` puts first: what lies beside the data must not run
    run()
