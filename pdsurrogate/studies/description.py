"""Description of a study: the scene or fit to repeat, the parameters that change from run to
run, and their values in each run.
"""

import itertools
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field

from ..arguments import check_path, suggestion
from ..scenes import MaterialSpec, SceneError, scene_names
from ..scenes.reading import leaves, read_description
from ..scenes.strict_model import Finite, StrictModel, Whole

MOST_RUNS = 100_000
"""Greatest number of runs of a study; a larger grid is treated as a mistake."""

USUAL = ("uniform", "loguniform", "norm", "truncnorm", "lognorm", "triang", "randint")
"""Examples of distributions that the error message for an unknown distribution lists."""

SEEDS = "body.seed", "fracture.strength.scatter.seed"
"""Parameters over whose values a study takes means unless it names others."""

FORCE = "force"
"""Name of the parameter, in a study of a scene, that selects the force model instead of changing
a key of the scene.
"""


class Distribution(StrictModel):
    """Distribution from which a study draws the values of a parameter: a distribution of
    `scipy.stats` by name, with its parameters.

    Parameters
    ----------
    distribution : str
        Name of the distribution.
    **extra_data : float
        Parameters of the distribution, named as in `scipy.stats`, such as ``loc`` and ``scale``.

    See Also
    --------
    pdsurrogate.Study : draws the values of parameters from distributions.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> radius = pds.studies.Distribution(distribution="uniform", loc=0.2, scale=0.6)
    >>> print(round(float(radius.build().ppf(0.5)), 6))
    0.5
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, Finite]

    distribution: str

    def model_post_init(self, context: Any) -> None:
        self.build()

    @property
    def discrete(self) -> bool:
        """True if the values of the distribution are whole numbers.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.studies.Distribution(distribution="randint", low=1, high=5).discrete
        True
        """
        from scipy import stats

        return isinstance(getattr(stats, self.distribution), stats.rv_discrete)

    def build(self):
        """Return the distribution of `scipy.stats` with its parameters fixed ("frozen").

        Returns
        -------
        scipy.stats.rv_frozen

        Raises
        ------
        ValueError
            For an unknown distribution, an unknown or missing parameter, or an invalid value.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> float(
        ...     pds.studies.Distribution(distribution="uniform", loc=0.0, scale=2.0).build().mean()
        ... )
        1.0
        """
        from scipy import stats

        kinds = stats.rv_continuous | stats.rv_discrete
        known = [name for name, kind in vars(stats).items() if isinstance(kind, kinds)]
        if self.distribution not in known:
            raise ValueError(
                f"unknown distribution {self.distribution!r};"
                f" {suggestion(self.distribution, USUAL, 'scipy.stats has', known)}"
            )
        kind = getattr(stats, self.distribution)
        given = self.model_extra or {}
        needed = kind.shapes.split(", ") if kind.shapes else []
        takes = [*needed, "loc", *([] if self.discrete else ["scale"])]
        if not set(needed) <= set(given) <= set(takes):
            raise ValueError(
                f"{self.distribution} has the parameters {', '.join(takes)}"
                f"{' and needs ' * bool(needed)}{', '.join(needed)}; given are {', '.join(given)}"
            )
        frozen = kind(**given)
        if not np.isfinite(frozen.ppf([0.25, 0.5, 0.75])).all():
            raise ValueError(
                f"{self.distribution} is undefined for"
                f" {', '.join(f'{key}={value:g}' for key, value in given.items())}"
            )
        return frozen


class Fit(StrictModel):
    """Table ``fit`` of a study of fits: the material, and settings of
    `pdsurrogate.learning.settings.FitSettings` as further keys.

    Parameters
    ----------
    material : MaterialSpec or str
        Material to learn.
    **extra_data
        Settings of the fit.
    """

    model_config = ConfigDict(extra="allow", frozen=True)

    material: MaterialSpec = Field(default_factory=lambda: MaterialSpec(law="neo-hookean"))


def _flattened(table: Any) -> Any:
    """Return a flat dictionary with dotted keys from the nested tables that TOML makes of unquoted
    dotted keys.

    The table of a distribution (with a key "distribution") stays a table; anything but a table is
    returned unchanged.
    """
    if not isinstance(table, Mapping):
        return table
    return dict(leaf for key, entry in table.items() for leaf in leaves(entry, _is_value, str(key)))


def _is_value(entry: Any) -> bool:
    return not isinstance(entry, Mapping) or "distribution" in entry


def _values(values: Any) -> Any:
    """Return the values of a parameter as a tuple (from a list or array) or a `Distribution`
    (from a table); ValueError if invalid.
    """
    if isinstance(values, Distribution):
        return values
    if isinstance(values, Mapping):
        return Distribution(**values)
    if isinstance(values, np.ndarray):
        values = values.tolist()
    if not isinstance(values, list | tuple | range):
        shown = f"[{values}]" if isinstance(values, int | float) else "[...]"
        raise ValueError(
            f"must be a list of values, such as {shown}, or a table with a distribution, not"
            f" {values!r}"
        )
    if not len(values):
        raise ValueError("must contain at least one value")
    return tuple(values)


Values = Annotated[tuple[Any, ...] | Distribution, BeforeValidator(_values)]
Names = Annotated[
    tuple[str, ...],
    Field(min_length=1),
    BeforeValidator(lambda names: (names,) if isinstance(names, str) else names),
]


class Study(StrictModel):
    """Description of many runs of a scene, or of many fits.

    Parameters
    ----------
    scene : str, optional
        Name or file of a scene; either this or `fit` is required.
    fit : dict, optional
        Material and settings of a fit.
    force : str, optional
        Force model of all runs: the name of an exact one, such as ``"analytic"``, or an artifact.
    set : dict
        Changes to the scene for all runs, by dotted key.
    parameters : dict
        Values that change from run to run, by dotted key of the scene or fit: a list, or a
        distribution. For a scene, ``force`` can be a key, too.
    design : {"grid", "zip", "random", "latin-hypercube"}
        ``"grid"`` combines every value of a parameter with every value of the others; ``"zip"``
        combines the first values of all parameters, then the second values and so on; ``"random"``
        and ``"latin-hypercube"`` draw the values of `samples` runs, the first independently, the
        second evenly over the distribution of each parameter. The entries of a list are equally
        probable.
    samples : int, optional
        Number of runs to draw; required for the two random designs.
    seed : int
        Seed of the draw.
    quantities : tuple of str, optional
        Columns of the table: dotted keys of a run's ``summary.json``, or of the last entry of its
        ``levels``. By default the convergence, stresses or forces, peak and path of a crack,
        probes, evaluations and seconds.
    derivatives : tuple of str, optional
        Measurements whose derivatives at the last output of each run are further columns, as
        ``outputs`` of `pdsurrogate.Result.sensitivity`: by each of the `parameters` that is a
        number of ``material``, ``materials``, ``loads``, ``prescribed`` or ``obstacles``, or
        ``stretches``. They need the equilibrium once more, and a solution of linear equations each.
    mean_over : tuple of str, optional
        Parameters whose values repeat a run, such as seeds: a second table gives mean and deviation
        of every quantity over these runs. By default ``body.seed`` and
        ``fracture.strength.scatter.seed``, if they are among the `parameters`.

    See Also
    --------
    pdsurrogate.study : carries out a study.
    pdsurrogate.studies.Distribution : distribution of a parameter.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> described = pds.Study(scene="uniaxial", parameters={"material.shear_modulus": [1.0, 2.0]})
    >>> described.design
    'grid'
    """

    scene: str | None = None
    fit: dict[str, Any] | None = None
    force: str | None = None
    set: Annotated[dict[str, Any], BeforeValidator(_flattened)] = Field(default_factory=dict)
    parameters: Annotated[dict[str, Values], BeforeValidator(_flattened)]
    design: Literal["grid", "zip", "random", "latin-hypercube"] = "grid"
    samples: Annotated[Whole, Field(ge=1, le=MOST_RUNS)] | None = None
    seed: Annotated[Whole, Field(ge=0)] = 0
    quantities: Names | None = None
    derivatives: Names | None = None
    mean_over: Names | None = None

    @property
    def repeated(self) -> tuple[str, ...]:
        """Parameters over which means are taken.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.Study(scene="tear", parameters={"spacing": [0.1], "body.seed": [1, 2, 3]}).repeated
        ('body.seed',)
        """
        return self.mean_over or tuple(key for key in SEEDS if key in self.parameters)

    def model_post_init(self, context: Any) -> None:
        drawn = self.design in ("random", "latin-hypercube")
        key = "force" if self.force is not None else "set"
        to_draw = "to draw samples, use design=random or design=latin-hypercube"
        for wrong, message in (
            ((self.scene is None) == (self.fit is None), "a study needs either a scene or a [fit]"),
            (
                not self.parameters,
                "parameters: there are none; name one and give its values, or its distribution",
            ),
            (
                self.fit is not None and (self.force is not None or self.set),
                f"{key}: applies to scenes only; put settings common to all fits in [fit]",
            ),
            (
                self.fit is not None and self.derivatives,
                "derivatives: applies to scenes only, whose equilibria have derivatives",
            ),
            (
                self.force is not None and FORCE in self.parameters,
                "force: is also a parameter; set it in one place only",
            ),
            *(
                (key not in self.parameters, f"mean_over: {key!r} is not one of the parameters")
                for key in self.mean_over or ()
            ),
            *(
                (
                    key in self.parameters,
                    f"set.{key}: is also a parameter; set it in one place only",
                )
                for key in self.set
            ),
            (
                drawn and self.samples is None,
                f"samples: design={self.design} needs the number of samples",
            ),
            (
                not drawn and self.samples,
                f"samples: design={self.design} uses every value of the lists; {to_draw}",
            ),
        ):
            if wrong:
                raise ValueError(message)
        for key, values in self.parameters.items():
            if not drawn and isinstance(values, Distribution):
                raise ValueError(
                    f"parameters.{key}: a distribution needs design=random or"
                    f" design=latin-hypercube, not {self.design}"
                )


def load_study(given: Study | Mapping[str, Any] | str | Path) -> tuple[Study, str, Path]:
    """Return a study from a file or a mapping, the name of this source for error messages, and the
    folder of relative scene files.

    Raise SceneError if the study cannot be read or is invalid; the message names the wrong key.
    """
    source = "study"
    folder = Path()
    if isinstance(given, Study):
        return given, source, folder
    if isinstance(given, Mapping):
        data = dict(given)
    else:
        check_path(given, "a study")
        source = str(given)
        folder = Path(given).parent
        data = read_description(Path(given), "study")
    try:
        return Study(**data), source, folder
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None


def scene_of(study: Study, folder: Path) -> str:
    """Return the argument of `load_scene` for a study's scene: the name of a built-in scene, or
    the path of its file in `folder`.
    """
    scene = study.scene or ""
    place = folder / scene
    known = scene in scene_names() or (place.suffix != ".toml" and not place.exists())
    return scene if known else str(place)


def parameters_of_runs(study: Study) -> list[dict[str, Any]]:
    """Return the values of the parameters of each run, by dotted key; in the design "grid" the last
    parameter changes fastest.

    Raise SceneError if the lists of the design "zip" differ in length, or if a grid has more than
    `MOST_RUNS` runs.
    """
    keys = list(study.parameters)
    values = list[Any](study.parameters.values())
    rows: Iterable[tuple]
    if study.design == "grid":
        number = math.prod(map(len, values))
        if number > MOST_RUNS:
            raise SceneError(
                f"parameters: the grid has {number} runs, more than the limit {MOST_RUNS}; use"
                " design=latin-hypercube to draw a sample from it"
            )
        rows = itertools.product(*values)
    elif study.design == "zip":
        if len({len(entries) for entries in values}) > 1:
            told = ", ".join(
                f"{key} has {len(entries)}" for key, entries in zip(keys, values, strict=True)
            )
            raise SceneError(
                f"parameters: design=zip needs lists of equal length, but {told} values"
            )
        rows = zip(*values, strict=True)
    else:
        rows = zip(*map(_drawn, values, _shares(study, len(keys)).T), strict=True)
    return [dict(zip(keys, row, strict=True)) for row in rows]


def _shares(study: Study, dimension: int) -> np.ndarray:
    """Return the drawn probability (0 to 1) of the quantile that each run takes of each
    parameter, shape (samples, dimension).
    """
    random = np.random.default_rng(study.seed)
    samples = study.samples or 0
    if study.design == "random":
        return random.random((samples, dimension))
    from scipy.stats.qmc import LatinHypercube

    return LatinHypercube(dimension, rng=random).random(samples)


def _drawn(values: tuple | Distribution, shares: np.ndarray) -> list:
    """Return the values of a parameter at quantiles from 0 to 1 (`shares`), of a distribution or
    a list with equally probable entries.
    """
    if isinstance(values, Distribution):
        quantiles = values.build().ppf(shares)
        return [int(value) if values.discrete else float(value) for value in quantiles]
    return [values[min(int(share * len(values)), len(values) - 1)] for share in shares]
