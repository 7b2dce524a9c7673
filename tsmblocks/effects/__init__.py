"""Effects that a model may lack, each a block to be put on a wire: the catalogue that a diagnosis searches."""

from tsmblocks.effects.catalogue import catalogue, register, registered, relatives
from tsmblocks.effects.effect import Effect
from tsmblocks.effects.relative import REPLACED, Relative, Replacement, replacement
from tsmblocks.effects.sizes import Size
from tsmblocks.effects.trials import Scales, Span, Trials, span_of

__all__ = [
    "REPLACED",
    "Effect",
    "Relative",
    "Replacement",
    "Scales",
    "Size",
    "Span",
    "Trials",
    "catalogue",
    "register",
    "registered",
    "relatives",
    "replacement",
    "span_of",
]
