"""Docstrings of public functions say what they raise, units and shapes of their numbers, and where equations are from.

What is public is named without an underscore, in a class that is. Compiled kernels are left out: their arguments are
those of the equations in their module's head. Three rules, read off the syntax tree:

- A function whose own body raises (other than NotImplementedError) says so.
- Every parameter that is a number or an array is named in the function's docstring, its class's, its module's or that
  of the method it implements, and in the same sentence or entry stands its unit in brackets, a shape, or the class
  that it is. So it is with what a function visibly returns. Numbers are what is
  annotated as such, and what is not annotated unless its default is a truth value or a text, or its name is one of
  `OBJECTS`.
- Every module of equations names a source, or says that they are derived.
"""

import ast
import functools
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "microstage_ros"
COMPILED = ("compiled", "internal", "in_place", "always_inlined", "inlined_before_typing", "intrinsic", "overload", "njit")

#: Parameters without annotation that are never numbers, by name.
OBJECTS = {
    "action", "arguments", "argv", "axis", "bands", "bench", "body", "builder", "channel", "checked", "choices",
    "chunk", "chunks", "compress", "compression", "contact", "controller", "count_name", "curve", "custom_data",
    "definition", "description", "deviance", "dimensions", "effect", "effects", "equations", "estimate",
    "estimates", "estimator", "experiment", "facts", "features", "field", "file", "file_name", "folder", "form",
    "function", "functions", "generator", "given", "guideway", "information", "key", "kind", "known", "law",
    "line", "line_of", "lines", "loadings", "machine", "meaning", "method", "name", "names", "namespace",
    "one_of", "other", "otherwise", "package", "parts", "path", "paths", "payload", "place", "plant",
    "prefixes", "profiles", "progress", "provenance", "qos", "reading", "record", "records", "required",
    "restarts", "result", "ros_distro", "schema", "sentence", "separator", "series", "signals", "skip_rows",
    "source", "table", "task", "text", "topic", "topics", "tree", "trials", "type_hash", "unit", "units",
    "warnings", "what", "window", "work",
}
#: The same, of one package alone.
OBJECTS_OF = {
    "commands": {"args", "asked", "axis_name", "backend", "bag", "columns", "console", "digest", "documents",
                 "feedback", "first", "found", "header", "headers", "long", "main", "message", "out", "owner",
                 "parser", "part", "python", "remark", "remembered", "report", "requirements", "results",
                 "root", "row", "rows", "run", "tables", "title", "venv", "word", "words"},
    "commissioning": {"condition", "has_current", "held", "keep", "loop", "phase", "says", "sketch"},
    "control": {"accept", "base", "cell", "chosen", "condition", "controllers", "cost", "cycle", "each", "elsewhere",
                "ends", "evaluation", "extent", "fed_forward", "found", "gain", "items", "jump", "kinds", "limits",
                "loop", "margins", "model", "more", "motion", "opponent", "outcomes", "parameters", "program", "run",
                "stress", "trial", "type_name"},
    "diagnosis": {"above", "also", "base", "baseline", "beside", "book", "calibration", "candidate", "case",
                  "cases", "cause", "cause_id", "causes", "channels", "choice", "chosen", "client",
                  "collection", "command", "context", "coordinates", "course", "degrade", "diagnosis", "drive",
                  "earlier", "everything", "evidence", "evidences", "examination", "examined", "experiments",
                  "extended", "extra", "figures", "files", "findings", "finished", "folders", "forms", "found",
                  "frame", "friction", "generic", "group", "groups", "held", "hidden", "holdout", "ids",
                  "joint", "judged", "keys", "label", "labels", "learn", "left", "log", "logs", "loop", "model",
                  "motion", "named", "notes", "now", "only", "open_sign", "others", "out", "outcome",
                  "outcomes", "picture", "pool", "possible", "prepared", "problem", "profile", "programme",
                  "repetition", "report", "reports", "residual", "rivals", "rng", "rows", "scattered",
                  "scheduler", "sde", "seen", "shipment", "signed", "sources", "spreads", "stage",
                  "submit", "trend", "trial", "truth", "visible", "without", "words", "world"},
    "files.py": {"error", "expected", "option"},
    "hardware": {"commands", "found", "hardware", "limits", "link", "memory", "message", "on", "output",
                 "outside_stop", "register", "setup"},
    "model": {"frame"},
    "monitoring": {"baseline", "health", "hidden", "limits", "out", "outcomes", "traits"},
    "report": {"axes", "code", "condition", "configuration", "entries", "figure", "figures", "header", "root", "salt",
               "stress", "title"},
    "ros": {"absent", "bag", "c_calls", "call", "cancel", "chance", "context", "entity", "entry", "example",
            "feedback", "found", "frame", "group", "guard", "hardware", "here", "implementation",
            "interruption", "logger", "make", "meanwhile", "message", "message_type", "mode", "node", "node_name",
            "nodes", "others", "owner", "paced", "prefix", "process", "publish", "publisher", "raw", "reader",
            "readers", "reliable", "rules", "running", "simulated", "stamped", "state", "supervisor", "tell", "tracing", "when", "word"},
}
#: Functions of these modules implement the methods of that class, which documents them.
INTERFACES = {"model/friction": "FrictionLaw"}
#: What may stand in brackets as a unit: products and quotients of these, with exponents.
UNITS = {"1", "%", "dB", "m", "s", "A", "V", "N", "K", "J", "W", "Pa", "rad", "Hz", "kg", "ohm", "H", "F", "°C", "ns",
         "mm", "µm", "nm", "ms", "µs", "ppm", "q", "unit", "byte", "bit", "count", "inch"}
WORDS = r"any unit|its own unit|unit of [^\]]+"
BRACKETS = r"\[([^\]\s][^\]]*)\]"
ARRAY = r"\(\w[\w +−]*,(?: …)?\)|\((?:\w{1,7}|\.\.\.), \w{1,7}(?:, \w{1,7})?\)|\bshapes?\b"
REFERRED = r"\bin ``?unit``?(?!\w)|\bin the units? of\b|\bSI\b"
NUMBER = r"\b(float|complex|ndarray|ArrayLike|NDArray)\b"
NAME_WITH_UNIT = r"_(m|s|ns|rad|hz|Hz|n|v|a|k|K|pa|Pa|nm|um|c|deg|ppm|counts)$"
#: Folders of equations: every module says where they are from (paper, article with its year, standard, datasheet), or
#: "Derived" and from what.
WITH_SOURCE = ("model/friction/", "model/effects/", "model/actuators/", "model/sensors/", "control/laws/",
               "identification/estimators/", "metrology/")
#: Modules there that only hold others together; none of them has an equation of its own.
WITHOUT_EQUATIONS = (
    "control/laws/controller.py", "control/laws/law.py", "control/laws/none.py", "control/laws/registry.py",
    "identification/estimators/estimate.py", "model/effects/drawing.py", "model/effects/effect.py",
    "model/effects/forces.py", "model/effects/resimulated.py", "model/friction/contact.py",
    "model/friction/registry.py", "model/friction/properties/table.py",
)
SOURCE = (r"\bpaper\b|\bSources?\b[^.]*?:|\b[Dd]erived\b|\bISO \d|\bJCGM \d|\bdatasheet\b|"
          r"[A-Z][\w-]+[^.:=]{0,60}\b(?:18|19|20)\d\d\b")


def _is_compiled(function):
    return any(name in ast.unparse(decorator) for decorator in function.decorator_list for name in COMPILED)


@functools.cache
def _modules():
    """[(path within the package, syntax tree)] of every module."""
    return [(path.relative_to(PACKAGE).as_posix(), ast.parse(path.read_text(encoding="utf-8")))
            for path in sorted(PACKAGE.rglob("*.py"))]


@functools.cache
def _classes():
    """{name: class} of the whole package."""
    return {node.name: node for _, tree in _modules() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def _functions():
    """(path, classes around it, function) of every public function outside compiled kernels."""
    def within(node, around):
        for child in node.body:
            if isinstance(child, ast.ClassDef) and not child.name.startswith("_"):
                yield from within(child, (*around, child))
            elif isinstance(child, ast.FunctionDef) and not child.name.startswith("_") and not _is_compiled(child):
                yield around, child

    for path, tree in _modules():
        for around, function in within(tree, ()):
            yield path, around, function


def _implemented(node, name, seen=()):
    """Docstrings of the methods ``name`` of a class and of those it derives from, with the classes' own."""
    found = [ast.get_docstring(node) or ""]
    found += [ast.get_docstring(child) or "" for child in node.body
              if isinstance(child, ast.FunctionDef) and child.name == name]
    for base in node.bases:
        parent = _classes().get(ast.unparse(base).split(".")[-1])
        if parent is not None and parent not in seen:
            found += _implemented(parent, name, (*seen, node))
    return found


def _texts(path, around, function):
    """Where a function's numbers may be told: its docstring, its class's, those of what it implements."""
    texts = [ast.get_docstring(function) or ""]
    for node in around:
        texts += _implemented(node, function.name)
    for folder, name in INTERFACES.items():
        if path.startswith(folder) and not around:
            texts += _implemented(_classes()[name], function.name)
    return texts


def _is_unit(text):
    if re.fullmatch(WORDS, text):
        return True
    factors = re.split(r"[ /()·√]", re.sub(r" or | per |, ", "/", text))
    return all(re.sub(r"[²³⁴]|\^-?[\w.]+$", "", factor) in UNITS | {""} for factor in factors)


def _has_unit(text):
    return bool(re.search(f"{ARRAY}|{REFERRED}", text)) or any(map(_is_unit, re.findall(BRACKETS, text)))


def _told(name, text, quoted=False):
    """Whether a text gives a unit, a shape or a class after a parameter's name, in the same sentence or entry.

    ``quoted``: only names in double backticks count, since a module's head has many words that are names too.
    """
    for found in re.finditer(rf"``{name}``" if quoted else rf"(?<!\w){name}(?!\w)", text):
        rest = re.split(r"(?<!\be\.g)[.;](?:\s|$)|\n\s*\n|\n(?=\w[\w, ]* : )", text[found.end():])[0]
        if _has_unit(rest) or re.search(r"`(?:\w+\.)*[A-Z]\w+(?<!Error)(?:\.\w+)*`", rest):
            return True
    return False


def _is_number(argument, default, objects):
    """Whether a parameter is a number: by its annotation, else unless its default or its name says otherwise."""
    if argument.annotation is not None:
        return bool(re.search(NUMBER, ast.unparse(argument.annotation)))
    said = isinstance(default, ast.Constant) and isinstance(default.value, (bool, str))
    return argument.arg not in objects and not said


def _numbers(function, objects):
    """Names of the parameters that are numbers."""
    places = function.args
    positional = [*places.posonlyargs, *places.args]
    defaults = [None] * (len(positional) - len(places.defaults)) + [*places.defaults, *places.kw_defaults]
    return [argument.arg for argument, default in zip([*positional, *places.kwonlyargs], defaults)
            if argument.arg not in ("self", "cls") and _is_number(argument, default, objects)]


def _is_text(value):
    """Whether an operation begins or ends with a text, or with one of two."""
    parts = [getattr(value, "left", None), getattr(value, "right", None)]
    parts += [part.body for part in parts if isinstance(part, ast.IfExp)]
    return any(isinstance(part, ast.JoinedStr) or isinstance(getattr(part, "value", None), (str, bytes))
               for part in parts)


def _own_statements(function):
    """All nodes of a function but those of functions within it, which return to others."""
    for child in ast.iter_child_nodes(function):
        if not isinstance(child, (ast.FunctionDef, ast.Lambda)):
            yield child
            yield from _own_statements(child)


def _gives_numbers(function):
    """Whether a function visibly returns numbers: by its annotation, else by the form of what it returns."""
    if function.returns is not None:
        return bool(re.search(NUMBER, ast.unparse(function.returns)))
    returned = [node.value for node in _own_statements(function) if isinstance(node, ast.Return)]
    return any(isinstance(value, (ast.BinOp, ast.UnaryOp)) and not _is_text(value)
               and not isinstance(value.op, (ast.Not, ast.BitOr))
               or isinstance(value, ast.Call)
               and re.match(r"(float|abs|np|numpy|math)\b(?!\.dtype)", ast.unparse(value.func))
               for value in returned)


def _untold(path, around, function):
    """Numbers of a function that its documentation leaves without unit and shape."""
    texts, head = _texts(path, around, function), ast.get_docstring(dict(_modules())[path]) or ""
    missing = [name for name in _numbers(function, OBJECTS | OBJECTS_OF.get(path.split("/")[0], set()))
               if not re.search(NAME_WITH_UNIT, name) and not _told(name, head, quoted=True)
               and not any(_told(name, text) for text in texts)]
    if _gives_numbers(function) and not re.search(NAME_WITH_UNIT, function.name):
        about = [re.split(r"\n\s*Parameters\n", texts[0])[0]]
        about += [part for text in texts for part in re.findall(r"Returns\n(.*)", text, re.DOTALL)]
        missing += [] if any(map(_has_unit, about)) else ["what it returns"]
    return missing


def _named(path, around, function):
    return f"{path}:{function.lineno} {'.'.join([*(node.name for node in around), function.name])}"


EXAMPLE = '''
def drag(axis, speed, force, samples=400, *, limit: float, name="x"):
    """Drag [N] at ``speed`` [m/s]; ``force`` of shape (n,). So many ``samples``. The limit is told elsewhere."""
    return force * speed
'''


def test_the_rule_finds_what_is_not_told():
    function = ast.parse(EXAMPLE).body[0]
    assert _untold("signals/rows.py", (), function) == ["samples", "limit"]
    silent = ast.parse(EXAMPLE.replace("Drag [N]", "Drag, or TypeError,").replace("[m/s]", "[metres]")).body[0]
    assert _untold("signals/rows.py", (), silent) == ["speed", "samples", "limit"]


@pytest.mark.parametrize("text, unit", [
    ("N m s²/rad", True), ("1/s^2", True), ("m/(V s^2)", True), ("N m or N", True), ("unit of value", True),
    ("metres", False), ("0", False), ("x", False)])
def test_units_are_known_from_other_brackets(text, unit):
    assert _is_unit(text) is unit


def test_names_of_objects_are_those_of_parameters():
    used = {argument.arg for _, _, function in _functions()
            for argument in [*function.args.args, *function.args.kwonlyargs]}
    assert set.union(OBJECTS, *OBJECTS_OF.values()) <= used


@pytest.mark.parametrize("package", sorted({path.split("/")[0] for path, _ in _modules()}))
def test_public_functions_give_units_or_shapes_of_their_numbers(package):
    untold = [f"{_named(*each)}: {', '.join(_untold(*each))}" for each in _functions()
              if each[0].split("/")[0] == package and _untold(*each)]
    assert not untold, "\n".join(untold)


def _raises(function):
    """Whether the body raises an exception of its own, other than that of a method that is only a place."""
    return any(isinstance(node, ast.Raise) and node.exc is not None
               and "NotImplementedError" not in ast.unparse(node.exc) for node in ast.walk(function))


def test_public_functions_say_what_they_raise():
    silent = [_named(*each) for each in _functions() if _raises(each[2])
              and not re.search(r"\b[Rr]aises?\b|\w+Error\b", ast.get_docstring(each[2]) or "")]
    assert not silent, "\n".join(silent)


def _told_source(tree):
    return any(re.search(SOURCE, ast.get_docstring(node) or "") for node in ast.walk(tree)
               if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)))


def test_modules_of_equations_name_their_source():
    silent = [path for path, tree in _modules() if path.startswith(WITH_SOURCE) and not path.endswith("__init__.py")
              and path not in WITHOUT_EQUATIONS and not _told_source(tree)]
    assert not silent, "\n".join(silent)


def test_modules_without_equations_are_there():
    assert set(WITHOUT_EQUATIONS) <= {path for path, _ in _modules()}
