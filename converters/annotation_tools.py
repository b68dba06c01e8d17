"""Reads what annotation tools write: COCO keypoints and LabelMe files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, FiniteFloat, ValidationError

from pliant.converters.annotations import Annotations, Collector, picture_in
from pliant.spec.errors import SpecError
from pliant.spec.io.photo import photo_size
from pliant.spec.marks import Mark

HIDDEN_FLAGS: Final = ("hidden", "occluded")
"""LabelMe's flags that say of a point that it is not seen."""


_Id = int | str | None


class _Image(BaseModel):
    id: _Id = None
    file_name: str
    width: int | None = None
    height: int | None = None


class _Annotation(BaseModel):
    image_id: _Id = None
    category_id: _Id = None
    keypoints: list[FiniteFloat] | None = None


class _Category(BaseModel):
    id: _Id = None
    name: str = ""
    keypoints: list[str] | None = None


class _Coco(BaseModel):
    images: list[_Image]
    annotations: list[_Annotation]
    categories: list[_Category] = []


class _Shape(BaseModel):
    label: str
    shape_type: str | None = None
    points: list[list[FiniteFloat]]
    flags: dict[str, Any] | None = None


class _LabelMe(BaseModel):
    imagePath: str  # noqa: N815 - the format's names
    imageWidth: int | None = None  # noqa: N815
    imageHeight: int | None = None  # noqa: N815
    shapes: list[_Shape]


Document = TypeVar("Document", bound=BaseModel)


def read_document(path: Path) -> Any:
    """Return a tool's JSON document: of any size, as Python reads it (NaN), with or without a BOM.

    Raises:
        SpecError: It cannot be read, or is not JSON.
    """
    try:
        return json.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise SpecError("the file cannot be read", path=path, found=error.strerror) from None
    except (ValueError, RecursionError) as error:
        raise SpecError(
            "this is not JSON", path=path, found=f"{error!s:.200}", fix="Export the file again."
        ) from None


def is_coco(document: Any) -> bool:
    """Return whether a JSON document is one of COCO annotations, perhaps without its images."""
    if not isinstance(document, dict) or "annotations" not in document:
        return False
    return not {"images", "categories"}.isdisjoint(document)


def is_labelme(document: Any) -> bool:
    """Return whether a JSON document is a LabelMe file, perhaps one that lacks a field."""
    return isinstance(document, dict) and not {"shapes", "imagePath"}.isdisjoint(document)


def read_coco(path: Path, document: Any) -> Annotations:
    """Read COCO keypoints: one annotation for each picture and category.

    A keypoint's third number is 0 (not labelled), 1 (labelled, not visible) or 2 (visible). Points
    have the names that the category gives its keypoints; with several categories,
    `CATEGORY/KEYPOINT`.

    Args:
        path: The JSON file; its pictures are in its folder, in `images/` there, or next to it.
        document: What `read_document` returns of it.

    Raises:
        SpecError: It is damaged, or a picture is not there or of another size.
    """
    coco = _parsed(_Coco, document, path)
    marks = Collector(path)
    pictures = _coco_pictures(coco, path, marks)
    labelled = {k: each for k, each in enumerate(coco.annotations) if each.keypoints}
    if not labelled:
        raise SpecError(
            "the annotations have no keypoints",
            path=path,
            required="annotations with keypoints [x, y, v, …]",
            fix="Export the project as COCO keypoints; boxes and polygons name no points.",
        )
    categories = _coco_categories(coco, path)
    several = len({each.category_id for each in labelled.values()}) > 1
    for index, annotation in labelled.items():
        where = f"annotations[{index}]"
        if annotation.image_id not in pictures:
            raise SpecError(
                "an annotation is of no picture of the file",
                path=path,
                where=f"{where}.image_id",
                found=f"{annotation.image_id!r:.60}",
                required="the id of one of its images",
            )
        if categories and annotation.category_id not in {None, *categories}:
            raise SpecError(
                "an annotation is of no category of the file",
                path=path,
                where=f"{where}.category_id",
                found=f"{annotation.category_id!r:.60}",
                required="the id of one of its categories",
            )
        category = categories.get(annotation.category_id, _Category())
        prefix = f"{category.name}/" if several else ""
        for name, mark in _coco_marks(annotation, category, path, where):
            marks.add(pictures[annotation.image_id], f"{prefix}{name}", mark, where)
    return marks.annotations()


def _coco_pictures(coco: _Coco, path: Path, marks: Collector) -> dict[_Id, Path]:
    """Add the pictures to those that are marked, and return them by id."""
    pictures: dict[_Id, Path] = {}
    described: dict[Path, str] = {}
    for index, image in enumerate(coco.images):
        where = f"images[{index}]"
        # Many tools write annotations/FILE.json next to images/.
        folder = path.parent.parent if path.parent.name == "annotations" else path.parent
        picture = picture_in(folder, image.file_name, path, where)
        if image.id in pictures:
            raise SpecError(
                "two pictures have the same id",
                path=path,
                where=f"{where}.id",
                found=f"{image.id!r:.60}, of {pictures[image.id].name} and {picture.name}",
                required="another id for each picture",
            )
        if picture in described:
            raise SpecError(
                "two images refer to the same picture",
                path=path,
                where=f"{where}.file_name",
                found=f"{image.file_name!r:.60}, read as {picture} like {described[picture]}",
                required="a picture for each image",
                fix="Put the pictures into the folders that file_name says.",
            )
        pictures[image.id], described[picture] = picture, where
        marks.add_picture(picture)
        _check_size(picture, image.width, image.height, path, where)
    return pictures


def _coco_categories(coco: _Coco, path: Path) -> dict[_Id, _Category]:
    """Return the categories by id."""
    categories: dict[_Id, _Category] = {}
    for index, category in enumerate(coco.categories):
        if (first := categories.setdefault(category.id, category)) is not category:
            raise SpecError(
                "two categories have the same id",
                path=path,
                where=f"categories[{index}].id",
                found=f"{category.id!r:.60}, of {first.name} and {category.name}",
                required="another id for each category",
            )
    return categories


def _coco_marks(
    annotation: _Annotation, category: _Category, path: Path, where: str
) -> Iterator[tuple[str, Mark]]:
    """Yield the names and marks of an annotation's labelled keypoints."""
    values = annotation.keypoints or []
    if len(values) % 3:
        raise SpecError(
            "keypoints are not triples x, y, v",
            path=path,
            where=f"{where}.keypoints",
            found=f"{len(values)} numbers",
            required="three numbers for each keypoint",
        )
    names = category.keypoints or [str(k) for k in range(len(values) // 3)]
    if len(names) != len(values) // 3:
        raise SpecError(
            "the keypoints are not those of the category",
            path=path,
            where=where,
            found=f"{len(values) // 3} keypoints",
            required=f"{len(names)}, as the category names them",
        )
    for number, name in enumerate(names):
        u, v, state = values[3 * number : 3 * number + 3]
        if state not in (0, 1, 2):
            raise SpecError(
                "invalid visibility flag of a keypoint",
                path=path,
                where=f"{where}.keypoints[{3 * number + 2}]",
                found=state,
                required="0 (not labelled), 1 (labelled, not visible) or 2 (visible)",
            )
        if state:
            yield name, Mark(u, v, state == 2)


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
    described: dict[Path, Path] = {}
    kinds: set[str] = set()
    for file in files:
        document = _parsed(_LabelMe, read_document(file), file)
        picture = picture_in(file.parent, document.imagePath, file, "imagePath")
        if picture in described:
            raise SpecError(
                "two files describe the same picture",
                path=file,
                where="imagePath",
                found=f"{picture.name}, as in {described[picture].name}",
                fix="Correct imagePath, or delete one of the files.",
            )
        described[picture] = file
        _check_size(picture, document.imageWidth, document.imageHeight, file, "")
        marks.add_picture(picture)
        for index, shape in enumerate(document.shapes):
            where = f"shapes[{index}]"
            kinds.add(f"{shape.shape_type}")
            if shape.shape_type != "point":
                continue
            if [len(each) for each in shape.points] != [2]:
                raise SpecError(
                    "a point is not one position",
                    path=file,
                    where=f"{where}.points",
                    found=f"{shape.points!r:.60}",
                    required="[[x, y]]",
                )
            u, v = shape.points[0]
            hidden = any((shape.flags or {}).get(flag) for flag in HIDDEN_FLAGS)
            marks.add(picture, shape.label, Mark(u, v, not hidden), f"{file.name}, {where}")
    if kinds and "point" not in kinds:
        raise SpecError(
            "the files have no points",
            path=path,
            found=f"shapes of type {', '.join(sorted(kinds))[:60]}",
            required="shapes of type point",
            fix="Mark points in LabelMe: boxes and polygons name no points.",
        )
    return marks.annotations()


def _parsed(kind: type[Document], document: Any, path: Path) -> Document:
    """Return a JSON document as an object.

    Raises:
        SpecError: A field is missing or of another type.
    """
    try:
        return kind.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        missing = first["type"] == "missing"
        place = "".join(
            f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]
        )
        raise SpecError(
            "a field is missing" if missing else "a field is of another type",
            path=path,
            where=place.lstrip("."),
            found=None if missing else f"{first['input']!r:.60}",
            required=None if missing else first["msg"].removeprefix("Input should be "),
        ) from None


def _check_size(
    picture: Path, width: int | None, height: int | None, path: Path, where: str
) -> None:
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
