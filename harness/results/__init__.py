"""What studies, gates, exhibits, benchmarks and mutants found, as plain values: read by `report` and the commands."""

from harness.results.bench import Benchmark, BenchRow, EntrantRow
from harness.results.exhibits import Exhibit, ExhibitImage, Finding, Plot, Series
from harness.results.features import FeatureImage
from harness.results.gates import (
    AgreementRecord,
    GateEvidence,
    GateNumbers,
    GateRecord,
    LookRecord,
    PartRecord,
    PointRecord,
    RungRecord,
)
from harness.results.mutants import Acquitted, AutopsyOutcome, AutopsyScore, KillRecord, MutantRecord, NamedMutant
from harness.results.pictures import KeptPicture
from harness.results.studies import REJECTED, SECONDS, CoupledRecord, Record, StrategyResult, StudyResult

__all__ = [
    "REJECTED",
    "SECONDS",
    "Acquitted",
    "AgreementRecord",
    "AutopsyOutcome",
    "AutopsyScore",
    "BenchRow",
    "Benchmark",
    "CoupledRecord",
    "EntrantRow",
    "Exhibit",
    "ExhibitImage",
    "FeatureImage",
    "Finding",
    "GateEvidence",
    "GateNumbers",
    "GateRecord",
    "KeptPicture",
    "KillRecord",
    "LookRecord",
    "MutantRecord",
    "NamedMutant",
    "PartRecord",
    "Plot",
    "PointRecord",
    "Record",
    "RungRecord",
    "Series",
    "StrategyResult",
    "StudyResult",
]
