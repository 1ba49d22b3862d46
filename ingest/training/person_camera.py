"""Train the person detector of the simulated camera and write it as ONNX.

    python -m ingest.training.person_camera FOLDER    (from the repository's root, with PyTorch and onnx)

Images are rendered into FOLDER at the first run (`person_scenes`, one place for each of TRAINING_SEEDS). The
network is fully convolutional and has no anchors: each cell of a grid of 8 px (small persons) and of one of
16 px (tall ones) says how likely it is near the middle of a person and how far the sides of the box are, as
in FCOS (Tian et al. 2019). Scores learn the overlap of the box that they come with, as in the generalized
focal loss of Li et al. 2020.
"""

from __future__ import annotations

import argparse
import copy
import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from torch import Tensor, nn
from torch.nn import functional

from ingest.training.person_figures import LEAST_VISIBLE, MODEL
from ingest.training.person_scenes import HEIGHT_PX, TRAINING_SEEDS, WIDTH_PX, Samples, samples

STRIDES_PX = (8, 16)
HEIGHTS_PX = ((0.0, 80.0), (60.0, math.inf))
"""Of persons that each grid learns; in between both do."""

GONE = 0.02
"""Persons of whom less is seen are not there."""

NEAR_CELLS = 1.5
"""How far from the middle of a box cells learn it."""


class Convolution(nn.Sequential):
    def __init__(self, inputs: int, outputs: int, stride: int = 1, size: int = 3) -> None:
        super().__init__(
            nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(),
        )


class Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.inner = Convolution(channels, channels)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.inner(x)


class PersonNetwork(nn.Module):
    """(b, 3, HEIGHT_PX, WIDTH_PX) RGB 0 to 1 -> (b, 5, cells): cx, cy, w, h [px], logit of the score.

    The receptive field of the coarser grid covers the whole image, so that the feet of a person that fills it
    are seen from the middle of the body.
    """

    def __init__(self) -> None:
        super().__init__()
        self.to_8 = nn.Sequential(
            Convolution(3, 16, 2), Convolution(16, 24, 2), Convolution(24, 40, 2), Residual(40)
        )
        self.to_16 = nn.Sequential(Convolution(40, 64, 2), Residual(64), Residual(64))
        self.to_32 = nn.Sequential(Convolution(64, 80, 2), Residual(80), Residual(80))
        self.down_32 = nn.Conv2d(80, 64, 1)
        self.down_16 = nn.Conv2d(64, 40, 1)
        self.head_8 = nn.Sequential(Convolution(40, 40), Convolution(40, 40), nn.Conv2d(40, 5, 1))
        self.head_16 = nn.Sequential(Convolution(64, 64), Convolution(64, 64), nn.Conv2d(64, 5, 1))
        for head in (self.head_8, self.head_16):
            nn.init.constant_(head[-1].bias[4], -5.0)
        for name, stride in (("cells_8", 8), ("cells_16", 16)):
            self.register_buffer(name, _cells(stride), persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        fine = self.to_8(images)
        middle = self.to_16(fine)
        coarse = self.to_32(middle)
        middle = middle + _doubled(self.down_32(coarse), middle)
        fine = fine + _doubled(self.down_16(middle), fine)
        grids = ((self.head_8(fine), self.cells_8, 8), (self.head_16(middle), self.cells_16, 16))
        return torch.cat(
            [_decoded(raw.flatten(2).float(), cells, stride) for raw, cells, stride in grids], dim=2
        )


class Scored(nn.Module):
    """The network as it is shipped: scores 0 to 1."""

    def __init__(self, network: PersonNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, images: Tensor) -> Tensor:
        found = self.network(images)
        return torch.cat([found[:, :4], found[:, 4:].sigmoid()], dim=1)


def _cells(stride: int) -> Tensor:
    """(1, 2, n), middles of the cells [px], row by row."""
    y, x = torch.meshgrid(
        torch.arange(stride / 2, HEIGHT_PX, stride), torch.arange(stride / 2, WIDTH_PX, stride), indexing="ij"
    )
    return torch.stack([x.flatten(), y.flatten()])[None]


def _doubled(coarse: Tensor, fine: Tensor) -> Tensor:
    return functional.interpolate(coarse, scale_factor=2)[:, :, : fine.shape[2], : fine.shape[3]]


def _decoded(raw: Tensor, cells: Tensor, stride: int) -> Tensor:
    sides = torch.exp(raw[:, :4].clamp(-4, 4)) * stride
    low, high = cells - sides[:, :2], cells + sides[:, 2:]
    return torch.cat([(low + high) / 2, high - low, raw[:, 4:]], dim=1)


def targets(box: Tensor, visible: Tensor, network: PersonNetwork) -> tuple[Tensor, Tensor]:
    """Which person each cell learns, for one image.

    box, visible  (m, 4) corners [px] and (m,)
    returns       (cells,) int64: number of the person, -1 none, -2 not to be learnt; (cells, 4) its corners
    """
    chosen, middle = [], (box[:, :2] + box[:, 2:]) / 2
    height = box[:, 3] - box[:, 1]
    wanted = (visible >= LEAST_VISIBLE) & ((box[:, 2] - box[:, 0]) > 3) & (height > 8)
    for stride, cells, heights in zip(
        STRIDES_PX, (network.cells_8[0].T, network.cells_16[0].T), HEIGHTS_PX, strict=True
    ):
        owner = torch.full((len(cells),), -1)
        inside = ((cells[:, None] > box[None, :, :2]) & (cells[:, None] < box[None, :, 2:])).all(dim=2)
        owner[(inside & (~wanted & (visible > GONE))[None]).any(dim=1)] = -2
        near = ((cells[:, None] - middle[None]).abs() < NEAR_CELLS * stride).all(dim=2) & inside
        fits = wanted & (height >= heights[0]) & (height < heights[1])
        # farther persons first, so that of two the nearer one, whose feet are lower, stays
        for person in torch.argsort(box[:, 3]).tolist():
            if fits[person]:
                owner[near[:, person]] = person
            elif wanted[person]:
                owner[near[:, person] & (owner == -1)] = -2
        chosen.append(owner)
    owner = torch.cat(chosen)
    corners = box[owner.clamp(min=0)] if len(box) else torch.zeros(len(owner), 4)
    return owner, corners


def loss(found: Tensor, owner: Tensor, corners: Tensor) -> Tensor:
    """found (b, 5, cells), owner (b, cells), corners (b, cells, 4)"""
    is_person = owner >= 0
    middle, size, logit = found[:, :2], found[:, 2:4], found[:, 4]
    boxes = torch.cat([middle - size / 2, middle + size / 2], dim=1).transpose(1, 2)[is_person]
    true = corners[is_person]
    overlap, generalized = _overlap(boxes, true)
    aim = torch.zeros_like(logit)
    aim[is_person] = overlap.detach()
    weight = (aim - logit.sigmoid()).abs().detach() ** 2
    weight = torch.where(is_person, weight.clamp(min=0.1), weight) * (owner != -2)
    score = functional.binary_cross_entropy_with_logits(logit, aim, weight, reduction="sum")
    scale = (true[:, 2:] - true[:, :2]).clamp(min=1).repeat(1, 2)
    sides = functional.smooth_l1_loss(boxes / scale, true / scale, beta=0.05, reduction="none").sum(dim=1)
    return (score + (2 * (1 - generalized) + sides).sum()) / is_person.sum().clamp(min=1)


def _overlap(boxes: Tensor, true: Tensor) -> tuple[Tensor, Tensor]:
    """Intersection over union, and the generalized one of Rezatofighi et al. 2019."""
    common = (torch.minimum(boxes[:, 2:], true[:, 2:]) - torch.maximum(boxes[:, :2], true[:, :2])).clamp(
        min=0
    )
    around = torch.maximum(boxes[:, 2:], true[:, 2:]) - torch.minimum(boxes[:, :2], true[:, :2])
    both = common.prod(dim=1)
    union = (boxes[:, 2:] - boxes[:, :2]).prod(dim=1) + (true[:, 2:] - true[:, :2]).prod(dim=1) - both
    overlap = both / union.clamp(min=1e-6)
    whole = around.prod(dim=1).clamp(min=1e-6)
    return overlap, overlap - (whole - union) / whole


def augmented(
    pixels: np.ndarray, box: np.ndarray, visible: np.ndarray, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mirrored and cut out; of persons who are partly cut off less is visible."""
    if generator.random() < 0.5:
        pixels = pixels[:, ::-1]
        # whole numbers are the middles of a pixel of the camera's image, of which two make one here
        box = np.column_stack([WIDTH_PX - 0.5 - box[:, 2], box[:, 1], WIDTH_PX - 0.5 - box[:, 0], box[:, 3]])
    if generator.random() < 0.5:
        scale = generator.uniform(0.75, 1.4)
        spare = np.array([WIDTH_PX, HEIGHT_PX]) * (1 - scale)
        shift = generator.uniform(0, 1, 2) * spare
        matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
        pixels = cv2.warpAffine(
            np.ascontiguousarray(pixels), matrix, (WIDTH_PX, HEIGHT_PX), borderValue=(114,) * 3
        )
        moved = box * scale + np.tile(shift, 2)
        cut = np.clip(moved, 0, np.tile([WIDTH_PX, HEIGHT_PX], 2))
        area, left = ((b[:, 2:] - b[:, :2]).prod(axis=1) for b in (moved, cut))
        box, visible = cut, visible * np.where(left > 0, left / np.maximum(area, 1e-6), 0)
    return pixels, box, visible


def exposed(pixels: list[np.ndarray], generator: np.random.Generator) -> Tensor:
    """(b, 3, height, width) 0 to 1, some brighter and some darker."""
    images = torch.from_numpy(np.stack(pixels)).permute(0, 3, 1, 2).float() / 255
    gain, offset = (
        torch.from_numpy(generator.uniform(low, high, (len(pixels), 1, 1, 1))).float()
        for low, high in ((0.75, 1.25), (-0.06, 0.06))
    )
    return (images * gain + offset).clamp(0, 1)


def train(data: Samples, epochs: int, batch: int = 32) -> Iterator[PersonNetwork]:
    """The network after each epoch, its weights averaged over the last steps."""
    torch.manual_seed(1)
    generator = np.random.default_rng(1)
    network = PersonNetwork().to(memory_format=torch.channels_last)
    average = torch.optim.swa_utils.AveragedModel(network, avg_fn=_following, use_buffers=True)
    steps = epochs * (len(data.pixels) // batch)
    optimizer = torch.optim.AdamW(network.parameters(), lr=2e-3, weight_decay=0.01)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=steps, pct_start=0.1)
    of_image = [np.flatnonzero(data.image == k) for k in range(len(data.pixels))]
    for epoch in range(epochs):
        order, total = generator.permutation(len(data.pixels)), 0.0
        for first in range(0, len(order) - batch + 1, batch):
            images, owners, corners = [], [], []
            for k in order[first : first + batch]:
                mine = of_image[k]
                image, box, visible = augmented(
                    data.pixels[k], data.box_px[mine], data.visible[mine], generator
                )
                owner, corner = targets(torch.tensor(box).float(), torch.tensor(visible).float(), network)
                images.append(image)
                owners.append(owner)
                corners.append(corner)
            with torch.autocast("cpu", torch.bfloat16):
                found = network(exposed(images, generator))
            error = loss(found, torch.stack(owners), torch.stack(corners))
            optimizer.zero_grad(set_to_none=True)
            error.backward()
            nn.utils.clip_grad_norm_(network.parameters(), 10.0)
            optimizer.step()
            schedule.step()
            average.update_parameters(network)
            total += float(error.detach())
        print(f"epoch {epoch + 1} of {epochs}: loss {total / (len(order) // batch):.3f}", flush=True)  # noqa: T201
        yield copy.deepcopy(average.module)


def _following(average: Tensor, now: Tensor, count: Tensor) -> Tensor:
    """The exponential average of weights, which at first forgets faster."""
    return average + (now - average) * max(0.005, 5 / (10 + int(count)))


def export(network: PersonNetwork, path: Path) -> None:
    """Output and metadata are as those of YOLOv8: [1, 4 + 1, cells], cx cy w h [px], score."""
    shipped = Scored(network.to(memory_format=torch.contiguous_format)).eval()
    example = torch.zeros(1, 3, HEIGHT_PX, WIDTH_PX)
    torch.onnx.export(
        shipped, (example,), str(path), input_names=["images"], output_names=["output0"], opset_version=17,
        dynamo=False,
    )  # fmt: skip
    model = onnx.load(str(path))
    about = {
        "names": "{0: 'person'}",
        "description": "Persons as semap's simulator renders them",
        "license": "Apache-2.0",
    }
    onnx.helper.set_model_props(model, about)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def rendered(folder: Path, seeds: range) -> Samples:
    """From the folder, or rendered into it."""
    path = folder / f"places_{seeds.start}_{seeds.stop}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        parts = [seeds[k : k + 10] for k in range(0, len(seeds), 10)]
        with ProcessPoolExecutor(2) as pool:
            done = list(pool.map(samples, parts))
        starts = np.cumsum([0] + [len(part.pixels) for part in done[:-1]])
        np.savez(
            path,
            pixels=np.concatenate([part.pixels for part in done]),
            image=np.concatenate([part.image + start for part, start in zip(done, starts, strict=True)]),
            box_px=np.concatenate([part.box_px for part in done]),
            visible=np.concatenate([part.visible for part in done]),
        )
    with np.load(path) as file:
        return Samples(file["pixels"], file["image"], file["box_px"], file["visible"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path, help="where the rendered images are kept (1.2 GB)")
    parser.add_argument("--epochs", type=int, default=12)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--model", type=Path, default=MODEL)
    chosen = parser.parse_args()
    torch.set_num_threads(chosen.threads)
    for network in train(rendered(chosen.folder, TRAINING_SEEDS), chosen.epochs):
        export(network, chosen.model)


if __name__ == "__main__":
    main()
