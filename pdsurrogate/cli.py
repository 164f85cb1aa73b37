"""The command line: words and exit statuses, no physics.

Exit status 0: done; 1: the run failed, what was reached is saved; 2: bad input, one line on standard error.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

app = typer.Typer(
    name="pdsurrogate",
    help="Learnt bond forces of rubber-like materials, and a peridynamic solver that runs on them.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
out = Console()
err = Console(stderr=True)

Reference = Annotated[str, typer.Argument(metavar="REF", help="analytic, nosb, or an artefact: NAME, NAME@VERSION or a path.")]


def main() -> None:
    """Entry point."""
    app()


@contextmanager
def bad_input(*kinds: type[Exception]) -> Iterator[None]:
    """Turn errors about what the user gave into one line and exit status 2."""
    try:
        yield
    except kinds as error:
        err.print(f"[red]pdsurrogate:[/] {escape(' '.join(str(error).split()))}", soft_wrap=True)
        raise typer.Exit(2) from None


@app.command()
def run(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="A built-in scene, or the path of a scene file (.toml).")],
    force: Annotated[
        str, typer.Option(metavar="REF", help="Force model: analytic, nosb, or an artefact (NAME, NAME@VERSION, path).")
    ] = "neo-hookean",
    change: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a parameter of the scene; may be repeated.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Write summary, history, VTU/PVD files and a figure here.")
    ] = None,
    threads: Annotated[int | None, typer.Option(help="Threads of the kernels (all by default); the result does not depend on it.")] = None,
) -> None:
    """Run a scene and compare it with its reference."""
    from .artifacts import ArtifactError, load_surrogate
    from .results.files import check_writable
    from .scenes import SceneError, load_scene
    from .simulation import SimulationFailed, simulate

    with bad_input(SceneError, ArtifactError):
        described = load_scene(scene, change or [])
        model = load_surrogate(force)
    if folder is not None:
        with bad_input(OSError):
            check_writable(folder)
    failure = None
    try:
        with bad_input(SceneError, ValueError), _Bar(described) as bar:
            result = simulate(described, model, threads=threads, progress=bar)
    except SimulationFailed as error:
        failure, result = error, error.result
    _print_levels(result)
    if folder is not None:
        try:
            result.save(folder)
        except OSError as error:
            err.print(f"[red]pdsurrogate:[/] could not write {folder}: {error.strerror}", soft_wrap=True)
            raise typer.Exit(1) from None
        out.print(f"Results in {folder}", soft_wrap=True)
    outside = result.summary["fraction_outside_domain"]
    if outside:
        what = "the exact bond force stood in for the surrogate" if described.outside == "fallback" else "the surrogate was extrapolated"
        err.print(
            f"[yellow]{100 * outside:.2g} % of the bond evaluations were outside the surrogate's domain; {what} there.[/]", soft_wrap=True
        )
    if failure is not None:
        err.print(f"[red]pdsurrogate: the run failed:[/] {escape(str(failure))}", soft_wrap=True)
        raise typer.Exit(1)


class _Bar:
    """Progress of a simulation on the terminal; the residual falls over many decades, so the bar counts decades."""

    def __init__(self, scene) -> None:
        self._scene = scene
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[state]}"), TimeElapsedColumn())
        self._progress = Progress(*columns, console=err, transient=True)
        self._task = None
        self._first = None

    def __enter__(self) -> _Bar:
        self._progress.start()
        return self

    def __exit__(self, *exception) -> None:
        self._progress.stop()

    def compiling(self) -> None:
        """Say that kernels are compiled."""
        err.print("Compiling kernels, once on this machine; later runs load them from the cache.")

    def level(self, number: int, stretch: float) -> None:
        """Begin a level."""
        if self._task is not None:
            self._progress.remove_task(self._task)
        title = f"{self._scene.name}: stretch {stretch:g} ({number + 1}/{len(self._scene.stretches)})"
        self._task, self._first = self._progress.add_task(title, total=1.0, state=""), None

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Show how far the residual has come down to its tolerance."""
        if self._first is None or residual > self._first:
            self._first = residual
        span = math.log10(max(self._first, 1e-300) / tolerance)
        done = math.log10(max(self._first, 1e-300) / max(residual, 1e-300)) / span if span > 0 else 1.0
        self._progress.update(self._task, completed=min(max(done, 0.0), 1.0), state=f"residual {residual:.1e}, {evaluations} evaluations")


def _print_levels(result) -> None:
    summary, units = result.summary, result.summary["units"]
    compared = any("nominal_stress_reference" in level for level in summary["levels"])
    table = Table(title=f"{summary['scene']}, force {summary['force']}, {summary['n_points']} points", title_justify="left")
    table.add_column("stretch", justify="right")
    for quantity, unit in (("lateral", units["length"]), ("stress", units["stress"])):
        table.add_column(f"{quantity} ({unit})", justify="right")
        if compared:
            table.add_column("exact", justify="right")
            table.add_column("error (%)", justify="right")
    for level in summary["levels"]:
        cells = [f"{level['stretch']:g}"]
        for key in ("lateral_displacement", "nominal_stress"):
            cells.append(f"{level[key]:.5f}")
            if compared:
                error = level.get(f"{key}_error")
                cells += [f"{level[f'{key}_reference']:.5f}", "" if error is None else f"{100 * error:+.4f}"]
        table.add_row(*cells)
    out.print(table)
    out.print(
        f"{summary['n_force_evaluations']} force evaluations, {summary['ns_per_bond']:.2f} ns per directed bond on {summary['threads']} "
        f"thread{'s' if summary['threads'] != 1 else ''}, {summary['seconds_total']:.1f} s in all, "
        f"of which {summary['seconds_compile']:.1f} s compiling",
        soft_wrap=True,
    )


@app.command()
def fit(
    name: Annotated[str, typer.Argument(help="Name of the new artefact.")],
    version: Annotated[str, typer.Option(help="Its version; versions never change once written.")] = "1",
    law: Annotated[str, typer.Option(help="Material law.")] = "neo-hookean",
    change: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A parameter of the law; may be repeated.")] = None,
    features: Annotated[str, typer.Option(help="symmetric, or the paper's five (paper).")] = "symmetric",
    units: Annotated[str, typer.Option(help="Hidden units; two layers with a comma between.")] = "20",
    activation: Annotated[str, typer.Option(help="algebraic, logistic, tanh, relu or softplus.")] = "algebraic",
    samples: Annotated[int, typer.Option(help="Training samples.", min=200)] = 8000,
    least: Annotated[float, typer.Option(help="Least principal stretch trained on.")] = 0.5,
    greatest: Annotated[float, typer.Option(help="Greatest principal stretch trained on.")] = 4.0,
    iterations: Annotated[int, typer.Option(help="Most iterations of the training.", min=1)] = 1000,
    folds: Annotated[int, typer.Option(help="Folds of the cross-validation; 0 for none.", min=0)] = 0,
    seed: Annotated[int, typer.Option(help="Seed of samples, split and first weights.", min=0)] = 0,
    folder: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of artefacts.")] = Path("artifacts"),
) -> None:
    """Fit a surrogate of a law's bond force and store it as an artefact."""
    from .artifacts import ArtifactError, load_card
    from .learning import LevenbergMarquardtRegressor, bond_force_pipeline, cross_validate, store, wide_design
    from .scenes import SceneError

    if folds == 1:
        err.print("[red]pdsurrogate:[/] --folds must be 0 or at least 2")
        raise typer.Exit(2)
    if (folder / name / version).exists():
        err.print(
            f"[red]pdsurrogate:[/] {name}@{version} exists already in {folder}; versions never change, choose another", soft_wrap=True
        )
        raise typer.Exit(2)
    with bad_input(SceneError, ArtifactError, ValueError, OSError):
        material = _law(law, change)
        hidden = tuple(int(width) for width in units.split(","))
        design = wide_design(material, samples, (least, greatest), random_state=seed)
        network = LevenbergMarquardtRegressor(hidden, activation, max_iter=iterations, n_iter_no_change=100, random_state=seed)
        model = bond_force_pipeline(features, network)
        with err.status("Fitting"):
            model.fit(design.X, design.y)
        table = []
        if folds:
            with err.status(f"Cross-validating, {folds} folds"):
                table = cross_validate(model, design, folds, seed)
        path = store(model, design, material, folder, name, version, f"Bond force of {law}, {features} features, {units} units", table)
        card = load_card(path)
    _print_errors(card.errors["box"])
    for row in card.training["cross_validation"]:
        out.print(f"fold {row['fold']}: relative RMS error {row['rms']:.2e} on samples left out")
    out.print(f"Wrote {path}", soft_wrap=True)


@app.command()
def evaluate(
    reference: Reference,
    least: Annotated[float | None, typer.Option(help="Least principal stretch; the artefact's own domain by default.")] = None,
    greatest: Annotated[float | None, typer.Option(help="Greatest principal stretch.")] = None,
    samples: Annotated[int, typer.Option(help="States in each set.", min=100)] = 20_000,
    seed: Annotated[int, typer.Option(help="Seed of the states.", min=0)] = 2_000_003,
    law: Annotated[str | None, typer.Option(help="Law to compare with; the artefact's own by default.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Compare a bond force with the exact one: on and off the plane-stress surface, by strain, at rest, and its stiffness."""
    from .artifacts import ArtifactError, load_card, load_surrogate
    from .forces import FORCES, ForceSurrogate
    from .learning import evaluate as report_of
    from .scenes import MaterialSpec

    with bad_input(ArtifactError, ValueError):
        model = load_surrogate(reference)
        if not isinstance(model, ForceSurrogate):
            raise ValueError(f"{reference} has no bond force of its own to evaluate")
        if reference in FORCES:
            material = MaterialSpec(law=law or "neo-hookean").build()
            model.law = material
        else:
            material = MaterialSpec.model_validate(law or load_card(reference).material.trained_with).build()
            model.check_material(material)
        domain = model.domain
        stretches = (
            least if least is not None else domain.least_stretch if domain else 0.5,
            greatest if greatest is not None else domain.greatest_stretch if domain else 4.0,
        )
        report = report_of(model.bond_force, material, stretches, samples, seed)
    if as_json:
        sys.stdout.write(json.dumps(report, indent=2) + "\n")
    else:
        _print_errors(report)


def _print_errors(report: dict) -> None:
    low, high = report["stretch_range"]
    table = Table(title=f"Relative force error, stretches {low:g} to {high:g}, {report['n_samples']} states", title_justify="left")
    for title in ("states", "RMS", "greatest"):
        table.add_column(title, justify="left" if title == "states" else "right")
    rows = [("on the plane-stress surface", report["on_surface"]), ("off it", report["off_surface"])]
    rows += [(f"strain {row['strain'][0]:g} to {row['strain'][1]:g}", row) for row in report["by_strain"]]
    for title, row in rows:
        table.add_row(title, f"{row['rms']:.1e}", f"{row['max']:.1e}")
    out.print(table)
    out.print(
        f"force at rest {report['at_rest']:.1e}; least stiffness slope {report['least_slope']:.3g} "
        f"(exact: {report['least_slope_exact']:.3g})"
    )


@app.command()
def artifacts(
    reference: Annotated[str | None, typer.Argument(metavar="[REF]", help="Show this one's card.")] = None,
) -> None:
    """List the artefacts that are found by name, or show one's card."""
    from .artifacts import ArtifactError, list_artifacts, load_card

    if reference is not None:
        with bad_input(ArtifactError):
            sys.stdout.write(load_card(reference).to_json())
        return
    table = Table(title="Artefacts", title_justify="left")
    for title in ("artefact", "law", "features", "RMS error", "where"):
        table.add_column(title)
    for folder in list_artifacts():
        try:
            card = load_card(folder)
        except ArtifactError as error:
            table.add_row(f"{folder.parent.name}@{folder.name}", f"[red]{escape(str(error))}[/]", "", "", str(folder))
            continue
        error = card.errors.get("box", {}).get("on_surface", {}).get("rms")
        table.add_row(
            f"{card.name}@{card.version}",
            card.material.law,
            str(card.features.get("set", "")),
            "" if error is None else f"{error:.1e}",
            str(folder),
        )
    out.print(table)


@app.command()
def scenes() -> None:
    """List the built-in scenes."""
    from .scenes import load_scene, scene_names

    table = Table(title="Scenes", title_justify="left")
    table.add_column("scene")
    table.add_column("what it is")
    for name in scene_names():
        table.add_row(name, load_scene(name).title)
    out.print(table)


@app.command()
def compare(
    material: Annotated[str, typer.Option(help="Material law.")] = "neo-hookean",
    change: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A parameter of the law; may be repeated.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A look in under a minute, not for quoting.")] = False,
    folder: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Write CSV, JSON and the Pareto figure here.")] = None,
) -> None:
    """Measure every force model: speed against error, on one thread and on all."""
    from .reports import compare as report_module
    from .reports import presentation
    from .results import figures
    from .results.files import check_writable, write_json, write_text

    with bad_input(ValueError):
        law = _law(material, change)
    if folder is not None:
        with bad_input(OSError):
            check_writable(folder)
    with err.status("Starting") as status:
        report = report_module.compare(law, quick, lambda text: status.update(text.capitalize()))
    header, rows = presentation.table(report)
    machine = report["machine"]
    table = Table(title=f"{law.name}, {machine['processor']}, {machine['threads']} threads", title_justify="left")
    for number, title in enumerate(header):
        table.add_column(title, justify="right" if number else "left")
    for row in rows:
        table.add_row(*row)
    Console(width=max(out.width, 190)).print(table)
    if folder is not None:
        write_text(folder / "compare.csv", presentation.as_csv(report))
        figures.save(presentation.pareto_figure(report), folder / "compare.png")
        write_json(folder / "compare.json", report)
        out.print(f"Results in {folder}", soft_wrap=True)


def _law(name: str, changes: list[str] | None):
    """A law by name with parameters given as KEY=VALUE."""
    from pydantic import ValidationError

    from .scenes import MaterialSpec
    from .scenes.reading import explain, parse_change

    try:
        return MaterialSpec.model_validate({"law": name, **dict(parse_change(item) for item in changes or [])}).build()
    except ValidationError as error:
        raise ValueError(explain(error)) from None
