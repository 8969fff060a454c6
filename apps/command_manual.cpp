#include <fmt/chrono.h>
#include <fmt/format.h>

#include <cstdlib>
#include <ctime>
#include <memory>
#include <string>

#include "command_line.h"
#include "commands.h"
#include "palpate/common/error.h"

namespace palpate {
namespace {

// All three ask the program itself (main.cpp, `complete`), so they need no change when it does.

constexpr const char* kBash = R"sh(# palpate(1) completion for bash
_palpate() {
  local program=${COMP_WORDS[0]/#\~\//$HOME/} word=${COMP_WORDS[COMP_CWORD]} line ending IFS=$'\n'
  [[ $word == [=:] ]] && word=
  COMPREPLY=()
  while read -r line; do
    case $line in
      :folders)
        compopt -o filenames
        COMPREPLY+=($(compgen -d -- "$word"))
        ;;
      :files)
        compopt -o filenames
        COMPREPLY+=($(compgen -f -- "$word"))
        ;;
      :files\ *)
        compopt -o filenames
        COMPREPLY+=($(compgen -d -- "$word"))
        for ending in $(tr ' ' '\n' <<<"${line#:files }"); do
          COMPREPLY+=($(compgen -f -X "!*.$ending" -- "$word"))
        done
        ;;
      *) COMPREPLY+=("${line%%$'\t'*}") ;;
    esac
  done < <("$program" complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
  [[ ${#COMPREPLY[@]} == 1 && ${COMPREPLY[0]} == *: ]] && compopt -o nospace
  return 0
}
complete -F _palpate palpate
)sh";

constexpr const char* kZsh = R"sh(#compdef palpate
# palpate(1) completion for zsh
_palpate() {
  local program=${words[1]/#\~\//$HOME/} line word
  local -a offered unfinished
  local paths=
  for line in "${(@f)$("$program" complete "${(@)words[2,CURRENT]}" 2>/dev/null)}"; do
    case $line in
      '') ;;
      :*) paths=${line#:} ;;
      *)
        word=${line%%$'\t'*}
        if [[ $word == *: ]]; then
          unfinished+=("${word//:/\\:}:${line#*$'\t'}")
        else
          offered+=("${word//:/\\:}:${line#*$'\t'}")
        fi
        ;;
    esac
  done
  (( $#offered )) && _describe 'palpate' offered
  (( $#unfinished )) && _describe 'palpate' unfinished -S ''
  if [[ -n $paths ]]; then
    [[ $PREFIX == --*=* ]] && compset -P '*='
    case $paths in
      folders) _files -/ ;;
      files) _files ;;
      *) _files -g "*.(${${paths#files }// /|})" ;;
    esac
  fi
}
if [[ ${funcstack[1]} == _palpate ]]; then
  _palpate "$@"
else
  compdef _palpate palpate
fi
)sh";

constexpr const char* kFish = R"sh(# palpate(1) completion for fish
function __palpate_complete
  set -l before (commandline -opc)
  set -l word (commandline -ct)
  set -l program (string replace -r '^~/' "$HOME/" -- $before[1])
  for line in (command $program complete $before[2..-1] "$word" 2>/dev/null)
    if not string match -q ':*' -- $line
      echo $line
      continue
    end
    set -l prefix (string match -r -- '^--[^=]*=' "$word"; or echo '')
    set -l path (string replace -- "$prefix" '' "$word")
    set -l endings (string split ' ' -- $line)[2..-1]
    if test $line = ':folders'
      printf '%s\n' $prefix(__fish_complete_directories "$path" '')
    else if test (count $endings) = 0
      printf '%s\n' $prefix(__fish_complete_path "$path")
    else
      printf '%s\n' $prefix(__fish_complete_path "$path" |
        string match -r '^[^\t]*(?:/|\.(?:'(string join '|' $endings)'))(?:\t.*)?$')
    end
  end
end
complete -c palpate -f -a '(__palpate_complete)'
)sh";

/// Of the manual: today, or what a build that is to give the same bytes says.
std::string date() {
  std::time_t seconds = std::time(nullptr);
  if (const char* given = std::getenv("SOURCE_DATE_EPOCH")) {  // NOLINT(concurrency-mt-unsafe)
    char* end = nullptr;
    seconds = std::strtoll(given, &end, 10);
    if (end == given || *end != '\0') throw InputError("SOURCE_DATE_EPOCH", "", "must be seconds since 1970");
  }
  return fmt::format("{:%Y-%m-%d}", fmt::gmtime(seconds));
}

}  // namespace

void addManualCommand(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("manual", "Write the manual page palpate(1); to read it: palpate manual | man -l -");
  command->callback([&app] { fmt::print("{}", manualPage(describe(app), PALPATE_VERSION, date())); });
}

void addCompletionCommand(CLI::App& app) {
  const auto shell = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("completion", "Write what makes a shell complete commands, options and files");
  command->add_option("shell", *shell, "The shell, such as: source <(palpate completion bash)")
      ->required()
      ->check(CLI::IsMember({"bash", "zsh", "fish"}))
      ->type_name("SHELL");
  command->callback([shell] { fmt::print("{}", *shell == "bash" ? kBash : *shell == "zsh" ? kZsh : kFish); });
}

}  // namespace palpate
