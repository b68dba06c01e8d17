"""The losses of Dense Object Nets, each alone in its module with its formula."""

from pliant.models.losses.contrastive import Hinge, contrastive_loss, draw_non_matches
from pliant.models.losses.distributional import distributional_loss, gaussian_target
from pliant.models.losses.lipschitz_space import lipschitz_space_loss
from pliant.models.losses.lipschitz_time import lipschitz_time_loss
from pliant.models.losses.matches import Candidates, NonMatches, Targets
from pliant.models.losses.orientation import orientation_loss

__all__ = [
    "Candidates",
    "Hinge",
    "NonMatches",
    "Targets",
    "contrastive_loss",
    "distributional_loss",
    "draw_non_matches",
    "gaussian_target",
    "lipschitz_space_loss",
    "lipschitz_time_loss",
    "orientation_loss",
]
