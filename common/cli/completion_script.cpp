// The scripts know nothing of our options: they hand over the words that are typed, and show what
// comes back.
#include "common/cli/completion.hpp"

#include <string>

namespace fraja::cli {
namespace {

// bash takes : and = for the ends of words, and puts what it completes behind them: so the line is
// cut at blanks here, and candidates lose what stands before.
constexpr std::string_view bash_script = R"(# bash completion for @PROGRAMS@
_fraja() {
    local line=${COMP_LINE:0:COMP_POINT} program=${1/#\~\//$HOME/} words typed found first word
    read -ra words <<<"$line"
    [[ $line != *[[:space:]] ]] || words+=('')
    typed=${words[-1]}
    COMPREPLY=()
    mapfile -t found < <("$program" --complete "${words[@]:1}" 2>/dev/null)
    first=${found[0]-}
    if [[ $first == :* ]]; then
        [[ $typed != -*=* ]] || typed=${typed#*=}
        compopt -o filenames
        case $first in
        :directories) mapfile -t COMPREPLY < <(compgen -d -- "$typed") ;;
        :files) mapfile -t COMPREPLY < <(compgen -f -- "$typed") ;;
        *) mapfile -t COMPREPLY < <(compgen -d -- "$typed"; compgen -f -X "!*.${first#:files }" -- "$typed") ;;
        esac
        return
    fi
    for word in "${found[@]}"; do
        printf -v word %q "${word%%$'\t'*}"
        COMPREPLY+=("${word#"${typed%"${typed##*[:=]}"}"}")
    done
}
complete -F _fraja @PROGRAMS@
)";

constexpr std::string_view zsh_script = R"(#compdef @PROGRAMS@
_fraja() {
    local -a found shown
    local line
    found=("${(@f)$("${(Q)words[1]/#\~\//$HOME/}" --complete "${(@Q)words[2,CURRENT]}" 2>/dev/null)}")
    [[ $PREFIX != -*=* || $found[1] != :* ]] || compset -P '*='
    case $found[1] in
    '') return 1 ;;
    :directories) _files -/ ;;
    :files) _files ;;
    :files\ *) _files -g "*.${found[1]#:files }" ;;
    *)
        for line in "${found[@]}"; do
            shown+=("${${line%%$'\t'*}//:/\\:}:${line#*$'\t'}")
        done
        _describe value shown
        ;;
    esac
}
if [[ $zsh_eval_context[-1] == loadautofunc ]]; then
    _fraja "$@"
else
    compdef _fraja @PROGRAMS@
fi
)";

constexpr std::string_view fish_script = R"(# fish completion for @PROGRAMS@
function __fraja_complete
    set -l typed (commandline -ct)
    set -l words (commandline -opc)
    set -l program (string replace -r '^~/' "$HOME/" -- $words[1])
    set -l found ($program --complete $words[2..-1] "$typed" 2>/dev/null)
    switch "$found[1]"
        case ':directories'
            __fish_complete_directories (string replace -r '^-[^=]*=' '' -- "$typed")
        case ':files*'
            __fish_complete_path (string replace -r '^-[^=]*=' '' -- "$typed")
        case '*'
            printf '%s\n' $found
    end
end
for program in @PROGRAMS@
    complete -c $program -f -a '(__fraja_complete)'
end
)";

} // namespace

std::optional<std::string> completion_script(std::string_view shell,
                                             std::span<const std::string> programs) {
    std::string script(shell == "bash"   ? bash_script
                       : shell == "zsh"  ? zsh_script
                       : shell == "fish" ? fish_script
                                         : "");
    if (script.empty())
        return std::nullopt;
    std::string names;
    for (const std::string& program : programs)
        names += (names.empty() ? "" : " ") + program;
    constexpr std::string_view mark = "@PROGRAMS@";
    for (std::size_t at = 0; (at = script.find(mark, at)) != std::string::npos;)
        script.replace(at, mark.size(), names);
    return script;
}

} // namespace fraja::cli
