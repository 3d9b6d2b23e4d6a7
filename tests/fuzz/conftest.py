"""The profile of `nox -s fuzz`, registered before pytest loads it."""

from hypothesis import HealthCheck, settings

EASY = settings(deadline=None, suppress_health_check=list(HealthCheck))
settings.register_profile("fuzz", EASY, max_examples=2000, print_blob=True)
settings.register_profile("brief", EASY, max_examples=10, derandomize=True, database=None)
