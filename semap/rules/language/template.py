"""Ready rules: sentences with a few values to fill in, and the texts that say the same.

What `fill` gives is an ordinary rule, to be read and edited.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from string import Template as Text

from semap.errors import NotFound
from semap.rules.language.parameter import Parameter
from semap.rules.language.words import unknown

NO_WHERE = re.compile(r'^where: "" *\n', re.MULTILINE)


@dataclass(frozen=True)
class Template:
    """A rule with parameters.

    title   what it is about, in a few words
    phrase  what it asks for, with {name} for each parameter that a person thinks of first
    text    ${name} stands for what a parameter becomes; ${where} for the conditions that are asked of all
            rows, and ${of_A} for those that are asked of the rows of A, with `and` before each
    """

    name: str
    title: str
    phrase: str
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
    values = {each.name: each.read(parameters.get(each.name, each.default)) for each in template.parameters}
    asked: dict[str, list[str]] = {}
    for each in template.parameters:
        if each.condition:
            asked.setdefault(each.variable, []).extend(filter(None, (values[each.name],)))
    of = {f"of_{variable}": "".join(f" and {each}" for each in all_) for variable, all_ in asked.items()}
    where = " and ".join(asked.get("", ()))
    filled = Text(template.text).substitute(values, **of, where=where)
    return f"# {template.sentence}\n{NO_WHERE.sub('', filled)}"


def _called(default: str) -> Parameter:
    return Parameter("name", default, "name of the rule, and of its event", "name")


def _person(condition: str = "track = {}") -> Parameter:
    return Parameter("person", "", "who, by name; empty: anybody", "person", condition)


def _room(condition: str = "instance = {}", variable: str = "") -> Parameter:
    return Parameter("room", "", "the room, by its name on the map; empty: any", "room", condition, variable)


def _lasting(default: str) -> Parameter:
    return Parameter("duration", default, "how long", "duration")


QUERY = Parameter("query", "track_in_room", "the continuous query", "query")
STATE = Parameter("state", "door", "the property of doors that becomes open and closed", "state")
REACH = Parameter("reach_m", "1.5", "how near the one is who opens or closes a door [m]", "distance_m")
ROOM_OF_ALL = _room(variable="all")
GAP = Parameter("within", "6 s", "the longest time between the two, itself excluded", "duration")
AT_DOOR = (
    _person("(actor = {} or track = {})"),
    _room("room = {}"),
    GAP,
    QUERY,
    STATE,
    REACH,
)

VISITS = Template(
    "visits",
    "Somebody comes or goes",
    "{person} enters or leaves {room}",
    "Whenever somebody enters a room, and whenever somebody leaves it.",
    (
        _person(),
        _room(),
        QUERY,
        Parameter("name", "visits", "name of the rule", "name"),
        Parameter("entered", "entered", "the event of entering", "name"),
        Parameter("left", "left", "the event of leaving", "name"),
    ),
    """\
name: ${name}
input: ${query}
where: "${where}"
emit: {began: ${entered}, ended: ${left}}
""",
)

DWELL = Template(
    "dwell",
    "Somebody stays long",
    "{person} has been in {room} for {duration}",
    "Somebody has been in one room for so long, known at that moment and not only at the end of the stay.",
    (
        _person(),
        _room(),
        _lasting("10 min"),
        QUERY,
        _called("dwelt"),
    ),
    """\
name: ${name}
input: ${query}
where: "${where}"
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
    "A door is open and nobody is there",
    "a door of {room} has been open for {duration}, and nobody was there",
    "A door of a room has been open for so long, and nobody was in the room in all that time.",
    (
        _room("room = {}"),
        _lasting("5 min"),
        QUERY,
        STATE,
        _called("open_and_empty"),
    ),
    """\
name: ${name}
input: [${query}, {object_state: ${state}}]
where: "${where}"
partition_by: room
when: S                            # it may begin when a door opens, and when somebody leaves
formula: "always[0 s, ${duration}] (O and not P)"
define:
  S: "(input = '${state}' and type = 'open') or (input = '${query}' and type = 'ended')"
  O: "input = '${state}' and type = 'open'"       # holds until the door's next state
  P: "input = '${query}' and type = 'began'"     # holds while somebody is in the room
emit: {holds: ${name}}
""",
)

COUNT = Template(
    "count",
    "Too many are in a room",
    "more than {more_than} are in {room}",
    "More than so many are in one room: whenever one too many comes, and when they are no longer too many.",
    (
        Parameter("more_than", "4", "how many may be there", "count"),
        ROOM_OF_ALL,
        QUERY,
        Parameter("name", "crowding", "name of the rule", "name"),
        Parameter("crowded", "crowded", "the event when one too many has come", "name"),
        Parameter("relieved", "no_longer_crowded", "the event when they are no longer too many", "name"),
    ),
    """\
name: ${name}
input: ${query}
# occupants counts those in the room after the change
where: "((type = 'began' and occupants = ${more_than} + 1)
  or (type = 'ended' and occupants = ${more_than}))${of_all}"
measures: {occupants: occupants}
emit: {began: ${crowded}, ended: ${relieved}}
""",
)

FIRST_SIGHT = Template(
    "first_sight",
    "Somebody comes into sight",
    "{person} comes into sight in {room}",
    "A track comes into sight: its first state lies in a room.",
    (_person(), _room(), QUERY, _called("first_seen")),
    """\
name: ${name}
input: ${query}
where: "${where}"
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
    "Somebody is lost from sight",
    "{person} is lost from sight in {room}",
    "A track is lost from sight: it ends while it is in a room.",
    (_person(), _room(), QUERY, _called("last_seen")),
    """\
name: ${name}
input: ${query}
where: "${where}"
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
    "Somebody opens a door and goes in",
    "{person} opens a door of {room} and goes in, in less than {within}",
    "Somebody opened a door of a room, and then entered that room.",
    (*AT_DOOR, _called("opened_then_entered")),
    """\
name: ${name}
input: [${query}, {object_state: ${state}, actor_within_m: ${reach_m}}]
where: "${where}"
partition_by: room
pattern: O followed by E
define:
  O: "input = '${state}' and type = 'open'"
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
input: [${query}, {object_state: ${state}, actor_within_m: ${reach_m}}]
where: "${where}"
partition_by: room
pattern: %(first)s followed by C
define:
  %(first)s: "input = '${query}' and type = '%(type)s'"
  C: "input = '${state}' and type = 'closed' and actor_id = last(%(first)s.track_id)"
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
    "Somebody goes in and closes the door",
    "{person} enters {room} and closes a door of it, in less than {within}",
    "Somebody entered a room, and then closed a door of it.",
    (*AT_DOOR, _called("entered_then_closed")),
    THEN_CLOSED % {"first": "E", "type": "began"},
)

LEFT_THEN_CLOSED = Template(
    "left_then_closed",
    "Somebody leaves and closes the door",
    "{person} leaves {room} and closes a door of it, in less than {within}",
    "Somebody left a room, and then closed a door of it.",
    (*AT_DOOR, _called("left_then_closed")),
    THEN_CLOSED % {"first": "L", "type": "ended"},
)

LEFT_OPEN = Template(
    "left_open",
    "A door stays open",
    "{door} has been open for {duration}",
    "A door has been open for so long.",
    (
        Parameter("door", "", "the door, by its name on the map; empty: any", "door", "instance = {}"),
        _lasting("5 min"),
        STATE,
        _called("left_open"),
    ),
    """\
name: ${name}
input: {object_state: ${state}}
where: "${where}"
partition_by: instance
pattern: O not followed by C
define:
  O: "type = 'open' and (previous is null or previous <> 'open')"
  C: "type <> 'open'"
within: ${duration}
emit: ${name}
""",
)

VACANT = Template(
    "vacant",
    "Nobody is in a room for long",
    "nobody has been in {room} for {duration}",
    "Nobody has come into a room for so long after the last one left it.",
    (_room(), _lasting("30 min"), QUERY, _called("vacant")),
    """\
name: ${name}
input: ${query}
where: "${where}"
partition_by: instance
pattern: L not followed by E
define:
  L: "type = 'ended' and occupants = 0"
  E: "type = 'began'"
within: ${duration}
emit: ${name}
""",
)

WENT_ON = Template(
    "went_on",
    "Somebody goes from room to room",
    "{person} leaves {from} and enters {to}, in less than {within}",
    "Somebody left a room, and so soon afterwards entered another.",
    (
        _person(),
        Parameter("from", "", "the room that is left; empty: any", "room", "instance = {}", "L"),
        Parameter("to", "", "the room that is entered; empty: any other", "room", "instance = {}", "E"),
        Parameter("within", "1 min", "the longest time between the two, itself excluded", "duration"),
        QUERY,
        _called("went_on"),
    ),
    """\
name: ${name}
input: ${query}
where: "${where}"
partition_by: track
pattern: L followed by E
define:
  L: "type = 'ended'${of_L}"
  E: "type = 'began' and instance_id <> L.instance_id${of_E}"
measures: {from: first(L.instance), to: last(E.instance)}
within: ${within}
after_match: skip to next row
emit: ${name}
""",
)

CAME_BEHIND = Template(
    "came_behind",
    "Somebody comes in behind another",
    "somebody enters {room} less than {within} after somebody else",
    "Somebody entered a room so soon after somebody else.",
    (
        ROOM_OF_ALL,
        Parameter("within", "3 s", "the longest time between the two, itself excluded", "duration"),
        QUERY,
        _called("came_behind"),
    ),
    """\
name: ${name}
input: ${query}
where: "type = 'began'${of_all}"
partition_by: instance
pattern: A B
define:
  B: "track_id <> A.track_id"
measures:
  who: last(B.track)
  behind: first(A.track)
  gap_s: seconds_between(first(A.stamp), last(B.stamp))
within: ${within}
after_match: skip to next row
emit: ${name}
""",
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
        LEFT_OPEN,
        VACANT,
        WENT_ON,
        CAME_BEHIND,
    )
}
