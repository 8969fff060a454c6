#include "palpate/scene/config.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "palpate/devices/driver_list.h"
#include "palpate/scene/checks.h"
#include "palpate/scene/limits.h"

namespace palpate {
namespace {

template <typename Enum>
const char* spelling(const std::vector<std::string>& names, Enum value) {
  return names.at(static_cast<std::size_t>(value)).c_str();
}

/// Tetrahedra that a body asks for; 0 for a file, which the mesh reader bounds.
double wantedTetrahedra(const BodyConfig& body) {
  if (std::holds_alternative<TetrahedraFileShapeConfig>(body.shape)) return 0.0;
  if (const auto* bar = std::get_if<BarShapeConfig>(&body.shape))
    return 6.0 * bar->cells[0] * bar->cells[1] * bar->cells[2];
  return body.tetrahedra;
}

}  // namespace

const std::vector<std::string>& methodNames() {
  static const std::vector<std::string> names{"live", "hsl", "hsl-exact", "vc"};
  return names;
}
const std::vector<std::string>& aimNames() {
  static const std::vector<std::string> names{"sample", "predicted"};
  return names;
}
const std::vector<std::string>& derivativeNames() {
  static const std::vector<std::string> names{"frozen", "full"};
  return names;
}
const std::vector<std::string>& deviceNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> out{"simulated", "prescribed", "recorded"};
    for (const DriverKind& kind : driverKinds()) out.emplace_back(kind.name);
    return out;
  }();
  return names;
}
const std::vector<std::string>& coneNames() {
  static const std::vector<std::string> names{"polyhedral", "exact"};
  return names;
}
const std::vector<std::string>& alienLandmarkNames() {
  static const std::vector<std::string> names{"head", "trunk", "left_hand", "right_hand", "left_foot", "right_foot"};
  return names;
}

const char* toString(MethodName method) { return spelling(methodNames(), method); }
const char* toString(AimName aim) { return spelling(aimNames(), aim); }
const char* toString(DerivativeName derivative) { return spelling(derivativeNames(), derivative); }
const char* toString(DeviceName device) { return spelling(deviceNames(), device); }

bool isSurface(const ShapeConfig& shape) {
  return !std::holds_alternative<BarShapeConfig>(shape) && !std::holds_alternative<TetrahedraFileShapeConfig>(shape);
}

LinkParameters LinkConfig::over(LinkParameters link) const {
  link.stiffness = stiffness.value_or(link.stiffness);
  link.damping = damping.value_or(link.damping);
  link.rotational_stiffness = rotational_stiffness.value_or(link.rotational_stiffness);
  link.rotational_damping = rotational_damping.value_or(link.rotational_damping);
  link.peak_force = peak_force.value_or(link.peak_force);
  link.peak_torque = peak_torque.value_or(link.peak_torque);
  return link;
}

const HandleConfig& ToolConfig::chosenHandle() const {
  const auto chosen = [&](const HandleConfig& candidate) { return candidate.name == handle; };
  return *std::find_if(handles.begin(), handles.end(), chosen);
}

HandleConfig& ToolConfig::chosenHandle() { return const_cast<HandleConfig&>(std::as_const(*this).chosenHandle()); }

Vec3 facing(const ShapeConfig& shape) {
  return std::holds_alternative<AlienShapeConfig>(shape) ? Vec3::UnitY() : Vec3(-Vec3::UnitY());
}

Vec3 SceneConfig::viewFrom() const {
  if (view_from) return *view_from;
  const Vec3 front = facing(tool.shape);
  return (0.95 * front + 0.5 * front.cross(Vec3::UnitZ()) + 0.42 * Vec3::UnitZ()).normalized();
}

int SceneConfig::ticksPerStep() const { return static_cast<int>(std::lround(visual_step / haptic_step)); }

std::optional<std::string> stepObjection(const SceneConfig& config) {
  const double ratio = config.visual_step / config.haptic_step;
  if (ratio < 0.5 || std::abs(ratio - std::round(ratio)) > 1e-6 * ratio)
    return fmt::format("{:g} s is not a whole multiple of the haptic step, {:g} s", config.visual_step,
                       config.haptic_step);
  return std::nullopt;
}

std::optional<std::string> timingObjection(const SceneConfig& config) {
  if (auto cause = stepObjection(config)) return cause;
  if (config.duration / config.haptic_step > limits::kTicks)
    return fmt::format("{:g} s at a haptic step of {:g} s are more than {:g} ticks", config.duration,
                       config.haptic_step, limits::kTicks);
  return std::nullopt;
}

std::optional<std::string> sizeObjection(const SceneConfig& config) {
  double total = config.tool.rigid ? 0.0 : wantedTetrahedra(config.tool);
  for (const FreeBodyConfig& body : config.bodies)
    if (!body.rigid) total += wantedTetrahedra(body);
  if (total <= limits::kTetrahedra) return std::nullopt;
  return fmt::format("the scene asks for {:.0f} tetrahedra; at most {} are allowed", total, limits::kTetrahedra);
}

namespace {

// A body that is glued to the tool, in a chain of glue without it, of which the world holds none.
std::optional<std::string> hangsOnTool(const SceneConfig& config) {
  const std::string& tool = config.tool.name;
  std::map<std::string, std::vector<std::string>> glued;
  std::set<std::string> held;
  const auto add = [&](const BodyConfig& body) {
    for (const AttachmentConfig& a : body.attachments) {
      if (a.to.empty()) {
        held.insert(body.name);
      } else {
        glued[body.name].push_back(a.to);
        glued[a.to].push_back(body.name);
      }
    }
  };
  add(config.tool);
  for (const FreeBodyConfig& body : config.bodies) add(body);
  for (const std::string& first : glued[tool]) {
    std::vector<std::string> chain{first};
    bool holds = held.contains(first);
    for (std::size_t k = 0; k < chain.size(); ++k) {
      for (const std::string& next : std::vector(glued[chain[k]])) {
        if (next == tool || std::find(chain.begin(), chain.end(), next) != chain.end()) continue;
        chain.push_back(next);
        holds |= held.contains(next);
      }
    }
    if (!holds) return first;
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::string> methodObjection(const SceneConfig& config) {
  if (config.method != MethodName::live) return std::nullopt;
  const std::vector<AttachmentConfig>& own = config.tool.attachments;
  if (std::any_of(own.begin(), own.end(), [](const AttachmentConfig& a) { return a.to.empty(); }))
    return "live is for tools that move as a whole, and the world holds this one; take hsl";
  if (const auto hangs = hangsOnTool(config))
    return fmt::format(
        "live needs to know what a body that is glued to the tool is held by, and nothing holds {}; take hsl", *hangs);
  return std::nullopt;
}

std::optional<std::string> handleObjection(const ToolConfig& tool, const std::string& handle) {
  std::vector<std::string> names;
  for (const HandleConfig& candidate : tool.handles) names.push_back(candidate.name);
  if (std::find(names.begin(), names.end(), handle) != names.end()) return std::nullopt;
  return fmt::format("the tool has no handle {}; the nearest is \"{}\"", shownText(handle), nearestWord(handle, names));
}

}  // namespace palpate
