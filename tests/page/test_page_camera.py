"""A fixed camera is placed on the page: what is downloaded, the reader of rigs takes, and it says where a pixel lies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from measured import PHONE, in_every_theme
from numpy.typing import NDArray
from playwright.sync_api import Locator, Page, expect
from scipy.spatial.transform import Rotation
from semap_ingest.fusion.camera_model import unproject
from semap_ingest.pipeline.rig import CameraEntry, read_rig
from served import Office

SIZE = (1280, 720)
FOCAL_PX = 700.0
EYE_M = np.array([0.3, 0.4, 2.5])
TURN = Rotation.from_euler("ZY", [0.55, 0.42]).as_matrix() @ [[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]
FLOOR_M = [(6.0, 0.0), (6.0, 4.0), (8.0, 4.0), (8.0, 0.0)]
"""Corners of rooms that it sees."""
SOMEWHERE_M = np.array([[3.0, 2.0], [5.5, 3.0], [4.0, 1.0]])
RED = (210, 40, 40)

Points = NDArray[np.float64]


def seen(places_m: Points) -> Points:
    in_camera = (np.column_stack([places_m, np.zeros(len(places_m))]) - EYE_M) @ TURN
    return FOCAL_PX * in_camera[:, :2] / in_camera[:, 2:] + np.array(SIZE) / 2


PIXELS = seen(np.array(FLOOR_M))


def picture() -> bytes:
    """The kitchen's floor in tiles of a metre, with a red one from (3, 2) to (4, 3)."""
    shown = np.full((SIZE[1], SIZE[0], 3), 170, np.uint8)
    for x in range(1, 8):
        for y in range(7):
            corners = seen(np.array([[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]], np.float64))
            colour = RED[::-1] if (x, y) == (3, 2) else (235, 235, 235) if (x + y) % 2 else (90, 110, 90)
            cv2.fillConvexPoly(shown, np.round(corners).astype(np.int32), colour)
    return cv2.imencode(".png", shown)[1].tobytes()


def placed(path: Path, pixels: Points) -> Points:
    """Where on the floor the camera of a rig sees pixels."""
    (camera,) = read_rig(path).sensors.values()
    assert isinstance(camera, CameraEntry)
    assert camera.calibration is not None
    assert camera.mount is not None
    hung = camera.mount.transform("camera")
    rays = unproject(pixels, camera.calibration.camera()) @ Rotation.from_quat(hung.quaternion).as_matrix().T
    eye_m = np.asarray(hung.translation_m)
    return np.asarray(eye_m[:2] - rays[:, :2] / rays[:, 2:] * eye_m[2])


def opened(page: Page, office: Office) -> Locator:
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    page.locator("#tab-edit").click()
    page.get_by_text("Fixed cameras").click()
    page.get_by_role("button", name="Place a camera…").click()
    dialog = page.get_by_role("dialog", name="Place a camera")
    with page.expect_file_chooser() as chooser:
        dialog.get_by_role("button", name="Choose a picture…").click()
    chooser.value.set_files({"name": "kitchen.png", "mimeType": "image/png", "buffer": picture()})
    expect(dialog.get_by_role("img", name="kitchen.png")).to_be_visible()
    return dialog


def fill(dialog: Locator, pixels: Points, places_m: list[tuple[float, float]]) -> None:
    """Points as numbers; those that are missing are added first."""
    points = dialog.get_by_role("list", name="Points").get_by_role("listitem")
    while points.count() < len(pixels):
        count = points.count()
        dialog.get_by_role("button", name="Add a point in the middle").click()
        expect(points).to_have_count(count + 1)
    for number, told in enumerate(zip(pixels.tolist(), places_m, strict=True), start=1):
        for where, at in zip(("in the picture", "on the plan"), told, strict=True):
            for axis, value in zip("xy", at, strict=True):
                dialog.get_by_label(f"{axis} of point {number} {where}").fill(str(round(value, 2)))


def number_in(dialog: Locator, label: str) -> float:
    return float(dialog.get_by_label(label).input_value())


def click_at(page: Page, pane: Locator, right: float, down: float) -> None:
    box = pane.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + right * box["width"], box["y"] + down * box["height"])


def test_the_rig_of_the_page_places_pixels(
    page: Page, office: Office, tmp_path: Path, look: Callable[[str], list[str]]
) -> None:
    page.set_viewport_size({"width": 1280, "height": 1400})
    dialog = opened(page, office)
    told = dialog.get_by_role("status", name="What the points tell")
    expect(told).to_contain_text("4 points are missing")
    shown = dialog.get_by_role("img", name="kitchen.png")
    plan = dialog.get_by_role("region", name="Plan").locator("svg")
    for (u, v), (x, y) in zip(PIXELS.tolist(), FLOOR_M, strict=True):
        click_at(page, shown, u / SIZE[0], v / SIZE[1])
        # Eight centimetres beside a corner; the plan has a metre more than the office on each side.
        click_at(page, plan, (x + 0.08 + 1) / 16, (10.5 - y) / 11.5)
    for number, place in enumerate(FLOOR_M, start=1):
        assert [number_in(dialog, f"{axis} of point {number} on the plan") for axis in "xy"] == list(place)
        clicked = [number_in(dialog, f"{axis} of point {number} in the picture") for axis in "xy"]
        np.testing.assert_allclose(clicked, PIXELS[number - 1], atol=2.5)
    expect(told).to_contain_text("above the floor at")

    fill(dialog, PIXELS, FLOOR_M)
    expect(told).to_contain_text("The camera hangs 2.50 m above the floor at 0.30, 0.40")
    expect(dialog.get_by_role("list", name="Points").get_by_text("0.0 px off")).to_have_count(4)
    dialog.get_by_label("Name of the camera").fill('kitchen: "west"')
    with page.expect_download() as download:
        dialog.get_by_role("button", name="Download").click()
    rig = tmp_path / "rig.yaml"
    download.value.save_as(rig)
    assert rig.read_text() == dialog.get_by_role("region", name="Part of a rig").locator("pre").inner_text()
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    dialog.get_by_role("button", name="Copy").click()
    expect(dialog.get_by_text("Copied.")).to_be_visible()
    assert page.evaluate("navigator.clipboard.readText()") == rig.read_text()
    assert list(read_rig(rig).sensors) == ['kitchen: "west"']
    np.testing.assert_allclose(placed(rig, seen(SOMEWHERE_M)), SOMEWHERE_M, atol=0.02)

    colour = page.evaluate(
        "([x, y]) => { const it = document.querySelector('.pane canvas'); return [...it.getContext('2d')"
        ".getImageData(x * it.width, y * it.height, 1, 1).data]; }",
        [(3.5 + 1) / 16, (10.5 - 2.5) / 11.5],
    )
    assert colour == [*RED, 255]
    assert look("placed") == []

    dialog.get_by_label("Persons are found in images of a width of [px]").fill("640")
    with page.expect_download() as download:
        dialog.get_by_role("button", name="Download").click()
    download.value.save_as(rig)
    np.testing.assert_allclose(placed(rig, seen(SOMEWHERE_M) / 2), SOMEWHERE_M, atol=0.03)


DROP = """(dialog, data) => {
    const files = new DataTransfer();
    files.items.add(new File([Uint8Array.from(data)], "dropped.png", {type: "image/png"}));
    const options = {dataTransfer: files, bubbles: true, cancelable: true};
    for (const type of ["dragenter", "dragover", "drop"]) dialog.dispatchEvent(new DragEvent(type, options));
}"""


def test_a_picture_that_is_dropped_is_taken(page: Page, office: Office) -> None:
    dialog = opened(page, office)
    dialog.evaluate(DROP, list(picture()))
    expect(dialog.get_by_role("img", name="dropped.png")).to_be_visible()
    dialog.get_by_role("button", name="Close").click()
    page.locator("#tab-import").click()
    expect(page.get_by_role("list", name="Imports").get_by_role("listitem")).to_have_count(0)


def test_points_are_moved_and_kept(page: Page, office: Office) -> None:
    page.set_viewport_size({"width": 1280, "height": 1400})
    dialog = opened(page, office)
    fill(dialog, PIXELS, FLOOR_M)
    point = dialog.get_by_role("button", name="Point 1 on the plan")
    point.hover()
    plan = dialog.get_by_role("region", name="Plan").locator("svg").bounding_box()
    assert plan is not None
    page.mouse.down()
    to = (plan["x"] + plan["width"] * (3 + 1) / 16, plan["y"] + plan["height"] * (10.5 - 2) / 11.5)
    page.mouse.move(*to, steps=3)
    page.mouse.up()
    dragged = [number_in(dialog, f"{axis} of point 1 on the plan") for axis in "xy"]
    np.testing.assert_allclose(dragged, [3, 2], atol=0.05)
    expect(dialog.get_by_role("list", name="Points").get_by_role("listitem")).to_have_count(4)
    mark = dialog.get_by_role("button", name="Point 2 in the picture")
    before = number_in(dialog, "x of point 2 in the picture")
    mark.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    expect(dialog.get_by_label("x of point 2 in the picture")).to_have_value(f"{before + 11:g}")
    dialog.get_by_role("button", name="Point 2 on the plan").focus()
    page.keyboard.press("ArrowUp")
    expect(dialog.get_by_label("y of point 2 on the plan")).to_have_value("4.01")
    dialog.get_by_role("button", name="Close").click()
    page.get_by_role("button", name="Place a camera…").click()
    assert number_in(dialog, "y of point 2 on the plan") == 4.01
    dialog.get_by_role("button", name="Point 2 on the plan").focus()
    page.keyboard.press("Delete")
    expect(dialog.get_by_role("status", name="What the points tell")).to_contain_text("One point is missing")
    expect(dialog.get_by_role("region", name="Part of a rig")).to_have_count(0)


def test_a_line_and_a_mirror_are_refused(page: Page, office: Office) -> None:
    dialog = opened(page, office)
    told = dialog.get_by_role("status", name="What the points tell")
    line = [(2.0, 2.0), (4.0, 2.0), (6.0, 2.0), (5.0, 3.0)]
    fill(dialog, seen(np.array(line)), line)
    expect(told).to_contain_text("lie on one line")
    fill(dialog, PIXELS, [(14 - x, y) for x, y in FLOOR_M])
    expect(told).to_contain_text("mirror image")
    fill(dialog, PIXELS[[1, 0, 2, 3]], FLOOR_M)
    expect(told).to_contain_text("cross one another")
    expect(dialog.get_by_role("region", name="Part of a rig")).to_have_count(0)
    fill(dialog, PIXELS, FLOOR_M)
    expect(told).to_contain_text("The camera hangs 2.50 m")


def test_a_file_that_is_no_picture_is_refused(page: Page, office: Office) -> None:
    dialog = opened(page, office)
    dialog.get_by_label("Picture of the camera").set_input_files(
        {"name": "notes.png", "mimeType": "image/png", "buffer": b"no picture"}
    )
    expect(dialog.get_by_role("alert")).to_contain_text("notes.png is no picture")
    expect(dialog.get_by_role("img", name="kitchen.png")).to_be_visible()


@pytest.mark.parametrize("size", [PHONE], ids=["phone"])
@in_every_theme
def test_a_phone_places_it_as_well(page: Page, office: Office, look: Callable[[str], list[str]]) -> None:
    dialog = opened(page, office)
    fill(dialog, PIXELS, FLOOR_M)
    expect(dialog.get_by_role("status", name="What the points tell")).to_contain_text(
        "The camera hangs 2.50 m"
    )
    assert look("placed") == []
    dialog.get_by_role("button", name="Download").scroll_into_view_if_needed()
    assert look("end") == []
