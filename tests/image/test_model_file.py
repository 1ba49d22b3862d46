"""Files that are no model, or one that cannot be used."""

from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from constant_models import class_columns, write_model
from onnx import TensorProto, helper
from semap_ingest.image import model_file
from semap_ingest.image.detector import ImageDetector
from semap_ingest.sensing.image import Image

from semap.errors import InvalidInput

DETECTOR = class_columns([])
FLOAT = TensorProto.FLOAT


def refused(path: Path, **options: object) -> InvalidInput:
    with pytest.raises(InvalidInput) as caught:
        ImageDetector.open(path, **options)  # type: ignore[arg-type]
    assert caught.value.remedy
    return caught.value


def test_no_file(tmp_path: Path) -> None:
    assert "there is no file" in str(refused(tmp_path / "none.onnx"))
    assert "there is no file" in str(refused(tmp_path))


@pytest.mark.parametrize(
    "content", [b"", b"not a model", b"version https://git-lfs.github.com/spec/v1\n" * 3]
)
def test_no_onnx(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes(content)
    error = refused(path)
    assert "model.onnx: it cannot be loaded" in str(error)
    assert "ONNX" in error.remedy


def test_half_a_model(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.onnx", DETECTOR)
    path.write_bytes(path.read_bytes()[:-5000])
    assert "whole" in refused(path).remedy


def test_a_newer_opset_and_a_newer_format(tmp_path: Path) -> None:
    assert "older opset" in refused(write_model(tmp_path / "new.onnx", DETECTOR, opset=200)).remedy
    assert "older onnx" in refused(write_model(tmp_path / "new.onnx", DETECTOR, ir_version=200)).remedy


def test_weights_that_are_not_there(tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    weights = onnx.numpy_helper.from_array(np.ones((1, 84, 2100), dtype=np.float32), "weights")
    graph = helper.make_graph(
        [helper.make_node("Identity", ["weights"], ["output0"])],
        "external",
        [helper.make_tensor_value_info("images", FLOAT, (1, 3, 320, 320))],
        [helper.make_tensor_value_info("output0", FLOAT, (1, 84, 2100))],
        [weights],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path, save_as_external_data=True, location="model.onnx.data", size_threshold=0)
    assert ImageDetector.open(path).layout.name == "yolov8"
    (tmp_path / "model.onnx.data").unlink()
    assert "beside it" in refused(path).remedy


def test_an_operator_of_one_vendor(tmp_path: Path) -> None:
    for operator, domain in (("YoloLayer_TRT", ""), ("Suppress", "com.vendor")):
        node = helper.make_node(operator, ["images"], ["found"], domain=domain)
        value = helper.make_tensor_value_info("found", FLOAT, (1, 100, 4))
        path = write_model(tmp_path / "trt.onnx", {}, nodes=[node], more_outputs=[value])
        assert "operators of one vendor" in refused(path).remedy


def test_a_model_that_fails_when_it_runs(tmp_path: Path) -> None:
    nodes = [
        helper.make_node("Constant", [], ["shape"], value=onnx.numpy_helper.from_array(np.array([1, 7, -1]))),
        helper.make_node("Reshape", ["images", "shape"], ["output0"]),
    ]
    value = helper.make_tensor_value_info("output0", FLOAT, ("a", "b", "c"))
    path = write_model(
        tmp_path / "model.onnx", {}, input_shape=(1, 3, "h", "w"), nodes=nodes, more_outputs=[value]
    )
    error = refused(path, size_px=(320, 320))
    assert "cannot be run; it has inputs images float[1, 3, h, w]; outputs output0 float[" in str(error)


def test_a_classifier_is_described(tmp_path: Path) -> None:
    path = write_model(
        tmp_path / "resnet.onnx", {"logits": np.zeros((1, 1000), np.float32)}, input_shape=(1, 3, 224, 224)
    )
    assert str(refused(path)) == (
        "resnet.onnx: a classifier, or another model with one list of numbers for an image, and no detector; "
        "it has inputs images float[1, 3, 224, 224]; outputs logits float[1, 1000]"
    )


@pytest.mark.parametrize(
    ("shape", "kind", "words"),
    [
        ((1, 1, 320, 320), FLOAT, "three colours"),
        (("n", "c", "h", "w"), FLOAT, "three colours"),
        ((8, 3, 320, 320), FLOAT, "8 images at once"),
        ((1, 3, 320, 320), TensorProto.INT64, "its image is of int64"),
        ((1, 100), FLOAT, "one image and nothing else"),
        ((3, 320, 320), FLOAT, "one image and nothing else"),
    ],
)
def test_inputs_that_are_no_image(
    tmp_path: Path, shape: tuple[int | str, ...], kind: int, words: str
) -> None:
    path = write_model(tmp_path / "model.onnx", DETECTOR, input_shape=shape, input_type=kind)
    error = refused(path)
    assert words in str(error)
    assert "it has inputs images" in str(error)


def test_an_input_that_nobody_knows(tmp_path: Path) -> None:
    more = helper.make_tensor_value_info("image_shape", FLOAT, (1, 2))
    assert "nothing else" in str(refused(write_model(tmp_path / "m.onnx", DETECTOR, more_inputs=[more])))


@pytest.mark.parametrize("shape", [(1, 3, 320, 320), ("n", 3, "h", "w"), (None, 3, None, None)])
def test_inputs_of_fixed_and_open_size(tmp_path: Path, shape: tuple[int | str | None, ...]) -> None:
    path = write_model(tmp_path / "model.onnx", DETECTOR, input_shape=shape)
    detector = ImageDetector.open(path, size_px=(320, 320))
    assert detector.input.size_px == (320, 320)
    assert len(detector.detect(Image(0, "camera_optical", np.zeros((9, 9, 3), dtype=np.uint8)))) == 0


def test_an_open_size_follows_the_metadata_or_custom(tmp_path: Path) -> None:
    shape = (1, 3, "h", "w")
    path = write_model(tmp_path / "m.onnx", DETECTOR, input_shape=shape, metadata={"imgsz": "[192, 320]"})
    assert ImageDetector.open(path).input.size_px == (320, 192)
    for value in ("", "640", "[1", "['a', 'b']"):
        path = write_model(tmp_path / "m.onnx", DETECTOR, input_shape=shape, metadata={"imgsz": value})
        assert ImageDetector.open(path).input.size_px == (640, 640)


def test_a_fixed_size_cannot_be_changed(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.onnx", DETECTOR)
    assert "not 640 x 320 px" in str(refused(path, size_px=(640, 320)))
    path = write_model(tmp_path / "model.onnx", DETECTOR, input_shape=(1, 3, "h", "w"))
    assert "0 x 320 px" in str(refused(path, size_px=(0, 320)))


@pytest.mark.parametrize("shape", [(1, 320, 320, 3), ("n", "h", "w", 3)])
@pytest.mark.parametrize("kind", [FLOAT, TensorProto.FLOAT16, TensorProto.UINT8])
def test_inputs_of_other_types_and_orders(tmp_path: Path, shape: tuple[int | str, ...], kind: int) -> None:
    path = write_model(tmp_path / "model.onnx", DETECTOR, input_shape=shape, input_type=kind)
    detector = ImageDetector.open(path, size_px=(320, 320))
    assert not detector.input.is_channels_first
    assert len(detector.detect(Image(0, "camera_optical", np.zeros((480, 640, 3), dtype=np.uint8)))) == 0


def test_the_tensor_arrives_at_the_model(tmp_path: Path) -> None:
    """A model whose score is the mean of the input's first channel, red from 0 to 1."""
    nodes = [
        helper.make_node("ReduceMean", ["images"], ["means"], axes=[2, 3], keepdims=0),
        helper.make_node("Constant", [], ["at"], value=onnx.numpy_helper.from_array(np.array([0]))),
        helper.make_node("Gather", ["means", "at"], ["red"], axis=1),
        helper.make_node("Reshape", ["red", "shape"], ["score"]),
        helper.make_node("Constant", [], ["shape"], value=onnx.numpy_helper.from_array(np.array([1, 1, 1]))),
        helper.make_node("Expand", ["score", "many"], ["scores"]),
        helper.make_node("Constant", [], ["many"], value=onnx.numpy_helper.from_array(np.array([1, 1, 300]))),
        helper.make_node(
            "Constant",
            [],
            ["box"],
            value=onnx.numpy_helper.from_array(np.full((1, 4, 300), 100, dtype=np.float32)),
        ),
        helper.make_node("Concat", ["box", "scores"], ["output0"], axis=1),
    ]
    sorted_nodes = [nodes[i] for i in (0, 1, 2, 4, 3, 6, 5, 7, 8)]
    value = helper.make_tensor_value_info("output0", FLOAT, (1, 5, 300))
    path = write_model(
        tmp_path / "mean.onnx",
        {},
        input_shape=(1, 3, 240, 320),
        nodes=sorted_nodes,
        more_outputs=[value],
        metadata={"names": "['person']"},
    )
    pixels = np.full((480, 640, 3), [204, 10, 20], dtype=np.uint8)
    boxes = ImageDetector.open(path).detect(Image(0, "camera_optical", pixels))
    np.testing.assert_allclose(boxes.score, [0.8], atol=1e-3)


def test_threads(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.onnx", DETECTOR)
    for threads in (1, 2):
        options = ImageDetector.open(path, threads=threads).model.session.get_session_options()
        assert (options.intra_op_num_threads, options.inter_op_num_threads) == (threads, 1)
    assert "0 threads" in str(refused(path, threads=0))


def test_a_provider_that_this_onnxruntime_does_not_have(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.onnx", DETECTOR)
    error = refused(path, providers=("NoSuchExecutionProvider", "CPUExecutionProvider"))
    assert "does not have NoSuchExecutionProvider; it has" in str(error)
    assert "no provider" in str(refused(path, providers=()))
    assert ImageDetector.open(path, providers="CPUExecutionProvider").layout.name == "yolov8"


@pytest.mark.skipif(
    "CUDAExecutionProvider" in onnxruntime.get_available_providers(),
    reason="there is no machine without CUDA: hide it",
)
def test_cuda_where_it_is_not(tmp_path: Path) -> None:
    path = write_model(tmp_path / "model.onnx", DETECTOR)
    error = refused(path, providers=("CUDAExecutionProvider", "CPUExecutionProvider"))
    assert "onnxruntime-gpu" in error.remedy
    assert "device" in error.remedy


def test_a_provider_without_a_device_is_not_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """onnxruntime-gpu has CUDA, and goes on with the CPU on a machine without a device."""
    real = onnxruntime.InferenceSession
    monkeypatch.setattr(
        model_file.onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider", model_file.CPU]
    )
    monkeypatch.setattr(
        model_file.onnxruntime,
        "InferenceSession",
        lambda path, options, providers: real(path, options, providers=providers[-1:]),
    )
    path = write_model(tmp_path / "model.onnx", DETECTOR)
    error = refused(path, providers=("CUDAExecutionProvider", "CPUExecutionProvider"))
    assert "CUDAExecutionProvider found no device" in str(error)
    assert "nvidia-smi" in error.remedy
