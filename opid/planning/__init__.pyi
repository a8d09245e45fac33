# The public names: `as` says so to type checkers (PEP 484); lazy_loader reads the same lines.
from .guess import (
    Guess as Guess,
    GuessedGear as GuessedGear,
    GuessedRoad as GuessedRoad,
    GuessedSensors as GuessedSensors,
    plan as plan,
    read_guess as read_guess,
)
