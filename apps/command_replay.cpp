#include <array>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include "commands.h"
#include "page.h"
#include "palpate/common/error.h"
#include "palpate/protocol/layout.h"
#include "palpate/protocol/server_messages.h"
#include "serve.h"

namespace palpate {
namespace {

struct ReplayOptions {
  std::string folder;
  ServeOptions serve;
};

// The page checks the rest, and says what is wrong with it.
void requireRecording(const std::filesystem::path& file) {
  std::error_code ignored;
  if (std::filesystem::exists(file, ignored) && !std::filesystem::is_regular_file(file, ignored)) {
    throw InputError(file.string(), "", "is not a regular file");  // a pipe would be waited for
  }
  std::ifstream in(file, std::ios::binary);
  if (!in) throw InputError(file.string(), "", "is missing: palpate run and recordings of palpate view write it");
  std::array<char, protocol::kRecordingMagic.size()> head{};
  in.read(head.data(), head.size());
  if (!in || std::string_view(head.data(), head.size()) != protocol::kRecordingMagic) {
    throw InputError(file.string(), "", "is no recording of this version");
  }
}

void replay(const ReplayOptions& options) {
  const std::filesystem::path folder = options.folder;
  const std::filesystem::path file = folder / "recording.palpate";
  requireRecording(file);
  const ServerOptions server_options = options.serve.server();
  const auto name = (folder.has_filename() ? folder : folder.parent_path()).filename().string();
  Server server(server_options, pageFiles(),
                sessionMessage({"replay", server_options.version, name, server_options.max_surface_bytes}), {});
  server.addFile(file.string(), "/recording");
  announce(server);
  server.run();
}

}  // namespace

void addReplayCommand(CLI::App& app) {
  const auto options = std::make_shared<ReplayOptions>();
  CLI::App* command = app.add_subcommand("replay", "Look at a recorded run again in a browser");
  command->add_option("folder", options->folder, "Folder of the run")->required()->type_name("DIR");
  options->serve.add(*command);
  command->callback([options] { replay(*options); });
}

}  // namespace palpate
