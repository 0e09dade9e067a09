"""The rule learner as a scikit-learn estimator: rules from an existing table, without asking for trials."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.generalize.rules import learn_from
from riot_bus.generalize.sampling import Variable
from riot_bus.generalize.table import Table
from riot_bus.vocabulary.errors import MissingExtraError

if TYPE_CHECKING:
    from riot_bus.generalize.features import Array
    from riot_bus.generalize.rule import Rule

__all__ = ["RuleClassifier"]


class RuleClassifier:
    """Classifier that learns the shortest rule for the second of two classes, such as failures.

    scikit-learn is needed to fit it, not to import it.

    Args:
        most_samples: Maximum number of samples to learn from, evenly thinned out: 500 take the search a second.

    Attributes:
        rule_: The rule (`riot_bus.generalize.rule.Rule`): `rule_.text()`, `rule_.to_json()`.
        classes_: The two classes; the rule holds for the second one.
        scale_: Spread of each column, the unit of the distance.
        n_features_in_: Number of columns.
        feature_names_in_: Names of the columns, if X had any; else they are called x0, x1, ...
    """

    _estimator_type = "classifier"

    def __init__(self, most_samples: int = 2000) -> None:
        self.most_samples = most_samples

    def fit(self, X: Any, y: Any) -> RuleClassifier:  # noqa: N803 - names of scikit-learn
        """Learn a rule.

        Args:
            X: (samples, columns): finite numbers; integers stay exact.
            y: (samples,): one of two classes each.

        Raises:
            ValueError: X or y is something else.
            MissingExtraError: scikit-learn is not installed.
        """
        validation, multiclass = _sklearn("utils.validation"), _sklearn("utils.multiclass")
        table, labels = validation.validate_data(self, X, y, dtype=None)
        table = _numbers(table)
        multiclass.check_classification_targets(labels)
        self.classes_, codes = np.unique(labels, return_inverse=True)
        if len(self.classes_) > 2:
            raise ValueError(
                f"Only binary classification is supported. The type of the target is "
                f"{multiclass.type_of_target(labels)}: {len(self.classes_)} classes."
            )
        if len(self.classes_) < 2:
            raise ValueError(f"Classifier can't train when only one class is present: {self.classes_[0]!r}")
        step = -(-len(table) // max(1, self.most_samples))
        rows, failed = table[::step], (codes[::step] == 1).tolist()
        self._names = [str(name) for name in getattr(self, "feature_names_in_", _plain_names(table.shape[1]))]
        with np.errstate(over="ignore"):
            spreads = np.asarray(table, dtype=np.float64).std(axis=0)
        self.scale_ = {name: float(spread) for name, spread in zip(self._names, spreads, strict=True)}
        type_ = {"b": "bool", "i": "int64", "u": "uint64"}.get(table.dtype.kind, "float64")
        columns = [column.tolist() for column in rows.T]
        variables = [
            Variable(name, type_, column[0], nominal=tuple(column[:64]))
            for name, column in zip(self._names, columns, strict=True)
        ]
        samples = Table(variables)
        samples.add([dict(zip(self._names, row, strict=True)) for row in zip(*columns, strict=True)], failed)
        self.rule_: Rule = learn_from(samples)[0].rule
        return self

    def predict(self, X: Any) -> Array:  # noqa: N803
        """Return (samples,): the second class where the rule holds, else the first."""
        columns = self._columns(X)
        return np.asarray(self.classes_[self.rule_.predict(columns).astype(int)])

    def decision_function(self, X: Any) -> Array:  # noqa: N803
        """Return (samples,): minus the distance to the rule in units of `scale_`, positive where it holds."""
        columns = self._columns(X)
        return -self.rule_.distance(columns, self.scale_)

    def score(self, X: Any, y: Any, sample_weight: Any = None) -> float:  # noqa: N803
        """Return the share of the samples whose class the rule predicts correctly."""
        return float(_sklearn("metrics").accuracy_score(y, self.predict(X), sample_weight=sample_weight))

    def _columns(self, X: Any) -> dict[str, Array]:  # noqa: N803
        validation = _sklearn("utils.validation")
        validation.check_is_fitted(self)
        table = _numbers(validation.validate_data(self, X, dtype=None, reset=False))
        return {name: table[:, number] for number, name in enumerate(self._names)}

    def get_params(self, *, deep: bool = True) -> dict[str, Any]:
        """Return the arguments, as scikit-learn asks for them."""
        return {name: getattr(self, name) for name in inspect.signature(type(self)).parameters}

    def set_params(self, **params: Any) -> RuleClassifier:
        """Set arguments.

        Raises:
            ValueError: There is no argument of that name.
        """
        for name, value in params.items():
            if name not in self.get_params():
                raise ValueError(f"Invalid parameter {name!r}; known: {', '.join(self.get_params())}")
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self.get_params().items())})"

    def __sklearn_tags__(self) -> Any:
        tags = _sklearn("utils")
        return tags.Tags(
            estimator_type="classifier",
            target_tags=tags.TargetTags(required=True),
            classifier_tags=tags.ClassifierTags(multi_class=False),
            input_tags=tags.InputTags(),
        )


def _sklearn(module: str) -> Any:
    import importlib

    try:
        return importlib.import_module(f"sklearn.{module}")
    except ImportError:
        raise MissingExtraError("scikit-learn", "analysis") from None


def _numbers(table: Any) -> Any:
    """Return a table of numbers; other kinds, such as objects, are converted to floats."""
    return table if table.dtype.kind in "biuf" else table.astype(np.float64)


def _plain_names(count: int) -> list[str]:
    return [f"x{number}" for number in range(count)]
