"""Commands of the package, in this process."""

from typer.testing import CliRunner

from pdsurrogate.cli import app


def invoke(*words):
    """What a command does and prints."""
    return CliRunner().invoke(app, list(map(str, words)))


def commanded(*words, status=0):
    """The same of one that ends with a status."""
    done = invoke(*words)
    assert done.exit_code == status, done.output
    return done
