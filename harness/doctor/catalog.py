"""All probes by name; each gives findings, and what it raises is a finding too."""

from collections.abc import Callable, Iterator

from harness.doctor.arithmetic import product_findings, torch_findings
from harness.doctor.finding import Finding, one_line
from harness.doctor.machine import core_findings, disk_findings, memory_findings
from harness.doctor.packages import optional_findings, package_findings, python_findings, tool_findings
from harness.doctor.rendering import cuda_findings, llvm_findings, scalar_findings

PROBES: dict[str, Callable[[], list[Finding]]] = {
    "python": python_findings,
    "packages": package_findings,
    "cores": core_findings,
    "memory": memory_findings,
    "disk": disk_findings,
    "torch": torch_findings,
    "products": product_findings,
    "scalar_rgb": scalar_findings,
    "llvm_ad_rgb": llvm_findings,
    "cuda_ad_rgb": cuda_findings,
    "tools": tool_findings,
    "optional": optional_findings,
}
ESSENTIAL = ("python", "packages", "torch", "scalar_rgb")
"""Where a probe cannot even be made, nothing works."""


def findings() -> Iterator[Finding]:
    """In the order of `PROBES`, each as soon as it is known; a package that is missing is told once."""
    missing = set()
    for name, probe in PROBES.items():
        try:
            for finding in probe():
                if finding.verdict == "missing":
                    missing.add(finding.what)
                yield finding
        except Exception as error:
            if isinstance(error, ModuleNotFoundError) and error.name in missing:
                continue
            said = one_line(f"{type(error).__name__}: {error}")
            yield Finding(name, said, "missing", "mend what it says", needed=name in ESSENTIAL)
