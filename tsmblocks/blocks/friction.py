"""Blocks that give a friction force (or torque) from a sliding velocity.

One sign convention: ``y`` is the force that the motion has to overcome, positive for positive
``v``; an equation of motion subtracts it. Units are free (``?v``, ``?f``); the defaults are in
rad/s and N*m, of the size of a small geared motor at its output shaft.

Signs are rounded with tanh over a ``smoothing`` velocity: a discontinuity at rest cannot be integrated at a fixed step,
and has no derivative for a fit. Below that velocity a body creeps. Where it must stick, use a ``SlidingMass``, whose
dry friction is inside, or Dahl or LuGre friction.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from tsmblocks.blocks.shared import LONG_AGO
from tsmblocks.model.block import Block, Input, Output, State, block, option, parameter, state


def _falling(coulomb: Any, further: Any, ratio: Any) -> Any:
    """Sliding friction: Coulomb friction, and a further part that falls with the ``ratio`` to the Stribeck speed."""
    return coulomb + further * ca.exp(-(ratio * ratio))


def _stribeck_level(block: Any, v: Any) -> Any:
    """Level of sliding friction at velocity ``v``, between the static and the Coulomb level."""
    return _falling(block.coulomb, block.static - block.coulomb, v / block.stribeck)


@block
class CoulombFriction(Block):
    r"""Coulomb friction: dry friction of constant level.

    .. math:: y = F_c \tanh(v / v_0)
    """

    source = "Olsson and others, Friction models and friction compensation, Eur. J. Control 4 (1998) 176"
    symbol = "Coulomb"
    symbol_with_values = "Coulomb\n{level:unit}"

    level: float = parameter(default=0.02, about="friction while sliding", unit="?f", at_least=0.0)
    smoothing: float = parameter(
        default=0.01, about="speed within which the force reverses", unit="?v", above=0.0, acts_at="v"
    )
    v = Input("sliding velocity", unit="?v")
    y = Output("friction to be overcome, positive for positive velocity", unit="?f")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.level * ca.tanh(u.v / self.smoothing))


@block
class AsymmetricFriction(Block):
    r"""Dry and viscous friction that differ between the two directions.

    .. math::

        y = \frac{1 + s}{2} (F_+ s + b_+ v) + \frac{1 - s}{2} (F_- s + b_- v),
        \qquad s = \tanh(v / v_0)

    It tends to :math:`F_+ + b_+ v` forwards and to :math:`-F_- + b_- v` backwards.
    """

    source = "Armstrong-Hélouvry, Control of Machines with Friction (1991), one level per direction"
    symbol = "F₊ / F₋"

    level_positive: float = parameter(default=0.02, about="dry friction while moving forwards", unit="?f", at_least=0.0)
    level_negative: float = parameter(default=0.025, about="dry friction while moving back", unit="?f", at_least=0.0)
    viscous_positive: float = parameter(default=0.002, about="friction per velocity forwards", at_least=0.0)
    viscous_negative: float = parameter(default=0.0025, about="friction per velocity backwards", at_least=0.0)
    smoothing: float = parameter(
        default=0.01, about="speed within which the force reverses", unit="?v", above=0.0, acts_at="v"
    )

    v = Input("sliding velocity", unit="?v")
    y = Output("friction to be overcome, positive for positive velocity", unit="?f")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        s = ca.tanh(u.v / self.smoothing)
        forwards = self.level_positive * s + self.viscous_positive * u.v
        backwards = self.level_negative * s + self.viscous_negative * u.v
        return dict(y=(1 + s) / 2 * forwards + (1 - s) / 2 * backwards)


@block
class ViscousFriction(Block):
    r"""Viscous friction: a force proportional to the velocity.

    .. math:: y = b v
    """

    source = "definition"
    symbol = "b v"
    symbol_with_values = "{coefficient} v"

    coefficient: float = parameter(default=0.002, about="friction per velocity", at_least=0.0)
    v = Input("sliding velocity", unit="?v")
    y = Output("friction to be overcome, positive for positive velocity", unit="?f")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.coefficient * u.v)


@block
class QuadraticDrag(Block):
    r"""Drag that grows with the square of the velocity and opposes it.

    .. math:: y = c |v| v
    """

    source = "definition"
    symbol = "c|v|v"
    symbol_with_values = "{coefficient}|v|v"

    coefficient: float = parameter(default=0.001, about="drag per velocity squared", at_least=0.0)
    v = Input("velocity", unit="?v")
    y = Output("drag to be overcome, positive for positive velocity", unit="?f")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.coefficient * ca.fabs(u.v) * u.v)


@block
class StribeckFriction(Block):
    r"""Stribeck friction: dry friction that falls from a static to a Coulomb level at low speed, plus viscous friction.

    .. math:: y = \left[F_c + (F_s - F_c)\, e^{-(v/v_s)^2}\right] \tanh(v / v_0) + b v

    The static level shows only if the smoothing velocity is well below the Stribeck velocity.
    """

    source = "Bo and Pavelescu, Wear 82 (1982) 277, exponent 2"
    symbol = "Stribeck"

    coulomb: float = parameter(default=0.02, about="friction while sliding fast", unit="?f", at_least=0.0)
    static: float = parameter(default=0.03, about="friction just before sliding", unit="?f", at_least=0.0)
    stribeck: float = parameter(
        default=0.1, about="speed over which the static part falls", unit="?v", above=0.0, acts_at="v"
    )
    viscous: float = parameter(default=0.002, about="friction per velocity", at_least=0.0)
    smoothing: float = parameter(
        default=0.01, about="speed within which the force reverses", unit="?v", above=0.0, acts_at="v"
    )

    v = Input("sliding velocity", unit="?v")
    y = Output("friction to be overcome, positive for positive velocity", unit="?f")

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=_stribeck_level(self, u.v) * ca.tanh(u.v / self.smoothing) + self.viscous * u.v)


@block
class DahlFriction(Block):
    r"""Dahl friction: dry friction that builds up over a small displacement, like a spring that yields.

    .. math:: \dot z = v - \frac{\sigma_0 |v|}{F_c} z, \qquad y = \sigma_0 z

    Rate-independent: the friction is a function of the path. It holds at rest.
    """

    source = "Dahl, AIAA J. 14 (1976) 1675, exponent 1"
    symbol = "Dahl"

    sigma0: float = parameter(default=2.0, about="stiffness of the contact before it slides", above=0.0)
    coulomb: float = parameter(default=0.02, about="friction while sliding", unit="?f", above=0.0)
    v = Input("sliding velocity", unit="?v")
    y = Output("friction to be overcome, positive for positive velocity", unit="?f")
    z: float = state(default=0.0, about="deflection of the contact", unit="?v*s")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(z=u.v - self.sigma0 * ca.fabs(u.v) * x.z / self.coulomb)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self.sigma0 * x.z)


@block
class LuGreFriction(Block):
    r"""LuGre friction: bristles that bend before they slide, with Stribeck effect.

    .. math::

        \dot z &= v - \frac{\sigma_0 |v|}{g(v)} z, \qquad
        g(v) = F_c + (F_s - F_c)\, e^{-(v/v_s)^2} \\
        y &= \sigma_0 z + \sigma_1 \dot z + \sigma_2 v

    The bristles settle at a rate :math:`\sigma_0 |v| / g(v)`: keep it below about 2.7 per step of
    the engine at the highest velocity.
    """

    source = "Canudas de Wit, Olsson, Åström and Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419"
    symbol = "LuGre"

    sigma0: float = parameter(default=2.0, about="stiffness of the bristles", above=0.0)
    sigma1: float = parameter(default=0.02, about="damping of the bristles", at_least=0.0)
    sigma2: float = parameter(default=0.002, about="viscous friction per velocity", at_least=0.0)
    coulomb: float = parameter(default=0.02, about="friction while sliding fast", unit="?f", above=0.0)
    static: float = parameter(default=0.03, about="friction just before sliding", unit="?f", above=0.0)
    stribeck: float = parameter(
        default=0.1, about="speed over which the static part falls", unit="?v", above=0.0, acts_at="v"
    )

    v = Input("sliding velocity", unit="?v")
    y = Output("friction to be overcome, positive for positive velocity", unit="?f")
    z: float = state(default=0.0, about="mean deflection of the bristles", unit="?v*s")

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(z=u.v - self.sigma0 * ca.fabs(u.v) * x.z / _stribeck_level(self, u.v))

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        bending = self.derivatives(t, x, u)["z"]
        return dict(y=self.sigma0 * x.z + self.sigma1 * bending + self.sigma2 * u.v)


def _after(v: Any, gain: Any, lost: Any) -> Any:
    """Speed of a mass that had ``v``, where forces give it ``gain`` at an even rate and dry friction takes ``lost``."""
    way = ca.sign(v)
    slides_on = v + gain - way * lost
    # It stops where its speed is used up. In the rest of the time it starts anew, where the force overcomes friction.
    left = 1 - ca.fabs(v) / ca.fmax(ca.fmax(lost - way * gain, ca.fabs(v)), 1e-300)
    starts = left * ca.sign(gain) * ca.fmax(ca.fabs(gain) - lost, 0)
    return ca.if_else(way * slides_on > 0, slides_on, starts)


@block
class SlidingMass(Block):
    r"""A mass with dry friction that sticks: its speed is exactly zero where the force does not overcome the friction.

    .. math::

        m \dot v = u - b v - f, \qquad f \begin{cases}
            = g(v) \operatorname{sign} v & v \ne 0 \\
            \in [-g(0), g(0)] & v = 0
        \end{cases}, \qquad g(v) = F_c + F_b\, e^{-(v/v_s)^2}

    The friction is set-valued at rest. Within a step its level is that of the mean speed, and the other forces act by
    their impulse: the instant at which the mass stops, and whether it sticks, follow in closed form. Without
    ``breakaway``, sliding is as exact as the method, and a stop or a reversal is exact where the force is constant over
    the step. Nothing creeps, and no smoothing speed limits the step.
    """

    source = "Karnopp, J. Dynamic Systems, Measurement, and Control 107 (1985) 100; the stop within a step is our own"
    symbol = "mass\nsticks"
    symbol_with_values = "mass {mass}\nsticks: {coulomb:unit}"

    mass: float = parameter(default=1.0, about="mass or inertia", above=0.0)
    coulomb: float = parameter(default=0.02, about="friction while sliding fast", unit="?u", at_least=0.0)
    breakaway: float = parameter(default=0.0, about="further friction at rest", unit="?u", at_least=0.0)
    stribeck: float = parameter(default=0.1, about="speed over which breakaway falls", unit="?y", above=0.0)
    viscous: float = parameter(default=0.0, about="friction per speed", at_least=0.0)
    unit: str = option(default="", about="unit of the speed")

    u = Input("force or torque, without the friction", unit="?u")
    y = Output("speed", unit="?y", unit_option="unit")
    v: float = state(default=0.0, about="speed at the start of the step", unit="?y")

    @property
    def states(self) -> dict[str, State]:
        return {
            **super().states,
            "gained": State(0.0, "speed that all forces but dry friction have given", "?y"),
            "before": State(0.0, "the same at the start of the step", "?y"),
            "time": State(LONG_AGO, "start of the step", "s"),
        }

    def _level(self, v: Any) -> Any:
        """Friction at a speed."""
        return _falling(self.coulomb, self.breakaway, v / self.stribeck)

    def _speed(self, t: Any, x: Any) -> Any:
        """The speed at time ``t`` of a step, whose friction is that of the mean of the speeds at its start and then."""
        gain, passed = x.gained - x.before, (t - x.time) / self.mass
        first = _after(x.v, gain, self._level(x.v) * passed)
        mean = self._level((ca.fabs(x.v) + ca.fabs(first)) / 2) * passed
        return ca.if_else(x.time > 0.5 * LONG_AGO, _after(x.v, gain, mean), x.v)

    def derivatives(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(gained=(u.u - self.viscous * self._speed(t, x)) / self.mass)

    def updates(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(v=self._speed(t, x), before=x.gained, time=t)

    def outputs(self, t: Any, x: Any, u: Any) -> dict[str, Any]:
        return dict(y=self._speed(t, x))
