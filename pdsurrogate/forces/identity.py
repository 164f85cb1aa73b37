"""Identity of a force model: its name, and a digest (SHA-256) of its learned numbers."""

import hashlib
import json
from typing import Any

import numpy as np

from .protocol import ForceModel


def identity_of(model: ForceModel) -> list[str]:
    """Return name and digest of a model; models that agree in both have the same forces."""
    return [model.name, digest_of_model(model)]


def digest_of_model(model: ForceModel) -> str:
    """Return a digest of the learned numbers of a model."""
    return digest_of(model.payload())


def digest_of(value: Any) -> str:
    """Return the SHA-256 of arrays, numbers and text, in mappings and lists of any depth; the
    order of keys does not count.
    """
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=_plain).encode()).hexdigest()


def _plain(value: Any) -> list | str:
    """Return a stand-in that JSON can hold: shape and digest of an array, or ``str`` of any
    other value.
    """
    if isinstance(value, np.ndarray):
        return [value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    return str(value)
