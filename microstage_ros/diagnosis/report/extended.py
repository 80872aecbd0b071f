"""The extended axis file: the axis with its causes as effects, which the simulator and the driver run as it is."""

from microstage_ros import __version__


def extended_axis(axis, diagnosis):
    """`Axis` with the causes of a diagnosis in ``effects`` and with the numbers that were fitted along.

    A cause that the axis already had as an effect is replaced: its new size was fitted on top of the file.
    Stand-ins for open causes (`Diagnosis.provisional`) are included.
    """
    numbers = diagnosis.identified
    changed = axis.with_values({key: number.value for key, number in numbers.items()},
                               stderr={key: number.stderr for key, number in numbers.items()})
    return changed.with_effects({**axis.effects, **diagnosis.provisional, **diagnosis.effects})


def write_extended(axis, diagnosis, path, sources):
    """Write the extended axis file with where it comes from; returns the `Axis`."""
    extended = extended_axis(axis, diagnosis)
    provenance = {
        "made_by": f"microstage_ros {__version__} diagnose", "seed": diagnosis.seed, "axis": axis.place,
        "verdict": diagnosis.verdict, **sources,
    }
    if diagnosis.provisional:
        provenance["stand_ins"] = {rivals.ids[0]: list(rivals.ids[1:]) for rivals in diagnosis.rivals
                                   if rivals.ids[0] in diagnosis.provisional}
    if diagnosis.of_one_homing:
        provenance["phases_of_one_homing"] = list(diagnosis.of_one_homing)
    extended.save(path, provenance)
    return extended
