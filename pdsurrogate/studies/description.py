"""What a user writes: what is run or fitted, and the parameters that change from run to run."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, ValidationError, field_validator, model_validator

from ..arguments import check_path
from ..scenes import MaterialSpec, SceneError, scene_names
from ..scenes.problems import explain, suggestion
from ..scenes.reading import read_description
from ..scenes.strict_model import Finite, Positive, StrictModel, Whole

MOST_RUNS = 100_000
"""Of a study: more are a mistake in a grid."""

USUAL = ("uniform", "loguniform", "norm", "truncnorm", "lognorm", "triang", "randint")
"""Distributions that are told where one is unknown."""

FORCE = "force"
"""The parameter of a study of a scene that is no key of the scene: which force model runs it."""


class Distribution(StrictModel):
    """A distribution of `scipy.stats` by its name, with its parameters by theirs.

    Examples
    --------
    >>> import pdsurrogate as pd
    >>> radius = pd.Distribution(distribution="uniform", loc=0.2, scale=0.6)
    >>> print(round(float(radius.build().ppf(0.5)), 6))
    0.5
    """

    model_config = ConfigDict(extra="allow", frozen=True)

    distribution: str

    @model_validator(mode="after")
    def _build(self) -> Distribution:
        self.build()
        return self

    @property
    def discrete(self) -> bool:
        """Whether its values are whole numbers."""
        from scipy import stats

        return isinstance(getattr(stats, self.distribution), stats.rv_discrete)

    def build(self):
        """The distribution, frozen.

        Raises
        ------
        ValueError
            For an unknown distribution, an unknown or missing parameter, or a value that makes no sense.
        """
        from scipy import stats

        known = [name for name in dir(stats) if isinstance(getattr(stats, name), stats.rv_continuous | stats.rv_discrete)]
        if self.distribution not in known:
            nearest = suggestion(self.distribution, known, "")
            meant = nearest if nearest.endswith("?") else f"names are those of scipy.stats, such as {', '.join(USUAL)}"
            raise ValueError(f"unknown distribution {self.distribution!r}; {meant}")
        kind = getattr(stats, self.distribution)
        shapes = kind.shapes.split(", ") if kind.shapes else []
        takes = [*shapes, "loc", *(["scale"] if isinstance(kind, stats.rv_continuous) else [])]
        given = dict(self.model_extra or {})
        for key, value in given.items():
            if key not in takes:
                raise ValueError(f"{self.distribution} has no parameter {key!r}; it has {', '.join(takes)}")
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise ValueError(f"{key} must be a finite number, not {value!r}")
        missing = [key for key in shapes if key not in given]
        if missing:
            raise ValueError(f"{self.distribution} needs {', '.join(missing)}; it has {', '.join(takes)}")
        frozen = kind(**given)
        if not np.isfinite(frozen.ppf([0.25, 0.5, 0.75])).all():
            raise ValueError(f"{self.distribution} makes no sense with {', '.join(f'{key}={value:g}' for key, value in given.items())}")
        return frozen


class Fit(StrictModel):
    """A fit of a surrogate, as `pdsurrogate fit` makes it; see `pdsurrogate.learning.settings.FitSettings` for the choices."""

    material: MaterialSpec = Field(default_factory=lambda: MaterialSpec(law="neo-hookean"))
    energy: bool = False
    features: str | None = None
    degree: int | tuple[int, ...] | str | None = None
    units: int | tuple[int, ...] | str | None = None
    activation: str | None = None
    samples: Annotated[Whole, Field(ge=200)] | None = None
    least: Positive | None = None
    greatest: Finite | None = None
    iterations: Annotated[Whole, Field(ge=1)] | None = None
    folds: Annotated[Whole, Field(ge=0)] = 5
    seed: Annotated[Whole, Field(ge=0)] = 0


class Study(StrictModel):
    """Many runs of a scene, or many fits.

    Attributes
    ----------
    scene : str, optional
        Name or file of a scene; this or `fit`.
    fit : dict, optional
        Settings of a fit, see `Fit`.
    force : str, optional
        Force model of all runs, as for `pdsurrogate.simulate`.
    set : dict
        What all runs change in the scene, by dotted key.
    parameters : dict
        By dotted key, the values that runs take: a list, or a `Distribution`.  Of a scene ``force`` is one as well.
    design : {"grid", "zip", "random", "latin-hypercube"}
        Every value with every other; the first values of all, then the second ones; or `samples` drawn at random, from a list every entry
        alike, independently or as a Latin hypercube, which spreads each parameter evenly.
    samples : int, optional
        Runs of a design that draws.
    seed : int
        Of a design that draws.
    quantities : tuple of str, optional
        Columns of the table: dotted keys of a run's ``summary.json``, or of its last level.

    Examples
    --------
    >>> import pdsurrogate as pd
    >>> described = pd.Study(scene="uniaxial", parameters={"material.shear_modulus": [1.0, 2.0]})
    >>> described.design
    'grid'
    """

    scene: str | None = None
    fit: dict[str, Any] | None = None
    force: str | None = None
    set: dict[str, Any] = Field(default_factory=dict)
    parameters: dict[str, tuple[Any, ...] | Distribution]
    design: Literal["grid", "zip", "random", "latin-hypercube"] = "grid"
    samples: Annotated[Whole, Field(ge=1, le=MOST_RUNS)] | None = None
    seed: Annotated[Whole, Field(ge=0)] = 0
    quantities: Annotated[tuple[str, ...], Field(min_length=1)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _flat(cls, data: Any) -> Any:
        """Dotted keys, which TOML reads as tables in tables unless they are quoted, as what they are."""
        if not isinstance(data, Mapping):
            return data
        data = dict(data)
        if isinstance(data.get("set"), Mapping):
            data["set"] = _flattened(data["set"])
        if isinstance(data.get("parameters"), Mapping):
            data["parameters"] = _flattened(data["parameters"])
            for key, values in data["parameters"].items():
                data["parameters"][key] = _values(key, values)
        return data

    @field_validator("quantities", mode="before")
    @classmethod
    def _one_or_many(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @model_validator(mode="after")
    def _whole(self) -> Study:
        if (self.scene is None) == (self.fit is None):
            raise ValueError("a study needs either a scene or a [fit]")
        if not self.parameters:
            raise ValueError("parameters: there are none; name one and give its values, or its distribution")
        if self.fit is not None and (self.force is not None or self.set):
            key = "force" if self.force is not None else "set"
            raise ValueError(f"{key}: belongs to a scene; what all fits have in common is said in [fit]")
        if self.force is not None and FORCE in self.parameters:
            raise ValueError("force: is a parameter as well; say it in one place")
        both = [key for key in self.set if key in self.parameters]
        if both:
            raise ValueError(f"set.{both[0]}: is a parameter as well; say it in one place")
        drawn = self.design in ("random", "latin-hypercube")
        if drawn and self.samples is None:
            raise ValueError(f"samples: design={self.design} needs their number")
        if not drawn and self.samples is not None:
            raise ValueError(f"samples: design={self.design} takes all values of the lists; design=random or latin-hypercube draws samples")
        for key, values in self.parameters.items():
            if not drawn and isinstance(values, Distribution):
                raise ValueError(f"parameters.{key}: a distribution needs design=random or design=latin-hypercube, not {self.design}")
        return self


def _flattened(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for step, value in table.items():
        key = f"{before}{step}"
        if isinstance(value, Mapping) and "distribution" not in value:
            flat |= _flattened(value, f"{key}.")
        else:
            flat[key] = value
    return flat


def _values(key: str, values: Any) -> Any:
    """A list or a distribution, of what was given for a parameter."""
    if isinstance(values, Distribution):
        return values
    if isinstance(values, Mapping):
        try:
            return Distribution.model_validate(values)
        except ValidationError as error:
            raise ValueError(f"parameters.{key}: {explain(error)}") from None
    if isinstance(values, np.ndarray):
        values = values.tolist()
    if not isinstance(values, list | tuple | range):
        shown = f"[{values}]" if isinstance(values, int | float) else "[...]"
        raise ValueError(f"parameters.{key}: must be a list of values, as {shown}, or a table with a distribution, not {values!r}")
    if not len(values):
        raise ValueError(f"parameters.{key}: is an empty list; give at least one value")
    return tuple(values)


def load_study(given: Study | Mapping[str, Any] | str | Path) -> tuple[Study, str, Path]:
    """A study, by the path of its file or as a mapping of the same keys.

    Returns
    -------
    Study
    str
        Where it comes from, for messages.
    Path
        Folder from which it names a scene file.

    Raises
    ------
    SceneError
        If it cannot be read, or makes no sense; the message names the key.
    """
    if isinstance(given, Study):
        return given, "study", Path()
    if isinstance(given, Mapping):
        return _checked(dict(given), "study"), "study", Path()
    check_path(given, "a study")
    path = Path(given)
    try:
        data = tomllib.loads(read_description(path))
    except OSError as error:
        raise SceneError(f"cannot read study file {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SceneError(f"{path}: not valid TOML: it is not UTF-8 text") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SceneError(f"{path}: not valid TOML: {error}") from None
    return _checked(data, str(path)), str(path), path.parent


def _checked(data: dict, source: str) -> Study:
    try:
        return Study.model_validate(data)
    except ValidationError as error:
        raise SceneError(f"{source}: {explain(error, Study)}") from None


def scene_of(study: Study, folder: Path) -> str:
    """The scene of a study: a built-in one by name, else a file, named from where the study stands."""
    place = folder / study.scene
    known = study.scene in scene_names() or (place.suffix != ".toml" and not place.exists())
    return study.scene if known else str(place)
