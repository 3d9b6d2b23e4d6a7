"""python -m reports where there is a speed.json: which pages are written, what is published, what is refused."""

import json

import pytest

from harness.records.study import read_studies
from reports.__main__ import main
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_speed import fake_speed, write_fake_speed
from tests.reports.run.test_page import Outline
from tests.reports.test_command import BUILD, HEAVY, fresh


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_speed_record_alone_gives_its_page_alone(tmp_path, capsys):
    out = write_fake_speed(tmp_path / "speed")
    assert main([str(out)]) == 0
    assert capsys.readouterr().out == f"{out / 'speed.html'}\n"
    assert names(out) == ["speed.html", "speed.json"]
    assert "report.html" not in (out / "speed.html").read_text(encoding="utf-8")


def test_with_a_run_beside_it_there_are_both_and_each_leads_to_the_other(out, capsys):
    assert main([str(write_fake_speed(out))]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == str(out / "speed.html")
    assert lines[-1] == str(out / "report.html")
    assert "speed.html" in Outline((out / "report.html").read_text(encoding="utf-8")).links
    assert "report.html" in Outline((out / "speed.html").read_text(encoding="utf-8")).links


def test_a_run_without_speed_has_no_link_to_it(out):
    main([str(out)])
    assert "speed.html" not in (out / "report.html").read_text(encoding="utf-8")
    assert not (out / "speed.html").exists()


def test_neither_is_one_clear_line(tmp_path, capsys):
    assert main([str(tmp_path)]) == 2
    caught = capsys.readouterr()
    assert caught.out == ""
    assert caught.err.startswith(f"{tmp_path}: no records/, no evidence.json, no stability.json, no speed.json in it; ")
    assert len(caught.err.splitlines()) == 1


@pytest.mark.parametrize(
    "content", ["{", "[]", "{}", '{"schema": 99}', "\udcff", json.dumps({"schema": 1, "measurements": 3})]
)
def test_a_damaged_record_gives_2_and_writes_nothing(out, capsys, content):
    (out / "speed.json").write_bytes(content.encode("utf-8", "surrogateescape"))
    assert main([str(out)]) == 2
    caught = capsys.readouterr()
    assert caught.err.startswith(str(out / "speed.json"))
    assert len(caught.err.splitlines()) == 1
    assert not (out / "report.html").exists()
    assert not (out / "speed.html").exists()


def test_a_number_that_is_not_finite_is_damage(tmp_path, capsys):
    out = write_fake_speed(tmp_path)
    text = (out / "speed.json").read_text(encoding="utf-8").replace("7.418", "NaN")
    (out / "speed.json").write_text(text, encoding="utf-8")
    assert main([str(out)]) == 2
    assert "JSON is malformed" in capsys.readouterr().err


def test_a_word_in_place_of_a_number_is_named(tmp_path, capsys):
    out = write_fake_speed(tmp_path)
    data = json.loads((out / "speed.json").read_text(encoding="utf-8").replace("7.418", '"fast"'))
    data.pop("digest")
    (out / "speed.json").write_text(json.dumps(data), encoding="utf-8")
    assert main([str(out)]) == 2
    told = capsys.readouterr().err
    assert told == (
        f"{out / 'speed.json'}: Expected `float | null`, got `str` - at `$.studies[0].findings[1].value`; "
        "run `nox -s speed` again\n"
    )


def test_publishing_speed_alone_writes_its_numbers_and_its_chart(tmp_path):
    out, docs = write_fake_speed(tmp_path / "speed"), tmp_path / "docs"
    assert main([str(out), "--publish", str(docs)]) == 0
    assert names(docs) == ["speed.json", "speed.png"]
    assert read_studies(docs / "speed.json") == fake_speed()
    assert (docs / "speed.png").read_bytes().startswith(b"\x89PNG")
    assert 1000 < (docs / "speed.png").stat().st_size < 300_000


def test_publishing_a_run_with_speed_writes_all(tmp_path, out):
    main([str(write_fake_speed(out)), "--quiet", "--publish", str(tmp_path / "docs")])
    assert names(tmp_path / "docs") == ["error_vs_time.png", "psnr.png", "speed.json", "speed.png", "summary.json",
                                         "work_precision.png"]  # fmt: skip


def test_a_quick_run_is_not_published(tmp_path, capsys):
    out = write_fake_speed(tmp_path / "speed", settings={"quick": True})
    assert main([str(out), "--publish", str(tmp_path / "docs")]) == 2
    caught = capsys.readouterr()
    assert "a quick run, too rough to publish" in caught.err
    assert len(caught.err.splitlines()) == 1
    assert not (tmp_path / "docs").exists()
    assert main([str(out)]) == 0


@pytest.mark.thorough
@pytest.mark.slow
def test_the_page_is_built_without_torch_and_mitsuba(tmp_path):
    out = write_fake_speed(tmp_path / "speed")
    done = fresh(f"{BUILD} {HEAVY}", str(out), "--publish", str(tmp_path / "docs"))
    assert done.stderr == ""
    assert done.stdout.splitlines()[1:] == ["[]"]


def test_records_without_a_run_file_do_not_stop_the_speed_page(tmp_path):
    out = write_fake_run(tmp_path / "run", ("chair",), seeds=1, pictures=False)
    (out / "records" / "run.json").unlink()
    assert main([str(write_fake_speed(out))]) == 0
    assert not (out / "report.html").exists()
