"""``python -m pdsurrogate``, and the command ``pdsurrogate``."""

import sys


def main() -> None:
    """Load the commands, which takes a second in which Ctrl-C may come, and run one."""
    try:
        from .cli import main as command

        command()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
