"""All constants of rope tracing, and how each was chosen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class TracingSettings:
    """The constants of `baselines/tracing`.

    *Geometry*: follows from the shape of strands, masks and cameras. *Compared*: the best of
    several values on validation pairs of rendered ropes (`docs/design-notes.md`). *Cost*: larger
    values cost time. *Unrecorded*: it works, and the history does not say what else was tried. No
    value was chosen on real pictures or on a test split.

    Lengths are in half widths of the rope unless the name says otherwise.

    Attributes:
        working_width_px: Masks are walked at about this width (cost).
        working_half_px: Or at a larger one, where half of the rope's width would be less than this
            (compared: 40 ropes of half the usual width or less, most of them with a knot, are read
            rightly in 35 cases instead of 22).
        shortest_steps: Shorter walks, and masks of fewer pixels, are not a rope (unrecorded).
        stations: Places that a trace is resampled to, evenly along it (cost).
        walk_step_px: Length of a step on the working mask (unrecorded).
        walk_turns_deg: Directions looked in, from the heading: start, stop, step (unrecorded).
        walk_look_px: How far ahead a walker looks (unrecorded).
        walk_look_weights: What it sees there counts by this (unrecorded).
        walk_turn_cost: Of a squared angle, times a walker's straightness (unrecorded).
        walk_straightness: Of the walkers that start at each end (unrecorded).
        walk_inertia: Share of the heading that they keep in a step (unrecorded).
        walk_least_depth: Share of the half width below which a place is off the rope (unrecorded).
        walk_misses: Steps off the rope in a row after which a walk ends (unrecorded).
        walk_most_steps: Longest walk: enough for a rope of five image widths (geometry).
        walk_across_px: How far to either side the middle of the mask is looked for (unrecorded).
        walk_centring: Share of the way to that middle that a step takes (unrecorded).
        heading_px: Radius around a start whose middle gives the first heading (unrecorded).
        chain_half_px: Half the rope's width in blocks of pixels that the hidden Markov model is
            given (cost; given those that are walked, 480 pairs of usual ropes have 11.1 instead
            of 11.3 px, those of an unseen look 13.9 instead of 14.0).
        chain_steps: Steps of the hidden Markov model from one end to the other (cost).
        chain_headings: Its headings (cost).
        chain_turns: Probability of each turn in a step, in headings (unrecorded).
        chain_blur_px: Blur of a step by the pixel grid (geometry).
        chain_least_share: Smaller shares of a step are left out (cost).
        chain_lengths: Rope lengths tried, in lengths of a rope without crossings (geometry: where
            strands cover each other the mask is smaller than the rope).
        chain_samples: Paths drawn (cost).
        hidden_first: First share of a rope that its ball may hide (geometry).
        hidden_later: Likelihood of being hidden by something after that (unrecorded).
        chain_smoothing_steps: Blur of a drawn path (unrecorded).
        centring_rounds: How often paths move to the middle (cost).
        centring_stiffness: Weight of a path's bends (compared: a stiffer one is no better).
        centring_least_weight: Keeps the system regular (unrecorded).
        usual_widths: Of the median; elsewhere a strand crosses or touches (geometry).
        across_reach: How far to either side the edge of the mask is looked for (geometry).
        edge_step_px: Step on the way to an edge (cost).
        leaves_ball_at: Where a rope leaves its ball, as a share of the ball's radius (compared: on
            200 rendered ropes the distance varies by 0.3 px).
        end_back: Length over which the way at an end is measured (unrecorded).
        end_reach: Where the mask goes on longer than this, a path does not (unrecorded).
        crossing_near: Places within this of the middle of both strands are in doubt (geometry:
            past an edge, and how far off a trace may be).
        crossing_body: A strand's edge (compared, with the next: 1.0 to 1.2).
        crossing_weight: How much a half width past it speaks against the upper strand, log odds
            (compared: 2 to 16; of 5,416 places near both strands 522 are put on the wrong one by
            the log odds alone, 484 by the edge alone, 430 by both).
        alike: Neighbouring stations whose widths say the same (geometry: their distance).
        focal_widths: Focal length in image widths of an unknown camera: 50 degrees across
            (geometry: the middle of usual lenses).
        tilt_prior: Standard deviation of a camera's tilt before anything is measured, tangent of an
            angle (unrecorded; the generator's cameras from above have up to 0.07).
        tilt_places: Independent widths that a tilt takes at least (unrecorded).
        fit_rounds: Of weighing residuals (cost).
        slant_least: Tangent of 20 degrees; tracing does not suffer from less (compared).
        slant_largest: More is taken for this (geometry: a rope of 50 degrees is foreshortened to
            two thirds).
        slant_significance: Standard errors that it exceeds at least (compared: of 202 found masks
            of pictures from above 12, 7, 3, 1 seem tilted with 3, 4, 5, 6, of 38 oblique ones 4, 5,
            7, 9 do not).
        slant_ridge: Pixels of ridge that it takes (unrecorded).
        slant_widths: Of the median; wider are strands side by side (geometry).
        slant_residual_px: Widths scatter by this at least (geometry: pixels).
        slant_fill: Share of the frame that a rectified rope fills at most (unrecorded).
        bend_weight: Of a trace's bend, rad², against its coverage (compared: 0 to 0.1 on ropes and
            cables; 0.01 is best, 0.03 misreads thin ropes with knots).
        retraced_weight: Of its retraced share, likewise (fitted, with the next, to 700 pairs of
            rendered ropes: log odds that both traces of a pair are right).
        coverage_weight: Of both scores against the logarithm of the lengths' ratio.
        strands_most: Of a mask; with more, the search takes too long (cost).
        strands_paths: Paths returned (cost).
        strands_looks: Steps of the search (cost).
        strands_reach: Length over which the direction of a strand at its end is measured
            (unrecorded).
        strands_spur: Shorter loose ends do not count (geometry: thinning leaves them).
        strands_twice: Cost of passing a strand again, rad² (unrecorded).
        strands_missed: Cost of a half width of strand that is not passed, rad² (compared: of 120
            thin ropes the right path is among those found in all with 1 and 2, in 118 with 0.5).
        strands_half_px: The skeleton is taken of a mask with at least this half width (compared: 3
            and 5 find the right path less often).
        strands_side_px: But of no larger mask than this (cost).
        bridge_least: Smaller parts of a mask are not bridged to, square half widths (compared: with
            5 short ends behind covers are left out; with 2, 34 instead of 27 of 120 noisy ropes
            with a segmenter's masks are read wrongly).
        bridge_parts: Masks with more parts are not bridged (cost).
        bridge_pairs: Pairs of ends among which bridges are chosen, those of least cost (cost).
        bridge_reach: Length over which the direction of a loose end is measured (compared:
            leaving out the last one or two half widths does not reduce the error).
        bridge_most: Largest cost of a bridge, rad² (compared with exact masks: with 1.2, 4.5 and 8,
            ropes next to cloths have 67.7, 58.6 and 57.7 px, others of them 75.0, 55.2 and 52.9;
            4.9 is a turn back to a parallel strand).
        bridge_most_at_ball: The same, also between ends of one part, where a ball is known, so that
            one end alone is free (compared: of 150 ropes next to cables and 150 next to cloths,
            18 and 32 are read wrongly with 3, 17 and 29 with 8; with 10, 31 of 120 noisy ones with
            a segmenter's masks are off by a tenth of the length, with 8 25).
        bridge_strand: Shortest strand whose end is bridged to another of its part: a ragged edge
            has short ones (compared: with 0 and 4, 15 and 11 of 60 of the noisy ropes are off).
        bridge_stub: The ends of a shorter strand have no direction (geometry: as wide as long).
        bridge_length: Cost of a half width of it, rad² (compared: 0.01 to 0.04 are equal).
        bridge_bare: Further cost of a half width along which the table is seen (compared: image
            alone, 40, 80 ropes next to other objects 75.9, 52.1 px with 0, 69.6, 37.9 with 0.2;
            a factor of 5 of the whole cost has 66.2, 37.9, but misreads faulty masks in noise).
        bridge_back: How far inside of either strand the line starts whose angles count (compared:
            on the same ropes with 0, 1 and 2, the first reading is off by 0.023, 0.021 and
            0.021 of the length next to cables, and by 0.022 next to cloths).
        bridge_own: Largest cost of one between ends of the same part without a ball (unrecorded).
        bridge_ball: A ball that is farther from the rope is bridged to (unrecorded).
        bridge_ahead: How far ahead of an end a strand is that it may be joined to (compared: with 4
            and 12, 10 and 9 of 150 ropes next to cloths are read wrongly; others are equal).
        bridge_joint: Cost of that, rad², against half of the largest cost (unrecorded).
        border_reach: Half widths between a cut end and the border of the picture at most
            (unrecorded; none of 192 ropes of the reference benchmark is called cut).
        border_px: Pixels by which a mask may end before the border (unrecorded).
        border_margin: Room outside for ropes that come back, as a share of the picture's longer
            side (unrecorded).
        shape_least_part: Smaller parts than this share of the largest are specks (unrecorded).
        shape_around: Radius in which loose ends are looked for (unrecorded).
        shape_at_end: Area of a rope within that around its end, over that around its middle
            (geometry: 0.6 two half widths before the end, at least 0.97 in the middle).
        shape_least_end: Square half widths; smaller places are ragged edges (unrecorded).
    """

    working_width_px: int = 320
    working_half_px: float = 2.0
    shortest_steps: int = 20
    stations: int = 300
    walk_step_px: float = 1.5
    walk_turns_deg: tuple[int, int, int] = (-50, 51, 5)
    walk_look_px: tuple[float, ...] = (1.5, 3.0, 4.5, 7.0)
    walk_look_weights: tuple[float, ...] = (1.0, 1.0, 0.7, 0.5)
    walk_turn_cost: float = 1.2
    walk_straightness: tuple[float, ...] = (0.3, 0.6, 0.9, 1.3, 1.8, 2.6)
    walk_inertia: tuple[float, ...] = (0.35, 0.55, 0.72)
    walk_least_depth: float = 0.15
    walk_misses: int = 3
    walk_most_steps: int = 1200
    walk_across_px: float = 1.5
    walk_centring: float = 0.4
    heading_px: float = 7.0
    chain_half_px: float = 1.8
    chain_steps: int = 100
    chain_headings: int = 16
    chain_turns: tuple[tuple[int, float], ...] = ((-1, 0.15), (0, 0.7), (1, 0.15))
    chain_blur_px: float = 0.6
    chain_least_share: float = 0.02
    chain_lengths: tuple[float, ...] = (0.9, 1.05, 1.2, 1.4)
    chain_samples: int = 24
    hidden_first: float = 0.08
    hidden_later: float = 0.02
    chain_smoothing_steps: float = 1.5
    centring_rounds: int = 2
    centring_stiffness: float = 3.0
    centring_least_weight: float = 1e-3
    usual_widths: tuple[float, float] = (0.75, 1.25)
    across_reach: float = 3.0
    edge_step_px: float = 0.5
    leaves_ball_at: float = 0.81
    end_back: float = 2.0
    end_reach: float = 6.0
    crossing_near: float = 1.6
    crossing_body: float = 1.2
    crossing_weight: float = 16.0
    alike: float = 3.0
    focal_widths: float = 1.07
    tilt_prior: float = 0.06
    tilt_places: int = 40
    fit_rounds: int = 15
    slant_least: float = 0.36
    slant_largest: float = 1.2
    slant_significance: float = 5.0
    slant_ridge: int = 40
    slant_widths: tuple[float, float] = (0.6, 1.35)
    slant_residual_px: float = 0.6
    slant_fill: float = 0.86
    bend_weight: float = 0.01
    retraced_weight: float = 0.04
    coverage_weight: float = 30.0
    strands_most: int = 16
    strands_paths: int = 8
    strands_looks: int = 4000
    strands_reach: float = 4.0
    strands_spur: float = 2.5
    strands_twice: float = 0.5
    strands_missed: float = 1.0
    strands_half_px: float = 4.0
    strands_side_px: int = 2560
    bridge_least: float = 3.0
    bridge_parts: int = 12
    bridge_pairs: int = 16
    bridge_reach: float = 4.0
    bridge_most: float = 4.5
    bridge_most_at_ball: float = 8.0
    bridge_length: float = 0.02
    bridge_bare: float = 0.2
    bridge_back: float = 2.0
    bridge_own: float = 0.8
    bridge_strand: float = 4.0
    bridge_stub: float = 1.0
    bridge_ball: float = 4.0
    bridge_ahead: float = 12.0
    bridge_joint: float = 2.0
    border_reach: float = 0.5
    border_px: float = 2.0
    border_margin: float = 0.15
    shape_least_part: float = 0.1
    shape_around: float = 5.0
    shape_at_end: float = 0.65
    shape_least_end: float = 1.0


TRACING: Final = TracingSettings()
"""The values in use."""
