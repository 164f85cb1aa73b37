"""Command ``export``, which writes the energy of a law or an artifact as source code for another
program.
"""

from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

from ..export import exported, file_name, source_of_artifact, source_of_law
from ..materials import LAWS
from ..results.files import write_text
from .command import SetLaw, check_folder, law_of
from .terminal import note, print_json, writing


def export(
    name: Annotated[
        str, Argument(metavar="NAME", help="Law, or artifact: NAME, NAME@VERSION or a path.")
    ],
    *,
    to: Annotated[
        Literal["felupe", "umat", "calculix-umat", "ufl", "c"],
        Option("--to", help="Program or language."),
    ],
    change: SetLaw = None,
    folder: Annotated[Path, Option("--out", metavar="DIR", help="Folder for the file.")] = Path(
        "."
    ),
    overwrite: Annotated[
        bool, Option("--overwrite", help="Overwrite an existing file, even if it differs.")
    ] = False,
) -> None:
    """Write the file of an energy, and print its name."""
    if change and name not in LAWS:
        raise ValueError(
            f"--set changes parameters of a law, and {name} is not one: choose one of"
            f" {', '.join(LAWS)}"
        )
    source = source_of_law(law_of(name, change)) if name in LAWS else source_of_artifact(name)
    text = exported(source, to)
    path = folder / file_name(source, to)
    check_folder(folder)
    if path.exists() and not overwrite and path.read_bytes() != text.encode():
        raise ValueError(
            f"{path}: the file already exists and differs; add --overwrite, or choose another"
            " folder with --out"
        )
    with writing(folder):
        write_text(path, text)
    print_json({"name": source.title, "to": to, "path": str(path)})
    note(f"Wrote {path}")
