// A recording by hand, from its description in docs/viewer.md: a soft tetrahedron and a rigid one.
#pragma once

#include <cstdint>
#include <cstring>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "palpate/exports/recorded_run.h"

namespace palpate::test {

/// Numbers behind one another.
class Payload {
 public:
  Payload& u32(std::initializer_list<std::uint32_t> values) { return put(values); }
  Payload& i32(std::initializer_list<std::int32_t> values) { return put(values); }
  Payload& f64(double value) { return put({value}); }
  Payload& f32(const std::vector<float>& values) {
    for (const float v : values) put({v});
    return *this;
  }
  std::string bytes;

 private:
  template <class T>
  Payload& put(std::initializer_list<T> values) {
    for (const T v : values) bytes.append(reinterpret_cast<const char*>(&v), sizeof v);
    return *this;
  }
};

inline std::string record(std::uint32_t kind, const std::string& payload) {
  Payload head;
  head.u32({kind, static_cast<std::uint32_t>(payload.size())});
  return head.bytes + payload + std::string((8 - payload.size() % 8) % 8, '\0');
}

struct RecordingParts {
  std::string scene = R"({"type":"scene","bodies":[{"name":"soft one"},{"name":"stone"}]})";
  std::string state = R"({"type":"state","visual_step":0.5})";
  std::uint32_t first_corner = 0;
  bool materials = true;
};

/// Corners 0, x, y, z, a meter long.
inline std::vector<float> unitCorners() { return {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}; }
constexpr float kLambda = 2000, kMu = 1000;  // [Pa]

inline std::string geometryPayload(const RecordingParts& parts) {
  Payload g;
  g.u32({1, 7, 2, 0});
  for (const std::uint32_t flags : {1U, 2U}) {
    g.u32({4, 3, 1, 1, flags}).f32(unitCorners()).f32({0, 0, 0, 1});
    g.u32({flags == 1 ? parts.first_corner : 0, 1, 2, 3});
    g.u32({0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3});
    g.f32({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0.5F, 0.5F}).u32({0, 1, 2});
  }
  return g.bytes;
}

inline std::string framePayload(double time, const std::vector<float>& nodes, std::uint32_t contacts) {
  Payload f;
  f.u32({2, 7, 1, 0}).f64(time).f32(std::vector<float>(27, 0.0F));
  const bool stress = !nodes.empty();
  f.u32({0, static_cast<std::uint32_t>(nodes.size()), contacts, stress ? 8U : 0U}).f32(nodes);
  if (stress) f.f32({10, 20, 30, 40, 0, 0, 0, 0});
  for (std::uint32_t c = 0; c < contacts; ++c) f.f32({0, 0, 0.5F, 0, 0, 1, 0, 0, 3, 2});
  return f.bytes;
}

inline std::string extraPayload(float stiffness, std::uint32_t contacts) {
  Payload e;
  e.u32({2}).f32({stiffness, 1}).u32({contacts});
  for (std::uint32_t c = 0; c < contacts; ++c) e.i32({0, -1});
  return e.u32({1, 3}).f32({0, 0, 3}).bytes;
}

/// Nodes of both bodies, the soft one's x stretched.
inline std::vector<float> stretched(float by) {
  std::vector<float> out = unitCorners();
  out[3] *= by;
  for (const float v : unitCorners()) out.push_back(v + 5);
  return out;
}

/// Frames whose states are reached at 0.5, 1 and 2 s: as built, x stretched by 1.1, by 1.2.
inline std::string recordingBytes(const RecordingParts& parts = {}) {
  std::string out = "PALPATE1";
  out += record(0, parts.scene) + record(1, geometryPayload(parts)) + record(0, parts.state);
  if (parts.materials) {
    Payload m;
    m.u32({1, 1}).f32({kLambda, kMu}).u32({0});
    out += record(2, m.bytes);
  }
  out += record(1, framePayload(0.0, stretched(1.0F), 0)) + record(2, extraPayload(1, 0));
  out += record(1, framePayload(0.5, stretched(1.1F), 1)) + record(2, extraPayload(1, 1));
  out += record(1, framePayload(0.5, stretched(9.0F), 0));  // of the same step: does not count
  out += record(1, framePayload(1.0, {}, 0));               // without nodes: neither
  out += record(1, Payload().u32({3, 7, 0, 0, 0, 0}).f64(0).bytes);
  return out + record(1, framePayload(1.5, stretched(1.2F), 1)) + record(2, extraPayload(2, 1));
}

inline RecordedRun runOf(const std::string& bytes) { return {std::make_unique<std::istringstream>(bytes), "run"}; }

}  // namespace palpate::test
