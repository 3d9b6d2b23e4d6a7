"""How to cite a run: a BibTeX entry that names its plan, its commit and the digest of its records."""

import re

from harness.records.cells import digests_of
from harness.records.json_record import digest_of
from reports.claims.headline import headline
from reports.data.load import Records
from reports.data.scale import in_a_line

SPECIAL = re.compile(r"[\\{}$&#%_^~]")
"""What TeX would take for its own."""


def records_digest(records: Records) -> str:
    """Return 64 hexadecimal digits of all cells of the run, whatever the order in which they were made."""
    cells = (*records.cells, *records.extra_cells, *records.guest_cells)
    return digest_of(dict(sorted(digests_of(cells).items())))


def bibtex(records: Records) -> str:
    """Return an entry whose key is the beginning of the digest: two runs have the same if their records are."""
    digest, run = records_digest(records), records.run
    scenes, methods = ", ".join(records.scenes), ", ".join(records.methods)
    title = f"{{{_tex(headline(records).title)}}}"
    note = f"{in_a_line(records)}; scenes: {scenes}; methods: {methods}"
    fields = {
        "title": title,
        "author": "{The radiance-verdict authors}",
        "howpublished": "Report of radiance-verdict",
        "note": _tex(f"{note}; commit {run.provenance.get('commit', 'unknown')}; records sha256:{digest}"),
    }
    lines = [f"  {name:<12} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@misc{{radiance-verdict-{digest[:12]},", *lines, "}", ""])


def _tex(text: str) -> str:
    plain = text.replace("\u202f", " ").replace("\u00a0", " ").replace("−", "-")
    return SPECIAL.sub(lambda found: f"\\{found[0]}" if found[0] not in "\\^~" else " ", plain)
