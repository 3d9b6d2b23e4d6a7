"""A small finished run to film, with copies that may be written to."""

from pathlib import Path

import pytest

from harness.command.main import main
from tests.harness.trained_runs import train_run
from tests.harness.viewer.film.typed import Said


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed; its view set `ball` lies next to it. `out`, of the folder above, is a copy."""
    return train_run(tmp_path_factory.mktemp("film"), ["nerf", "nerf_matched", "qnerf"], steps=14)


@pytest.fixture
def render(capsys: pytest.CaptureFixture[str]) -> Said:
    """Render, and return the printed lines."""

    def rendered(*arguments: str | Path) -> str:
        capsys.readouterr()
        assert main(["render", *map(str, arguments), "--threads", "1"]) == 0
        said, complaints = capsys.readouterr()
        assert complaints == ""
        return said

    return rendered
