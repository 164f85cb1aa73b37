"""Words and units of tables of testing machines: what a heading, a unit and an entry above a
table mean, in English, German, French, Spanish, Chinese and Japanese.
"""

import re
import unicodedata
from functools import cache

UNITS = {
    "time": "s",
    "force": "N",
    "extension": "mm",
    "nominal-stress": "MPa",
    "true-stress": "MPa",
    "lateral-stress": "MPa",
    "temperature": "K",
}
"""Units to which quantities with a dimension are converted; all others are numbers."""

KNOWN_UNITS = """
    N kN mN cN lbf kgf gf mm cm m um in Pa kPa MPa GPa psi ksi bar N/mm2 kgf/cm2 % mm/mm - s ms min
    h degC K
""".split()  # noqa: SIM905
"""Units that messages show, and whose capitals do not matter."""

ALIASES = {
    "-": "", "1": "", "lb": "lbf", "lbs": "lbf", "kg": "kgf", "kp": "kgf",
    "°c": "degC", "sek": "s", "secs": "s", '"': "in", "inches": "in", "pct": "%",
    "percent": "%", "prozent": "%", "με": "um/m", "microstrain": "um/m", "牛顿": "N",
    "秒": "s", "分": "min", "毫米": "mm", "牛": "N", "千牛": "kN", "兆帕": "MPa", "千帕": "kPa",
}  # fmt: skip
"""Spellings of units that pint does not know, or takes for another unit (kg of force)."""

KINDS = {
    "broke": r"^broken?\b|^gebrochen|^rompu|^rot[oa]\b|是否断裂",
    "no measurement": r"max(?!well)|minim|peak|break|bruch|rupture|rotura|yield|modul|strength|fes"
    r"tigkeit|rate\b|speed|geschw|vitesse|velocidad|energ|work\b|arbeit|grün|green|最大|断裂|破断"
    r"|速度|速率|能量|弹性模量|強度|强度|\bat\b|slope"
    r"|(2nd|second)\W*(piola|pk)|\bpk\W?2|(?<!piola.)kirchhoff",
    "mode": r"^mode\b|^modus|belastungsart|^modo|加载方式",
    "stress": r"stress|spannung|contrainte|(?<!ex)tensi[oó]n|esfuerzo|应力|応力|\b(sigma|σ)\b",
    "stretch": r"stretch|streck|ratio of (ext|elong)|(ext\w*|draw|elongation) ratio|(rapport|taux)"
    r" d.(allong|[ée]long|[ée]tir)|relaci[oó]n de|estiramiento|[ée]tirement|拉伸比|伸长比"
    r"|延伸比|伸[長張]比|\b(lambda|lam|λ)[ _]?([1-3xy]|lat)?\b",
    "volume-ratio": r"volum|体积|体積",
    "elongation": r"elongat|[ée]longation|allongement|alargamiento|elongaci|verformung|伸び|变形",
    "strain": r"strain|dehnung|d[ée]form|deformaci|应变|ひずみ|歪|伸长率|伸び率"
    r"|\b(eps|epsilon|ε)\b",
    "force": r"force|load|kraft|charge|effort|fuerza|carga|载荷|负荷|荷重|試験力|试验力|力|\bf\b",
    "extension": r"extens|displac|stroke|position|crosshead|travel|weg\b|travers|längenänd"
    r"|d[ée]plac|course|desplaz|位移|伸长|行程|変位|ストローク|\b(disp|dl|δl|u)\b",
    "time": r"time|zeit|temps|tiempo|tempo\b|时间|時間|\bt\b",
    "cycle": r"cycle|count|zykl|ciclo|循环|サイクル",
    "temperature": r"temp|温度",
    "specimen": r"specimen|sample|probe|[ée]prouvette|probeta|muestra|试样|样品|試験片",
    "weight": r"^weight$",
    "force or stress": r"\bp ?(1|2|11|22)?\b",
}  # fmt: skip
"""Words and symbols of headings as regular expressions; the first kind that is found counts."""

STATISTICS = (
    r"^(mean|average|median|std|stand\w* ?(dev|abw)|coeff|variance|cv\b|mittelwert|minim|maxim"
    r"|range|n$|moyenne|[ée]cart|media|desv|平均|标准|標準偏差|最[大小])"
)
"""Words before the statistics of specimens."""

LATERAL = r"lateral|trans|quer|横|(?<!振)幅|(lambda|lam|λ)[ _]?([2y]|lat)"
TRUE = r"true|wahr|vrai|verdader|\breal|真|log|hencky|cauchy"
NOMINAL = r"piola|nomin|engin|tech|nenn|conven|ing[ée]n|工程|名义|公称"

MEANINGS = {
    "strain": ("engineering-strain",),
    "stress": ("nominal-stress",),
    "elongation": ("extension", "engineering-strain"),
    "force or stress": ("force", "nominal-stress"),
    "no measurement": (),
    "None": (),
}
"""Quantities of a kind, where they are not the kind itself; a symbol may have several."""

MECHANICAL = {"stress", "stretch", "volume-ratio", "elongation", "strain", "force", "extension"}
"""Kinds that make a table one of a test."""

COUNTED = ("mode", "specimen", "weight", "cycle", "broke")
"""Kinds whose units say nothing."""

FACTS = {
    "gauge length": r"gau?ge ?length|messlänge|meßlänge|longueur (initiale|utile|de r)"
    r"|longitud (inicial|calibrada|de ref)|标距|標点|\bl0\b",
    "width": r"width|breite|largeur|ancho|anchura|宽度|(?<!振)幅|\bb0\b",
    "thickness": r"thick|dicke|[ée]paisseur|espesor|grosor|厚|\ba0\b",
    "diameter": r"diamet|durchmesser|diam[èe]t|di[áa]met|直径|\bd0\b",
    "area": r"\barea|querschnitt|section|secci|[áa]rea|截面|面积|断面積|\bs0\b",
    "length": r"(^|: )(specimen )?(length|länge|longueur|longitud|长度|長さ)$"
    r"|einspannlänge|grip (sep|dist)",
    "broke": r"^(broken?|break|bruch\w*|rupture|rotura|failure|fracture|断裂)\W*(location|type|mode"
    r"|lieu|posici[oó]n|位置)?$"
    r"|^(end of test|test end\w*|prüfende|versuchsende|fin d\w* (l')?essai)$",
    "specimen": rf"({KINDS['specimen']}) ?(label|name|id|n[or°]?\.?|number|nummer|编号|番号)?$"
    r"|^name$|bezeichnung|label|名称",
}  # fmt: skip
"""Words for entries above a table."""

GEOMETRY = ("gauge length", "width", "thickness", "diameter", "area")
"""Facts of the geometry of a specimen."""

LENGTHS = (*GEOMETRY, "length")
"""Facts that are numbers with units."""

MODES = {
    "trouser": r"trouser|hosen|pantal[oó]n|裤形|ズボン",
    "pure-shear-tear": r"pure.?shear.?(tear|crack)",
    "pure-shear": r"pure.?shear|planar|reine.? (scher|schub)|cisaillement pur|(cizall|cort)\w* pur"
    r"|纯剪|平面拉伸|純せん断",
    "equibiaxial": r"bi-?ax|zweiachs|双轴|二軸|equi-?bi",
    "volumetric": r"^volumetric test",
    "uniaxial": r"uni-?ax|einachs|zugversuch|zugprüfung|tensile test|tension test|(essai|ensayo) de"
    r" trac|单轴|単軸|一軸|拉伸试验|引張試験",
}  # fmt: skip
"""Words for the mode of loading."""


def plain(text: str) -> str:
    """Return text with ordinary characters for those of full width, and for small digits."""
    return unicodedata.normalize("NFKC", text).replace("\u2212", "-").strip()


def is_nominal(heading: str) -> bool:
    """Whether a heading says that it is nominal."""
    return re.search(NOMINAL, plain(heading).lower()) is not None


def found_in(table: dict[str, str], text: str) -> str | None:
    """Return the first key of a table of words whose expression is found in a text."""
    words = plain(text).lower().replace("_", " ")
    return next((key for key, words_of in table.items() if re.search(words_of, words)), None)


@cache
def _registry():
    """Registry of pint, which takes a moment to load."""
    import pint

    return pint.UnitRegistry()


def within_brackets(text: str) -> str:
    """Return text without the brackets around it."""
    return re.sub(r"^[(\[{<](.*)[)\]}>]$", r"\1", plain(text)).strip()


@cache
def unit_in(text: str) -> str | None:
    """Return a unit in the spelling of pint, "" for numbers; None for text that is no unit of
    `UNITS` or of a number.
    """
    import pint

    inner = within_brackets(text).rstrip(".")
    spelled = re.sub(r"([a-zA-Z])\^?([23])\b", r"\1**\2", ALIASES.get(inner.lower(), inner))
    if not spelled and inner:
        return ""
    if not re.fullmatch(r"[^\W\d][\w/*°·.]{0,15}|%", spelled):
        return None
    known = {unit.lower(): unit for unit in KNOWN_UNITS}
    for one in (spelled, known.get(spelled.lower(), "")):
        if len(one) == 1 and one not in KNOWN_UNITS:  # a letter is a heading rather than a year
            continue
        try:
            dimension = _registry().parse_units(one).dimensionality
        except (pint.PintError, ValueError, TypeError, AttributeError):
            continue
        # A quotient of one sign, such as P/MPa, is a heading with its unit.
        compound = one.partition("/")[2].removesuffix("**2")
        if one and (
            (dimension in _dimensions() and not compound)
            or (compound and (dimension == {} or fits(one, "nominal-stress")))
            or one == "%"
        ):
            return one
    return None


@cache
def _dimensions():
    """Dimensions of `UNITS`, and those of area."""
    return [_registry().parse_units(one).dimensionality for one in (*UNITS.values(), "m**2")]


def fits(unit: str, quantity: str) -> bool:
    """Whether a unit is one of a quantity."""
    dimension = _registry().parse_units(unit).dimensionality
    return dimension == _registry().parse_units(UNITS.get(quantity, "")).dimensionality


@cache
def factor(unit: str, to: str) -> float:
    """Return the factor that converts numbers in one unit to another of the same kind; raise
    ValueError for an unknown unit, and one of another kind.
    """
    known, one = unit_in(unit), _registry().Quantity
    if known is None or one(1.0, known).dimensionality != one(1.0, unit_in(to)).dimensionality:
        raise ValueError(f"{unit} is no unit like {to}; known are {', '.join(KNOWN_UNITS)}")
    return float((one(1.0, known) / one(1.0, unit_in(to))).to("").magnitude)


def is_of_unit(heading: str, unit: str | None, *quantities: str) -> bool:
    """Whether the unit of a column, and nothing in its heading, says that it is of one of some
    quantities.
    """
    known = unit_in(unit or "")
    return (
        bool(known)
        and found_in(KINDS, heading) is None
        and any(fits(str(known), one) for one in quantities)
    )


def amount_in(text: str, to: str, what: str) -> float:
    """Return a positive number with its unit, such as "25 mm", in a unit."""
    found = re.fullmatch(r"\s*([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)\s*([^\d\s].*?)\s*", str(text))
    if not found:
        raise ValueError(f"{what} must be a number with its unit, such as '12 {to}', not {text!r}")
    try:
        value = float(found[1]) * factor(found[2], to)
    except ValueError as error:
        raise ValueError(f"{what} {text!r}: {error}; right is a number such as '12 {to}'") from None
    if not value > 0:
        raise ValueError(f"{what} must be positive, not {text!r}")
    return value


def heading_and_unit(text: str) -> tuple[str, str | None]:
    """Return a heading without its unit, and the unit: "Stress (MPa)", "P_kPa", "Weg / mm",
    "Dehnung in %".
    """
    text = plain(text)
    for pattern in (
        r"(.*?)\s*[(\[{<]([^()\[\]]*)[)\]}>]",
        r"(.*\S)\s+in\s+(\S+)",
        r"(.*\S)\s*/\s*(\S+)",
        r"(.*[^\s,_])\s*[\s,_]_?\s*(\S*[^\W\d]\S*)",
    ):
        found = re.fullmatch(pattern, text)
        # Behind a blank or the like, only words that follow a quantity are units.
        trusted = found and ("_" not in pattern or found_in({**KINDS, **FACTS}, found[1]))
        if found and trusted and unit_in(found[2]) is not None:
            return found[1].rstrip("_"), found[2].strip()
    return text, None


def quantities_of(heading: str, unit: str | None) -> tuple[str, ...]:
    """Return the quantities that a heading and a unit may mean; none if they contradict."""
    outside = re.sub(r"\(.*?\)|\[.*?\]", "", heading) or heading
    kind = found_in(KINDS, outside) or found_in(KINDS, heading)
    words = plain(heading).lower()
    meant = MEANINGS.get(str(kind), (str(kind),))
    if kind in ("strain", "stress", "stretch") and re.search(LATERAL, words):
        meant = (f"lateral-{kind}",)
    elif kind in ("strain", "stress") and re.search(TRUE, words):
        meant = (f"true-{kind}",)
    elif kind == "force or stress" and words.endswith("2"):
        meant = ("lateral-stress",)
    elif kind == "stress" and re.search(r"\b(sigma|σ)\b", words):
        meant = ("nominal-stress", "true-stress")
    known = unit_in(unit) if unit else None
    if known is None or not meant:
        return meant
    if kind == "stretch" and known == "%":
        return ("stretch", "engineering-strain")
    if kind == "strain" and fits(known, "extension"):
        return ("extension",)
    if kind == "extension" and fits(known, "stretch"):
        return ("engineering-strain",)
    return tuple(one for one in meant if kind in COUNTED or fits(known, one))
