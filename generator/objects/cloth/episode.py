"""Episodes: a hand picks, lifts, carries and releases a cloth, frame after frame.

A level-1 episode starts from a flat cloth, the others from a configuration of their level.
An action is simulated whole before its first frame is handed out; should the cloth poke
through itself in any of its frames, the action is undone and another is chosen, so that
every frame of an episode keeps the rule that configurations keep.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pliant.generator import portable
from pliant.generator.objects.cloth.configuration import make_configuration
from pliant.generator.objects.cloth.handling import Action, Handling, perform
from pliant.generator.objects.cloth.surface import PART, Placement, cover_of, render_vertices
from pliant.generator.scene.scene_object import Pose
from pliant.generator.seeding import RandomStreams, Stream
from pliant.generator.settings.cloth import ClothSettings
from pliant.spec.arrays import FloatArray
from pliant.spec.configuration import settings_to_dict
from pliant.spec.errors import GenerationError

REST_FRAMES: Final = (6, 15)
"""Frames (fewest, most) in which the hand is away between two actions."""

LARGEST_REACH: Final = 0.55
"""The hand stays within this share of the cloth's lengths of the place where the cloth started."""

_CHOICES: Final = 8


@dataclass(frozen=True)
class _Moment:
    """A frame that is simulated and waits to be asked for."""

    vertices: FloatArray
    pierced: int
    action: int | None
    hand_m: FloatArray | None
    moved_m: FloatArray


class Episode:
    """The poses of one episode. Frames are simulated in order; going back starts again."""

    def __init__(self, settings: ClothSettings, level: int, streams: RandomStreams) -> None:
        self._settings = settings
        self._level = level
        self._streams = streams
        self._restart()

    def pose(self, frame: int) -> Pose:
        """Return the pose of a frame, >= 0."""
        if frame < self._frame:
            self._restart()
        while self._frame < frame:
            while not self._waiting:
                self._act()
            self._moment = self._waiting.popleft()
            self._frame += 1
        moment = self._moment
        info: dict[str, Any] = {
            **settings_to_dict(cover_of(self._settings, moment.vertices)),
            "action": None if moment.action is None else self._actions[moment.action],
            "hand": None if moment.hand_m is None else moment.hand_m.tolist(),
            "d_action": moment.moved_m.tolist(),
        }
        if self._frame == 0:
            info["start"] = self._start
        return Pose(vertices={PART: moment.vertices}, info=info)

    def _restart(self) -> None:
        settings = self._settings
        self._rng = self._streams.generator(Stream.CLOTH_EPISODE)
        start: dict[str, Any] = {"actions": []}
        if self._level == 1:
            self._handling = Handling(settings, self._rng)
            positions = self._handling.simulator.positions
            yaw_rad = float(self._rng.uniform(-settings.yaw_max_rad, settings.yaw_max_rad))
            self._placement = Placement.centred(positions, yaw_rad)
        else:
            made = make_configuration(settings, self._level, self._rng)
            self._handling, self._placement = made.handling, made.placement
            start = dict(made.info)
        self._start = start
        self._home = self._handling.middle()
        self._actions: list[dict[str, Any]] = []
        self._waiting: deque[_Moment] = deque()
        self._frame = 0
        self._moment = _Moment(*self._surface(), None, None, np.zeros(3))

    def _surface(self) -> tuple[FloatArray, int]:
        positions = self._handling.simulator.positions
        return render_vertices(self._settings, self._placement.apply(positions))

    def _act(self) -> None:
        """Simulate one more action whole, and let its frames wait."""
        simulator = self._handling.simulator
        before = simulator.positions.copy(), simulator.previous.copy()
        for choice in range(_CHOICES):
            number = len(self._actions)
            rest = int(self._rng.integers(REST_FRAMES[0], REST_FRAMES[1] + 1))
            # Should every action end badly, a rest of the hand is what remains.
            action = self._choose() if choice < _CHOICES - 1 else None
            moments = self._frames(action, number, rest)
            if moments is not None:
                if action is not None:
                    facts = action.record(self._settings.grid)
                    self._actions.append({"index": number, **facts})
                self._waiting.extend(moments)
                return
            simulator.place(before[0])
            simulator.previous[:] = before[1]
        raise GenerationError(
            f"the cloth intersects itself after each of {_CHOICES} tried actions",
            where=f"{self._streams.task.id}, frame {self._frame + 1}",
            fix="Lower hand_speed_m_s or raise contact_spacings",
        )

    def _frames(self, action: Action | None, number: int, rest: int) -> list[_Moment] | None:
        """Simulate an action and the rest after it; None if a frame pokes through itself."""
        simulator = self._handling.simulator
        per_frame = simulator.sheet.steps_per_frame
        moments: list[_Moment] = []
        if action is not None:
            where = simulator.positions[action.vertex].copy()
            since = 0
            last = where.copy()
            for where in perform(simulator, action):
                since += 1
                if since < per_frame:
                    continue
                moments.append(self._moment_now(number, where, last))
                if moments[-1].pierced:
                    return None
                last, since = where, 0
            if since:  # the last frame of an action ends with the hand let go
                simulator.run(per_frame - since)
                moments.append(self._moment_now(number, where, last))
        for _ in range(rest):
            simulator.run(per_frame)
            moments.append(_Moment(*self._surface(), None, None, np.zeros(3)))
        return None if any(moment.pierced for moment in moments) else moments

    def _moment_now(self, number: int, where: FloatArray, last: FloatArray) -> _Moment:
        ends = self._placement.apply(np.stack([last, where]))
        return _Moment(*self._surface(), number, ends[1], ends[1] - ends[0])

    def _choose(self) -> Action:
        """Choose an action: gather a spread cloth, spread a gathered one, most of the time."""
        cloth, rng = self._handling, self._rng
        spread_out = cloth.coverage()
        if rng.random() < np.clip(1.1 - spread_out, 0.1, 0.8):
            name, vertex = "spread", self._rim_vertex()
            carry = -cloth.inwards(vertex, 0.5) * rng.uniform(0.15, 0.45)
            lift, lower = rng.uniform(0.08, 0.2), 0.7
        elif rng.random() < 0.35:
            name = "drop"
            xy = cloth.middle() + rng.uniform(-0.2, 0.2, 2) * cloth.lengths_m
            vertex = cloth.top_vertex(xy)
            carry = cloth.anywhere() * rng.uniform(0.05, 0.25)
            lift, lower = rng.uniform(0.2, 0.5), rng.uniform(0.1, 0.6)
        else:
            name, vertex = "fold", self._rim_vertex()
            carry = cloth.inwards(vertex, 0.6) * rng.uniform(0.2, 0.5)
            lift, lower = rng.uniform(0.1, 0.25), 0.5
        picked = cloth.simulator.positions[vertex, :2]
        reach = LARGEST_REACH * cloth.lengths_m
        target = np.clip(picked + carry * cloth.scale_m, self._home - reach, self._home + reach)
        return cloth.action(name, vertex, target - picked, lift, lower)

    def _rim_vertex(self) -> int:
        """Return a corner now and then, else an uppermost mass far from the middle."""
        cloth, rng = self._handling, self._rng
        if rng.random() < 0.4:
            return cloth.corner()
        direction = cloth.anywhere()
        offsets = cloth.simulator.positions[:, :2] - cloth.middle()
        outermost = int(portable.product(offsets, direction[:, None]).argmax())
        return cloth.top_vertex(cloth.simulator.positions[outermost, :2])
