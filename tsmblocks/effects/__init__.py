"""Effects that a model may lack, each a block to be put on a wire: the catalogue that a diagnosis searches."""

from tsmblocks.effects.catalogue import catalogue, register, registered
from tsmblocks.effects.effect import Effect, Scales, Span, Trials, span_of

__all__ = ["Effect", "Scales", "Span", "Trials", "catalogue", "register", "registered", "span_of"]
