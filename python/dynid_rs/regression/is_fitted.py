"""What has not been fitted yet says so, as scikit-learn's estimators do."""

from __future__ import annotations

from typing import Any


def check_is_fitted(estimator: Any, attribute: str) -> None:
    """Refuse an estimator that has not learned an attribute.

    Raises
    ------
    NotFittedError
        scikit-learn's, a ValueError.
    """
    if hasattr(estimator, attribute):
        return
    from sklearn.exceptions import NotFittedError

    raise NotFittedError(f"This {type(estimator).__name__} instance is not fitted yet; call fit before using it.")
