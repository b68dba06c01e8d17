"""Episodes: a hand moves a rope about, one frame after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from pliant.generator.rope.actions import Action, next_action, outside_by
from pliant.generator.rope.curve import resample, turned
from pliant.generator.rope.dynamics import RopeState
from pliant.generator.rope.posing import RopeBody, upward_normal
from pliant.generator.rope.spline import smooth_curve
from pliant.generator.rope.static import sample_configuration
from pliant.generator.subject import FloatArray, Pose

_SETTLE_FRAMES: Final = 30

_STRAY_LENGTHS: Final = 0.03
"""A hand lets go when some of the rope is this far outside the workspace, in rope lengths."""


class Episode:
    """The frames of one episode, simulated as they are asked for.

    A frame depends on those before it: asking for an earlier one starts the episode again.
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

    def pose(self, frame: int) -> Pose:
        """Return the geometry of a frame.

        Args:
            frame: Frame index, >= 0.
        """
        if frame < self._frame:
            self._start()
        while self._frame < frame:
            self._advance()
        return self._pose

    def _start(self) -> None:
        settings = self._settings
        self._rng = self._new_generator()
        made = sample_configuration(self._shape, settings, self._rng)
        limit = np.deg2rad(settings.roll_deg)
        self._roll = float(self._rng.uniform(-limit, limit))
        curve = resample(made.centreline, settings.particles)
        self.state = RopeState(settings, curve, made.ball_centre)
        for _ in range(_SETTLE_FRAMES):
            self.state.advance()
        self._normal = np.empty(0)
        self._tangent = np.empty(0)
        self._action: Action | None = None
        self._actions = 0
        self._frame = 0
        start = {
            "shape": self._shape,
            "roll_rad": self._roll,
            "start_control_points_m": made.control_points.tolist(),
            "start_handles_m": made.handles.tolist(),
            **made.detail,
        }
        self._show({**start, "action": -1, "phase": "start", "d_action_m": [0.0, 0.0, 0.0]})

    def _advance(self) -> None:
        settings, state = self._settings, self.state
        action = self._action
        if action is None or action.done:
            action = next_action(self._actions, state.chain, settings, self._rng)
            self._actions += 1
            self._action = action
        hand = action.hand()
        lag = float(np.sqrt(((state.now[action.held] - hand) ** 2).sum()))
        action.step(lag, 1.0 / settings.frame_rate_hz, settings.diameter_m)
        stray = float(outside_by(state.chain[:, :2], settings).max())
        if action.kind != "gather" and stray > _STRAY_LENGTHS * settings.length_m:
            action.let_go()
        info: dict[str, Any] = action.record(settings.particles)
        if action.phase == "wait":
            state.advance()
            info["d_action_m"] = [0.0, 0.0, 0.0]
        else:
            target = action.hand()
            state.advance(action.held, target)
            info["hand_m"] = target.tolist()
            info["d_action_m"] = (target - hand).tolist()
        self._frame += 1
        self._show(info)

    def _show(self, info: dict[str, Any]) -> None:
        centreline = self.centreline()
        tangent = centreline[1] - centreline[0]
        tangent = tangent / np.sqrt((tangent**2).sum())
        if len(self._normal):
            normal = turned(self._normal, self._tangent, tangent)
        else:
            normal = upward_normal(centreline, self._roll)
        self._pose, frames = self._body.pose(centreline, normal, self.state.ball, info)
        self._normal, self._tangent = frames[0, 1].copy(), tangent

    def centreline(self) -> FloatArray:
        """Return the curve of the current frame: float64 (rows, 3), metres, equal steps."""
        smooth = smooth_curve(self.state.chain, self._settings.radius_m)
        return resample(smooth, self._settings.rows)
