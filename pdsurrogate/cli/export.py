"""Commands ``export``, which writes the energy of a law or an artifact for another program, and
``convert``, which says what law the material card of another program states.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

from ..artifacts.material import inline
from ..cards.programs import PROGRAMS
from ..cards.reading import built, read_card
from ..cards.writing import card_of, differences
from ..export import TARGETS, exported, file_name, identifier_of, source_of_artifact, source_of_law
from ..materials import LAWS
from ..results.files import write_text
from ..scenes import MaterialSpec
from ..scenes.reading import parse_change
from .command import SetLaw, check_folder, law_of
from .terminal import note, out, print_json, writing


def export(
    name: Annotated[
        str,
        Argument(
            metavar="NAME",
            help="Law, artifact (NAME, NAME@VERSION or a path), or file with a material card (of"
            " several, --set name=MATERIAL).",
        ),
    ],
    *,
    to: Annotated[
        Literal[*TARGETS, *PROGRAMS],
        Option(help="Program or language."),
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
    is_card = name not in LAWS and Path(name).is_file()
    if change and name not in LAWS and not is_card:
        raise ValueError(
            f"--set changes parameters of a law, and {name} is not one: choose one of"
            f" {', '.join(LAWS)}"
        )
    if name in LAWS:
        source = source_of_law(law_of(name, change))
    elif is_card:
        changes = dict(parse_change(item) for item in change or [])
        spec = MaterialSpec.model_validate({**changes, "card": name})
        source = replace(source_of_law(spec.build()), title=Path(name).stem)
    else:
        source = source_of_artifact(name)
    if to not in PROGRAMS:
        text = exported(source, to)
        path = folder / file_name(source, to)
    elif source.network is not None:
        raise ValueError(
            f"{name}: a learned energy has no constants for a card; export its law,"
            f" {source.law.name}, or the energy --to umat"
        )
    else:
        stem = identifier_of(source)
        text = card_of(source.law, to, stem.upper())
        path = folder / f"{stem}{PROGRAMS[to].suffix}"
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


def convert(
    card: Annotated[
        Path, Argument(metavar="CARD", help="File with a material card, such as rubber.inp.")
    ],
    *,
    name: Annotated[str, Option(metavar="MATERIAL", help="Material of a file with several.")] = "",
) -> None:
    """Print the law of a material card as a scene takes it, and what differs."""
    keys, form, remarks = read_card(card, name)
    print_json(keys)
    pairs = ", ".join(f"{key} = {inline(value)}" for key, value in keys.items())
    out.print(f"material = {{ {pairs} }}", markup=False, highlight=False, soft_wrap=True)
    if "bulk_modulus" not in keys:
        remarks += ("The card states no bulk modulus: add bulk_modulus to the material.",)
        keys |= {"bulk_modulus": 100 * keys.get("shear_modulus", 1.0)}
    for text in (*remarks, *differences(built(keys), form)):
        note(text)
