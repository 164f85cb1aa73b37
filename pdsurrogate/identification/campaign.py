"""Facts that files of tests lack, as options and keys, and campaigns: TOML files that name the
files of many tests with these facts.
"""

import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field
from typer import Option

from ..arguments import check_path, suggestion
from ..measurements import read_tests
from ..measurements.mechanical import join_tests
from ..measurements.specimens import ALL_MODES, MechanicalTests
from ..scenes.problems import SceneError
from ..scenes.reading import read_description
from ..scenes.strict_model import StrictModel


def _as_texts(value: Any) -> Any:
    """Return a table as a list of texts KEY=VALUE."""
    given = isinstance(value, Mapping)
    return [f"{key}={one}" for key, one in value.items()] if given else value


def _pairs(value: list[str] | None) -> list[str] | None:
    """Refuse texts that are not of the form KEY=VALUE."""
    for one in value or ():
        if "=" not in one.strip("="):
            raise ValueError(f"must have the form QUANTITY=NAME, not {one!r}")
    return value


Texts = Annotated[list[str] | None, BeforeValidator(_as_texts)]
Up = Annotated[
    bool | None,
    Option(
        "--up/--down", help="Whether y and v of a field point upward, if its files do not say it."
    ),
]
"""Direction of the axes of a field, as an option."""

Text = Annotated[
    str | None, BeforeValidator(lambda one: str(one) if type(one) in (int, float, bool) else one)
]


def _pairs_of(texts: list[str] | None) -> dict[str, str]:
    """Return texts KEY=VALUE as a dictionary, without other texts."""
    pairs = (text.partition("=") for text in texts or () if "=" in text)
    return {key.strip(): value.strip() for key, _, value in pairs}


class TableFacts(StrictModel):
    """Statements of a user about a table of a machine that the table may lack.

    Parameters
    ----------
    column : dict or list of str, optional
        Headings, or numbers from 1, of columns by quantity: ``["force=Kraft"]``, or a table
        ``{ force = "Kraft" }``.
    unit : dict or list of str, optional
        Units by quantity: ``["stress=kPa"]``, or a table ``{ stress = "kPa" }``.
    thickness : str, optional
        Thickness of the undeformed sheet or specimen, such as "2 mm".
    """

    column: Annotated[
        Texts,
        AfterValidator(_pairs),
        Option(
            metavar="QUANTITY=HEADING",
            help="Heading or number of a column, as force=Kraft; may be repeated.",
        ),
    ] = None
    unit: Annotated[
        Texts,
        Option(
            metavar="QUANTITY=UNIT",
            help="Unit of a quantity, as stress=kPa, or of a field, as px; may be repeated.",
        ),
    ] = None
    thickness: Annotated[
        str | None, Option(metavar="LENGTH", help="Undeformed thickness, as 2mm.")
    ] = None

    @property
    def field_unit(self) -> str | None:
        """Unit of a field."""
        return next((one for one in self.unit or () if "=" not in one), None)

    def stated(self, fields: bool = False) -> dict[str, Any]:
        """Return what is stated, as arguments of `read_tests`; raise ValueError for a unit of a
        field unless there are `fields`.
        """
        if self.field_unit and not fields:
            raise ValueError(f"unit: must have the form QUANTITY=UNIT, not {self.field_unit!r}")
        given = self.model_dump(exclude_none=True, exclude={"file", "test", "column", "unit"})
        pairs = {"columns": _pairs_of(self.column), "units": _pairs_of(self.unit)}
        return given | {key: value for key, value in pairs.items() if value}


class TestFacts(TableFacts):
    """Statements of a user about a file of mechanical tests; each is an option of the commands that
    take tests, and a key of campaigns.

    Parameters
    ----------
    mode : str, optional
        Mode of loading: uniaxial, equibiaxial or pure-shear, or that of a tear test, trouser or
        pure-shear-tear.
    gauge_length : str, optional
        Undeformed length whose extension was measured, such as "25 mm".
    area : str, optional
        Undeformed cross-section, such as "12 mm2"; or `width` and thickness, or `diameter`.
    width : str, optional
        Undeformed width, such as "6 mm"; of trousers that of a leg, or "leg" or "specimen": whose
        width the file states.
    diameter : str, optional
        Undeformed diameter, such as "5 mm".
    strain : str, optional
        "engineering" or "true".
    stress : str, optional
        "engineering" or "true".
    branch : str or int, optional
        Branch to take: "loading" (default), "unloading", "all", or the number of a cycle.
    rate : str or float, optional
        Rate of stretch, per second, of tests without times.
    zero : str, optional
        Whether a stretch at zero force that is not 1 is moved to 1: "shift" (default) or "keep".
    broke : str or bool, optional
        Whether specimens broke: true, false, or "grips", "slipped" or "limit" (of the machine), for
        tests whose load does not drop, or drops for another reason.
    stress_unit : str, optional
        Unit of the stresses that are fitted; by default MPa, or none if no file states one.
    """

    __test__ = False  # no test case, whatever pytest thinks of the name

    mode: Annotated[
        str | None, Option(metavar="MODE", help=f"Mode of loading: {', '.join(ALL_MODES)}.")
    ] = None
    gauge_length: Annotated[
        str | None, Option(metavar="LENGTH", help="Undeformed gauge length, as 25mm.")
    ] = None
    area: Annotated[
        str | None, Option(metavar="AREA", help="Undeformed cross-section, as 12mm2.")
    ] = None
    width: Annotated[str | None, Option(metavar="LENGTH", help="Undeformed width, as 6mm.")] = None
    diameter: Annotated[
        str | None, Option(metavar="LENGTH", help="Undeformed diameter, as 5mm.")
    ] = None
    strain: Annotated[
        str | None, Option(metavar="MEASURE", help="Strains: engineering or true.")
    ] = None
    stress: Annotated[
        str | None, Option(metavar="MEASURE", help="Stresses: engineering or true.")
    ] = None
    branch: Annotated[
        Text,
        Option(
            metavar="BRANCH",
            help="Rows to take: loading (default), unloading, all, or the number of a cycle.",
        ),
    ] = None
    rate: Annotated[
        Text, Option(metavar="RATE", help="Rate of stretch per second of tests without times.")
    ] = None
    zero: Annotated[
        str | None,
        Option(help="Move a stretch at zero force that is not 1 to 1: shift (default) or keep."),
    ] = None
    broke: Annotated[
        Text,
        Option(
            metavar="HOW",
            help="Whether specimens broke: true, false, grips, slipped or limit (default: what"
            " files say, or the drop of the load).",
        ),
    ] = None
    stress_unit: Annotated[
        str | None, Option(metavar="UNIT", help="Unit of the stresses that are fitted.")
    ] = None


class CampaignTest(TestFacts):
    """Entry ``[[test]]`` of a campaign: a file, and what it leaves open.

    Parameters
    ----------
    file : str
        Path of the file, from the folder of the campaign.
    """

    file: str


class Campaign(TestFacts):
    """Tests of a material, described once (`tests.toml`): facts of all files, and a table
    ``[[test]]`` for each file, whose own facts come before those of all.

    Parameters
    ----------
    test : list of CampaignTest
        Files of tests.
    """

    test: Annotated[tuple[CampaignTest, ...], Field(min_length=1)]


Source = tuple[Path, dict[str, Any]]
"""A file of tests, and what is stated of it, as arguments of `read_tests`."""


def option_of(key: str) -> str:
    """Return the option that states a fact, by the name of its argument."""
    return f"--{ {'columns': 'column', 'units': 'unit'}.get(key, key).replace('_', '-') }"


def sources(references: Iterable[str | Path], stated: Mapping[str, Any]) -> list[Source]:
    """Return the files of tests that are meant by paths, paths with a mode after a colon
    (``ps.csv:pure-shear``) and campaigns, with what is stated of each.

    Raise ValueError for an unknown mode, a wrong campaign, and facts beside a campaign.
    """
    found: list[Source] = []
    for reference in references:
        check_path(reference, "test data")
        name, _, mode = str(reference).rpartition(":")
        own = dict(stated)
        colon = name and not Path(reference).exists()
        if colon and mode in ALL_MODES:
            own["mode"] = mode
        elif colon and Path(name).exists():
            raise ValueError(f"{reference}: unknown mode {mode!r}; {suggestion(mode, ALL_MODES)}")
        else:
            name = str(reference)
        if not name.lower().endswith(".toml"):
            found.append((Path(name), own))
        elif own:
            option = option_of(next(iter(own)))
            raise ValueError(
                f"{name}: write what {option} states into this file, which describes all of its"
                " tests"
            )
        else:
            found += _of_campaign(Path(name))
    return found


def read_sources(found: Iterable[Source]) -> MechanicalTests:
    """Return the tests in files, one data set."""
    groups = [
        read_tests(*(path for path, _ in group), **stated)
        for stated, group in itertools.groupby(found, key=lambda source: source[1])
    ]
    return groups[0] if len(groups) == 1 else join_tests(", ".join(g.name for g in groups), *groups)


def _of_campaign(path: Path) -> list[Source]:
    """Return the files that a campaign names; raise ValueError with the key of a wrong entry."""
    described = read_description(path, "tests")
    try:
        campaign = Campaign.model_validate(described)
    except SceneError as error:
        raise ValueError(f"{path}: {error}") from None
    return [
        (path.parent / one.file, {**campaign.stated(), **one.stated()}) for one in campaign.test
    ]
