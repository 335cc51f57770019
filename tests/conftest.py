"""What all tests share."""

from hypothesis import HealthCheck, settings

# Machines differ in speed: a slow example is no failure.
settings.register_profile(
    "kaju", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)
settings.load_profile("kaju")
