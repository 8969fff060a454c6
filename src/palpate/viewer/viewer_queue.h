#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/viewer/server.h"

namespace palpate {

/// One WebSocket message.
struct ViewerMessage {
  bool binary = false;
  Bytes bytes;
};

/// A frame in both its forms; see Server::frame().
struct ViewerFrame {
  unsigned step = 0;
  Bytes full, light;
};

/// A batch of samples.
struct ViewerSamples {
  Bytes bytes;
  unsigned ticks = 0;
};

/// What waits for one viewer, and which message goes next: `welcome`, greetings, state, texts, then frames and samples
/// in turn. Its memory is bounded whatever the viewer does. No sockets, no threads.
class ViewerQueue {
 public:
  static constexpr std::size_t kMaxSampleBytes = std::size_t{4} << 20;
  static constexpr std::size_t kMaxTextBytes = std::size_t{4} << 20;
  static constexpr std::size_t kMaxFramesOnTheWay = 3;

  explicit ViewerQueue(std::size_t max_sample_bytes = kMaxSampleBytes) : max_sample_bytes_(max_sample_bytes) {}

  void welcome(Bytes json) { welcome_ = std::move(json); }
  /// A new generation. A greeting of which a part is sent already is completed first; one that waits is forgotten.
  void greet(const std::vector<std::pair<bool, Bytes>>& messages);
  void setState(Bytes json) { state_ = std::move(json); }
  void text(Bytes json);
  void setFrame(const ViewerFrame& frame) { frame_ = frame; }
  void addSamples(const ViewerSamples& samples);

  /// The viewer has drawn a frame of this step; earlier ones it has drawn or passed over.
  void acknowledge(unsigned step);

  /// Takes the message that is to be sent now; nothing where none waits or may go.
  std::optional<ViewerMessage> next();

  /// More text waits than is sane.
  bool overflowing() const { return text_bytes_ > kMaxTextBytes; }
  std::size_t waitingSampleBytes() const { return sample_bytes_; }

 private:
  struct Greeting {
    ViewerMessage message;
    bool first = false;  ///< of its generation
  };

  bool frameMayGo() const { return frame_ && on_the_way_.size() < kMaxFramesOnTheWay; }
  ViewerMessage takeFrame();
  ViewerMessage takeSamples();

  std::size_t max_sample_bytes_;
  Bytes welcome_, state_;
  std::deque<Greeting> greetings_;
  std::deque<Bytes> texts_;
  std::size_t text_bytes_ = 0;
  std::optional<ViewerFrame> frame_;
  std::optional<unsigned> nodes_of_;  ///< step whose nodes the viewer was sent last
  std::deque<unsigned> on_the_way_;   ///< steps of frames sent and not acknowledged
  std::deque<ViewerSamples> samples_;
  std::size_t sample_bytes_ = 0;
  unsigned lost_ = 0;  ///< ticks dropped since the last batch sent
  bool frame_went_last_ = false;
};

}  // namespace palpate
