"""Programs whose material cards are written and read: their formats, and the forms of laws."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any, NamedTuple

from ..arguments import check_known, suggestion
from ..materials import LAWS
from .constants import constants_of, law_keys

PER_TERM = ("C", "D", "mu", "mu_1", "mu_2", "alpha")
"""Constants of `constants_of` of which a law has one for every term."""


class Field(NamedTuple):
    """Field of a card: its label, the name of its constant, and the number of the term."""

    label: str
    name: str
    term: int


@dataclass(frozen=True)
class Form:
    """A law as a program has it.

    Attributes
    ----------
    law : str
        Name of the law here.
    keys : tuple of str
        Its names in the program, the first of which is written.
    rows : tuple
        Fields of the rows of the card.
    W, modulus, U : str
        Isochoric energy, initial shear modulus by its constants, and volumetric energy, a key of
        `VOLUMES`, or empty if it is not known.
    options : str
        Options of the head, with ``{terms}`` for the number of terms.
    terms, most : int
        Number of terms, or the greatest one, if not one.
    only : int
        Number that the head must state, if it states one.
    whole : str
        Constant that must be a whole number.
    other : str
        What else the program has for the law, with other constants: a convention must then name
        the law as the program does.
    """

    law: str
    keys: tuple[str, ...]
    rows: tuple[Any, ...]
    W: str
    modulus: str
    U: str = ""
    options: str = ""
    terms: int = 0
    most: int = 0
    only: int = 0
    whole: str = ""
    other: str = ""

    def fields(self, terms: int) -> list[list[Field]]:
        """Return the fields of every row for a number of terms."""
        rows = []
        for row in self.rows:
            fields: list[Field] = []
            for item in row:
                words = item if isinstance(item, list) else [item]
                several = words[0].rpartition(":")[2] in PER_TERM
                for term in range(terms if several else 1):
                    for word in words:
                        label, _, name = word.rpartition(":")
                        fields.append(
                            Field((label or name).replace("#", str(term + 1)), name, term)
                        )
            rows.append(fields)
        return rows


@dataclass(frozen=True)
class Program:
    """Format of the cards of a program.

    Attributes
    ----------
    program, known, note : str
        Its name; how it is known what its constants mean; what users must add.
    suffix, comment : str
        End of the names of files; a comment around ``{}``.
    head, start, row, end : str
        Templates of the lines of a card.
    join : str
        Between the fields of a row.
    width, per_row, digits : int
        Width of a field, if fixed; most fields in a row; digits of a number.
    heads, names, rows, ends, refused, beside : str
        Regular expressions of lines without blanks, in upper or lower case: heads of materials,
        with ``{keys}`` for the names of all forms; lines that name a material; rows; lines that end
        rows; lines of models that the laws here have not, and of what is left out with a remark,
        wherever they are if they have the name of the material.
    line, comments : str
        Regular expressions of what counts as a line, and of comments within and across lines.
    longest : int
        Characters of a number that CalculiX reads.
    skip : int
        Lines between the head and the rows.
    softening : str
        Keyword of the softening of Ogden and Roxburgh, whose row is r, m and beta.
    forms : dict
        By law.
    """

    program: str
    known: str
    suffix: str
    comment: str
    head: str
    heads: str
    ends: str
    forms: dict[str, Form] = field(repr=False)
    note: str = ""
    start: str = ""
    row: str = "{fields}"
    end: str = ""
    join: str = ""
    width: int = 0
    per_row: int = 100
    digits: int = 13
    names: str = ""
    rows: str = ""
    refused: str = ""
    beside: str = ""
    line: str = "(?m)^.*$"
    comments: str = ""
    longest: int = 0
    skip: int = 0
    softening: str = ""

    @property
    def named(self) -> bool:
        """Whether fields have labels in the place of an order."""
        return "label" in self.row

    def number(self, value: float) -> str:
        """Return the text of a number, as exact as its field takes."""
        texts = (f"{value:.{digits}g}" for digits in range(self.digits, 0, -1))
        return next(text for text in texts if len(text) <= (self.width or len(text)))

    def text(self, field: Field, values: Mapping[str, Sequence[float]]) -> str:
        """Return the text of a field."""
        if field.name in values:
            return self.number(values[field.name][field.term])
        return field.name.removeprefix("?")

    def form_of(self, key: str) -> Form:
        """Return the form with a name in the program, without blanks, in any case."""
        return next(form for form in self.forms.values() if compact(key) in map(compact, form.keys))


def compact(text: str) -> str:
    """Return a text in upper case, without blanks."""
    return re.sub(r"\s", "", text).upper()


def _programs() -> dict[str, Program]:
    found: dict[str, Program] = {}
    text = resources.files(__package__).joinpath("programs.toml").read_text("utf-8")
    given = tomllib.loads(text)
    for name, own in given.items():
        like = given.get(own.pop("like", ""), {"forms": {}})
        described = {**like, **own}
        forms = {}
        for law in {**like["forms"], **own.get("forms", {})}:
            form = {**like["forms"].get(law, {}), **own.get("forms", {}).get(law, {})}
            form = {key: tuple(v) if type(v) is list else v for key, v in form.items()}
            forms[law] = Form(law, **form)
        keys = {compact(key) for form in forms.values() for key in form.keys} - {""}
        longest_first = sorted(map(re.escape, keys), key=len, reverse=True)
        described["heads"] = described["heads"].replace("{keys}", "|".join(longest_first))
        found[name] = Program(**{**described, "forms": forms})
    return found


PROGRAMS = _programs()
"""Programs by their names on the command line."""


def keys_of_constants(convention: str, law: str, given: Mapping[str, float]) -> dict[str, Any]:
    """Return the keys of the material of a scene whose constants have the names of a program.

    Parameters
    ----------
    convention : str
        A name of `PROGRAMS`, without ``-card``.
    law : str
        Name of the law here.
    given : mapping of float
        Constants by their names in the program, all but that of the volume.

    Raises
    ------
    ValueError
        If the program has no such law or constant, or the law needs more, or is another one with
        these; the message says what it has.

    Examples
    --------
    >>> from pdsurrogate.cards.programs import keys_of_constants
    >>> keys_of_constants("calculix", "mooney-rivlin", {"C10": 0.25, "C01": 0.25, "D1": 0.02})
    {'law': 'mooney-rivlin', 'second_share': 0.5, 'shear_modulus': 1.0, 'bulk_modulus': 100.0}
    """
    programs = {name.removesuffix("-card"): program for name, program in PROGRAMS.items()}
    check_known(convention, sorted(programs), f"unknown convention {convention!r}")
    own = programs[convention].forms
    forms = {form.keys[0] if form.other else law: form for law, form in own.items()}
    if law in own and law not in forms:
        raise ValueError(f"{own[law].other}: write law = {own[law].keys[0]!r} if it is that one")
    check_known(law, sorted(forms), f"{convention} has no law {law!r}", "it has")
    form = forms[law]
    fields = [
        each
        for row in form.fields(form.terms or form.most or 1)
        for each in row
        if each.name[0] != "?" and not each.name.isdigit()
    ]
    labels = [each.label for each in fields]
    for key, value in given.items():
        if key not in labels:
            first = f"{key}1"
            choice = f"write {first}" if first in labels else suggestion(key, labels, "it has")
            raise ValueError(f"{law} of {convention} has no constant {key!r}; {choice}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{key} must be a number, not {value!r}")
    used = (each.term for each in fields if each.label in given and each.name != "D")
    terms = form.terms or 1 + max(used, default=0)
    typical = constants_of(LAWS[form.law]())
    values: dict[str, list[float]] = {}
    for each in fields:
        if each.name == "D" and each.term and each.label in given:
            raise ValueError(f"{each.label}: the laws here have one volumetric term: leave it out")
        if each.term >= terms:
            continue
        needed = each.name not in ("K", "D", "nu") and any(typical[each.name])
        if needed and each.label not in given:
            raise ValueError(f"{law} of {convention} needs {each.label} as well")
        values.setdefault(each.name, []).append(float(given.get(each.label, 0.0)))
    keys = law_keys(values)
    if keys["law"] != form.law != "ogden":
        raise ValueError(f"these constants are of {keys['law']}, not {law}")
    return keys
