"""The steps of the chain as data, in order: the name of each, the record it writes, and the function that runs it.

The chain, the command line and the report read this table. Records and functions are named as entry points name them,
`module:attribute`, so that this module costs nothing to import.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, cast

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.findings.records import Artefact


class StepOption(NamedTuple):
    """An option of a step on the command line.

    Attributes:
        name: Name of the argument of the step's function; the option is called `--name`.
        default: Its value if it is not given; decides the type: int, float, str, bool, or () for texts, repeatable.
        help: Meaning of the option, in a line.
        min: Smallest value.
    """

    name: str
    default: bool | int | float | str | tuple[()]
    help: str
    min: int | None = None


class ChainStep(NamedTuple):
    """A step of the chain: it takes the files of a finding and adds one of its own.

    Attributes:
        name: Name on the command line and in events: `minimize`.
        title: Name of its result, in two or three words: a heading of the report.
        help: Purpose of the step, in a line.
        record: Class of its file (an `Artefact`), or the name of the class.
        run: Function that carries it out, or its name: takes a `StepRun`, the folder of the finding and the options,
            and returns the record. None for `test`, which makes findings instead of taking one.
        options: Options of the function.
        whole_system: Whether it needs a system whose external topics are known.
    """

    name: str
    title: str
    help: str
    record: str | type[Artefact]
    run: str | Callable[..., Artefact] | None = None
    options: tuple[StepOption, ...] = ()
    whole_system: bool = False

    @property
    def kind(self) -> type[Artefact]:
        """Class of its record."""
        return cast("type[Artefact]", _named(self.record))

    @property
    def function(self) -> Callable[..., Artefact]:
        """Function that carries it out."""
        return cast("Callable[..., Artefact]", _named(self.run))


TEST = ChainStep(
    "test",
    "failing log",
    "Test one unit with exceptional values and group its failures into findings.",
    "riot_bus.findings.records:FindingRecord",
)
MINIMIZE = ChainStep(
    "minimize",
    "minimal log",
    "Shrink a finding's failing log to the few messages that are needed.",
    "riot_bus.findings.records:MinimalRecord",
    "riot_bus.chain.steps.minimize:minimize",
    (StepOption("budget", 2000, "Maximum number of trials.", min=2),),
)
RELEVANCE = ChainStep(
    "relevance",
    "relevant fields",
    "Find the fields that matter, each shown by two trials that differ in it alone.",
    "riot_bus.findings.records:FieldsRecord",
    "riot_bus.chain.steps.relevance:relevance",
    (StepOption("budget", 1000, "Maximum number of trials of the search.", min=2),),
)
RULES = ChainStep(
    "rules",
    "rule",
    "Learn when exactly the unit fails, as a rule in one line.",
    "riot_bus.findings.records:RuleRecord",
    "riot_bus.chain.steps.rules:rules",
    (StepOption("budget", 160, "Trials for learning.", min=10),),
)
PERMEABILITY = ChainStep(
    "permeability",
    "external fields",
    "Find the external fields that reach the relevant ones, by perturbing the whole system.",
    "riot_bus.findings.permeability:PermeabilityRecord",
    "riot_bus.chain.steps.permeability:permeability",
    (
        StepOption(
            "runs", 8, "Long runs of the whole system; where these cannot tell, several times as many follow.", min=2
        ),
        StepOption("prune", True, "Leave out what has no declared path to the relevant fields."),  # noqa: FBT003
    ),
    whole_system=True,
)
ACTIVATE = ChainStep(
    "activate",
    "activation",
    "Drive the external inputs until the whole system fails.",
    "riot_bus.findings.activation:ActivationRecord",
    "riot_bus.chain.steps.activation:activation",
    (
        StepOption("budget", 200, "Runs of the whole system for the search; at most as many more confirm it.", min=1),
        StepOption("search", (), "A search method; repeatable. [default: simplex, forest and evolution in turns]"),
        StepOption("study", "", "Share the search as an Optuna study in this database, such as sqlite:///studies.db."),
    ),
    whole_system=True,
)

STEPS = (TEST, MINIMIZE, RELEVANCE, RULES, PERMEABILITY, ACTIVATE)


def further_steps() -> list[str]:
    """Return the names of the steps that other packages bring."""
    from riot_bus import plugins

    return [name for name in plugins.STEPS.targets() if name not in {step.name for step in STEPS}]


def find_step(name: str) -> ChainStep:
    """Return a step by its name, ours or another package's.

    Raises:
        ConfigError: There is no such step, it cannot be imported, or it cannot be used.
    """
    from riot_bus import plugins
    from riot_bus.vocabulary.errors import ConfigError

    found = plugins.STEPS.load(name)
    hint = f"its entry point has to name a riot_bus.findings.steps.ChainStep whose name is {name!r}"
    if not isinstance(found, ChainStep) or found.name != name:
        raise ConfigError(f"step {name!r} is {found!r}", where=plugins.STEPS.targets()[name], hint=hint)
    if name in further_steps() and found.kind.FILE not in {f"{name}.json"} - {step.kind.FILE for step in STEPS}:
        where, hint = plugins.STEPS.targets()[name], f"FILE of its record {found.kind.__name__} is how reports find it"
        text = f"step {name!r} writes {found.kind.FILE}, not a {name}.json of its own"
        raise ConfigError(text, where=where, hint=hint)
    return found


def _named(target: Any) -> Any:
    if not isinstance(target, str):
        return target
    module, _, attribute = target.partition(":")
    return getattr(import_module(module), attribute)
