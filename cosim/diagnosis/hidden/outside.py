"""Effects that the catalogue does not know, to see whether a diagnosis admits that it does not.

Each is a number ``outside.NAME`` of the hidden plant; a diagnosis is right if it says ``unknown`` and names
the balance, and better if it finds what the missing torque goes with.
"""

from __future__ import annotations

from dataclasses import dataclass

PREFIX = "outside:"


@dataclass(frozen=True)
class Outside:
    """An effect outside the catalogue.

    Attributes:
        meaning: One line.
        balance: The torque balance it enters, as ``Effect.acts_on``.
        driving_variables: What its torque goes with; of several any is right.
        unit: Of its size.
        sizes: Smallest and largest of a draw.
        limit: Largest that can be simulated.
    """

    meaning: str
    balance: str
    driving_variables: tuple[str, ...]
    unit: str
    sizes: tuple[float, float]
    limit: float


OUTSIDE = {
    "engine_mount_coupling": Outside(
        "the powertrain rolls on mounts that harden with torque, and the gearbox with it: so many times as far "
        "as the mounts of the file would let it", "transmission", ("shaft torque", "engine torque"), "1",
        (60.0, 240.0), 400.0),
    "hardening_axle_shafts": Outside(
        "the axle shafts stiffen with the cube of their twist", "axle", ("twist",), "N.m/rad3", (4e6, 1.5e7), 1e8),
    "warming_oil": Outside(
        "viscous drag on the propeller shaft that fades within seconds as the oil warms", "propeller shaft",
        ("time",), "N.m.s/rad", (0.15, 0.5), 5.0),
    "wavy_road": Outside(
        "a road that rises and falls every 14 m", "vehicle", ("distance",), "rad", (0.008, 0.025), 0.1),
    "tyre_out_of_round": Outside(
        "a tyre out of round that pushes the axle once a revolution", "vehicle", ("wheel angle",), "N",
        (150.0, 500.0), 5000.0),
}
