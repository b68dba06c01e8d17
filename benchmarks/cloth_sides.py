"""How well can a matcher do that cannot tell a blank cloth's two sides apart?

`python benchmarks/cloth_sides.py DATA --tier cloth-2 --split test`. A cloth whose sides look alike
shows its mirror image once it is turned over. The script counts the configurations that show
more of the underside, and scores a matcher that knows every place except that: right in pairs
that show the same side, and a mirror image (of four the best for the pair) in the others. Nothing
that only sees the picture can be expected to do better.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from pliant.loaders.frame_store import FrameStore
from pliant.loaders.views import FrameView
from pliant.models.don.validation import draw_validation_pairs
from pliant.spec.dataset import Dataset

NEIGHBOURS = 8
LEAST_VISIBLE = 3


def shows_underside(view: FrameView, material: npt.NDArray[np.float64]) -> bool:
    """Return whether most visible points see the material mirrored.

    Args:
        view: A frame.
        material: float64 (P, 2), material coordinates of its points.
    """
    _, near = cKDTree(material).query(material, NEIGHBOURS + 1)
    mirrored = []
    for point in np.flatnonzero(view.visible):
        others = [each for each in near[point, 1:] if view.visible[each]]
        if len(others) >= LEAST_VISIBLE:
            step = material[others] - material[point]
            moved = view.uv_px[others] - view.uv_px[point]
            slope = np.linalg.lstsq(step, moved, rcond=None)[0]
            mirrored.append(np.linalg.det(slope) > 0)  # v grows up the cloth and down the image
    return float(np.mean(mirrored)) > 0.5


@click.command(help=__doc__)
@click.argument("data", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--tier", default="cloth-2", show_default=True)
@click.option("--split", default="test", show_default=True)
@click.option("--pairs", default=400, show_default=True, help="Random pairs of configurations.")
def main(data: Path, tier: str, split: str, pairs: int) -> None:
    """Print the share of turned cloths and the errors."""
    dataset = Dataset.open(data)
    store = FrameStore(dataset, tier, split, dataset.size)
    mirrors = [k for k, each in enumerate(store.tier.symmetries) if each.name.startswith("mirror")]
    material = np.asarray(store.material, dtype=np.float64)
    turned = {
        frame.key: shows_underside(store.view(number), material)
        for number, frame in enumerate(store.frames)
    }
    squared, per_pair, differ = [], [], 0
    for pair in draw_validation_pairs(store, pairs, 48, 0):
        seen = pair.visible[:, 0]
        if not seen.any():
            continue
        error = np.zeros(int(seen.sum()))
        if turned[pair.source.key] != turned[pair.target.key]:
            differ += 1
            gap = np.linalg.norm(pair.uv_b_px[:, 1:] - pair.uv_b_px[:, :1], axis=2)[seen]
            error = min((gap[:, k] for k in mirrors), key=lambda each: float((each**2).mean()))
        squared.append(error**2)
        per_pair.append(float(np.sqrt((error**2).mean())))
    click.echo(
        f"{data} {tier} {split}: {sum(turned.values())} of {len(turned)} configurations show more "
        f"of the underside, {differ / len(per_pair):.0%} of {len(per_pair)} pairs differ in it; a "
        f"matcher blind to the side: RMSE {np.sqrt(np.concatenate(squared).mean()):.1f} px pooled, "
        f"{np.mean(per_pair):.1f} px mean over pairs"
    )


if __name__ == "__main__":
    main()
