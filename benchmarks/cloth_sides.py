"""How well can a matcher do that cannot tell a cloth's two sides apart?

`python benchmarks/cloth_sides.py DATA --tier cloth-2 --split test`. A cloth whose sides look alike
shows its mirror image once it is turned over. The script counts the configurations that show
more of the underside, and scores a matcher that knows every place except that: right in pairs
that show the same side, and a mirror image (of four the best for the pair) in the others. Nothing
that only sees a blank cloth can be expected to do better, nor could anything with the towel of
pliant-v2 2.0, which had one stripe: for the tier `towel` the mirror image is that along the stripe.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from pliant.generator.objects.cloth.sampling import MIRRORS
from pliant.loaders.frame_store import FrameStore
from pliant.loaders.views import TrainingFrame
from pliant.spec.dataset import Dataset

NEIGHBOURS = 8
LEAST_VISIBLE = 3


def shows_underside(view: TrainingFrame, material: npt.NDArray[np.float64]) -> bool:
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
    material = np.asarray(store.material, dtype=np.float64)
    maps = [each for each in MIRRORS if tier != "towel" or each.name == "mirror_v"]
    tree = cKDTree(material)
    partners = [tree.query(each.apply(material))[1] for each in maps]
    views = [store.view(number) for number in range(len(store))]
    turned = [shows_underside(view, material) for view in views]
    rng = np.random.default_rng(0)
    squared, per_pair, differ = [], [], 0
    for _ in range(pairs):
        a, b = rng.choice(len(views), size=2, replace=False)
        seen = views[a].visible & views[b].visible
        if not seen.any():
            continue
        error = np.zeros(int(seen.sum()))
        if turned[a] != turned[b]:
            differ += 1
            uv = views[b].uv_px
            gaps = [np.linalg.norm(uv[partner] - uv, axis=1)[seen] for partner in partners]
            error = min(gaps, key=lambda each: float((each**2).mean()))
        squared.append(error**2)
        per_pair.append(float(np.sqrt((error**2).mean())))
    click.echo(
        f"{data} {tier} {split}: {sum(turned)} of {len(turned)} configurations show more "
        f"of the underside, {differ / len(per_pair):.0%} of {len(per_pair)} pairs differ in it; a "
        f"matcher blind to the side: RMSE {np.sqrt(np.concatenate(squared).mean()):.1f} px pooled, "
        f"{np.mean(per_pair):.1f} px mean over pairs"
    )


if __name__ == "__main__":
    main()
