"""The citation of a run: a BibTeX entry that names its plan, its commit and the digest of its records."""

import re

from harness.records.cells import digests_of
from harness.records.json_record import digest_of
from reports.claims.headline import headline
from reports.data.load import Records
from reports.data.scale import in_a_line

SPECIAL = re.compile(r"[\\{}$&#%_^~]")


def records_digest(records: Records) -> str:
    """Return 64 hexadecimal digits that depend on every cell of the run, but not on their order."""
    return digest_of(dict(sorted(digests_of(records.every_cell).items())))


def bibtex(records: Records) -> str:
    """Return an entry whose key is the beginning of the digest, which runs share if their records are the same."""
    digest, commit = records_digest(records), records.run.provenance.get("commit", "unknown")
    scenes, methods = ", ".join(records.scenes), ", ".join(records.methods)
    note = f"{in_a_line(records)}; scenes: {scenes}; methods: {methods}; commit {commit}; records sha256:{digest}"
    fields = {
        "title": f"{{{_tex(headline(records).title)}}}",
        "author": "{The radiance-verdict authors}",
        "howpublished": "Report of radiance-verdict",
        "note": _tex(note),
    }
    lines = [f"  {name:<12} = {{{value}}}," for name, value in fields.items()]
    return "\n".join([f"@misc{{radiance-verdict-{digest[:12]},", *lines, "}", ""])


def _tex(text: str) -> str:
    plain = text.replace("\u202f", " ").replace("\u00a0", " ").replace("−", "-")
    return SPECIAL.sub(lambda match: f"\\{match[0]}" if match[0] not in "\\^~" else " ", plain)
