"""A row pattern written out as words, in order of preference.

A word is a way through the pattern, its items the rows to bind. Words of one beginning stand together, so that
which of two ways is preferred is told by which stands first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from semap.rules import pattern as p


class TooMany(Exception):
    """The pattern has more words than anyone would wait for."""


@dataclass(frozen=True)
class Item:
    """A row to bind. `way`: how the pattern was gone through to it. `element`: what the joint stands before.

    absences  (name, joint) since the row before
    scopes    (the repetition on its way, name of its `until`)
    """

    way: tuple[object, ...]
    variable: str
    joint: str | None = None
    element: tuple[object, ...] = ()
    absences: tuple[tuple[str, str | None], ...] = ()
    scopes: tuple[tuple[tuple[object, ...], str], ...] = ()


@dataclass(frozen=True)
class Word:
    """`cut`: it goes on, beyond the end of the stream."""

    items: tuple[Item, ...] = ()
    absences: tuple[tuple[str, str | None], ...] = ()
    cut: bool = False


def words(node: p.Node, way: tuple[object, ...], longest: int) -> list[Word]:
    """The words, cut after `longest` items, preferred first."""
    match node:
        case p.Anchor(at):
            found = [Word((), (("^" if at == "begin" else "$", None),))]
        case p.Variable():
            found = [Word((Item(way, node.label),))]
        case p.Absent(name):
            found = [Word((), ((name, None),))]
        case p.Sequence(elements):
            found = [Word()]
            for place, element in enumerate(elements):
                there = (*way, place)
                parts = words(element.node, there, longest)
                found = [
                    word
                    for head in found
                    for part in parts
                    for word in join(head, part, element.joint, there)
                ]
                found = short(found, longest)
        case p.Alternation(options):
            found = [
                word
                for place, option in enumerate(options)
                for word in words(option, (*way, f"|{place}"), longest)
            ]
        case p.Permutation(nodes, joint):
            found = [
                word for _, word in orders(nodes, tuple(range(len(nodes))), joint, (*way, "permute"), longest)
            ]
        case p.Repeat():
            found = rounds(node, 0, way, longest)
    return short(found, longest)


def orders(
    nodes: tuple[p.Node, ...], left: tuple[int, ...], joint: str, way: tuple[object, ...], longest: int
) -> list[tuple[int, Word]]:
    """The nodes that are left, in any order, each with its first.

    Which comes next is chosen when the one before is through.
    """
    found = []
    for place in left:
        there = (*way, place)
        others = tuple(other for other in left if other != place)
        tails = orders(nodes, others, joint, there, longest) if others else [(-1, Word())]
        heads = words(nodes[place], there, longest)
        ways = [
            word for head in heads for then, tail in tails for word in join(head, tail, joint, (*there, then))
        ]
        found += [(place, word) for word in short(ways, longest)]
    return found


def rounds(node: p.Repeat, done: int, way: tuple[object, ...], longest: int) -> list[Word]:
    """What is left of a repetition after so many rounds."""
    if done == node.most or done > node.least + longest:
        return [Word()]
    there = (*way, f"round {done}")
    more = []
    parts = words(node.node, there, longest)
    rest = (
        rounds(node, done + 1, way, longest)
        if any(part.items for part in parts) or done < node.least
        else [Word()]
    )
    for part in parts:
        if done >= node.least and not part.items:
            more.append(part)
            continue
        head = part if node.until is None else scoped(part, (way, node.until))
        more += [word for tail in rest for word in join(head, tail, node.joint, (*way, f"round {done + 1}"))]
    more = short(more, longest)
    if done < node.least:
        return more
    return [*more, Word()] if node.greedy else [Word(), *more]


def scoped(word: Word, scope: tuple[tuple[object, ...], str]) -> Word:
    return replace(word, items=tuple(replace(item, scopes=(scope, *item.scopes)) for item in word.items))


def join(head: Word, tail: Word, joint: str, element: tuple[object, ...]) -> list[Word]:
    """One after the other: the joint is for the first row of the tail, if the head binds one."""
    if head.cut:
        return [head]
    if head.items:
        tail = jointed(tail, joint, element)
    if not tail.items:
        return [Word(head.items, head.absences + tail.absences)]
    first = replace(tail.items[0], absences=head.absences + tail.items[0].absences)
    return [Word((*head.items, first, *tail.items[1:]), tail.absences, tail.cut)]


def jointed(word: Word, joint: str, element: tuple[object, ...]) -> Word:
    def filled(absences: tuple[tuple[str, str | None], ...]) -> tuple[tuple[str, str | None], ...]:
        return tuple((name, own or joint) for name, own in absences)

    if not word.items:
        return replace(word, absences=filled(word.absences))
    first = word.items[0]
    if first.joint is None:
        first = replace(first, joint=joint, element=element)
    first = replace(first, absences=filled(first.absences))
    return replace(word, items=(first, *word.items[1:]))


def short(found: list[Word], longest: int) -> list[Word]:
    cut = [word if len(word.items) <= longest else Word(word.items[:longest], (), True) for word in found]
    found = list(dict.fromkeys(cut))
    if len(found) > 1500:
        raise TooMany
    return found
