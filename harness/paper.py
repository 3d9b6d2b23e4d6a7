"""What the paper prints, to stand beside what is measured."""

from typing import Any

TABLE1 = {"density_net": 1_300_000, "density_head": 257, "colour_net": 67_000, "total": 1_370_000}
TABLE2 = {
    "chair": {"nerf": 33.0, "qnerf": 34.4},
    "drums": {"nerf": 25.0, "qnerf": 26.2},
    "ficus": {"nerf": 30.1, "qnerf": 31.6},
    "hotdog": {"nerf": 36.2, "qnerf": 38.0},
    "lego": {"nerf": 32.5, "qnerf": 34.0},
    "materials": {"nerf": 29.6, "qnerf": 31.0},
    "mic": {"nerf": 32.9, "qnerf": 34.4},
    "ship": {"nerf": 28.7, "qnerf": 30.2},
    "average": {"nerf": 31.0, "qnerf": 32.5},
}
TABLE3 = {
    "iterations_to_30_db": {"nerf": 150_000, "qnerf": 123_000},
    "hours_to_30_db": {"nerf": 4.2, "qnerf": 3.4},
    "final_psnr": {"nerf": 31.0, "qnerf": 32.5},
    "speedup_percent": 18,
}
TABLE4 = [
    {"configuration": "Baseline NeRF", "method": "nerf", "psnr": 32.5, "ssim": 0.961},
    {"configuration": "+ φ-Encoding", "method": "nerf_phi_encoding", "psnr": 33.2, "ssim": 0.967},
    {"configuration": "+ Quantum Amplifier", "method": "nerf_phi_encoding_amplifier", "psnr": 33.8, "ssim": 0.972},
    {"configuration": "+ φ-Skip (Full Q-NeRF)", "method": "qnerf", "psnr": 34.0, "ssim": 0.974},
]


def printed() -> dict[str, Any]:
    """All tables, as a run record keeps them."""
    return {"table1": TABLE1, "table2": TABLE2, "table3": TABLE3, "table4": TABLE4, "sloc": 427}
