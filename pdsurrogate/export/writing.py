"""Writing of an energy as a source file for another program: a template with the expressions and
constants of the energy.
"""

import re
import textwrap
from dataclasses import dataclass, replace
from importlib import resources
from string import Template

import numpy as np

from .. import __version__
from ..kernels.network import ACTIVATIONS
from ..materials import InvariantLaw, PrincipalStretchLaw
from .source import Source
from .tracing import Language, symbol

ALLOWED = 1e-10
"""Deviation from the package's energy and stress, relative to the greatest stress of the check,
that the check of a file allows.
"""

REST_STRAIN = 1e-3
"""Log-strain of the differences of `_near_rest`. Chosen: their error is a millionth, and rounding
less.
"""


@dataclass(frozen=True)
class Target:
    """Program for which a file is written.

    Attributes
    ----------
    template, suffix : str
        File among the templates of this subpackage, and end of the name of exported files.
    language : Language
    comment : str
        Beginning of the lines of a comment.
    use : str
        How to use the file, in sentences, with ``{name}`` for the name of the file without its end.
    """

    template: str
    suffix: str
    language: Language
    comment: str
    use: str


def _in_fortran(statement: str) -> str:
    """Return the lines of a statement in fixed form: from column 7 to 72."""
    return "      " + "\n     & ".join(
        textwrap.wrap(statement, 64, break_long_words=False, break_on_hyphens=False)
    )


PYTHON = Language(
    functions={"power": "({0}) ** ({1})", "nan": "nan"},
    line=lambda statement: f"    {statement}",
    row=lambda at, literals: f"    [{', '.join(literals)}],",
)
UFL = replace(PYTHON, functions={**PYTHON.functions, "sum": "total({0})"})
C = Language(
    functions={"power": "pow({0}, {1})", "where": "({0} ? {1} : {2})", "nan": "NAN"},
    line=lambda statement: f"    {statement};",
    row=lambda at, literals: f"    {{{', '.join(literals)}}},",
    assignment="const double {0} = {1}",
    element=lambda array, number: f"{array}[{number}]",
)
FORTRAN = Language(
    functions={
        "power": "({0})**({1})",
        "where": "merge({1}, {2}, {0})",
        "nan": "ieee_value(1.D0, ieee_quiet_nan)",
    },
    line=_in_fortran,
    row=lambda at, literals: _in_fortran(
        f"DATA (T(J,{at}),J=1,{len(literals)}) / {', '.join(literals)} /"
    ),
    number=lambda text: text.replace("e", "D") if "e" in text else f"{text}D0",
    element=lambda array, number: f"{array}({number + 1})",
    declaration="REAL*8 {0}",
)

TARGETS = {
    "felupe": Target(
        "felupe.txt",
        "_felupe.py",
        PYTHON,
        "",
        "from {name}_felupe import Material, then felupe.SolidBody(umat=Material(), field=field);"
        " Material takes other moduli. The file needs NumPy alone; `python {name}_felupe.py`"
        " compares it with pdsurrogate.",
    ),
    "umat": Target(
        "umat.f",
        "_umat.f",
        FORTRAN,
        "C     ",
        "abaqus job=JOB user={name}_umat.f, with *User Material, constants={constants}: {props}."
        " The stress is Cauchy's and the tangent that of its Jaumann rate, in the order 11, 22, 33,"
        " 12, 13, 23, for {elements}. CalculiX needs the file of --to calculix-umat.",
    ),
    "calculix-umat": Target(
        "umat.f",
        "_umat_user.f",
        FORTRAN,
        "C     ",
        "compile CalculiX with this file in place of its umat_user.f; *MATERIAL, NAME=USER_RUBBER"
        " with *USER MATERIAL, CONSTANTS={constants}: shear modulus, bulk modulus. In CalculiX a"
        " file for Abaqus (ABAQUSNL_...) gives wrong stresses wherever the material turns.",
    ),
    "ufl": Target(
        "ufl.txt",
        "_ufl.py",
        UFL,
        "",
        "from {name}_ufl import stress, tangent; with a test function v and a trial function du,"
        " the residual is inner(stress(F), grad(v)) * dx and its derivative"
        " inner(tangent(F, grad(du)), grad(v)) * dx. psi(F) is the energy per undeformed volume;"
        " UFL can differentiate stress and psi, too, but compiles the results for longer."
        " All take other moduli, which may be constants of UFL. UFL cannot estimate the"
        " degree of quadrature: give it, dx = ufl.dx(metadata=dict(quadrature_degree=4)),"
        " 4 for quadratic elements.",
    ),
    "c": Target(
        "energy.h",
        ".h",
        C,
        " * ",
        "{name}_energy, {name}_stress and {name}_tangent take F by rows and the moduli; P and A ="
        " dP/dF are stored by rows. They allocate no memory. `cc -x c -D{name}_check {name}.h -lm`"
        " makes a program that compares the file with pdsurrogate.",
    ),
}
"""Programs for which an energy can be exported, by their names on the command line."""


def file_name(source: Source, target: str) -> str:
    """Return the name of the file to which an energy is exported."""
    return identifier_of(source) + TARGETS[target].suffix


def identifier_of(source: Source) -> str:
    """Return the title of an energy as a name that all languages accept."""
    name = re.sub(r"[^a-z0-9]+", "_", source.title.partition(" ")[0].lower()).strip("_")
    return name if name[:1].isalpha() else f"energy_{name}"


def exported(source: Source, target: str) -> str:
    """Return the text of the file that computes an energy in a target of `TARGETS`.

    Raise ValueError if an expression of the law cannot be written in other languages.
    """
    found = TARGETS[target]
    if source.law.memory and target in ("ufl", "c"):
        raise ValueError(
            f"{source.law.name}: an energy alone has no memory, and this material has"
            f" {' and '.join(source.law.memory.describe())}; export to felupe, umat or"
            " calculix-umat, which keep state variables"
        )
    if source.law.memory.thinning:
        raise ValueError(
            f"{source.law.name}: relaxation times that depend on the overstress are not exported,"
            " only constant ones"
        )
    if source.law.memory and source.is_sheet:
        raise ValueError(
            f"{source.title}: the learned energy of a sheet has no thickness, which its branches"
            f" and softening need; export the law {source.law.name}, which has one"
        )
    if source.is_sheet and target == "calculix-umat":
        raise ValueError(
            f"{source.title}: CalculiX computes sheets as solids, and the learned energy of a"
            f" sheet has no thickness; export the law {source.law.name}, which has one"
        )
    try:
        tags, parts = _parts(source, found.language)
        tags.add(target)
    except ValueError as error:
        raise ValueError(f"{source.law.name}: {error}") from None
    text = (resources.files(__package__) / "templates" / found.template).read_text("utf-8")
    sections = re.split(r"^%% (.*)\n", text, flags=re.MULTILINE)[1:]
    kept = (
        part
        for words, part in zip(sections[::2], sections[1::2], strict=True)
        if tags.issuperset(words.split())
    )
    values = {"header": _header(source, found), **_values(source, found.language), **parts}
    return re.sub(r"\n{4,}", "\n\n\n", Template("".join(kept)).substitute(values)).rstrip() + "\n"


def _values(source: Source, language: Language) -> dict:
    """Return what every template contains: names, sizes, moduli, and the states of the check."""
    states = source.states()
    d = 2 if source.is_sheet else 3
    moduli = ("shear_modulus", "bulk_modulus")[: len(source.moduli)]
    return {
        "name": identifier_of(source),
        "shear_modulus": language.literal(source.law.shear_modulus),
        "bulk_modulus": language.literal(source.law.bulk_modulus),
        "moduli": ", ".join(f"double {key}" for key in moduli),
        "pass": ", ".join(moduli),
        "parameters": ", ".join(f"{key}={key.upper()}" for key in moduli),
        "defaults": ", ".join(map(language.literal, source.moduli)),
        **{"d": d, "dd": d**2, "ddd": d**4, "voigt": 3 * d - 3},
        "states": language.table(states),
        "n_states": len(states),
        "n_numbers": states.shape[1],
        "allowed": language.literal(ALLOWED * abs(states[:, d**2 :]).max()),
    }


def _parts(source: Source, language: Language) -> tuple[set[str], dict]:
    """Return the tags of the sections of a template that an energy needs, and its expressions and
    constants by their names there.
    """
    law = source.law
    network = source.network
    softening = law.memory.softening
    tags = {"begin", "check", "end", "memory" if law.memory else "elastic"}
    found = _memory(source, language)

    tags |= {"branches"} if law.memory.branches else set()
    tags |= {"softening"} if softening else set()
    tags |= {"alone"} if bool(law.memory.branches) != bool(softening) else set()
    if source.is_sheet:
        tags |= {"sheet"}
    else:
        tags |= {"space"}
        found["volumetric"] = language.body(
            law.volumetric, "J3", "U U1 U2", [symbol("K"), *law.parameters[1:]]
        )
    if network is not None:
        tags |= {"network"} if source.is_sheet else {"network", "isochoric", "invariants"}
        units = np.vstack([network.hidden_weights, network.hidden_biases, network.output_weights]).T
        found |= {"units": language.table(units), "n_units": len(units)}
        found["activation"] = language.body(ACTIVATIONS[network.activation], "x", "a a1 a2")
        found |= dict(zip(("at_rest", "flat"), map(language.literal, network.at_rest), strict=True))
        found["least"], found["greatest"] = map(
            language.literal, (network.domain.least_stretch, network.domain.greatest_stretch)
        )
    elif isinstance(law, InvariantLaw):
        tags |= {"law", "invariants"}
        found["isochoric"] = language.body(
            law.isochoric, "I1 I2", "W W1 W2 W11 W12 W22", list(law.parameters)
        )
    else:
        tags |= {"stretches"}
        terms = np.array([law.coefficients(law.parameters, k) for k in range(len(law.terms))])
        found |= {
            "terms": language.table(terms),
            "n_terms": len(terms),
            "n_constants": terms.shape[1],
        }
        constants = tuple(
            symbol((language.element or C.element)("c", at)) for at in range(terms.shape[1])
        )
        found["term"] = language.body(law.term, "x1 x2 x3 s1 s2 s3", "W g1 g2 g3 h", constants)
        found |= zip(("third", "fourth"), map(language.literal, _near_rest(law)), strict=True)
    return tags, found


def _memory(source: Source, language: Language) -> dict:
    """Return the constants of branches and softening in units of the shear modulus, and the
    arguments by which a template passes their state on, empty without memory.
    """
    mu = source.law.shear_modulus
    memory = source.law.memory
    softening = memory.softening
    constants = softening and {**vars(softening), "m": softening.m / mu}
    rows = np.array([[each.modulus / mu, each.time] for each in memory.branches])
    first = 1 + (source.network is not None)
    size = source.n_state
    fortran = language is FORTRAN
    peak = (" PEAK," if fortran else "peak, ") if softening else ""
    return {
        "peak": peak,
        "new_peak": f" NEW({size})," if peak else "",
        "past": " OLD, NEW, DT," if memory else "",
        "statev": " OLD, NEW, DTIME," if memory else "",
        "n_state": size,
        "first": first,
        "depvar": first + size - 1,
        "branches": language.table(rows),
        "n_branches": len(rows),
        "time_step": language.literal(source.time_step),
        **{key: language.literal(value) for key, value in (constants or {}).items()},
    }


def _header(source: Source, target: Target) -> str:
    """Return the comment at the beginning of a file: name, origin, units, domain and use."""
    sheet = " of a sheet under plane stress" if source.is_sheet else ""
    moduli = f"unit of the shear modulus, here {source.law.shear_modulus:g}"
    props = ["PROPS(1) is the shear modulus", "PROPS(2) the bulk modulus"][: len(source.moduli)]
    elements = [
        "solids, plane strain, axisymmetry and plane stress (continuum elements)",
        "plane stress, of a sheet that keeps its volume",
    ]
    use = target.use.format(
        name=identifier_of(source),
        constants=len(props),
        props=", ".join(props),
        elements=elements[source.is_sheet],
    )
    if source.network is not None:
        use += (
            " STATEV(1), if there is one, is 1 outside the domain."
            if target.language is FORTRAN
            else ""
        )
    if size := source.n_state:
        use += _use_of_memory(size, source, target)
    kind = "Energy with memory" if source.law.memory else "Hyperelastic energy"
    facts = (
        f"{kind}{sheet}: {source.title}.",
        f"Written by pdsurrogate {__version__}.",
        *source.facts,
    )
    paragraphs = [*facts, f"Units: energies and stresses have the {moduli}.", f"Use: {use}"]
    lines = [
        line
        for text in paragraphs
        for line in (*textwrap.wrap(text, 66, break_long_words=False, break_on_hyphens=False), "")
    ][:-1]
    if not target.comment:
        return "\n".join(lines) + "\n"
    lines = [f"{target.comment}{line}".rstrip() for line in lines]
    return "\n".join(["/*", *lines, " */"] if target.language is C else lines)


def _use_of_memory(size: int, source: Source, target: Target) -> str:
    """Return how to give the time of a step and the state variables, in sentences."""
    if target.language is FORTRAN:
        first = 1 + (source.network is not None)
        how = (
            f" *Depvar must be at least {first + size - 1}: STATEV({first}:{first + size - 1}) are"
            " {what}. The time of a step is DTIME, that of the increment."
        )
    else:
        how = (
            " FElupe gives no time to a material: a substep lasts Material.time_step, to be set"
            " before it is solved, or by time = felupe.thermal.TimeStep([solid, material]) as"
            " first of the items of a felupe.Step with ramp={{time: times}}. State variables are"
            " {what}."
        )
    what = []
    if source.law.memory.branches:
        what.append("the six components of C_k - I of every branch and of the isochoric C - I")
    if source.law.memory.softening:
        what.append("the greatest isochoric energy")
    scaled = (
        " All are 0 at rest. Moduli of branches and m of softening scale with the shear modulus."
    )
    return how.format(what=" and ".join(what)) + scaled


def _near_rest(law: PrincipalStretchLaw) -> tuple[float, float]:
    """Return k and l of W = a/2 + k b + l a^2, a = I1bar - 3 and b = I1bar - I2bar, the energy near
    rest up to the fourth order in the strain, which a law of stretches does not state.

    Along (-1, -1, 2)/3 the third derivatives of a and b by the log-stretch are 16/9 and 32/9, and
    the fourth ones of a, b and a^2 are 32/9, 0 and 128/3.
    """
    behind, here, ahead = (
        law.sums((*x, *np.exp(2 * x)), law.parameters)[-1]
        for x in REST_STRAIN * np.outer([-1, 0, 1], [-1, -1, 2]) / 3
    )
    third = (ahead - behind) / (2 * REST_STRAIN)
    fourth = (ahead - 2 * here + behind) / REST_STRAIN**2
    return float(third - 8 / 9) * 9 / 32, float(fourth - 16 / 9) * 3 / 128
