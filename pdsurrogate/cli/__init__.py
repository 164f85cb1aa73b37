"""The command line: words and exit statuses, no physics.

Exit status 0: done; 1: the run failed, what was reached is saved; 2: bad input, one line on standard error;
130: interrupted, a checkpoint is left.
"""

from . import comparing, materials, running, stress_test, toolkit  # noqa: F401  (each adds its commands)
from .application import app


def main() -> None:
    """Entry point."""
    app()
