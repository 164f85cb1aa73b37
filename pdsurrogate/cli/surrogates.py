"""Commands about surrogates: fit, evaluate, artifacts."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from .application import Rate, bad_input, described_law, ended, law_of, note, out, print_json, progress_bar, show, status, writing
from .common import AsJson, command
from .materials import (
    DATA_HELP,
    BulkModulus,
    BulkRatio,
    bulk_of,
    differences_in_words,
    free_energy,
    identified,
    members_of,
    print_identified,
    warn,
)

EDGE = 1e-6
"""Log-stretch by which a test must be beyond an artefact's domain to be counted: rounding decides none of those on its edge."""

Reference = Annotated[str, typer.Argument(metavar="REF", help="analytic, bond-energy, or an artefact: NAME, NAME@VERSION or a path.")]


@command()
def fit(
    name: Annotated[str, typer.Argument(help="Name of the new artefact.")],
    version: Annotated[str | None, typer.Option(help="Its version; by default the next one: versions never change once written.")] = None,
    law: Annotated[str, typer.Option(help="Material law.")] = "neo-hookean",
    change: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A parameter of the law; may be repeated.")] = None,
    data: Annotated[Path | None, typer.Option(metavar="CSV", help=f"Identify the law's parameters first. {DATA_HELP}")] = None,
    terms: Annotated[int, typer.Option(help="Terms of Ogden's law, with --data.", min=1, max=4)] = 3,
    free: Annotated[
        bool, typer.Option("--free", help="No law: with --data, the energy that fits the data best among those that physics allows.")
    ] = False,
    bulk_modulus: BulkModulus = None,
    bulk_ratio: BulkRatio = None,
    force_fit: Annotated[
        bool, typer.Option("--force-fit", help="With --data, go on where stresses have the wrong sign, or a mode is not described at all.")
    ] = False,
    committee: Annotated[
        int | None,
        typer.Option(
            help="Ensemble members stored with the model, each fitted to half of the tests (without data: with another seed).", min=2
        ),
    ] = None,
    energy: Annotated[
        bool,
        typer.Option("--energy", help="Its isochoric energy instead, for plane strain, space and every bulk modulus: a network."),
    ] = False,
    features: Annotated[
        str | None, typer.Option(help="isochoric (for polynomials), symmetric (for networks), or the paper's five (paper).")
    ] = None,
    degree: Annotated[str | None, typer.Option(help="Degrees of a polynomial in the two isochoric features; 12,6 by default.")] = None,
    units: Annotated[str | None, typer.Option(help="Hidden units of a network instead; two layers with a comma between.")] = None,
    activation: Annotated[str | None, typer.Option(help="Of a network: algebraic (the default), logistic, tanh or relu.")] = None,
    samples: Annotated[int | None, typer.Option(help="Training samples; 8000, of an energy 1000.", min=200)] = None,
    least: Annotated[
        float | None, typer.Option(help="Least principal stretch trained on, below 1; 0.5 (of an energy 0.25), or as far as the law goes.")
    ] = None,
    greatest: Annotated[
        float | None, typer.Option(help="Greatest principal stretch trained on, above 1; 4, or as far as the law goes.")
    ] = None,
    iterations: Annotated[int | None, typer.Option(help="Most iterations of the training of a network; 1000 by default.", min=1)] = None,
    folds: Annotated[int, typer.Option(help="Folds of the cross-validation; 0 for none.", min=0)] = 5,
    seed: Annotated[int, typer.Option(help="Seed of samples, split and first weights.", min=0)] = 0,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder of artefacts; by default artifacts here (own-artifacts in a checkout), or $PDSURROGATE_ARTIFACTS.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fit a surrogate of a law's bond force or isochoric energy, cross-validate it, and store it as an artefact."""
    from ..artifacts import ArtifactError, load_card, new_artifact, next_version, own_folder
    from ..identification import examine, report
    from ..learning import store
    from ..learning.fitting import TooInexact
    from ..learning.settings import FitSettings
    from ..results.files import check_writable
    from ..scenes import SceneError

    with bad_input(SceneError, ArtifactError, ValueError, OSError):
        folder = own_folder() if folder is None else folder
        new_artifact(folder, name, next_version(folder, name) if version is None else version)
        settings = FitSettings(energy, features, degree, units, activation, samples, least, greatest, iterations, folds, seed)
        check_writable(folder)
        found, laws, bulk = None, [], bulk_of(bulk_modulus, bulk_ratio)
        if data is None and (bulk or force_fit):
            raise ValueError("--bulk-modulus, --bulk-ratio and --force-fit are of test data, which --data gives; of a law by --set")
        if free and data is None:
            raise ValueError("--free is of an energy from test data: give them by --data")
        if data is not None:
            if change:
                raise ValueError("--data finds the law's parameters, --set gives them: choose one")
            with status(f"Fitting {'an energy' if free else law} to {data}"):
                model, rows = free_energy(data, bulk) if free else identified(data, law, terms, None, bulk)
            material, found = model.law_, report(model, rows)
            if free:
                settings = settings.within(*model.stretch_range_)
                found |= {"form": "polyconvex energy without a law", "cross_validation": model.cross_validation_}
                law = "energy"
            if committee:
                with status(f"Fitting {committee} drawings from {data}"):
                    laws = members_of(model, rows, committee, seed)
                own = " with exponents of its own" if free else ""
                found["committee"] = f"each fitted to half of {len(set(rows.tests))} tests{own}, seed {seed}"
            said = examine(model, rows)
            found["refusals"], found["remarks"] = said.refusals, said.remarks
            print_identified(found)
            for text in (*said.remarks, *(said.refusals if force_fit else ())):
                warn(text)
            if said.refusals and not force_fit:
                raise ValueError(f"{'; '.join(said.refusals)}; --force-fit goes on all the same")
        else:
            material = law_of(law, change)
            laws = [material] * (committee or 0)
        design, (pipeline, _) = settings.design(material), settings.pipeline()
        if free:
            design = replace(design, design={**design.design, "hull": model.domain_hull()})
        with _TrainingBar("Fitting", 1):
            pipeline.fit(design.X, design.y)
        with _TrainingBar("Fitting members", max(len(laws), 1)) as bar:
            members = settings.committee(laws, bar.fold)
        with _TrainingBar("Cross-validating", folds) as bar:
            table = settings.cross_validate(pipeline, design, bar.fold)
        try:
            with writing(folder):
                # Now: another fit of that name may have ended in the meantime.
                version = next_version(folder, name) if version is None else version
                path = store(pipeline, design, material, folder, name, version, settings.text(material, table, found), members)
        except TooInexact as error:
            raise ended(1, "[red]pdsurrogate:[/]", str(error)) from None
        card = load_card(path)
    simulated = _simulate_tests(path, model, rows) if data is not None else {}
    if as_json:
        print_json({"artefact": f"{name}@{version}", "path": str(path), "errors": card.errors, "training": card.training, **simulated})
    (_print_energy_errors if energy else _print_errors)(card.errors["box"])
    for row in card.training["cross_validation"]:
        out.print(f"fold {row['fold'] + 1}: relative RMS error {row['rms']:.2e} on samples left out")
    for number, member in enumerate(card.members, 1):
        modulus = member.material.trained_with["shear_modulus"]
        out.print(f"member {number}: shear modulus {modulus:.5g}, RMS error {member.errors['box']['on_surface']['rms']:.1e}")
    note(f"Wrote {path}")


def _simulate_tests(path: Path, model, rows) -> dict:
    """Simulate the tests with the artefact's own force, print how far it is from them and from the law, and draw all three."""
    import numpy as np

    from ..artifacts import load_surrogate
    from ..forces.homogeneous import nominal_states
    from ..identification import differences, figure, free_sides
    from ..results import figures

    first, second = rows.stretches.T
    stretches = np.column_stack([first, np.where(free_sides(first, second), np.nan, second)])
    with status(f"Simulating the tests with {path}"):
        surrogate = load_surrogate(path)
        stress, beyond = nominal_states(surrogate, model.law_, stretches)
    found = differences(rows, stress)
    out.print(f"simulated with the artefact against tests, greatest difference by mode: {differences_in_words(found)}")
    law = model.predict(rows.stretches)
    off = np.abs(stress - law).max() / np.abs(law).max()
    out.print(f"simulated against the law: {'no stress' if np.isnan(off) else f'{100 * off:.2g} % of the greatest stress'} at the most")
    outside = int((beyond > EDGE).sum())
    if outside:
        least, greatest = surrogate.domain.least_stretch, surrogate.domain.greatest_stretch
        warn(
            f"{outside} of {len(rows)} rows lie outside the artefact's domain, stretches from {least:.4g} to {greatest:.4g}: the exact "
            "force stands in for the artefact there, so their simulation does not test it.  The stretches of the data go from "
            f"{rows.stretches.min():.4g} to {rows.stretches.max():.4g}: --least and --greatest set the domain as far as the law reaches; a "
            "larger one needs a higher --degree or more --units"
        )
    picture = path.with_name(f"{path.name}.png")
    if not picture.exists():
        with writing(path.parent):
            figures.save(figure([model], rows, stress), picture)
        note(f"Tests, law and simulation drawn in {picture}")
    return {
        "simulated": {
            "against_measured": found,
            "rows_outside_domain": outside,
            "nominal_stress": [float(s) if np.isfinite(s) else None for s in stress],
        }
    }


class _TrainingBar:
    """Progress of trainings on the terminal: of one, or of one for each fold; most end before their last iteration."""

    def __init__(self, title: str, folds: int) -> None:
        self._bar, self._folds = progress_bar(title), folds
        self._fold, self._count, self._rate = 0, 0, Rate("iterations")

    def __enter__(self) -> _TrainingBar:
        from ..learning.marquardt import listening

        self._told = self._bar.__enter__()
        self._listening = listening(self._iteration)
        self._listening.__enter__()
        return self

    def __exit__(self, *exception) -> None:
        self._listening.__exit__(*exception)
        self._bar.__exit__(*exception)

    def fold(self, number: int) -> None:
        """Begin a fold."""
        self._fold = number
        self._told(number / self._folds, self._which)

    @property
    def _which(self) -> str:
        return f"fold {self._fold + 1} of {self._folds}" if self._folds > 1 else ""

    def _iteration(self, iteration: int, most: int, loss: float) -> None:
        self._count += 1
        state = [self._which, f"iteration {iteration} of at most {most}", f"loss {loss:.2e}{self._rate.after(self._count)}"]
        self._told((self._fold + iteration / most) / self._folds, ", ".join(filter(None, state)))


@command()
def evaluate(
    reference: Reference,
    least: Annotated[float | None, typer.Option(help="Least principal stretch, below 1; the artefact's own domain by default.")] = None,
    greatest: Annotated[float | None, typer.Option(help="Greatest principal stretch, above 1.")] = None,
    samples: Annotated[int, typer.Option(help="States in each set.", min=100)] = 20_000,
    seed: Annotated[int, typer.Option(help="Seed of the states.", min=0)] = 2_000_003,
    law: Annotated[str | None, typer.Option(help="Law to compare with; the artefact's own by default.")] = None,
    as_json: AsJson = False,
) -> None:
    """Compare a bond force or an energy with the exact one: by strain, at rest, and its stiffness; a force on and off plane stress."""
    from ..artifacts import ArtifactError, load_surrogate
    from ..forces import FORCES, EnergySurrogate, ForceSurrogate, IsochoricNetwork
    from ..learning import evaluate as report_of

    with bad_input(ArtifactError, ValueError):
        model = load_surrogate(reference)
        if not isinstance(model, ForceSurrogate | EnergySurrogate | IsochoricNetwork):
            raise ValueError(f"{reference} has no bond force of its own to evaluate")
        material = _compared_with(reference, model, law)
        if reference in FORCES and isinstance(model, ForceSurrogate):
            model.law = material
        report = report_of(model, material, _range(model, least, greatest), samples, seed)
    if as_json:
        print_json(report)
    else:
        (_print_errors if "off_surface" in report else _print_energy_errors)(report)


def _compared_with(reference: str, model, law: str | None):
    """The law by name; else the one of the artefact's card, or Neo-Hookean rubber for a force model that serves every law."""
    from ..artifacts import load_card
    from ..forces import FORCES

    if law is not None:
        material = law_of(law)
    else:
        material = law_of("neo-hookean") if reference in FORCES else described_law(load_card(reference).material.trained_with)
    model.check_material(material)
    return material


def _range(model, least: float | None, greatest: float | None) -> tuple[float, float]:
    """Principal stretches as given, else those of the model's domain."""
    from ..learning.sampling import checked_range

    low, high = (model.domain.least_stretch, model.domain.greatest_stretch) if model.domain else (0.5, 4.0)
    return checked_range((low if least is None else least, high if greatest is None else greatest))


def _print_energy_errors(report: dict) -> None:
    low, high = report["stretch_range"]
    table = Table(title=f"Relative errors, stretches {low:g} to {high:g}, {report['n_samples']} states", title_justify="left")
    for title in ("states", "stress, RMS", "greatest", "energy, RMS"):
        table.add_column(title, justify="left" if title == "states" else "right")
    rows = [("all", report["on_surface"]), *((f"strain {row['strain'][0]:g} to {row['strain'][1]:g}", row) for row in report["by_strain"])]
    for title, row in rows:
        table.add_row(title, f"{row['rms']:.1e}", f"{row['max']:.1e}", f"{row['energy_rms']:.1e}")
    show(table)
    if "shear_modulus" in report:
        more = f"shear modulus at rest {report['shear_modulus']:.7g} (exact: 1)"
    else:
        more = f"least curvature by log-stretches {report['least_curvature']:.3g} (exact: {report['least_curvature_exact']:.3g})"
    out.print(
        f"at rest {report['at_rest']:.1e}; least acoustic stiffness {report['least_acoustic']:.3g} "
        f"(exact: {report['least_acoustic_exact']:.3g}); {more}"
    )


def _print_errors(report: dict) -> None:
    low, high = report["stretch_range"]
    table = Table(title=f"Relative force error, stretches {low:g} to {high:g}, {report['n_samples']} states", title_justify="left")
    for title in ("states", "RMS", "greatest"):
        table.add_column(title, justify="left" if title == "states" else "right")
    rows = [("on the plane-stress surface", report["on_surface"]), ("off it", report["off_surface"])]
    rows += [(f"strain {row['strain'][0]:g} to {row['strain'][1]:g}", row) for row in report["by_strain"]]
    for title, row in rows:
        table.add_row(title, f"{row['rms']:.1e}", f"{row['max']:.1e}")
    show(table)
    out.print(
        f"force at rest {report['at_rest']:.1e}; least stiffness slope {report['least_slope']:.3g} "
        f"(exact: {report['least_slope_exact']:.3g})"
    )


@command()
def artifacts(
    reference: Annotated[str | None, typer.Argument(metavar="[REF]", help="Artefact whose card is shown.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the artefacts that are found by name, or show one's card."""
    from ..artifacts import ArtifactError, called, list_artifacts, load_card

    if reference is not None:
        with bad_input(ArtifactError):
            sys.stdout.write(load_card(reference).to_json())
        return
    table = Table(title="Artefacts", title_justify="left")
    for title in ("artefact", "law", "features", "RMS error", "where"):
        table.add_column(title, overflow="ellipsis" if title == "RMS error" else "fold")
    known = []
    for folder in list_artifacts():
        try:
            card = load_card(folder)
            placed = {"name": folder.parent.name, "version": folder.name, "called": called(folder, card)}
            known.append({**placed, "kind": card.kind, "law": card.material.law, "path": str(folder)})
        except ArtifactError as error:
            table.add_row(f"{folder.parent.name}@{folder.name}", f"[red]{escape(str(error))}[/]", "", "", str(folder))
            continue
        error = f"{card.errors['box']['on_surface']['rms']:.1e}"
        table.add_row(escape(called(folder, card)), card.material.law, card.features["set"], error, str(folder))
    show(table)
    if as_json:
        print_json(known)
