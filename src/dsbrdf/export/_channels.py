"""The refusal of models that a format of three colours cannot hold."""

from __future__ import annotations

__all__ = ["require_rgb"]


def require_rgb(n_channels: int, what: str) -> None:
    """Raise ValueError unless there are three channels.

    Parameters
    ----------
    n_channels : int
    what : str
        What wants them, as the subject of the sentence.
    """
    if n_channels != 3:
        raise ValueError(
            f"{what} has 3 channels, linear sRGB; the model has {n_channels}. Make a model of three: the same "
            "index of the channel axis in kappa, gamma, beta and spike, by model.replace."
        )
