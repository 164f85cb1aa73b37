"""The command line: words and exit statuses, no physics.

Exit status 0: done; 1: the run failed, and what it reached is saved; 2: bad input, one line on standard error; 130: interrupted, or
ended by --max-time, and a checkpoint is left.
"""

import os
import sys

from .application import app
from .endings import FAILED, end_soon_after_interrupts
from .terminal import complain


def main() -> None:
    """Run the command that the arguments of the process name."""
    end_soon_after_interrupts()
    try:
        try:
            app()
        finally:
            # Flushed here, not at the exit of the interpreter: this may fail, too.
            sys.stdout.flush()
    except OSError as error:  # standard output on a full disk; commands name the folders that they write to
        complain(f"{error.filename or 'standard output'}: {error.strerror}")
        # The interpreter shall not try again to write what is left in the buffer.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILED)
