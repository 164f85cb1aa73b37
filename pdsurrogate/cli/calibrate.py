"""Command ``calibrate``, which finds a law from displacement fields and forces measured on a
body that a scene describes.
"""

import time
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from ..artifacts.material import rates_between_grips
from ..artifacts.places import new_artifact, next_version
from ..calibration import SceneRegressor, reporting
from ..calibration.field_files import FieldFacts
from ..calibration.measured import DISPLACEMENTS, FORCE, FORCES, with_law
from ..calibration.measurement_files import measurements
from ..identification.campaign import TableFacts
from ..identification.regressor import N_TERMS
from ..identification.stress_regressor import bulk_arguments
from ..learning.fitting import TooInexact
from ..learning.settings import FitSettings
from ..materials import Polyconvex
from ..results import figures
from ..results.files import write_json
from ..results.places import MEASURED, write_columns
from ..run.simulate import simulate
from ..scenes import load_scene
from ..scenes.reading import parse_change
from .command import SCENE_HELP, Overwrite, SetScene, check_folder, with_fields
from .identify import BulkModulus, Terms, print_parameters
from .terminal import FAILED, Bar, bad_input, note, print_json, print_rows, warn, writing

RUN = "calibration-run"
"""Folder, within that of a calibration, of the run with the fitted law and the measured fields."""

FIELDS_HELP = (
    "File of displacements with the columns step, x1, x2, u1, u2 (solids: also x3 and u3), or of a"
    " program for image correlation: one for each image, as a folder, 'FOLDER/*.csv' in quotes, or"
    " repeated."
)
FORCES_HELP = (
    "CSV file with the column step and measurements: force, of the region that is pulled, or"
    " columns of history.csv such as force_right_1; or the table of a testing machine."
)


@with_fields(facts=TableFacts, image=FieldFacts)
def calibrate(
    scene: Annotated[
        str, Argument(metavar="SCENE", help=f"{SCENE_HELP}. Step k is its k-th output.")
    ],
    name: Annotated[str, Argument(metavar="NAME", help="Name of the new artifact.")],
    *,
    fields: Annotated[list[Path] | None, Option(metavar="F.csv", help=FIELDS_HELP)] = None,
    image: FieldFacts,
    forces: Annotated[Path | None, Option(metavar="G.csv", help=FORCES_HELP)] = None,
    times: Annotated[
        str | None,
        Option(
            metavar="TIMES",
            help=(
                "Time of each step in the table of a machine, in seconds with commas between them,"
                " or a table with a column of times (default: those of the scene, or else its rows"
                " are the steps)."
            ),
        ),
    ] = None,
    facts: TableFacts,
    law: Annotated[
        str | None, Option(metavar="LAW", help="Law whose parameters are fitted.")
    ] = None,
    free: Annotated[
        bool, Option("--free", help="Find an energy of few terms instead of a law.")
    ] = False,
    terms: Terms = None,
    field_noise: Annotated[
        float | None, Option(help="Standard deviation of the displacements (default: estimated).")
    ] = None,
    force_noise: Annotated[
        float | None,
        Option(help="Standard deviation of the forces (default: 0.5 % of the greatest)."),
    ] = None,
    refine: Annotated[
        int | None,
        Option(
            help=(
                "Spacing divided by that of the finer simulation; 1: no correction (default: 3 with"
                " --law, 6 with --free)."
            ),
            min=1,
        ),
    ] = None,
    bulk_modulus: BulkModulus = None,
    bulk_ratio: Annotated[
        float | None,
        Option(help="Ratio of bulk modulus to shear modulus (default: that of the scene)."),
    ] = None,
    change: SetScene = None,
    folder: Annotated[
        Path,
        Option(
            "--out",
            metavar="DIR",
            help="Folder for the artifact, calibration.json and the figures.",
        ),
    ],
    overwrite: Overwrite = False,
) -> None:
    """Fit a law or an energy to the measurements, store an artifact of it, and print and write a
    report.
    """
    if free == (law is not None):
        raise ValueError(
            "choose one: --law LAW fits the parameters of a law, --free an energy without a law"
        )
    if terms is not None and law != "ogden":
        raise ValueError("--terms needs --law ogden")
    if law == Polyconvex.name:
        raise ValueError(f"--law {law}: this law is a sum of terms, which --free chooses and fits")
    for option, noise in (("--field-noise", field_noise), ("--force-noise", force_noise)):
        if noise is not None and not 0 < noise < np.inf:
            raise ValueError(
                f"{option} {noise:g}: a standard deviation must be positive and finite; leave the"
                " option out for the default"
            )
    bulk = bulk_arguments(bulk_modulus=bulk_modulus, bulk_ratio=bulk_ratio)
    test = load_scene(scene, dict(parse_change(item) for item in change or ()))
    X, y, outputs, images = measurements(
        test, fields, forces, facts.stated(bool(fields)), times, image, facts.field_unit
    )
    with bad_input(OSError):
        new_artifact(folder, name, next_version(folder, name))
    check_folder(folder, "calibration.json", overwrite)
    model = SceneRegressor(
        test,
        law,
        terms or N_TERMS,
        outputs=[*outputs.values()] or None,
        refine=refine,
        **bulk,
        **(images.arguments if images else {"frame": image.frame}),
    )
    for text in images.notes if images else ():
        note(text)
    noises = {1: field_noise}
    began = time.perf_counter()
    for number, key in enumerate(outputs.values()):
        noises[-number] = (
            force_noise
            if FORCES.fullmatch(key)
            else field_noise
            if DISPLACEMENTS.fullmatch(key)
            else None
        )
    with Bar(test.name):
        deviations = model.stated_deviations(X, y, noises)
        if images and field_noise is None:  # files state those of some points
            first = deviations[: len(images.y)]
            first[:] = np.where(np.isfinite(images.deviation), images.deviation, first)
        model.fit(X, y, standard_deviation=deviations)
    found = reporting.report(model, X, y, [*outputs])
    seconds = time.perf_counter() - began
    print_calibrated(found)
    data = f"{' and '.join(file.name for file in (*(fields or ()), forces) if file)} in {test.name}"
    memory = model.law_.memory
    if memory:  # of which bond forces have none
        rates = rates_between_grips(test) if memory.branches else None
        known = rates and np.isfinite(rates).all()
        found |= {"time_unit": test.units.time or "s", "rates": [*rates] if known else None}
    settings = FitSettings(energy=test.plane != "stress" or bool(memory), folds=0)
    if free:  # a law is trusted beyond the states of the test, an energy of terms is not
        settings = settings.within(*model.stretch_range_)
    with Bar(name):
        write = settings.train(model.law_, model.domain_hull_, {"data": data, **found})
    with writing(folder), bad_input(TooInexact, status=FAILED):
        path = write(folder, name, None)
        found = {"artifact": str(path), **found, "seconds": seconds}
        write_json(folder / "calibration.json", found)
        for which, drawn in reporting.figures(model, X, y, [*outputs]).items():
            figures.save(drawn, folder / f"calibration-{which}.png")
        if fields:  # for `show --html`, which shows both
            simulate(with_law(test, model.law_), FORCE, folder=folder / RUN, overwrite=True)
            write_columns(folder / RUN / MEASURED, reporting.measured_fields(model, X, y))
    print_json(found)
    note(f"Wrote {path}, and the report in {folder}")


def _in_text(value: float | str | list) -> float | str:
    """Return numbers in one text, and else what is given."""
    return np.array2string(np.array(value), precision=4) if isinstance(value, list) else value


def print_calibrated(found: dict) -> None:
    """Print the parameters of a calibrated law with their standard errors, the residuals, and
    what the test leaves open.
    """
    print_parameters(f"{found['law']['law']}, calibrated", found)
    print_rows(
        "Measurements: residuals in their units",
        [{"measured": kind, **row} for kind, row in found["measurements"].items()],
    )
    print_rows(
        "Nominal stresses of the law",
        [{"mode": mode, **row} for mode, rows in found["stresses"].items() for row in rows],
    )
    if "map" in found:
        errors = dict(found["map"].get("standard_errors", {}))
        errors["origin_of_image"] = errors.pop("translation", "")
        print_rows(
            "Map from the image to the scene",
            [
                {
                    "what": key.replace("_", " "),
                    "value": _in_text(value),
                    "standard error": _in_text(errors.get(key, "")),
                }
                for key, value in found["map"].items()
                if key != "standard_errors"
            ],
        )
        print_rows("Points left out or down-weighted", [found["points"]])
    for text in found["remarks"]:
        warn(text)
