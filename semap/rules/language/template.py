"""Ready rules: texts that a person can read and edit, with a few values to fill in.

What `fill` gives is an ordinary rule. What it takes for a parameter depends on what the default is: a
duration, a whole number, a distance, a name, or the name of a room as it is on the map.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from string import Template as Text

from semap.errors import InvalidInput, NotFound
from semap.rules.language.duration import read_duration, write_duration
from semap.rules.language.source_text import CONSTANTS
from semap.rules.language.words import read_name, unknown


def _name(value: object, where: str) -> str:
    """A name that YAML does not take for something else."""
    name = read_name(value, where)
    if name in CONSTANTS:
        raise InvalidInput(f"{name} is no name to YAML", "Choose another name.", where)
    return name


@dataclass(frozen=True)
class Parameter:
    """A value of a template.

    read  makes of what is given what stands in the text; raises InvalidInput with the name
    """

    name: str
    default: str
    meaning: str
    read: Callable[[object, str], str] = _name


@dataclass(frozen=True)
class Template:
    """A rule with parameters: ${name} in its text stands for what `read` of the parameter gives."""

    name: str
    sentence: str
    parameters: tuple[Parameter, ...]
    text: str


def fill(name: str, /, **parameters: object) -> str:
    """The text of a rule, in YAML.

    raises  NotFound for a template that is none; InvalidInput for a parameter that is none, or does not fit
    """
    template = TEMPLATES.get(name)
    if template is None:
        raise NotFound("template", name, f"There are {', '.join(TEMPLATES)}.")
    known = [parameter.name for parameter in template.parameters]
    for given in parameters:
        if given not in known:
            raise unknown(f"the template {name} has no such parameter", given, known, given)
    values = {
        each.name: each.read(parameters.get(each.name, each.default), each.name)
        for each in template.parameters
    }
    return f"# {template.sentence}\n{Text(template.text).substitute(values)}"


def _duration(value: object, where: str) -> str:
    return write_duration(read_duration(value, where))


def _count(value: object, where: str) -> str:
    text = str(value)
    if not text.isdecimal() or not 0 < len(text) <= 6:
        raise InvalidInput(f"{text!r} is no count", "Write a whole number, such as 4.", where)
    return str(int(text))


def _distance_m(value: object, where: str) -> str:
    text = str(value)
    if not text.replace(".", "", 1).isdecimal() or len(text) > 12 or float(text) <= 0:
        raise InvalidInput(f"{text!r} is no distance", "Write metres above zero, such as 1.5.", where)
    return repr(float(text))


def _literal(value: object, where: str) -> str:
    """A text as CQL2 writes it, within a text of YAML in double quotes."""
    if not isinstance(value, str) or not value or len(value) > 200:
        raise InvalidInput("a name is needed", "Write it as it is on the map.", where)
    quoted = "'" + value.replace("'", "''") + "'"
    return json.dumps(quoted, ensure_ascii=False)[1:-1]


def _called(default: str) -> Parameter:
    return Parameter("name", default, "name of the rule, and of its event")


QUERY = Parameter("query", "track_in_room", "the continuous query")
DOOR = Parameter("door", "door", "the property of doors that becomes open and closed")
REACH = Parameter("reach_m", "1.5", "how near the one is who opens or closes a door [m]", _distance_m)
GAP = Parameter("within", "6 s", "the longest time between the two, itself excluded", _duration)
AT_DOOR = (QUERY, DOOR, REACH, GAP)

VISITS = Template(
    "visits",
    "Whenever somebody enters a room, and whenever somebody leaves it.",
    (
        QUERY,
        Parameter("name", "visits", "name of the rule"),
        Parameter("entered", "entered", "the event of entering"),
        Parameter("left", "left", "the event of leaving"),
    ),
    """\
name: ${name}
input: ${query}
emit: {began: ${entered}, ended: ${left}}
""",
)

DWELL = Template(
    "dwell",
    "Somebody has been in one room for so long, known at that moment and not only at the end of the stay.",
    (
        QUERY,
        Parameter("room", "kitchen", "the room, by its name on the map", _literal),
        Parameter("duration", "10 min", "how long at least", _duration),
        _called("dwelt"),
    ),
    """\
name: ${name}
input: ${query}
where: "instance = ${room}"        # leave it out for every room
partition_by: [track, instance]
pattern: I not followed by O       # entered, and has not left again when the window ends
define:
  I: "type = 'began'"
  O: "type = 'ended'"
within: ${duration}
emit: ${name}
""",
)

ABSENCE = Template(
    "absence",
    "A door of a room has been open for so long, and nobody was in the room in all that time.",
    (
        QUERY,
        DOOR,
        Parameter("duration", "5 min", "how long", _duration),
        _called("open_and_empty"),
    ),
    """\
name: ${name}
input: [${query}, {object_state: ${door}}]
partition_by: room
when: S                            # it may begin when a door opens, and when somebody leaves
formula: "always[0 s, ${duration}] (O and not P)"
define:
  S: "(input = '${door}' and type = 'open') or (input = '${query}' and type = 'ended')"
  O: "input = '${door}' and type = 'open'"       # holds until the door's next state
  P: "input = '${query}' and type = 'began'"     # holds while somebody is in the room
emit: {holds: ${name}}
""",
)

COUNT = Template(
    "count",
    "More than so many are in one room: whenever one too many comes, and when they are no longer too many.",
    (
        QUERY,
        Parameter("more_than", "4", "how many may be there", _count),
        Parameter("name", "crowding", "name of the rule"),
        Parameter("crowded", "crowded", "the event when one too many has come"),
        Parameter("relieved", "no_longer_crowded", "the event when they are no longer too many"),
    ),
    """\
name: ${name}
input: ${query}
# occupants counts those in the room after the change
where: "(type = 'began' and occupants = ${more_than} + 1) or (type = 'ended' and occupants = ${more_than})"
measures: {occupants: occupants}
emit: {began: ${crowded}, ended: ${relieved}}
""",
)

FIRST_SIGHT = Template(
    "first_sight",
    "A track comes into sight: its first state lies in a room.",
    (QUERY, _called("first_seen")),
    """\
name: ${name}
input: ${query}
partition_by: track
# One event for each time that the track appears, though it may appear in several overlapping rooms at once.
# A track whose first state lies in no room has none.
pattern: F
define:
  F: >-
    cause = 'appeared'
    and (prev(stamp) is null or prev(stamp) < stamp or prev(cause) <> 'appeared')
within: 1 s
emit: ${name}
""",
)

LAST_SIGHT = Template(
    "last_sight",
    "A track is lost from sight: it ends while it is in a room.",
    (QUERY, _called("last_seen")),
    """\
name: ${name}
input: ${query}
partition_by: track
# One event for each time that the track ends, though it may be in several overlapping rooms then.
# A track that ends while it is in no room has none. The stamp is that of its end.
pattern: L
define:
  L: >-
    cause = 'disappeared'
    and (prev(stamp) is null or prev(stamp) < stamp or prev(cause) <> 'disappeared')
within: 1 s
emit: ${name}
""",
)

OPENED_THEN_ENTERED = Template(
    "opened_then_entered",
    "Somebody opened a door of a room, and then entered that room.",
    (*AT_DOOR, _called("opened_then_entered")),
    """\
name: ${name}
input: [${query}, {object_state: ${door}, actor_within_m: ${reach_m}}]
partition_by: room
pattern: O followed by E
define:
  O: "input = '${door}' and type = 'open'"
  E: "input = '${query}' and type = 'began' and track_id = first(O.actor_id)"
measures:
  who: last(E.track)
  gap_s: seconds_between(first(O.stamp), last(E.stamp))
  likelihood: first(O.actor_likelihood)
within: ${within}
after_match: skip to next row      # what one person does hides nothing that another does meanwhile
emit: ${name}
""",
)

THEN_CLOSED = """\
name: ${name}
input: [${query}, {object_state: ${door}, actor_within_m: ${reach_m}}]
partition_by: room
pattern: %(first)s followed by C
define:
  %(first)s: "input = '${query}' and type = '%(type)s'"
  C: "input = '${door}' and type = 'closed' and actor_id = last(%(first)s.track_id)"
measures:
  who: last(%(first)s.track)
  gap_s: seconds_between(first(%(first)s.stamp), last(C.stamp))
  likelihood: last(C.actor_likelihood)
within: ${within}
after_match: skip to next row      # what one person does hides nothing that another does meanwhile
emit: ${name}
"""

ENTERED_THEN_CLOSED = Template(
    "entered_then_closed",
    "Somebody entered a room, and then closed a door of it.",
    (*AT_DOOR, _called("entered_then_closed")),
    THEN_CLOSED % {"first": "E", "type": "began"},
)

LEFT_THEN_CLOSED = Template(
    "left_then_closed",
    "Somebody left a room, and then closed a door of it.",
    (*AT_DOOR, _called("left_then_closed")),
    THEN_CLOSED % {"first": "L", "type": "ended"},
)

TEMPLATES: Mapping[str, Template] = {
    template.name: template
    for template in (
        VISITS,
        DWELL,
        ABSENCE,
        COUNT,
        FIRST_SIGHT,
        LAST_SIGHT,
        OPENED_THEN_ENTERED,
        ENTERED_THEN_CLOSED,
        LEFT_THEN_CLOSED,
    )
}
