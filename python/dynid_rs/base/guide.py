"""Where the documentation is, for messages and help: whoever has installed the wheel has no folder docs/."""

from __future__ import annotations

REPOSITORY = "https://github.com/dynid-rs/dynid_rs"
"""As in pyproject.toml and Cargo.toml."""
DOCUMENTATION = f"{REPOSITORY}/tree/main/docs"


def page(name: str) -> str:
    """Address of a page of the documentation.

    Parameters
    ----------
    name : str
        As "how_to/logs": its place below docs/, without its suffix.
    """
    return f"{REPOSITORY}/blob/main/docs/{name}.md"
