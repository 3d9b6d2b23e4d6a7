"""Every set of `image_sets` is read, or refused in one sentence that names the file, the value and the remedy."""

from pathlib import Path

import pytest

from scenes.files.errors import InputError
from scenes.view_sets.view_set import read_view_set
from tests.hostile.image_sets import ACCEPTED, SETS, made


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", SETS)
def test_a_set_is_read_or_refused_in_a_sentence(name: str, tmp_path: Path) -> None:
    said = SETS[name][1]
    folder = made(tmp_path / "set", name)
    if said == ACCEPTED:
        views = read_view_set(folder)
        assert [len(split.rgba[0]) for split in (views.train, views.test)] == [24, 24]
        return
    with pytest.raises(InputError) as refused:
        read_view_set(folder)
    assert said in str(refused.value)
    assert str(folder) in str(refused.value)
