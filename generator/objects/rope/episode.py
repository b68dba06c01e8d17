"""Episodes: a hand moves a rope about, one frame after the other.

It picks a point, lifts it, carries it, lets go, and waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pliant.generator.objects.rope.body import RopeBody, upward_normal
from pliant.generator.objects.rope.curve import resample
from pliant.generator.objects.rope.dynamics import RopeState
from pliant.generator.objects.rope.static import sample_configuration
from pliant.generator.portable import norm
from pliant.generator.scene.scene_object import Pose
from pliant.generator.settings.rope import RopeSettings
from pliant.spec.arrays import FloatArray

_MARGIN_LENGTHS: Final = 0.06
_WAIT_FRAMES_S: Final = (0.12, 0.40)
_LAG_DIAMETERS: Final = 1.0
"""The hand waits for the rope when it is this far ahead of the point it holds."""

_LET_GO_DIAMETERS: Final = 4.0


@dataclass
class Action:
    """One action, and how far it has come.

    Attributes:
        number: 0, 1, 2 … in the episode.
        kind: `spread` (an end pulled outward), `cross` (over another stretch), `gather` (a
            stray point brought back) or `move` (anywhere).
        held: Particle picked.
        start_m: float64 (3,), where it was picked.
        end_m: float64 (2,), where it is let go.
        side_m: float64 (2,), the largest sideways bow of the path.
        lift_m: Height of the carry above the picking height.
        duration_s: Time of lift and carry, seconds, if the hand moves freely.
        wait_s: Time after letting go.
        progress: 0..1 along the path; above 1 the wait.
        waited_s: Time since letting go.
        phase: `lift`, `carry`, `lower` or `wait`.
    """

    number: int
    kind: str
    held: int
    start_m: FloatArray
    end_m: FloatArray
    side_m: FloatArray
    lift_m: float
    duration_s: float
    wait_s: float
    progress: float = 0.0
    waited_s: float = 0.0
    elapsed_s: float = 0.0
    phase: str = "lift"

    def hand(self) -> FloatArray:
        """Return where the hand is now: float64 (3,), metres."""
        u = min(self.progress, 1.0)
        eased = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        out = np.empty(3)
        out[:2] = self.start_m[:2] + (self.end_m - self.start_m[:2]) * eased
        out[:2] += self.side_m * math.sin(math.pi * eased)
        rise, sink = _smooth(u / 0.25), _smooth((1.0 - u) / 0.3)
        out[2] = self.start_m[2] * (1.0 - rise) + self.lift_m * min(rise, 0.3 + 0.7 * sink)
        out[2] += self.start_m[2] * rise
        return out

    def step(self, lag_m: float, frame_s: float, diameter_m: float) -> None:
        """Go on by one frame, slower where the rope holds back the hand.

        Args:
            lag_m: Distance of the held particle from the hand, metres.
            frame_s: Time of a frame, seconds.
            diameter_m: Diameter of the rope, metres.
        """
        if self.phase == "wait":
            self.waited_s += frame_s
            return
        self.elapsed_s += frame_s
        follow = max(0.0, 1.0 - lag_m / (_LAG_DIAMETERS * diameter_m))
        self.progress += follow * frame_s / self.duration_s
        stuck = self.elapsed_s > 2.5 * self.duration_s
        if self.progress >= 1.0 or stuck or lag_m > _LET_GO_DIAMETERS * diameter_m:
            self.phase = "wait"
        elif self.progress < 0.25:
            self.phase = "lift"
        else:
            self.phase = "carry" if self.progress < 0.75 else "lower"

    @property
    def done(self) -> bool:
        """True when the wait is over."""
        return self.phase == "wait" and self.waited_s >= self.wait_s

    def record(self, particles: int) -> dict[str, Any]:
        """Return what every frame of the action records.

        Args:
            particles: Number of particles of the rope.
        """
        return {
            "action": self.number,
            "kind": self.kind,
            "phase": self.phase,
            "picked_s": self.held / (particles - 1),
        }


def outside_by(flat: FloatArray, settings: RopeSettings) -> FloatArray:
    """Return how far particles are outside the workspace.

    Args:
        flat: float64 (n, 2), metres.
        settings: The tier's settings.

    Returns:
        float64 (n,), metres, negative inside.
    """
    half = np.array(settings.workspace) * settings.length_m / 2.0
    return np.asarray((np.abs(flat) - half).max(axis=1))


def next_action(
    number: int, chain: FloatArray, settings: RopeSettings, rng: np.random.Generator
) -> Action:
    """Draw the next action from where the rope is.

    Args:
        number: Its number.
        chain: float64 (particles, 3), metres.
        settings: The tier's settings.
        rng: Where the numbers come from.

    Returns:
        The action, not yet begun.
    """
    last = len(chain) - 1
    half = np.array(settings.workspace) * settings.length_m / 2.0
    inner = half - _MARGIN_LENGTHS * settings.length_m
    flat = chain[:, :2]
    outside = outside_by(flat, settings)
    extent = flat.max(axis=0) - flat.min(axis=0)
    clumped = float(extent.max()) < 0.3 * settings.length_m
    if outside.max() > 0.0:
        kind, held = "gather", int(outside.argmax())
        end = rng.uniform(-0.5, 0.5, 2) * inner
    elif clumped or rng.random() < settings.spread_share:
        kind, held = "spread", 0 if rng.random() < 0.5 else last
        end = _outward(flat, held, settings, rng)
    else:
        held = int(rng.integers(last + 1)) if rng.random() < 0.5 else last * int(rng.integers(2))
        if rng.random() < 0.6:
            kind = "cross"
            other = flat[int(rng.integers(last + 1))]
            end = flat[held] + (other - flat[held]) * rng.uniform(1.1, 1.7)
        else:
            kind, end = "move", rng.uniform(-1.0, 1.0, 2) * inner
    end = np.clip(end, -inner, inner)
    way = end - flat[held]
    distance = norm(way)
    # Not so far that the rope would have to follow for long.
    furthest = 0.45 * settings.length_m
    if distance > furthest:
        end = flat[held] + way * (furthest / distance)
        way, distance = end - flat[held], furthest
    side = np.array([-way[1], way[0]]) * _bow(flat, held, way, rng)
    # The eased path is fastest in its middle; the mean is what the setting names.
    speed = rng.uniform(*settings.hand_speed_m_s)
    return Action(
        number=number,
        kind=kind,
        held=held,
        start_m=chain[held].copy(),
        end_m=end,
        side_m=side,
        lift_m=rng.uniform(*settings.lift_m),
        duration_s=max(0.35, distance / speed),
        wait_s=rng.uniform(*_WAIT_FRAMES_S),
    )


def _bow(flat: FloatArray, held: int, way: FloatArray, rng: np.random.Generator) -> float:
    """Return the path's sideways bow over its length.

    A path back along the rope would fold it flat onto itself, which no rope of this thickness
    does: such a path swings out to one side.
    """
    bow = rng.normal(0.0, 0.15)
    length = norm(way)
    for reach in (-6, 6):
        other = held + reach
        if 0 <= other < len(flat) and length > 0:
            back = flat[other] - flat[held]
            cosine = float((back * way).sum()) / (length * max(norm(back), 1e-9))
            if cosine > 0.5:
                return math.copysign(rng.uniform(0.3, 0.6), bow)
    return bow


def _outward(
    flat: FloatArray, held: int, settings: RopeSettings, rng: np.random.Generator
) -> FloatArray:
    """Return a place away from the rest of the rope, or from its other end."""
    other = flat[-1 - held] if held == 0 else flat[0]
    anchor = flat.mean(axis=0) if rng.random() < 0.5 else other
    out = flat[held] - anchor
    heading = math.atan2(out[1], out[0]) + rng.normal(0.0, 0.5)
    reach = rng.uniform(0.3, 0.75) * settings.length_m
    return np.asarray(anchor + reach * np.array([math.cos(heading), math.sin(heading)]))


def _smooth(u: float) -> float:
    u = min(max(u, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


_SETTLE_FRAMES: Final = 30

_STRAY_LENGTHS: Final = 0.03
"""A hand lets go when some of the rope is this far outside the workspace, in rope lengths."""


class Episode:
    """The frames of one episode, simulated as they are asked for.

    A frame depends on those before it: asking for an earlier one starts the episode again.

    Attributes:
        frame: Index of the current frame.
        state: The particles in it.
        info: Facts of it: action, phase, hand; at the start the shape it was drawn in.
    """

    def __init__(
        self, body: RopeBody, shape: str, new_generator: Callable[[], np.random.Generator]
    ) -> None:
        """Prepare an episode.

        Args:
            body: The rope.
            shape: Shape it starts in.
            new_generator: Returns the episode's random numbers, from their start.
        """
        self._body = body
        self._settings = body.settings
        self._shape = shape
        self._new_generator = new_generator
        self._start()

    def _start(self) -> None:
        settings = self._settings
        self._rng = self._new_generator()
        made = sample_configuration(self._shape, settings, self._rng)
        limit = np.deg2rad(settings.roll_deg)
        roll = float(self._rng.uniform(-limit, limit))
        curve = resample(made.centreline, settings.particles)
        self.state = RopeState(settings, curve, made.ball_centre)
        for _ in range(_SETTLE_FRAMES):
            self.state.advance()
        self.state.normal = upward_normal(self.state.chain, roll)
        self._action: Action | None = None
        self._actions = 0
        self.frame = 0
        self.info: dict[str, Any] = {
            "shape": self._shape,
            "roll_rad": roll,
            "start_control_points_m": made.control_points.tolist(),
            "start_handles_m": made.handles.tolist(),
            **made.detail,
            "action": -1,
            "phase": "start",
            "hand_m": None,
            "d_action": [0.0, 0.0, 0.0],
        }

    def pose(self, frame: int) -> Pose:
        """Return the geometry of a frame.

        Args:
            frame: Frame index, >= 0.
        """
        if frame < self.frame:
            self._start()
        while self.frame < frame:
            self.step()
        state = self.state
        return self._body.pose(state.centreline(), state.normal, state.ball, self.info)

    def step(self) -> None:
        """Simulate the next frame."""
        settings, state = self._settings, self.state
        action = self._action
        if action is None or action.done:
            action = next_action(self._actions, state.chain, settings, self._rng)
            self._actions += 1
            self._action = action
        hand = action.hand()
        lag = norm(state.now[action.held] - hand)
        action.step(lag, 1.0 / settings.frame_rate_hz, settings.diameter_m)
        stray = float(outside_by(state.chain[:, :2], settings).max())
        if action.kind != "gather" and stray > _STRAY_LENGTHS * settings.length_m:
            action.phase = "wait"
        self.info = action.record(settings.particles)
        if action.phase == "wait":
            state.advance()
            self.info |= {"hand_m": None, "d_action": [0.0, 0.0, 0.0]}
        else:
            target = action.hand()
            state.advance(action.held, target)
            self.info |= {"hand_m": target.tolist(), "d_action": (target - hand).tolist()}
        self.frame += 1
