"""Regressor that finds the parameters of a law from measurements on bodies, by simulations of the tests and their derivatives."""

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from numbers import Integral, Real
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from scipy.optimize import least_squares, lsq_linear
from scipy.stats import chi2
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from ..arguments import check_kind, check_names, check_numbers, in_order
from ..identification import EnergyRegressor, LawRegressor, nominal_stress
from ..identification.averaging import average
from ..identification.energy import half_planes
from ..identification.regressor import check_fitted
from ..identification.stress_regressor import BULK_RATIO, LawEstimator, bulk_arguments
from ..materials import LAWS, Law, Ogden
from ..materials.covariance import derivatives_of_numbers
from ..materials.dictionary import OF_INVARIANTS, STABLE_TO, checked_dictionary, wave_margin
from ..progress import event
from ..scenes import Mesh, Scene, load_scene
from .free import FLOOR, HALVINGS, MOST_TRIED, EnergyUnknowns, floored, grouping, minimized, proposed, scaled, solved
from .measured import DISPLACEMENTS, FAILURES, FORCES, MeasuredScene, Rows, local_fit

logger = logging.getLogger(__name__)

REFINED, REFINED_FREE = 3, 6
"""Default ratio of the spacing of a scene to that of the finer simulation, with a law and without. Chosen: for Carroll's law, fields with
a noise of 1e-4 of the length and a sheet 20 points across, equibiaxial stresses of a free energy are 6 % off with 4 and 4 % with 6."""

COLUMNS = ("step", "quantity", "x1", "x2", "x3")
"""Columns of a table of measurements; the last one for solids only."""

FORCE_SCATTER = 0.005
"""Standard deviation of outputs such as forces without a given one, relative to the greatest in the table: that of common load cells."""

LEAST_SCATTER = 1e-6
"""Least standard deviation of displacements without a given one, relative to the greatest displacement: files have about six digits."""

NEIGHBORS = 13
"""Number of places, with the place itself, to which a quadratic is fitted in order to estimate the scatter of displacements: about twice
its six coefficients in the plane. In space 20 neighbors serve its ten coefficients."""

ORDER, MEAN_ORDER = 1.5, 1.75
"""Least order in the spacing with which displacements of sheets with holes converge, for standard errors, and the mean one, for the
extrapolation to a spacing of zero (theory, section 28)."""

UNDETERMINED = 0.5
"""Relative standard error of a combination of parameters from which on the test does not determine it."""

SHARE = 0.3
"""Least component of a parameter, in the unit vector of an undetermined combination, at which the parameter is named."""

ROUNDS = 3
"""Most fits with a new correction of the discretization error: each changes the parameters by a small part of the change before."""

FARTHEST = 0.5
"""Greatest difference of measured from simulated displacements in a step of a test that prescribes motions, relative to the greater of
them. Displacements of different laws differ by less; a greater difference is an error of units, axes or the order of the steps."""

ALONE = 0.9
"""Share of a single measurement in such a difference (root of the sum of squares) from which on the error names this measurement."""

SUBSTANTIAL = 0.1
"""Size of one component of the simulated displacements, relative to all, from which on the measured one must have the same sign."""

SIGNIFICANT = 2.0
"""Noise of the measurements, in standard deviations, that a difference must exceed in order to count as such an error."""

AT_BOUND = 0.01
"""Distance from a bound, in standard errors, at which a parameter counts as at the bound, which a search approaches without reaching it."""

SETTLED = 0.1
"""Change of all parameters, in their standard errors, below which the correction of the discretization error is not computed again."""

DIFFERENCE = 1e-6
"""Change of a search variable in central differences of the numbers of a law; of a coefficient of an energy, relative to it. Chosen:
the error by rounding is then 1e-10, and that by curvature less."""

MOST_STEPS = 60
"""Most laws that a search tries: well-posed fits take five to ten."""

MEMBERS = 8
"""Number of members of a committee: their spread is then known to some 25 %."""

MOST_COMPARED = 100
"""Most states of the tests in which the stresses of a member are compared with linear ones."""

FAIR, STEPS = 0.02, (1, 3, 0)
"""Relative decrease of the cost that ends the least-squares steps of an energy with all terms, and most such steps in each of the `ROUNDS`.
Chosen: further steps would change the energy less than the choice of the terms and the next correction do. The last round has no step: it
linearizes the equations about the average of the energies."""

EXPONENTS = ((2.0,), (2.0, -2.0), (1.3, 5.0, -2.0), (1.3, 5.0, -2.0, 8.0))
"""Exponents from which Ogden's law with one to four terms starts: those of Ogden (1972) for three terms."""


@dataclass(eq=False, repr=False)
class SceneRegressor(LawEstimator):
    """Parameters of a law from measurements on a body of any shape, such as displacement fields and forces.

    The test is described by a scene. Its equilibria and their exact derivatives by the parameters (theory, section 23) are those of a
    bounded least-squares iteration (Gauss-Newton steps in a trust region), so that noisy fields are never differentiated. A finer
    simulation of the fitted law corrects the simulation at the spacing of the scene; the standard errors contain an estimate of the
    discretization error that remains (theory, section 28). A fit takes seconds to many minutes; `pdsurrogate.progress`
    tells how far it is.

    Parameters
    ----------
    scene : Scene, str, path or list of these, default="hole"
        Test, or several tests of one material. The search starts at the material of a scene if this has the law that is fitted. K/mu is
        that of the scene unless `bulk_ratio` or `bulk_modulus` is given.
    law : str or None, default="neo-hookean"
        Name of the law; None for an energy without a law, an average of energies of few terms of both invariants, weighted by how well they
        fit (theory, section 28). It is a `pdsurrogate.materials.Polyconvex`.
    n_terms : int, default=3
        Number of terms of Ogden's law; without effect for other laws.
    outputs : sequence of str, optional
        Dotted keys of other measurements than fields, such as ``"forces.right.0"`` or ``"probes.tip.displacement.1"``, in the order of the
        quantities 0, -1, -2 and so on in the table. The default, ``"force"``, is the force of the region that is pulled, positive in
        tension.
    refine : int, optional
        Ratio of the spacing of the scene to that of the finer simulation. With 1 the discretization error is not corrected, but estimated
        by a simulation with twice the spacing, and the estimate is part of the standard errors. By default 3 with a law and 6 without one,
        since the remaining error changes an energy of free terms more than a law.
    bulk_ratio : float, optional
        K/mu of the law.
    bulk_modulus : float, optional
        K instead of K/mu, in the unit of the stresses.
    random_state : int, default=0
        Seed of the members of the committee; nothing else is random.
    dictionary : sequence of (str, float), optional
        Candidate terms of an energy without a law, pairs of a kind and a number as in `pdsurrogate.materials.dictionary.Term`, such as
        ``("second_logarithm", 1)``. An energy has at most four terms that are functions of the stretches and at most one that is a function
        of their inverses. By default `pdsurrogate.materials.dictionary.OF_INVARIANTS`. Of sums with a term that is not polyconvex, those
        are left out whose waves are unstable in states with stretches from 1/3 to 3, or those of the tests if these are greater.

    Attributes
    ----------
    law_ : Law
        Law with the parameters found.
    parameter_names_ : list of str
    parameters_ : ndarray, shape (n_parameters,)
    covariance_ : ndarray, shape (n_parameters, n_parameters)
        Covariance from the standard deviations of the measurements, times the lack of fit if it exceeds 1, plus the square of the change
        of the parameters by the remaining discretization error. For an energy without a law: the covariance of the average, with correlated
        residuals.
    standard_errors_ : ndarray, shape (n_parameters,)
        Infinite for parameters that the data do not determine at all.
    correlation_ : ndarray, shape (n_parameters, n_parameters)
    at_bound_ : list of str
        Parameters at a bound, whose standard errors have no meaning.
    undetermined_ : list of str
        Parameters in combinations whose relative standard error exceeds one half. For an energy without a law, terms whose own weights
        have such an error; the stresses may be determined nevertheless.
    lack_of_fit_ : float
        Sum of the squared residuals in standard deviations, divided by the degrees of freedom; 1 is expected.
    p_value_ : float
        Probability of a greater sum in a test of this law with these standard deviations.
    residuals_ : ndarray, shape (n_samples,)
        Measurements minus the fit, in their units.
    standard_deviations_ : ndarray, shape (n_samples,)
        Standard deviations of the measurements, given or estimated.
    discretization_ : ndarray, shape (n_samples,)
        Correction of the simulation at the spacing of the scene, in the units of the measurements. With ``refine=1`` it is not applied, and
        estimated by a simulation with twice the spacing.
    members_ : list of Law
        Committee, whose spread shows what the measurements leave open: laws with parameters drawn from their covariance, within the bounds
        of the search; without a law, energies drawn by their weights in the average, with random errors. Empty if the measurements do not
        determine a parameter at all.
    domain_hull_ : list of list of float
        Half-planes (n1, n2, d) of the convex hull of the states in the simulated tests, as in ``hull`` of
        `pdsurrogate.forces.domain.Domain`, moved outwards by the margin of `EnergyRegressor`.
    stretch_range_ : tuple of float
        Least and greatest stretch in the plane, or in space, in the simulated tests.
    start_ : dict
        Start of the search. ``taken`` is ``"weak form"`` if an energy without a law was taken from the weak form at the measured
        displacements, else ``"default"``. ``chi_squared`` has the sums of squares at both starts, None where there is no equilibrium, and
        ``terms`` has the candidates; both are missing if no weak form was solved.
    n_simulations_ : int
        Number of simulated equilibria, derivatives not counted.
    n_features_in_ : int

    See Also
    --------
    pdsurrogate.identification.LawRegressor : fits a law to the stresses of homogeneous tests.
    pdsurrogate.Result.sensitivity : derivatives of a simulation.

    Examples
    --------
    >>> import numpy as np
    >>> import pdsurrogate as pds
    >>> scene = pds.load_scene("hole", spacing=0.25, stretches=[1.1, 1.2])
    >>> X = [[1, 0, 0, 0], [2, 0, 0, 0]]  # the forces of the first and the second stretch
    >>> found = pds.SceneRegressor(scene, refine=1).fit(X, [0.855, 1.526], standard_deviation=[0.01, 0.01])
    >>> found.parameter_names_, bool(found.standard_errors_[0] < 0.05 * found.parameters_[0])
    (['shear_modulus'], True)
    """

    _parameter_constraints: ClassVar = {
        "scene": "no_validation",
        "law": [str, None],  # laws are added while the program runs
        "n_terms": [Interval(Integral, 1, 4, closed="both")],
        "outputs": "no_validation",  # checked with its names
        "refine": [None, Interval(Integral, 1, None, closed="left")],
        "bulk_ratio": [None, Interval(Real, 0, None, closed="neither")],
        "bulk_modulus": [None, Interval(Real, 0, None, closed="neither")],
        "random_state": [Interval(Integral, 0, None, closed="left")],
        "dictionary": "no_validation",  # checked with its terms
    }

    scene: Scene | str | Path | Sequence = "hole"
    law: str | None = "neo-hookean"
    n_terms: int = 3
    outputs: Sequence[str] | None = None
    refine: int | None = None
    bulk_ratio: float | None = None
    bulk_modulus: float | None = None
    random_state: int = 0
    dictionary: Sequence[tuple[str, float]] | None = None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table of measurements, in their order in arrays.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.SceneRegressor("hole").columns
        ('step', 'quantity', 'x1', 'x2')
        """
        scenes = self._scenes()
        several = isinstance(self.scene, list | tuple)
        return (*(("scene",) if several else ()), *COLUMNS[: 2 + scenes[0].dimension])

    def fit(self, X, y, sample_weight=None, standard_deviation=None):
        """Fit the parameters of the law to measurements.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2 + d)
            What was measured, in the columns ``step``, the number of the output of the scene from 1; ``quantity``: 1, 2 or 3 for a part
            of the displacement and 0, -1, ... for `outputs`; and ``x1``, ``x2`` (and ``x3``), the undeformed place, which outputs do not
            need: any numbers serve there. For a list of scenes the first column is ``scene``, the number of the scene from 0. A table
            (pandas) has these columns in any order.
        y : array-like, shape (n_samples,)
            Measured values in the units of the scene; the force of a sheet is per unit of thickness.
        sample_weight : array-like, shape (n_samples,), optional
            Weights of the squared residuals, in standard deviations; 0 leaves a row out.
        standard_deviation : float or array-like, shape (n_samples,), optional
            Standard deviation of each measurement. By default that of displacements is estimated from the differences of each field from
            local quadratic fits, and that of outputs is 0.5 % of the greatest one.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If the law or a term is unknown, X has other columns, steps or quantities than the scene, a place lies outside the body,
            displacements are unlike those of the scene, the law has no equilibrium at the start of the search, or an energy without a law
            is to be found from displacements alone or from too few measurements.
        TypeError
            If a parameter is of another kind than named above.

        Warns
        -----
        UserWarning
            If a row is a copy of another one, or ``refine=1`` and the discretization error cannot be estimated, or exceeds the standard
            deviations of the measurements.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> scene = pds.load_scene("hole", spacing=0.25)
        >>> model = pds.SceneRegressor(scene, refine=1).fit([[1, 0, 0, 0]], [3.0], standard_deviation=0.01)
        >>> model.parameter_names_
        ['shear_modulus']
        """
        self._begin_fit()
        if self.law is not None:
            check_fitted(self.law)
        if self.dictionary is not None:
            checked_dictionary(self.dictionary)
        if self.outputs is not None:
            check_names(self.outputs, "outputs", "such as ['force', 'probes.tip.displacement.0'], or None for the force")
        self._scenes()
        self._check_table(X, y)
        if sample_weight is not None:
            check_numbers(sample_weight, "sample_weight", "give a number for each row of X")
        X, y = validate_data(self, in_order(X, self.columns, "X"), y, dtype=np.float64, y_numeric=True)
        weight = _check_sample_weight(sample_weight, X, dtype=np.float64, ensure_non_negative=True)
        used = weight > 0
        if not used.any():
            raise ValueError("all sample weights are zero")
        self._tests = self._tests_of(X[used])
        self._warn_of_copies(y[used])
        deviation = self._deviations(X, y, standard_deviation)
        self.standard_deviations_ = deviation
        self.residuals_, self.discretization_ = np.full((2, len(y)), np.nan)
        fit, self.discretization_[used] = self._fitted(y[used], np.sqrt(weight[used]) / deviation[used])
        self.residuals_[used] = y[used] - fit
        del self._tests
        return self

    def predict(self, X):
        """Return simulated measurements of the fitted law, at the spacing of the finer simulation.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2 + d)
            As for `fit`.

        Returns
        -------
        ndarray, shape (n_samples,)

        Raises
        ------
        SimulationFailed
            If the scene has no equilibrium with the fitted law.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> scene = pds.load_scene("hole", spacing=0.25)
        >>> model = pds.SceneRegressor(scene, refine=1).fit([[1, 0, 0, 0]], [3.0], standard_deviation=0.01)
        >>> model.predict([[1, 0, 0, 0]]).round(3).tolist()
        [3.0]
        """
        check_is_fitted(self)
        X = validate_data(self, in_order(X, self.columns, "X"), dtype=np.float64, reset=False)
        found = np.empty(len(X))
        for test, here in self._tests_of(X):
            found[here] = test.simulate(self.law_, self._fine(test.scene))[0]
        return found

    def nominal_stress(self, X) -> tuple[np.ndarray, np.ndarray]:
        """Return nominal stresses of the fitted law in homogeneous states, with their standard errors by the covariance of the parameters.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretches along the stress and across it, as for `pdsurrogate.identification.LawRegressor`.

        Returns
        -------
        stress, standard_error : ndarray, shape (n_samples,)

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> scene = pds.load_scene("hole", spacing=0.25)
        >>> model = pds.SceneRegressor(scene, refine=1).fit([[1, 0, 0, 0]], [3.0], standard_deviation=0.03)
        >>> stress, error = model.nominal_stress([[1.5, 1.5**-0.5]])
        >>> bool(0.04 < error[0] / stress[0] < 0.05)
        True
        """
        check_is_fitted(self)
        wanted = "X must have two columns of positive stretches, along the stress and across it"
        check_numbers(X, "X", wanted)
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != 2 or not (X > 0).all():
            raise ValueError(f"{wanted}, not {f'{X.min():g}' if X.ndim == 2 and X.shape[1] == 2 else f'the shape {X.shape}'}")
        jacobian = self._stress_derivatives(X)
        variance = np.einsum("ij,jk,ik->i", jacobian, self.covariance_, jacobian)
        return nominal_stress(self.law_, X), np.sqrt(variance)

    def stated_deviations(self, X, y, stated: dict[int, float | None]) -> np.ndarray:
        """Return standard deviations of measurements: stated ones of all displacements or of an output, and estimated ones of the others.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2 + d)
            As for `fit`.
        y : array-like, shape (n_samples,)
        stated : dict
            Standard deviation by quantity: 1 for all displacements, 0, -1, ... for `outputs`; None for an estimate, as `fit` makes it.

        Returns
        -------
        ndarray, shape (n_samples,)

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.SceneRegressor("hole").stated_deviations([[1, 0, 0, 0]], [3.0], {0: None, 1: 1e-3}).tolist()
        [0.015]
        """
        self._check_table(X, y)
        check_kind(stated, dict, "stated", "a dictionary of standard deviations by quantity, such as {1: 1e-3}")
        X, y = np.asarray(in_order(X, self.columns, "X"), dtype=float), np.asarray(y, dtype=float)
        found = np.empty(len(y))
        for quantity, value in stated.items():
            check_kind(value, Real | None, f"stated: the value of {quantity}", "a positive number or None")
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"stated: the value of {quantity} must be a positive number or None, not {value:g}")
        for test, here in self._tests_of(X):
            found[here] = _estimated(test.rows, y[here])
            for quantity, value in stated.items():
                if value is not None:
                    found[here[test.rows.is_field if quantity > 0 else test.rows.quantity == quantity]] = value
        return found

    def _law_of(self, values) -> Law:
        return self._unknown.law_of(values)

    def _stress_derivatives(self, X: np.ndarray) -> np.ndarray:
        """Return the derivatives of `nominal_stress` by the parameters, shape (n_samples, n_parameters)."""
        columns, steps = [], 1e-5 * self._scales()
        for step, change in zip(steps, np.diag(steps), strict=True):
            sides = [nominal_stress(self._law_of(self.parameters_ + sign * change), X) for sign in (1, -1)]
            columns.append((sides[0] - sides[1]) / (2 * step))
        return np.stack(columns, axis=1)

    def _deviations(self, X: np.ndarray, y: np.ndarray, given) -> np.ndarray:
        """Return the standard deviations of all measurements, estimated if none are given."""
        if given is None:
            return self.stated_deviations(X, y, {})
        wanted = f"give one positive number, or one for each of the {len(y)} rows of X"
        check_numbers(given, "standard_deviation", wanted)
        if np.shape(given) not in ((), y.shape):
            raise ValueError(f"standard_deviation: its shape is {np.shape(given)}; {wanted}")
        found = np.broadcast_to(np.asarray(given, dtype=float), y.shape).copy()
        if (wrong := found[~((found > 0) & np.isfinite(found))]).size:
            raise ValueError(f"standard_deviation: {wrong[0]:g} is no standard deviation; {wanted}")
        return found

    def _check_table(self, X, y) -> None:
        """Raise ValueError for a table of measurements, or values, that are no numbers or none at all."""
        columns = self.columns
        check_numbers(
            X, "X", f"it must have the columns {', '.join(columns)}, and a row for each measurement" if columns else "give numbers"
        )
        check_numbers(y, "y", "give a measured value for each row of X")

    def _scenes(self) -> list[Scene]:
        """Return the scenes, loaded if they are given by name; raise ValueError for none or for bodies of different dimension."""
        scenes: list[Scene] = []
        given: Sequence = self.scene if isinstance(self.scene, list | tuple) else [self.scene]
        for one in (load_scene(each) if isinstance(each, str | Path) else each for each in given):
            check_kind(one, Scene, "scene", "a Scene, or the name or file of one, or a list of these")
            if self._ratio > 1 and isinstance(one.body, Mesh):
                raise ValueError(f"refine: scene {one.name} is a mesh, which has a spacing of its own: set refine=1 (--refine 1)")
            scenes.append(one)
        if not scenes:
            raise ValueError("scene: the list is empty; give at least one scene")
        if len({one.dimension for one in scenes}) > 1:
            raise ValueError("scene: bodies in the plane and solids cannot share a table, as their places have different columns")
        return scenes

    @property
    def _ratio(self) -> int:
        """Ratio of the spacings, `refine` or its default."""
        return (REFINED_FREE if self.law is None else REFINED) if self.refine is None else self.refine

    def _fine(self, scene: Scene) -> float | None:
        """Return the spacing of the finer simulation of a scene; None for the scene's own."""
        return None if self._ratio == 1 or scene.spacing is None else scene.spacing / self._ratio

    def _tests_of(self, X: np.ndarray) -> list[tuple[MeasuredScene, np.ndarray]]:
        """Return each scene with its rows of a table, and the numbers of these rows."""
        scenes, columns = self._scenes(), self.columns
        if X.ndim != 2 or X.shape[1] != len(columns):
            given = f"n_features = {X.shape[1]}" if X.ndim == 2 else f"the shape {X.shape}"
            raise ValueError(f"X must have the columns {', '.join(columns)}, but has {given}")
        whole = X[:, : X.shape[1] - scenes[0].dimension]
        if (whole != np.round(whole)).any():
            wrong = whole[whole != np.round(whole)][0]
            raise ValueError(f"{', '.join(columns[: whole.shape[1]])} must be whole numbers, not {wrong:g}")
        number = whole[:, 0] if len(columns) > 2 + scenes[0].dimension else np.zeros(len(X))
        if (number < 0).any() or (number >= len(scenes)).any():
            raise ValueError(f"scene: the {len(scenes)} scenes are numbered from 0, so that there is no {number.max():g}")
        step, quantity = whole[:, -2:].astype(int).T
        tests = []
        for which, scene in enumerate(scenes):
            here = np.flatnonzero(number == which)
            if len(here):
                rows = Rows(step[here], quantity[here], X[here][:, whole.shape[1] :])
                tests.append((MeasuredScene(scene, rows, self.outputs), here))
        return tests

    def _warn_of_copies(self, y: np.ndarray) -> None:
        """Warn of rows that repeat a measurement, each of which counts: in a file they are mostly copies."""
        for test, here in self._tests:
            rows, places = test.rows, np.where(test.rows.is_field[:, None], test.rows.places, 0.0)
            table = np.column_stack([rows.step, rows.quantity, places, y[here]])
            unique, counts = np.unique(table, axis=0, return_counts=True)
            for step, quantity, *_, value in unique[counts > 1][:1].tolist():
                what = f"displacement along x{quantity:.0f}" if quantity > 0 else test.outputs[-int(quantity)][0]
                warnings.warn(
                    f"X: {(counts - 1).sum()} rows of scene {test.scene.name} are copies of others, such as {what} = {value:.4g} in step "
                    f"{step:.0f}; each counts as a further measurement: leave copies out",
                    stacklevel=3,
                )

    def _fitted(self, y: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Set the results of the fit to values with roots of weights; return its values and the correction of the discretization error."""
        self._unknown = self._unknowns(len(y))
        start = self._start(y, root)
        search, x = self._search_from(start, y, root)
        self.start_: dict[str, Any] = {"taken": "default"}
        if self._has_weak_form:
            x = self._better_start(search, x)
        found, correction = self._searched(search, x)
        x, space = found.x, search.space
        if self.law is None:
            kept = x > FLOOR * x.max()
            self._keep(search, kept)
            x, found.jac, space = x[kept], found.jac[:, kept], search.space
            found.spread, found.active_mask = found.spread[np.ix_(kept, kept)], np.zeros(len(x), dtype=bool)
        else:
            found.active_mask = (found.active_mask != 0) | (np.minimum(x - space.low, space.high - x) < AT_BOUND * _errors(found.jac))
        visited = np.concatenate([test.states(search.law_at(x)) for test, _ in self._tests])
        self._set_domain(visited)
        self.n_simulations_ = search.count
        fit = search.values(x) + correction
        residuals = root * (y - fit)
        remaining = found.remaining if self._ratio == 1 else correction / (self._ratio**ORDER - 1)
        self._store(x, space, found, residuals, root * remaining)
        if self._ratio == 1:
            correction = -remaining
            if (ratio := float(np.sqrt(((root * remaining) ** 2).mean()))) > 1:
                warnings.warn(
                    f"refine=1: the discretization error that is not corrected is about {ratio:.2g} standard deviations of the "
                    "measurements, and the standard errors contain it to first order only: use refine=2 or more, or a smaller spacing",
                    stacklevel=3,
                )
        if self.law is not None:
            self.members_ = self._drawn(x, space, found.jac, residuals, visited)
        return fit, correction

    @property
    def _has_weak_form(self) -> bool:
        """Whether the weak form of an energy without a law can be made: displacements were measured in all tests."""
        return self.law is None and all(test.has_fields for test, _ in self._tests)

    def _unknowns(self, count: int) -> LawRegressor | EnergyUnknowns:
        """Return the unknowns of the fit; raise ValueError unless `count` measurements can determine them."""
        bulk = self._bulk()
        if self.law is None:
            terms = OF_INVARIANTS if self.dictionary is None else checked_dictionary(self.dictionary)
            unknown = EnergyUnknowns(bulk.get("bulk_ratio", None if bulk else BULK_RATIO), bulk.get("bulk_modulus"), terms)
            self._check_energy(unknown, count)
            return unknown
        unknown = LawRegressor(self.law, self.n_terms).set_params(**bulk)
        names = unknown.unknowns()
        if count < len(names):
            raise ValueError(f"X: {count} measurements do not determine {len(names)} parameters ({', '.join(names)})")
        return unknown

    def _search_from(self, start: np.ndarray, y: np.ndarray, root: np.ndarray) -> tuple["_Search", np.ndarray]:
        """Return the search that starts at given parameters, at which the tests are simulated, and its variables there."""
        if isinstance(self._unknown, EnergyUnknowns):
            low, high, logarithmic = np.zeros(len(start)), np.full(len(start), np.inf), np.zeros(len(start), dtype=bool)
        else:
            low, high, logarithmic = self._unknown.search_range(start, float(self._law_of(start).shear_modulus))
        x, low, high = (np.log(each, out=np.array(each, dtype=float), where=logarithmic) for each in (start, low, high))
        if self.law is not None:  # central differences stay between the bounds
            low, high = low + 2 * DIFFERENCE, high - 2 * DIFFERENCE
            x = np.clip(x, low, high)
        space = _Space(low, high, logarithmic)
        self._begin(self._law_of(space.parameters(x)), y, root)
        held = self.law is not None and self._without_scale()
        return _Search(self._tests, self._law_of, space, y, root, self.law is None, held), x

    def _better_start(self, search: "_Search", x: np.ndarray) -> np.ndarray:
        """Return the start of the search with the lesser sum of squares: x, or the solution of the weak form at measured displacements.

        Of a dictionary of more than `MOST_TRIED` terms, those that the weak form proposes and the term of the start remain.
        """
        try:
            jacobian, right, forces, steps = self._weak_form(search, x)
        except FAILURES as error:  # as where noise turns bonds around
            if len(x) > MOST_TRIED:
                raise ValueError(f"dictionary: it is too large without the forces at the measured displacements: {error}") from None
            return x
        if len(x) > MOST_TRIED:
            shares = proposed(jacobian, right, forces, steps)
            kept = np.zeros(len(x), dtype=bool)
            kept[np.argsort(-shares - 2 * (x == x.max()), kind="stable")[:MOST_TRIED]] = True
            self._keep(search, kept)
            x, jacobian = x[kept], jacobian[:, kept]
        weak = floored(solved(*scaled(jacobian, right, forces)))
        starts = {"default": x, "weak form": weak}
        squares = {name: float((search.residuals(each) ** 2).sum()) for name, each in starts.items()}
        taken = min(starts, key=squares.__getitem__)
        finite = {name: value if np.isfinite(value) else None for name, value in squares.items()}
        self.start_ = {"taken": taken, "terms": self._unknown.unknowns(), "chi_squared": finite}
        return starts[taken]

    def _weak_form(self, search: "_Search", x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the weighted equations of the weak form, a mask of those of forces, and the number of the step of each among all tests."""
        count, first = len(search.y), 0
        jacobian, right, forces, steps = np.empty((count, len(x))), np.empty(count), np.zeros(count, dtype=bool), np.empty(count, dtype=int)
        for test, here in self._tests:
            jacobian[here], right[here] = test.weak_form(search.law_at, x, search.y[here])
            forces[here], steps[here] = test.among(FORCES), first + test.rows.step
            first += test.rows.step.max()
        return search.root[:, None] * jacobian, search.root * right, forces, steps

    def _keep(self, search: "_Search", kept: np.ndarray) -> None:
        """Keep only the unknowns that a mask chooses."""
        self._unknown, search.space = self._unknown.of(kept), search.space.of(kept)
        search.forget()

    def _searched(self, search: "_Search", x: np.ndarray) -> tuple[SimpleNamespace, np.ndarray]:
        """Return the solution of a search that starts at x, and the correction of the discretization error, (n,), that it contains."""
        y, correction = search.y, np.zeros(len(search.y))
        for number in range(ROUNDS if self._ratio > 1 or self.law is None else 1):
            first = self._ratio > 1 and not number
            # Changes of the cost by less than these are those of parameters within a part of their standard errors.
            close = 1e-3 if first else 1e-2 / len(y)
            if self.law is None:
                found = self._energy(search, x, number)
            else:
                bounds = {"bounds": (search.space.low, search.space.high), "x_scale": "jac"}
                found = least_squares(
                    search.residuals, x, search.jacobian, **bounds, ftol=close, xtol=1e-8, gtol=1e-12, max_nfev=MOST_STEPS
                )
            before, x = x, found.x
            if self._ratio == 1:
                if self.law is not None:
                    found.remaining = self._error_by_coarse(search.law_at(x), search.values(x))
                continue
            if self.law is not None and number and (np.abs(x - before) <= SETTLED * _errors(found.jac)).all():
                break
            correction = self._fine_values(search.law_at(x)) - search.values(x)
            if self.law is None:
                correction *= self._ratio**MEAN_ORDER / (self._ratio**MEAN_ORDER - 1)
            search.y = y - correction
        return found, correction

    def _error_by_coarse(self, law: Law, values: np.ndarray) -> np.ndarray:
        """Return the discretization error of measurements with a law, (n,), by simulations with twice the spacing; warn where they fail."""
        found = np.zeros(len(values))
        for test, here in self._tests:
            try:
                if test.scene.spacing is None:
                    raise ValueError("the spacing of a mesh is its own")
                coarse = test.simulate(law, 2 * test.scene.spacing)[0]
                found[here] = (coarse - values[here]) / (2**ORDER - 1)
            except (*FAILURES, ValueError) as error:
                warnings.warn(
                    f"refine=1: the discretization error of scene {test.scene.name} is unknown and no part of the standard errors, since "
                    f"a simulation with twice the spacing fails: {error}",
                    stacklevel=5,
                )
        return found

    def _fine_values(self, law: Law) -> np.ndarray:
        """Return the measurements of the finer simulations with a law, shape (n,)."""
        found = np.empty(sum(len(here) for _, here in self._tests))
        for test, here in self._tests:
            logger.info("%s: finer simulation, spacing %.3g", test.scene.name, self._fine(test.scene))
            with _failing(f"refine: with the spacing {self._fine(test.scene)} the fitted law fails; choose another spacing or refine"):
                found[here] = test.simulate(law, self._fine(test.scene))[0]
        return found

    def _check_energy(self, unknown: EnergyUnknowns, count: int) -> None:
        """Raise ValueError for measurements that cannot determine an energy without a law."""
        if self._without_scale():
            raise ValueError(
                "displacements under prescribed motions determine an energy without a law up to a factor alone: add rows of forces "
                "(quantity 0; --forces)"
            )
        if len(unknown.terms) > MOST_TRIED and not self._has_weak_form:
            raise ValueError(
                f"dictionary: measured displacements choose among more than {MOST_TRIED} terms, but here are too few: give at most "
                f"{MOST_TRIED} terms, not {len(unknown.terms)}"
            )
        if count < len(unknown.terms):
            raise ValueError(
                f"an energy without a law has {len(unknown.terms)} candidate terms, and needs at least as many measurements, not "
                f"{count}: add displacements (--fields), or fit a law (--law)"
            )

    def _without_scale(self) -> bool:
        """Return whether all measurements are displacements that do not depend on a common factor of all stresses."""
        scaled = self.law is None or "bulk_modulus" not in self._bulk()
        tests = [test for test, _ in self._tests if not (test.rows.is_field | test.among(DISPLACEMENTS)).all()]
        return scaled and not tests and not any(test.scene.loads or test.scene.materials for test, _ in self._tests)

    def _energy(self, search: "_Search", x: np.ndarray, number: int) -> SimpleNamespace:
        """Return the coefficients of all terms and the Jacobian there.

        In the first of the rounds, which are numbered from 0, a least-squares step finds the coefficients. In the following ones the
        equations are linearized there, and the average of energies with few terms is their solution, with the covariance ``spread``.
        """
        found = minimized(search, x, FAIR, STEPS[number])
        if number == 0:
            return found
        residuals = search.residuals(found.x)
        total, count = 0.0, 0
        for test, here in self._tests:
            field = test.rows.is_field
            each = grouping(residuals[here][field], test.rows.places[field], test.rows.quantity[field])
            total, count = total + each[0], count + each[1]
        correlated = max(1.0, total / count / (residuals**2).mean()) if count else 1.0
        greatest = max(STABLE_TO, *(test.greatest_stretch for test, _ in self._tests))
        right, terms = found.jac @ found.x - residuals, self._unknown.terms
        settings = lambda least: correlated * max(1.0, least / len(right)), wave_margin(terms, greatest), MEMBERS, self.random_state
        energies = average(terms, found.jac, right, *settings)
        members, found.spread, found.x = energies.members, energies.covariance, floored(energies.mean)
        if self._ratio == 1 and number == ROUNDS - 1:
            found.remaining = self._error_by_coarse(search.law_at(found.x), search.values(found.x))
            shift = search.root * found.remaining
            sides = [average(terms, found.jac, right + way * shift, *settings) for way in (1, -1)]
            members = np.concatenate([sides[0].members[::2], sides[1].members[1::2]])
            change = (sides[0].mean - sides[1].mean) / 2
            found.spread = found.spread + np.outer(change, change)
        self.members_ = [self._unknown.of(each > 0).law_of(each[each > 0]) for each in members]
        return found

    def _set_domain(self, visited: np.ndarray) -> None:
        """Set the hull and the range of the principal stretches (n, 3) in the tests, which are in descending order."""
        isochoric = visited / np.cbrt(visited.prod(axis=1))[:, None]
        self.domain_hull_ = [[n1, n2, EnergyRegressor.margin - offset] for n1, n2, offset in half_planes(isochoric[:, :2]).tolist()]
        self.stretch_range_ = float(visited.min()), float(visited.max())

    def _store(self, x, space, found, residuals, remaining) -> None:
        """Set parameters, covariance and lack of fit from the weighted Jacobian and residuals at the solution, and the remaining error."""
        jacobian = found.jac / space.sizes(x)
        self.parameter_names_, self.parameters_ = self._unknown.unknowns(), space.parameters(x)
        self.law_ = self._law_of(self.parameters_)
        self.at_bound_ = [name for name, active in zip(self.parameter_names_, found.active_mask, strict=True) if active]
        free = len(residuals) - len(x)
        self.lack_of_fit_ = float((residuals**2).sum() / free) if free > 0 else np.nan
        self.p_value_ = float(chi2.sf((residuals**2).sum(), free)) if free > 0 else np.nan
        if self.law is None:
            self.covariance_, errors = found.spread, np.sqrt(np.diag(found.spread))
            self.standard_errors_, self.correlation_ = errors, found.spread / np.outer(errors, errors)
            self.undetermined_ = [
                name for name, one in zip(self.parameter_names_, errors > UNDETERMINED * self.parameters_, strict=True) if one
            ]
            return
        scales = self._scales()
        left, singular, right = np.linalg.svd(jacobian * scales, full_matrices=False)
        known = singular > 1e-10 * singular.max(initial=0.0)
        inverse = (right[known].T / singular[known]) @ left[:, known].T
        covariance = inverse @ inverse.T * max(1.0, self.lack_of_fit_ if free > 0 else 1.0)
        change = inverse @ remaining
        covariance += np.outer(change, change)
        unknown = (np.abs(right[~known]) > SHARE).any(axis=0) if not known.all() else np.zeros(len(x), dtype=bool)
        doubtful = ~known | (1 / np.where(known, singular, 1.0) > UNDETERMINED)
        named = (np.abs(right[doubtful]) > SHARE).any(axis=0)
        self.undetermined_ = [name for name, one in zip(self.parameter_names_, named, strict=True) if one]
        covariance = covariance * np.outer(scales, scales)
        errors = np.sqrt(np.diag(covariance))
        self.correlation_ = covariance / np.outer(np.where(errors > 0, errors, 1.0), np.where(errors > 0, errors, 1.0))
        covariance[unknown, unknown] = np.inf
        self.covariance_, self.standard_errors_ = covariance, np.sqrt(np.diag(covariance))

    def _drawn(self, x, space, jacobian, residuals, visited) -> list[Law]:
        """Return laws drawn from the distribution of bounded least-squares solutions x; none if a parameter is not determined at all.

        `jacobian` is the derivative of the weighted simulated measurements by x, and `residuals` are the weighted measurements minus the
        simulated ones. Solutions without bounds are normal about the minimum of the linearized residuals, with the covariance of the
        parameters. The bounded solution is the nearest place within the bounds, in the metric of the covariance. The change from x is
        halved until it gives a law whose stresses in the states `visited` (n, 3) are nearly linear in it: others do not describe the test.
        """
        if not np.isfinite(self.covariance_).all():
            return []
        states = visited[:: -(-len(visited) // MOST_COMPARED), :2]
        sizes = space.sizes(x)
        variances, axes = np.linalg.eigh(self.covariance_ / np.outer(sizes, sizes))
        deviations, random, members = np.sqrt(np.maximum(variances, 1e-14 * variances.max())), np.random.default_rng(self.random_state), []
        inverse, unbounded = (axes / deviations).T, x + np.linalg.lstsq(jacobian, residuals, rcond=1e-10)[0]
        (stress, error), slopes = self.nominal_stress(states), self._stress_derivatives(states) * sizes
        for normal in random.standard_normal((MEMBERS, len(x))):
            change = lsq_linear(inverse, inverse @ (unbounded + axes @ (deviations * normal)), (space.low, space.high), method="bvls").x - x
            member = self.law_
            for part in change / 2.0 ** np.arange(HALVINGS)[:, None]:
                with suppress(ValueError):  # some parameters between the bounds are not those of a law
                    law = self._law_of(space.parameters(x + part))
                    if ((nominal_stress(law, states) - stress - slopes @ part) ** 2).mean() <= (error**2).mean():
                        member = law
                        break
            members.append(member)
        return members

    def _scales(self) -> np.ndarray:
        """Return the sizes of the parameters by which they are compared: their values, or a hundredth of the range between bounds."""
        if self.law is None:
            return np.abs(self.parameters_)
        spans = [LAWS[self.law].bounds.get(name, (0.0, 0.0)) for name in self.parameter_names_]
        return np.maximum(np.abs(self.parameters_), [1e-2 * min(high - low, 1.0) for low, high in spans])

    def _bulk(self) -> dict[str, float]:
        """Return the bulk modulus or its ratio, as arguments of a `LawRegressor`: given, or that of the first scene with a material."""
        if given := bulk_arguments(bulk_modulus=self.bulk_modulus, bulk_ratio=self.bulk_ratio):
            return given
        for scene in self._scenes():
            if scene.material is not None:
                return {"bulk_ratio": scene.law().bulk_modulus / scene.law().shear_modulus}
        return {}

    def _start(self, y: np.ndarray, root: np.ndarray) -> np.ndarray:
        """Return the parameters at which the search starts: those of a scene or the law's defaults, with moduli that fit the forces."""
        stated = [scene.law() for scene in self._scenes() if scene.material is not None and scene.material.law == self.law]
        if isinstance(self._unknown, EnergyUnknowns):
            start = self._unknown.start()
        elif self.law == Ogden.name:
            exponents = np.array(EXPONENTS[self.n_terms - 1])
            sizes = 1 / np.abs(exponents)
            if stated and isinstance(stated[0], Ogden) and len(stated[0].exponents) == self.n_terms:
                sizes, exponents = np.abs(stated[0].moduli), np.array(stated[0].exponents)
            start = np.concatenate([sizes, exponents])
        else:
            law = stated[0] if stated else LAWS[str(self.law)]()
            start = np.array([getattr(law, name) for name in self._unknown.unknowns()])
        product, square = 0.0, 0.0
        for test, here in self._tests:
            forces = test.among(FORCES)
            if test.scene.loads or not forces.any():
                continue
            with _failing(f"the search cannot start at {self._law_of(start).describe()}"):
                simulated = test.simulate(self._law_of(start))[0]
            weight = root[here][forces] ** 2
            product += float((weight * simulated[forces] * y[here][forces]).sum())
            square += float((weight * simulated[forces] ** 2).sum())
        if product <= 0 < square:
            what = "are all zero" if product == 0 else "have the opposite sign of the simulated ones"
            raise ValueError(f"y: the measured forces {what}; a force is that on the region pulled, as a run of the scene reports it")
        if square > 0:
            moduli = len(start) if self.law is None else self.n_terms if self.law == Ogden.name else 1
            start[:moduli] *= product / square
        return start

    def _begin(self, law: Law, y: np.ndarray, root: np.ndarray) -> None:
        """Simulate all tests with a law; raise ValueError for displacements that are unlike those of a test that prescribes them."""
        for test, here in self._tests:
            with _failing(f"the search cannot start at {law.describe()}"):
                simulated = test.begin(law)
            if not test.scene.loads:
                _check_displacements(test, simulated, y[here], 1 / root[here])


def _errors(jacobian: np.ndarray) -> np.ndarray:
    """Return the standard errors of search variables by the noise, from the derivatives of weighted measurements by them."""
    return np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14, hermitian=True)))


@contextmanager
def _failing(what: str) -> Iterator[None]:
    """Raise a ValueError that says what fails, during a context, where a law has no equilibrium."""
    try:
        yield
    except FAILURES as error:
        raise ValueError(f"{what}: {error}") from None


def _check_displacements(test: MeasuredScene, simulated: np.ndarray, measured: np.ndarray, deviation: np.ndarray) -> None:
    """Raise ValueError for displacements that differ from simulated ones by more than laws do, and than the noise of the measurements."""
    rows, field = test.rows, test.rows.is_field
    what = f"those of scene {test.scene.name}, simulated with a law that fits the forces"
    for axis in np.unique(rows.quantity[field]):
        here = rows.quantity == axis
        product, noise = float(simulated[here] @ measured[here]), float(np.linalg.norm(simulated[here] * deviation[here]))
        substantial = np.linalg.norm(simulated[here]) > SUBSTANTIAL * np.linalg.norm(simulated[field])
        if substantial and product < -SIGNIFICANT * noise:
            raise ValueError(
                f"y: the displacements along x{axis} have the opposite sign of {what}: check the directions of the axes and the columns"
            )
    for step in np.unique(rows.step[field]):
        here = field & (rows.step == step)
        found, right, scatter = (np.linalg.norm(each[here]) for each in (measured, simulated, deviation))
        off, most = float(np.linalg.norm((measured - simulated)[here])), max(found, right)
        if off - SIGNIFICANT * scatter > FARTHEST * most:
            worst = np.flatnonzero(here)[np.abs(measured - simulated)[here].argmax()]
            if abs(measured[worst] - simulated[worst]) > ALONE * off:
                place = ", ".join(f"{x:.4g}" for x in rows.places[worst])
                raise ValueError(
                    f"y: one displacement of step {step} is far from all others: along x{rows.quantity[worst]} at ({place}) it is "
                    f"{measured[worst]:.4g}, and {simulated[worst]:.4g} among {what}: check this measurement"
                )
            ratio = simulated[here] @ measured[here] / right**2 if right > 0 else np.inf
            raise ValueError(
                f"y: the displacements of step {step} are {ratio:.3g} times {what}, and differ by {off / most:.0%}: give "
                "places and displacements in the unit of length and along the axes of the scene, and the steps in its order"
            )


@dataclass(frozen=True)
class _Space:
    """Variables of a search: parameters or, where flags say so, their logarithms, between bounds; each of shape (n_parameters,)."""

    low: np.ndarray
    high: np.ndarray
    logarithmic: np.ndarray

    def of(self, kept: np.ndarray) -> "_Space":
        """Return the variables that a mask chooses."""
        return _Space(self.low[kept], self.high[kept], self.logarithmic[kept])

    def parameters(self, x: np.ndarray) -> np.ndarray:
        return np.exp(x, out=x.copy(), where=self.logarithmic)

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """Return the derivatives of the parameters by the variables."""
        return np.where(self.logarithmic, self.parameters(x), 1.0)


class _Search:
    """Weighted residuals of a law at the measurements and their Jacobian by the variables of a `space`, for `scipy.optimize.least_squares`.

    If `held`, the measurements do not depend on a common factor of all moduli, and the first one keeps its value.
    """

    def __init__(self, tests: list, law_of, space: _Space, y: np.ndarray, root: np.ndarray, linear: bool, held: bool) -> None:
        self.tests, self.law_of, self.space, self.y, self.root, self.linear, self.held = tests, law_of, space, y, root, linear, held
        self.count = 0
        self.known: dict[bytes, np.ndarray] = {}
        self.differentiated: dict[bytes, np.ndarray] = {}

    def forget(self) -> None:
        """Delete what is known of laws with other unknowns."""
        self.known, self.differentiated = {}, {}

    def law_at(self, x: np.ndarray) -> Law:
        return self.law_of(self.space.parameters(x))

    def values(self, x: np.ndarray) -> np.ndarray:
        """Return the measurements at the search variables; raise one of `FAILURES` where a scene has no equilibrium."""
        key = x.tobytes()
        if key not in self.known:
            self.known[key] = self._differentiated(x, [])[0]
        return self.known[key]

    def residuals(self, x: np.ndarray) -> np.ndarray:
        try:
            return self.root * (self.values(x) - self.y)
        except (*FAILURES, ValueError):
            return np.full(len(self.y), np.inf)  # the search then turns back

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        key = x.tobytes()
        if key not in self.differentiated:
            numbers, chain = derivatives_of_numbers(self.law_at, x, DIFFERENCE * (np.abs(x) if self.linear else np.ones(len(x))))
            self.known[key], derivatives = self._differentiated(x, [f"material.{name}" for name in numbers])
            if self.held:
                chain[:, 0] = 0.0
            self.differentiated[key] = derivatives @ chain
        return self.root[:, None] * self.differentiated[key]

    def _differentiated(self, x: np.ndarray, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
        law, values, derivatives = self.law_at(x), np.empty(len(self.y)), np.empty((len(self.y), len(names)))
        for test, here in self.tests:
            self.count += test.count
            values[here], derivatives[here] = test.differentiate(law, names)
        squares = ((self.root * (values - self.y)) ** 2).sum()
        logger.info("%d equilibria, sum of squared residuals %.4g for %d measurements", self.count, squares, len(values))
        event("calibrating", 0, 1, equilibria=self.count, sum_of_squared_residuals=squares)
        return values, derivatives


def _estimated(rows: Rows, values: np.ndarray) -> np.ndarray:
    """Return estimated standard deviations of measurements on one scene, shape (n,)."""
    found = np.empty(len(values))
    for quantity in np.unique(rows.quantity):
        same = rows.quantity == quantity
        size = np.abs(values[same]).max() or 1.0
        found[same] = FORCE_SCATTER * size if quantity < 1 else max(_scatter(rows, values, same), LEAST_SCATTER * size)
    return found


def _scatter(rows: Rows, values: np.ndarray, same: np.ndarray) -> float:
    """Return the standard deviation of one component of measured displacements, from its differences from local quadratic fits.

    The median over all places is that of a normal distribution, and does not notice the few places where the field bends sharply. With too
    few places in each field it is 0.
    """
    found = []
    for step in np.unique(rows.step[same]):
        here = same & (rows.step == step)
        places, once = np.unique(rows.places[here], axis=0, return_index=True)
        u, d = values[here][once], places.shape[1]
        count = NEIGHBORS if d == 2 else 20
        if len(u) < 2 * count:
            continue
        # Row of the hat matrix of each place in its own fit: the variance of the residual is 1 - h.
        near, hat = local_fit(places, places, count)
        left = 1 - hat[:, 0]
        residual = u - (hat * u[near]).sum(axis=1)
        found.append((residual / np.sqrt(np.maximum(left, 1e-6)))[left > 1e-6])
    return float(np.median(np.abs(np.concatenate(found))) / 0.6745) if found else 0.0
