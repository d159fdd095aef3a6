"""How large a report page is and how long it takes to open, in headless Chromium with software rendering.

    python -m benchmarks.report_page RUN [--times N]

From the request to open the page until every figure is drawn, each time in a browser that was just started.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "browser"))

from chromium import browser

DRAWN = "document.documentElement?.dataset.report === 'drawn'"


def main() -> None:
    """Open the page several times and print seconds and size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="RUN folder")
    parser.add_argument("--times", type=int, default=4)
    arguments = parser.parse_args()
    page = arguments.run.absolute() / "report.html"
    seconds = []
    for _ in range(arguments.times):
        with browser() as running:
            running.emulate(1280, 900)
            start = time.perf_counter()
            running.open(page)
            running.wait_until(DRAWN)
            seconds.append(time.perf_counter() - start)
            complaints = running.complaints()
    print(f"{page.stat().st_size / 1e6:.1f} MB; opened in " + ", ".join(f"{s:.1f}" for s in seconds) + " s")
    print(f"complaints of the browser: {complaints or 'none'}")


if __name__ == "__main__":
    main()
