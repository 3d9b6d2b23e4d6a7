"""torch: which build, which devices, which products."""

from pathlib import Path

from harness.doctor.finding import Finding

FLAGS = ("avx2", "avx512f", "avx512_bf16", "amx_tile", "amx_bf16", "asimd", "bf16")


def torch_findings() -> list[Finding]:
    import torch

    build = f"ROCm {torch.version.hip}" if torch.version.hip else f"CUDA {torch.version.cuda}"
    build = build if torch.version.hip or torch.version.cuda else "CPU"
    found = [Finding("torch", f"{torch.__version__}, built for {build}")]
    product = torch.ones(3, 3) @ torch.ones(3, 3)
    if not bool((product == 3.0).all()):
        found.append(Finding("matrix product", f"wrong: {product.tolist()}", "missing", "reinstall torch", needed=True))
    if torch.cuda.is_available():
        names = [torch.cuda.get_device_name(index) for index in range(torch.cuda.device_count())]
        found.append(Finding("GPU", ", ".join(names)))
    elif torch.version.hip or torch.version.cuda:
        to_do = "--device cpu works; for a GPU look at its driver, or take its build of torch (UV_TORCH_BACKEND)"
        found.append(Finding("GPU", f"none that {build} sees", "limited", to_do))
    else:
        to_do = "nothing, or torch for your GPU: UV_TORCH_BACKEND=rocm7.1 nox … (or as your driver has it)"
        found.append(Finding("GPU", "none: this torch is for processors", "limited", to_do))
    return found


def product_findings() -> list[Finding]:
    """AMX, AVX-512 and what torch makes of them."""
    import torch

    from harness.device import multiplies_bfloat16

    flags = processor_flags()
    here = " ".join(name for name in FLAGS if name in flags) or "none of " + " ".join(FLAGS)
    said = f"{here}; torch uses {torch.backends.cpu.get_cpu_capability()}"
    if multiplies_bfloat16(torch.device("cpu")):
        return [Finding("processor's products", f"{said}; bfloat16")]
    to_do = "nothing: --precision auto takes float32; with AMX a run is faster"
    return [Finding("processor's products", f"{said}; no matrix units for bfloat16", "limited", to_do)]


def processor_flags(cpuinfo: Path = Path("/proc/cpuinfo")) -> set[str]:
    try:
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
    except OSError:
        return set()
    return {flag for line in lines if line.startswith(("flags", "Features")) for flag in line.split(":", 1)[1].split()}
