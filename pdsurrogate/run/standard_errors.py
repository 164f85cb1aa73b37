"""Standard errors of measurements by the covariance of a law that was fitted to measurements
(delta method, theory (86)).
"""

from collections.abc import Sequence

import numpy as np

from ..forces import FORCES, ForceModel
from ..forces.learned import Learned
from ..materials import Law
from ..materials.covariance import LawCovariance
from ..results import Result
from ..scenes import Scene
from .derivatives import differentiate
from .parameters import by_key, laws_of


def standard_errors(
    scene: Scene,
    models: Sequence[ForceModel],
    result: Result,
    outputs: Sequence[str],
    covariance: LawCovariance | None,
    level: int,
) -> dict[str, float]:
    """Return standard errors of measurements of a result, see `Result.standard_errors`; `models`
    are those of its run.
    """
    if not (covariance is None or isinstance(covariance, LawCovariance)):
        raise ValueError(
            "covariance: must be a LawCovariance, such as regressor.law_covariance(), not a"
            f" {type(covariance).__name__}"
        )
    if isinstance(outputs, str) or not outputs:
        raise ValueError(
            "outputs: must be a list of at least one name, such as ['nominal_stress'], not"
            f" {outputs!r}"
        )
    laws = laws_of(scene)
    found = [(covariance, laws)] if covariance is not None else _stated(models, laws)
    groups = [(one, *_same(one, some)) for one, some in found]
    parameters = [f"{key}.{name}" for one, keys, _ in groups for key in keys for name in one.names]
    # A surrogate holds for one shape of its law alone: the exact force has derivatives by all
    # numbers of the law.
    exact = {model.exact: FORCES[model.exact]() for model in models if isinstance(model, Learned)}
    models = [exact[model.exact] if isinstance(model, Learned) else model for model in models]
    rates = differentiate(scene, models, result, outputs, parameters, level)
    variance = np.zeros(len(rates.outputs))
    at = 0
    for one, keys, values in groups:
        # Regions of one law change together.
        own = (
            rates.derivatives[:, at : at + len(keys) * len(one.names)]
            .reshape(len(variance), len(keys), -1)
            .sum(axis=1)
        )
        at += len(keys) * len(one.names)
        variance += np.einsum("ij,jk,ik->i", own, values, own)
    return dict(zip(rates.outputs, np.sqrt(np.maximum(variance, 0.0)).tolist(), strict=True))


def _stated(
    models: Sequence[ForceModel], laws: dict[str, Law]
) -> list[tuple[LawCovariance, dict[str, Law]]]:
    """Return the covariance of each artifact with the laws of its regions, by key; raise
    ValueError if there is none.
    """
    found: dict[int, tuple[LawCovariance, dict[str, Law]]] = {}
    for key, model in by_key(models, "material").items():
        if isinstance(model, Learned) and model.covariance is not None and key in laws:
            found.setdefault(id(model), (model.covariance, {}))[1][key] = laws[key]
    if not found:
        raise ValueError(
            f"standard_errors: {models[0].name} has no covariance of its law, as artifacts have"
            " that were fitted to measurements that determine all parameters (pdsurrogate"
            " calibrate, or fit --data); for the law of a regressor give"
            " covariance=regressor.law_covariance()"
        )
    return list(found.values())


def _same(covariance: LawCovariance, laws: dict[str, Law]) -> tuple[list[str], np.ndarray]:
    """Return the keys of the laws that are that of a covariance, and the covariance in their
    unit of stress; ValueError for none.
    """
    scaled = {
        key: values
        for key, law in laws.items()
        if (values := covariance.scaled_to(law)) is not None
    }
    if not scaled:
        raise ValueError(
            f"standard_errors: the covariance is that of {covariance.law.describe()}, but the scene"
            f" has {', '.join(str(law.describe()) for law in laws.values())}: it must be the same"
            " law, at most in another unit of stress"
        )
    first = next(iter(scaled))
    return [key for key in scaled if laws[key] == laws[first]], scaled[first]
