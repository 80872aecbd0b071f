"""The candidates: one file per family, one line per form."""

from microstage_ros.discrepancy.catalogue import drive, electrical, friction, generic, measuring

FORMS = tuple(form for family in (friction, drive, electrical, measuring, generic) for form in family.FORMS)


def forms_of(channel):
    """All forms that show in the channel of this name."""
    return tuple(form for form in FORMS if form.channel == channel)
