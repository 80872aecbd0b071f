"""The one error that means: the input is wrong, and this is what would be right."""


class InputError(ValueError):
    """Bad input, told in one line: where, what was found, what would be right.

    Parameters
    ----------
    place : file, field, line, parameter or argument that holds the bad value.
    value : the value as it was found.
    expected : what would have been accepted, with its unit and range.
    """

    def __init__(self, place: object, value: object, expected: object) -> None:
        super().__init__(f"{place}: got {value!r}, expected {expected}")
        self.place = str(place)
        self.value = value
        self.expected = str(expected)

    def __reduce__(self) -> tuple:
        """Pickled as it was made, so that it comes back whole from another process."""
        return InputError, (self.place, self.value, self.expected)
