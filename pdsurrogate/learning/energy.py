"""Learning energies, a sheet's under plane stress and the isochoric one: samples, pipeline, errors, and the artefact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from sklearn.base import clone
from sklearn.model_selection import KFold
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils.validation import check_is_fitted

from ..arguments import check_is, check_seed, check_share, check_text, check_whole_number
from ..artifacts import save_artifact
from ..forces import Domain, EnergyNetwork, IsochoricNetwork, LearntEnergy
from ..forces.bond_energy import EnergySurrogate
from ..forces.learnt_energy import ENERGY_FEATURES, energy_shape
from ..materials import Law, plane_stress
from ..materials.law import checked_law
from .card_text import CardText
from .energy_form import EnergyForm, EnergySamples, checked_derivatives, checked_invariants
from .export import best_of
from .fitting import MEMBER_STATES, check_storing, check_validation, check_worth_storing, committee_of, versions
from .isochoric import ISOCHORIC
from .named import named
from .sampling import checked_range, hull_of, log_stretches, random_order, stretches_of_strain
from .sobolev import SobolevRegressor
from .target import InputAwareTargetRegressor
from .validation import strain_bins

ANCHOR = (0.0, 0.0)
"""Features at rest, where the energy is zero."""


@named()
def log_invariants(X) -> np.ndarray:
    """Log J and log(tr C/(2 J)), shape (n, 2)."""
    trace, J = checked_invariants(X, SHEET)
    return np.stack([np.log(J), np.log(trace / (2 * J))], axis=1)


@named()
def rubber_energy_size(features) -> np.ndarray:
    """(tr C + J^-2)/2 from the features."""
    x, u = features.T
    return np.exp(x + u) + np.exp(-2 * x) / 2


@named(("tr C", "J"), ("psi", "dpsi/dtr C", "dpsi/dJ"))
def derivatives_by_features(X, y) -> np.ndarray:
    """Energy and its derivatives by log J and log(tr C/(2 J)), from those by tr C and J."""
    (trace, J), (energy, by_trace, by_J) = checked_derivatives(X, y, SHEET)
    by_ratio = trace * by_trace
    return np.stack([energy, J * by_J + by_ratio, by_ratio], axis=1)


@named()
def derivatives_by_invariants(X, z) -> np.ndarray:
    """The inverse of `derivatives_by_features`."""
    trace, J = checked_invariants(X, SHEET)
    return np.stack([z[:, 0], z[:, 2] / trace, (z[:, 1] - z[:, 2]) / J], axis=1)


@named()
def _names(transformer, input_features):
    return np.asarray(ENERGY_FEATURES, dtype=object)


class _Sheet(EnergyForm):
    name = "energy"
    invariants, targets = derivatives_by_features.columns, derivatives_by_features.targets
    surrogate = EnergyNetwork
    stretch_range = (0.5, 5.0)
    n_units = 12
    flat = (0,)
    log_features = staticmethod(log_invariants)
    feature_names = staticmethod(_names)
    size = staticmethod(rubber_energy_size)
    derivatives_by_features = staticmethod(derivatives_by_features)
    derivatives_by_invariants = staticmethod(derivatives_by_invariants)

    @staticmethod
    def states(law: Law, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        trace, J = (stretches**2).sum(axis=1), stretches.prod(axis=1)
        J3 = plane_stress.volume_ratio(law, trace, J)
        p, q, _, _, energy = plane_stress.response(law, trace, J, J3)
        return np.stack([trace, J], axis=1), np.stack([energy, p / 2, q / J], axis=1)

    @staticmethod
    def draw(random: np.random.Generator, n_samples: int, low: float, high: float, near_rest: float) -> np.ndarray:
        return log_stretches(random, n_samples, low, high, near_rest)

    @staticmethod
    def of_strain(random: np.random.Generator, strains: tuple[float, float], low: float, high: float, n_samples: int) -> np.ndarray:
        return np.stack(stretches_of_strain(random, strains, low, high, n_samples), axis=1)

    @staticmethod
    def stresses(stretches: np.ndarray, first, second) -> np.ndarray:
        return principal_stresses(stretches, first, second)

    @staticmethod
    def derivatives(model: EnergySurrogate, law: Law, X: np.ndarray) -> np.ndarray:
        found = model.energy_derivatives(law, *X.T)
        return np.stack([found.psi, found.by_trace, found.by_area], axis=1)

    @staticmethod
    def stability(model: EnergySurrogate, law: Law, samples: EnergySamples) -> dict[str, float]:
        rest = model.energy_derivatives(law, np.array([2.0]), np.array([1.0]))
        least = _stability(model.energy_derivatives(law, *samples.X.T), samples)
        exact = _stability(_exact(law, samples), samples)
        return {
            "at_rest": float(max(abs(rest.psi[0]), abs(2 * rest.by_trace[0] + rest.by_area[0]))),
            "least_acoustic": least[0],
            "least_acoustic_exact": exact[0],
            "least_curvature": least[1],
            "least_curvature_exact": exact[1],
        }

    @staticmethod
    def shape(law: Law) -> dict[str, float]:
        return energy_shape(law)

    @staticmethod
    def bulk_range(law: Law, X: np.ndarray) -> tuple[float, float]:
        # J3^2 = J^2 C33 of the training states.
        bulk = plane_stress.volume_ratio(law, *X.T) ** 2
        return float(bulk.min()), float(bulk.max())

    @staticmethod
    def range_of(X: np.ndarray) -> tuple[float, float]:
        return range_of_stretches(*X.T)


SHEET = _Sheet()
"""Psi of a sheet under plane stress with C33 condensed out, a function of tr C and J in the plane."""

FORMS = (SHEET, ISOCHORIC)


def form_of(model: InputAwareTargetRegressor) -> EnergyForm | None:
    """Which energy a pipeline is of; None of a pipeline of something else."""
    return next((form for form in FORMS if model.func is form.derivatives_by_features), None)


def range_of_stretches(trace, J) -> tuple[float, float]:
    """Least and greatest principal stretch of states of a sheet with tr C and J."""
    total, difference = np.sqrt(trace + 2 * J), np.sqrt(np.maximum(trace - 2 * J, 0))
    return float((total - difference).min() / 2), float((total + difference).max() / 2)


def energy_design(
    law: Law,
    n_samples: int = 2000,
    stretch_range: tuple[float, float] | None = None,
    near_rest: float = 0.25,
    random_state: int = 0,
    isochoric: bool = False,
) -> EnergySamples:
    """States even in log-stretch, in random order, a share of them near rest.

    Those near rest have strains from 0.1 % to 30 % or as far as the range goes, even in the logarithm of the strain.

    Parameters
    ----------
    law : Law
    n_samples : int
    stretch_range : tuple of float, optional
        Of the principal stretches; 0.5 to 5, or 0.25 to 4 of three stretches of product 1.
    near_rest : float
        Share of states near rest.
    random_state : int
        Seed.
    isochoric : bool
        Whether the energy is W(I1bar, I2bar), for plane strain, space and every bulk modulus; else that of a sheet under plane stress.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.energy_design(pds.NeoHookean(), n_samples=300, stretch_range=(0.7, 2.0))
    >>> samples.design["stretch_range"]
    [0.7, 2.0]
    """
    checked_law(law)
    check_whole_number(n_samples, "n_samples", 1)
    check_share(near_rest, "near_rest")
    check_seed(random_state)
    form = ISOCHORIC if isochoric else SHEET
    low, high = checked_range(form.stretch_range if stretch_range is None else stretch_range)
    logs = form.draw(np.random.default_rng(random_state), n_samples, low, high, near_rest)
    design = {
        "name": form.name,
        "n_samples": n_samples,
        "stretch_range": [low, high],
        "near_rest": near_rest,
        "random_state": random_state,
    }
    samples = EnergySamples.of(law, np.exp(logs), design, form)
    if not np.isfinite(samples.y).all():
        raise ValueError(f"{law.name} ends before all states of stretches from {low:g} to {high:g}; see reachable_stretches")
    order = random_order(n_samples, near_rest, random_state)
    return replace(samples, X=samples.X[order], y=samples.y[order], stretches=samples.stretches[order])


def energy_pipeline(regressor: SobolevRegressor | None = None, isochoric: bool = False) -> InputAwareTargetRegressor:
    """A scikit-learn regressor from the invariants (columns of `EnergySamples.X`) to the energy and its derivatives.

    Of a sheet the regressor sees log J and log(tr C/(2 J)), of the isochoric energy log(I1bar/3) and log(I2bar/3), all zero at rest.  There
    the energy is zero by construction, and so is the stress: of a sheet since the derivative by log J is made zero, of isochoric invariants
    by itself.  Residuals are divided by the size of a rubber's energy, (tr C + J^-2)/2 or (I1bar + I2bar)/6.

    Parameters
    ----------
    regressor : SobolevRegressor, optional
        With 12 units by default, 8 of the isochoric energy; its `anchor`, `flat` and `size` are set here.
    isochoric : bool
        See `energy_design`.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.energy_design(pds.NeoHookean(), n_samples=300, stretch_range=(0.7, 2.0), isochoric=True)
    >>> model = pds.energy_pipeline(pds.SobolevRegressor(4, "algebraic", max_iter=30, random_state=0), isochoric=True)
    >>> model.fit(samples.X, samples.y).predict(samples.X).shape[0]
    300
    """
    if regressor is not None and not isinstance(regressor, SobolevRegressor):
        raise ValueError(f"an energy is learnt with its derivatives, by a SobolevRegressor, not by a {type(regressor).__name__}")
    form = ISOCHORIC if isochoric else SHEET
    inner = SobolevRegressor(form.n_units, random_state=0) if regressor is None else clone(regressor)
    inner.set_params(anchor=ANCHOR, flat=form.flat, size=form.size)
    features = FunctionTransformer(form.log_features, feature_names_out=form.feature_names, check_inverse=False)
    return InputAwareTargetRegressor(
        Pipeline([("features", features), ("regressor", inner)]),
        func=form.derivatives_by_features,
        inverse_func=form.derivatives_by_invariants,
    )


def network_of(model: InputAwareTargetRegressor) -> SobolevRegressor:
    """The network of an `energy_pipeline`, fitted or not.

    Raises
    ------
    ValueError
        If the pipeline is not of that make, so that it cannot become an energy surrogate.
    """
    pipeline = getattr(model, "regressor_", getattr(model, "regressor", None))
    form = form_of(model) if isinstance(model, InputAwareTargetRegressor) else None
    if (
        form is None
        or not isinstance(pipeline, Pipeline)
        or not isinstance(pipeline[-1], SobolevRegressor)
        or getattr(pipeline[0], "func", None) is not form.log_features
    ):
        raise ValueError("only an energy_pipeline, which ends in a SobolevRegressor, can become an energy surrogate")
    network = pipeline[-1]
    if (network.anchor, network.flat) != (ANCHOR, form.flat):
        raise ValueError(f"the network of an {form.name} has anchor {ANCHOR} and flat {form.flat}, not {network.anchor} and {network.flat}")
    return network


def energy_surrogate_of(model: InputAwareTargetRegressor, law: Law, samples: EnergySamples, name: str = "unsaved") -> LearntEnergy:
    """The surrogate of a fitted `energy_pipeline`: the same function, as plain arrays.

    Raises
    ------
    ValueError
        If the pipeline is not of that make, or not fitted, or of another energy than the samples.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> law = pds.NeoHookean()
    >>> samples = pds.energy_design(law, n_samples=300, stretch_range=(0.7, 2.0), isochoric=True)
    >>> model = pds.energy_pipeline(pds.SobolevRegressor(4, "algebraic", max_iter=30, random_state=0), isochoric=True)
    >>> pds.energy_surrogate_of(model.fit(samples.X, samples.y), law, samples)
    <IsochoricNetwork unsaved of neo-hookean>
    """
    check_text(name, "name")
    check_is(samples, EnergySamples, "samples", "energy_design draws")
    checked_law(law)
    network_of(model)
    if form_of(model) is not samples.form:
        raise ValueError(f"the pipeline is of an {form_of(model).name} and the samples are of an {samples.form.name}")
    found = energy_network(model, law, samples.design["stretch_range"], samples.X, name)
    hull = hull_of(samples.design)
    return found if hull is None else replace(found, domain=replace(found.domain, hull=hull))


def energy_network(model: InputAwareTargetRegressor, law: Law, stretch_range, X: np.ndarray, name: str = "unsaved") -> LearntEnergy:
    """The same from the range of principal stretches and the training states (columns `EnergyForm.invariants`)."""
    network, form = network_of(model), form_of(model)
    check_is_fitted(model)
    return form.surrogate(
        name,
        network.activation,
        np.ascontiguousarray(network.hidden_weights_),
        network.hidden_biases_.copy(),
        network.output_weights_.copy(),
        Domain(*stretch_range, *form.bulk_range(law, X)),
        law.name,
        form.shape(law),
    )


def principal_stresses(stretches, by_trace, by_J) -> np.ndarray:
    """Principal nominal stresses 2 psi_I lambda + psi_J J/lambda, shape (n, 2)."""
    return 2 * by_trace[:, None] * stretches + by_J[:, None] * stretches[:, ::-1]


def energy_errors(derivatives, samples: EnergySamples) -> dict:
    """Relative errors of a model's stress and energy on samples; `derivatives` are the energy and its derivatives by the invariants."""
    energy, first, second = derivatives
    exact = samples.form.stresses(samples.stretches, *samples.y.T[1:])
    error = np.linalg.norm(samples.form.stresses(samples.stretches, first, second) - exact, axis=1)
    size = np.sqrt((exact**2).sum(axis=1).mean())
    size_of_energy = np.sqrt((samples.y[:, 0] ** 2).mean())
    return {
        "rms": float(np.sqrt((error**2).mean()) / size),
        "max": float(error.max() / size),
        "energy_rms": float(np.sqrt(((energy - samples.y[:, 0]) ** 2).mean()) / size_of_energy),
    }


def evaluate_energy(
    model: EnergySurrogate | IsochoricNetwork,
    law: Law,
    stretch_range: tuple[float, float] | None = None,
    n_samples: int = 20_000,
    random_state: int = 1_000_003,
) -> dict:
    """Report of an energy surrogate against the exact energy, in double precision.

    Parameters
    ----------
    model : EnergySurrogate or IsochoricNetwork
    law : Law
    stretch_range : tuple of float, optional
        Of the principal stretches; the model's own domain by default.
    n_samples : int
    random_state : int
        Seed; choose one that no training used.

    Returns
    -------
    dict
        ``on_surface``: relative errors of the stress (``rms``, ``max``) and of the energy (``energy_rms``) over the box of stretches, even
        in their logarithms, of an isochoric energy over the part of it with product 1, where stresses are Kirchhoff's; ``by_strain``: the
        same by bins of greatest principal strain; ``at_rest``: size of energy and stress at rest;
        ``least_acoustic``: least second derivative of the energy along a rank-one change m (x) n of F, unit m and n, over the states (of an
        isochoric energy along those that keep the volume), with
        ``least_acoustic_exact``: a positive value means that short waves are stable (strong ellipticity).  Of a sheet
        ``least_curvature`` and
        ``least_curvature_exact``: least eigenvalue of the second derivative by the logarithms of the stretches, positive where the energy
        is convex in them; of an isochoric energy ``shear_modulus`` at rest, which is 1 of the law.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean-energy")
    >>> pds.evaluate_energy(model, pds.NeoHookean(), n_samples=500)["on_surface"]["energy_rms"] < 1e-3
    True
    """
    checked_law(law)
    if not isinstance(model, EnergySurrogate | IsochoricNetwork):
        raise TypeError(f"an energy surrogate is evaluated, such as energy_surrogate_of makes of a pipeline, not a {type(model).__name__}")
    form = ISOCHORIC if isinstance(model, IsochoricNetwork) else SHEET
    domain = model.domain
    own = (domain.least_stretch, domain.greatest_stretch) if domain else (0.5, 4.0)
    low, high = checked_range(own if stretch_range is None else stretch_range)
    samples = energy_design(law, n_samples, (low, high), 0.0, random_state, form is ISOCHORIC)

    def errors(samples):
        return energy_errors(form.derivatives(model, law, samples.X).T, samples)

    bins = []
    random = np.random.default_rng(random_state + 1)
    for strains in strain_bins(low, high):
        stretches = form.of_strain(random, strains, low, high, max(n_samples // 10, 100))
        bins.append({"strain": list(strains), **errors(EnergySamples.of(law, stretches, {}, form))})
    return {
        "stretch_range": [low, high],
        "n_samples": n_samples,
        "random_state": random_state,
        "on_surface": errors(samples),
        "by_strain": bins,
        **form.stability(model, law, samples),
    }


def _exact(law, samples):
    from ..forces import BondEnergyForce

    return BondEnergyForce().energy_derivatives(law, *samples.X.T)


def _stability(energy, samples) -> tuple[float, float]:
    """Least acoustic stiffness, and least curvature by the log-stretches."""
    first, second = samples.stretches.T
    angles = np.arange(0, np.pi, np.pi / 12)
    least = np.inf
    for n in angles:
        for m in angles:
            # F is diagonal here: m . F n and cof F : m (x) n.
            along = first * np.cos(m) * np.cos(n) + second * np.sin(m) * np.sin(n)
            cofactor = second * np.cos(m) * np.cos(n) + first * np.sin(m) * np.sin(n)
            value = 2 * energy.by_trace + 4 * energy.by_trace_trace * along**2
            value += 4 * energy.by_trace_area * along * cofactor + energy.by_area_area * cofactor**2
            least = min(least, float(value.min()))
    a, b, J = 2 * first**2, 2 * second**2, first * second
    by_log = [energy.by_trace * s for s in (a, b)]

    def second_derivative(s, t, same):
        value = energy.by_trace_trace * s * t + energy.by_trace_area * J * (s + t) + energy.by_area_area * J * J + energy.by_area * J
        return value + (2 * by_log[0 if s is a else 1] if same else 0)

    aa, bb, ab = second_derivative(a, a, True), second_derivative(b, b, True), second_derivative(a, b, False)
    curvature = (aa + bb) / 2 - np.sqrt(((aa - bb) / 2) ** 2 + ab**2)
    return least, float(curvature.min())


def cross_validate_energy(
    model, samples: EnergySamples, folds: int = 5, random_state: int = 0, progress: Callable[[int], None] = lambda fold: None
) -> list[dict]:
    """Fit clones of a pipeline to all but one fold of the samples each, and report the relative errors on the fold left out.

    `progress` is told every fold that begins, counted from 0.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.energy_design(pds.NeoHookean(), n_samples=300, stretch_range=(0.7, 2.0), isochoric=True)
    >>> model = pds.energy_pipeline(pds.SobolevRegressor(4, "algebraic", max_iter=30, random_state=0), isochoric=True)
    >>> len(pds.cross_validate_energy(model, samples, folds=2))
    2
    """
    check_validation(model, samples, EnergySamples, "energy_design", folds, random_state, progress)
    rows = []
    for number, (train, test) in enumerate(KFold(folds, shuffle=True, random_state=random_state).split(samples.X)):
        progress(number)
        fitted = clone(model).fit(samples.X[train], samples.y[train])
        left_out = EnergySamples(samples.X[test], samples.y[test], samples.stretches[test], samples.design, samples.form)
        rows.append({"fold": number, **energy_errors(fitted.predict(left_out.X).T, left_out)})
    return rows


def store_energy(
    model: InputAwareTargetRegressor,
    samples: EnergySamples,
    law: Law,
    folder: str | Path,
    name: str,
    version: str,
    text: str | CardText,
    members: Sequence[tuple] = (),
) -> Path:
    """Write the artefact of a fitted energy pipeline with a full card; the arguments are those of `pdsurrogate.store`.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> import tempfile
    >>> law = pds.NeoHookean()
    >>> samples = pds.energy_design(law, n_samples=500, stretch_range=(0.7, 2.0), isochoric=True)
    >>> regressor = pds.SobolevRegressor(4, "algebraic", max_iter=60, random_state=0)
    >>> model = pds.energy_pipeline(regressor, isochoric=True).fit(samples.X, samples.y)
    >>> path = pds.store_energy(model, samples, law, tempfile.mkdtemp(), "my-energy", "1", "an example")
    >>> path.parts[-2:]
    ('my-energy', '1')
    """
    text = CardText.of(text)
    check_storing(samples, EnergySamples, law, folder, name, version, members)
    form = samples.form
    if members and form is SHEET:
        raise ValueError("a committee is of bond forces, or of isochoric energies; the energy of a sheet has none")
    model, title = best_of(model), f"{name}@{version}"
    surrogate = energy_surrogate_of(model, law, samples, title)
    errors = evaluate_energy(surrogate, law)
    check_worth_storing(errors, title, law)
    committee, cards = committee_of(
        members,
        title,
        lambda one, drawn, described, which: energy_surrogate_of(best_of(one), described, drawn, which),
        lambda found, drawn, described: evaluate_energy(found, described, n_samples=MEMBER_STATES),
        form.shape,
    )
    regressor = model.regressor_[-1]
    parameters = {
        key: list(value) if isinstance(value, tuple) else getattr(value, "__name__", value) for key, value in regressor.get_params().items()
    }
    card = {
        "name": name,
        "version": version,
        "kind": surrogate.kind,
        "description": text.description,
        "material": {"law": law.name, "trained_with": law.describe(), "shape": form.shape(law)},
        "weight_function": "any: the energy learnt is that of the material alone",
        "features": {
            "set": surrogate.feature_set,
            "names": list(surrogate.features),
            "from": list(form.invariants),
            "targets": list(form.targets),
            "units": "dimensionless; energy in the shear modulus",
        },
        "scaling": {"folded": "features are standardised and targets scaled within the regressor; the payload is on plain features"},
        "training": {
            "design": samples.design,
            "regressor": type(regressor).__name__,
            "parameters": parameters,
            "outcome": {"n_iter": regressor.n_iter_, "loss": regressor.loss_},
            "cross_validation": text.cross_validation or [],
            "search": text.search or [],
            **({"identification": text.identification} if text.identification else {}),
        },
        "domain": asdict(surrogate.domain),
        # Of a sheet the box's corners are states of little use that its errors are of.
        "errors": {"box": errors} | ({"stretches 0.8 to 4": evaluate_energy(surrogate, law, (0.8, 4.0))} if form is SHEET else {}),
        "made_with": versions(),
        "members": cards,
    }
    return save_artifact(folder, card, surrogate, model, committee)
