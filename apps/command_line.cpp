#include "command_line.h"

#include <algorithm>
#include <map>

namespace palpate {
namespace {

using Strings = std::vector<std::string>;

Strings split(const std::string& text, char separator) {
  Strings out;
  std::size_t begin = 0;
  while (true) {
    const std::size_t end = text.find(separator, begin);
    out.push_back(text.substr(begin, end - begin));
    if (end == std::string::npos) return out;
    begin = end + 1;
  }
}

/// "INT in [0 - 9]" -> "0 to 9"; "{a,b}" -> "a,b"
std::string limitsFrom(const std::string& text) {
  const std::size_t open = text.find_first_of("[{"), close = text.find_last_of("]}");
  if (open == std::string::npos || close == std::string::npos || close < open) return text;
  std::string inside = text.substr(open + 1, close - open - 1);
  if (text[open] == '{') return CLI::detail::join(split(inside, ','), ", ");
  if (const std::size_t dash = inside.find(" - "); dash != std::string::npos) inside.replace(dash, 3, " to ");
  return inside;
}

OptionDescription describe(CLI::Option& option) {
  constexpr const char* kOffers = "offers ";
  OptionDescription out;
  for (const std::string& name : option.get_snames()) out.names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) out.names.push_back("--" + name);
  out.help = option.get_description();
  out.standard = option.get_default_str();
  if (out.standard.starts_with("[") && out.standard.ends_with("]"))
    out.standard = out.standard.substr(1, out.standard.size() - 2);
  out.required = option.get_required();
  out.list = option.get_delimiter() == ',';
  out.most = std::min(option.get_items_expected_max(), kAnyNumber);
  std::string value = option.get_type_name();
  Strings limits;  // CLI11 puts them behind the type
  for (int i = 0; true; ++i) {
    CLI::Validator* validator = nullptr;
    try {
      validator = option.get_validator(i);
    } catch (const CLI::OptionNotFound&) {
      break;  // there is no other way to know how many there are
    }
    const std::string text = validator->get_description();
    if (!text.empty()) {
      limits.push_back(text);
      out.limits = limitsFrom(text);
      if (text.starts_with("{")) out.words = split(text.substr(1, text.size() - 2), ',');
    }
    if (validator->get_name().starts_with(kOffers))
      out.words = split(validator->get_name().substr(std::string(kOffers).size()), ',');
  }
  for (auto text = limits.rbegin(); text != limits.rend(); ++text) {
    if (value.ends_with(":" + *text)) value.erase(value.size() - text->size() - 1);
  }
  if (out.most > 0) {
    const std::map<std::string, std::string> plain{
        {"INT", "N"}, {"UINT", "N"}, {"FLOAT", "X"}, {"TEXT", "TEXT"}, {"", "VALUE"}};
    const auto known = plain.find(value);
    out.value = known == plain.end() ? value : known->second;
  }
  return out;
}

bool hidden(const std::string& group) { return group.empty(); }

}  // namespace

CommandDescription describe(CLI::App& app) {
  CommandDescription out;
  out.name = app.get_name();
  out.help = app.get_description();
  for (CLI::Option* option : app.get_options([](CLI::Option* o) { return !hidden(o->get_group()); })) {
    (option->nonpositional() ? out.options : out.operands).push_back(describe(*option));
  }
  for (CLI::App* command : app.get_subcommands([](CLI::App* c) { return !hidden(c->get_group()); })) {
    out.commands.push_back(describe(*command));
  }
  return out;
}

namespace {

/// The words as one typed them, though bash splits them at = and :.
struct TypedWords {
  Strings words;
  bool split = false;  // the last one was

  explicit TypedWords(const Strings& given) {
    bool behind = false;
    for (const std::string& word : given) {
      const bool separator = (word == "=" || word == ":") && !words.empty() && !words.back().empty();
      split = separator || behind;
      if (split) {
        words.back() += word;
      } else {
        words.push_back(word);
      }
      behind = separator;
    }
    if (words.empty()) words.emplace_back();
  }
};

/// Where in the command line the cursor is.
struct Place {
  std::vector<const CommandDescription*> commands;  // the program first
  std::size_t operands = 0;                         // of the last command, given before
  const OptionDescription* option = nullptr;        // whose value may be next
  int values = 0;                                   // of it, given before
  Strings given;                                    // options

  explicit Place(const CommandDescription& program) : commands{&program} {}

  const CommandDescription& command() const { return *commands.back(); }

  // Those of the program may stand behind a command.
  const OptionDescription* find(const std::string& name) const {
    for (const CommandDescription* c : commands) {
      for (const OptionDescription& o : c->options) {
        if (std::find(o.names.begin(), o.names.end(), name) != o.names.end()) return &o;
      }
    }
    return nullptr;
  }

  void pass(const std::string& word) {
    if (word.size() > 1 && word[0] == '-') {
      const std::size_t equals = word.find('=');
      given.push_back(word.substr(0, equals));
      option = equals == std::string::npos ? find(word) : nullptr;
      values = 0;
    } else if (option != nullptr && values < option->most) {
      ++values;
    } else {
      option = nullptr;
      const auto& inner = command().commands;
      const auto next = std::find_if(inner.begin(), inner.end(), [&](const auto& c) { return c.name == word; });
      if (next != inner.end()) {
        commands.push_back(&*next);
      } else {
        ++operands;
      }
    }
  }

  bool valueIsNext() const { return option != nullptr && values < option->most; }
  bool valueMustBeNext() const { return valueIsNext() && values == 0; }
};

void offer(Completions& out, const std::string& text, const std::string& help, const std::string& typed) {
  if (text.starts_with(typed)) out.words.push_back({text, help});
}

void offerValues(Completions& out, const OptionDescription& option, const std::string& typed,
                 const std::string& prefix) {
  const std::size_t comma = option.list ? typed.rfind(',') : std::string::npos;
  const std::string before = comma == std::string::npos ? "" : typed.substr(0, comma + 1);
  const Strings taken = split(before, ',');
  for (const std::string& word : option.words) {
    if (std::find(taken.begin(), taken.end(), word) != taken.end()) continue;
    if ((before + word).starts_with(typed)) out.words.push_back({prefix + before + word, ""});
  }
  if (!option.words.empty()) return;
  using Paths = Completions::Paths;
  const std::map<std::string, std::pair<Paths, Strings>> kinds{
      {"DIR", {Paths::folders, {}}},
      {"FILE", {Paths::files, {}}},
      {"RUN", {Paths::files, {}}},
      {"SCENE", {Paths::files, {"yaml", "yml"}}},
      {"STUDY", {Paths::files, {"yaml", "yml"}}},
      {"SURFACE", {Paths::files, {"obj", "stl", "ply", "off", "gltf", "glb", "3mf"}}}};
  const auto kind = kinds.find(option.value.substr(0, option.value.find("...")));
  if (kind != kinds.end()) std::tie(out.paths, out.endings) = kind->second;
}

void offerOptions(Completions& out, const Place& place, const std::string& typed) {
  for (auto c = place.commands.rbegin(); c != place.commands.rend(); ++c) {
    for (const OptionDescription& o : (*c)->options) {
      const bool was_given = std::any_of(o.names.begin(), o.names.end(), [&](const std::string& name) {
        return std::find(place.given.begin(), place.given.end(), name) != place.given.end();
      });
      const std::string& name = o.names.back();  // the long one
      const bool twice = std::any_of(out.words.begin(), out.words.end(), [&](const auto& w) { return w.text == name; });
      if (!twice && (!was_given || o.most == kAnyNumber)) offer(out, name, o.help, typed);
    }
  }
}

}  // namespace

Completions complete(const CommandDescription& program, const Strings& words) {
  const TypedWords typed(words);
  Place place(program);
  for (std::size_t i = 0; i + 1 < typed.words.size(); ++i) place.pass(typed.words[i]);
  const std::string& word = typed.words.back();
  Completions out;
  if (const std::size_t equals = word.find('='); word.starts_with("--") && equals != std::string::npos) {
    const OptionDescription* option = place.find(word.substr(0, equals));
    const std::string prefix = typed.split ? "" : word.substr(0, equals + 1);
    if (option != nullptr) offerValues(out, *option, word.substr(equals + 1), prefix);
  } else if (typed.split) {
    // behind a colon stands what only the device knows
  } else if (place.valueIsNext() && !word.starts_with("-")) {
    offerValues(out, *place.option, word, "");
  } else if (word.starts_with("-") && !place.valueMustBeNext()) {
    offerOptions(out, place, word);
  } else if (!place.command().commands.empty()) {
    for (const CommandDescription& c : place.command().commands) offer(out, c.name, c.help, word);
  } else {
    const auto& operands = place.command().operands;
    const bool more = !operands.empty() && (place.operands < operands.size() || operands.back().most == kAnyNumber);
    if (more) {
      offerValues(out, operands[std::min(place.operands, operands.size() - 1)], word, "");
    } else {
      offerOptions(out, place, word);
    }
  }
  return out;
}

std::string completionLines(const Completions& completions) {
  std::string out;
  for (const Completions::Word& w : completions.words) out += w.text + "\t" + w.help + "\n";
  if (completions.paths == Completions::Paths::folders) out += ":folders\n";
  if (completions.paths == Completions::Paths::files) {
    out += ":files";
    for (const std::string& ending : completions.endings) out += " " + ending;
    out += "\n";
  }
  return out;
}

namespace {

// What troff would take for a command, or a hyphen for a sign of its own.
std::string plain(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c;
    }
  }
  if (out.starts_with(".") || out.starts_with("'")) out.insert(0, "\\&");
  return out;
}
std::string bold(const std::string& text) { return "\\fB" + plain(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + plain(text) + "\\fR"; }

std::string sentence(std::string text) {
  if (!text.empty() && !text.ends_with(".")) text += '.';
  return text;
}

/// An option's names and value, or an operand.
std::string headOf(const OptionDescription& option) {
  std::string out;
  for (const std::string& name : option.names) out += (out.empty() ? "" : ", ") + bold(name);
  if (!option.value.empty()) out += (out.empty() ? "" : " ") + italic(option.value);
  return out;
}

void writeOptions(std::string& out, const std::vector<OptionDescription>& options) {
  for (const OptionDescription& o : options) {
    out += ".TP\n" + headOf(o) + "\n" + plain(sentence(o.help));
    if (o.required && !o.names.empty()) out += " Required.";
    if (!o.limits.empty()) out += plain(" Takes " + o.limits + ".");
    if (!o.standard.empty()) out += plain(" Default: " + o.standard + ".");
    out += "\n";
  }
}

void writeCommands(std::string& out, const CommandDescription& parent, const std::string& before) {
  for (const CommandDescription& c : parent.commands) {
    const std::string path = before + " " + c.name;
    if (!c.commands.empty()) {
      writeCommands(out, c, path);
      continue;
    }
    std::string head = bold(path);
    for (const OptionDescription& o : c.operands) {
      const std::string more = o.most > 1 && !o.value.ends_with("...") ? "..." : "";
      head += " " + (o.required ? italic(o.value) + more : "[" + italic(o.value) + more + "]");
    }
    const bool has_options =
        std::any_of(c.options.begin(), c.options.end(), [](const auto& o) { return o.names.back() != "--help"; });
    if (has_options) head += " [" + italic("OPTION") + "]...";
    out += ".SS " + head + "\n" + plain(sentence(c.help)) + "\n";
    writeOptions(out, c.operands);
    std::vector<OptionDescription> own;  // --help is said once, for all
    for (const OptionDescription& o : c.options) {
      if (o.names.back() != "--help") own.push_back(o);
    }
    writeOptions(out, own);
  }
}

}  // namespace

std::string manualPage(const CommandDescription& program, const std::string& version, const std::string& date) {
  std::string out = ".TH PALPATE 1 " + date + " \"Palpate " + version + "\" \"User Commands\"\n";
  out +=
      ".SH NAME\n"
      "palpate \\- hold soft objects and feel them at 1 kHz\n"
      ".SH SYNOPSIS\n"
      "\\fBpalpate\\fR \\fICOMMAND\\fR [\\fIARGUMENT\\fR]...\n"
      ".SH DESCRIPTION\n"
      "A person holds a soft object by a handle, pushes it into other things and feels it a thousand times a second,\n"
      "while the scene (deformation, contact, friction) is simulated at 30 Hz.\n"
      "A scene is a YAML file.\n"
      "Lengths are in m, masses in kg, times in s, forces in N, torques in N m, stresses in Pa; z points up.\n"
      ".SH OPTIONS\n"
      "These may stand before a command or behind it.\n";
  writeOptions(out, program.options);
  out += ".SH COMMANDS\n";
  writeCommands(out, program, program.name);
  out +=
      ".SH EXIT STATUS\n"
      ".TP\n.B 0\nThe job is done.\n"
      ".TP\n.B 1\nThe run failed.\n"
      ".TP\n.B 2\nBad input: a file, a key or an option; one line on standard error names it and the cause.\n"
      ".TP\n.B 3\nThe job is done, but what it checked is not as it must be.\n"
      ".TP\n.B 128 + signal\nA signal ended the job; what there was is written.\n"
      ".SH ENVIRONMENT\n"
      ".TP\n.B NO_COLOR\nWhen set, tables on a terminal have no colors.\n"
      ".TP\n.B SPNAV_SOCKET\nSocket of spacenavd, for the device\n.BR spacenavigator .\n"
      ".TP\n.B SOURCE_DATE_EPOCH\nDate of this page for\n.BR \"palpate manual\" ,\nin seconds since 1970.\n"
      ".SH EXAMPLES\n"
      ".TP\n.B palpate view scenes/alien.yaml\nHold the alien in a browser.\n"
      ".TP\n.B palpate run scenes/cube.yaml \\-\\-out out/cube\nRun a scene in virtual time; open "
      "out/cube/report.html.\n"
      ".TP\n.B palpate completion bash > ~/.local/share/bash\\-completion/completions/palpate\n"
      "Complete commands, options and files with the Tab key.\n";
  return out;
}

}  // namespace palpate
