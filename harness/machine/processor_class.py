"""The class of a processor, which decides the order in which its library sums, and so the last bits of every number."""

import platform


def class_here() -> str:
    """Return the class of this process: that of the processor, unless its environment forces another."""
    import torch

    capability = str(torch.backends.cpu.get_cpu_capability()).lower().replace("no avx", "default")
    machine = platform.machine()
    return capability if machine in ("x86_64", "AMD64") else f"{machine}_{capability}"
