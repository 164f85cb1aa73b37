"""Mechanical tests from tables of machines: stretch and nominal stress of each specimen."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

MODES = "uniaxial", "equibiaxial", "pure-shear"
"""Modes of loading, in which one stretch and one stress describe a test."""


@dataclass(frozen=True)
class Facts:
    """What a user states of tests beside what their files state themselves.

    Attributes
    ----------
    mode : str, optional
        Mode of loading: "uniaxial", "equibiaxial" or "pure-shear".
    gauge_length, area, width, thickness, diameter : str, optional
        Of the undeformed specimen, with units: "25 mm", "12mm2".
    columns : mapping, optional
        Column of a quantity (`pdsurrogate.measurements.table.QUANTITIES`, "strain" or "stress") by
        its heading or its number from 1: ``{"force": "Kraft", "stress": 2}``.
    units : mapping, optional
        Unit of a quantity whose column has none: ``{"stress": "kPa"}``.
    strain, stress : str, optional
        "engineering" or "true", where headings do not say which.
    branch : str or int, optional
        "loading" (default: the first loading), "unloading", "all", or the number of a cycle.
    zero : str, optional
        "shift" (default) moves the stretch at zero force to 1 where it is not, "keep" does not.
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
    zero: str | None = None
    stress_unit: str | None = None


@dataclass(frozen=True)
class AtBreak:
    """State in which a specimen broke.

    Attributes
    ----------
    stretch, nominal_stress : float
    work : float
        Work per undeformed volume up to the break, in the unit of the stress.
    """

    stretch: float
    nominal_stress: float
    work: float


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
    ranges : tuple of dict
        Least and greatest values of every column that was understood, with units (mm, N, s, MPa).
    """

    name: str
    specimens: tuple[Specimen, ...] = ()
    unit: str | None = None
    assumed: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    ranges: tuple[dict, ...] = ()
