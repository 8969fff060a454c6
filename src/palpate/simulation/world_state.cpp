#include "palpate/simulation/world_state.h"

#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

#include "palpate/common/error.h"

namespace palpate {
namespace {

constexpr std::uint32_t kMagic = 0x54535050;  // "PPST"
constexpr std::uint32_t kVersion = 8;

class Writer {
 public:
  std::string bytes;

  template <class T>
  void number(const T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  void numbers(const double* values, std::size_t count) {
    bytes.append(reinterpret_cast<const char*>(values), count * sizeof(double));
  }
  template <class Container>
  void size(Container& container) {
    number(static_cast<std::uint64_t>(container.size()));
  }
};

class Reader {
 public:
  explicit Reader(const std::string& bytes) : at_(bytes.data()), left_(bytes.size()) {}

  template <class T>
  void number(T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    std::memcpy(&value, take(sizeof value), sizeof value);
  }
  void numbers(double* values, std::size_t count) {
    if (count > 0) std::memcpy(values, take(count * sizeof(double)), count * sizeof(double));
  }
  template <class Container>
  void size(Container& container) {
    std::uint64_t count = 0;
    number(count);
    // each element takes a byte at least, so that a wrong count does not ask for more memory than there are bytes
    if (count > left_) throw InputError("state", "", "is cut short");
    container.resize(static_cast<decltype(container.size())>(count));
  }
  bool atEnd() const { return left_ == 0; }

 private:
  const char* take(std::size_t count) {
    if (count > left_) throw InputError("state", "", "is cut short");
    const char* from = at_;
    at_ += count;
    left_ -= count;
    return from;
  }
  const char* at_;
  std::size_t left_;
};

// One list of fields for both directions.

template <class A, class T>
requires std::is_arithmetic_v<T> || std::is_enum_v<T>
void fields(A& a, T& value) { a.number(value); }

template <class A>
void fields(A& a, bool& value) {
  auto byte = static_cast<std::uint8_t>(value);
  a.number(byte);
  value = byte != 0;
}

template <class A>
void fields(A& a, Vec3& v) {
  a.numbers(v.data(), 3);
}

template <class A>
void fields(A& a, Vec6& v) {
  a.numbers(v.data(), 6);
}

template <class A>
void fields(A& a, Mat3& m) {
  a.numbers(m.data(), 9);
}

template <class A>
void fields(A& a, VecX& v) {
  a.size(v);
  a.numbers(v.data(), static_cast<std::size_t>(v.size()));
}

template <class A, class T, std::size_t N>
void fields(A& a, std::array<T, N>& values) {
  for (T& value : values) fields(a, value);
}

template <class A, class T, class U>
void fields(A& a, std::pair<T, U>& pair) {
  fields(a, pair.first);
  fields(a, pair.second);
}

template <class A>
void fields(A& a, Pose& pose) {
  fields(a, pose.position);
  a.numbers(pose.rotation.coeffs().data(), 4);  // x y z w
}

template <class A>
void fields(A& a, HandleState& handle) {
  fields(a, handle.pose);
  fields(a, handle.twist);
}

template <class A>
void fields(A& a, ContactStatus& status) {
  fields(a, status.state);
  fields(a, status.index);
}

template <class A>
void fields(A& a, ContactPoint& point) {
  fields(a, point.body);
  fields(a, point.count);
  if (point.count < 0 || point.count > ContactPoint::kCapacity) {
    throw InputError("state", "contacts", "have a point of too many nodes");
  }
  for (int k = 0; k < point.count; ++k) {
    fields(a, point.node[k]);
    fields(a, point.weight[k]);
  }
}

template <class A>
void fields(A& a, ContactFeatures& f) {
  for (int* index : {&f.first_surface, &f.second_surface, &f.kind, &f.first, &f.second}) fields(a, *index);
}

template <class A>
void fields(A& a, Contact& c) {
  fields(a, c.key);
  fields(a, c.track);
  fields(a, c.features);
  fields(a, c.first);
  fields(a, c.second);
  for (Vec3* v : {&c.normal, &c.tangent1, &c.tangent2, &c.position}) fields(a, *v);
  for (double* d : {&c.gap, &c.follows, &c.friction, &c.end_gap, &c.thickness, &c.slack, &c.impact_time}) fields(a, *d);
  fields(a, c.patch);
  fields(a, c.partner);
}

template <class A>
void fields(A& a, ContactMemory::Force& force) {
  fields(a, force.track);
  fields(a, force.force);
  fields(a, force.status);
}

template <class A, class T>
void fields(A& a, std::vector<T>& values) {
  a.size(values);
  for (T& value : values) fields(a, value);
}

template <class A>
void fields(A& a, BodyState& body) {
  fields(a, body.positions);
  fields(a, body.velocities);
  fields(a, body.handle);
  fields(a, body.elastic.rotations);
  fields(a, body.elastic.stiffness_scale);
  fields(a, body.elastic.released);
  fields(a, body.order.chosen);
  fields(a, body.order.last_nodes);
  fields(a, body.order.sought);
  fields(a, body.order.surplus_steps);
}

template <class A>
void fields(A& a, WorldState& state) {
  fields(a, state.bodies);
  fields(a, state.contacts.forces);
  fields(a, state.contacts.loaded);
  fields(a, state.contacts.loaded_force);
  fields(a, state.contacts.near);
  fields(a, state.contacts.touched);
  fields(a, state.surfaces.may_overlap);
  fields(a, state.surfaces.tangled);
  fields(a, state.friction_scale);
  fields(a, state.device.pose);
  fields(a, state.device.twist);
  fields(a, state.aimed);
  fields(a, state.time);
  fields(a, state.halvings);
  fields(a, state.bending);
  fields(a, state.part_cost);
  fields(a, state.pulled_steps);
  fields(a, state.pulled_after);
}

// FNV-1a: a file that was damaged on its way is told from a state.
std::uint64_t checksum(const char* bytes, std::size_t count) {
  std::uint64_t sum = 0xcbf29ce484222325ULL;
  for (std::size_t i = 0; i < count; ++i) sum = (sum ^ static_cast<unsigned char>(bytes[i])) * 0x100000001b3ULL;
  return sum;
}

}  // namespace

std::string toBytes(const WorldState& state) {
  Writer writer;
  writer.number(kMagic);
  writer.number(kVersion);
  fields(writer, const_cast<WorldState&>(state));  // the writer changes nothing
  writer.number(checksum(writer.bytes.data(), writer.bytes.size()));
  return std::move(writer.bytes);
}

WorldState worldStateFrom(const std::string& bytes) {
  Reader reader(bytes);
  std::uint32_t magic = 0, version = 0;
  reader.number(magic);
  reader.number(version);
  if (magic != kMagic) throw InputError("state", "", "is not a saved state");
  if (version != kVersion) throw InputError("state", "", "is of version " + std::to_string(version));
  WorldState state;
  fields(reader, state);
  std::uint64_t sum = 0;
  reader.number(sum);
  if (!reader.atEnd()) throw InputError("state", "", "has bytes too many");
  if (sum != checksum(bytes.data(), bytes.size() - sizeof sum)) throw InputError("state", "", "is damaged");
  return state;
}

}  // namespace palpate
