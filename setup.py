"""The rooms at the top of the repository are installed as one package."""

from setuptools import find_packages, setup

ROOMS = ("agents", "model", "view", "cli")
inner = find_packages(include=[name for room in ROOMS for name in (room, f"{room}.*")])
setup(
    packages=["kaju", *(f"kaju.{name}" for name in inner)],
    package_dir={"kaju": "src/kaju"} | {f"kaju.{room}": room for room in ROOMS},
)
