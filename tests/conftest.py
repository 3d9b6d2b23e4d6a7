"""For every test: an int is a float to the type checker, as PEP 484 and mypy have it.

`--jaxtyping-packages` in `pyproject.toml` names the checker, and can say neither its settings nor a module of ours;
it looks `beartype.beartype` up while our packages are imported, which is after this file. Plain beartype would
refuse `box(1, 1, 0.2)`.
"""

import beartype

beartype.beartype = beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))
