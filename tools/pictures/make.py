"""Makes the README's picture from the demo's report (needs chromium): python tools/pictures/make.py

Takes the verdict, the table of errors and the rig from above and in 3D out of out/demo/demo.report.html, lays them side
by side, and photographs them.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
REPORT = ROOT / "out" / "demo" / "demo.report.html"
PICTURE = Path(__file__).with_name("report.png")
WIDTH, HEIGHT = 1360, 1180


def section(page: str, name: str) -> str:
    """One section of the report."""
    found = re.search(rf'<section id="{name}">.*?</section>', page, re.DOTALL)
    if found is None:
        raise SystemExit(f"{REPORT} has no section {name}")
    return found[0]


def main() -> None:
    """Write the picture."""
    page = REPORT.read_text(encoding="utf-8")
    head = page[: page.index("<body")]
    header = re.search(r"<header>.*?</header>", page, re.DOTALL)
    left = f"{header[0] if header else ''}{section(page, 'next')}{section(page, 'rmse')}"
    columns = (
        "<style>body { max-width: none } #rig figcaption { display: none }</style>"
        '<div style="display:flex;gap:32px"><div style="flex:none;width:820px">'
        f'{left}</div><div style="flex:none;width:430px">{section(page, "rig")}</div></div>'
    )
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "picture.html"
        source.write_text(f'{head}<body><main style="max-width:none;padding:16px">{columns}</main></body></html>')
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run"]
        options += ["--hide-scrollbars", f"--user-data-dir={folder}/profile", f"--window-size={WIDTH},{HEIGHT}"]
        subprocess.run(["chromium", *options, f"--screenshot={PICTURE}", f"file://{source}"], check=True)


if __name__ == "__main__":
    main()
