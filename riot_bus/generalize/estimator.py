"""The rule learner as a scikit-learn estimator: rules from an existing table, without asking for trials.

Raises:
    MissingExtraError: scikit-learn is not installed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from riot_bus.generalize.rules import learn_from
from riot_bus.generalize.sampling import Variable
from riot_bus.generalize.table import Table
from riot_bus.vocabulary.errors import needs_extra

with needs_extra("scikit-learn", "analysis"):
    from sklearn.base import BaseEstimator, ClassifierMixin
    from sklearn.utils.multiclass import check_classification_targets, type_of_target
    from sklearn.utils.validation import check_is_fitted, validate_data

if TYPE_CHECKING:
    from riot_bus.generalize.features import Array
    from riot_bus.generalize.rule import Rule

__all__ = ["RuleClassifier"]


class RuleClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc,unused-ignore] # scikit-learn has no types
    """Classifier that learns the shortest rule for the second of two classes, such as failures.

    Args:
        most_samples: Maximum number of samples to learn from, evenly thinned out: 500 take the search a second.

    Attributes:
        rule_: The rule (`riot_bus.generalize.rule.Rule`): `rule_.text()`, `rule_.to_json()`.
        classes_: The two classes; the rule holds for the second one.
        scale_: Spread of each column, the unit of the distance.
        n_features_in_: Number of columns.
        feature_names_in_: Names of the columns, if X had any; else they are called x0, x1, ...
    """

    def __init__(self, most_samples: int = 2000) -> None:
        self.most_samples = most_samples

    def fit(self, X: Any, y: Any) -> RuleClassifier:  # noqa: N803 - names of scikit-learn
        """Learn a rule.

        Args:
            X: (samples, columns): finite numbers; integers stay exact.
            y: (samples,): one of two classes each.

        Raises:
            ValueError: X or y is something else.
        """
        table, labels = validate_data(self, X, y, dtype=None)
        table = _numbers(table)
        check_classification_targets(labels)
        self.classes_, codes = np.unique(labels, return_inverse=True)
        if len(self.classes_) > 2:
            raise ValueError(
                f"Only binary classification is supported. The type of the target is "
                f"{type_of_target(labels)}: {len(self.classes_)} classes."
            )
        if len(self.classes_) < 2:
            raise ValueError(f"Classifier can't train when only one class is present: {self.classes_[0]!r}")
        step = -(-len(table) // max(1, self.most_samples))
        rows, failed = table[::step], (codes[::step] == 1).tolist()
        plain = [f"x{number}" for number in range(table.shape[1])]
        self._names = [str(name) for name in getattr(self, "feature_names_in_", plain)]
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

    def _columns(self, X: Any) -> dict[str, Array]:  # noqa: N803
        check_is_fitted(self)
        table = _numbers(validate_data(self, X, dtype=None, reset=False))
        return {name: table[:, number] for number, name in enumerate(self._names)}

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags


def _numbers(table: Any) -> Any:
    """Return a table of numbers; other kinds, such as objects, are converted to floats."""
    return table if table.dtype.kind in "biuf" else table.astype(np.float64)
