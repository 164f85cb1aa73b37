"""Writing of material cards, with a heading that says what differs from the law."""

import textwrap
from collections.abc import Iterator

import numpy as np

from .. import __version__
from ..materials import LAWS, Law, homogeneous
from .constants import NO_TERM, as_read, constants_of
from .programs import PROGRAMS, Form, Program
from .reading import built, read_text

ALLOWED = 1e-4
"""Relative deviation of a constant that is read back from a card. Chosen: Poisson's ratio
in ten characters is exact enough for a bulk modulus of 1,000 shear moduli and more.
"""

STRETCH = 2.0
RATIOS = np.array([0.9, 1.1])
"""Stretch and volume ratios at which differences are stated."""

CONVOLUTION = (
    "its branches are not the convolutions of *VISCOELASTIC, TB,PRONY and their kin: of a stretch"
    " of 2 that is held, a branch has 0.18 of its stress left after its time, a convolution 0.37"
)


def card_of(law: Law, to: str, name: str) -> str:
    """Return the material card of a law for a program.

    Parameters
    ----------
    law : Law
    to : str
        A name of `PROGRAMS`.
    name : str
        Name of the material.

    Raises
    ------
    ValueError
        If the program cannot say the law; the message says why, and what can.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.cards.writing import card_of
    >>> print(card_of(pds.materials.NeoHookean(0.4, 40.0), "calculix-card", "RUBBER")[-61:-1])
    *MATERIAL, NAME=RUBBER
    *HYPERELASTIC, NEO HOOKE
    0.2, 0.05
    """
    program = PROGRAMS[to]
    form = program.forms.get(law.name)
    values = constants_of(law)
    terms = max(len(values["D"]), len(values.get("mu", ())))
    softening = law.memory.softening
    if form is None or type(law) is not LAWS[law.name]:
        refused = f"{program.program} has no such law, only {', '.join(program.forms)}"
    elif law.memory.branches:
        refused = CONVOLUTION
    elif softening and not program.softening:
        refused = f"its softening is no card of {program.program} that is known here"
    elif form.most and terms > form.most:
        refused = f"{program.program} has at most {form.most} terms, and this law {terms}"
    elif form.whole and values[form.whole][0] % 1:
        refused = f"{program.program} takes a whole number of links, not {values[form.whole][0]:g}"
    else:
        body = _body(law, program, form, name, values, terms)
        return "".join(_heading(law, program, form)) + body
    raise ValueError(f"{law.name}: {refused}; --to umat and --to felupe write any law")


def _body(law: Law, program: Program, form: Form, name: str, values: dict, terms: int) -> str:
    """Return the lines of a card, after they have been read back."""
    words = {"name": name, "key": form.keys[0], "options": form.options.format(terms=terms)}
    lines = [line.format(**words) for line in (program.start, program.head) if line]
    for row in form.fields(terms):
        texts = [
            (field.label, program.text(field, values))
            for field in row
            if field.term < len(values.get(field.name, "1"))
        ]
        if program.width and row:
            labels = "".join(f"{label:>{program.width}}" for label, _ in texts)
            mark = program.comment.format("").strip()
            lines.append(mark + labels[len(mark) :])
        for at in range(0, len(texts) or 1, program.per_row):
            part = texts[at : at + program.per_row]
            fields = program.join.join(f"{text:>{program.width}}" for _, text in part)
            label = part[0][0] if part else ""
            lines.append(program.row.format(label=label, fields=fields, first=at + 1))
    if law.memory.softening:
        parts = vars(law.memory.softening).values()
        lines += [program.softening, program.join.join(map(program.number, parts))]
    body = "\n".join([*lines, *([program.end] if program.end else [])]) + "\n"
    again = constants_of(built(read_text(body, "the card")[0]))
    for key, value in values.items():  # laws that are another one may have fewer terms
        mine, theirs = (
            np.trim_zeros([one * (one < NO_TERM) for one in each], "b")
            for each in (value, again[key])
        )
        if len(mine) != len(theirs) or not np.allclose(theirs, mine, ALLOWED, 0):
            raise ValueError(
                f"{law.name}: a field of {program.program} has too few characters for {key} ="
                f" {value[0]:g}, which would be {again[key][0]:g}"
            )
    return body


def _heading(law: Law, program: Program, form: Form) -> Iterator[str]:
    """Yield the lines of comment at the beginning of a card."""
    parameters = ", ".join(f"{key} = {value}" for key, value in law.describe().items())
    paragraphs = (
        f"Material card for {program.program} by pdsurrogate {__version__}.",
        f"{parameters}. Stresses have the unit of the shear modulus.",
        f"How the program is known: {program.known}.",
        f"W = {form.W}; the initial shear modulus is {form.modulus}.",
        *differences(law, form),
        program.note,
    )
    for text in paragraphs:
        for line in textwrap.wrap(text, 76, break_long_words=False, break_on_hyphens=False):
            yield program.comment.format(line) + "\n"


def differences(law: Law, form: Form) -> tuple[str, str]:
    """Return in words how the energy of a program differs from that of the law: in the mean stress
    at volume ratios, and in the stress at a stretch.
    """
    theirs = as_read(law, form.U)
    scale = law.shear_modulus / law.bulk_modulus
    here, there = (
        " and ".join(
            f"{scale * slope:.4f} K" for slope in one.volumetric(RATIOS, one.parameters)[1]
        )
        for one in (law, theirs)
    )
    at = " and ".join(f"{ratio:g}" for ratio in RATIOS)
    known = f"U(J) = {form.U}" if form.U else "U(J) of the program is not known here, only K"
    volume = (
        f"{known}: the mean stress at J = {at} is {there if form.U else 'unknown'}, here {here}."
    )
    try:
        mine, other = (homogeneous.uniaxial(one, STRETCH).nominal_stress for one in (law, theirs))
    except ValueError:
        return volume, f"The law ends before a stretch of {STRETCH:g}."
    return volume, (
        f"Nominal stress in tension at a stretch of {STRETCH:g}: {mine:.6g} here, {other:.6g} with"
        f" the energy of the program{' and U(J) of here' * (not form.U)} ({other / mine - 1:+.1e})."
    )
