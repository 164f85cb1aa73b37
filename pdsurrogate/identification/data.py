"""Test data of rubber: nominal stress against stretch, in the modes of loading of laboratories."""

import csv
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Self

import numpy as np

from ..arguments import check_path, suggestion

MODES: dict[str, Callable] = {
    "uniaxial": lambda stretch: stretch**-0.5,
    "equibiaxial": lambda stretch: stretch,
    "pure-shear": lambda stretch: np.ones_like(stretch),
}
"""Lateral stretch of incompressible rubber as a function of the stretch, by mode of loading."""

BIAXIAL = "biaxial"
"""Mode of loading of biaxial tests, for which a file states two stretches and the stress along
each of them.
"""

CURVES = ("mode", "stretch", "nominal_stress")
GRID = ("stretch", "lateral_stretch", "nominal_stress", "lateral_stress")
"""Columns of the two kinds of test data files, without the optional ``weight``: `CURVES` of tests
in the modes of loading `MODES`, and `GRID` of biaxial tests.
"""


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
    """

    __test__ = False  # not a test case, whatever pytest thinks of the name

    name: str
    mode: np.ndarray
    stretches: np.ndarray
    nominal_stress: np.ndarray
    weight: np.ndarray
    row: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))

    def __post_init__(self) -> None:
        if not len(self.row):
            object.__setattr__(self, "row", np.arange(1, len(self) + 1))

    def __len__(self) -> int:
        return len(self.nominal_stress)

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

    def loading(self) -> Self:
        """Return the rows of first loading: without those in which the strain of a mode is less
        than before, see `unloading`.
        """
        return self.where(~self.unloading)

    @property
    def unloading(self) -> np.ndarray:
        """Mask of the rows, shape (n,), in which the strain is less than in an earlier row of the
        mode; none if strains only fall.

        Rows of biaxial tests are none, as their order says nothing.
        """
        found = np.zeros(len(self), dtype=bool)
        strain = np.abs(np.log(self.stretches[:, 0]))
        for mode in set(self.modes) - {BIAXIAL}:
            rows = np.flatnonzero(self.mode == mode)
            greatest = np.maximum.accumulate(strain[rows])
            found[rows] = (strain[rows] < greatest) & (greatest[-1] > greatest[0])
        return found

    def where(self, rows: np.ndarray) -> Self:
        """Return the given rows: a mask of shape (n,), or their indices in the order wanted."""
        return type(self)(
            self.name,
            self.mode[rows],
            self.stretches[rows],
            self.nominal_stress[rows],
            self.weight[rows],
            self.row[rows],
        )

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


setattr(test_data_names, "__test__", False)  # noqa: B010


def load_test_data(reference: str | Path) -> TestData:
    """Return test data by name (``treloar``, ``kawabata``), or from a CSV file.

    A file has the columns ``mode`` (uniaxial, equibiaxial or pure-shear), ``stretch`` and
    ``nominal_stress``; or ``stretch``, ``lateral_stretch``, ``nominal_stress`` and
    ``lateral_stress``; both kinds may have a ``weight``. Lines that begin with # are comments.

    Parameters
    ----------
    reference : str or path
        Name of the shipped data, or path of a CSV file.

    Returns
    -------
    TestData

    Raises
    ------
    ValueError
        If the file cannot be read, or a row is invalid; the message names the row.

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
    check_path(reference, "test data")
    name = str(reference)
    included = name in test_data_names()
    file = resources.files(__package__) / f"{name}.csv" if included else Path(reference)
    try:
        columns, rows = read_table(file, name)
    except OSError as error:
        raise ValueError(
            f"cannot read test data {name}: {error.strerror};"
            f" {suggestion(name, test_data_names(), 'included are')}"
        ) from None
    if twice := [column for column in columns if columns.count(column) > 1]:
        raise ValueError(f"{name}: the file has the column {min(twice)} more than once")
    kind = next((kind for kind in (CURVES, GRID) if set(columns) - {"weight"} == set(kind)), None)
    if kind is None:
        raise ValueError(
            f"{name}: columns must be {', '.join(CURVES)}, or {', '.join(GRID)} and weight, not"
            f" {', '.join(sorted(columns))}"
        )
    found: list[tuple] = []
    for place, (where, cells) in enumerate(rows, start=1):
        found += [(*one, place) for one in _rows(cells, kind, where)]
    if not found:
        raise ValueError(f"{name}: there are no rows")
    mode, *first_second, stress, weight, row = map(np.array, zip(*found, strict=True))
    return TestData(name, mode, np.stack(first_second, axis=1), stress, weight, row)


def read_table(file, name: str) -> tuple[list[str], list[tuple[str, dict[str, str]]]]:
    """Return the columns of a CSV file, and its rows by column with their places for messages;
    raise ValueError for text that is not UTF-8, and for lines of another length.

    Lines that begin with # are comments.
    """
    try:
        text = file.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"cannot read {name}: it is not UTF-8 text") from None
    reader = csv.reader(
        "" if line.isspace() or line.lstrip().startswith("#") else line
        for line in text.splitlines()
    )
    (_, columns), *rows = [(reader.line_num, row) for row in reader if row] or [(0, [])]
    found = []
    for number, values in rows:
        where = f"{name}, line {number}"
        if len(values) != len(columns):
            raise ValueError(
                f"{where}: the line has {len(values)} values for {len(columns)} columns; decimals"
                " have points, not commas"
            )
        found.append((where, dict(zip(columns, values, strict=True))))
    return columns, found


def number_in(row: dict[str, str], key: str, where: str) -> float:
    """Return the number in a column of a row; raise ValueError for text or a number that is not
    finite.
    """
    try:
        found = float(row[key])
    except ValueError:
        raise ValueError(f"{where}: {key} is not a number: {row[key]!r}") from None
    if not np.isfinite(found):
        raise ValueError(f"{where}: {key} must be finite")
    return found


def _rows(row, kind, where):
    """Return tuples (mode, stretch, lateral stretch, stress, weight) for a row of a file: one for
    each stress.

    `kind` is `CURVES` or `GRID`, and `where` names the row in the message of the ValueError that an
    invalid row raises.
    """
    numbers = {}
    for key in row.keys() - {"mode"}:
        numbers[key] = number_in(row, key, where)
        if "stress" not in key and numbers[key] <= 0:
            hint = "; a stretch is 1 + strain" if "stretch" in key else ""
            raise ValueError(f"{where}: {key} must be positive, not {numbers[key]:g}{hint}")
    first = numbers["stretch"]
    stress = numbers["nominal_stress"]
    weight = numbers.get("weight", 1.0)
    if kind is GRID:
        second = numbers["lateral_stretch"]
        return [
            (BIAXIAL, first, second, stress, weight),
            (BIAXIAL, second, first, numbers["lateral_stress"], weight),
        ]
    mode = row["mode"].strip()
    if mode not in MODES:
        raise ValueError(f"{where}: unknown mode {mode!r}; there are {', '.join(MODES)}")
    return [(mode, first, float(MODES[mode](np.float64(first))), stress, weight)]
