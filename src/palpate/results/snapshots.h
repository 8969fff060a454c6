#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/picture/types.h"
#include "palpate/record/report.h"
#include "palpate/scene/config.h"
#include "palpate/session/run_record.h"
#include "palpate/simulation/world.h"

namespace palpate {

inline constexpr int kMostPictures = 60;  ///< of a run

/// Pictures of a run, ready to be written.
struct RunPictures {
  std::vector<Image> images;           ///< in order of time
  std::string note{};                  ///< what to see in them
  std::vector<unsigned char> sheet{};  ///< PNG of all of them, three a row; empty without pictures
};

/// Notes how the bodies of a run in lockstep stand at evenly spaced times, and draws them after it. Drawing afterwards
/// costs the run nothing but a copy of the nodes, and lets one camera see the whole motion.
class Snapshots {
 public:
  /// @param world  of the run, which must live as long as this; not stepped by another thread
  /// @param count  pictures, >= 0
  Snapshots(const SceneConfig& config, const World& world, int count);

  /// A sink that notes what it needs and passes all rows on to `sink`. This must outlive it.
  RunSink watch(RunSink sink);

  RunPictures draw();

 private:
  struct Snapshot {
    double time;              ///< [s]
    std::vector<VecX> nodes;  ///< positions, one a body [m]
    Pose device;
    Vec3 force;  ///< on the hand [N]
  };

  PictureMesh bodyMesh(int body, const Snapshot& shot) const;
  /// Obstacles but planes. A mesh that surrounds a part of the tool is cut open towards the camera.
  std::vector<PictureMesh> obstacleMeshes() const;
  bool surroundsTool(const Surface& surface) const;
  Vec3 penAxis(const Snapshot& shot) const;
  Vec3 grip(const Snapshot& shot) const;
  std::vector<Vec3> pointsToSee(const std::vector<PictureMesh>& obstacles) const;
  double strongestForce() const;
  PictureScene commonScene(double strongest, int& width);
  PictureScene sceneAt(const Snapshot& shot, const PictureScene& common) const;
  Image imageOf(const Snapshot& shot, const Bitmap& bitmap) const;

  const SceneConfig& config_;
  const World& world_;
  Vec3 looking_along_;       // unit length
  std::vector<double> due_;  // [s]
  std::vector<Snapshot> shots_;
  TickRecord last_tick_;
  std::optional<Quat> start_rotation_;  // of the device
  double pen_length_ = 0;               // [m]
  double meters_per_newton_ = 0;        // of arrows
};

}  // namespace palpate
