#include <fmt/format.h>

#include "cli/say.h"
#include "cli/verbs.h"

namespace lightrig::cli {
namespace {

// Options are asked of the program itself, so that they never grow stale.
constexpr const char* bash_script = R"sh(_lightrig() {
  local word=${COMP_WORDS[COMP_CWORD]}
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "@VERBS@ --help --version" -- "$word"))
  elif [[ $word == -* ]]; then
    COMPREPLY=($(compgen -W "$(lightrig "${COMP_WORDS[1]}" --help 2>/dev/null |
      grep -o -- '--[a-z-]*')" -- "$word"))
  else
    COMPREPLY=($(compgen -f -- "$word"))
  fi
}
complete -o filenames -F _lightrig lightrig)sh";

constexpr const char* zsh_script = R"sh(#compdef lightrig
if (( CURRENT == 2 )); then
  compadd @VERBS@ -- --help --version
elif [[ $words[CURRENT] == -* ]]; then
  compadd -- $(lightrig $words[2] --help 2>/dev/null | grep -o -- '--[a-z-]*')
else
  _files
fi)sh";

constexpr const char* fish_script =
    R"sh(complete -c lightrig -n __fish_use_subcommand -f -a "@VERBS@"
complete -c lightrig -n "not __fish_use_subcommand" -a \
  "(lightrig (commandline -opc)[2] --help 2>/dev/null | string match -r -a -- '--[a-z-]+')")sh";

}  // namespace

int completion(const std::string& shell, const std::vector<std::string>& verbs) {
  std::string script = shell == "bash" ? bash_script : shell == "zsh" ? zsh_script : fish_script;
  const std::string mark = "@VERBS@";
  script.replace(script.find(mark), mark.size(), fmt::format("{}", fmt::join(verbs, " ")));
  say(script);
  return 0;
}

}  // namespace lightrig::cli
