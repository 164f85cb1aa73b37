"""Versioned artefacts: cards, digests, safe reading and atomic writing."""

from .card import SCHEMA_VERSION, Card
from .store import (
    ArtifactError,
    find_artifact,
    list_artifacts,
    load_card,
    load_pipeline,
    load_surrogate,
    new_artifact,
    save_artifact,
    surrogate_for,
)

__all__ = [
    "SCHEMA_VERSION",
    "ArtifactError",
    "Card",
    "find_artifact",
    "list_artifacts",
    "load_card",
    "load_pipeline",
    "load_surrogate",
    "new_artifact",
    "save_artifact",
    "surrogate_for",
]
