"""The constants of a drive that the signals are referred with."""

from typing import Protocol


class DriveConstants(Protocol):
    """Of a voltage-driven motor and its transmission.

    ``resistance`` [ohm], ``inductance`` [H], ``back_emf`` [V s/rad], ``torque_constant`` [N m/A], ``lever``: travel of
    the stage per motor angle [m/rad].
    """

    @property
    def resistance(self) -> float:
        """Of the winding [ohm]."""

    @property
    def inductance(self) -> float:
        """Of the winding [H]."""

    @property
    def back_emf(self) -> float:
        """Back-EMF constant [V s/rad]."""

    @property
    def torque_constant(self) -> float:
        """Torque per current [N m/A]."""

    @property
    def lever(self) -> float:
        """Travel of the stage per motor angle [m/rad]."""
