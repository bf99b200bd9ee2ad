"""What two encoders per joint reveal: gears that yield, play, clocks that differ, encoders that are not centred."""

from dynid_rs.diagnosis.deflection.examine import examine_deflection, examine_signals
from dynid_rs.diagnosis.deflection.findings import DeflectionFinding
from dynid_rs.diagnosis.deflection.parameters import Parameter
from dynid_rs.diagnosis.deflection.signals import GearSignals

__all__ = ["DeflectionFinding", "GearSignals", "Parameter", "examine_deflection", "examine_signals"]
