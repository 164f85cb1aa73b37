"""Effective diameters of crack tips: bodies with a precut are torn slowly, and G at the peak of the
load is divided by psi delta.

python pipelines/tip_diameters.py --lacking        tears what docs/figures/tip-diameters.json lacks
python pipelines/tip_diameters.py "strain 2.2"     the tears that have all of these in their names
python pipelines/tip_diameters.py --docs           writes the package's table and the page

A strip of 4 x 1 with a precut of 1.5 is pulled in pure shear, and G is W h; in plane strain, where
its volume would not allow that, the grips slide. In a strip that is turned in its lattice, and held
at points, and in a square with an edge notch, G is -dE/da of two equilibria. All tears are in
equilibrium.
"""

import json
import time
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import scipy
from cases import HEADS, Study, ending_at, report, rows_of, stored, table_of
from pages import markdown_table

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous
from pdsurrogate.scenes.tip_diameter import measured_diameters, tip_diameters

TABLE = Path(pds.__file__).resolve().parent / "scenes" / "tip_diameters.json"

LONG, PRECUT, ENERGY = 4.0, 1.5, 0.35
"""Of a strip of height 1: length, precut, fracture energy over shear modulus and height."""

FAMILIES = {"neo-hookean": "bond force", "bond-energy": "bond energy"}
"""Families of the force models that are measured; learned energies are compared with the exact
one.
"""

GUESS = {"neo-hookean": 1.15, 1.75: 1.35}
"""Diameters in horizons, by force model or horizon, by which critical stretches are chosen so
that G is near ENERGY; elsewhere 0.9.
"""

LAYERS, THICKER = 3, {1.75: 5}
"""Points through the thickness of strips in space, and of those at a horizon where bonds reach one
layer: of three layers, two points of the middle one can leave both flanks of a crack and hold it.
"""

BULK = 20.0
"""Bulk modulus over shear modulus."""

CASE = "family", "plane", "arrangement", "horizon_ratio", "bulk_ratio"
"""What the diameters of a case have in common, in the order of `told`."""

LEAST = {"rows": 2, "seeds": 5}
"""Tears that a diameter needs, at spacings along a row or over clouds."""

MOST_SPREAD = 0.07
"""Greatest relative deviation of a spacing's diameter from the tabulated one, along a row: G at the
peak then misses the prescribed one by no more. Cases with a greater one have no entry, so that
`fracture.energy` is refused.
"""

LEAST_HEIGHT = 2.0
"""Least height of strips of which the table is made, in blunted tips, which are about as wide as a
horizon that is stretched by the critical stretch.

Chosen after some tears: at a horizon of 3.15 spacings, strips of 1.8 to 1.9 such widths gave 9 to
11 % less than those of 2.2 and more.
"""

PAST_PEAK = 5
"""Advance of the crack, in spacings along a row, at which a tear ends. The tip of a precut grows
into that of a running crack within 2.5 spacings, at all horizons, and then the load falls: three
clouds that were torn through had their peaks within 2.2.
"""

OFFSET = 0.3
"""Difference of either precut from the one in between, for -dE/da: some spacings, so that the
rows at its end do not matter.
"""


def high_enough(case):
    """Whether a strip is high enough for its critical stretch."""
    return case["rows"] >= LEAST_HEIGHT * case["critical"] * case["ratio"]


def guess(case):
    """Diameter in horizons by which critical stretches, or the travel at the peak, are chosen."""
    return GUESS.get(case["model"], GUESS.get(case["ratio"], 0.9))


def law_of(case):
    """Law of the material: neo-Hookean, or with a `limit` of the chains that of Gent."""
    bulk = case.get("bulk", BULK)
    return (
        pds.materials.Gent(1.0, bulk, chain_limit=case["limit"])
        if "limit" in case
        else pds.materials.NeoHookean(1.0, bulk)
    )


def layers_of(case):
    """Points through the thickness of a strip in space."""
    return case.get("layers", THICKER.get(case["ratio"], LAYERS))


def density_of(case):
    """Expected G over height of a case."""
    if "critical" not in case:
        return case.get("energy", ENERGY)
    return (
        homogeneous.uniaxial(law_of(case), case["critical"]).energy_density
        * guess(case)
        * case["ratio"]
        / case["rows"]
    )


def expected_travel(case):
    """Travel of the grip of a strip of height 1 at which pure shear has the expected energy."""
    law, density = law_of(case), density_of(case)
    return scipy.optimize.brentq(
        lambda travel: homogeneous.pure_shear(law, 1 + travel).energy_density - density, 0.0, 5.0
    )


def cases(study):
    """All tears of a study by their names, such as "model=bond-energy plane=stress ratio=2.2
    rows=16", which stand in its JSON; figures of those without a peak, or not torn yet, are empty.
    """
    texts = {"model", "plane", "arrangement"}
    words = {name: [word.split("=") for word in name.split()] for name in stored(study)}
    return {
        name: {key: value if key in texts else json.loads(value) for key, value in of}
        for name, of in words.items()
    }


def strip(case, critical=None, precut=None, end=None):
    """The body of a case: torn, or with `end` brought into equilibrium at a travel of the grip."""
    solid, high, spacing = case["plane"] == "space", case.get("high", 1.0), 1 / case["rows"]
    turn = np.radians(case.get("angle", 0))
    # what holds a turned strip at either side
    held = np.ceil(case["ratio"]) * spacing if turn else 0.0
    origin = np.zeros(2) if turn else np.array([LONG / 2, high / 2])

    def turned(x, y):
        return np.array([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y])

    def place(x, y):
        return (origin + turned(x, y)).tolist()

    if turn:
        sides = [
            (x * LONG / 2, y * (high / 2 + held)) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        body = {"shape": "polygon", "vertices": [place(*corner) for corner in sides]}
        kind, flat = ("half_space", [0.0]) if solid else ("half_plane", [])
        ends = [
            {
                kind: {
                    "point": place(0, side * high / 2) + flat,
                    "normal": turned(0, side).tolist() + flat,
                }
            }
            for side in (-1, 1)
        ]
    else:
        body, ends = {"shape": "rectangle", "size": [LONG, high]}, ["bottom", "top"]
    begin, tip = place(-LONG, 0), place((precut or case.get("precut", PRECUT)) - LONG / 2, 0)
    cut = {"start": begin, "end": tip}
    if solid:
        body = {"shape": "extrusion", "outline": body, "thickness": layers_of(case) * spacing}
        cut = {
            "corner": [*begin, -1.0],
            "sides": [[*np.subtract(tip, begin).tolist(), 0.0], [0.0, 0.0, 3.0]],
        }
    body |= {key: case[key] for key in ("arrangement", "seed") if key in case}
    normal, across = turned(0, 1).tolist(), {"x3": 0.0} if solid else {}
    prescribed = [{"region": ends[0], "name": "low", "x1": 0.0, "x2": 0.0, **across}]
    prescribed += [{"region": ends[1], "name": "high", "x1": normal[0], "x2": normal[1], **across}]
    last = 0.5 * high if high != 1 else 2 * expected_travel(case)
    slides = case["plane"] == "strain" and high == 1
    return pds.Scene.model_validate(
        {
            "name": "strip",
            "spacing": spacing,
            "horizon_ratio": case["ratio"],
            "plane": case["plane"],
            "body": body,
            "precuts": [cut],
            "material": law_of(case).describe(),
            "prescribed": sliding(prescribed) if slides else prescribed,
            "steps": [{"to": last}] if end is None else [{"to": end, "outputs": 8}],
            **({"fracture": {"critical_stretch": critical}} if end is None else {}),
        }
    )


def sliding(prescribed):
    """Grips that leave the direction along them free; the far end of the strip is a plane of
    symmetry.
    """
    for entry in prescribed:
        del entry["x1"]
    return [*prescribed, {"region": "right", "name": "end", "x1": 0.0}]


def bonds_a_spacing(case):
    """Bonds that a crack along a row of the lattice breaks when it grows by a spacing."""
    reach, solid = int(case["ratio"]), case["plane"] == "space"
    along, up, deep = np.mgrid[
        -reach : reach + 1, 1 : reach + 1, -reach * solid : reach * solid + 1
    ]
    near = along**2 + up**2 + deep**2 <= case["ratio"] ** 2
    layers = np.maximum(layers_of(case) - abs(deep), 0) if solid else 1
    return int((near * up * layers).sum())


def pulls(case, forces):
    """Forces of the moving grip along its travel, over the thickness."""
    turn = np.radians(case.get("angle", 0))
    thickness = layers_of(case) / case["rows"] if case["plane"] == "space" else 1.0
    return (
        np.array([force[1] * np.cos(turn) - force[0] * np.sin(turn) for force in forces])
        / thickness
    )


def released(case, travel):
    """-dE/da at a travel: the works of the grips on two bodies whose precuts differ."""
    works = []
    for precut in case.get("precut", PRECUT) + np.array([-OFFSET, OFFSET]) / (
        1 if case.get("high", 1) == 1 else 3
    ):
        levels = pds.simulate(
            strip(case, precut=float(precut) + 1e-3 / case["rows"], end=travel),
            case["model"],
            threads=1,
        ).levels
        forces = pulls(case, [level["forces"]["high"] for level in levels])
        works.append(
            (precut, np.trapezoid([0.0, *forces], [0.0, *(level["t"] for level in levels)]))
        )
    (short, large), (long, small) = works
    return float((large - small) / (long - short))


def torn(case):
    """A case with the figures of its tear."""
    began, horizon, law = time.process_time(), case["ratio"] / case["rows"], law_of(case)
    critical = case.get("critical") or pds.critical_stretch_of(
        law, case.get("energy", ENERGY), horizon, guess(case)
    )
    with ending_at(PAST_PEAK * bonds_a_spacing(case)):
        result = pds.simulate(strip(case, critical), case["model"], threads=1)
    rows = result.history
    load = pulls(case, [(row["force_high_1"], row["force_high_2"]) for row in rows])
    peak = rows[int(load.argmax())]
    travel = peak["t"]
    if load.argmax() == len(load) - 1:
        raise ValueError("the load rises until the end of the pull: it has no peak")
    figures = {"critical_stretch": critical, "travel": travel, "peak": float(load.max())}
    figures["grown"] = peak["broken_bonds"] / bonds_a_spacing(case)
    if case.get("high", 1) == 1 and not case.get("angle"):
        stretch = (
            homogeneous.uniaxial(law, 1 + travel, "strain")
            if case["plane"] == "strain"
            else homogeneous.pure_shear(law, 1 + travel)
        )
        figures["G"] = stretch.energy_density
    else:
        figures["G"] = released(case, travel)
    figures["diameter"] = figures["G"] / (
        homogeneous.uniaxial(law, critical).energy_density * result.body.horizon
    )
    figures["account_percent"] = result.summary["quasi_static"].get("energy_gap")
    yield case | figures | {"seconds": time.process_time() - began}


def tears_of(name):
    """Tears of a study so far."""
    return rows_of(stored(name))


def strips():
    """Turned strips of `crack_directions.py`, and the diameters of their tips."""
    found = []
    for case in tears_of("crack-directions"):
        if case["plane"] != "space":
            density = homogeneous.uniaxial(law_of(case), case["critical_stretch"]).energy_density
            found.append(case | {"diameter": case["peak"] / density * case["rows"] / case["ratio"]})
    return found


def told(case):
    """Family of the force model, plane, arrangement and horizon of a tear; those of other force
    models have their names.
    """
    return (
        FAMILIES.get(case["model"], case["model"]),
        case["plane"],
        case.get("arrangement", "lattice"),
        case["ratio"],
        case.get("bulk", BULK),
    )


def process(case, averaged):
    """How the tears of a case, by `told`, were made, of those that the table averages or of those
    that judge it: tears in dynamics are from before.
    """
    tears = [
        tear
        for tear in tears_of("tip-diameters")
        if told(tear) == case and ("critical" in tear) == averaged
    ]
    kinds = {"slow" if "grown" in tear else "dynamics" for tear in tears}
    return " and ".join(sorted(kinds, reverse=True))


def measured():
    """All measured cases: the mean along a row over spacings, or over clouds, the tears that it
    averages, and a diameter if settled.
    """
    found: dict[tuple, dict] = {}
    for case in tears_of("tip-diameters"):
        if "critical" in case and not {"limit", "layers"} & case.keys() and high_enough(case):
            kind, number = ("seeds", "seed") if "seed" in case else ("rows", "rows")
            found.setdefault((*told(case), case["critical"]), {kind: {}})[kind][case[number]] = (
                round(case["diameter"], 3)
            )
    entries = []
    for key, figures in sorted(found.items()):
        ((kind, by_number),) = figures.items()
        entry = dict(
            zip(
                (*CASE, "critical_stretch"),
                key,
                strict=True,
            )
        )
        tears = np.array(list(by_number.values()))
        if len(tears) >= LEAST[kind]:
            mean = float(tears.mean())
            settled = kind == "seeds" or np.abs(tears / mean - 1).max() <= MOST_SPREAD
            entry |= {"diameter": round(mean, 3)} if settled else {}
            entry |= {"mean": round(mean, 3), "deviation": round(float(tears.std(ddof=1)), 3)}
        entries.append(
            entry | {kind: {str(number): by_number[number] for number in sorted(by_number)}}
        )
    return entries


def case_of(entry):
    """What `told` returns of the tears of an entry."""
    return tuple(entry[key] for key in CASE)


def table():
    """Entries of the package's table: the measured cases that have diameters at two critical
    stretches or more.
    """
    settled = [entry for entry in measured() if "diameter" in entry]
    several = Counter(case_of(entry) for entry in settled)
    return [entry for entry in settled if several[case_of(entry)] > 1]


def diameters(figures):
    """The table of the page, and that of the package, an entry to a line."""
    TABLE.write_text("[\n" + ",\n".join(map(json.dumps, table())) + "\n]\n", "utf-8")
    measured_diameters.cache_clear()
    entries = measured()
    stretches, rows = sorted({entry["critical_stretch"] for entry in entries}), []
    for case in dict.fromkeys(case_of(entry) for entry in entries):
        cells = {
            entry["critical_stretch"]: cell(entry) for entry in entries if case_of(entry) == case
        }
        rows.append(
            [
                case[0],
                f"{case[1]}, {case[2]}",
                f"{case[3]:g}",
                f"{case[4]:g}",
                process(case, averaged=True),
                *(cells.get(stretch, "-") for stretch in stretches),
            ]
        )
    head = ["force model", "body, points", "horizon (spacings)", "K / μ", "tears"]
    return markdown_table([*head, *(f"λ_c = {stretch:g}" for stretch in stretches)], rows)


def others(figures):
    """Tears of other bodies and force models."""
    found = [
        case
        for case in rows_of(figures)
        if case["model"] not in FAMILIES
        or {"high", "limit", "layers"} & case.keys()
        or ("bulk" in case and "critical" not in case)
    ]
    for case in sorted(
        found,
        key=lambda case: (
            "high" in case,
            case["plane"],
            case["model"],
            case.get("precut", 0),
            case.get("angle", 0),
        ),
    ):
        law = f"Gent, limit {case['limit']:g}, " if "limit" in case else ""
        thick = f"{case['layers']} points thick, " if "layers" in case else ""
        turned = f", turned by {case['angle']} degrees" if case.get("angle") else ""
        body = (
            f"square of 4 x 4, notch {case['precut']:g}{turned}"
            if "high" in case
            else f"strip, {thick}{law}K = {case.get('bulk', BULK):g} μ"
        )
        numbers = (case[key] for key in ("ratio", "rows", "critical_stretch", "diameter"))
        yield case["model"], f"{body}, {case['plane']}", *numbers


def cell(entry):
    """Mean, deviation and number of the tears of an entry, in brackets if it gives no diameter."""
    tears = entry.get("rows", {}) | entry.get("seeds", {})
    if "mean" not in entry:
        return f"({np.mean(list(tears.values())):.2f}; {len(tears)})"
    text = f"{entry['mean']:.2f} ± {entry['deviation']:.2f}; {len(tears)}"
    return text if "diameter" in entry else f"({text})"


def span(values):
    """Least and greatest value."""
    return (
        f"{min(values):.2f} to {max(values):.2f}"
        if len(values) > 1
        else "".join(f"{value:.2f}" for value in values) or "-"
    )


def judged():
    """G at the peak over the prescribed one by case and kind of tear, of tears that the table does
    not average.

    The cases are those of the package's table, and along a row of the lattice those at horizons
    between them.
    """
    own = [
        case for case in tears_of("tip-diameters") if "critical" not in case and "bulk" not in case
    ]
    stretched = {told(case) for case in tears_of("tip-diameters") if "critical" in case}
    between = [told(case) for case in own if told(case) not in stretched]
    found: dict[tuple, dict[str, list[float]]] = {}
    for case in sorted({*map(case_of, table()), *between}):
        family, plane, arrangement, ratio, bulk = case
        tips = tip_diameters(plane, ratio, family, arrangement, bulk)
        found[case] = {kind: [] for kind in ("along", "clouds", "turned", "notched", "directions")}
        for tear in [*own, *(strip | {"directions": True} for strip in strips())]:
            if told(tear) == case:
                kind = (
                    "directions"
                    if "directions" in tear
                    else "clouds"
                    if "seed" in tear
                    else "notched"
                    if "high" in tear
                    else "along"
                )
                kind = "turned" if kind in ("along", "notched") and tear["angle"] else kind
                found[case][kind].append(tear["diameter"] / tips.at(tear["critical_stretch"]))
    return {case: ratios for case, ratios in found.items() if any(ratios.values())}


def error_of(entries, ratios):
    """Standard error of the mean of some ratios, together with the greatest one of the entries
    of their case, if clouds have them.
    """
    tips = [
        entry["deviation"] / entry["mean"] / np.sqrt(len(entry["seeds"]))
        for entry in entries
        if "seeds" in entry
    ]
    return float(np.hypot(np.std(ratios, ddof=1) / np.sqrt(len(ratios)), max(tips, default=0.0)))


def peaks(figures):
    """G at the peak over the prescribed one, for every judged case."""
    entries = table()
    for case, ratios in judged().items():
        family, plane, arrangement, ratio, _ = case
        own = [entry for entry in entries if case_of(entry) == case]
        yield (
            *(family, f"{plane}, {arrangement}", ratio, process(case, averaged=False) or None),
            *(len(ratios["along"]) or None, span(ratios["along"]), averaged(own, ratios["clouds"])),
            *(span(ratios["turned"]), span(ratios["notched"])),
            averaged(own, ratios["directions"]),
        )


def averaged(entries, ratios):
    """Mean, standard error and number of some ratios of a case with these entries in the table."""
    return (
        f"{np.mean(ratios):.2f} ± {error_of(entries, ratios):.2f} ({len(ratios)})"
        if len(ratios) > 1
        else span(ratios)
    )


if __name__ == "__main__":
    tables = {
        "tip-diameters": diameters,
        "other-tips": table_of(others, HEADS["other-tips"]),
        "peaks": table_of(peaks, HEADS["peaks"]),
    }
    named = {name: partial(torn, case) for name, case in cases("tip-diameters").items()}
    report(__doc__, Study("tip-diameters", named, tables))
