"""Causes: why an image of any renderer is not the reference, from the image alone, by simulated defects."""

from harness.diagnosis.causes.catalogue import Defect, load_defects
from harness.diagnosis.causes.diagnose import diagnose
from harness.diagnosis.causes.record import Cause, Diagnosis
from harness.diagnosis.causes.repairs import Repair, repairs

__all__ = ["Cause", "Defect", "Diagnosis", "Repair", "diagnose", "load_defects", "repairs"]
