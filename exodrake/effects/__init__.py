"""The shelf: one line per effect."""

from exodrake.block import Effect
from exodrake.effects import tendon_capstan_friction

SHELF: tuple[Effect, ...] = (tendon_capstan_friction.EFFECT,)
