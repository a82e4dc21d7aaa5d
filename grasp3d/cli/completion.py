"""Completion of commands, options and their words by the shells bash and zsh."""

from collections.abc import Mapping
from string import Template

from grasp3d.cli.options import options_of

_SCRIPT = Template("""\
if [ -n "$${ZSH_VERSION-}" ]; then
    whence compdef > /dev/null || { autoload -U +X compinit && compinit; }
    autoload -U +X bashcompinit && bashcompinit
fi
_grasp3d() {
    local words="" word="$${COMP_WORDS[COMP_CWORD]}"
    case "$$COMP_CWORD $${COMP_WORDS[1]} $${COMP_WORDS[COMP_CWORD-1]}" in
        "1 "*) words="$commands --help --version --completion" ;;
$values
        *) case "$${COMP_WORDS[1]} $$word" in
$options
        esac ;;
    esac
    COMPREPLY=($$(compgen -W "$$words" -- "$$word"))
}
complete -o bashdefault -o default -F _grasp3d grasp3d
""")


def completion_script(kinds: Mapping[str, type]) -> str:
    """The script that `source <(grasp3d --completion)` runs; other words are names of files.

    Args:
        kinds: The options of each command, by its name.
    """
    values, options = [], []
    for command, kind in kinds.items():
        found = [one for one in options_of(kind, helps=False) if one.names]
        names = " ".join(name for one in found for name in one.names if name.startswith("--"))
        options.append(f'            "{command} -"*) words="{names} --help --help-all" ;;')
        for one in found:
            words = one.parser.placeholder.split("|")
            if len(words) > 1 and all(word == word.lower() for word in words):
                ends = f'        *" {command} {one.names[-1]}") words="{" ".join(words)}" ;;'
                values.append(ends)
    return _SCRIPT.substitute(
        commands=" ".join(kinds), values="\n".join(values), options="\n".join(options)
    )
