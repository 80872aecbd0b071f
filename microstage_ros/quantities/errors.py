"""The one error that means: the input is wrong, and this is what would be right."""


LONGEST_VALUE = 120
"""Characters of a bad value that are shown; a whole file given for a mapping is not printed."""

#: A name from a file may hold any character; those that end a line are shown as Python writes them.
ONE_LINE = {ord(end): repr(end)[1:-1] for end in "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"}


class InputError(ValueError):
    """Bad input, reported in one line: where, what was found, what would be right.

    Parameters
    ----------
    place : file, field, line, parameter or argument that holds the bad value.
    value : the value as it was found.
    expected : what would have been accepted, with its unit and range.
    """

    def __init__(self, place: object, value: object, expected: object) -> None:
        shown = repr(value)
        shown = shown if len(shown) <= LONGEST_VALUE else f"{shown[:LONGEST_VALUE]} …"
        super().__init__(f"{place}: got {shown}, expected {expected}".translate(ONE_LINE))
        self.place = str(place)
        self.value = value
        self.expected = str(expected)

    def __reduce__(self) -> tuple:
        """Pickled as it was made, so that it comes back whole from another process."""
        return InputError, (self.place, self.value, self.expected)
