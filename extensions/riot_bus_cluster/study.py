"""A search as an optuna study, which can be inspected, shared between machines, and continued later."""

from __future__ import annotations

import math
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from riot_bus.backchain.activation import Evaluation
from riot_bus.backchain.encoding import SearchField
from riot_bus.vocabulary.errors import ConfigError, needs_extra

_HINT = "a file of SQLite, such as sqlite:///studies.db, is enough for one machine"

_BY, _FAILED = "riot_bus search", "failed"
"""Attributes of trials: the search that made it, and whether the failure happened."""


class Study:
    """Runs of a search as trials of a study: parameters are values of external fields, the value is the distance.

    Args:
        url: Storage of studies, as optuna takes it, such as `sqlite:///studies.db`.

    Raises:
        ConfigError: The storage cannot be used.
        MissingExtraError: optuna is not installed.
    """

    def __init__(self, url: str, name: str) -> None:
        with needs_extra("optuna", "study"):
            import optuna
        self._optuna: Any = optuna
        self._me = uuid.uuid4().hex
        self._seen: set[int] = set()
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        with _told_plainly():
            self._study = optuna.create_study(storage=url, study_name=name, direction="minimize", load_if_exists=True)

    def add(
        self, points: Sequence[Mapping[str, float]], evaluations: Iterable[Evaluation], fields: Sequence[SearchField]
    ) -> None:
        """Add runs."""
        known = {field.name: field for field in fields}
        for point, found in zip(points, evaluations, strict=True):
            told = found.distance is not None and math.isfinite(found.distance)
            trial = self._optuna.trial.create_trial(
                params={name: round(value) if known[name].integer else value for name, value in point.items()},
                distributions={name: self._distribution(known[name]) for name in point},
                value=found.distance if told else None,
                state=self._optuna.trial.TrialState.COMPLETE if told else self._optuna.trial.TrialState.FAIL,
                user_attrs={_BY: self._me, _FAILED: found.failed},
            )
            with _told_plainly():
                self._study.add_trial(trial)

    def take(self) -> list[tuple[dict[str, float], Evaluation]]:
        """Return the runs that other searches, also earlier ones, have added since the last call."""
        found = []
        with _told_plainly():
            trials = self._study.get_trials(deepcopy=False)
        for trial in trials:
            if trial.number in self._seen or not trial.state.is_finished():
                continue
            self._seen.add(trial.number)
            values = {name: value for name, value in trial.params.items() if isinstance(value, int | float)}
            by = trial.user_attrs.get(_BY)
            if by is not None and by != self._me and len(values) == len(trial.params):
                failed = trial.user_attrs.get(_FAILED) is True
                found.append(({name: float(value) for name, value in values.items()}, Evaluation(trial.value, failed)))
        return found

    def _distribution(self, field: SearchField) -> Any:
        if field.integer:
            return self._optuna.distributions.IntDistribution(math.ceil(field.low), math.floor(field.high))
        return self._optuna.distributions.FloatDistribution(field.low, field.high)


@contextmanager
def _told_plainly() -> Iterator[None]:
    """Turn errors of the storage into ConfigErrors that name the option and the remedy."""
    import optuna
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (SQLAlchemyError, ImportError, ValueError, OSError, optuna.exceptions.OptunaError) as error:
        why = str(error).splitlines()[0]
        raise ConfigError(f"the storage of studies cannot be used: {why}", where="--study", hint=_HINT) from error
