"""Mechanical tests from tables of machines: stretch and nominal stress of every specimen."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arguments import check_known, suggestion
from .branches import LEAST, branches, break_row, creep, energy_lost, records, stretch_at_zero
from .breaks import NO_STRENGTH, WORDS, last_state, slip
from .quantities import found_in
from .reading import read_tables
from .readings import Readings
from .specimens import (
    ALL_MODES,
    BIAXIAL,
    SHEAR_TEAR,
    AtBreak,
    Facts,
    MechanicalTests,
    Specimen,
    Tear,
)
from .table import TableFile
from .tears import cut_strip, torn_legs

OWN = "table of this project"
"""Form of tables whose documented unit is that of their stresses."""

BRANCHES = "loading", "unloading", "all"

AXES = {"equibiaxial": 2}
"""Number of directions in which the stress of a mode works, where it is not 1."""

SAME = 1e-3
"""Relative difference of the ends of tests that ended at a limit of the machine, not by breaking:
a tenth of the least scatter that any laboratory has."""


def read_tests(*files: str | Path, **stated: Any) -> MechanicalTests:
    r"""Return the tests in files of testing machines, workbooks, decks or plain tables.

    Force and extension become nominal stress and stretch by the geometry that a file or the user
    states; strains and stresses of any kind are converted. Columns that say the same must agree.

    Parameters
    ----------
    *files : str or path
    **stated
        Fields of `Facts`: ``mode="uniaxial"``, ``gauge_length="25 mm"``, ``area="12 mm2"``,
        ``columns={"force": "Kraft"}``, ``units={"stress": "kPa"}``, ``strain="true"``,
        ``branch="all"`` and others; for every file.

    Returns
    -------
    MechanicalTests
        Its `missing` says what is still to be stated; stresses are in MPa, or in
        ``stress_unit``, or as they are where neither file nor user states a unit.

    Raises
    ------
    ValueError
        If a file cannot be read, what is stated contradicts a file or is not needed, or columns
        contradict each other; the message shows both values.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pdsurrogate.measurements import read_tests
    >>> _ = Path("test.csv").write_text("Load (N),Extension (mm)\n0,0\n3,5\n6,10\n9,15\n12,25\n")
    >>> tests = read_tests("test.csv", mode="uniaxial", gauge_length="25 mm", area="12 mm2")
    >>> tests.specimens[0].stretch.max(), tests.specimens[0].nominal_stress.max(), tests.unit
    (2.0, 1.0, 'MPa')
    """
    try:
        facts = Facts(**stated)
    except TypeError:
        known = list(Facts.__dataclass_fields__)
        wrong = next(name for name in stated if name not in known)
        raise TypeError(f"there is no fact {wrong}; {suggestion(wrong, known)}") from None
    try:
        _check(facts)
    except ValueError as error:
        raise ValueError(f"{', '.join(map(str, files))}: {error}") from None
    parts, used = [], set()
    for file in files:
        found = read_tables(file, columns=facts.columns, units=facts.units)
        parts.append(_tests(found, facts, used))
    idle = facts.unused(used)
    if idle and not any(part.missing for part in parts):
        raise ValueError(
            f"{', '.join(map(str, files))}: {idle} is stated, but no table needs it: leave it out"
        )
    return join_tests(", ".join(Path(file).name for file in files), *parts)


def join_tests(name: str, *parts: MechanicalTests) -> MechanicalTests:
    """Return the tests of several files as one; raise ValueError if only some state a unit."""
    units = {part.unit for part in parts if part.specimens or part.tears}
    if len(units) > 1:
        words = ", ".join(f"{part.name}: {part.unit or 'none'}" for part in parts)
        raise ValueError(
            f"the units of stress differ ({words}): state that of the others (--unit stress=MPa)"
        )
    rows, specimens = 0, []
    for part in parts:
        specimens += [replace(one, row=one.row + rows) for one in part.specimens]
        rows += part.rows
    specimens, limits = _without_limits(specimens)
    together = MechanicalTests(name, tuple(specimens), next(iter(units), None))
    scatter = [
        f"{name}, {mode}: rows have weights of 1/variance; the specimens scatter by"
        f" {100 * found.weights(np.array(found.greatest)) ** -0.5 / found.greatest:.2g} % at the"
        " greatest stress"
        for mode, found in together.scatter.items()
    ]
    said = (
        *(text for part in parts for text in part.assumed),
        *_twins(specimens),
        *limits,
        *scatter,
    )
    return replace(
        together,
        assumed=tuple(dict.fromkeys(said)),
        missing=tuple(text for part in parts for text in part.missing),
        tables=tuple(file for part in parts for file in part.tables),
        tears=tuple(one for part in parts for one in part.tears),
    )


def _without_limits(specimens: list[Specimen]) -> tuple[list[Specimen], list[str]]:
    """Return specimens, whose breaks are no strengths if they were said to break, no load drops,
    and several end at one stretch or stress; and remarks on these.
    """
    found, said = list(specimens), []
    for mode in dict.fromkeys(one.mode for one in specimens):
        places = [
            (place, (one.at_break.stretch - 1, one.at_break.nominal_stress))
            for place, one in enumerate(specimens)
            if one.mode == mode and one.at_break and not one.at_break.drops
        ]
        ends = np.array([end for _, end in places])
        if len(places) < 2 or (np.ptp(ends, axis=0) > SAME * np.abs(ends).max(axis=0)).all():
            continue
        cause = f"{len(places)} specimens end at the same stretch or stress, as at a limit"
        said.append(f"{mode}: {cause} of the machine: their last state is no strength")
        for place, _ in places:
            at_break = replace(found[place].at_break, no_strength=cause)
            found[place] = replace(found[place], at_break=at_break)
    return found, said


def _twins(specimens: list[Specimen]) -> list[str]:
    """Return remarks on specimens with the same rows, as of a file that is given twice."""
    seen: dict[tuple, str] = {}
    found = []
    for one in specimens:
        curve = one.stretch[one.chosen], one.nominal_stress[one.chosen], one.lateral_stress
        key = one.mode, *(values.tobytes() for values in curve)
        if key in seen:
            found.append(f"{one.name} has the same rows as {seen[key]}, and counts twice")
        elif len(curve[0]) > 3:
            seen[key] = one.name
    return found


def _check(facts: Facts) -> None:
    """Raise ValueError for facts that no test has."""
    for value, known, what in (
        (facts.mode, ALL_MODES, "mode"),
        (facts.strain, ("engineering", "true"), "strain"),
        (facts.stress, ("engineering", "true"), "stress"),
        (facts.zero, ("shift", "keep"), "zero"),
    ):
        if value is not None:
            check_known(value, known, f"unknown {what} {value!r}")
    if facts.rate is not None:
        _rate(facts)
    if facts.broke is not None and found_in(WORDS, str(facts.broke)) is None:
        raise ValueError(
            f"broke must be true, false, or {', '.join(NO_STRENGTH)}, not {facts.broke!r}"
        )
    branch = facts.branch
    if not (branch is None or branch in BRANCHES or str(branch).isdigit()):
        raise ValueError(
            f"branch must be {', '.join(BRANCHES)} or the number of a cycle, not {branch!r}"
        )


def _rate(facts: Facts) -> float:
    """Return the rate of stretch that is stated; raise ValueError unless it is positive."""
    try:
        rate = float(str(facts.rate))
    except ValueError:
        rate = np.nan
    if not 0 < rate < np.inf:
        raise ValueError(
            f"rate must be a positive number, the rate of stretch per second, not {facts.rate!r}"
        )
    return rate


def _tests(file: TableFile, facts: Facts, used: set[str]) -> MechanicalTests:
    """Return the tests of one file, with the names of the `facts` that were needed in `used`."""
    name = file.path.name
    specimens: list[Specimen] = []
    tears: list[Tear] = []
    assumed, missing = [(name, note) for note in file.notes], []
    units, rows = set(), 0
    for block in file.blocks:
        where = f"{name}, {block.title}" if block.title and len(file.blocks) > 1 else name
        readings = Readings(block, facts, where)
        modes = readings.modes()
        torn = torn_legs(readings, modes)
        found = [] if torn is not None else _specimens(readings, modes, rows)
        torn = torn or [
            tear for one in found if one.mode == SHEAR_TEAR for tear in cut_strip(readings, one)
        ]
        used |= readings.used
        assumed += [(where, text) for text in readings.assumed]
        missing += [(where, text) for text in readings.missing]
        if (found or torn) and not readings.missing:
            specimens += [one for one in found if one.mode != SHEAR_TEAR]
            tears += torn
            units.add(readings.unit)
        rows += len(block.lines)
    if len(units) > 1:
        raise ValueError(f"{name}: only some tables state the unit of stress: --unit stress=MPa")
    unit = next(iter(units), None)
    if specimens and unit is None and file.form != OWN:
        assumed.append((name, "no unit of stress is stated; stresses stay as they are (--unit)"))
    return MechanicalTests(
        name,
        tuple(specimens),
        unit,
        _sentences(assumed, name),
        _sentences(missing, name),
        (file,),
        tuple(tears),
    )


def _sentences(texts: list[tuple[str, str]], name: str) -> tuple[str, ...]:
    """Return texts with the tables that they are about: one sentence for a text about several."""
    places: dict[str, list[str]] = {}
    for where, text in texts:
        places.setdefault(text, []).append(where)
    return tuple(
        f"{where[0] if len(where) == 1 else name}: {text}" for text, where in places.items()
    )


def _specimens(readings: Readings, modes: list[str] | None, before: int) -> list[Specimen]:
    """Return the specimens of a table after `before` rows of other tables."""
    found_values = readings.stretch_and_stress()
    if found_values is None or modes is None:
        return []
    stretch, stress = found_values
    known = np.isfinite(stretch) & np.isfinite(stress)
    if not known.all():
        readings.assumed.append(f"{(~known).sum()} rows without both numbers are left out")
    if (stretch[known] <= 0).any():
        line = readings.block.lines[known][stretch[known] <= 0][0]
        raise ValueError(
            f"{readings.where}, line {line}: stretch must be positive, not"
            f" {stretch[known].min():g}; a stretch is 1 + strain"
        )
    time, groups = readings.numbers("time"), readings.text("specimen")
    keys = [f"{mode}\n{group}" for mode, group in zip(modes, groups, strict=True)]
    found = []
    for key in dict.fromkeys(keys):
        rows = np.flatnonzero((np.array(keys) == key) & known)
        mode, group = key.split("\n")
        if not len(rows):
            continue
        series = np.zeros(len(rows), dtype=int)
        if mode != BIAXIAL:
            series = records(stretch[rows], time[rows])
        if series.any():
            readings.assumed.append(
                f"{mode}: rows begin again at small stretches {series.max()} times: each part is"
                " taken as a specimen of its own"
            )
        for number in range(series.max() + 1):
            part = rows[series == number]
            title = " ".join(
                filter(None, (readings.block.title, group, f"{number + 1}" * bool(series.any())))
            )
            found.append(_specimen(readings, title, mode, part, before, stretch, stress))
    return found


def _specimen(readings, title, mode, rows, before, stretch, stress) -> Specimen:
    """Return rows of a table as a specimen, its branches recognized."""
    lateral, across = (one[rows] for one in readings.across(stretch))
    stretch, stress = stretch[rows], stress[rows]
    time = readings.numbers("time")[rows]
    if readings.facts.rate is not None:
        if np.isfinite(time).any():
            raise ValueError(f"{readings.where}: --rate is stated, but there are times already")
        time = np.abs(np.diff(stretch, prepend=stretch[0])).cumsum() / _rate(readings.facts)
    branch = np.full(len(rows), "loading", dtype="<U9")
    cycle, end, at_break = np.ones(len(rows), dtype=int), len(rows), None
    lost, zero = None, 1.0
    if mode != BIAXIAL:
        peak, ended = break_row(stretch, stress, time), readings.ended(rows)
        drops = peak is not None
        if (
            ended in ("yes", "grips")
            and not drops
            and (peak := last_state(stretch, stress)) is None
        ):
            raise ValueError(
                f"{readings.where}, {title or mode}: it broke as is said, but the load neither"
                " drops while the strain goes on nor is greatest in the last row"
            )
        end = len(rows) if peak is None else peak + 1
        branch[end:] = "broken"
        branch[:end], cycle[:end] = branches(stretch[:end], time[:end], readings.resolution)
        cycle[end:] = cycle[end - 1]
        lost = energy_lost(stretch[:end], stress[:end], branch[:end], cycle[:end])
        first = (cycle == cycle[0]) & (branch == "loading")
        branch[np.flatnonzero(first)[creep(stretch[first], stress[first], time[first])]] = "hold"
        first &= branch == "loading"
        zero = stretch_at_zero(stretch[first], stress[first], mode.removesuffix("-tear"))
        if zero != 1.0:
            stretch = _shifted(readings, stretch, zero)
        else:
            _check_signs(readings, stretch[first], stress[first])
        if peak is not None:
            last = (cycle == cycle[peak]) & (np.arange(len(rows)) <= peak) & (branch != "unloading")
            no_strength = NO_STRENGTH.get(str(ended))
            slipped = slip(stretch, stress, branch == "loading", peak)
            if slipped and not no_strength:
                no_strength = f"the load falls at {slipped:.4g} and rises again, as if it slipped"
            at_break = AtBreak(
                float(stretch[peak]),
                float(stress[peak]),
                AXES.get(mode, 1) * float(np.trapezoid(stress[last], stretch[last])),
                drops,
                no_strength,
            )
    own = readings.numbers("cycle")[rows]
    cycle = own.astype(int) if np.isfinite(own).all() else cycle
    wanted = readings.facts.branch
    if wanted == "all":
        chosen = branch != "broken"
    elif wanted in (None, "loading", "unloading"):
        chosen = (branch == (wanted or "loading")) & (cycle == cycle[0])
    else:
        chosen = (cycle == int(wanted)) & (branch != "broken")
    if zero != 1.0 and readings.facts.zero != "keep":  # rows of slack say nothing
        chosen &= (stretch - 1) * np.sign(stretch[np.abs(stress).argmax()] - 1) >= 0
    if not chosen.any():
        readings.missing.append(
            f"{title or mode}: no rows of --branch {wanted}; there are {cycle.max()} cycles"
        )
    _tell(readings, title or mode, branch, cycle, chosen, lost, at_break)
    return Specimen(
        title or readings.where,
        mode,
        rows + 1 + before,
        stretch,
        stress,
        lateral,
        across,
        time,
        readings.numbers("weight")[rows],
        cycle,
        branch,
        chosen,
        at_break,
    )


def _check_signs(readings: Readings, stretch: np.ndarray, stress: np.ndarray) -> None:
    """Ask for the sign of stresses that are against their strains, and say that there is a stress
    at a stretch of 1.
    """
    size, greatest = np.abs(stress), np.abs(stress).max(initial=0.0)
    rows = (size > 0.05 * greatest) & (np.abs(stretch - 1) > LEAST)
    if rows.sum() > 2 and (np.sign(stretch - 1) != np.sign(stress))[rows].all():
        way = "compression" if stretch[rows].mean() < 1 else "tension"
        readings.missing.append(
            f"all stresses are against their strains, which are of {way}: change the sign of one of"
            " the columns; what is positive in compression has a heading that says so, such as"
            " 'Compressive load (N)'"
        )
    away = np.abs(stretch - 1)
    rest = away.argmin() if len(stretch) else 0
    if rows.any() and away[rest] < LEAST / 2 * away.max() and size[rest] > 0.05 * greatest:
        readings.assumed.append(
            f"at a stretch of {stretch[rest]:.4g} the nominal stress is {stress[rest]:.4g} already"
            " (a preload, or relaxation); stretches stay as they are"
        )


def _shifted(readings: Readings, stretch: np.ndarray, zero: float) -> np.ndarray:
    """Return stretches that are 1 at zero force, unless the user keeps them, and say the shift."""
    cause = "slack" if (zero - 1) * (np.median(stretch) - 1) > 0 else "a preload"
    text = f"the stretch at zero force is {zero:.4g} ({cause})"
    if readings.facts.zero == "keep":
        readings.assumed.append(f"{text}, and stays as it is")
        return stretch
    readings.assumed.append(f"{text}: {1 - zero:+.4g} is added to all stretches (--zero keep)")
    return stretch - (zero - 1)


def _tell(readings, name, branch, cycle, chosen, lost, at_break) -> None:
    """Say where a specimen breaks, how much energy it loses, and which rows are left out."""
    if at_break is not None:
        readings.assumed.append(
            f"{name} breaks at a stretch of {at_break.stretch:.4g} and a nominal stress of"
            f" {at_break.nominal_stress:.4g}; {(branch == 'broken').sum()} rows after it are left"
            " out" + f"; that is no strength: {at_break.no_strength}" * bool(at_break.no_strength)
        )
    if lost is not None and lost > LEAST:
        readings.assumed.append(
            f"{name}: hysteresis: {100 * lost:.1f} % of the work of the first loading is lost on"
            " unloading"
        )
    left = ~chosen & (branch != "broken")
    kinds = [
        f"{number} of {kind}"
        for kind in ("loading", "unloading", "hold")
        if (number := int((left & (branch == kind)).sum()))
    ]
    if kinds:
        readings.assumed.append(
            f"{name}: {chosen.sum()} of {len(chosen)} rows are taken"
            f" ({readings.facts.branch or 'the first loading'}); left out: {', '.join(kinds)}"
            " (--branch all takes them)"
        )
