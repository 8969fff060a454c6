#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <string>
#include <system_error>

#include "commands.h"
#include "page.h"
#include "palpate/common/error.h"
#include "palpate/common/interruption.h"
#include "palpate/interactive/interactive_run.h"
#include "palpate/protocol/server_messages.h"
#include "palpate/scene/hardware.h"
#include "scene_options.h"
#include "serve.h"

namespace palpate {
namespace {

struct ViewOptions {
  SceneOptions scene;
  ServeOptions serve;
  std::string out = "out/recorded";
  bool record = false;
};

/// A folder for dropped surfaces, which goes when the program does.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "palpate-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw RunError(name + ": no temporary folder can be made");
    path_ = name;
    markProvisional(path_, true);
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
    unmarkProvisional(path_);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// The server as the run sees it.
class ServedAudience final : public Audience {
 public:
  void serve(Server& server) { server_ = &server; }

  void greet(std::vector<Message> messages) override {
    std::vector<std::pair<bool, Bytes>> out;
    for (Message& m : messages) out.emplace_back(m.binary, std::move(m.bytes));
    server_->setGreeting(std::move(out));
  }
  void state(Bytes json) override { server_->setState(std::move(json)); }
  void text(Bytes json) override { server_->text(std::move(json)); }
  void textTo(int viewer, Bytes json) override { server_->textTo(viewer, std::move(json)); }
  void frame(std::uint32_t step, Bytes full, Bytes light) override {
    server_->frame(step, std::move(full), std::move(light));
  }
  void samples(Bytes batch, std::uint32_t ticks) override { server_->samples(std::move(batch), ticks); }
  double cpuSeconds() const override { return server_->cpuSeconds(); }

 private:
  Server* server_ = nullptr;
};

// The scenes that lie beside the given one, itself first if it is nowhere among them.
std::vector<SceneEntry> scenesBeside(const SceneConfig& chosen) {
  std::vector<SceneEntry> out;
  std::error_code ignored;
  const auto folder = chosen.file.has_parent_path() ? chosen.file.parent_path() : std::filesystem::path(".");
  for (const auto& file : std::filesystem::directory_iterator(folder, ignored)) {
    if (file.path().extension() != ".yaml" && file.path().extension() != ".yml") continue;
    try {
      const SceneConfig config = readScene(file.path());
      out.push_back({config.name, config.description, file.path()});
    } catch (const InputError&) {  // no scene, or one whose files are not installed
    }
  }
  std::sort(out.begin(), out.end(), [](const SceneEntry& a, const SceneEntry& b) { return a.name < b.name; });
  if (std::none_of(out.begin(), out.end(), [&](const SceneEntry& s) { return s.name == chosen.name; })) {
    out.insert(out.begin(), {chosen.name, chosen.description, chosen.file});
  }
  return out;
}

void view(const ViewOptions& options) {
  SceneConfig config = options.scene.read();
  openDevice(config);
  const TemporaryFolder dropped;
  InteractiveOptions run_options;
  run_options.scenes = scenesBeside(config);
  run_options.open = [&config](const SceneEntry& entry) {
    if (entry.name == config.name) return config;
    SceneConfig other = readScene(entry.file);
    if (config.device.driver) {  // stays in the hand
      other.device = config.device;
      openDevice(other);
    }
    return other;
  };
  run_options.record_folder = options.out;
  run_options.record_from_start = options.record;
  run_options.surface_folder = dropped.path();

  ServedAudience audience;
  InteractiveRun run(config, run_options, audience);
  ServerHandlers handlers;
  handlers.joined = [&run](int viewer) { run.joined(viewer); };
  handlers.left = [&run](int viewer) { run.left(viewer); };
  handlers.message = [&run](int viewer, std::string_view json) { run.message(viewer, json); };
  handlers.surface = [&run](const std::string& name, std::string&& body, bool place) {
    return run.surface(name, std::move(body), place);
  };
  handlers.stopping = [&run] { run.askToStop(); };
  const ServerOptions server_options = options.serve.server();
  Server server(server_options, pageFiles(),
                sessionMessage({"view", server_options.version, config.name, server_options.max_surface_bytes}),
                handlers);
  audience.serve(server);
  run.start();
  announce(server);
  server.run();
  run.stop();
  if (!run.failure().empty()) throw RunError(run.failure());
}

}  // namespace

void addViewCommand(CLI::App& app) {
  const auto options = std::make_shared<ViewOptions>();
  CLI::App* command = app.add_subcommand("view", "Run a scene in real time and hold it in a browser");
  options->scene.addScene(*command);
  options->scene.addOverrides(*command);
  options->serve.add(*command);
  command->add_flag("--record", options->record, "Record from the start; the page can also begin and end it");
  command
      ->add_option("--out", options->out, "Folder that recordings go below")

      ->type_name("DIR")
      ->capture_default_str();
  command->callback([options] { view(*options); });
}

}  // namespace palpate
