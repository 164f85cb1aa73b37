"""Griffe extension for the API pages: signatures of Pydantic models with plain types, and See
Also sections as lists of links.
"""

import re

import griffe

import pdsurrogate

HOMES = {
    f"pds.{name}": f"pdsurrogate.{home}.{name}" for name, home in pdsurrogate._HOMES.items()
} | {
    f"pds.{room}.{name}": f"pdsurrogate.{room}.{name}"
    for room, names in pdsurrogate._IN_ROOMS.items()
    for name in names.split()
}
"""Path of every public name, by the name that scripts write."""

TYPE = re.compile(r"^(\*{0,2}\w[\w, *]* : )([^{\n]*)$", re.MULTILINE)
"""Line of a docstring with a parameter and its type, other than a choice in braces, of which
Griffe takes the first as default.
"""

SEE_ALSO = re.compile(r"^See Also\n-+\n(.*?)(?=\n\n|\Z)", re.MULTILINE | re.DOTALL)
ENTRY = re.compile(r"^(\S.*?)(?: : ?(.*))?$", re.MULTILINE)


def path_of(name: str) -> str | None:
    """Return the path of a public name such as ``pds.Scene``, or of a member of one such as
    ``pds.Scene.law``; None if it is neither.
    """
    owner, _, member = name.rpartition(".")
    return HOMES.get(name) or (f"{HOMES[owner]}.{member}" if owner in HOMES else None)


def _linked(match: re.Match) -> str:
    """Return a See Also section whose names are links, one item for each entry."""
    items = []
    for names, text in ENTRY.findall(re.sub(r"\n +", " ", match[1])):
        written = [f"pds.{name.removeprefix('pdsurrogate.')}" for name in names.split(", ")]
        links = ", ".join(f"[`{name}`][{path_of(name) or name}]" for name in written)
        items.append(f"- {links}: {text}" if text else f"- {links}")
    return "See Also\n--------\n" + "\n".join(items)


def _plain(expression):
    """Return a type without the constraints of ``Annotated``, and with the types that aliases
    such as ``Positive`` stand for.
    """
    if isinstance(expression, griffe.ExprSubscript):
        if expression.canonical_path == "typing.Annotated":
            return _plain(expression.slice.elements[0])
        if expression.canonical_path == "typing.Literal":
            return expression
        return griffe.ExprSubscript(expression.left, _plain(expression.slice))
    if isinstance(expression, griffe.ExprTuple):
        return griffe.ExprTuple(
            [_plain(element) for element in expression.elements], implicit=expression.implicit
        )
    if isinstance(expression, griffe.ExprBinOp):
        return griffe.ExprBinOp(
            _plain(expression.left), expression.operator, _plain(expression.right)
        )
    if isinstance(expression, griffe.ExprName):
        path = expression.canonical_path
        found = (
            expression.parent.modules_collection[path] if path.startswith("pdsurrogate.") else None
        )
        if found is not None and found.is_attribute and isinstance(found.value, griffe.Expr):
            return _plain(found.value)
    return expression


def _default(field):
    """Return the default of a field, or None where a value is required; ``...`` stands for a
    default that a function makes.
    """
    call = field.value
    if call is None:
        return "..." if "default_factory" in str(field.annotation) else None
    if isinstance(call, griffe.ExprCall) and str(call.function) == "Field":
        return (
            call.arguments[0]
            if call.arguments and not isinstance(call.arguments[0], griffe.ExprKeyword)
            else "..."
        )
    return call


def _fields(cls):
    """Return the fields of a model and of the models it derives from by their names, the first
    ones first.
    """
    found = {}
    for parent in [*reversed(cls.mro()), cls]:
        for name, member in parent.members.items():
            if (
                member.is_attribute
                and member.annotation is not None
                and "instance-attribute" in member.labels
            ):
                found[name] = member
    return found


class Signatures(griffe.Extension):
    """Give Pydantic models the constructor that they have at run time, as Griffe does for
    dataclasses.
    """

    def on_instance(self, *, obj, **_):
        """Turn the names of a See Also section into links, and keep types in words as they are
        written.

        Griffe would read "ndarray, shape (n,)" as Python, a tuple with a call, if its spaces did
        not prevent it.
        """
        if obj.docstring:
            text = SEE_ALSO.sub(_linked, obj.docstring.value)
            text = TYPE.sub(
                lambda match: match[1] + re.sub(", (?!optional)", ",\N{NO-BREAK SPACE}", match[2]),
                text,
            )
            obj.docstring.value = text.replace("shape (", "shape\N{NO-BREAK SPACE}(")

    def on_package(self, *, pkg, **_):
        """Add constructors once all classes are known."""
        for module in [pkg, *self._modules_of(pkg)]:
            for cls in module.classes.values():
                if not cls.is_alias and "__init__" not in cls.members and self._is_model(cls):
                    self._add_constructor(cls)

    def _modules_of(self, module):
        for member in module.modules.values():
            if not member.is_alias:
                yield member
                yield from self._modules_of(member)

    def _is_model(self, cls):
        return any(
            str(getattr(base, "canonical_path", base)) == "pydantic.BaseModel"
            for one in [cls, *cls.mro()]
            for base in one.bases
        )

    def _add_constructor(self, cls):
        keyword = griffe.ParameterKind.keyword_only
        fields = _fields(cls)
        parameters = [
            griffe.Parameter(
                name, annotation=_plain(field.annotation), kind=keyword, default=_default(field)
            )
            for name, field in fields.items()
        ]
        if "model_config" in cls.members and re.search(
            "extra *= *['\"]allow", str(cls.members["model_config"].value)
        ):
            parameters.append(
                griffe.Parameter(
                    "extra_data", annotation="Any", kind=griffe.ParameterKind.var_keyword
                )
            )
        this = griffe.Parameter("self", kind=griffe.ParameterKind.positional_or_keyword)
        cls.set_member(
            "__init__",
            griffe.Function(
                "__init__", parameters=griffe.Parameters(this, *parameters), returns="None"
            ),
        )
