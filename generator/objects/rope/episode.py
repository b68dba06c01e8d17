"""Episodes: a hand moves a rope about, one frame after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from pliant.generator.objects.rope.actions import Action, next_action, outside_by
from pliant.generator.objects.rope.body import RopeBody, upward_normal
from pliant.generator.objects.rope.curve import resample
from pliant.generator.objects.rope.dynamics import RopeState
from pliant.generator.objects.rope.static import sample_configuration
from pliant.generator.portable import norm
from pliant.generator.scene.scene_object import Pose

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
