"""The fields that ``--json`` promises of a command that succeeded; looked at after every command that a page prints."""

import json

from microstage_ros.commands import answer

REPORT = {"format", "verdict", "causes", "rivals", "gain"}
FIELDS = {
    "simulate": {"record", "rows", "period_s", "columns", "seed"},
    "identify": {"axis", "page", "parameters", "warnings", "remarks"},
    "diagnose": {"report", "folder"},
    "log": {"proposal", "reasons", "missing", "unused"},
    "move": {"moves"},
    "status": {"active", "lifecycle", "fault", "position_m", "voltage_V", "backend", "processes", "summary"},
    "stop": {"success", "message", "answered_s"}, "hold": {"success", "message", "answered_s"},
    "reset": {"success", "message", "answered_s"}, "home": {"success", "message", "answered_s"},
    "topic list": {"topics"}, "topic echo": {"topic", "messages"}, "topic hz": {"topic", "messages", "rate_Hz"},
    "replay": {"messages", "topics"}, "cut": {"record", "rows", "period_s", "columns", "first_s", "last_s"},
    "completion": {"options"}, "effects": {"effects"},
}
"""{command: fields of its answer}."""

MOVE = {"target_m", "reached", "final_error_m", "settling_time_s"}
PARAMETER = {"value", "stderr", "unit", "determined"}


def check_answer(words):
    """Assert that the command that has just succeeded announced what it promises, as JSON that reads back."""
    found = answer.facts()
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    name = " ".join(words[:2]) if words[0] == "topic" else words[0]
    assert name in FIELDS, f"{name}: which fields does it promise?"
    assert FIELDS[name] <= set(found), (name, FIELDS[name] - set(found))
    if name == "move":
        assert found["moves"] and all(MOVE <= set(move) for move in found["moves"])
    elif name == "identify":
        assert found["parameters"] and all(set(facts) == PARAMETER for facts in found["parameters"].values())
    elif name == "diagnose":
        assert REPORT <= set(found["report"]), set(found["report"])
