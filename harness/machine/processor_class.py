"""The class of a processor, which decides the order of sums in its library, and so the last bits of every number."""

import platform


def class_here() -> str:
    """Return the processor's class, unless the environment of this process forces another one."""
    import torch

    capability = str(torch.backends.cpu.get_cpu_capability()).lower().replace("no avx", "default")
    machine = platform.machine()
    return capability if machine in ("x86_64", "AMD64") else f"{machine}_{capability}"
