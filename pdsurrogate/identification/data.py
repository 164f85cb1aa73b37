"""Test data of rubber: nominal stress against stretch, in the modes of loading of laboratories."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..arguments import suggestion
from ..measurements import MechanicalTests, read_tests
from ..measurements.specimens import BIAXIAL
from .campaign import read_sources, sources

MODES: dict[str, Callable] = {
    "uniaxial": lambda stretch: stretch**-0.5,
    "equibiaxial": lambda stretch: stretch,
    "pure-shear": lambda stretch: np.ones_like(stretch),
}
"""Lateral stretch of incompressible rubber as a function of the stretch, by mode of loading."""


class TestDataWarning(UserWarning):
    """Warning that test data, or a fit to test data, look wrong, or that something was assumed."""

    __test__ = False


@dataclass(frozen=True)
class TestData:
    """Test data of rubber: in each row a mode of loading, two stretches, a measured nominal stress
    and a weight.

    Attributes
    ----------
    name : str
    mode : ndarray of str, shape (n,)
    stretches : ndarray, shape (n, 2)
        Stretches along the stress and across it.
    nominal_stress : ndarray, shape (n,)
    weight : ndarray, shape (n,)
        Weights of the file, or 1.
    row : ndarray of int, shape (n,), optional
        Numbers of the rows in the file, from 1, without header and comments; by default from 1 to
        n.
    tests : MechanicalTests, optional
        What the rows were chosen from: specimens with all of their rows, cycles, times and breaks.
    time : ndarray, shape (n,), optional
        NaN where the tests have no times, as by default.
    curve : ndarray of int, shape (n,), optional
        Number of the specimen, from 0; by default 0.
    """

    __test__ = False  # not a test case, whatever pytest thinks of the name

    name: str
    mode: np.ndarray
    stretches: np.ndarray
    nominal_stress: np.ndarray
    weight: np.ndarray
    row: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))
    tests: MechanicalTests | None = None
    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    curve: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))

    def __post_init__(self) -> None:
        for key, values in (
            ("row", np.arange(1, len(self) + 1)),
            ("time", np.full(len(self), np.nan)),
            ("curve", np.zeros(len(self), dtype=int)),
        ):
            if not len(getattr(self, key)):
                object.__setattr__(self, key, values)

    def __len__(self) -> int:
        return len(self.nominal_stress)

    @property
    def unit(self) -> str | None:
        """Unit of the stresses, None if it is not stated."""
        return self.tests.unit if self.tests else None

    @property
    def modes(self) -> list[str]:
        """Modes of the rows, in the order of their first rows."""
        return list(dict.fromkeys(self.mode.tolist()))

    def of(self, *modes: str) -> Self:
        """Return the test data of the given modes of loading; raise ValueError for a mode
        without rows.
        """
        if unknown := sorted({*modes} - {*self.modes}):
            raise ValueError(
                f"{self.name}: no rows of {', '.join(unknown)}; there are"
                f" {', '.join(sorted(self.modes))}"
            )
        return self.where(np.isin(self.mode, modes))

    def up_to(self, stretch: float) -> Self:
        """Return the rows in which neither of the two stretches exceeds `stretch`; raise
        ValueError if there are no such rows.
        """
        chosen = np.all(self.stretches <= stretch, axis=1)
        if not chosen.any():
            raise ValueError(f"{self.name}: all rows have stretches above {stretch:g}")
        return self.where(chosen)

    def where(self, rows: np.ndarray) -> Self:
        """Return the given rows: a mask of shape (n,), or their indices in the order wanted."""
        arrays = {key: one for key, one in vars(self).items() if isinstance(one, np.ndarray)}
        return replace(self, **{key: values[rows] for key, values in arrays.items()})

    def histories(self, timed: bool = True) -> np.ndarray:
        """Return the rows as a `HistoryRegressor` takes them, shape (n, 4): stretches, time and
        curve; raise ValueError for biaxial rows, and, if branches need times, for rows without one,
        whose times are 0 otherwise.
        """
        if BIAXIAL in self.modes:
            raise ValueError(f"{self.name}: biaxial tests are not fitted with branches: use --law")
        timeless = np.flatnonzero(np.isnan(self.time)).tolist()
        if timeless and timed:
            raise ValueError(
                f"{self.name}: {self.row_in_words(timeless[0])} has no time: branches need a column"
                " of times, or the rate of stretch (--rate)"
            )
        time = np.zeros(len(self)) if timeless else self.time
        return np.column_stack([self.stretches, time, self.curve])

    def row_in_words(self, number: int) -> str:
        """Return the number in the file, mode, stretch and stress of a row as text for a
        message; `number` is the row's index, from 0.
        """
        first, second = self.stretches[number]
        at = (
            f"stretches {first:g} and {second:g}"
            if self.mode[number] == BIAXIAL
            else f"stretch {first:g}"
        )
        return (
            f"row {self.row[number]} ({self.mode[number]}, {at}, nominal stress"
            f" {self.nominal_stress[number]:g})"
        )

    def balanced_weights(self) -> np.ndarray:
        """Return row weights that make the sum of weighted squared residuals the sum of 1 - R^2
        over the modes: no mode dominates.
        """
        weights = self.weight.copy()
        for mode in self.modes:
            rows = self.mode == mode
            stress = self.nominal_stress[rows]
            with np.errstate(over="ignore", invalid="ignore"):  # checked below
                spread = (
                    self.weight[rows]
                    * (stress - np.average(stress, weights=self.weight[rows])) ** 2
                ).sum()
            size = spread if spread > 0 else (self.weight[rows] * stress**2).sum()
            if not 0 < size < np.inf:
                raise ValueError(
                    f"{self.name}: the stresses of mode {mode} are all zero, or so large that their"
                    " squares overflow"
                )
            weights[rows] /= size
        return weights

    def r_squared(self, predicted: np.ndarray) -> dict[str, float]:
        """Return, by mode, R^2 of predicted stresses, shape (n,), for the modes with at least
        two different stresses.
        """
        found = {}
        for mode in self.modes:
            rows = self.mode == mode
            stress = self.nominal_stress[rows]
            spread = ((stress - stress.mean()) ** 2).sum()
            if spread > 0:
                found[mode] = float(1 - ((predicted[rows] - stress) ** 2).sum() / spread)
        return found


def test_data_names() -> list[str]:
    """Return the names of the test data that are shipped with the package."""
    return sorted(
        path.name.removesuffix(".csv")
        for path in resources.files(__package__).iterdir()
        if path.name.endswith(".csv")
    )


def load_test_data(*references: str | Path, history: bool = False, **stated: Any) -> TestData:
    """Return test data by name (``treloar``, ``kawabata``), or from files of testing machines,
    workbooks, decks or plain tables.

    Columns ``mode`` (uniaxial, equibiaxial or pure-shear), ``stretch`` and ``nominal_stress``, or
    ``stretch``, ``lateral_stretch``, ``nominal_stress`` and ``lateral_stress``, both with an
    optional ``weight``, need nothing else; of other tables the user states what they leave open.
    Of a test that unloads the first loading is taken, unless ``branch`` says otherwise.

    Parameters
    ----------
    *references : str or path
        Name of shipped data; or paths of files, whose rows make one data set, with a mode after a
        colon (``"ps.csv:pure-shear"``) if it is that of the file alone; or a campaign
        (``"tests.toml"``), which names files and states what they leave open.
    history : bool
        Whether all rows up to a break are taken unless ``branch`` says otherwise: loading,
        unloading and holds, as fits of branches need them.
    **stated
        What the files leave open, such as ``mode="uniaxial"``, ``gauge_length="25 mm"``,
        ``area="12 mm2"``: arguments of `pdsurrogate.measurements.read_tests`.

    Returns
    -------
    TestData

    Raises
    ------
    ValueError
        If a file cannot be read, leaves something open, contradicts what is stated, or a row is
        invalid; the message says what to state.

    Warns
    -----
    TestDataWarning
        Of everything that was assumed or left out.

    See Also
    --------
    pdsurrogate.fit_to_tests : fits a law or an energy to test data, and examines both.
    pdsurrogate.identification.LawRegressor : fits the parameters of a law.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar")
    >>> data.up_to(3.0).stretches.shape[1]
    2
    """
    names = test_data_names()
    if any(str(reference) in names for reference in references):
        if len(references) > 1 or stated:
            raise ValueError(f"{references[0]} is complete: give no other files, and state nothing")
        file = Path(str(resources.files(__package__) / f"{references[0]}.csv"))
        tests = read_tests(file, units={"stress": "MPa"})
        return test_data_of(replace(tests, name=str(references[0])))
    found = sources(references, stated)
    if history:
        found = [(path, {"branch": "all", **facts}) for path, facts in found]
    if missing := [path for path, _ in found if not path.exists()]:
        raise ValueError(
            f"cannot read test data {missing[0]}: there is no such file;"
            f" {suggestion(str(missing[0]), names, 'included are')}"
        )
    tests = read_sources(found)
    for text in tests.assumed:
        warnings.warn(text, TestDataWarning, stacklevel=2)
    return test_data_of(tests)


def test_data_of(tests: MechanicalTests) -> TestData:
    """Return the rows that were chosen of mechanical tests as test data; raise ValueError for what
    is still missing, and for tests without rows.
    """
    if tests.missing:
        raise ValueError("; ".join(tests.missing))
    found: list[tuple] = []
    scatter = tests.scatter
    for number, specimen in enumerate(tests.specimens):
        weights = np.where(np.isnan(specimen.weight), 1.0, specimen.weight)
        if len({*np.isnan(specimen.weight[specimen.chosen])}) > 1:
            raise ValueError(f"{tests.name}: some rows have no weight: all have one, or none")
        if not np.isfinite(specimen.weight).any() and specimen.mode in scatter:
            weights = scatter[specimen.mode].weights(specimen.nominal_stress)
        for place in np.flatnonzero(specimen.chosen):
            row, first, weight = specimen.row[place], specimen.stretch[place], weights[place]
            if not 0 < weight < np.inf:
                raise ValueError(f"{tests.name}, row {row}: weight must be positive")
            along, time = specimen.nominal_stress[place], specimen.time[place]
            if specimen.mode == BIAXIAL:
                second, across = specimen.lateral_stretch[place], specimen.lateral_stress[place]
                found.append((BIAXIAL, first, second, along, weight, time, number, row))
                found.append((BIAXIAL, second, first, across, weight, time, number, row))
            else:
                second = MODES[specimen.mode](first)
                found.append((specimen.mode, first, second, along, weight, time, number, row))
    if not found:
        more = " of tension: a tearing energy needs a law" if tests.tears else ""
        raise ValueError(f"{tests.name}: there are no rows{more}")
    found.sort(key=lambda one: one[-1])
    mode, first, second, stress, weight, time, curve, row = (
        np.array(one) for one in zip(*found, strict=True)
    )
    stretches = np.column_stack([first, second])
    return TestData(tests.name, mode, stretches, stress, weight, row, tests, time, curve)


for _ in (test_data_names, test_data_of):
    setattr(_, "__test__", False)  # noqa: B010
