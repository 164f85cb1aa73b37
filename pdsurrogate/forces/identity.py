"""What tells a force model from others: its name, and a digest of its numbers."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np

from .protocol import ForceModel


def identity_of(model: ForceModel) -> list[str]:
    """Name and digest of a model: models with the same give the same forces."""
    return [model.name, digest_of_model(model)]


def digest_of_model(model: ForceModel) -> str:
    """Digest of what a model evaluates, and of the members whose deviation is asked for."""
    payload = model.payload()
    if model.members:
        payload = {"runs": payload, "members": [[str(one.law), one.ratio, one.model.payload()] for one in model.members]}
    return digest_of(payload)


def digest_of(value: Any) -> str:
    """SHA-256 of arrays, numbers and text, in mappings and lists of any depth; the order of keys does not count."""
    return hashlib.sha256(json.dumps(_plain(value), sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, str | int | float | bool | None) else str(value)
