"""``completion``: a script that completes commands, options and choices in bash, zsh or fish."""

import importlib

from microstage_ros.commands import COMMANDS, answer, module_of
from microstage_ros.commands.parser import Parser, parser_of

SHELLS = ("bash", "zsh", "fish")
PLAIN = ("test", "shell")
"""Commands that pass their words on to another program."""


def main(argv=None):
    """Print the script. Returns 0."""
    parser = Parser(prog="microstage completion", description=(
        "Prints a script that completes commands, options and choices of ./microstage. For bash: "
        "./microstage completion bash > ~/.local/share/bash-completion/completions/microstage"))
    parser.add_argument("shell", choices=SHELLS, help="for which shell")
    arguments = parser.parse_args(argv)
    words = options()
    answer.state(options=words)
    print(fish(words) if arguments.shell == "fish" else bash(words, arguments.shell == "zsh"))
    return 0


def options():
    """{command: {option: its choices, [] for a free value, None for a flag}}."""
    found = {}
    for name in COMMANDS:
        parser = None if name in PLAIN else parser_of(importlib.import_module(module_of(name)).main)
        found[name] = parser.known_options() if parser else {}
    return found


def bash(words, zsh=False):
    """The script for bash; zsh runs it through its own emulation."""
    cases = []
    for name, known in words.items():
        cases += [
            f'    {name}:{option}) choices="{" ".join(choices)}" ;;' for option, choices in known.items() if choices
        ]
        cases.append(f'    {name}:*) options="{" ".join(known)}" ;;')
    head = "autoload -U +X bashcompinit && bashcompinit\n" if zsh else ""
    return head + f"""\
_microstage() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" options="" choices=""
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{' '.join(words)} --help --version" -- "$word")); return
  fi
  case "${{COMP_WORDS[1]}}:$before" in
{chr(10).join(cases)}
  esac
  if [ -n "$choices" ]; then COMPREPLY=($(compgen -W "$choices" -- "$word"))
  elif [ "${{word#-}}" != "$word" ]; then COMPREPLY=($(compgen -W "$options" -- "$word"))
  fi
}}
complete -o default -F _microstage microstage ./microstage"""


def fish(words):
    """The script for fish."""
    lines = ["complete -c microstage -n __fish_use_subcommand -a '" + " ".join(words) + "'"]
    for name, known in words.items():
        for option, choices in known.items():
            if option.startswith("--"):
                more = f" -x -a '{' '.join(choices)}'" if choices else "" if choices is None else " -r"
                lines.append(f"complete -c microstage -n '__fish_seen_subcommand_from {name}' -l {option[2:]}{more}")
    return "\n".join(lines)
