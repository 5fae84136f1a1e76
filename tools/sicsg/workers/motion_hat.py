"""Hands and hats: an arm that carries one is bent before the body, and goes to the crown when the hat moves there."""

from __future__ import annotations

from dataclasses import dataclass

from tools.sicsg.scene import Thing
from tools.sicsg.workers.ik import smooth
from tools.sicsg.workers.motion_arms import at_crown, holding_hat
from tools.sicsg.workers.motion_posture import Reach, Upper, mixed_reach
from tools.sicsg.workers.motion_rig import SIDES

_REACH_S = 0.5
"""How long before and after the change the hand is on its way."""
_CARRIED = "hard_hat"


@dataclass(frozen=True, slots=True)
class HatWork:
    """How far each arm is drawn to where a carried hat is, and to the crown; left and right, 0..1."""

    carries: tuple[float, float]
    crowns: tuple[float, float]

    def reach(self, side: int, upper: Upper, wished: Reach) -> Reach:
        """What a hand that is free does instead of what is wished."""
        if self.carries[side] > 0.0:
            wished = mixed_reach(upper, side, (wished, holding_hat(upper, side)), self.carries[side])
        if self.crowns[side] > 0.0:
            wished = mixed_reach(upper, side, (wished, at_crown(upper, side)), self.crowns[side])
        return wished


def hat_work(worker: str, things: tuple[Thing, ...], t_s: float) -> HatWork:
    """What the hats of a worker ask of the hands at a time."""
    carries, crowns = [0.0, 0.0], [0.0, 0.0]
    for thing in things:
        if thing.category != _CARRIED:
            continue
        spans = [attachment for attachment in thing.attached if attachment.worker == worker]
        heads = [span for span in spans if span.bone == "head"]
        for span in spans:
            if span.bone == "head":
                continue
            side = SIDES.index(span.bone.removesuffix("_hand"))
            inside = min(t_s - span.start_s, span.end_s - t_s)
            carries[side] = max(carries[side], smooth(0.5 + 0.5 * inside / _REACH_S))
            changes = [span.start_s for head in heads if abs(head.end_s - span.start_s) < 0.05]
            changes += [span.end_s for head in heads if abs(head.start_s - span.end_s) < 0.05]
            for change in changes:
                crowns[side] = max(crowns[side], smooth(1.0 - abs(t_s - change) / _REACH_S))
    return HatWork((carries[0], carries[1]), (crowns[0], crowns[1]))
