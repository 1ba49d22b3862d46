"""A detector is recognised, tried on a picture and kept; or refused with what settles it."""

from __future__ import annotations

import json
import os
import pty
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from data_sets import data_set
from onnx import helper, numpy_helper
from semap_ingest.image.added import added_as
from semap_ingest.image.decoding import decode
from semap_ingest.image.trial import OWN_PERSON_PX, own_picture
from semap_ingest.pipeline.proposal import Wishes, rig_of
from semap_ingest.pipeline.rig import read_rig
from semap_ingest.pipeline.topics import Parts
from semap_ingest.sensing.image import CompressedImage, Image
from semap_service.cli import commands
from typer.testing import CliRunner, Result

from semap.errors import Conflict, InvalidInput, NotFound

YOLOX = "detector/yolox_nano.onnx"


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SEMAP_HOME", str(tmp_path / "home"))
    return tmp_path / "home"


def asked(*arguments: str | Path) -> Result:
    return CliRunner().invoke(commands(), ["detector", *(str(each) for each in arguments)])


def done(*arguments: str | Path) -> str:
    ran = asked(*arguments)
    assert ran.exit_code == 0, (ran.output, ran.exception)
    return ran.stdout


def refused(*arguments: str | Path) -> InvalidInput:
    ran = asked(*arguments)
    assert isinstance(ran.exception, InvalidInput), (ran.output, ran.exception)
    return ran.exception


def constant(path: Path, outputs: dict[str, np.ndarray], **metadata: str) -> Path:
    """A model that says the same of every picture."""
    values = {name: numpy_helper.from_array(array, name) for name, array in outputs.items()}
    graph = helper.make_graph(
        [helper.make_node("Constant", [], [name], value=value) for name, value in values.items()],
        "constant",
        [helper.make_tensor_value_info("images", onnx.TensorProto.FLOAT, (1, 3, 320, 320))],
        [helper.make_tensor_value_info(name, value.data_type, value.dims) for name, value in values.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata)
    onnx.save(model, path)
    return path


@pytest.fixture
def decoded(tmp_path: Path) -> Path:
    """YOLOX-Nano as it is exported with its decoding: its outputs are shaped as those of YOLOv6."""
    model = onnx.load(data_set(YOLOX))
    cells = [
        (x, y, stride) for stride in (8, 16, 32) for y in range(416 // stride) for x in range(416 // stride)
    ]
    grid = np.array(cells, np.float32)
    constants = {
        "cell": grid[None, :, :2], "stride": grid[None, :, 2:], "0": np.array([0]), "2": np.array([2]),
        "4": np.array([4]), "85": np.array([85]), "last": np.array([2]),
    }  # fmt: skip
    model.graph.initializer.extend(numpy_helper.from_array(array, name) for name, array in constants.items())
    raw = model.graph.output[0].name
    model.graph.node.extend(
        [
            helper.make_node("Slice", [raw, "0", "2", "last"], ["offset"]),
            helper.make_node("Slice", [raw, "2", "4", "last"], ["log size"]),
            helper.make_node("Slice", [raw, "4", "85", "last"], ["scores"]),
            helper.make_node("Add", ["offset", "cell"], ["place"]),
            helper.make_node("Mul", ["place", "stride"], ["centre"]),
            helper.make_node("Exp", ["log size"], ["cells wide"]),
            helper.make_node("Mul", ["cells wide", "stride"], ["size"]),
            helper.make_node("Concat", ["centre", "size", "scores"], ["decoded"], axis=2),
        ]
    )
    del model.graph.output[:]
    model.graph.output.append(
        helper.make_tensor_value_info("decoded", onnx.TensorProto.FLOAT, (1, len(grid), 85))
    )
    path = tmp_path / "yolox decoded.onnx"
    onnx.save(model, path)
    return path


def test_a_detector_is_recognised_tried_drawn_and_kept(home: Path) -> None:
    said = done("add", data_set(YOLOX))
    assert "yolox_nano.onnx: layout yolox, input BGR, 416 x 416 px, 80 classes." in said
    assert "semap's own picture, 512 x 600 px: 1 person" in said
    kept = json.loads(done("list", "--json"))
    assert [(each["name"], each["layout"]) for each in kept] == [("yolox_nano", "yolox")]
    boxes = decode(CompressedImage(0, "", (home / "detectors" / "yolox_nano" / "boxes.jpg").read_bytes()))
    assert isinstance(boxes, Image)
    picture = own_picture().image.pixels
    assert boxes.pixels.shape == picture.shape
    assert (np.abs(boxes.pixels.astype(int) - picture).max(axis=2) > 100).sum() > 2000  # the frame of a box
    done("remove", "yolox_nano")
    assert json.loads(done("list", "--json")) == []
    assert not (home / "detectors" / "yolox_nano").exists()


def test_a_picture_of_ones_own_and_what_is_found_in_it(tmp_path: Path) -> None:
    picture = data_set("detector") / "coco" / "000000197388.jpg"
    told = json.loads(done("add", data_set(YOLOX), "--picture", picture, "--name", "nano", "--json"))
    assert len(told["boxes"]) == 4
    assert told["boxes"][0]["score"] == pytest.approx(0.861, abs=0.05)
    (tmp_path / "text.jpg").write_text("no picture")
    assert "JPEG" in refused("add", data_set(YOLOX), "--name", "b", "--picture", tmp_path / "text.jpg").remedy
    assert "path" in refused("add", data_set(YOLOX), "--name", "b", "--picture", tmp_path / "none").remedy


def test_an_ambiguous_one_is_refused_with_the_command_that_settles_it(decoded: Path) -> None:
    error = refused(
        "add", decoded, "--name", "settled", "--picture", data_set("detector/coco/000000197388.jpg")
    )
    assert "may be yolov5, yolox-decoded" in str(error)
    assert "yolox-decoded a person at 0.9" in str(error)
    assert "yolov5 nobody" in str(error)
    assert json.loads(done("list", "--json")) == []
    command = shlex.split(error.remedy.removeprefix("Say which: "))
    assert command[:3] == ["semap", "detector", "add"]
    done(*command[2:])
    kept = json.loads(done("list", "--json"))
    assert [(each["name"], each["layout"]) for each in kept] == [("settled", "yolox-decoded")]


def test_on_a_terminal_it_asks(decoded: Path) -> None:
    leader, follower = pty.openpty()
    words = [sys.executable, "-m", "semap_service", "detector", "add", str(decoded), "--name", "asked"]
    with subprocess.Popen(words, stdin=follower, stdout=subprocess.PIPE, text=True) as running:
        os.close(follower)
        os.write(leader, b"nonsense\nyolox-decoded\n")
        said, _ = running.communicate(timeout=60)
        os.close(leader)
    assert running.returncode == 0
    assert "Which layout was it exported with? [yolox-decoded]" in said
    assert "One of yolov5, yolox-decoded [yolox-decoded]" in said
    assert json.loads(done("list", "--json"))[0]["layout"] == "yolox-decoded"


def rows(*boxes: tuple[float, ...]) -> np.ndarray:
    """(1, 5, 2100) as YOLOv8 of one class says it"""
    told = np.zeros((1, 5, 2100), np.float32)
    told[0, :, : len(boxes)] = np.array(boxes).T.reshape(5, -1)
    return told


@pytest.mark.parametrize(
    ("boxes", "says"),
    [
        ([], "it finds nobody in semap's own picture"),
        ([(30, 30, 40, 40, 0.9)], "it finds persons in semap's own picture, but not where one is"),
        (
            [(x * 16 + 8, y * 16 + 8, 12, 12, 0.9) for x in range(18) for y in range(18)],
            "it finds 306 persons",
        ),
    ],
)
def test_who_finds_nobody_where_persons_are_is_suspicious(
    tmp_path: Path, boxes: list[tuple[float, ...]], says: str
) -> None:
    model = constant(tmp_path / "blind.onnx", {"output0": rows(*boxes)}, names="{0: 'person'}")
    error = refused("add", model)
    assert f"suspicious: {says}" in str(error)
    assert "--anyway" in error.remedy
    assert json.loads(done("list", "--json")) == []
    done("add", model, "--anyway")
    assert json.loads(done("list", "--json"))[0]["name"] == "blind"


def test_the_layout_that_would_find_somebody_is_named(tmp_path: Path) -> None:
    """A model that wants colours from 0 to 255, and says so by nothing: of the one kind it is taken for it is blind."""
    left, top, right, bottom = OWN_PERSON_PX
    scale = 320 / 600
    corners = np.array([[[left * scale, top * scale, right * scale, bottom * scale]]], np.float32)
    mean = helper.make_node("ReduceMean", ["images"], ["brightness"], keepdims=0)
    nodes = [
        mean,
        helper.make_node("Div", ["brightness", "full"], ["share"]),
        helper.make_node("Reshape", ["share", "shape"], ["score"]),
        helper.make_node("Concat", ["corners", "score"], ["dets"], axis=2),
    ]
    constants = {
        "full": np.float32(150), "shape": np.array([1, 1, 1]), "corners": corners, "labels": np.zeros((1, 1), np.int64),
    }  # fmt: skip
    graph = helper.make_graph(
        nodes,
        "bright",
        [helper.make_tensor_value_info("images", onnx.TensorProto.FLOAT, (1, 3, 320, 320))],
        [
            helper.make_tensor_value_info("dets", onnx.TensorProto.FLOAT, (1, 1, 5)),
            helper.make_tensor_value_info("labels", onnx.TensorProto.INT64, (1, 1)),
        ],
        [numpy_helper.from_array(np.asarray(array), name) for name, array in constants.items()],
    )
    path = tmp_path / "bright.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    names = tmp_path / "names.txt"
    names.write_text("person\n")
    error = refused("add", path, "--classes", names)
    assert "suspicious: it finds nobody" in str(error)
    command = shlex.split(error.remedy.partition("somebody: ")[2].partition(". ")[0])
    assert command[4:] == ["--layout", "mmdet-yolox", "--classes", str(names)]
    done(*command[2:])


@pytest.mark.parametrize("name", ["../up", "a b", "", ".hidden"])
def test_a_name_that_cannot_be(name: str) -> None:
    assert "--name" in (refused("add", data_set(YOLOX), "--name", name).remedy if name else "--name")


def test_what_there_is_is_not_overwritten_and_what_there_is_not_is_told(tmp_path: Path) -> None:
    done("add", data_set(YOLOX), "--name", "eyes")
    ran = asked("add", data_set(YOLOX), "--name", "eyes")
    assert isinstance(ran.exception, Conflict)
    assert "semap detector remove eyes" in ran.exception.remedy
    ran = asked("remove", "ears")
    assert isinstance(ran.exception, NotFound)
    assert "eyes" in ran.exception.remedy
    assert "no file" in str(refused("add", tmp_path / "none.onnx"))


def test_a_refusal_names_the_options_of_this_command(tmp_path: Path) -> None:
    model = constant(tmp_path / "m.onnx", {"output0": np.zeros((1, 12, 2100), np.float32)})
    remedy = refused("add", model).remedy
    assert "--classes" in remedy
    assert "--camera" not in remedy


def test_its_name_stands_for_it_in_options_and_in_rigs(decoded: Path, tmp_path: Path) -> None:
    classes = tmp_path / "names.txt"
    classes.write_text("\n".join(["person", *(f"thing {n}" for n in range(79))]))
    done("add", decoded, "--layout", "yolox-decoded", "--name", "eyes", "--classes", classes)
    known = added_as(Path("eyes"))
    assert known is not None
    parts = Parts({"image": ("/image",)})
    by_option = rig_of(parts, Wishes(image_model=Path("eyes"))).sensors["/image"]
    file = tmp_path / "rig.yaml"
    file.write_text("sensors: {eye: {kind: camera, topic: /image, detector: eyes}}")
    by_rig = read_rig(file).detecting(None).sensors["eye"]
    for each in (by_option, by_rig):
        assert (each.detector, each.layout, each.classes) == (known.model, "yolox-decoded", known.classes)
    other = rig_of(parts, Wishes(image_model=Path("eyes"), image_layout="yolov5")).sensors["/image"]
    assert other.layout == "yolov5"
    (tmp_path / "eyes").write_bytes(b"a file of that name goes first")
    assert read_rig(file).detecting(None).sensors["eye"].detector == tmp_path / "eyes"
