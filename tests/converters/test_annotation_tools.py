"""What COCO and LabelMe say comes out, and damaged files are one sentence."""

from __future__ import annotations

import json
import math
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from pliant.converters import read_source
from pliant.spec.errors import SpecError
from pliant.spec.io.limits import MAX_JSON_BYTES
from tests.conformance.edits import change_document
from tests.converters.conftest import Rejected
from tests.converters.importing import asked, imported
from tests.converters.test_pictures import photographs


def coco() -> dict[str, Any]:
    shown = {"a b.JPG": (40, 30), "b.tif": (20, 30), "ç.webp": (80, 20)}
    images = [
        {"id": 7 + k, "file_name": name, "width": w, "height": h}
        for k, (name, (w, h)) in enumerate(shown.items())
    ]
    points = [[4.5, 6, 2, 39.5, 29.5, 2], [10, 30, 1, 2.25, 8, 2], [60, 10, 2, 0, 0, 0]]
    annotations = [
        {"image_id": 7 + k, "category_id": 1, "keypoints": values}
        for k, values in enumerate(points)
    ]
    category = {"id": 1, "name": "rope", "keypoints": ["ball", "end"]}
    return {"images": images, "annotations": annotations, "categories": [category]}


COCO_ROWS = {
    (0, 4.5, 6.0, 1, 10.0, 30.0, "out_of_frame"),
    (0, 4.5, 6.0, 2, 60.0, 10.0, "visible"),
    (0, 39.5, 29.5, 1, 2.25, 8.0, "visible"),
    (1, 2.25, 8.0, 0, 39.5, 29.5, "visible"),
    (2, 60.0, 10.0, 0, 4.5, 6.0, "visible"),
    (2, 60.0, 10.0, 1, 10.0, 30.0, "out_of_frame"),
}


def test_coco_keypoints(tmp_path: Path) -> None:
    folder = photographs(tmp_path / "photos")
    (folder / "export.json").write_text(json.dumps(coco()))
    dataset = imported(folder, tmp_path / "out")
    assert asked(tmp_path / "out") == COCO_ROWS
    assert dataset.info["provenance"]["config"]["points"] == ["ball", "end"]
    imported(folder / "export.json", tmp_path / "index", "--pixels", "index")
    assert (0, 5.0, 6.5, 2, 60.5, 10.5, "visible") in asked(tmp_path / "index")


def test_coco_files_as_tools_write_them(tmp_path: Path) -> None:
    """With a byte order mark and NaN, through a link, larger than a file of the specification."""
    folder = photographs(tmp_path / "photos")
    unread = {"info": {"score": math.nan}, "licence": "A" * MAX_JSON_BYTES}
    (tmp_path / "export.json").write_text(json.dumps(coco() | unread), encoding="utf-8-sig")
    (folder / "export.json").symlink_to(tmp_path / "export.json")
    imported(folder, tmp_path / "out")
    assert asked(tmp_path / "out") == COCO_ROWS
    (folder / "export.json").unlink()
    (folder / "export.json").write_text('{"images": [')
    with pytest.raises(SpecError, match=r"export\.json: this is not JSON"):
        read_source(folder)


def labelme(folder: Path) -> None:
    for image, annotation in zip(coco()["images"], coco()["annotations"], strict=True):
        values = annotation["keypoints"]
        shapes: list[dict[str, Any]] = [
            {
                "label": label,
                "shape_type": "point",
                "points": [values[3 * k : 3 * k + 2]],
                "flags": {"hidden": values[3 * k + 2] == 1},
            }
            for k, label in enumerate(("ball", "end"))
            if values[3 * k + 2]
        ]
        shapes.append({"label": "rope", "shape_type": "polygon", "points": [[0, 0], [1, 1]]})
        document = {
            "imagePath": f"..\\elsewhere\\{image['file_name']}",
            "imageWidth": image["width"],
            "imageHeight": image["height"],
            "shapes": shapes,
        }
        (folder / f"{image['id']}.json").write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("number", "changes", "said"),
    [
        (8, {"imagePath": "a b.JPG"}, "8.json, imagePath: two files describe the same picture"),
        (8, {"shapes.0.points": [[2.0, 8.0, 1.0]]}, "[0].points: a point is not one position"),
        (8, {"shapes.0.label": ""}, "8.json, shapes[0]: the point has no name"),
        (8, "imagePath", "8.json, imagePath: a field is missing"),
        (8, "shapes", "8.json, shapes: a field is missing"),
        (None, {}, "the files have no points; found shapes of type polygon"),
    ],
)
def test_broken_labelme_files_are_named(
    number: int | None,
    changes: dict[str, Any] | str,
    said: str,
    tmp_path: Path,
    rejected: Rejected,
) -> None:
    folder = photographs(tmp_path / "photos")
    labelme(folder)
    for file in folder.glob("*.json"):
        document = json.loads(file.read_text())
        if number is None:
            document["shapes"] = document["shapes"][-1:]  # the polygon
        elif file.stem == str(number):
            edit = {"delete": [changes]} if isinstance(changes, str) else {"set": changes}
            change_document(document, **edit)
        file.write_text(json.dumps(document))
    assert said in rejected(folder)


def test_labelme_files(tmp_path: Path) -> None:
    folder = photographs(tmp_path / "photos")
    labelme(folder)
    imported(folder, tmp_path / "out")
    assert asked(tmp_path / "out") == COCO_ROWS


def test_pictures_inside_labelme_files_are_not_kept(tmp_path: Path) -> None:
    """LabelMe stores a picture in its file: those of a hundred photographs are a gigabyte."""
    for number in range(12):
        Image.new("RGB", (40, 30)).save(tmp_path / f"{number}.png")
        shape = {"label": "ball", "shape_type": "point", "points": [[4.5, 6]]}
        data = "A" * 2**20
        document = {"imagePath": f"{number}.png", "imageData": data, "shapes": [shape]}
        (tmp_path / f"{number}.json").write_text(json.dumps(document))
    tracemalloc.start()
    try:
        read_source(tmp_path)
        assert tracemalloc.get_traced_memory()[1] < 8 * 2**20
    finally:
        tracemalloc.stop()
