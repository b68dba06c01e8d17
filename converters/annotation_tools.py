"""Reads what annotation tools write: COCO keypoints and LabelMe files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from pliant.converters.annotations import Annotations, Collector, Mark, picture_in
from pliant.spec.errors import SpecError
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.photo import photo_size

HIDDEN_FLAGS: Final = ("hidden", "occluded")
"""LabelMe's flags that say of a point that it is not seen."""


def is_coco(document: Any) -> bool:
    """Return whether a JSON document is one of COCO annotations."""
    return isinstance(document, dict) and {"images", "annotations"} <= set(document)


def is_labelme(document: Any) -> bool:
    """Return whether a JSON document is a LabelMe file."""
    return isinstance(document, dict) and {"shapes", "imagePath"} <= set(document)


def read_coco(path: Path) -> Annotations:
    """Read COCO keypoints: one annotation for each picture and category.

    A keypoint's third number is 0 (not labelled), 1 (labelled, not visible) or 2 (visible). Points
    have the names that the category gives its keypoints; with several categories,
    `CATEGORY/KEYPOINT`.

    Args:
        path: The JSON file; its pictures are in its folder, in `images/` there, or next to it.

    Raises:
        SpecError: It is damaged, or a picture is not there or of another size.
    """
    document = read_json(path)
    marks = Collector(path)
    pictures: dict[Any, Path] = {}
    for index, image in enumerate(document["images"]):
        where = f"images[{index}]"
        name = _field(image, "file_name", str, path, where)
        # Many tools write annotations/FILE.json next to images/.
        folder = path.parent.parent if path.parent.name == "annotations" else path.parent
        picture = picture_in(folder, name, path, where)
        pictures[image.get("id")] = picture
        marks.add_picture(picture)
        _check_size(picture, image.get("width"), image.get("height"), path, where)
    labelled = [a for a in document["annotations"] if isinstance(a, dict) and a.get("keypoints")]
    if not labelled:
        raise SpecError(
            "the annotations have no keypoints",
            path=path,
            required="annotations with keypoints [x, y, v, …]",
            fix="Export the project as COCO keypoints; boxes and polygons name no points.",
        )
    categories = {c.get("id"): c for c in document.get("categories", []) if isinstance(c, dict)}
    several = len({a.get("category_id") for a in labelled}) > 1
    for index, annotation in enumerate(document["annotations"]):
        if annotation not in labelled:
            continue
        where = f"annotations[{index}]"
        if annotation.get("image_id") not in pictures:
            raise SpecError("an annotation is of no picture of the file", path=path, where=where)
        values = _field(annotation, "keypoints", list, path, where)
        if len(values) % 3 or not all(isinstance(v, int | float) for v in values):
            raise SpecError("keypoints are not triples x, y, v", path=path, where=where)
        category = categories.get(annotation.get("category_id"), {})
        names = category.get("keypoints") or [str(k) for k in range(len(values) // 3)]
        if len(names) != len(values) // 3:
            raise SpecError(
                "the keypoints are not those of the category",
                path=path,
                where=where,
                found=f"{len(values) // 3} keypoints",
                required=f"{len(names)}, as the category names them",
            )
        prefix = f"{category.get('name')}/" if several else ""
        for number, name in enumerate(names):
            u, v, state = values[3 * number : 3 * number + 3]
            if state > 0:
                picture = pictures[annotation["image_id"]]
                mark = Mark(float(u), float(v), state == 2)
                marks.add(picture, f"{prefix}{name}", mark, where)
    return marks.annotations()


def read_labelme(files: Sequence[Path], path: Path) -> Annotations:
    """Read LabelMe files: every shape of type `point` is a mark, named by its label.

    A point with one of the flags `HIDDEN_FLAGS` is not visible; shapes of other types are ignored.

    Args:
        files: The JSON files, one for each picture.
        path: What is imported, for messages.

    Raises:
        SpecError: A file is damaged, or a picture is not there or of another size.
    """
    marks = Collector(path)
    for file in files:
        document = read_json(file)
        name = _field(document, "imagePath", str, file, "imagePath")
        picture = picture_in(file.parent, name, file, "imagePath")
        _check_size(picture, document.get("imageWidth"), document.get("imageHeight"), file, "")
        marks.add_picture(picture)
        for index, shape in enumerate(_field(document, "shapes", list, file, "shapes")):
            where = f"shapes[{index}]"
            if not isinstance(shape, dict) or shape.get("shape_type") != "point":
                continue
            label = _field(shape, "label", str, file, where)
            try:
                ((u, v),) = shape["points"]
                u, v = float(u), float(v)
            except (KeyError, TypeError, ValueError) as error:
                raise SpecError(
                    "a point has no position", path=file, where=where, required="points [[x, y]]"
                ) from error
            flags = shape.get("flags") or {}
            hidden = any(flags.get(flag) for flag in HIDDEN_FLAGS)
            marks.add(picture, label, Mark(u, v, not hidden), where)
    return marks.annotations()


def _field(document: Any, name: str, kind: type, path: Path, where: str) -> Any:
    value = document.get(name) if isinstance(document, Mapping) else None
    if not isinstance(value, kind):
        raise SpecError(
            "a field is missing or of another type",
            path=path,
            where=where,
            found=f"{value!r:.60}",
            required=f"{name}: {kind.__name__}",
        )
    return value


def _check_size(picture: Path, width: Any, height: Any, path: Path, where: str) -> None:
    """Refuse a picture of another size than it was annotated at."""
    size = photo_size(picture)
    if width is not None and height is not None and (width, height) != size:
        raise SpecError(
            "the picture is of another size than it was annotated at",
            path=path,
            where=where or "imageWidth, imageHeight",
            found=f"{picture.name} is {size[0]}x{size[1]}, after its EXIF orientation",
            required=f"{width}x{height}",
            fix="If the tool ignored the EXIF orientation, save the pictures without it (for "
            "example: mogrify -auto-orient) and annotate them again.",
        )
