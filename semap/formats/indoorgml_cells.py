"""The cells of an IndoorGML document: which there are, of whatever class, and what kind of thing each is.

Every child of a `cellSpaceMember` is a cell: extensions of the standard add classes in namespaces of their
own. A class that is not known is judged by the words of its name; without a known word it is a room.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from xml.etree.ElementTree import Element

from semap.formats.gml_tree import GML, LINE, id_of, name_of, referred, text_of
from semap.model.building import Finding

ROOM, DOOR, WINDOW, OBSTACLE = "Room", "Door", "Window", "Obstacle"

MEMBER = "cellSpaceMember"
CELLS = {
    "CellSpace": ROOM,
    "GeneralSpace": ROOM,
    "TransferSpace": ROOM,
    "TransitionSpace": ROOM,
    "NavigableSpace": ROOM,
    "ConnectionSpace": DOOR,
    "AnchorSpace": DOOR,
    "NonNavigableSpace": OBSTACLE,
}
WORDS = {
    "door": DOOR,
    "gate": DOOR,
    "window": WINDOW,
    "obstacle": OBSTACLE,
    "wall": OBSTACLE,
    "column": OBSTACLE,
    "furniture": OBSTACLE,
}
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
CALLED = {
    DOOR: re.compile(r"(door|tür|tuer|porte|puerta)[\s_#:.-]*\d*[a-z]?", re.IGNORECASE),
    WINDOW: re.compile(r"(window|fenster|fenêtre|ventana)[\s_#:.-]*\d*[a-z]?", re.IGNORECASE),
}
READ = {MEMBER, "cellSpaceBoundaryMember", "stateMember", "transitionMember", "spaceLayerMember"}
"""Members that are read; any other is told to be left out."""


def cell_elements(root: Element, ids: Mapping[str, Element], findings: list[Finding]) -> list[Element]:
    """Every cell once, in the order of the document.

    findings  gets the classes that are none of the standard's, and what of the document is not read
    """
    found: dict[int, Element] = {}
    elsewhere = 0
    unread: Counter[str] = Counter()
    for element in root.iter():
        name = name_of(element)
        if name == MEMBER:
            target = referred(element, ids)
            elsewhere += target is None and len(element) == 0
            for each in element if target is None else (target,):
                found[id(each)] = each
        elif name in CELLS and id_of(element) is not None:
            found[id(element)] = element
        elif name.endswith("Member") and name not in READ and not element.tag.startswith("{" + GML):
            unread.update(name_of(each) for each in element)
    if elsewhere:
        findings.append(Finding("skipped", _counted(elsewhere, "cell"), "they lie in another file"))
    for name, count in unread.items():
        findings.append(Finding("skipped", f"{count} {name}", "semap reads cells, states and transitions"))
    strange = Counter(each.tag for each in found.values() if name_of(each) not in CELLS)
    for tag, count in strange.items():
        name = tag.rpartition("}")[2]
        reason = f"of the class {name}, which is not IndoorGML's own; taken as {_of_class(name)}"
        findings.append(Finding("note", _counted(count, "cell"), reason))
    return list(found.values())


def key_of(element: Element) -> str:
    """The cell's gml:id, or where it stands."""
    return id_of(element) or f"cell in line {element.get(LINE)}"


def concept_of(element: Element, name: str) -> str:
    """What a cell is: by what it is called, else by its class."""
    called = (name, text_of(element, "class") or "")
    for concept, pattern in CALLED.items():
        if any(pattern.fullmatch(text) for text in called):
            return concept
    return _of_class(name_of(element))


def _of_class(name: str) -> str:
    words = (word.lower() for word in WORD.findall(name))
    return CELLS.get(name) or next((WORDS[word] for word in words if word in WORDS), ROOM)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" + ("s" if count > 1 else "")
