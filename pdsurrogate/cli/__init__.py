"""The command line: words and exit statuses, no physics.

Exit status 0: done; 1: the run failed, what was reached is saved; 2: bad input, one line on standard error;
130: interrupted, or ended by --max-time, a checkpoint is left.
"""

import os
import sys

from . import comparing, materials, running, showing, stress_test, studies, surrogates  # noqa: F401  (each adds its commands)
from .application import app, err, shared
from .interrupts import end_soon_after_interrupts


def main() -> None:
    """Entry point."""
    end_soon_after_interrupts(shared)
    try:
        try:
            app()
        finally:
            # Here, not when the interpreter ends: what has not been written yet may fail, too.
            sys.stdout.flush()
    except OSError as error:  # standard output on a full disk; what commands write to folders they name themselves
        err.print(f"[red]pdsurrogate:[/] {error.filename or 'standard output'}: {error.strerror}", soft_wrap=True)
        # What is left in the buffer is not tried again at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
