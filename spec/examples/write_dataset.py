"""Write the dataset of SPEC.md's walkthrough, and answers to it, without Pliant.

Usage: python write_dataset.py DATASET ANSWERS.parquet

A square card, 15 cm wide, printed alike from both ends, is seen from 0.5 m above in two frames.
`write_dataset.mjs` writes the same dataset in JavaScript.
"""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

WIDTH, HEIGHT, FOCAL_PX, CAMERA_M, SIDE_M = 64, 48, 100.0, 0.5, 0.15
SIZE = {"width": WIDTH, "height": HEIGHT}
POSES = [(0.96, 0.28, 0.0, 0.0), (0.28, 0.96, 0.1, 0.02)]  # cos, sin, x_m, y_m of each frame
GRID = (0.125, 0.5, 0.875)  # material coordinates of the 3 x 3 points
ORDER = [4, 0, 7, 2, 8, 5, 1, 6, 3]  # the queries, in random order
NAME, VERSION = {"id": "card", "version": "1.0.0"}, "1.0.0"
CONVENTIONS = {
    "pixel_origin": "top_left_corner",
    "first_pixel_centre": [0.5, 0.5],
    "pixel_axes": {"u": "right", "v": "down"},
    "camera_axes": {"x": "right", "y": "down", "z": "forward"},
    "pose": "world_to_camera",
    "length_unit": "m",
    "angle_unit": "rad",
    "depth": "planar_z",
    "depth_background": "+inf",
    "colour_space": "sRGB",
    "visibility_states": ["visible", "self_occluded", "occluded", "out_of_frame"],
}
INT, FLOAT, TEXT = pa.int32(), pa.float32(), pa.string()
ALTERNATIVE = pa.struct([("u", FLOAT), ("v", FLOAT), ("visibility", TEXT)])


def save_json(path: Path, document: dict[str, Any]) -> None:
    """Write a JSON document."""
    path.write_text(json.dumps(document, indent=1, sort_keys=True) + "\n")


def save_table(path: Path, columns: dict[str, tuple[pa.DataType, Any]], **footer: Any) -> None:
    """Write a Parquet table whose metadata has the footer `pliant`."""
    text = json.dumps({"spec_version": VERSION, **footer})
    table = pa.table({name: pa.array(values, kind) for name, (kind, values) in columns.items()})
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table.replace_schema_metadata({"pliant": text}), path)


def save_images(folder: Path, frame: int) -> tuple[int, int]:
    """Write the colour and depth image of a frame; return the object's width and height, px."""
    cos, sin, x_m, y_m = POSES[frame]
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5  # pixel centres
    x = (u - WIDTH / 2) * CAMERA_M / FOCAL_PX - x_m
    y = -(v - HEIGHT / 2) * CAMERA_M / FOCAL_PX - y_m
    m0, m1 = (cos * x + sin * y) / SIDE_M + 0.5, (cos * y - sin * x) / SIDE_M + 0.5
    seen = (np.minimum(m0, m1) >= 0) & (np.maximum(m0, m1) <= 1)
    print_ = np.abs(np.abs(m0 - 0.5) - 0.25) < 0.1  # two bars, alike after half a turn
    rgb = np.where(seen, np.where(print_, 150, 220), 60).astype(np.uint8)
    Image.fromarray(np.stack([rgb, rgb, rgb], axis=2)).save(folder / f"rgb/{frame:06d}.png")
    channels = {
        "Z": np.where(seen, CAMERA_M, np.inf).astype(np.float32),
        "surface.m0": np.where(seen, m0, 0).astype(np.float32),
        "surface.m1": np.where(seen, m1, 0).astype(np.float32),
        "surface.object": seen.astype(np.uint32),
    }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(folder / f"depth/{frame:06d}.exr"))
    return int(np.ptp(u[seen])) + 1, int(np.ptp(v[seen])) + 1


def place(frame: int, m0: float, m1: float) -> dict[str, Any]:
    """Return a point's row in the correspondences of a frame."""
    cos, sin, x_m, y_m = POSES[frame]
    a, b = (m0 - 0.5) * SIDE_M, (m1 - 0.5) * SIDE_M
    x, y = x_m + cos * a - sin * b, y_m + sin * a + cos * b
    u, v = FOCAL_PX * x / CAMERA_M + WIDTH / 2, -FOCAL_PX * y / CAMERA_M + HEIGHT / 2
    state = "visible" if 0 <= u < WIDTH and 0 <= v < HEIGHT else "out_of_frame"
    at = {"u_px": u, "v_px": v, "depth_m": CAMERA_M, "visibility": state}
    return {"frame": frame, **at, "x_m": x, "y_m": y, "z_m": 0.0}


Rows = list[list[dict[str, Any]]]
"""Frame -> the rows of its points."""


def write_sequence(folder: Path) -> tuple[Rows, float]:
    """Write images, cameras and tables; return the rows, and the box in the second frame."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    boxes = [save_images(folder, frame) for frame in (0, 1)]

    pose = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, CAMERA_M], [0, 0, 0, 1]]
    K = [[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1]]
    cameras = [{"frame": frame, "K": K, "world_to_camera": pose} for frame in (0, 1)]
    save_json(folder / "cameras.json", {"spec_version": VERSION, **SIZE, "frames": cameras})

    material = [(m0, m1) for m1 in GRID for m0 in GRID]
    points: dict[str, Any] = {
        "point": (INT, range(9)),
        "object": (INT, [1] * 9),
        "kind": (TEXT, ["surface"] * 9),
        "m0": (FLOAT, [m0 for m0, _ in material]),
        "m1": (FLOAT, [m1 for _, m1 in material]),
        "partners": (pa.list_(INT), [[8 - point] for point in range(9)]),  # after half a turn
    }
    save_table(folder / "points.parquet", points, table="points")
    found = [[{"point": p, **place(f, *m)} for p, m in enumerate(material)] for f in (0, 1)]
    kinds: dict[str, pa.DataType] = {
        "frame": INT,
        "point": INT,
        "u_px": FLOAT,
        "v_px": FLOAT,
        "depth_m": FLOAT,
    }
    kinds |= {"visibility": TEXT, "x_m": FLOAT, "y_m": FLOAT, "z_m": FLOAT}
    rows = [*found[0], *found[1]]
    columns: dict[str, Any] = {
        name: (kind, [row[name] for row in rows]) for name, kind in kinds.items()
    }
    save_table(folder / "correspondences.parquet", columns, table="correspondences")
    return found, max(boxes[1])


def write_dataset(root: Path, folder: Path) -> None:
    """Write sequence.json, and the two files that list the sequence and describe the dataset."""
    files = [
        {
            "path": path.relative_to(folder).as_posix(),
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "bytes": path.stat().st_size,
        }
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    ]
    same: dict[str, Any] = {
        "id": "card-test-000000",
        "tier": "card",
        "split": "test",
        "shape": None,
    }
    same |= {"frames": 2, "temporal": False, "seed": 0, "style": "external"}
    free: dict[str, Any] = {
        "index": 0,
        "noise": None,
        "parameters": {},
        "frame_info": [{}, {}],
        "tools": {},
    }
    save_json(folder / "sequence.json", {"spec_version": VERSION, **same, **free, "files": files})

    special = {"frames": INT, "temporal": pa.bool_(), "seed": pa.int64()}
    columns = {name: (special.get(name, TEXT), [value]) for name, value in same.items()}
    columns |= {"coverage": (FLOAT, [None]), "self_occluded": (FLOAT, [0.0])}
    save_table(root / "sequences.parquet", columns, table="sequences", dataset=NAME)
    axes = [
        {"name": name, "min": 0, "max": 1, "metres_per_unit": SIDE_M, "period": None}
        for name in "uv"
    ]
    tier = {
        "name": "card",
        "kind": "cloth",
        "variant": "printed",
        "queried_object": 1,
        "objects": [{"id": 1, "name": "card", "material": axes}],
        "symmetries": [{"name": "rotate-180", "matrix": [[-1, 0], [0, -1]], "offset": [1, 1]}],
    }
    made: dict[str, Any] = {"generator": "write_dataset", "seed": None, "config": {}, "tools": {}}
    words = {"title": "Card", "description": "A card in two frames.", "licence": "CC0-1.0"}
    rest = {"image_size": SIZE, "tiers": [tier], "splits": ["test"], "provenance": made}
    head = {"spec_version": VERSION, **NAME, **words, "conventions": CONVENTIONS}
    save_json(root / "dataset.json", {**head, **rest})


def write_split(root: Path, submission: Path, found: Rows, box_px: float) -> None:
    """Write queries, truth and the answers: every point where it was, 20 px to the right."""
    count = len(ORDER)
    pair: dict[str, Any] = {"pair_id": (INT, [0] * count), "query_id": (INT, range(count))}
    of: dict[str, Any] = {"dataset": NAME, "split": "test"}
    queries = {**pair, "tier": (TEXT, ["card"] * count)}
    for end, frame in (("a", 0), ("b", 1)):
        queries[f"sequence_{end}"] = (TEXT, ["card-test-000000"] * count)
        queries[f"frame_{end}"] = (INT, [frame] * count)
    queries |= {f"{x}_a": (FLOAT, [found[0][p][f"{x}_px"] for p in ORDER]) for x in "uv"}
    save_table(root / "queries/test.parquet", queries, table="queries", **of)
    asked = hashlib.sha256((root / "queries/test.parquet").read_bytes()).hexdigest()

    def alternative(point: int) -> dict[str, Any]:
        row = found[1][8 - point]
        return {"u": row["u_px"], "v": row["v_px"], "visibility": row["visibility"]}

    truth = {
        **pair,
        "tier": (TEXT, ["card"] * count),
        "point": (INT, ORDER),
        "u_b": (FLOAT, [found[1][p]["u_px"] for p in ORDER]),
        "v_b": (FLOAT, [found[1][p]["v_px"] for p in ORDER]),
        "visibility_b": (TEXT, [found[1][p]["visibility"] for p in ORDER]),
        "box_px": (FLOAT, [box_px] * count),
        "alternatives": (pa.list_(ALTERNATIVE), [[alternative(p)] for p in ORDER]),
    }
    save_table(root / "truth/test.parquet", truth, table="truth", **of, queries_sha256=asked)

    answers = {
        **pair,
        "u": (FLOAT, [found[0][p]["u_px"] + 20 for p in ORDER]),
        "v": (FLOAT, [found[0][p]["v_px"] for p in ORDER]),
    }
    by: dict[str, Any] = {"queries_sha256": asked, "method": {"name": "twenty-right"}}
    save_table(submission, answers, table="answers", **of, **by)


def main(root: Path, submission: Path) -> None:
    """Write the dataset and the answers."""
    folder = root / "sequences/card/card-test-000000"
    found, box_px = write_sequence(folder)
    write_dataset(root, folder)
    write_split(root, submission, found, box_px)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
