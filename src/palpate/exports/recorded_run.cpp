#include "palpate/exports/recorded_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "palpate/common/error.h"
#include "palpate/mesh/byte_reader.h"
#include "palpate/protocol/layout.h"

namespace palpate {
namespace {

using RecordingJson = nlohmann::json;

// Arrays of a message; once too few bytes are left, all is empty.
class MessageReader {
 public:
  explicit MessageReader(std::string_view data) : bytes_(data, false) {}
  template <class T>
  T one() {
    T value{};
    short_ = short_ || !bytes_.take(value);
    return short_ ? T{} : value;
  }
  template <class T>
  std::vector<T> many(std::uint64_t count) {
    std::vector<T> out;
    short_ = short_ || count > bytes_.left() / sizeof(T);
    if (short_) return out;
    out.resize(count);
    for (T& value : out) bytes_.take(value);
    return out;
  }
  void skip(std::size_t bytes) { short_ = short_ || !bytes_.skip(bytes); }
  bool isShort() const { return short_; }

 private:
  ByteReader bytes_;
  bool short_ = false;
};

bool below(const std::vector<std::int32_t>& indices, std::size_t limit) {
  return std::all_of(indices.begin(), indices.end(),
                     [&](std::int32_t i) { return i >= 0 && static_cast<std::size_t>(i) < limit; });
}
bool finite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

constexpr std::size_t kTimeAt = 16;     // bytes of a frame before its time
constexpr std::size_t kCountsAt = 136;  // and before the numbers of its values
constexpr std::uint32_t kLargestRecord = 1U << 30U;

}  // namespace

void RecordedRun::fail(const std::string& place, const std::string& cause) const {
  throw InputError(name_, place, cause);
}

RecordedRun RecordedRun::open(const std::filesystem::path& run) {
  std::error_code ignored;
  const std::filesystem::path file = std::filesystem::is_directory(run, ignored) ? run / "recording.palpate" : run;
  if (!std::filesystem::exists(file, ignored))
    throw InputError(file.string(), "", "is missing: palpate run and recordings of palpate view write it");
  if (!std::filesystem::is_regular_file(file, ignored)) throw InputError(file.string(), "", "is not a regular file");
  auto in = std::make_unique<std::ifstream>(file, std::ios::binary);
  if (!*in) throw InputError(file.string(), "", "cannot be read");
  return {std::move(in), file.string()};
}

RecordedRun::RecordedRun(std::unique_ptr<std::istream> file, const std::string& name)
    : file_(std::move(file)), name_(name) {
  index();
  if (times_.empty()) fail("", "holds no frames" + (complaint_.empty() ? "" : ": " + complaint_));
}

std::size_t RecordedRun::bodyNamed(const std::string& name) const {
  std::string known;
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    if (bodies_[i].name == name) return i;
    known += (known.empty() ? "" : ", ") + bodies_[i].name;
  }
  throw InputError("--body", "", "must be one of " + known + ", not '" + name + "'");
}

// Goes once through the file: all but the frames is read, they are noted.
void RecordedRun::index() {
  std::string magic(protocol::kRecordingMagic.size(), '\0');
  file_->read(magic.data(), static_cast<std::streamsize>(magic.size()));
  if (!*file_ || magic != protocol::kRecordingMagic) fail("", "is no recording of this version");
  file_->seekg(0, std::ios::end);
  const std::streamoff end = file_->tellg();
  auto at = static_cast<std::streamoff>(magic.size());
  while (at < end) {
    const std::string begin = payload(at, static_cast<std::uint32_t>(std::min<std::streamoff>(12, end - at)));
    MessageReader head(begin);
    const auto kind = head.one<protocol::RecordKind>();
    const auto bytes = head.one<std::uint32_t>();
    at += 8;
    if (head.isShort() || bytes > kLargestRecord || bytes > end - at) {
      complaint_ = "it ends within a record";
      return;
    }
    const auto first = head.one<std::uint32_t>();
    if (kind == protocol::RecordKind::text) {
      takeText(payload(at, bytes));
    } else if (kind == protocol::RecordKind::binary && first == static_cast<std::uint32_t>(protocol::Kind::geometry)) {
      takeGeometry(payload(at, bytes));
    } else if (kind == protocol::RecordKind::binary && first == static_cast<std::uint32_t>(protocol::Kind::frame)) {
      takeFrame(at, bytes);
    } else if (kind == protocol::RecordKind::extra &&
               first == static_cast<std::uint32_t>(protocol::ExtraKind::materials)) {
      takeMaterials(payload(at, bytes));
    } else if (kind == protocol::RecordKind::extra && !places_.empty()) {
      places_.back().extra = at;
      places_.back().extra_bytes = bytes;
    }
    constexpr auto kStep = static_cast<std::streamoff>(protocol::kRecordAlignment);
    at += (static_cast<std::streamoff>(bytes) + kStep - 1) / kStep * kStep;
  }
}

std::string RecordedRun::payload(std::streamoff at, std::uint32_t bytes) {
  std::string out(bytes, '\0');
  file_->clear();
  file_->seekg(at);
  if (!file_->read(out.data(), bytes)) fail("byte " + std::to_string(at), "cannot be read");
  return out;
}

void RecordedRun::takeText(const std::string& payload) {
  const RecordingJson json = RecordingJson::parse(payload, nullptr, false);
  if (!json.is_object() || !json.contains("type")) return;
  if (json["type"] == "scene" && json.contains("bodies") && json["bodies"].is_array()) {
    names_.clear();
    for (const RecordingJson& body : json["bodies"]) {
      const bool named = body.is_object() && body.contains("name") && body["name"].is_string();
      names_.push_back(named ? body["name"].get<std::string>() : "");
    }
  } else if (json["type"] == "state" && json.contains("visual_step") && json["visual_step"].is_number()) {
    visual_step_ = json["visual_step"].get<double>();
  }
}

void RecordedRun::takeGeometry(const std::string& payload) {
  if (!bodies_.empty()) fail("geometry", "comes twice: recordings of several scenes are not exported");
  MessageReader in(payload);
  in.skip(8);
  const auto count = in.one<std::uint32_t>();
  in.one<std::uint32_t>();  // obstacles
  for (std::uint32_t b = 0; b < count && !in.isShort(); ++b) {
    RecordedBody body;
    const auto nodes = in.one<std::uint32_t>();
    const auto vertices = in.one<std::uint32_t>();
    const auto triangles = in.one<std::uint32_t>();
    const auto tetrahedra = in.one<std::uint32_t>();
    body.rigid = (in.one<std::uint32_t>() & protocol::kRigidBody) != 0;
    body.name = b < names_.size() && !names_[b].empty() ? names_[b] : "body" + std::to_string(b + 1);
    body.first_node = nodes_;
    body.rest = in.many<float>(3ULL * nodes);
    in.many<float>(nodes);  // held
    body.tetrahedra = in.many<std::int32_t>(4ULL * tetrahedra);
    body.vertex_nodes = in.many<std::int32_t>(4ULL * vertices);
    body.vertex_weights = in.many<float>(4ULL * vertices);
    body.triangles = in.many<std::int32_t>(3ULL * triangles);
    if (!below(body.tetrahedra, nodes) || !below(body.vertex_nodes, nodes) || !below(body.triangles, vertices) ||
        !finite(body.rest) || !finite(body.vertex_weights))
      fail("body " + body.name, "is damaged");
    nodes_ += nodes;
    bodies_.push_back(std::move(body));
  }
  if (in.isShort() || bodies_.empty()) fail("geometry", "is damaged");
}

void RecordedRun::takeMaterials(const std::string& payload) {
  MessageReader in(payload);
  in.skip(4);
  for (RecordedBody& body : bodies_) {
    const auto count = in.one<std::uint32_t>();
    body.lambda = in.many<float>(count);
    body.mu = in.many<float>(count);
    if (in.isShort() || (count > 0 && 4ULL * count != body.tetrahedra.size())) fail("materials", "are damaged");
  }
  has_materials_ = true;
}

// A frame tells of the end of the step that began at its time. Several may be of one step: the first counts.
void RecordedRun::takeFrame(std::streamoff at, std::uint32_t bytes) {
  if (bodies_.empty()) fail("frame", "comes before the geometry");
  const std::string begin = payload(at, std::min<std::uint32_t>(bytes, kCountsAt + 4));
  MessageReader in(begin);
  in.skip(kTimeAt);
  const double time = in.one<double>() + visual_step_;
  in.skip(kCountsAt - kTimeAt - sizeof(double));
  const auto values = in.one<std::uint32_t>();
  if (in.isShort() || !std::isfinite(time) || (values != 0 && values != 3 * nodes_)) fail("frame", "is damaged");
  if (values == 0 || (!times_.empty() && time <= times_.back())) return;
  times_.push_back(time);
  places_.push_back({at, 0, bytes, 0});
}

RecordedFrame RecordedRun::frame(std::size_t index) {
  RecordedFrame out;
  out.time = times_.at(index);
  const Place& place = places_.at(index);
  readFrame(payload(place.frame, place.frame_bytes), out);
  if (place.extra != 0) readExtra(payload(place.extra, place.extra_bytes), out);
  if (out.stiffness.empty()) out.stiffness.assign(bodies_.size(), 1.0F);
  return out;
}

void RecordedRun::readFrame(const std::string& payload, RecordedFrame& out) const {
  MessageReader in(payload);
  in.skip(kCountsAt);
  const auto values = in.one<std::uint32_t>();
  const auto contacts = in.one<std::uint32_t>();
  const auto stresses = in.one<std::uint32_t>();
  out.nodes = in.many<float>(values);
  out.von_mises = in.many<float>(stresses);
  const std::vector<float> rows = in.many<float>(protocol::stride(protocol::kContactColumns) * contacts);
  if (in.isShort() || (stresses != 0 && stresses != nodes_) || !finite(out.nodes))
    fail(fmt::format("frame at {:g} s", out.time), "is damaged");
  for (std::size_t c = 0; c < contacts; ++c) {
    const float* row = rows.data() + protocol::stride(protocol::kContactColumns) * c;
    RecordedContact contact;
    std::copy(row, row + 3, contact.position.begin());
    std::copy(row + 3, row + 6, contact.normal.begin());
    std::copy(row + 6, row + 9, contact.force.begin());
    contact.state = row[9] >= 0 && row[9] <= 2 ? static_cast<int>(row[9]) : 0;
    out.contacts.push_back(contact);
  }
}

void RecordedRun::readExtra(const std::string& payload, RecordedFrame& out) const {
  MessageReader in(payload);
  in.skip(4);
  out.stiffness = in.many<float>(bodies_.size());
  const auto contacts = in.one<std::uint32_t>();
  const std::vector<std::int32_t> pairs = in.many<std::int32_t>(2ULL * contacts);
  const auto count = in.one<std::uint32_t>();
  const std::vector<std::int32_t> nodes = in.many<std::int32_t>(count);
  const std::vector<float> forces = in.many<float>(3ULL * count);
  if (in.isShort() || contacts != out.contacts.size() || !below(nodes, nodes_))
    fail(fmt::format("extra record at {:g} s", out.time), "is damaged");
  for (std::size_t c = 0; c < contacts; ++c) {
    out.contacts[c].body = pairs[2 * c];
    out.contacts[c].other = pairs[2 * c + 1];
  }
  out.forces.assign(3 * nodes_, 0.0F);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    for (std::size_t d = 0; d < 3; ++d) out.forces[3 * static_cast<std::size_t>(nodes[i]) + d] = forces[3 * i + d];
  }
}

RecordedFrame RecordedRun::at(double time) {
  constexpr double kSlack = 1e-9;
  if (!(time >= 0 && time <= times_.back() + kSlack))
    throw InputError("--time", "", fmt::format("must be from 0 to {:g} s, where the recording ends", times_.back()));
  const auto after = std::lower_bound(times_.begin(), times_.end(), time - kSlack);
  const auto i = static_cast<std::size_t>(after - times_.begin());
  if (i == 0 || times_[i] <= time + kSlack) return frame(i);
  const RecordedFrame a = frame(i - 1);
  RecordedFrame b = frame(i);
  const double share = (time - a.time) / (b.time - a.time);
  const auto mix = [&](const std::vector<float>& from, std::vector<float>& to) {
    for (std::size_t k = 0; k < to.size() && from.size() == to.size(); ++k)
      to[k] = static_cast<float>((1 - share) * from[k] + share * to[k]);
  };
  mix(a.nodes, b.nodes);
  mix(a.von_mises, b.von_mises);
  mix(a.forces, b.forces);
  mix(a.stiffness, b.stiffness);
  if (share < 0.5) b.contacts = a.contacts;
  b.time = time;
  return b;
}

}  // namespace palpate
