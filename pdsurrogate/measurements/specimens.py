"""Mechanical tests from tables of machines: what a user states of them, and what is found."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .breaks import weibull_modulus, with_deviation
from .quantities import GEOMETRY
from .table import TableFile

MODES = "uniaxial", "equibiaxial", "pure-shear"
"""Modes of loading, in which one stretch and one stress describe a test."""

TEARS = TROUSER, SHEAR_TEAR = "trouser", "pure-shear-tear"
"""Modes of tear tests: two legs that are pulled apart, and a strip with a long cut between wide
grips.
"""

ALL_MODES = (*MODES, *TEARS)
"""Modes that a file or a user can state."""

BIAXIAL = "biaxial"
"""Mode of tests with two stretches, and the stress along each of them."""


@dataclass(frozen=True)
class Facts:
    """Statements of a user about tests, beside those of their files.

    Attributes
    ----------
    mode : str, optional
        Mode of loading: "uniaxial", "equibiaxial" or "pure-shear", or that of a tear test,
        "trouser" or "pure-shear-tear".
    gauge_length, area, width, thickness, diameter : str, optional
        Of the undeformed specimen, with units: "25 mm", "12mm2"; the width of trousers is that of
        a leg, or says whose width the file states: "leg" or "specimen".
    columns : mapping, optional
        Column of a quantity (`pdsurrogate.measurements.table.QUANTITIES`, "strain" or "stress") by
        its heading or its number from 1: ``{"force": "Kraft", "stress": 2}``.
    units : mapping, optional
        Unit of a quantity whose column has none: ``{"stress": "kPa"}``.
    strain, stress : str, optional
        "engineering" or "true", where headings do not say which.
    branch : str or int, optional
        "loading" (default: the first loading), "unloading", "all", or the number of a cycle.
    rate : str or float, optional
        Rate of stretch, per second, of tests without times.
    zero : str, optional
        "shift" (default) moves the stretch at zero force to 1 where it is not, "keep" does not.
    broke : str or bool, optional
        Whether specimens broke, True or False, or "grips" if they broke there, "slipped" or
        "limit" (of the machine): by default what files say, or the drop of the load.
    stress_unit : str, optional
        Unit of the stresses of the result; by default MPa, or that of the files where they state
        none.
    """

    mode: str | None = None
    gauge_length: str | None = None
    area: str | None = None
    width: str | None = None
    thickness: str | None = None
    diameter: str | None = None
    columns: Mapping[str, str | int] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    strain: str | None = None
    stress: str | None = None
    branch: str | int | None = None
    rate: str | float | None = None
    zero: str | None = None
    broke: str | bool | None = None
    stress_unit: str | None = None

    def sizes(self) -> dict[str, str]:
        """Return the sizes of the specimen that are stated, by the names in `Block.facts`."""
        found = {name: getattr(self, name.replace(" ", "_")) for name in GEOMETRY}
        return {name: text for name, text in found.items() if text is not None}

    def unused(self, used: set[str]) -> str | None:
        """Return the first size or kind of strain or stress that is stated and not `used`."""
        kinds = {"strain": self.strain, "stress": self.stress}
        stated = [*self.sizes(), *(name for name, kind in kinds.items() if kind)]
        idle = [name.replace(" ", "-") for name in stated if name not in used]
        return f"--{idle[0]}" if idle else None


@dataclass(frozen=True)
class AtBreak:
    """State in which a specimen broke.

    Attributes
    ----------
    stretch, nominal_stress : float
    work : float
        Work per undeformed volume up to the break, in the unit of the stress.
    drops : bool
        Whether the load drops after it.
    no_strength : str, optional
        Why the stress is no strength, as that of a specimen that slipped.
    """

    stretch: float
    nominal_stress: float
    work: float
    drops: bool
    no_strength: str | None


@dataclass(frozen=True)
class Specimen:
    """Rows of one specimen in one mode of loading, in the order of the file.

    Attributes
    ----------
    name : str
    mode : str
        One of `MODES`, or "biaxial" with two stretches and two stresses.
    row : ndarray of int, shape (n,)
        Numbers of the rows among those of all tables that were read, from 1.
    stretch, nominal_stress : ndarray, shape (n,)
    lateral_stretch, lateral_stress, time, weight : ndarray, shape (n,)
        NaN where the file does not have them.
    cycle : ndarray of int, shape (n,)
        Number of the cycle, from 1.
    branch : ndarray of str, shape (n,)
        "loading", "unloading", "hold" or "broken" (after the break).
    chosen : ndarray of bool, shape (n,)
        Rows of the branch that was asked for.
    at_break : AtBreak, optional
        None if the specimen did not break.
    """

    name: str
    mode: str
    row: np.ndarray
    stretch: np.ndarray
    nominal_stress: np.ndarray
    lateral_stretch: np.ndarray
    lateral_stress: np.ndarray
    time: np.ndarray
    weight: np.ndarray
    cycle: np.ndarray
    branch: np.ndarray
    chosen: np.ndarray
    at_break: AtBreak | None = None

    def curve(self) -> tuple[np.ndarray, np.ndarray]:
        """Return stretches, in ascending order, and stresses of the rows that are chosen."""
        order = np.argsort(self.stretch[self.chosen], kind="stable")
        return self.stretch[self.chosen][order], self.nominal_stress[self.chosen][order]


@dataclass(frozen=True)
class Tear:
    """Tear of a specimen.

    Attributes
    ----------
    name : str
    mode : str
        One of `TEARS`.
    length : float
        Width of a leg of trousers, or height of a strip between the grips, in mm.
    nominal_stress : float
        Of the legs while the tear runs, or of the strip when it begins.
    stretch : float, optional
        Of the strip when the tear begins.
    """

    name: str
    mode: str
    length: float
    nominal_stress: float
    stretch: float | None = None


@dataclass(frozen=True)
class MechanicalTests:
    """Tests that were read from files of machines (`read_tests`).

    Attributes
    ----------
    name : str
    specimens : tuple of Specimen
    unit : str or None
        Unit of the stresses, None if neither file nor user states one.
    assumed : tuple of str
        Everything that was assumed or left out, a sentence each.
    missing : tuple of str
        What is needed before tables are tests, each with the option that states it; the tables
        have no specimens.
    tables : tuple of TableFile
        The files as they were read.
    tears : tuple of Tear
        Tear tests, which are no `specimens`.
    """

    name: str
    specimens: tuple[Specimen, ...] = ()
    unit: str | None = None
    assumed: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    tables: tuple[TableFile, ...] = ()
    tears: tuple[Tear, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows of all tables."""
        return sum(len(block.lines) for file in self.tables for block in file.blocks)

    @property
    def lateral_stretches(self) -> dict[int, float]:
        """Measured lateral stretches of uniaxial tests by the number of their row."""
        return {
            int(row): float(lateral)
            for one in self.specimens
            if one.mode == "uniaxial"
            for row, lateral in zip(one.row, one.lateral_stretch, strict=True)
            if np.isfinite(lateral)
        }

    @property
    def scatter(self) -> dict[str, "Scatter"]:
        """Scatter of the stresses by mode, for modes with several specimens that differ and whose
        rows are of loading alone.
        """
        found = {}
        loaded = [one for one in self.specimens if (one.branch[one.chosen] == "loading").all()]
        for mode in dict.fromkeys(one.mode for one in loaded if one.mode != BIAXIAL):
            curves = [one.curve() for one in loaded if one.mode == mode]
            scatter = Scatter.of([curve for curve in curves if len(curve[0]) > 1])
            if scatter is not None:
                found[mode] = scatter
        return found

    @property
    def at_break(self) -> dict[str, dict]:
        """Mean and standard deviation of stretch, stress and work at break of the specimens of each
        mode that broke, with their number; the Weibull modulus of the stress and its standard error
        from five on. Stresses that are no strength do not count.
        """
        broken: dict[str, list[AtBreak]] = {}
        for one in self.specimens:
            if one.at_break and not one.at_break.no_strength:
                broken.setdefault(one.mode, []).append(one.at_break)
        found: dict[str, dict] = {}
        for mode, ends in broken.items():
            found[mode] = {"specimens": len(ends)}
            for name in ("stretch", "nominal_stress", "work"):
                found[mode][name] = with_deviation([getattr(one, name) for one in ends])
            if modulus := weibull_modulus(np.array([one.nominal_stress for one in ends])):
                found[mode]["weibull_modulus"] = modulus
        return found


@dataclass(frozen=True)
class Scatter:
    """Variance of the stress P between specimens of a mode: `constant` + `relative` P^2, at least
    that of a twentieth of the greatest stress.

    Attributes
    ----------
    constant, relative : float
    greatest : float
        Greatest stress of the specimens.
    """

    constant: float
    relative: float
    greatest: float

    @classmethod
    def of(cls, curves: list[tuple[np.ndarray, np.ndarray]]) -> "Scatter | None":
        """Return the scatter of curves (stretch, stress) over the stretches that all of them have;
        None if there are less than two, or they are the same.
        """
        from scipy.optimize import nnls

        if len(curves) < 2:
            return None
        least = max(stretch[0] for stretch, _ in curves)
        most = min(stretch[-1] for stretch, _ in curves)
        if not least < most:
            return None
        places = np.linspace(least, most, 50)
        stresses = np.array([np.interp(places, *curve) for curve in curves])
        mean, variance = stresses.mean(axis=0), stresses.var(axis=0, ddof=1)
        greatest = max(float(np.abs(stress).max()) for _, stress in curves)
        columns = np.column_stack([np.full(50, greatest**2), mean**2])
        shares = nnls(columns, variance)[0]
        if not shares.sum() > 0:
            return None
        return cls(float(shares[0] * greatest**2), float(shares[1]), greatest)

    def weights(self, stress: np.ndarray) -> np.ndarray:
        """Return 1/variance of stresses."""
        size = np.maximum(np.abs(stress), self.greatest / 20)
        return 1 / (self.constant + self.relative * size**2)
