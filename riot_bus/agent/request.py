"""Checked requests of a controller: all that comes from the network is data of limited size, never code."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus.agent.options import AgentOptions
    from riot_bus.play.options import PlayOptions
    from riot_bus.record.options import CaptureOptions

__all__ = ["DEFAULT_GRACE_S", "Lead", "PlayRequest", "Policy", "RecordRequest", "check_key", "parse_request"]

DEFAULT_GRACE_S = 10.0
"""How long a controller may be away before it counts as lost: as long as Zenoh may need to notice a broken link."""

Policy = Literal["continue", "pause", "stop"]
"""What becomes of an operation whose controller is lost."""

RequestT = TypeVar("RequestT", bound="Lead")

_Id = Annotated[str, Field(pattern=r"^[0-9a-f]{8,32}$")]
_Secret = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
_Text = Annotated[str, Field(min_length=1, max_length=1000)]
_Texts = Annotated[list[_Text], Field(max_length=1000)]
_Seconds = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]
_MOST_INJECTIONS = 1000  # a guess: each one costs the robot time for every message of its topic
_MOST_COPIES = 1000  # a guess: a single injection could flood the robot's bus
_LONGEST_DELAY_S = 3600.0  # a guess: delayed messages take memory until they are due


class Lead(BaseModel):
    """The part that the requests of all operations have.

    Attributes:
        operation: Id of the operation, chosen by the controller: the same request twice is one operation.
        secret: Secret by which agent and controller prove who they are; None for no proofs.
        watched: Whether the controller stays.
        who: Name of the controller, for people.
        on_lost_controller: What to do when the controller has given no proof for `grace` seconds.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    operation: _Id
    secret: Annotated[_Secret | None, Field(repr=False)] = None
    watched: bool = False
    who: Annotated[str, Field(max_length=200)] = "somebody"
    on_lost_controller: Policy = "stop"
    grace: Annotated[float, Field(ge=0, le=3600, allow_inf_nan=False)] = DEFAULT_GRACE_S

    @model_validator(mode="after")
    def _watched(self) -> Lead:
        if self.watched and self.secret is None:
            raise ValueError("a controller that stays needs a secret, to prove that it is there")
        if not self.watched and self.on_lost_controller != "continue":
            raise ValueError(f"{self.on_lost_controller!r} on a lost controller needs one that stays (watched)")
        return self


class PlayRequest(Lead):
    """Request to play, with the options of `riot play` but those that name files or code."""

    logs: Annotated[list[_Text], Field(min_length=1, max_length=16)]
    inject: Annotated[str, Field(max_length=1 << 19)] | None = None
    rate: Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)] = 1.0
    loop: bool = False
    delay: _Seconds = 0.0
    start_offset: _Seconds = 0.0
    duration: _Seconds | None = None
    until: _Text | None = None
    align: bool = False
    topics: _Texts = []
    exclude: _Texts = []
    remap: _Texts = []
    paused: bool = False
    clock: Annotated[float, Field(ge=0, le=1000, allow_inf_nan=False)] = 0.0
    wait: Annotated[float, Field(ge=0, le=600, allow_inf_nan=False)] = 2.0
    lockstep: _Texts = []
    ack: _Text | None = None
    quiet: _Seconds = 0.05
    settle_timeout: _Seconds = 5.0
    types: _Texts = []
    seed: Annotated[int, Field(ge=-(1 << 63), lt=1 << 63)] = 0
    domain: Annotated[int, Field(ge=0, le=232)] | None = None
    latched: _Texts = []

    def options(self, agent: AgentOptions, files: Sequence[Path], plan: Path | None) -> PlayOptions:
        """Return the options of the player.

        Args:
            agent: Options of the robot's agent.
            files: Files of the logs.
            plan: A file with the text of `inject`.

        Raises:
            ConfigError: An option is wrong, or publishes at a key that is closed to remote users.
        """
        from riot_bus.log.limits import tight_limits
        from riot_bus.play.options import PlayOptions, parse_remaps

        own = {*Lead.model_fields, "logs", "inject"}
        options = PlayOptions(
            logs=files,
            endpoint=agent.endpoint,
            config=agent.config,
            name=agent.robot,
            inject=plan,
            limits=tight_limits(len(files)),
            **{name: getattr(self, name) for name in type(self).model_fields if name not in own},
        )
        options.check()
        for target in parse_remaps(self.remap).values():
            check_key(target, where="remap")
        return options

    def check_plan(self) -> None:
        """Raise ConfigError if the injection plan is wrong, or could overload the robot."""
        if self.inject is None:
            return
        from riot_bus.inject.plan import parse_plan

        injections = parse_plan(self.inject, name="inject")
        if len(injections) > _MOST_INJECTIONS:
            raise ConfigError(f"{len(injections)} injections are too many", where="inject", hint="at most 1000")
        for number, each in enumerate(injections):
            if each.copies > _MOST_COPIES or each.delay > _LONGEST_DELAY_S:
                hint = f"at most {_MOST_COPIES} copies and {_LONGEST_DELAY_S:g} s of delay"
                raise ConfigError("this is too much for a robot", where=f"inject[{number}]", hint=hint)


class RecordRequest(Lead):
    """Request to record, with options of `riot record`."""

    on_lost_controller: Policy = "continue"
    keys: _Texts = ["**"]
    exclude: _Texts = []
    output: _Text | None = None
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    split_bytes: Annotated[int, Field(ge=0, lt=1 << 60)] = 0
    split_seconds: _Seconds = 0.0
    max_files: Annotated[int, Field(ge=0, le=100_000)] = 0
    duration: _Seconds = 0.0
    paused: bool = False
    throttle: _Texts = []
    latched: bool = True
    types: _Texts = []
    seed: Annotated[int, Field(ge=-(1 << 63), lt=1 << 63)] = 0

    def options(self, agent: AgentOptions) -> CaptureOptions:
        """Return the options of the recorder.

        Raises:
            ConfigError: An option is wrong, or the file exists or would be outside of the folder of logs.
        """
        from riot_bus.control.log_paths import safe_path
        from riot_bus.record.options import CaptureOptions

        own = {*Lead.model_fields, "output"}
        output = None if self.output is None else safe_path(agent.folder, self.output)
        if output is not None and os.path.lexists(output):
            raise ConfigError(f"{self.output!r} exists already", where="output", hint="choose another name")
        options = CaptureOptions(
            endpoint=agent.endpoint,
            config=agent.config,
            name=agent.robot,
            robot=agent.robot,
            output=output,
            folder=agent.folder.resolve(),
            notes={"for": self.who},
            **{name: getattr(self, name) for name in type(self).model_fields if name not in own},
        )
        options.check()
        return options


def check_key(key: str, *, where: str) -> None:
    """Raise ConfigError if a key belongs to the administration of Zenoh or riot_bus."""
    if any(chunk.startswith("@") and chunk != "@adv" for chunk in key.split("/")):
        hint = "chunks that begin with @ belong to administration; leave the topic out (exclude)"
        raise ConfigError(f"{key[:200]!r} is not published from afar", where=where, hint=hint)


def parse_request(kind: type[RequestT], payload: bytes) -> RequestT:
    """Return a received request, checked.

    Raises:
        ConfigError: The payload is no request of this kind; names the place and what was expected.
    """
    try:
        return kind.model_validate_json(payload or b"{}")
    except ValidationError as error:
        problem: Any = error.errors(include_url=False, include_input=False)[0]
    place = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        word = str(problem["loc"][-1])[:80]
        raise ConfigError(f"unknown argument {word!r}", hint=did_you_mean(word, kind.model_fields))
    message = str(problem["msg"]).removeprefix("Value error, ")
    raise ConfigError(f"{place}: {message}" if place else message)
