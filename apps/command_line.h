#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace palpate {

/// An option, a flag or an operand, as the program declares it.
struct OptionDescription {
  std::vector<std::string> names;  ///< with their hyphens; none: an operand
  std::string value;               ///< what stands for the value, such as FILE; empty: a flag
  std::string help;
  std::string standard;            ///< the value when it is not given; may be empty
  std::string limits;              ///< of the value; may be empty
  std::vector<std::string> words;  ///< values that a shell offers
  bool required = false;
  int most = 0;       ///< values that it takes at once; kAnyNumber: no bound
  bool list = false;  ///< values are joined by commas
};
constexpr int kAnyNumber = 1 << 20;

/// The program or one of its commands.
struct CommandDescription {
  std::string name;
  std::string help;
  std::vector<OptionDescription> options;
  std::vector<OptionDescription> operands;
  std::vector<CommandDescription> commands;
};

/// What the program takes, from what its command line is parsed by.
CommandDescription describe(CLI::App& app);

/// Words that a shell offers as values of an option or operand. What is accepted is decided where the value is read.
inline CLI::Validator offers(const std::vector<std::string>& words) {
  return {[](std::string&) { return std::string(); }, "", "offers " + CLI::detail::join(words, ",")};
}

/// What a shell may put in place of the word at the cursor.
struct Completions {
  enum class Paths { none, files, folders };
  struct Word {
    std::string text;
    std::string help;
  };
  std::vector<Word> words;
  Paths paths = Paths::none;         ///< or the name of one of these
  std::vector<std::string> endings;  ///< of the files; none: any
};

/// @param words behind the name of the program, up to the cursor; the last one, which may be empty, is to be completed.
///     A word that bash split at = or : is taken as one, and then only what stands behind that is completed.
Completions complete(const CommandDescription& program, const std::vector<std::string>& words);

/// One line a word: the word, a tab, its help. Then `:files ENDING...` or `:folders`.
std::string completionLines(const Completions& completions);

/// The manual page palpate(1), for man.
/// @param date YYYY-MM-DD
std::string manualPage(const CommandDescription& program, const std::string& version, const std::string& date);

}  // namespace palpate
