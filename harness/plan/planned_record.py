"""The part of a run's record that its plan decides, before anything is measured."""

from msgspec.structs import replace

from harness.plan.caveats import deviations, not_tested
from harness.plan.plugins import origins, title_of
from harness.plan.profiles import Plan
from harness.records.cells import Roles, RunRecord


def planned_record(plan: Plan, command: str) -> RunRecord:
    """Return the record of a run of `command` that has not begun; its provenance holds the methods' packages alone."""
    methods = (*plan.all_methods(), *plan.guests)
    return RunRecord(
        profile=plan.profile,
        command=command,
        scenes=[],
        methods={name: title_of(name) for name in methods},
        seeds=list(plan.seeds),
        settings=plan.settings(),
        provenance=origins(methods),
        phases={},
        finished=False,
        not_tested=not_tested(plan),
        deviations=deviations(plan),
        guests=list(plan.guests),
        claims=list(plan.claims),
        roles=_roles(plan),
    )


def _roles(plan: Plan) -> Roles:
    pairs = dict.fromkeys(pair for file in plan.claims for pair in file.pairs)
    return replace(plan.roles.among(plan.methods), claimed=tuple(pairs))
