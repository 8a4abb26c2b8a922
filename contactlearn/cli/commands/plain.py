"""The door between a composed configuration and the library: plain values on the other side."""

from typing import Any

from omegaconf import DictConfig, OmegaConf


def plain_values(part: DictConfig) -> dict[str, Any]:
    """Return a part of a configuration as plain values by name, with everything in place that it refers to."""
    values = OmegaConf.to_container(part, resolve=True)
    assert isinstance(values, dict)  # a part that is given and not null
    return {str(name): value for name, value in values.items()}
