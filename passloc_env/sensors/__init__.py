"""What an observer can hear, one sensor per file."""

from passloc_env.sensors.bearing import Bearing
from passloc_env.sensors.doppler import Doppler
from passloc_env.sensors.phase_difference import PhaseDifference
from passloc_env.sensors.radial_acceleration import RadialAcceleration
from passloc_env.sensors.sensor import Sensor
from passloc_env.sensors.time_difference import TimeDifference

__all__ = ["Bearing", "Doppler", "PhaseDifference", "RadialAcceleration", "Sensor", "TimeDifference"]
