"""Commands of the package, in this process."""

import shlex

from typer.testing import CliRunner

from pdsurrogate.cli import app


def words_of(given):
    """Words of a command: texts with blanks are read as a shell reads them, lists are opened."""
    if isinstance(given, list | tuple):
        return [word for one in given for word in words_of(one)]
    text = str(given)
    return shlex.split(text) if " " in text else [text]


def invoke(*words):
    """What a command does and prints."""
    return CliRunner().invoke(app, words_of(words))


def commanded(*words, status=0):
    """The same of one that ends with a status."""
    done = invoke(*words)
    assert done.exit_code == status, done.output
    return done
