"""Versioned artifacts: cards, digests, safe reading and atomic writing.

An artifact is a folder ``NAME/VERSION/`` of up to three files:

* ``card.json`` describes it, and states size and SHA-256 of the other files;
* ``surrogate.npz`` holds the constants of the surrogate, all that a simulation needs: plain arrays,
  read without pickle;
* ``pipeline.joblib`` is the fitted scikit-learn pipeline, for further training: a pickle, which can
  run code, loaded only on explicit trust.
"""

from .card import ArtifactError, Card
from .material import sourced, with_material
from .places import find_artifact, list_artifacts, own_folder
from .store import default_force, load_card, load_pipeline, load_surrogate, surrogate_for
