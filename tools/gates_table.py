"""Prints the table of gates that stands in rig_configs/README.md: `python tools/gates_table.py`."""

from __future__ import annotations

from rigcal.site import GateLimits


def table() -> str:
    """The gates as a Markdown table: name, default limit, what it measures."""
    rows = ["| gate | default | what it measures |", "|---|---|---|"]
    rows += [
        f"| `{name}` | {field.default:g} | {field.description} |" for name, field in GateLimits.model_fields.items()
    ]
    return "\n".join(rows)


if __name__ == "__main__":
    print(table())
