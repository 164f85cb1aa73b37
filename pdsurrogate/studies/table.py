"""Table and figure of the results of a study."""

import json
import re
from collections.abc import Iterable
from itertools import product
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..arguments import suggestion
from ..results import tables
from ..results.figures import styled
from ..run.parameters import check_not_at_break
from ..scenes import SceneError
from ..scenes.reading import leaves
from .description import Study

_ALL = ("fraction_outside_domain", "n_force_evaluations", "seconds_total")
_CRACK = ("crack.peak", "crack.path", "crack.broken_bonds", "crack.through")
OF_GRIPS = ("converged", "stretch", "nominal_stress", "peak_nominal_stress", *_CRACK, *_ALL)
OF_STEPS = ("converged", "t", "forces", "moments", "probes.*.displacement", *_CRACK, *_ALL)
OF_FITS = (
    "on_surface.rms",
    "on_surface.max",
    "cross_validated_rms",
    "outcome.n_iter",
    "seconds_total",
)
"""Default columns of the tables of studies of scenes with grips, of scenes with steps, and of fits;
only those with a value in some run are shown.
"""

KEYS_OF_RUNS, KEYS_OF_LEVELS, KEYS_OF_CRACKS, KEYS_OF_FITS = (
    keys.split()
    for keys in (
        """
        scene force material materials plane thickness n_points n_bonds n_directed_bonds
        n_ghost_points spacing cell_size horizon precision correction support ranks
        threads converged failure interrupted residual n_force_evaluations seconds_total
        seconds_compile ns_per_directed_bond fallback_fraction status beyond_data held_at_points
        fraction_outside_domain unsupported_points units grip_areas levels digests scene_as_run
        provenance peak_nominal_stress n_steps dynamics quasi_static critical_stretch
        process fracture_remarks interfaces strength crack
        """,
        """
        stretch t step time forces moments displacements energy kinetic_energy dissipated_energy
        stability probes nominal_stress nominal_stress_reference nominal_stress_error
        lateral_displacement
        lateral_displacement_reference lateral_displacement_error greatest_lateral_displacement
        greatest_lateral_displacement_reference greatest_lateral_displacement_error
        nominal_stress_grip nominal_stress_area nominal_stress_work_conjugate roughness residual
        evaluations method increments path_error force_balance rigid contact cracks
        """,
        "start peak path tips broken_bonds failed_points through",
        """
        material artifact stretch_range n_samples random_state on_surface off_surface by_strain
        at_rest least_slope least_slope_exact least_acoustic least_acoustic_exact least_curvature
        least_curvature_exact shear_modulus outcome cross_validation cross_validated_rms
        seconds_total
        """,
    )
)
"""All keys that the summary of a run, its levels (outputs) and its crack can have, and those of the
summary of a fit; tests compare them with written files.
"""

RUN = "run"
FAILURE = "failure"
"""Names of the first and last column: the name of the run's folder, and the reason of its
failure.
"""

MOST_DRAWN = 6
"""Greatest number of quantities, and also of parameters, in a study's figure. Chosen: 36 small
diagrams fill a page.
"""


def check_quantities(study: Study) -> None:
    """Raise SceneError if a study asks for a quantity, or a derivative of one, that no run can
    have; the message suggests a similar key.
    """
    try:
        check_not_at_break(study.derivatives or (), "derivatives")
    except ValueError as error:
        raise SceneError(str(error)) from None
    for name in study.derivatives or ():
        if (first := name.split(".")[0]) not in KEYS_OF_LEVELS:
            raise SceneError(
                f"derivatives: no output has {name!r}; {suggestion(first, KEYS_OF_LEVELS)}"
            )
    known = (
        KEYS_OF_FITS if study.fit is not None else dict.fromkeys((*KEYS_OF_LEVELS, *KEYS_OF_RUNS))
    )
    for name in study.quantities or ():
        first, *others = name.split(".")
        if first not in (*known, "*"):
            raise SceneError(f"quantities: no run has {name!r}; {suggestion(first, known)}")
        if first == "crack" and others and others[0] not in (*KEYS_OF_CRACKS, "*"):
            raise SceneError(
                f"quantities: no run has {name!r}; {suggestion(others[0], KEYS_OF_CRACKS)}"
            )


def quantities_in(summary: dict, names: Iterable[str] | None = None) -> dict[str, Any]:
    """Return the values that the study's table shows for a run, by the names of their columns.

    Each of the `names` is a dotted key of the run's `summary`, or else of the last of its
    ``levels`` (outputs); an asterisk stands for every key of a dictionary. A value becomes one
    column; a dictionary or list becomes one column for each entry at any depth. By default the
    names are `OF_GRIPS` for scenes with grips, `OF_STEPS` for scenes with steps, and `OF_FITS` for
    fits.
    """
    last = summary["levels"][-1] if summary.get("levels") else {}
    if names is None:
        names = OF_FITS if "levels" not in summary else OF_STEPS if "t" in last else OF_GRIPS
    found: dict[str, Any] = {}
    for name in names:
        found |= _below(summary, name) or _below(last, name)
    return found


def _below(table: dict, name: str) -> dict[str, Any]:
    """Return, by dotted key, the entries of nested tables and lists whose key is `name` or
    continues it after a dot, except None.

    An asterisk in the name stands for any key between two dots.
    """
    first = name.split(".")[0]
    pattern = re.escape(name).replace(r"\*", "[^.]+") + r"(\.|$)"
    named = {key: inner for key, inner in table.items() if first in (key, "*")}
    return {
        key: value for key, value in leaves(named) if value is not None and re.match(pattern, key)
    }


def columns_of(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Return the names of the columns that occur in any row of a study's table, in order of
    appearance, with ``failure`` as the last.
    """
    return [*(column for column in tables.columns_of(rows) if column != FAILURE), FAILURE]


def means_of(
    rows: Iterable[dict[str, Any]], parameters: Iterable[str], over: Iterable[str]
) -> list[dict[str, Any]]:
    """Return mean and deviation of numerical quantities over the successful runs whose parameters
    are equal apart from those in `over`.

    Quantities that a run of such a group lacks are left out. Each row has the other parameters, the
    number of ``runs``, and the ``mean`` and (for two runs or more) the sample standard
    ``deviation`` of each quantity, after its key and a dot.
    """
    kept = [key for key in parameters if key not in over]
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        if row[FAILURE] is None:
            groups.setdefault(json.dumps([row.get(key) for key in kept], default=str), []).append(
                row
            )
    found = []
    for group in groups.values():
        means: dict[str, Any] = {key: group[0].get(key) for key in kept} | {"runs": len(group)}
        for key in columns_of(group):
            values = [row[key] for row in group if _is_number(row.get(key))]
            if len(values) == len(group) and key not in (*kept, *over):
                means |= {f"{key}.mean": float(np.mean(values))}
                means |= (
                    {f"{key}.deviation": float(np.std(values, ddof=1))} if len(values) > 1 else {}
                )
        found.append(means)
    return found


def as_csv(rows: list[dict[str, Any]]) -> str:
    """Return the rows of a study's table as CSV; nested tables and lists are written as JSON,
    missing values as empty cells.
    """
    columns = columns_of(rows) if any(FAILURE in row for row in rows) else tables.columns_of(rows)
    return tables.as_csv([{column: _cell(row.get(column)) for column in columns} for row in rows])


def _cell(value: Any) -> str:
    return (
        value if isinstance(value, str) else "" if value is None else json.dumps(value, default=str)
    )


def study_figure(rows: list[dict[str, Any]], parameters: list[str]) -> Figure | None:
    """Return a figure of every varying quantity against every varying parameter, up to `MOST_DRAWN`
    of each; None if nothing varies.

    `rows` are those of the study's table, and `parameters` the columns of parameters.
    """
    across = [key for key in parameters if len({_cell(row.get(key)) for row in rows}) > 1]
    others = [key for key in columns_of(rows) if key not in (RUN, FAILURE, *parameters)]
    down = [
        key for key in others if len({row[key] for row in rows if _is_number(row.get(key))}) > 1
    ]
    across = across[:MOST_DRAWN]
    down = down[:MOST_DRAWN]
    if not across or not down:
        return None
    with styled(1.0 + 2.6 * len(across), 0.6 + 2.3 * len(down)) as figure:
        axes = figure.subplots(len(down), len(across), squeeze=False, sharey="row", sharex="col")
        for (i, quantity), (j, key) in product(enumerate(down), enumerate(across)):
            places = [row.get(key) for row in rows]
            if not all(map(_is_number, places)):
                places = list(map(_cell, places))
            points = zip(places, [row.get(quantity) for row in rows], strict=True)
            shown = [point for point in points if _is_number(point[1])]
            axes[i, j].plot(*zip(*shown, strict=True), "o", ms=3.5)
            if isinstance(places[0], str):
                names = list(dict.fromkeys(places))
                shortened = [name[:24] for name in names]
                axes[i, j].set_xticks(names, shortened, rotation=30, ha="right")
            axes[i, j].set(xlabel=key, ylabel=quantity)
            axes[i, j].label_outer()
        return figure


def _is_number(value: Any) -> bool:
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
    )
