"""Checked requests of a controller: all that comes from the network is data of limited size, never code."""

from __future__ import annotations

import os
from collections.abc import Sequence
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, model_validator

from riot_bus.play.options import PlayOptions
from riot_bus.record.options import CaptureOptions
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.flags import flags_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from riot_bus_fleet.agent.options import AgentOptions


Policy = Literal["continue", "pause", "stop"]
"""What becomes of an operation whose controller is lost."""

RequestT = TypeVar("RequestT", bound="Lead")

_Id = Annotated[str, Field(pattern=r"^[0-9a-f]{8,32}$")]
_Secret = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
_Text = Annotated[str, Field(min_length=1, max_length=1000)]
_Texts = Annotated[list[_Text], Field(max_length=1000)]
_LIMITS = {float: (0, 1e9), int: (-(1 << 63), (1 << 63) - 1)}  # seconds as in `riot play`; what 64 bits hold
_MOST_COPIES = 1000  # a guess: a single injection could flood the robot's bus
_LONGEST_DELAY_S = 3600.0  # a guess: delayed messages take memory until they are due


class Lead(BaseModel):
    """The part that the requests of all operations have.

    Attributes:
        operation: Id of the operation, chosen by the controller: the same request twice is one operation.
        secret: Secret by which agent and controller prove who they are; None for no proofs.
        on_lost_controller: Action once the controller has given no proof for `grace` seconds.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    operation: _Id
    secret: Annotated[_Secret | None, Field(repr=False)] = None
    watched: bool = False
    who: Annotated[str, Field(max_length=200)] = "an unnamed controller"
    on_lost_controller: Policy = "stop"
    grace: Annotated[float, Field(ge=0, le=3600, allow_inf_nan=False)] = 10.0

    @model_validator(mode="after")
    def _watched(self) -> Lead:
        if self.watched and self.secret is None:
            raise ValueError("a controller that stays needs a secret, to prove that it is there")
        if not self.watched and self.on_lost_controller != "continue":
            raise ValueError(f"{self.on_lost_controller!r} on a lost controller needs one that stays (watched)")
        return self


def _with_options(kind: type) -> Callable[[type[RequestT]], type[RequestT]]:
    """Add the options that may be requested of a robot to a request, with their types and limits."""

    def decorate(base: type[RequestT]) -> type[RequestT]:
        options: dict[str, Any] = {
            each.name: (_checked(get_args(each.type)[0], limits=flag.remote), each.default)
            for each, flag, _ in flags_of(kind)
            if flag.remote
        }
        return create_model(base.__name__, __base__=base, __module__=__name__, **options)

    return decorate


def _checked(kind: Any, *, limits: bool | tuple[float, float]) -> Any:
    first, *others = get_args(kind) or (kind,)
    if NoneType in others:
        return _checked(first, limits=limits) | None
    if kind in _LIMITS:
        least, most = limits if isinstance(limits, tuple) else _LIMITS[kind]
        return Annotated[kind, Field(ge=least, le=most)]
    return {str: _Text, Sequence[str]: _Texts}.get(kind, kind)


@_with_options(PlayOptions)
class PlayRequest(Lead):
    """Request to play, with the options of `riot play` but those that name files or code."""

    logs: Annotated[list[_Text], Field(min_length=1, max_length=16)]
    inject: Annotated[str, Field(max_length=1 << 19)] | None = None

    def options(self, agent: AgentOptions, files: Sequence[Path], plan: Path | None) -> PlayOptions:
        """Return the options of the player; raises ConfigError if one is wrong, or a key is closed."""
        from riot_bus.log.limits import tight_limits
        from riot_bus.log.naming import parse_remaps

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
        for target in parse_remaps(options.remap).values():
            check_key(target, where="remap")
        return options

    def check_plan(self) -> None:
        """Raise ConfigError if the injection plan is wrong, or could overload the robot."""
        if self.inject is None:
            return
        from riot_bus.inject.plan import parse_plan

        injections = parse_plan(self.inject, name="inject")
        if len(injections) > 1000:  # each costs time for every message of its topic
            raise ConfigError(f"{len(injections)} injections are too many", where="inject", hint="at most 1000")
        for number, each in enumerate(injections):
            if each.copies > _MOST_COPIES or each.delay > _LONGEST_DELAY_S:
                hint = f"at most {_MOST_COPIES} copies and {_LONGEST_DELAY_S:g} s of delay"
                raise ConfigError("this is too much for a robot", where=f"inject[{number}]", hint=hint)


@_with_options(CaptureOptions)
class RecordRequest(Lead):
    """Request to record, with options of `riot record`."""

    on_lost_controller: Policy = "continue"
    keys: _Texts = ["**"]
    output: _Text | None = None

    def options(self, agent: AgentOptions) -> CaptureOptions:
        """Return the options of the recorder; raises ConfigError if one, or the file, cannot be used."""
        from riot_bus.control.log_paths import safe_path

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
    """Return a received request, checked; raises ConfigError with the place and what was expected."""
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


Action = Literal["pause", "resume", "stop"]


class ControllerWatch:
    """Decides what to do when a controller is lost and when it returns.

    A controller is lost when it was not seen for the grace time; then the action of the policy is taken, once. A paused
    operation is resumed when the controller is back; a stop is final.
    """

    def __init__(self, policy: Policy, grace: float, now: float) -> None:
        self.policy = policy
        self._grace = grace
        self._seen = now
        self._lost = False

    def look(self, now: float, *, present: bool) -> Action | None:
        """Note whether the controller is present; return what to do now."""
        if present:
            back, self._seen, self._lost = self._lost, now, False
            return "resume" if back and self.policy == "pause" else None
        if self._lost or now - self._seen < self._grace:
            return None
        self._lost = True
        return None if self.policy == "continue" else self.policy

    def away(self, now: float) -> float:
        """Return for how many seconds it has not been seen."""
        return max(0.0, now - self._seen)
