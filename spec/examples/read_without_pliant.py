"""Read a Pliant dataset without Pliant: numpy, pyarrow, OpenEXR and Pillow alone.

Usage: python read_without_pliant.py DATASET

For the first frame of every sequence it projects the points by the formula of SPEC.md and
looks up, in the depth image, the pixel that each visible point falls into.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pyarrow.parquet as pq
from PIL import Image


def read_depth(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Return a depth image's channels by name: float32 or uint32 (H, W)."""
    with OpenEXR.File(str(path), separate_channels=True) as image:
        return {name: channel.pixels for name, channel in image.channels().items()}


def project(
    camera: dict[str, Any], xyz_m: np.ndarray[Any, Any]
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return pixels (N, 2), first pixel's centre at (0.5, 0.5), and planar depth (N,)."""
    K, pose = np.array(camera["K"]), np.array(camera["world_to_camera"])
    x, y, z = pose[:3, :3] @ xyz_m.T + pose[:3, 3:]
    u = K[0, 0] * x / z + K[0, 2]
    v = K[1, 1] * y / z + K[1, 2]
    return np.stack([u, v], axis=1), z


def main(root: Path) -> None:
    """Read the first frame of every sequence and compare its files with one another."""
    info = json.loads((root / "dataset.json").read_text())
    if info["spec_version"].split(".")[0] != "1":
        sys.exit(f"specification {info['spec_version']} is not known here")
    for row in pq.read_table(root / "sequences.parquet").to_pylist():
        folder = root / "sequences" / row["tier"] / row["id"]
        camera = json.loads((folder / "cameras.json").read_text())["frames"][0]
        table = pq.read_table(folder / "correspondences.parquet", filters=[("frame", "==", 0)])
        column = {name: table.column(name).to_numpy() for name in table.column_names}
        xyz_m = np.stack([column["x_m"], column["y_m"], column["z_m"]], axis=1)
        uv, depth_m = project(camera, xyz_m.astype(np.float64))
        error_px = np.abs(uv - np.stack([column["u_px"], column["v_px"]], axis=1)).max()

        rgb = np.asarray(Image.open(folder / "rgb" / "000000.png"))
        image = read_depth(folder / "depth" / "000000.exr")
        visible = column["visibility"] == "visible"
        rows, columns = np.floor(uv[visible, 1]).astype(int), np.floor(uv[visible, 0]).astype(int)
        on_object = image["surface.object"][rows, columns] > 0
        gap_m = np.abs(image["Z"][rows, columns] - depth_m[visible])[on_object]
        print(
            f"{row['id']}: image {rgb.shape[1]} x {rgb.shape[0]}, {len(uv)} points, "
            f"{visible.sum()} visible; reprojection within {error_px:.4f} px; "
            f"{on_object.mean():.0%} of the visible on an object's pixel, "
            f"median distance from its Z {np.median(gap_m) * 1000 if gap_m.size else 0:.2f} mm"
        )
    for path in sorted((root / "queries").glob("*.parquet")):
        footer = json.loads(pq.read_schema(path).metadata[b"pliant"])
        print(f"{footer['split']}: {pq.read_metadata(path).num_rows} queries")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
