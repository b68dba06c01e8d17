"""One pixel between two photographs, and the figure of it."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from matplotlib.figure import Figure
from PIL import Image

from pliant.baselines import METHODS, Answers, Frame, Heat, Matcher
from pliant.baselines.controls import Identity
from pliant.cli.main import run
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.frame import Pair
from pliant.viewer.match_figure import _heat, _rings, draw_match
from pliant.viewer.photo_match import PhotoMatch, PointMatch, grid_points, match_photo
from tests.baselines.cards import Similarity, card_view
from tests.conftest import Refused
from tests.known import known
from tests.viewer.test_photo_views import rope_on


class Unsure(Identity):
    """Answers with everything a learned method may say."""

    name = "unsure"

    def answer(self, pair: Pair) -> Answers:
        modes = np.array([[40, 30, 4, 0.7], [80, 60, 9, 0.3]], dtype=np.float32)
        return Answers(
            uv_px=modes[:1, :2].copy(), visible=np.array([0.9], np.float32), modes=[modes]
        )


def test_turned_card_is_found() -> None:
    before, after = Similarity(), Similarity(angle_deg=30)
    at = before.place(np.array([[20.0, -11.0]]))[0]
    match = match_photo(METHODS["sift"](), card_view(before), card_view(after), [tuple(at)])  # type: ignore[arg-type]
    found = match.points[0].uv_b_px
    assert np.hypot(*(found - after.place(np.array([[20.0, -11.0]]))[0])) < 1.5
    document = match.as_dict()
    assert document["query_px"] == [140, 89]
    assert 0 < document["confidence"] <= 1
    assert "16 px" in document["confidence_is"]
    assert document["visible"] is None


@pytest.mark.parametrize("said", [None, "one sentence", [3]])
def test_remarks_that_are_no_sentences_are_refused(said: Any) -> None:
    class Remarking(Identity):
        def remarks(self, source: Frame, target: Frame) -> Any:
            return said

    view = card_view(Similarity())
    with pytest.raises(SubmissionError, match="'identity' returned no list of remarks; found"):
        match_photo(Remarking(), view, view, [(120, 100)])


@pytest.mark.parametrize("shapes", [((17, 2000), (2000, 17)), ((17, 2000), (17, 2000))])
def test_a_strip_does_not_make_the_figure_one(
    shapes: tuple[tuple[int, int], ...], tmp_path: Path
) -> None:
    source, target = (Frame(np.full((*shape, 3), 90, np.uint8)) for shape in shapes)
    match = match_photo(Unsure(), source, target, [(8, 8)])
    draw_match(match, source, target, tmp_path / "figure.png")
    with Image.open(tmp_path / "figure.png") as figure:
        assert max(figure.size) < 3000
        assert max(figure.size) < 6 * min(figure.size)


def on_itself(matcher: Matcher) -> tuple[PhotoMatch, Frame]:
    """Match one point of a card to the same picture; return it too."""
    view = card_view(Similarity())
    return match_photo(matcher, view, view, [(100, 100)]), view


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that the test writes."""
    written: list[Figure] = []
    save = Figure.savefig

    def kept(figure: Figure, *args: Any, **options: Any) -> None:
        save(figure, *args, **options)
        written.append(figure)

    monkeypatch.setattr(Figure, "savefig", kept)
    return written


def test_texts_of_narrow_pictures_do_not_meet(tmp_path: Path, figures: list[Figure]) -> None:
    view = Frame(np.random.default_rng(0).integers(0, 255, (400, 40, 3)).astype(np.uint8))
    match = match_photo(METHODS["sift"](), view, view, [(20, 200)])  # type: ignore[arg-type]
    draw_match(match, view, view, tmp_path / "figure.png")
    *panels, bar = figures[0].axes
    titles = [panel.title.get_window_extent() for panel in panels]
    assert len(titles) == 3
    assert all(left.x1 < right.x0 for left, right in pairwise(titles))
    others = [bar.xaxis.label.get_window_extent(), figures[0].texts[0].get_window_extent()]
    assert all(0 <= box.x0 < box.x1 <= figures[0].bbox.width for box in (*titles, *others))


@pytest.mark.parametrize("at", [(250.0, 150.0), (-5000.0, 3.0)])
def test_the_figure_reaches_to_a_match_off_the_object(
    at: tuple[float, float], tmp_path: Path, figures: list[Figure]
) -> None:
    mask = np.zeros((200, 300), np.bool_)
    mask[3, 4] = True
    view = Frame(np.full((200, 300, 3), 90, np.uint8), mask)
    points = [PointMatch(np.array([4.5, 3.5], "f4"), np.array(at, "f4"))]
    match = PhotoMatch("far", points, np.ones(2), np.ones(2), near_px=6)
    draw_match(match, view, view, tmp_path / "figure.png")
    left, right = figures[0].axes[1].get_xlim()
    assert 0 == left < min(max(at[0], 0) + 8, 300) <= right <= 300


def test_no_number_hides_a_match(tmp_path: Path, figures: list[Figure]) -> None:
    view = card_view(Similarity())
    match = match_photo(METHODS["identity"](), view, view, [(100 + 3 * k, 100) for k in range(9)])  # type: ignore[arg-type]
    draw_match(match, view, view, tmp_path / "figure.png")
    for panel in figures[0].axes:
        numbers = [text for text in panel.texts if text.get_text().isdigit()]
        assert len(numbers) == 9
        assert min(mark.zorder for mark in panel.lines) > max(text.zorder for text in numbers)


def test_everything_a_method_says_is_told(tmp_path: Path) -> None:
    match, view = on_itself(Unsure())
    document = match.as_dict()
    assert document["visible"] == pytest.approx(0.9)
    # Of the nearer mode, 1 - exp(-r^2 / 2 sigma^2) is within r: 2 % of 240 px, sigma 4 px.
    assert document["confidence"] == pytest.approx(0.7 * (1 - np.exp(-(4.8**2) / 32)), abs=1e-3)
    assert document["confidence_is"] == "probability within 5 px of the answer"
    assert document["modes"][1] == pytest.approx({"u": 80, "v": 60, "sigma": 9, "weight": 0.3})
    assert "visible with probability 0.90" in figure_text(match, view, tmp_path / "figure.svg")


def figure_text(match: PhotoMatch, view: Frame, out: Path) -> str:
    """Draw a figure, and return its texts, which matplotlib leaves as comments next to glyphs."""
    draw_match(match, view, view, out)
    return out.read_text()


def test_figure_has_a_heat_map_where_the_method_has_one(tmp_path: Path) -> None:
    sizes = []
    for name in ("orb", "identity"):
        out = tmp_path / f"{name}.png"
        match, view = on_itself(METHODS[name]())  # type: ignore[arg-type]
        draw_match(match, view, view, out)
        with Image.open(out) as figure:
            sizes.append(figure.size)
    assert sizes[0][0] > 1.4 * sizes[1][0]  # three panels against two
    assert sorted(path.name for path in tmp_path.iterdir()) == ["identity.png", "orb.png"]


@pytest.mark.parametrize(
    ("shape", "confidence", "message"),
    [
        ((90, 120), 0.5, r"heat, values: .*wrong shape; found \(90, 120\); required: \(200, 240\)"),
        ((200, 240), 2.0, "heat, confidence: .*2.0 .*a probability, 0 to 1"),
        ((200, 240), float("nan"), "heat, confidence: .*nan .*a probability, 0 to 1"),
    ],
)
def test_heat_maps_that_are_none_are_refused(
    shape: tuple[int, int], confidence: float, message: str
) -> None:
    class Warm(Identity):
        def heat(self, source: Frame, target: Frame, uv_a_px: npt.NDArray[np.float32]) -> Heat:
            return Heat(np.zeros(shape, np.float32), "similarity", confidence, "share")

    with pytest.raises(SubmissionError, match=message):
        on_itself(Warm())


def test_an_error_of_a_method_names_it_and_the_missing_mask() -> None:
    class Masked(Identity):
        def answer(self, pair: Pair) -> Answers:
            raise KeyError(known(pair.target.mask).shape)

    view = card_view(Similarity())
    with pytest.raises(AssertionError) as caught:
        match_photo(Masked(), view, Frame(view.rgb), [(100, 100)])
    (note,) = caught.value.__notes__
    assert note == "The method 'identity' was at the source and the target (no mask)"


def test_pictures_of_unlike_shapes_get_one_height(tmp_path: Path) -> None:
    wide = Frame(np.full((100, 400, 3), 90, np.uint8))
    tall = Frame(np.full((400, 100, 3), 90, np.uint8))
    for number, (source, target) in enumerate(((wide, tall), (tall, tall), (wide, wide))):
        out = tmp_path / f"{number}.png"
        draw_match(match_photo(Identity(), source, target, [(50, 50)]), source, target, out)
        with Image.open(out) as figure:
            rows = np.asarray(figure.convert("L"))
        grey = rows == 90
        heights = grey.sum(axis=0)
        panels = heights[heights > 0.9 * heights.max()]
        assert heights.max() > 0.6 * rows.shape[0]
        assert len(panels) > 0.5 * (heights > 50).sum()  # both pictures reach as far
        assert rows.shape[0] < 800


def test_logarithms_are_drawn_down_to_nothing() -> None:
    values = np.array([[-np.inf, -60.0, -3.0, 0.0, np.nan]], np.float32)
    heat = Heat(values, "log probability", 0.5, "probability of the peak")
    image = _heat(Figure().subplots(), heat)
    assert image.get_clim() == (-10.0, 0.0)
    shown = image.get_array()
    assert shown[0, :4].tolist() == [-10.0, -10.0, -3.0, 0.0]
    assert np.ma.getmaskarray(shown).tolist() == [[False] * 4 + [True]]
    distance = Heat(values, "similarity", 0.5, "ratio")
    assert _heat(Figure().subplots(), distance).get_clim()[0] < -50
    assert _heat(Figure().subplots(), Heat(values[:, -1:], "log", 0, "")) is None


def test_modes_of_no_weight_are_not_drawn() -> None:
    (point,) = on_itself(Unsure())[0].points
    assert point.modes is not None
    assert _rings(Figure().subplots(), point) == 2
    point.modes[1, 3] = 0.01
    assert _rings(Figure().subplots(), point) == 1


def test_figure_of_a_blank_picture(tmp_path: Path) -> None:
    blank = Frame(np.zeros((20, 30, 3), dtype=np.uint8))
    match = match_photo(METHODS["sift"](), blank, blank, [(3, 3)])  # type: ignore[arg-type]
    draw_match(match, blank, blank, tmp_path / "blank.png")
    assert match.points[0].uv_b_px.tolist() == [15, 10]


def test_queries_off_the_picture_or_the_object_are_refused() -> None:
    blank, card = Frame(np.zeros((20, 30, 3), np.uint8)), card_view(Similarity())
    outside = "0 <= U < 30, 0 <= V < 20"
    for view, at, message in (
        *((blank, at, outside) for at in ((-0.1, 5.0), (30.0, 5.0), (5.0, 20.0), (np.nan, 1.0))),
        (card, (3.0, 3.0), "not on the object"),
    ):
        with pytest.raises(CallError, match=message):
            match_photo(Identity(), view, view, [at])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("figure.bmp", r"ending is unknown.*\.png"),
        ("a folder/figure.png", "output folder does not exist.*mkdir -p '[^']*a folder'$"),
        ("folder.png", "is a folder, not a file"),
    ],
)
def test_bad_figure_paths_are_refused(name: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    blank = Frame(np.zeros((20, 30, 3), dtype=np.uint8))
    match = match_photo(Identity(), blank, blank, [(3, 3)])
    with pytest.raises(CallError, match=message):
        draw_match(match, blank, blank, tmp_path / name)


def pair_of_cards(tmp_path: Path, times: int = 1) -> list[str]:
    """Write two enlarged pictures of a card and their masks; return the options naming them."""
    options = []
    for side, angle in (("source", 0), ("target", 30)):
        view = card_view(Similarity(angle_deg=angle))
        assert view.mask is not None
        for name, values in (("", view.rgb), ("mask-", view.mask.astype(np.uint8) * 255)):
            large = np.repeat(np.repeat(values, times, axis=0), times, axis=1)
            path = tmp_path / f"{name}{side}.png"
            Image.fromarray(large).save(path)
            options += [f"--{name}{side}", str(path)]
    return options


def matched(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert run(["match", *arguments, "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


def test_a_reduced_picture_gives_positions_of_the_whole_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four times as large and reduced by four: the same answer, times four."""
    before, after = Similarity(), Similarity(angle_deg=30)
    at, expected = (4 * each.place(np.array([[20.0, -11.0]]))[0] for each in (before, after))
    options = pair_of_cards(tmp_path, times=4)
    side = str(max(card_view(before).rgb.shape[:2]))
    point = f"{at[0]},{at[1]}"
    out = str(tmp_path / "figure.png")
    found = matched(capsys, "sift", *options, "--at", point, "--max-size", side, "--out", out)
    assert found["query_px"] == pytest.approx(at, abs=1e-3)
    assert np.hypot(*(np.array(found["match_px"]) - expected)) < 4 * 1.5
    assert found["warnings"] == []


def test_several_points_and_a_grid(
    tmp_path: Path, refused: Refused, capsys: pytest.CaptureFixture[str]
) -> None:
    options = pair_of_cards(tmp_path)
    out = str(tmp_path / "figure.png")
    two = ["--at", "140.5,89.5", "--at", "100.5,80.5"]
    found = matched(capsys, "sift", *options, *two, "--out", out)
    assert [point["query_px"] for point in found["points"]] == [[140.5, 89.5], [100.5, 80.5]]
    grid = matched(capsys, "identity", *options, "--grid", "30", "--out", out)
    assert 20 <= len(grid["points"]) <= 40
    mask = card_view(Similarity()).mask
    assert mask is not None
    assert all(mask[int(p["query_px"][1]), int(p["query_px"][0])] for p in grid["points"])
    for given, what in (((), "none"), ((*two, "--grid", "3"), "both")):
        said = refused(2, "match", "identity", *options, *given, "--out", out)
        assert f"by --at U,V or by --grid N; found {what}" in said


@pytest.mark.parametrize("name", ["source.png", "mask-target.png"])
def test_a_figure_does_not_replace_its_own_pictures(
    name: str, tmp_path: Path, refused: Refused
) -> None:
    call = ("match", "identity", *pair_of_cards(tmp_path), "--at", "140.5,89.5", "--out")
    before = (tmp_path / name).read_bytes()
    (tmp_path / "link.png").symlink_to(name)
    for out in (name, "link.png"):
        assert "would replace a picture that it shows" in refused(2, *call, tmp_path / out)
    assert (tmp_path / name).read_bytes() == before


def test_grid_points_cover_the_object() -> None:
    mask = np.zeros((40, 60), np.bool_)
    mask[10:30, 20:40] = True
    view = Frame(np.zeros((40, 60, 3), np.uint8), mask)
    points = grid_points(Identity(), view, 16, (120, 80))
    assert set(points) == {
        (u, v) for u in (45.0, 55.0, 65.0, 75.0) for v in (25.0, 35.0, 45.0, 55.0)
    }


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_grid_has_points_on_thin_objects(count: int) -> None:
    rgb = np.zeros((20, 800, 3), np.uint8)
    assert 1 <= len(grid_points(Identity(), Frame(rgb), count, (800, 20))) <= 2 * count
    line = np.zeros((20, 800), np.bool_)
    line[7, 100:300] = True
    points = grid_points(Identity(), Frame(rgb, line), count, (800, 20))
    assert 1 <= len(points) <= 2 * count
    assert all(int(v) == 7 and 100 <= u < 300 for u, v in points)
    assert grid_points(Identity(), Frame(rgb, np.zeros_like(line)), count, (800, 20))


@pytest.mark.parametrize("given", ["whole", "both"])
def test_a_ball_in_a_given_mask_is_separated(
    given: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rgb, strand, ball = rope_on((120, 120, 120), noise=40)
    masks = {"rope": strand, "whole": strand | ball}
    for name, picture in {"photo": rgb, **masks}.items():
        Image.fromarray(picture).save(tmp_path / f"{name}.png")
    photo, rope, whole = (str(tmp_path / f"{name}.png") for name in ("photo", *masks))
    options: list[str] = []
    for side in ("source", "target"):
        options += [f"--{side}", photo, f"--mask-{side}", whole if given == "whole" else rope]
        options += [f"--objects-{side}", whole] if given == "both" else []
    out = str(tmp_path / "figure.png")
    found = matched(capsys, "identity", *options, "--grid", "20", "--out", out)
    asked = np.array([point["query_px"] for point in found["points"]]).astype(int)
    assert not ball[asked[:, 1], asked[:, 0]].any()
    separated = "photo.png: a ball at the rope's end was separated from the mask."
    assert found["notes"] == ([separated] * 2 if given == "whole" else [])


SIDES = ("source", "target")


class Finder(Identity):
    """Finds the object where the picture is bright."""

    def object_mask(self, view: Frame) -> npt.NDArray[np.bool_]:
        return view.rgb.min(axis=2) > 200


def test_a_grid_is_on_the_object_that_the_method_finds() -> None:
    rgb = np.zeros((40, 60, 3), np.uint8)
    rgb[10:30, 20:40] = 255
    view = Frame(rgb)
    assert len(grid_points(Finder(), view, 16, (60, 40))) == 16
    assert all(20 < u < 40 for u, _ in grid_points(Finder(), view, 16, (60, 40)))
    assert max(u for u, _ in grid_points(Identity(), view, 16, (60, 40))) > 50


def test_a_point_beside_the_object_that_the_method_finds_is_said() -> None:
    rgb = np.random.default_rng(0).integers(0, 99, (40, 60, 3)).astype(np.uint8)
    rgb[10:30, 20:40] = 255
    bare = Frame(rgb)
    said = "not on the object that identity found in the source"
    assert match_photo(Finder(), bare, bare, [(25, 15)]).warnings() == []
    assert match_photo(Finder(), bare, bare, [(19.5, 15)]).warnings() == []  # masks end roughly
    assert f"The point is {said}" in match_photo(Finder(), bare, bare, [(15, 15)]).warnings()[0]
    several = match_photo(Finder(), bare, bare, [(25, 15), (5, 5), (55, 5)]).warnings()
    assert f"2 of 3 points are {said}" in several[0]
    assert match_photo(Identity(), bare, bare, [(5, 5)]).warnings() == []


def test_objects_that_the_method_finds_are_said() -> None:
    rgb = np.zeros((40, 60, 3), np.uint8)
    rgb[10:30, 20:40] = 255
    bare, masked = Frame(rgb), Frame(rgb, rgb[..., 0] > 0)
    said = [f"identity found the object in the {side} (16.7% of the picture)." for side in SIDES]
    assert match_photo(Finder(), bare, bare, [(25, 15)]).notes == said
    assert match_photo(Finder(), masked, bare, [(25, 15)]).notes == said[1:]
    assert match_photo(Identity(), bare, bare, [(25, 15)]).notes == []


@pytest.mark.parametrize("method", ["sift", "surf", "orb", "random"])
@pytest.mark.parametrize("case", ["tiny", "black", "empty"])
def test_pictures_that_show_nothing_get_no_confidence(case: str, method: str) -> None:
    side = 3 if case == "tiny" else 64
    rgb = np.random.default_rng(0).integers(0, 256, (side, side, 3)).astype(np.uint8)
    if case != "tiny":
        rgb[:] = 0 if case == "black" else 140
        rgb[::2, ::3] += 1  # the noise of an empty table
    points = [(1.5, 1.5)] if method == "random" else [(1.5, 1.5), (0.5, 1.5)]
    match = match_photo(METHODS[method](), Frame(rgb), Frame(rgb), points)  # type: ignore[arg-type]
    assert [match.confidence(point) for point in match.points] == [0.0] * len(points)
    assert "nothing to compare" in match.warnings()[0]


def test_a_reduced_picture_is_not_said_to_be_that_small() -> None:
    strip = Frame(np.zeros((8, 1024, 3), np.uint8))
    match = match_photo(Identity(), strip, strip, [(9, 5)], sizes=((8000, 60), (8000, 60)))
    assert "only 1024x8 px after its reduction to --max-size:" in match.warnings()[0]


class Strange(Identity):
    """Answers a query that is unlike its training data with full confidence."""

    name = "strange"

    def __init__(self, familiarity: float) -> None:
        self.familiarity = familiarity

    def answer(self, pair: Pair) -> Answers:
        known = np.full(len(pair.uv_a_px), self.familiarity, np.float32)
        return Answers(pair.uv_a_px.copy(), familiarity=known)

    def heat(self, source: Frame, target: Frame, uv_a_px: npt.NDArray[np.float32]) -> Heat:
        return Heat(np.zeros(target.rgb.shape[:2], np.float32), "log probability", 0.9, "peak")


def test_an_unfamiliar_query_is_said(tmp_path: Path) -> None:
    usual, _ = on_itself(Strange(0.4))
    assert usual.warnings() == []
    assert usual.as_dict()["confidence"] == 0.9
    match, view = on_itself(Strange(0.01999))
    assert "familiarity 0.01" in figure_text(match, view, tmp_path / "figure.svg")
    match, view = on_itself(Strange(0.01))
    assert match.as_dict()["confidence"] == pytest.approx(0.009)
    assert "unlike what strange was trained on" in match.warnings()[0]
    assert "do not trust the answer" in figure_text(match, view, tmp_path / "figure.svg")
