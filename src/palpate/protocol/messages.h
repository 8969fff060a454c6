#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "palpate/haptics/haptic_loop.h"
#include "palpate/haptics/realtime.h"
#include "palpate/scene/builder.h"
#include "palpate/scene/config.h"
#include "palpate/session/run_record.h"

namespace palpate {

class ByteWriter;

// What the page is sent, byte by byte and key by key as docs/viewer.md says.

/// A scene that a viewer may choose.
struct SceneEntry {
  std::string name;
  std::string description;
  std::filesystem::path file;
};

/// What a person may change while a scene runs.
struct InteractiveSettings {
  double friction = 1.0;   ///< factor on all coefficients
  double stiffness = 1.0;  ///< factor on all moduli
  double speed = 1.0;      ///< of simulated time against the clock
  bool paused = false;
  bool stress = false;  ///< frames carry it
};

/// What the scene's own motion of the hand does: there is none, it moves the hand, or it does not (it has come to its
/// end, or somebody has taken the hand).
enum class Motion { none, playing, over };

/// A dropped surface that waits to be placed (PlaceMessage), as it is shown meanwhile.
struct SurfacePreview {
  std::string name;            ///< of the file
  Vec3 extent = Vec3::Zero();  ///< sides of the bounding box, in the file's own unit
  double size = 0.0;           ///< longest side as it is shown [m]
};

/// Who is there and what goes on, besides the settings.
struct InteractiveStatus {
  std::optional<int> hand;  ///< viewer that holds the device
  bool on_path = true;      ///< the scene's own path drives the hand
  int viewers = 0;
  std::string recording;  ///< folder; empty: none
  std::string busy;       ///< what is being done meanwhile; empty: nothing
  Motion motion = Motion::none;
  std::optional<SurfacePreview> placing;
};

/// JSON `scene`.
std::string sceneMessage(const SceneConfig& config, const BuiltScene& scene, const std::vector<SceneEntry>& scenes,
                         std::uint32_t generation);
/// JSON `state`.
std::string stateMessage(const SceneConfig& config, const InteractiveSettings& settings,
                         const InteractiveStatus& status, std::uint32_t generation);
/// JSON `notice`; line ends in the text become spaces.
std::string noticeMessage(bool error, const std::string& text);

/// JSON `saved`: a scene's file for whoever asked for it.
std::string savedMessage(const std::string& name, const std::string& text);

struct LoopFigures {
  std::uint64_t ticks = 0, missed = 0, dropped = 0;
  double delivered_energy = 0;  ///< [J]
  double server_share = 0;      ///< of one core
  std::string realtime_note;    ///< empty: all granted
};
/// JSON `stats`.
std::string statsMessage(const LoopFigures& figures, const PeriodicReport& report);

/// Binary `geometry`.
std::string geometryMessage(const World& world, std::uint32_t generation);

/// How the bodies stand after a visual step: copied by the thread that steps them, made into a message by another.
struct SceneState {
  std::uint32_t step = 0;
  Pose handle;
  std::vector<float> nodes;     ///< of all bodies, x y z [m]
  std::vector<float> stress;    ///< von Mises at the nodes [Pa]; empty: not wanted
  std::vector<float> contacts;  ///< rows of protocol::kContactColumns
};

/// Copies states out of a world; keeps what the stress needs of the meshes.
class StateReader {
 public:
  explicit StateReader(const World& world);
  /// After a step. Contact forces are those of its last part.
  void read(const World& world, bool stress, SceneState& out) const;
  /// Extra record `materials`: Lame constants of all tetrahedra.
  std::string materials(const World& world) const;

 private:
  void readStress(const World& world, std::vector<float>& out) const;
  std::vector<std::vector<double>> filled_;  // of each tetrahedron of each body: volume times filled share [m^3]
};

/// Extra record `step`: what a frame lacks for other programs: stiffness of the bodies, bodies of the contacts, contact
/// forces at the nodes.
std::string stepExtra(const World& world);

/// Binary `frame`.
/// @param nodes  whether node positions, stress and contacts are part of it
std::string frameMessage(const SceneState& state, const TickRecord& tick, std::uint32_t hand_sequence,
                         std::uint32_t generation, bool nodes);

/// Makes `samples` of a run's rows. A tick's row says what virtual coupling to the handle of the same model would give,
/// so steps must come before the ticks that use them.
class SampleEncoder {
 public:
  /// @param handle_weight  of handle and attached nodes, mass times gravity [N]: with the tool's coupling wrench it is
  ///   what the visual step alone would have the hand hold
  SampleEncoder(const LinkParameters& link, const Vec3& handle_weight, std::uint32_t generation)
      : link_(link), handle_weight_(handle_weight), generation_(generation) {}
  void add(const TickRecord& tick);
  void add(const VisualRecord& step, int substeps);
  int ticks() const { return static_cast<int>(ticks_.size()); }
  bool empty() const { return ticks_.empty() && steps_.empty(); }
  /// The batch so far, which begins anew.
  std::string take();

 private:
  struct TickRow {
    TickRecord tick;
    Vec6 coupling;
  };
  struct StepRow {
    VisualRecord step;
    int substeps;
  };
  void writeTick(const TickRow& row, double origin, ByteWriter& out) const;
  void writeStep(const StepRow& row, double origin, ByteWriter& out) const;
  struct VisualHandle {
    double time;  ///< of its model [s]
    Pose pose;
    Vec6 twist;
  };
  LinkParameters link_;
  Vec3 handle_weight_;
  std::uint32_t generation_;
  std::vector<TickRow> ticks_;
  std::vector<StepRow> steps_;
  std::deque<VisualHandle> handles_;
};

}  // namespace palpate
