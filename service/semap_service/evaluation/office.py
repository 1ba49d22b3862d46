"""The office recording against its labels: the paper's experiment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
from semap_ingest.pipeline.ingest_recording import Plan
from semap_ingest.pipeline.meter import StopWatch
from semap_ingest.simulation.labels import Labels, read_labels
from semap_ingest.simulation.office import OfficePaths, office_recording
from semap_ingest.simulation.settings import START_US, OfficeSettings

from semap.errors import InvalidInput, NotFound
from semap_service.evaluation import pictures
from semap_service.evaluation.delays import measure_delays, row
from semap_service.evaluation.matching import Occurrence, Scores, match, together
from semap_service.evaluation.play import Played, PlayedEvent, play, set_the_stage
from semap_service.evaluation.report import Report
from semap_service.evaluation.tracking import score_crowd, ways_in_scans
from semap_service.evaluation.walls import plan_of_walls, wall_scores, wall_settings

TOLERANCE_US = 500_000
PERSONS = ("person_entered", "person_left")
DOORS = ("door_opening", "door_opened", "door_closing", "door_closed")
COMPLEX = ("opened_then_entered", "opened_then_left", "entered_then_closed", "left_then_closed")
LASER_PERIOD_MS = 1000 / 15
MEDIAN_MS = 25.0
AIM_RATE = 0.95
BESIDE = ("idf1", "idf1_best_alone")
WALLS = ((5, 1), (4, 3), (8, 7), (20, 1))
"""People and seed of the recordings with cameras on walls."""
PARTS = {"transitions": PERSONS, "doors": DOORS, "complex": COMPLEX}

Advance = Callable[[int, int], None]


@dataclass(frozen=True)
class Stage:
    """Where evaluations run: a database with a rule worker, and how to tell how far they are."""

    dsn: str
    say: Callable[[str], None]
    advance: Advance = lambda done, total: None

    def recording(self, settings: OfficeSettings) -> OfficePaths:
        """Made at first use."""
        return office_recording(settings, self.advance)

    def play(
        self, name: str, paths: OfficePaths, *, speed: float | None = None, meter: StopWatch | None = None
    ) -> Played:
        """On a map of its own, made anew."""
        set_the_stage(self.dsn, paths.map, name)
        return play(self.dsn, plan_of(name, paths, speed), meter or StopWatch())


def plan_of(map_name: str, paths: OfficePaths, speed: float | None = None) -> Plan:
    """How the office's recording is brought in: with the detector of its camera."""
    return Plan(map_name, "robot", paths.recording, speed, image_model=camera_model())


def camera_model() -> Path:
    """The small detector that knows the simulated camera's persons."""
    with as_file(files("semap_ingest.models") / "person_camera.onnx") as path:
        return path


def score(labels: Labels, events: Iterable[PlayedEvent]) -> dict[str, Scores]:
    """Transitions, doors and complex relations, each event within 500 ms of its label."""
    wanted, found = labelled(labels), _occurrences(events)
    return {
        part: match(
            [o for o in wanted if o.kind in kinds], [o for o in found if o.kind in kinds], TOLERANCE_US
        )
        for part, kinds in PARTS.items()
    }


def labelled(labels: Labels) -> list[Occurrence]:
    """What should be found. Each turn of a leaf has two events, at its beginning and towards its end."""
    of_turn = {"opening": ("door_opening", "door_opened"), "closing": ("door_closing", "door_closed")}
    return [
        *(Occurrence(f"person_{each.kind}", each.room, each.complete_us) for each in labels.transitions),
        *(
            Occurrence(kind, each.door, each.start_us, each.end_us)
            for each in labels.doors
            for kind in of_turn[each.kind]
        ),
        *(Occurrence(each.kind, each.room, each.second_us) for each in labels.relations),
    ]


def openings_before(labels: Labels, scores: Scores) -> tuple[int, int]:
    """Of the openings that a transition follows: how many were found before it was complete, and of how
    many."""
    found = {
        (label.place, label.until_us): event.stamp_us
        for label, event in scores.matched
        if label.kind == "door_opening"
    }
    opened = [each for each in labels.relations if each.kind in COMPLEX[:2]]
    before = [
        each for each in opened if found.get((each.door, each.first_us), each.second_us) < each.second_us
    ]
    return len(before), len(opened)


def detection(stage: Stage) -> Report:
    """The paper's recording: every transition, opening and relation, and nothing else."""
    paths = stage.recording(OfficeSettings())
    labels = read_labels(paths.labels)
    scores = score(labels, stage.play("office", paths).events)
    every = together(scores.values())
    before, opened = openings_before(labels, scores["doors"])
    return Report(
        "detection",
        "16 of 16 transitions within 500 ms, all openings before, 12 of 12 relations, nothing else",
        not every.missed and not every.made_up and before == opened,
        tuple(_row(part, each) for part, each in scores.items()),
        (
            f"{before} of {opened} openings found before the transition that follows",
            *_faults(every, labels.start_us),
        ),
        lambda: pictures.timeline(
            every, labels.start_us, "Office recording: labels (grey) and events (blue)"
        ),
    )


def other_seeds(stage: Stage, count: int) -> Report:
    """The same over other schedules."""
    by_part: dict[str, list[Scores]] = {part: [] for part in PARTS}
    faults: list[str] = []
    for number in range(1, count + 1):
        stage.say(f"   seed {number} of {count} others")
        paths = stage.recording(OfficeSettings(seed=OfficeSettings().seed + number))
        labels = read_labels(paths.labels)
        scores = score(labels, stage.play("office", paths).events)
        for part, each in scores.items():
            by_part[part].append(each)
        found = _faults(together(scores.values()), labels.start_us)
        faults += [f"seed {labels.seed}: {fault}" for fault in found]
    every = {part: together(each) for part, each in by_part.items()}
    errors_ms = every["transitions"].errors_ms
    return Report(
        "seeds",
        f"recall and precision of at least {AIM_RATE} over {count} other seeds",
        all(min(each.recall, each.precision) >= AIM_RATE for each in every.values()),
        tuple(_row(part, each) for part, each in every.items()),
        tuple(faults),
        lambda: pictures.histogram(errors_ms, "Transitions: event less label", "error [ms]"),
    )


def delays(stage: Stage, plays: int) -> Report:
    """From the sending of the last record that affects an event to the event, as in the paper's Fig. 5."""
    paths = stage.recording(OfficeSettings())
    groups: dict[str, list[float]] = {}
    rows = []
    for name, images_hz in (("30 Hz", None), ("7.5 Hz", 7.5)):
        door_ms: list[float] = []
        person_ms: list[float] = []
        unknown = 0
        for number in range(1, plays + 1):
            stage.say(f"   images at {name}: play {number} of {plays}")
            set_the_stage(stage.dsn, paths.map, "office")
            measured = measure_delays(stage.dsn, replace(plan_of("office", paths), images_hz=images_hz))
            door_ms += measured.door_ms
            person_ms += measured.person_ms
            unknown += measured.unknown
        groups |= {f"doors, {name}": door_ms, f"persons, {name}": person_ms}
        rows += [
            {**row(name, "doors", door_ms), "plays": plays},
            {**row(name, "persons", person_ms), "plays": plays, "unknown": unknown},
        ]
    return Report(
        "delays",
        f"median at most {MEDIAN_MS:g} ms, p99 below a laser period, {LASER_PERIOD_MS:.0f} ms, at both rates",
        all(
            bool(each)
            and float(np.median(each)) <= MEDIAN_MS
            and float(np.percentile(each, 99)) < LASER_PERIOD_MS
            for each in groups.values()
        ),
        tuple(rows),
        (),
        lambda: pictures.boxes(
            groups, "From the last record to the event", "delay [ms]", (LASER_PERIOD_MS, "one laser period")
        ),
    )


def throughput(stage: Stage, people: Sequence[int]) -> Report:
    """The recording as fast as it goes, where the time goes, and how that grows with the crowd."""
    rows = []
    by_people: dict[str, dict[str, float]] = {}
    for count in people:
        stage.say(f"   {count} people")
        paths = stage.recording(OfficeSettings(people=count))
        meter = StopWatch()
        played = stage.play("office", paths, meter=meter)
        length_s = played.ingested.length_s
        rows.append(
            {
                "people": count,
                "recording_s": round(length_s, 1),
                "took_s": round(played.took_s, 1),
                "share": round(played.took_s / length_s, 2),
                **{f"{role}_s": round(seconds, 2) for role, seconds in sorted(meter.seconds.items())},
            }
        )
        by_people[str(count)] = dict(sorted(meter.seconds.items()))
    return Report(
        "throughput",
        "at most half of the recording's own length, with any number of people",
        all(float(str(each["share"])) <= 0.5 for each in rows),
        tuple(rows),
        (),
        lambda: pictures.shares(by_people, "Where the time goes, by people in the office", "seconds"),
    )


def repeat(stage: Stage) -> Report:
    """The same recording as fast as it goes and in real time: the same events with the same ids."""
    paths = stage.recording(OfficeSettings())
    fast = stage.play("office", paths)
    slow = stage.play("office", paths, speed=1.0)
    logs = [
        sorted((e.event_id, e.type, e.stamp_us, e.track or "", e.place) for e in each.events)
        for each in (fast, slow)
    ]
    both = match(_occurrences(fast.events), _occurrences(slow.events), 0)
    return Report(
        "repeat",
        "the same events with the same ids in real time and at full speed",
        logs[0] == logs[1] and bool(logs[0]),
        tuple(
            {"played": name, "events": len(each.events), "took_s": round(each.took_s, 1)}
            for name, each in (("as fast as it goes", fast), ("in real time", slow))
        ),
        tuple(f"only one of them: {one}" for one in sorted(set(logs[0]) ^ set(logs[1]))),
        lambda: pictures.timeline(both, START_US, "At full speed (grey) and in real time (blue)"),
    )


def tracking(stage: Stage, people: Sequence[int]) -> Report:
    """CLEAR MOT, IDF1 and HOTA on crowds."""
    rows = []
    for count in people:
        stage.say(f"   {count} people")
        paths = stage.recording(OfficeSettings(people=count))
        scores = score_crowd(plan_of("office", paths), read_labels(paths.labels).tracks)
        rows.append({"people": count, **{name: _rounded(value) for name, value in asdict(scores).items()}})
    return Report(
        "tracking",
        "figures to compare with; no person who can be seen is lost for long",
        all(float(str(each["mota"])) > 0 for each in rows),
        tuple(rows),
        (),
        lambda: pictures.lines(
            {name: (people, [float(str(each[name])) for each in rows]) for name in ("mota", "idf1", "hota")},
            "Tracks of simulated crowds", "people", "score",
        ),
    )  # fmt: skip


def walls(stage: Stage) -> Report:
    """Four cameras on walls over six rooms: each alone and together, and how long all of it takes.

    The cameras say boxes, so that no time of a detector is in it.
    """
    rows = []
    for people, seed in WALLS:
        stage.say(f"   {people} people, seed {seed}")
        paths = stage.recording(wall_settings(people, seed))
        set_the_stage(stage.dsn, paths.map, "walls")
        played = play(stage.dsn, plan_of_walls("walls", paths, scan=("/scan",)))
        rows.append(
            {
                "people": people,
                "seed": seed,
                **{name: round(value, 4) for name, value in wall_scores(paths).items()},
                "recording_s": round(played.ingested.length_s, 1),
                "took_s": round(played.took_s, 1),
                "share": round(played.took_s / played.ingested.length_s, 2),
            }
        )
    figures = [{name: float(str(value)) for name, value in each.items()} for each in rows]
    return Report(
        "walls",
        "IDF1 above the best camera's, doubled tracks below 0.01, share below 1 with a laser beside",
        all(
            each["idf1"] > each["idf1_best_alone"] and each["doubled"] < 0.01 and each["share"] < 1
            for each in figures
        ),
        tuple(rows),
        (),
        lambda: pictures.lines(
            {name: (range(len(rows)), [each[name] for each in figures]) for name in BESIDE},
            "Four cameras together, and the best of them", "recording", "IDF1",
        ),
    )  # fmt: skip


def scans(data: Path) -> Report:
    """Real scans of people who walk by, without labels: a picture to look at."""
    path = data / "laser_people" / "demo_stationary_simple_environment.bag"
    if not path.exists():
        raise NotFound("data set", path, "Name the folder of the real data sets: --data FOLDER")
    ways, seen = ways_in_scans(path, least_points=15)
    lengths_m = [float(np.hypot(*np.diff(way, axis=0).T).sum()) for way in ways.values()]
    return Report(
        "scans",
        "people tracked through real scans",
        bool(ways),
        ({"tracks": len(ways), "longest_way_m": round(max(lengths_m, default=0.0), 1),
          "median_states": float(np.median([len(way) for way in ways.values()])) if ways else None},),
        (),
        lambda: pictures.plan(seen, ways, "Persons in a recording of a laser (real)"),
    )  # fmt: skip


def evaluate(
    stage: Stage, part: str, *, seeds: int, plays: int, people: Sequence[int], data: Path | None
) -> Report:
    """One part of the evaluation, by its name."""
    if part == "scans" and data is None:
        raise InvalidInput("real scans are needed", "Name the folder of the real data sets: --data FOLDER")
    return {
        "detection": lambda: detection(stage),
        "seeds": lambda: other_seeds(stage, seeds),
        "delays": lambda: delays(stage, plays),
        "throughput": lambda: throughput(stage, people),
        "tracking": lambda: tracking(stage, people),
        "repeat": lambda: repeat(stage),
        "walls": lambda: walls(stage),
        "scans": lambda: scans(data or Path()),
    }[part]()


def _occurrences(events: Iterable[PlayedEvent]) -> list[Occurrence]:
    return [Occurrence(event.type, event.place, event.stamp_us) for event in events]


def _rounded(value: float) -> float:
    return round(value, 3)


def _row(part: str, scores: Scores) -> dict[str, object]:
    errors_ms = np.abs(scores.errors_ms)
    return {
        "part": part,
        "labels": len(scores.matched) + len(scores.missed),
        "found": len(scores.matched),
        "made_up": len(scores.made_up),
        "recall": round(scores.recall, 3),
        "precision": round(scores.precision, 3),
        "median_error_ms": round(float(np.median(errors_ms)), 0) if len(errors_ms) else None,
        "max_error_ms": round(float(errors_ms.max()), 0) if len(errors_ms) else None,
    }


def _faults(scores: Scores, start_us: int) -> list[str]:
    return [
        f"{what}: {each.kind} {each.place}, {(each.stamp_us - start_us) / 1e6:.2f} s after the beginning"
        for what, every in (("missed", scores.missed), ("made up", scores.made_up))
        for each in every
    ]
