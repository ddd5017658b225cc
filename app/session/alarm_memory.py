"""What the alarm remembers between two runs: the level of each scene, and where pictures go."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from slopegate.app.session.preferences import load, save

FILE_NAME = "alarm.json"
MOST_SCENES = 200
"""The scene that was set longest ago is forgotten for another."""


class SceneLevel(BaseModel):
    """What sets the alarm off in one scene: counts of a camera whose largest is `max_count`, and per cent."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    level_count: int = Field(ge=0)
    max_count: int = Field(gt=0)
    share_percent: float = Field(gt=0, le=100)


class AlarmFacts(BaseModel):
    """The file's content."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    scenes: dict[str, SceneLevel] = Field(default_factory=dict)
    """By file or address, the one set last at the end."""
    folder: str = ""
    """Where the pictures of events go."""


class AlarmMemory:
    """Levels by scene, and the folder for pictures; kept in a settings folder, for this run only where that is None."""

    def __init__(self, folder: Path | None) -> None:
        self._path = None if folder is None else folder / FILE_NAME
        self._facts, self.notice = (AlarmFacts(), "") if self._path is None else load(self._path, AlarmFacts, "alarms")
        """`notice`: why nothing is remembered, in one sentence; empty when all is well."""

    @property
    def folder(self) -> str:
        """Where the pictures of events go; empty when none was chosen."""
        return self._facts.folder

    def keep_folder(self, folder: str) -> str:
        """Remember the folder; one sentence where that fails."""
        return self._keep(self._facts.model_copy(update={"folder": folder}))

    def level(self, place: str) -> SceneLevel | None:
        """What was set in this scene; None where nothing was."""
        return self._facts.scenes.get(place)

    def keep_level(self, place: str, level: SceneLevel) -> str:
        """Remember what is set in this scene; one sentence where that fails."""
        if self.level(place) == level:
            return ""
        others = {key: value for key, value in self._facts.scenes.items() if key != place}
        newest = dict(list(others.items())[-(MOST_SCENES - 1) :]) | {place: level}
        return self._keep(self._facts.model_copy(update={"scenes": newest}))

    def _keep(self, facts: AlarmFacts) -> str:
        if facts == self._facts:
            return ""
        self._facts = facts
        return "" if self._path is None else save(self._path, facts)
