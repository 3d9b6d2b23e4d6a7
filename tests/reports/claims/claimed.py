"""The judged claims of a run."""

from harness.records.study import Studies
from reports.claims.claim_list import claims
from reports.claims.ledger import Claim
from reports.data.load import Records
from reports.data.shelf_records import ShelfRecords


def claimed(records: Records, evidence: Studies | None = None, serving: Studies | None = None) -> dict[str, Claim]:
    """Map the id of a claim → the claim as judged on `records` with these studies."""
    return {claim.id: claim for claim in claims(records, ShelfRecords(evidence=evidence, serving=serving))}
