"""Boards to print: a true-to-scale PDF with rulers, on one sheet or on several to be glued together."""

from rigcal.target.caption import symmetry_warning
from rigcal.target.drawing import draw_target
from rigcal.target.layout import TargetPlan, plan_target
from rigcal.target.paper import TargetOptions, page_text, parse_margin, parse_page

__all__ = [
    "TargetOptions",
    "TargetPlan",
    "draw_target",
    "page_text",
    "parse_margin",
    "parse_page",
    "plan_target",
    "symmetry_warning",
]
