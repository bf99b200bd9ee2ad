"""Parameters by name, as scikit-learn's estimators have them.

The same protocol, so that scikit-learn's `clone` takes them; without its base class, whose import takes a second and
fifty megabytes of every command.
"""

from __future__ import annotations

from copy import deepcopy
from inspect import signature
from typing import Any, Self, TypeVar

T = TypeVar("T")


class Estimator:
    """Something with parameters: the constructor only stores them, what is learned ends in an underscore."""

    @classmethod
    def _names(cls) -> list[str]:
        return sorted(name for name in signature(cls.__init__).parameters if name != "self")

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters by name; if `deep`, those of estimators among them too, as ``name__parameter``."""
        params: dict[str, Any] = {}
        for name in self._names():
            value = params[name] = getattr(self, name)
            if deep and _is_estimator(value):
                params |= {f"{name}__{key}": own for key, own in value.get_params().items()}
        return params

    def set_params(self, **params: Any) -> Self:
        """Set parameters by the names of `get_params`.

        Raises
        ------
        ValueError
            There is no such parameter.
        """
        names = self._names()
        for key, value in params.items():
            name, _, rest = key.partition("__")
            if name not in names:
                raise ValueError(f"{type(self).__name__} has no parameter {name!r}, only {', '.join(names)}")
            if rest:
                getattr(self, name).set_params(**{rest: value})
            else:
                setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in self._names())})"


def clone(estimator: T) -> T:
    """Return an estimator with the same parameters that has learned nothing; estimators among them are cloned too."""
    params = estimator.get_params(deep=False)  # type: ignore[attr-defined]
    return type(estimator)(**{n: clone(own) if _is_estimator(own) else deepcopy(own) for n, own in params.items()})


def _is_estimator(value: Any) -> bool:
    return hasattr(value, "get_params") and not isinstance(value, type)
