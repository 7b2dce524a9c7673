"""Every block of the toolbox, by family. Importing this registers them all."""

from typing import Any

from tsmblocks.blocks.arithmetic import Abs as Abs
from tsmblocks.blocks.arithmetic import Convert as Convert
from tsmblocks.blocks.arithmetic import Cos as Cos
from tsmblocks.blocks.arithmetic import Divide as Divide
from tsmblocks.blocks.arithmetic import Gain as Gain
from tsmblocks.blocks.arithmetic import Maximum as Maximum
from tsmblocks.blocks.arithmetic import Minimum as Minimum
from tsmblocks.blocks.arithmetic import Power as Power
from tsmblocks.blocks.arithmetic import Product as Product
from tsmblocks.blocks.arithmetic import Sign as Sign
from tsmblocks.blocks.arithmetic import Sin as Sin
from tsmblocks.blocks.arithmetic import Square as Square
from tsmblocks.blocks.arithmetic import Sum as Sum
from tsmblocks.blocks.arithmetic import Switch as Switch
from tsmblocks.blocks.arithmetic import Tanh as Tanh
from tsmblocks.blocks.changes import Disturbance as Disturbance
from tsmblocks.blocks.changes import Drift as Drift
from tsmblocks.blocks.changes import GainChange as GainChange
from tsmblocks.blocks.changes import GainDrift as GainDrift
from tsmblocks.blocks.changes import HeatedGain as HeatedGain
from tsmblocks.blocks.changes import Jump as Jump
from tsmblocks.blocks.changes import SettlingGain as SettlingGain
from tsmblocks.blocks.changes import SettlingOffset as SettlingOffset
from tsmblocks.blocks.changes import TemporaryGain as TemporaryGain
from tsmblocks.blocks.changes import TemporaryOffset as TemporaryOffset
from tsmblocks.blocks.control import PID as PID
from tsmblocks.blocks.control import FeedforwardCompensator as FeedforwardCompensator
from tsmblocks.blocks.control import HysteresisObserver as HysteresisObserver
from tsmblocks.blocks.control import LeadLag as LeadLag
from tsmblocks.blocks.control import PIDController as PIDController
from tsmblocks.blocks.control import SmoothSlope as SmoothSlope
from tsmblocks.blocks.delays import DeadTime as DeadTime
from tsmblocks.blocks.delays import Lag as Lag
from tsmblocks.blocks.discrete import DiscreteIntegrator as DiscreteIntegrator
from tsmblocks.blocks.discrete import DiscretePID as DiscretePID
from tsmblocks.blocks.discrete import DiscreteStateSpace as DiscreteStateSpace
from tsmblocks.blocks.discrete import DiscreteTransferFunction as DiscreteTransferFunction
from tsmblocks.blocks.discrete import MovingAverage as MovingAverage
from tsmblocks.blocks.discrete import UnitDelay as UnitDelay
from tsmblocks.blocks.discrete import ZeroOrderHold as ZeroOrderHold
from tsmblocks.blocks.friction import AsymmetricFriction as AsymmetricFriction
from tsmblocks.blocks.friction import CoulombFriction as CoulombFriction
from tsmblocks.blocks.friction import DahlFriction as DahlFriction
from tsmblocks.blocks.friction import LuGreFriction as LuGreFriction
from tsmblocks.blocks.friction import QuadraticDrag as QuadraticDrag
from tsmblocks.blocks.friction import SlidingMass as SlidingMass
from tsmblocks.blocks.friction import StribeckFriction as StribeckFriction
from tsmblocks.blocks.friction import ViscousFriction as ViscousFriction
from tsmblocks.blocks.function import function_block as function_block
from tsmblocks.blocks.hydraulics import Overflow as Overflow
from tsmblocks.blocks.hysteresis import AsymmetricBoucWen as AsymmetricBoucWen
from tsmblocks.blocks.hysteresis import BoucWen as BoucWen
from tsmblocks.blocks.hysteresis import DahlHysteresis as DahlHysteresis
from tsmblocks.blocks.hysteresis import ElasticBacklash as ElasticBacklash
from tsmblocks.blocks.hysteresis import GeneralizedBoucWen as GeneralizedBoucWen
from tsmblocks.blocks.hysteresis import Play as Play
from tsmblocks.blocks.hysteresis import PrandtlIshlinskii as PrandtlIshlinskii
from tsmblocks.blocks.hysteresis import TaoBacklash as TaoBacklash
from tsmblocks.blocks.limits import DeadZone as DeadZone
from tsmblocks.blocks.limits import EndStops as EndStops
from tsmblocks.blocks.limits import Quantiser as Quantiser
from tsmblocks.blocks.limits import RateLimit as RateLimit
from tsmblocks.blocks.limits import Relay as Relay
from tsmblocks.blocks.limits import Saturation as Saturation
from tsmblocks.blocks.limits import SoftDeadZone as SoftDeadZone
from tsmblocks.blocks.limits import SoftRateLimit as SoftRateLimit
from tsmblocks.blocks.limits import SoftSaturation as SoftSaturation
from tsmblocks.blocks.linear import Delay as Delay
from tsmblocks.blocks.linear import Derivative as Derivative
from tsmblocks.blocks.linear import FilteredDerivative as FilteredDerivative
from tsmblocks.blocks.linear import FirstOrderLag as FirstOrderLag
from tsmblocks.blocks.linear import Integrator as Integrator
from tsmblocks.blocks.linear import SecondOrderLag as SecondOrderLag
from tsmblocks.blocks.logic import Comparison as Comparison
from tsmblocks.blocks.logic import Logic as Logic
from tsmblocks.blocks.logic import StateMachine as StateMachine
from tsmblocks.blocks.logic import TriggeredHold as TriggeredHold
from tsmblocks.blocks.loops import LoopAsymmetry as LoopAsymmetry
from tsmblocks.blocks.loops import LoopChange as LoopChange
from tsmblocks.blocks.loops import NonlocalMemory as NonlocalMemory
from tsmblocks.blocks.loops import PositionDependentLoop as PositionDependentLoop
from tsmblocks.blocks.loops import Stretch as Stretch
from tsmblocks.blocks.loops import StribeckStretch as StribeckStretch
from tsmblocks.blocks.lti import StateSpace as StateSpace
from tsmblocks.blocks.lti import TransferFunction as TransferFunction
from tsmblocks.blocks.lti import ZeroPoleGain as ZeroPoleGain
from tsmblocks.blocks.lti import from_control as from_control
from tsmblocks.blocks.motor import DCMotor as DCMotor
from tsmblocks.blocks.motor import MotorTransferFunction as MotorTransferFunction
from tsmblocks.blocks.sensors import Bias as Bias
from tsmblocks.blocks.sensors import Encoder as Encoder
from tsmblocks.blocks.sensors import GainError as GainError
from tsmblocks.blocks.sensors import SensorNoise as SensorNoise
from tsmblocks.blocks.sources import Chirp as Chirp
from tsmblocks.blocks.sources import Constant as Constant
from tsmblocks.blocks.sources import MultiSine as MultiSine
from tsmblocks.blocks.sources import Ramp as Ramp
from tsmblocks.blocks.sources import Random as Random
from tsmblocks.blocks.sources import Recorded as Recorded
from tsmblocks.blocks.sources import Sine as Sine
from tsmblocks.blocks.sources import Staircase as Staircase
from tsmblocks.blocks.sources import Step as Step
from tsmblocks.blocks.sources import Triangle as Triangle
from tsmblocks.blocks.switching import Enable as Enable
from tsmblocks.blocks.switching import Trigger as Trigger
from tsmblocks.blocks.tables import LookupTable as LookupTable
from tsmblocks.blocks.tables import LookupTable2D as LookupTable2D
from tsmblocks.blocks.tendon import CapstanFriction as CapstanFriction
from tsmblocks.blocks.transmission import AsymmetricGain as AsymmetricGain
from tsmblocks.blocks.transmission import Bend as Bend
from tsmblocks.blocks.transmission import Bow as Bow
from tsmblocks.blocks.transmission import BroadCreep as BroadCreep
from tsmblocks.blocks.transmission import Creep as Creep
from tsmblocks.blocks.transmission import ParallelResonance as ParallelResonance
from tsmblocks.blocks.transmission import RateDependence as RateDependence
from tsmblocks.blocks.transmission import Resonance as Resonance
from tsmblocks.blocks.transmission import Ripple as Ripple
from tsmblocks.blocks.transmission import Slack as Slack

__all__ = sorted(  # noqa: PLE0605 - one list of names is enough
    name for name, thing in globals().items() if getattr(thing, "__module__", "").startswith(__name__)
)


def __getattr__(name: str) -> Any:
    from tsmblocks.common.errors import no_such_name
    from tsmblocks.model.aliases import block_hint

    raise no_such_name(__name__, name, block_hint(name, __all__))
