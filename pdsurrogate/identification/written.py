"""Test data as a table that `load_test_data` reads back."""

import csv
import io

import numpy as np

from ..measurements.specimens import BIAXIAL
from .data import TestData


def table_of(data: TestData) -> str:
    """Return test data as the text of a table with a line of headings, numbers in full precision.

    Raise ValueError for biaxial tests beside others, which need other columns.
    """
    unit = f" ({data.unit})" if data.unit else ""
    first, second = data.stretches.T
    specimens = data.tests.specimens if data.tests else ()
    if data.modes == [BIAXIAL]:
        one = np.flatnonzero(np.r_[True, np.diff(data.row) > 0])
        columns = {
            "stretch": first[one],
            "lateral_stretch": second[one],
            f"nominal_stress{unit}": data.nominal_stress[one],
            f"lateral_stress{unit}": data.nominal_stress[one + 1],
            "weight": data.weight[one],
        }
    elif BIAXIAL in data.modes:
        raise ValueError(
            f"{data.name}: biaxial tests have columns of their own: write them to another table"
        )
    else:
        named = {row: one.name for one in specimens for row in one.row.tolist()}
        columns = {
            "mode": data.mode,
            "specimen": np.array([named.get(row, "") for row in data.row.tolist()]),
            "stretch": first,
            f"nominal_stress{unit}": data.nominal_stress,
            "weight": data.weight,
        }
    if (data.weight == 1).all():
        del columns["weight"]
    if len(specimens) <= len(data.modes):
        columns.pop("specimen", None)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return text.getvalue()
