"""``effects``: the catalogue of what an axis may have and its model lacks, as run files and diagnoses name it."""

import inspect
import sys

from rich.console import Console
from rich.table import Table

from microstage_ros.commands import answer
from microstage_ros.commands.markdown import grid, plain, without_blank_runs, without_roles
from microstage_ros.commands.parser import Parser, nearest
from microstage_ros.diagnosis.report.experiment import WHY
from microstage_ros.model.axis_file import load_axis
from microstage_ros.model.effects import REGISTRY
from microstage_ros.model.effects.effect import CONTACTS
from microstage_ros.quantities.errors import InputError
from microstage_ros.solver.plant import make_plant

INF = float("inf")
COLUMNS = ("id", "what it is")


def main(argv=None):
    """Print the catalogue, or what is known of some of it. Returns 0. Raises `InputError`: an id that there is not."""
    parser = Parser(
        prog="microstage effects",
        description="Lists the effects that a run file or an axis file may have in its section `effects`, that the "
        "simulation makes and the diagnosis names. Of those given by their ids: equation, parameters with unit, range "
        "and default, what to do about it.",
    )
    parser.add_argument("ids", nargs="*", metavar="ID", help="effects to explain; none: list them all")
    parser.add_argument("--axis", metavar="FILE", help="only those that this axis can have")
    parser.add_argument("--markdown", action="store_true", help="print docs/reference/effects.md")
    arguments = parser.parse_args(argv)
    effects = [_known(name) for name in arguments.ids] or list(REGISTRY.values())
    if arguments.axis:
        axis = load_axis(arguments.axis)
        plant = make_plant(axis)
        cannot = [effect for effect in effects if not (effect.acts_on(axis) and shows_on(effect, plant))]
        if cannot and arguments.ids:
            raise InputError("ID", cannot[0].id, f"an effect that {arguments.axis} can have: {needs_of(cannot[0])}")
        effects = [effect for effect in effects if effect not in cannot]
    answer.state(effects={effect.id: facts_of(effect) for effect in effects})
    if arguments.markdown:
        sys.stdout.write(page(effects))
    elif arguments.ids:
        print("\n".join(text_of(effect) for effect in effects), end="")
    else:
        show(effects)
    return 0


def _known(name):
    """The effect of an id. Raises `InputError`: there is none."""
    if name not in REGISTRY:
        raise InputError("ID", name, "one of " + ", ".join(REGISTRY) + nearest(name, REGISTRY))
    return REGISTRY[name]


def shows_on(effect, plant):
    """Whether the machine, or one of its contacts, has what the effect needs to show; ``plant``: `PLANT` record."""
    if effect.needs is None:
        return True
    has = effect.needs[0]
    return any(has(plant[contact]) for contact in CONTACTS) if effect.on_contact else bool(has(plant))


def facts_of(effect):
    """What is known of an effect, as plain data; ranges and defaults in the unit of each parameter."""
    return {
        "label": effect.label, "remedy": effect.remedy, "acts_on_a_contact": effect.on_contact,
        "drives": list(effect.drives), "sensors": list(effect.sensors),
        "parameters": {name: {"unit": spec.unit, "minimum": _bound(spec.minimum), "maximum": _bound(spec.maximum),
                              "default": spec.default, "meaning": spec.meaning}
                       for name, spec in effect.parameters.items()},
    }


def _bound(value):
    """A bound of a range, None where there is none; ``value`` in the parameter's unit."""
    return None if abs(value) == INF else value


def show(effects):
    """Print the list on a terminal, or as plain text into a pipe."""
    sheet = Table(*COLUMNS, caption="microstage effects ID explains one", caption_justify="left")
    for effect in effects:
        sheet.add_row(effect.id, effect.label)
    Console(width=None if sys.stdout.isatty() else 160).print(sheet)


def text_of(effect):
    """What is known of an effect, for a terminal."""
    lines = [f"{effect.id}: {effect.label}", *_indented(equation_of(effect).splitlines())]
    lines += [f"  {name} [{spec.unit}]  {spec.meaning}; {range_of(spec)}; {default_of(spec)}"
              for name, spec in effect.parameters.items()]
    lines += [f"  {name}: {words}" for name, words in remarks_of(effect)]
    return "\n".join(lines) + "\n"


def _indented(lines):
    return [f"  {line}" if line else "" for line in lines]


def equation_of(effect):
    """The effect's docstring: its equation."""
    return without_roles(inspect.cleandoc(effect.__doc__ or ""))


def range_of(spec):
    """The closed range of a parameter in words; ``spec``: its `Spec`, whose numbers are in its unit."""
    if spec.minimum == -INF and spec.maximum == INF:
        return "any"
    return f"{spec.minimum:g} … {spec.maximum:g}".replace("inf", "∞")


def default_of(spec):
    """What holds where a parameter is not given, in words; ``spec``: its `Spec`, whose numbers are in its unit."""
    if spec.default is None:
        return "required"
    return f"default {', '.join(f'{value:g}' for value in _as_list(spec.default))}"


def _as_list(value):
    return value if isinstance(value, list) else [value]


def remarks_of(effect):
    """(title, words) of all that is known beside equation and parameters."""
    if effect.on_contact:
        yield "contact", "actuator (default) or guideway"
    if needs_of(effect):
        yield "needs", needs_of(effect)
    if effect.separated_by:
        yield "a record that tells it from its rivals", separating_motion(effect)
    yield "what to do", effect.remedy


def separating_motion(effect):
    """The motion of `WHY` alone, in words."""
    return WHY[effect.separated_by].partition("; ")[2].removesuffix(" it").removesuffix(" shows").removesuffix(" show")


def needs_of(effect):
    """What the machine must have for the effect, in words; empty: nothing."""
    return effect.needs[1] if effect.needs else " or ".join((*effect.drives, *effect.sensors))


def page(effects):
    """The page docs/reference/effects.md."""
    parts = [
        "# Effects\n",
        plain(PURPOSE) + "\n",
        "Written by `./microstage effects --markdown`; change the sources (`microstage_ros/model/effects/`), not this "
        "page.\n",
        EXAMPLE,
        *grid(COLUMNS, [[f"[`{effect.id}`](#{effect.id})", effect.label] for effect in effects]), "",
    ]
    for effect in effects:
        parts += [f"## {effect.id}\n", f"**{effect.label}.**\n", equation_of(effect), ""]
        parts += grid(("parameter", "unit", "meaning", "range", "default"),
                      [[f"`{name}`", spec.unit, spec.meaning, range_of(spec), default_of(spec).removeprefix("default ")]
                       for name, spec in effect.parameters.items()])
        parts += ["", *(f"- {title.capitalize()}: {words}" for title, words in remarks_of(effect)), ""]
    return without_blank_runs("\n".join(parts))


PURPOSE = """
    With this page you write the section `effects` of a run file or an axis file, and look up what a diagnosis has
    named: what it is, its parameters, and what to do about it.
"""
EXAMPLE = """\
```yaml
# run.yaml
controller: {type: self_tuning_observer}
effects:
  backlash: {width_rad: 0.005}
  friction_level_change: {factor: 1.2, contact: guideway}
program:
  - {move_to_m: 1.0e-5, dwell_s: 0.5}
```

Where an effect has several terms its parameters are lists, and every parameter of the terms is given:
`screw_pitch_error: {amplitude_m: [1.0e-7, 3.0e-8], cycles_per_turn: [1, 2], phase_rad: [0, 0]}`. A spline has as many
support points (`positions_m`, `factors`) as it needs. `contact` says on which of the two friction contacts an effect
acts.
"""


if __name__ == "__main__":
    sys.exit(main())
