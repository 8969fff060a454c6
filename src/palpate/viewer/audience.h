#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace palpate {

/// Bytes of a message, made once and shared by all who send it.
using Bytes = std::shared_ptr<const std::string>;

/// Whoever watches a run. Any thread may call; no call waits for a viewer.
class Audience {
 public:
  virtual ~Audience() = default;

  struct Message {
    bool binary = false;
    Bytes bytes;
  };
  /// What everybody gets now, and newcomers first: scene and geometry. Frames and samples of before are void.
  virtual void greet(std::vector<Message> messages) = 0;
  /// Newest state; newcomers get it after the greeting.
  virtual void state(Bytes json) = 0;
  virtual void text(Bytes json) = 0;
  virtual void textTo(int viewer, Bytes json) = 0;
  /// Newest frame; one that has not gone out yet is replaced.
  /// @param step  visual step that it shows
  /// @param full  with the nodes; @param light without, for whoever has the nodes of that step
  virtual void frame(std::uint32_t step, Bytes full, Bytes light) = 0;
  /// All of them go out, in order.
  virtual void samples(Bytes batch, std::uint32_t ticks) = 0;
  /// CPU time that serving has taken so far [s].
  virtual double cpuSeconds() const = 0;
};

}  // namespace palpate
