"""Entry point of the command line: ``python -m pdsurrogate`` and the command ``pdsurrogate``."""

import gc
import sys


def main() -> None:
    """Run the command line; end with status 130 if Ctrl-C comes during the second that loading
    the commands takes.
    """
    # until the command is loaded: what is loaded stays, and a search for unused objects finds none
    gc.disable()
    try:
        from .cli import main as command

        command()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
