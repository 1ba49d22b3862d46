"""Which ready rule a rule is, and with which values: so that what is a text is a sentence again.

Each template is filled with values that stand for any value and read as a rule; a rule is of that template if
it is the same value but for those. So spaces, quotes and comments do not count, and nothing is read twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from itertools import product

from semap.errors import InvalidInput
from semap.rules.declaration import Declaration, TemporalFormula
from semap.rules.language.duration import write_duration
from semap.rules.language.parameter import Kind, Parameter
from semap.rules.language.reading import read_declaration
from semap.rules.language.template import TEMPLATES, fill

NOT_SAID = ("name", "document")
"""Of a declaration: the name alone makes no other rule, and the document says the rest once more."""

CLAUSES = {"inputs": "input", "body": "pattern"}
"""The clauses by the names of a declaration's members, where they differ."""

FIRST_US = 86_399_000_001
FIRST_COUNT = 900_001
FIRST_M = 9_000.0625


@dataclass(frozen=True)
class Recognised:
    """template  the name of the one that says the same, or of the one that is likest
    values     of its parameters, as `fill` takes them; None: it does not say the same
    differs    the clauses in which it does not
    """

    template: str
    values: Mapping[str, str] | None
    differs: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Form:
    """A template with a stand-in for each value that is not left open."""

    template: str
    declaration: Declaration
    stands_for: Mapping[object, Parameter]


def recognise(declaration: Declaration) -> Recognised:
    """The template of a rule, or the likest one."""
    likest: Recognised | None = None
    for form in _forms():
        found, differs = _values(form, declaration)
        if not differs and _says(form.template, found, declaration):
            return Recognised(form.template, found)
        if likest is None or len(differs) < len(likest.differs):
            likest = Recognised(form.template, None, differs or ("name",))
    assert likest is not None  # noqa: S101
    return likest


@lru_cache(maxsize=1)
def _forms() -> tuple[_Form, ...]:
    return tuple(form for name in TEMPLATES for form in _forms_of(name))


def _forms_of(name: str) -> Iterator[_Form]:
    """With each choice of what is left open."""
    parameters = TEMPLATES[name].parameters
    may_be_open = [each for each in parameters if each.condition]
    for chosen in product((True, False), repeat=len(may_be_open)):
        left_open = {each.name for each, is_given in zip(may_be_open, chosen, strict=True) if not is_given}
        stands_for: dict[object, Parameter] = {}
        values: dict[str, object] = {}
        for place, each in enumerate(parameters):
            if each.name in left_open:
                values[each.name] = ""
                continue
            stand_in, values[each.name] = _stand_in(each.kind, place)
            stands_for[stand_in] = each
        yield _Form(name, read_declaration(fill(name, **values)), stands_for)


def _stand_in(kind: Kind, place: int) -> tuple[object, object]:
    """What a rule holds of a value that no rule has, and the value."""
    match kind:
        case "duration":
            return FIRST_US + place, write_duration(FIRST_US + place)
        case "count":
            return FIRST_COUNT + place, FIRST_COUNT + place
        case "distance_m":
            return FIRST_M + place, FIRST_M + place
    return f"stand-in_{place}", f"stand-in_{place}"


def _values(form: _Form, declaration: Declaration) -> tuple[dict[str, str], tuple[str, ...]]:
    """The values, and the clauses that are others."""
    found: dict[str, str] = {}
    differs = []
    for member in fields(Declaration):
        if member.name in NOT_SAID:
            continue
        pair = getattr(form.declaration, member.name), getattr(declaration, member.name)
        if not _same(*pair, form.stands_for, found):
            is_formula = member.name == "body" and isinstance(declaration.body, TemporalFormula)
            differs.append("formula" if is_formula else CLAUSES.get(member.name, member.name))
    named = next((each.name for each in form.stands_for.values() if each.name == "name"), "")
    if named and found.setdefault(named, declaration.name) != declaration.name:
        differs.append("emit")
    left_open = {each.name: "" for each in TEMPLATES[form.template].parameters if each.condition}
    return {**left_open, **found}, tuple(dict.fromkeys(differs))


def _same(form: object, said: object, stands_for: Mapping[object, Parameter], found: dict[str, str]) -> bool:
    """Whether both are the same but for what stands for a value; notes the values."""
    if isinstance(form, str | int | float) and not isinstance(form, bool) and form in stands_for:
        parameter = stands_for[form]
        if isinstance(said, bool) or not isinstance(said, type(form)):
            return False
        value = write_duration(said) if parameter.kind == "duration" and isinstance(said, int) else str(said)
        return found.setdefault(parameter.name, value) == value
    if is_dataclass(form) and type(form) is type(said):
        pairs = [(getattr(form, f.name), getattr(said, f.name)) for f in fields(form) if f.compare]
    elif isinstance(form, Mapping) and isinstance(said, Mapping):
        if form.keys() != said.keys():
            return False
        pairs = [(form[key], said[key]) for key in form]
    elif isinstance(form, tuple) and isinstance(said, tuple):
        if len(form) != len(said):
            return False
        pairs = list(zip(form, said, strict=True))
    else:
        return form == said
    return all(_same(*pair, stands_for, found) for pair in pairs)


def _says(template: str, values: Mapping[str, str], declaration: Declaration) -> bool:
    """Whether the template, filled with these values, is the rule."""
    try:
        filled = read_declaration(fill(template, **values))
    except InvalidInput:
        return False
    return all(
        getattr(filled, member.name) == getattr(declaration, member.name)
        for member in fields(Declaration)
        if member.name != "document"
    )
