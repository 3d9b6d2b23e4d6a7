"""The claims of a run by their ids."""

from harness.records.study import Studies
from reports.claims.claim_list import claims
from reports.claims.ledger import Claim
from reports.data.beside import Beside
from reports.data.load import Records


def claimed(records: Records, evidence: Studies | None = None, serving: Studies | None = None) -> dict[str, Claim]:
    return {claim.id: claim for claim in claims(records, Beside(evidence=evidence, serving=serving))}
