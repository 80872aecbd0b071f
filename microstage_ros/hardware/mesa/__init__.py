"""Mesa Ethernet FPGA cards (LBP16 over UDP, hostmot2 registers) as a backend: ``mesa``."""

from microstage_ros.hardware.mesa.card import MesaCard

__all__ = ["MesaCard"]
