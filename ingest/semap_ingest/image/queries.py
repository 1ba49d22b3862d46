"""Decoders of RT-DETR and its kin: transformers with one box for each of their queries, each thing once."""

from __future__ import annotations

from scipy.special import expit

from semap_ingest.image.candidates import (
    Candidates,
    Choice,
    Outputs,
    best_classes,
    corners_around,
    corners_of_input,
)


def decode_boxes_and_scores(outputs: Outputs, choice: Choice) -> Candidates:
    """Boxes (1, n, 4) centre x, y, width, height from 0 to 1, scores (1, n, classes) from 0 to 1."""
    best = best_classes(outputs[1][0].T, choice)
    return best.boxed(corners_around(outputs[0][0, best.rows]) * corners_of_input(choice))


def decode_boxes_and_logits(outputs: Outputs, choice: Choice) -> Candidates:
    """The same with scores before the sigmoid."""
    return decode_boxes_and_scores([outputs[0], expit(outputs[1])], choice)


def decode_joined(outputs: Outputs, choice: Choice) -> Candidates:
    """The same in one output, (1, n, 4 + classes)."""
    return decode_boxes_and_scores([outputs[0][..., :4], outputs[0][..., 4:]], choice)
