"""What is told of a view set that is being rendered."""

from scenes.standing import Standing, standings

COUNTS = {"train": 2, "val": 0, "test": 2}
SPP = {"train": 16, "val": 16, "test": 64}


def test_a_test_view_is_as_much_as_its_samples() -> None:
    found = list(standings(COUNTS, SPP, ()))
    assert [one.view for one in found] == ["train/r_0", "train/r_1", "test/r_0", "test/r_1", ""]
    assert [one.share for one in found] == [0.0, 0.1, 0.2, 0.6, 1.0]
    assert [one.done for one in found] == [0, 1, 2, 3, 4]


def test_what_was_there_before_is_told_at_once_and_is_no_share() -> None:
    found = list(standings(COUNTS, SPP, {"train/r_0", "test/r_0"}))
    assert found == [
        Standing(done=2, total=4, kept=2, share=0.0, view="train/r_1"),
        Standing(done=3, total=4, kept=2, share=0.2, view="test/r_1"),
        Standing(done=4, total=4, kept=2, share=1.0, view=""),
    ]
    everything = ("train/r_0", "train/r_1", "test/r_0", "test/r_1")
    assert list(standings(COUNTS, SPP, everything)) == [Standing(4, 4, 4, 1.0, "")]
