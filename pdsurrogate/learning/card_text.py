"""Text that a user gives for the card of an artefact, in addition to what is computed from the model."""

from __future__ import annotations

from dataclasses import dataclass

from ..arguments import check_tables, check_text, kind_of
from ..artifacts.card import check_plain


@dataclass(frozen=True)
class CardText:
    """Text that a user gives for the card of an artefact, in addition to what is computed from the model.

    Parameters
    ----------
    description : str
        Purpose of the artefact, in a sentence.
    cross_validation : list of dict, optional
        Errors by fold, as `pdsurrogate.cross_validate` returns them.
    search : list of dict, optional
        Parameters that a search tried, and their errors; by default the table of the model if that is a search.
    identification : dict, optional
        Report of the identification of the law (`pdsurrogate.identification.report`).

    Raises
    ------
    TypeError, ValueError
        If a card cannot hold a value; names the value.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.CardText("Neo-Hookean, 20 units").description
    'Neo-Hookean, 20 units'
    """

    description: str
    cross_validation: list[dict] | None = None
    search: list[dict] | None = None
    identification: dict | None = None

    def __post_init__(self) -> None:
        check_text(self.description, "description")
        check_tables(self.cross_validation, "cross_validation")
        check_tables(self.search, "search")
        if not isinstance(self.identification, dict | None):
            raise TypeError(f"identification must be a dictionary, or None, not {kind_of(self.identification)}")
        check_plain({"cross_validation": self.cross_validation, "search": self.search, "identification": self.identification})

    @classmethod
    def of(cls, text: str | CardText) -> CardText:
        """Return a text with the given description only; return a `CardText` unchanged."""
        return text if isinstance(text, cls) else cls(text)
