"""Regressor that finds the parameters of a law from measurements on bodies, by simulations of
the tests and their derivatives.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from pathlib import Path
from typing import ClassVar

import numpy as np
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import check_is_fitted, validate_data

from ..arguments import check_kind, check_names, check_numbers, in_order
from ..identification import nominal_stress
from ..identification.regressor import check_fitted
from ..identification.stress_regressor import LawEstimator
from ..materials import Law
from ..scenes import Scene
from .asked import fine_spacing, scenes_of, stress_derivatives
from .fitting import fitted
from .imaged import ImagedScene
from .measured import MeasuredScene
from .scatter import Rows, estimated_deviations

COLUMNS = ("step", "quantity", "x1", "x2", "x3")
"""Columns of a table of measurements; the last one for solids only."""


@dataclass(eq=False, repr=False)
class SceneRegressor(LawEstimator):
    """Parameters of a law from measurements on a body of any shape, such as displacement fields and
    forces.

    The test is described by a scene. Its equilibria and their exact derivatives by the parameters
    (theory, section 23, with branches or softening (100a)) are those of a bounded least-squares
    iteration (Gauss-Newton steps in a trust region), so that noisy fields are never differentiated.
    A finer simulation of the fitted law corrects the simulation at the spacing of the scene; the
    standard errors contain an estimate of the discretization error that remains (theory, section
    28). A fit takes seconds to many
    minutes; `pdsurrogate.progress` tells how far it is.

    Parameters
    ----------
    scene : Scene, str, path or list of these, default="hole"
        Test, or several tests of one material. The search starts at the material of a scene if this
        has the law that is fitted. K/mu is that of the scene unless `bulk_ratio` or `bulk_modulus`
        is given. Branches and softening of its material are fitted with the law, from its numbers
        on; those that are zero stay zero. The program of each scene then needs times.
    law : str or None, default="neo-hookean"
        Name of the law; None for an energy without a law, an average of energies of few terms of
        both invariants, weighted by how well they fit (theory, section 28). It is a
        `pdsurrogate.materials.Polyconvex`.
    n_terms : int, default=3
        Number of terms of Ogden's law; without effect for other laws.
    outputs : sequence of str, optional
        Dotted keys of other measurements than fields, such as ``"forces.right.0"`` or
        ``"probes.tip.displacement.1"``, in the order of the quantities 0, -1, -2 and so on in the
        table. The default, ``"force"``, is the force of the region that is pulled, positive in
        tension.
    refine : int, optional
        Ratio of the spacing of the scene to that of the finer simulation. With 1 the discretization
        error is not corrected, but estimated by a simulation with twice the spacing, and the
        estimate is part of the standard errors. By default 3 with a law and 6 without one, since
        the remaining error changes an energy of free terms more than a law.
    bulk_ratio : float, optional
        K/mu of the law.
    bulk_modulus : float, optional
        K instead of K/mu, in the unit of the stresses.
    random_state : int, default=0
        Seed of `members_`; nothing else is random.
    frame : {"scene", "image"}, optional
        Frame of places and displacements. With ``"image"`` they are those in the images of a
        camera, and the map from the image to the scene, with a rigid motion of the camera in each
        step, is fitted with the law by a robust loss (theory, section 28). None is the scene, but
        displacements are refused that a map, or another correction of a known mistake, would
        explain; ``"scene"`` makes this a warning.
    pixels_per : float, optional
        Length in the image of a unit of length of the scene, to 2 %: the start of the map.
    origin : sequence of float, shape (d,), optional
        Place in the image of the origin of the scene, to 2 % of the size of the body.
    subset : float, optional
        Width of the subsets that a program correlated, in the image: places nearer to an edge than
        half of it are left out.

    Attributes
    ----------
    law_ : Law
        Law with the parameters found.
    parameter_names_ : list of str
    parameters_ : ndarray, shape (n_parameters,)
    covariance_ : ndarray, shape (n_parameters, n_parameters)
        Covariance from the standard deviations of the measurements, times the lack of fit if it
        exceeds 1, plus the square of the change of the parameters by the remaining discretization
        error. For an energy without a law: the covariance of the average, with correlated
        residuals.
    standard_errors_ : ndarray, shape (n_parameters,)
        Infinite for parameters that the data do not determine at all.
    correlation_ : ndarray, shape (n_parameters, n_parameters)
    at_bound_ : list of str
        Parameters at a bound, whose standard errors have no meaning.
    undetermined_ : list of str
        Parameters in combinations whose relative standard error exceeds one half. For an energy
        without a law, terms whose own weights have such an error; the stresses may be determined
        nevertheless.
    lack_of_fit_ : float
        Sum of the squared residuals in standard deviations, divided by the degrees of freedom; 1 is
        expected.
    p_value_ : float
        Probability of a greater sum in a test of this law with these standard deviations.
    residuals_ : ndarray, shape (n_samples,)
        Measurements minus the fit, in their units.
    standard_deviations_ : ndarray, shape (n_samples,)
        Standard deviations of the measurements, given or estimated.
    discretization_ : ndarray, shape (n_samples,)
        Correction of the simulation at the spacing of the scene, in the units of the measurements.
        With ``refine=1`` it is not applied, and estimated by a simulation with twice the spacing.
    members_ : list of Law
        Laws whose spread shows what the measurements leave open: with parameters drawn from their
        covariance, within the bounds of the search; without a law, energies drawn by their weights
        in the average, with random errors. Empty if the measurements do not determine a parameter
        at all.
    domain_hull_ : list of list of float
        Half-planes (n1, n2, d) of the convex hull of the states in the simulated tests, as in
        ``hull`` of `pdsurrogate.forces.domain.Domain`, moved outwards by the margin of
        `EnergyRegressor`.
    stretch_range_ : tuple of float
        Least and greatest stretch in the plane, or in space, in the simulated tests.
    maps_ : dict of int to ImageMap
        Fitted maps from the image to the scene by the number of the scene, with standard errors;
        empty unless ``frame="image"``.
    weights_ : ndarray, shape (n_samples,)
        Weights of the squared residuals by the robust loss, 1 for measurements near the fit and 0
        for those that are left out.
    left_out_ : int
        Number of displacements beside the body or, by `subset`, too near to an edge.
    start_ : dict
        Start of the search. ``taken`` is ``"weak form"`` if an energy without a law was taken from
        the weak form at the measured displacements, else ``"default"``. ``chi_squared`` has the
        sums of squares at both starts, None where there is no equilibrium, and ``terms`` has the
        candidates; both are missing if no weak form was solved.
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
    >>> found = pds.SceneRegressor(scene, refine=1).fit(
    ...     X, [0.855, 1.526], standard_deviation=[0.01, 0.01]
    ... )
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
        "frame": [StrOptions({"scene", "image"}), None],
        "pixels_per": [None, Interval(Real, 0, None, closed="neither")],
        "origin": "no_validation",  # checked with its length
        "subset": [None, Interval(Real, 0, None, closed="left")],
    }

    scene: Scene | str | Path | Sequence = "hole"
    law: str | None = "neo-hookean"
    n_terms: int = 3
    outputs: Sequence[str] | None = None
    refine: int | None = None
    bulk_ratio: float | None = None
    bulk_modulus: float | None = None
    random_state: int = 0
    frame: str | None = None
    pixels_per: float | None = None
    origin: Sequence[float] | None = None
    subset: float | None = None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table of measurements, in their order in arrays.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.SceneRegressor("hole").columns
        ('step', 'quantity', 'x1', 'x2')
        """
        scenes = scenes_of(self)
        several = isinstance(self.scene, list | tuple)
        return (*(("scene",) if several else ()), *COLUMNS[: 2 + scenes[0].dimension])

    def fit(self, X, y, sample_weight=None, standard_deviation=None):
        """Fit the parameters of the law to measurements.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2 + d)
            What was measured, in the columns ``step``, the number of the output of the scene from
            1; ``quantity``: 1, 2 or 3 for a part of the displacement and 0, -1, ... for `outputs`;
            and ``x1``, ``x2`` (and ``x3``), the undeformed place, which outputs do not need: any
            numbers serve there. For a list of scenes the first column is ``scene``, the number of
            the scene from 0. A table (pandas) has these columns in any order.
        y : array-like, shape (n_samples,)
            Measured values in the units of the scene; the force of a sheet is per unit of
            thickness.
        sample_weight : array-like, shape (n_samples,), optional
            Weights of the squared residuals, in standard deviations; 0 leaves a row out.
        standard_deviation : float or array-like, shape (n_samples,), optional
            Standard deviation of each measurement. By default that of displacements is estimated
            from the differences of each field from local quadratic fits, and that of outputs is 0.5
            % of the greatest one.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If the law is unknown, a scene has no times for branches, X has other columns, steps or
            quantities than the scene, a place lies outside the body, displacements are unlike those
            of the scene, the law has no equilibrium at the start of the search, or an energy
            without a law is to be found from displacements alone or from too few measurements.
        TypeError
            If a parameter is of another kind than named above.

        Warns
        -----
        UserWarning
            If a row is a copy of another one, or ``refine=1`` and the discretization error cannot
            be estimated, or exceeds the standard deviations of the measurements.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> scene = pds.load_scene("hole", spacing=0.25)
        >>> model = pds.SceneRegressor(scene, refine=1).fit(
        ...     [[1, 0, 0, 0]], [3.0], standard_deviation=0.01
        ... )
        >>> model.parameter_names_
        ['shear_modulus']
        """
        self._begin_fit()
        if self.law is not None:
            check_fitted(self.law)
        if self.outputs is not None:
            check_names(
                self.outputs,
                "outputs",
                "such as ['force', 'probes.tip.displacement.0'], or None for the force",
            )
        self._check_image()
        X, y, weight = self._checked(X, y, sample_weight)
        used = weight > 0
        self.tests_ = self._tests_of(X[used])
        self._warn_of_copies(y[used])
        deviation = self._deviations(X, y, standard_deviation)
        self.standard_deviations_ = deviation
        self.residuals_, self.discretization_ = np.full((2, len(y)), np.nan)
        fit, self.discretization_[used] = fitted(
            self, y[used], np.sqrt(weight[used]) / deviation[used]
        )
        self.residuals_[used] = y[used] - fit
        weights = np.zeros(len(y))
        weights[used] = self.weights_
        self.weights_ = weights
        del self.tests_
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
        >>> model = pds.SceneRegressor(scene, refine=1).fit(
        ...     [[1, 0, 0, 0]], [3.0], standard_deviation=0.01
        ... )
        >>> model.predict([[1, 0, 0, 0]]).round(3).tolist()
        [3.0]
        """
        check_is_fitted(self)
        X = validate_data(self, in_order(X, self.columns, "X"), dtype=np.float64, reset=False)
        found = np.empty(len(X))
        for test, here in self._tests_of(X):
            test.follow(self.maps_)
            found[here] = test.simulate(self.law_, fine_spacing(self, test.scene))[0]
        return found

    def nominal_stress(self, X) -> tuple[np.ndarray, np.ndarray]:
        """Return nominal stresses of the fitted law in homogeneous states, with their standard
        errors by the covariance of the parameters.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretches along the stress and across it, as for
            `pdsurrogate.identification.LawRegressor`.

        Returns
        -------
        stress, standard_error : ndarray, shape (n_samples,)

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> scene = pds.load_scene("hole", spacing=0.25)
        >>> model = pds.SceneRegressor(scene, refine=1).fit(
        ...     [[1, 0, 0, 0]], [3.0], standard_deviation=0.03
        ... )
        >>> stress, error = model.nominal_stress([[1.5, 1.5**-0.5]])
        >>> bool(0.04 < error[0] / stress[0] < 0.05)
        True
        """
        check_is_fitted(self)
        wanted = "X must have two columns of positive stretches, along the stress and across it"
        check_numbers(X, "X", wanted)
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != 2 or not (X > 0).all():
            raise ValueError(
                f"{wanted}, not"
                f" {f'{X.min():g}' if X.ndim == 2 and X.shape[1] == 2 else f'the shape {X.shape}'}"
            )
        jacobian = stress_derivatives(self, X)
        variance = np.einsum("ij,jk,ik->i", jacobian, self.covariance_, jacobian)
        return nominal_stress(self.law_, X), np.sqrt(variance)

    def stated_deviations(self, X, y, stated: dict[int, float | None]) -> np.ndarray:
        """Return standard deviations of measurements: stated ones of all displacements or of an
        output, and estimated ones of the others.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2 + d)
            As for `fit`.
        y : array-like, shape (n_samples,)
        stated : dict
            Standard deviation by quantity: 1 for all displacements, 0, -1, ... for `outputs`; None
            for an estimate, as `fit` makes it.

        Returns
        -------
        ndarray, shape (n_samples,)

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.SceneRegressor("hole").stated_deviations(
        ...     [[1, 0, 0, 0]], [3.0], {0: None, 1: 1e-3}
        ... ).tolist()
        [0.015]
        """
        for values, what in ((X, "X"), (y, "y")):
            check_numbers(values, what, "give a row for each measurement")
        check_kind(
            stated,
            dict,
            "stated",
            "a dictionary of standard deviations by quantity, such as {1: 1e-3}",
        )
        X = np.asarray(in_order(X, self.columns, "X"), dtype=float)
        y = np.asarray(y, dtype=float)
        found = np.empty(len(y))
        for quantity, value in stated.items():
            check_kind(
                value, Real | None, f"stated: the value of {quantity}", "a positive number or None"
            )
            if value is not None and not 0 < value < np.inf:
                raise ValueError(
                    f"stated: the value of {quantity} must be a positive number or None, not"
                    f" {value:g}"
                )
        for test, here in self._tests_of(X):
            found[here] = estimated_deviations(test.rows, y[here])
            for quantity, value in stated.items():
                if value is not None:
                    found[
                        here[test.rows.is_field if quantity > 0 else test.rows.quantity == quantity]
                    ] = value
        return found

    def _check_image(self) -> None:
        """Raise ValueError for wrong statements about images, or any without images."""
        scenes = scenes_of(self)
        if self.frame != "image":
            if any(one is not None for one in (self.pixels_per, self.origin, self.subset)):
                raise ValueError("pixels_per, origin and subset are for frame='image' (--frame)")
        elif self.origin is not None:
            wanted = (
                "give the place in the image of the origin of the scene, a number for each axis"
            )
            check_numbers(self.origin, "origin", wanted)
            if np.shape(self.origin) != (scenes[0].dimension,):
                raise ValueError(f"origin: {wanted}")

    def _law_of(self, values) -> Law:
        return self.unknown_.law_of(values)

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

    def _tests_of(self, X: np.ndarray) -> list[tuple[MeasuredScene, np.ndarray]]:
        """Return each scene with its rows of a table, and the numbers of these rows."""
        scenes = scenes_of(self)
        columns = self.columns
        if X.ndim != 2 or X.shape[1] != len(columns):
            given = f"n_features = {X.shape[1]}" if X.ndim == 2 else f"the shape {X.shape}"
            raise ValueError(f"X must have the columns {', '.join(columns)}, but has {given}")
        whole = X[:, : X.shape[1] - scenes[0].dimension]
        if (whole != np.round(whole)).any():
            wrong = whole[whole != np.round(whole)][0]
            raise ValueError(
                f"{', '.join(columns[: whole.shape[1]])} must be whole numbers, not {wrong:g}"
            )
        number = whole[:, 0] if len(columns) > 2 + scenes[0].dimension else np.zeros(len(X))
        if (number < 0).any() or (number >= len(scenes)).any():
            raise ValueError(
                f"scene: the {len(scenes)} scenes are numbered from 0, so that there is no"
                f" {number.max():g}"
            )
        step, quantity = whole[:, -2:].astype(int).T
        tests = []
        for which, scene in enumerate(scenes):
            here = np.flatnonzero(number == which)
            if len(here):
                rows = Rows(step[here], quantity[here], X[here][:, whole.shape[1] :])
                kind = ImagedScene if self.frame == "image" else MeasuredScene
                tests.append((kind(scene, rows, self.outputs, which), here))
        return tests

    def _warn_of_copies(self, y: np.ndarray) -> None:
        """Warn of rows that repeat a measurement, each of which counts: in a file they are
        mostly copies.
        """
        for test, here in self.tests_:
            rows = test.rows
            places = np.where(test.rows.is_field[:, None], test.rows.places, 0.0)
            table = np.column_stack([rows.step, rows.quantity, places, y[here]])
            unique, counts = np.unique(table, axis=0, return_counts=True)
            for step, quantity, *_, value in unique[counts > 1][:1].tolist():
                what = (
                    f"displacement along x{quantity:.0f}"
                    if quantity > 0
                    else test.outputs[-int(quantity)][0]
                )
                warnings.warn(
                    f"X: {(counts - 1).sum()} rows of scene {test.scene.name} are copies of others,"
                    f" such as {what} = {value:.4g} in step {step:.0f}; each counts as a further"
                    " measurement: leave copies out",
                    stacklevel=3,
                )
