"""The errors a user can meet. A caller's programming mistake raises ValueError instead."""

from __future__ import annotations

from collections.abc import Mapping


class SkytraceError(Exception):
    """Base of the errors that become one clear message on the command line."""

    exit_code = 1


class InputError(SkytraceError):
    """A file that is missing, malformed or contradictory; the message names file, line and what was expected."""

    exit_code = 3

    def __init__(self, path: object, message: str, *, line: int | None = None) -> None:
        self.path = str(path)
        self.line = line
        self.message = message
        where = self.path if line is None else f"{self.path}:{line}"
        super().__init__(f"{where}: {message}")


class ReconstructionError(SkytraceError):
    """The data do not determine a reconstruction: which stage found out, from which counts, and what may help."""

    exit_code = 4

    def __init__(
        self,
        stage: str,
        reason: str,
        *,
        camera: str | None = None,
        counts: Mapping[str, float] | None = None,
        threshold: float | None = None,
        hint: str = "",
    ) -> None:
        self.stage = stage
        self.reason = reason
        self.camera = camera
        self.counts = dict(counts or {})
        self.threshold = threshold
        self.hint = hint
        text = f"{stage}: {reason}"
        if camera is not None:
            text += f" (camera {camera})"
        if self.counts:
            text += " [" + ", ".join(f"{k} {v:g}" for k, v in self.counts.items()) + "]"
        if threshold is not None:
            text += f" (needed: {threshold:g})"
        if hint:
            text += f". {hint}"
        super().__init__(text)
