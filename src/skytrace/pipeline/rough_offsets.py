"""The offsets that a FLIGHT must give where they are where synchronisation starts, or all that it has."""

from __future__ import annotations

from skytrace.errors import InputError
from skytrace.estimation.sync_settings import SyncMethod
from skytrace.io.flight import Flight
from skytrace.io.text import read_text
from skytrace.io.toml import parse_toml

_USES: dict[SyncMethod, str] = {
    "paper": "the paper's synchronisation starts from a rough offset of every camera",
    "given": "offsets that are taken as given must be given for every camera",
}


def require_offsets(flight: Flight, method: SyncMethod) -> None:
    """Raise InputError, naming the camera, where a method needs `offset_s` of every camera and one has none."""
    if method not in _USES:
        return
    missing = [k for k, c in enumerate(flight.cameras) if c.offset_s is None]
    if not missing:
        return
    line = parse_toml(flight.path, read_text(flight.path, "flight description")).line("camera", missing[0])
    names = ", ".join(flight.cameras[k].camera_id for k in missing)
    message = (
        f"no offset_s of camera{'s' if len(missing) > 1 else ''} {names}: {_USES[method]}; add offset_s, the time of "
        "its frame 0 in seconds on a clock common to all, or let the exhaustive search find the offsets"
    )
    raise InputError(flight.path, message, line=line)
