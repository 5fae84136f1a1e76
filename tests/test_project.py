"""The project's own files keep their promises: pins with hashes, no addresses, a README that follows the code."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def pins():
    text = (ROOT / "constraints.txt").read_text()
    return {name.lower() for name in re.findall(r"^([A-Za-z0-9._-]+)==\S+", text, re.MULTILINE)}


def test_every_dependency_is_pinned_with_a_hash():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = [*project["project"]["dependencies"], *project["project"]["optional-dependencies"]["dev"]]
    wanted += project["build-system"]["requires"]
    names = {re.split(r"[<>=!\[ ]", entry)[0].lower() for entry in wanted}
    assert names <= pins()
    for block in re.split(r"\n(?=\S)", (ROOT / "constraints.txt").read_text().strip()):
        assert "--hash=sha256:" in block, block.splitlines()[0]


def test_pins_hold_names_versions_and_hashes_only():
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        assert re.fullmatch(r"\S+==\S+( ;[^\\]+)? \\|    --hash=sha256:[0-9a-f]{64}( \\)?|", line), line


READMES = sorted(
    [
        ROOT / "README.md",
        *(p for top in ("rig_configs", "recognition", "rigcal", "tools") for p in (ROOT / top).rglob("README.md")),
    ]
)


def test_the_table_of_gates_is_the_one_that_the_code_has():
    script = ROOT / "tools" / "gates_table.py"
    made = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True).stdout.strip()
    assert made in (ROOT / "rig_configs" / "README.md").read_text(), "renew it with: python tools/gates_table.py"


@pytest.mark.parametrize("path", READMES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_readme_names_only_commands_and_files_that_exist(path):
    readme = path.read_text()
    for program in ("rigcal", "recognition"):
        shown = subprocess.run(
            [Path(sys.executable).parent / program, "--help"], capture_output=True, text=True, check=True
        ).stdout
        commands = set(re.findall(r"^  ([a-z]+)  ", shown, re.MULTILINE))
        used = set(re.findall(rf"(?:^|`){program} ([a-z]+) ", readme, re.MULTILINE))
        assert used or path.parent != ROOT
        assert used <= commands, used - commands
    for named in re.findall(r"`((?:rigcal|recognition|rig_configs|tests|tools)/[\w./-]+)`", readme):
        assert (ROOT / named).exists(), named
    for target in re.findall(r"^make ([\w-]+)|`make ([\w-]+)`", readme, re.MULTILINE):
        assert f"\n{target[0] or target[1]}:" in (ROOT / "Makefile").read_text()
