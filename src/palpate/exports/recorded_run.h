#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <istream>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/math/types.h"

namespace palpate {

/// A body of a recorded run.
struct RecordedBody {
  std::string name;
  bool rigid = false;
  std::size_t first_node = 0;              ///< among the nodes of all bodies
  std::vector<float> rest;                 ///< nodes as built, x y z of each [m]
  std::vector<std::int32_t> tetrahedra;    ///< four nodes each, counted within the body
  std::vector<std::int32_t> vertex_nodes;  ///< four a vertex of the surface
  std::vector<float> vertex_weights;       ///< theirs
  std::vector<std::int32_t> triangles;     ///< three vertices each
  std::vector<float> lambda, mu;           ///< of each tetrahedron [Pa]; empty: not recorded
  std::size_t nodes() const { return rest.size() / 3; }
};

struct RecordedContact {
  std::array<float, 3> position, normal, force;  ///< [m], unit, on the first body [N]
  int state = 0;                                 ///< protocol::ContactKind
  int body = -1, other = -1;                     ///< the force is on `body`; -1: an obstacle, or not recorded
};

/// How all bodies stood at a time.
struct RecordedFrame {
  double time = 0;               ///< [s]
  std::vector<float> nodes;      ///< of all bodies, x y z of each [m]
  std::vector<float> von_mises;  ///< at the nodes [Pa]; empty: not recorded
  std::vector<float> forces;     ///< of contact at the nodes, x y z of each [N]; empty: not recorded
  std::vector<float> stiffness;  ///< factor on the moduli of each body
  std::vector<RecordedContact> contacts;
};

/// recording.palpate (docs/viewer.md), opened: its bodies, and its frames one at a time, however long it is.
class RecordedRun {
 public:
  /// @param name  for messages
  /// @throws InputError if it is no recording, damaged, or holds no frames
  RecordedRun(std::unique_ptr<std::istream> file, const std::string& name);
  /// @param run  the file, or the folder of a run
  /// @throws InputError also if there is none
  static RecordedRun open(const std::filesystem::path& run);

  const std::vector<RecordedBody>& bodies() const { return bodies_; }
  /// Index of a body. @throws InputError if none is called so, with those that there are
  std::size_t bodyNamed(const std::string& name) const;
  /// When the frames' states were reached, increasing [s].
  const std::vector<double>& times() const { return times_; }
  bool hasMaterials() const { return has_materials_; }
  /// What was recorded incompletely; empty: nothing.
  const std::string& complaint() const { return complaint_; }
  /// @throws InputError if it is damaged
  RecordedFrame frame(std::size_t index);
  /// Between two frames, all that is continuous by the share of the time that has passed; contacts of the nearer one.
  /// @param time  before the first frame: that one
  /// @throws InputError beyond the last one
  RecordedFrame at(double time);

 private:
  struct Place {
    std::streamoff frame = 0, extra = 0;  // 0: there is none
    std::uint32_t frame_bytes = 0, extra_bytes = 0;
  };
  [[noreturn]] void fail(const std::string& place, const std::string& cause) const;
  void index();
  void takeText(const std::string& payload);
  void takeGeometry(const std::string& payload);
  void takeMaterials(const std::string& payload);
  void takeFrame(std::streamoff at, std::uint32_t bytes);
  std::string payload(std::streamoff at, std::uint32_t bytes);
  void readFrame(const std::string& payload, RecordedFrame& out) const;
  void readExtra(const std::string& payload, RecordedFrame& out) const;

  std::unique_ptr<std::istream> file_;
  std::string name_, complaint_;
  std::vector<std::string> names_;
  std::vector<RecordedBody> bodies_;
  std::size_t nodes_ = 0;
  double visual_step_ = 0;
  bool has_materials_ = false;
  std::vector<double> times_;
  std::vector<Place> places_;
};

}  // namespace palpate
