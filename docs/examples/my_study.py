"""Do the frequencies of the φ encoding grow by φ from band to band?"""

from collections.abc import Iterator

from baselines.numerics.encoding import PHI, frequency_ladder
from harness.records.study import Series, check
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.framework import Found


def ladder_spacing(context: EvidenceContext) -> Iterator[Found]:
    """Compare neighbouring frequencies with φ, and show those of φ and of 2 as lines."""
    bands = 4 if context.quick else 10
    ratios = frequency_ladder(PHI, bands)[1:] / frequency_ladder(PHI, bands)[:-1]
    yield f"From band to band the frequency grows by a factor of {float(ratios.mean()):.4f}."
    yield check("largest relative distance from φ", float((ratios / PHI - 1).abs().max()), high=1e-6, subject="φ^k")
    for name, base in (("φ^k", PHI), ("2^k", 2.0)):
        frequencies = frequency_ladder(base, bands).tolist()
        yield Series("Frequencies", 0, name, "band", "frequency", [float(k) for k in range(bands)], frequencies)
