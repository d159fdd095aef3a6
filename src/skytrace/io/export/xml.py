"""What GPX and KML share: text that is safe inside XML."""

from __future__ import annotations

import re
from xml.sax.saxutils import escape

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def xml_text(text: str) -> str:
    """Text for an element's content; characters that XML 1.0 has no way to write become question marks."""
    return escape(_FORBIDDEN.sub("?", text))
