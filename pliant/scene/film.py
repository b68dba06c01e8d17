"""Pictures of a body with their exact answers, and the dataset that they become."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import describe_tier
from pliant.generator.rendering import open_renderer
from pliant.generator.runner.dataset_files import write_dataset_files
from pliant.generator.runner.sequence import frame_facts, sequence_info
from pliant.generator.runner.sequence_writer import writing_sequence
from pliant.generator.scene.appearance import Appearance, sample_appearance
from pliant.generator.scene.camera import looking_at, sample_camera
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.seeding import SequenceTask
from pliant.generator.settings.scene import AppearanceSettings, CameraSettings
from pliant.generator.truth.frame_truth import FrameTruth, frame_truth
from pliant.scene.bodies import Body
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray, Rgb
from pliant.spec.calls import check_numbers, check_whole
from pliant.spec.camera import Camera
from pliant.spec.configuration import settings_from, settings_to_dict
from pliant.spec.conventions import SPLITS
from pliant.spec.errors import CallError
from pliant.spec.io.exr import Surface
from pliant.spec.secrets import draw_secret_seed, write_secret_seed


def camera(
    eye: Sequence[float],
    target: Sequence[float] = (0.0, 0.0, 0.0),
    *,
    size: tuple[int, int] = (640, 480),
    fov_deg: float = 45.0,
) -> Camera:
    """Return a pinhole camera.

    Args:
        eye: (x, y, z), metres.
        target: What its centre sees, metres.
        size: (width, height), pixels.
        fov_deg: Horizontal field of view, degrees.

    Raises:
        CallError: An argument is not possible.

    Examples:
        >>> pliant.scene.camera((0.0, -0.6, 1.1), size=(320, 240)).size
        (320, 240)
    """
    for name, place in (("eye", eye), ("target", target)):
        check_numbers(name, place, "(x, y, z), metres", count=3)
    if tuple(eye) == tuple(target):
        raise CallError(
            "the camera is where it looks", where="target", found=target, required="not eye"
        )
    _check_size(size)
    check_numbers("fov_deg", fov_deg, "between 0 and 180 degrees", low=0, high=180, strict=True)
    straight = abs(eye[0] - target[0]) + abs(eye[1] - target[1]) < 1e-6 * abs(eye[2] - target[2])
    up = (0.0, 1.0, 0.0) if straight else (0.0, 0.0, 1.0)
    return looking_at(eye, target, size, fov_deg=fov_deg, up=up)


def _check_size(size: object) -> None:
    check_numbers("size", size, "(width, height), pixels", count=2)
    for side in cast("Sequence[object]", size):
        check_whole("size", side, least=1)


@dataclass(frozen=True, eq=False)
class Shot:
    """What a camera has seen, and the exact answers.

    Attributes:
        rgb: uint8 (H, W, 3), sRGB.
        camera: The camera.
        pose: The geometry.
        truth: As `pliant generate` writes it.

    Examples:
        >>> rope = pliant.scene.Rope([(-0.4, 0.0), (0.0, 0.15), (0.4, 0.0)])
        >>> shot = pliant.scene.Film(rope, size=(160, 120)).shoot()
        >>> shot.depth_m.shape, shot.uv_px.shape[1], shot.xyz_m.shape[1]
        ((120, 160), 2, 3)
    """

    rgb: Rgb
    camera: Camera
    pose: Pose
    truth: FrameTruth

    @property
    def surface(self) -> Surface:
        """Depth, material coordinates and object of every pixel."""
        return self.truth.surface

    @property
    def depth_m(self) -> Float32Array:
        """float32 (H, W), planar z, +inf where nothing is."""
        return self.truth.surface.depth_m

    @property
    def uv_px(self) -> FloatArray:
        """float64 (P, 2), where the material points are in the picture."""
        return self.truth.uv_px

    @property
    def xyz_m(self) -> FloatArray:
        """float64 (P, 3), where they are in the world."""
        return self.truth.xyz_m

    @property
    def visible(self) -> BoolArray:
        """Whether the camera sees them, bool (P,)."""
        return np.asarray(self.truth.visibility) == "visible"


class Film:
    """A sequence of pictures of one body.

    Args:
        body: What is seen.
        view: The camera of shots that name none; default: one that sees all of the body.
        size: (width, height) of the default camera, pixels.
        style: `raster`, or `fast` and `photo` (Blender).
        look: Colours, table and light; default: drawn with the seed.
        seed: Of the default camera and look.
        split: Split of the sequence in a dataset; `val` and `test` get queries.
        episode: Whether the shots, two or more, follow one another in time.

    Examples:
        >>> rope = pliant.scene.Rope([(-0.4, 0.0), (0.0, 0.15), (0.4, 0.0)])
        >>> film = pliant.scene.Film(rope, size=(160, 120))
        >>> shot = film.shoot()
        >>> shot.rgb.shape, len(shot.uv_px) == len(shot.visible)
        ((120, 160, 3), True)
    """

    def __init__(
        self,
        body: Body,
        view: Camera | None = None,
        *,
        size: tuple[int, int] = (640, 480),
        style: str = "raster",
        look: Appearance | None = None,
        seed: int = 0,
        split: str = "train",
        episode: bool = True,
    ) -> None:
        if split not in SPLITS:
            raise CallError("unknown split", where="split", found=split, required=", ".join(SPLITS))
        _check_size(size)
        check_whole("seed", seed)
        self.body, self.style, self.split, self.episode = body, style, split, episode
        self.shots: list[Shot] = []
        self.scene_object = SceneObject(
            tier=body.tier,
            kind=body.kind,
            shape=None,
            temporal=episode,
            frames=1,  # known when the film is written
            parts=body.parts,
            points=body.points,
            pose=lambda frame: self.shots[frame].pose,
            size_m=body.size_m,
            thickness_m=body.thickness_m,
            info={body.kind: settings_to_dict(body.settings)},
            variant=body.variant,
            proportion=body.proportion,
        )
        rng = np.random.default_rng(seed)
        self.view = view or sample_camera(
            rng, self.scene_object, CameraSettings(), size, (body.pose(),)
        )
        self.look = look or sample_appearance(rng, self.scene_object, AppearanceSettings())
        self._renderer = open_renderer(style, self.view.size)
        self._seen_by: Camera | None = None

    @property
    def temporal(self) -> bool:
        """Whether its pictures follow one another in time, which one alone does not."""
        return self.episode and len(self.shots) > 1

    def shoot(self, view: Camera | None = None) -> Shot:
        """Take a picture of the body as it is now, and keep it.

        Args:
            view: The camera; default: the film's. All pictures of a film have one size.
        """
        view = view or self.view
        if view.size != self.view.size:
            raise CallError(
                "the pictures of a film have one size", found=view.size, required=self.view.size
            )
        pose = self.body.pose()
        truth = frame_truth(self.scene_object, pose, view)
        if view is not self._seen_by:
            self._renderer.begin(self.scene_object, self.look, view)
            self._seen_by = view
        self.shots.append(Shot(self._renderer.render(pose, truth), view, pose, truth))
        return self.shots[-1]

    def write(self, out: Path | str, **about: Any) -> Path:
        """Write the film as a dataset of one sequence, as `write` does."""
        return write([self], out, **about)


_ABOUT: Final = ("title", "description", "licence", "version", "seed", "secret_seed", "queries")


def write(films: Sequence[Film], out: Path | str, *, id: str = "own-scenes", **about: Any) -> Path:
    """Write films as the sequences of one dataset.

    Args:
        films: At least one; all of one kind of body with equal settings, one size and one style.
        out: The dataset's folder; new.
        id: The dataset's id.
        about: More fields of a config: `title`, `description`, `licence`, `version`, `seed` (of
            the queries), `secret_seed` (required for a held-out split), `queries`.

    Returns:
        The folder.

    Raises:
        CallError: The folder is there, there are no pictures, films do not go together, or a field
            would say of the pictures what they do not show.

    Examples:
        >>> rope = pliant.scene.Rope([(-0.4, 0.0), (0.0, 0.15), (0.4, 0.0)])
        >>> film = pliant.scene.Film(rope, size=(160, 120))
        >>> shots = [film.shoot(), film.shoot()]
        >>> folder = pliant.scene.write([film], "my-scenes", title="One rope")
        >>> pliant.load(folder)[0].frames
        2
    """
    out = Path(out)
    if out.exists():
        raise CallError("the folder is there already", path=out, fix="Name a new one.")
    if not films or not all(film.shots for film in films):
        raise CallError("there is nothing to write: no picture was taken", path=out)
    if unknown := about.keys() - _ABOUT:
        raise CallError(
            "the pictures are taken already, and no such setting changes them",
            found=", ".join(sorted(unknown)),
            required=f"of {', '.join(_ABOUT)}",
        )
    first = films[0]
    for film in films:
        for name, mine, theirs in (
            ("size", film.view.size, first.view.size),
            ("style", film.style, first.style),
            ("body", film.body.tier, first.body.tier),
            ("settings", film.body.settings, first.body.settings),
            ("number of pictures", len(film.shots), len(first.shots)),
            ("episode", film.episode, first.episode),
        ):
            if mine != theirs:
                raise CallError(
                    f"films of one dataset have one {name}", found=mine, required=theirs
                )
    splits = {name: sum(film.split == name for film in films) for name in SPLITS}
    values = {
        "tiers": [first.body.tier],
        "splits": {name: count for name, count in splits.items() if count},
        "frames": len(first.shots),
        "episodes": first.temporal,
        "width": first.view.size[0],
        "height": first.view.size[1],
        "style": first.style,
        "id": id,
        first.body.kind: settings_to_dict(first.body.settings),
        **about,
    }
    config = settings_from(GenerateConfig, values)
    if config.secret_seed:
        config = config.replace(seed=draw_secret_seed())
        write_secret_seed(out, config.seed)
    tasks: list[SequenceTask] = []
    for film in films:
        index = sum(task.split == film.split for task in tasks)
        tasks.append(SequenceTask(film.body.tier, film.split, index))
        _write_sequence(film, config, tasks[-1], out)
    # Only what is true of the pictures: the rest of the config describes random scenes.
    resolved = config.resolved()
    stated = {name: resolved[name] for name in (first.body.kind, "queries", "style")}
    write_dataset_files(config, tasks, out, stated={"made_with": "pliant.scene", **stated})
    return out


def _write_sequence(film: Film, config: GenerateConfig, task: SequenceTask, out: Path) -> None:
    scene_object = replace(film.scene_object, temporal=film.temporal)
    queried = describe_tier(config, task.tier).queried_object
    facts = [frame_facts(scene_object, shot.pose, shot.truth, queried) for shot in film.shots]
    info = sequence_info(config, task, scene_object, film.look, facts)
    with writing_sequence(task.folder(out)) as writer:
        for shot in film.shots:
            writer.add_frame(shot.rgb, shot.truth, shot.camera)
        writer.finish(info, scene_object.points)
