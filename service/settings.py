"""The rules of a challenge: what `challenge.yaml` contains."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, model_validator

from pliant.spec.configuration import Settings, read_mapping, settings_from
from pliant.spec.constraints import Bounds, NotEmpty, OneOf, Pattern, Refused
from pliant.spec.conventions import SPLITS
from pliant.spec.errors import CallError


def _in_utc(moment: datetime) -> datetime:
    if moment.tzinfo is None:
        raise Refused("a time with its zone, such as 2027-03-01T00:00:00Z")
    try:
        return moment.astimezone(UTC)
    except OverflowError:
        raise Refused("a time of the years 1 to 9999 in UTC") from None


Name = Annotated[
    str,
    Pattern(
        "[a-z0-9][a-z0-9-]{0,39}", "1 to 40 small letters, digits and hyphens, such as test-2027"
    ),
]
Moment = Annotated[datetime, AfterValidator(_in_utc)]
Count = Annotated[int, Bounds(1, 1_000_000)]


class Phase(Settings):
    """One part of a challenge: a split, its protocols, its dates and its attempts.

    Attributes:
        name: Name in addresses.
        split: The dataset's split that submissions answer.
        protocols: Protocols that score it; the first is the one that the leaderboard opens with.
        opens: First moment at which submissions are accepted; None: from the start.
        closes: Moment from which they are refused; None: never.
        attempts_per_day: Scored submissions of a team per UTC day.
        attempts_total: Scored submissions of a team in all.
        show: Which submission of a team the leaderboard shows.
        hidden_until_close: Whether only the host sees scores, receipts and leaderboard before it
            closes; needs `closes`.
    """

    name: Name
    split: Annotated[str, OneOf(SPLITS)]
    protocols: Annotated[tuple[str, ...], NotEmpty()] = ("standard",)
    opens: Moment | None = None
    closes: Moment | None = None
    attempts_per_day: Count = 5
    attempts_total: Count = 100
    show: Literal["best", "last"] = "best"
    hidden_until_close: bool = False

    @model_validator(mode="after")
    def _check(self) -> Phase:
        if self.opens and self.closes and self.opens >= self.closes:
            raise Refused("a time after opens", "closes")
        if len(set(self.protocols)) < len(self.protocols):
            raise Refused("different protocols", "protocols")
        if self.hidden_until_close and self.closes is None:
            raise Refused("false, or a phase with a time in closes", "hidden_until_close")
        return self

    def status(self, time_ms: int) -> Literal["upcoming", "open", "closed"]:
        """Return whether submissions are accepted at a time (milliseconds since 1970)."""
        now = datetime.fromtimestamp(time_ms / 1000, UTC)
        if self.opens and now < self.opens:
            return "upcoming"
        return "closed" if self.closes and now >= self.closes else "open"


def moment_text(moment: datetime | None) -> str:
    """Return an opening or closing time for people, with seconds where it has any."""
    if moment is None:
        return "–"
    seconds = ":%S" if moment.second or moment.microsecond else ""
    return moment.strftime(f"%Y-%m-%d %H:%M{seconds} %Z")


class Scoring(Settings):
    """What the process that scores a submission may use.

    Attributes:
        memory_gib: Memory.
        cpu_s: CPU time.
        wall_s: Time on the clock.
        lease_s: A job whose worker has not reported for so long is given to another worker.
        tries: How often a job is started before it fails.
    """

    memory_gib: Annotated[float, Bounds(0.5, 1024)] = 4
    cpu_s: Annotated[int, Bounds(1, 86_400)] = 600
    wall_s: Annotated[float, Bounds(0, 86_400, above=True)] = 900
    lease_s: Annotated[float, Bounds(1, 3600)] = 30
    tries: Annotated[int, Bounds(1, 3)] = 3


class ChallengeSettings(Settings):
    """A challenge.

    Attributes:
        title: Its name on pages; empty takes the dataset's title.
        rules: More rules for participants, in Markdown.
        contact: Address for questions, shown on the rules page.
        phases: Its phases; the first open one is what the pages open with.
        max_file_mb: Largest submission file.
        submissions_per_minute: Files of a team per minute, checks included.
        scoring: Limits of scoring.
        authors: Who publishes the challenge, for the archive's metadata.
    """

    title: str = ""
    rules: str = ""
    contact: str = ""
    phases: Annotated[tuple[Phase, ...], NotEmpty()]
    max_file_mb: Annotated[float, Bounds(0, 16_384, "MB", above=True)] = 200
    submissions_per_minute: Annotated[int, Bounds(1, 1000)] = 10
    scoring: Scoring = Scoring()
    authors: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _check(self) -> ChallengeSettings:
        names = [phase.name for phase in self.phases]
        if len(set(names)) < len(names):
            raise Refused("phases with different names", "phases")
        return self

    @property
    def max_file_bytes(self) -> int:
        """Largest submission file in bytes."""
        return int(self.max_file_mb * 1e6)

    def phase(self, name: str) -> Phase:
        """Return a phase by its name.

        Raises:
            CallError: There is no such phase.
        """
        for phase in self.phases:
            if phase.name == name:
                return phase
        names = ", ".join(phase.name for phase in self.phases)
        raise CallError("no such phase", found=repr(name)[:60], required=names)


def read_challenge_settings(
    path: Path | None, splits: tuple[str, ...] | None = None
) -> ChallengeSettings:
    """Read `challenge.yaml`.

    Args:
        path: The file; None takes the defaults.
        splits: Splits of which each becomes a phase of its own, where the file names no phases: by
            default test. None: the file has to name its phases.

    Raises:
        CallError: It cannot be read, or a setting is refused; every problem is listed. Or splits
            are given as well as phases.
    """
    values = {} if path is None else read_mapping(path)
    if splits and "phases" in values:
        raise CallError(
            "the phases name their splits already", path=path, where="phases", fix="Omit --split."
        )
    if splits is not None and "phases" not in values:
        named = [{"name": split, "split": split} for split in splits or ("test",)]
        values = {**values, "phases": named}
    return settings_from(ChallengeSettings, values, path=path)
