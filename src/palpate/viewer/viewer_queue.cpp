#include "palpate/viewer/viewer_queue.h"

#include <algorithm>
#include <limits>

namespace palpate {
namespace {

// Little-endian on every machine, as all binary messages are.

unsigned lostField(const std::string& batch) {
  unsigned value = 0;
  if (batch.size() < protocol::kLostOffset + 4) return 0;
  for (std::size_t i = 0; i < 4; ++i)
    value |= static_cast<unsigned>(static_cast<unsigned char>(batch[protocol::kLostOffset + i])) << (8 * i);
  return value;
}

void setLostField(std::string& batch, unsigned value) {
  if (batch.size() < protocol::kLostOffset + 4) return;
  for (std::size_t i = 0; i < 4; ++i) batch[protocol::kLostOffset + i] = static_cast<char>((value >> (8 * i)) & 0xff);
}

unsigned saturatedSum(unsigned a, unsigned b) {
  return b > std::numeric_limits<unsigned>::max() - a ? std::numeric_limits<unsigned>::max() : a + b;
}

}  // namespace

void ViewerQueue::greet(const std::vector<std::pair<bool, Bytes>>& messages) {
  const auto waiting = std::find_if(greetings_.begin(), greetings_.end(), [](const Greeting& g) { return g.first; });
  greetings_.erase(waiting, greetings_.end());
  for (std::size_t i = 0; i < messages.size(); ++i)
    greetings_.push_back({{messages[i].first, messages[i].second}, i == 0});
  frame_.reset();
  nodes_of_.reset();
  on_the_way_.clear();  // the page does not draw frames of an older generation, so it will not acknowledge them
  samples_.clear();
  sample_bytes_ = 0;
  lost_ = 0;
}

void ViewerQueue::text(Bytes json) {
  text_bytes_ += json->size();
  texts_.push_back(std::move(json));
}

void ViewerQueue::addSamples(const ViewerSamples& samples) {
  sample_bytes_ += samples.bytes->size();
  samples_.push_back(samples);
  while (sample_bytes_ > max_sample_bytes_) {
    const ViewerSamples& oldest = samples_.front();
    lost_ = saturatedSum(lost_, saturatedSum(oldest.ticks, lostField(*oldest.bytes)));
    sample_bytes_ -= oldest.bytes->size();
    samples_.pop_front();
  }
}

void ViewerQueue::acknowledge(unsigned step) {
  // Several frames may be of one step: the last one sent is meant, so that none stays on the way forever.
  const auto newest = std::find(on_the_way_.rbegin(), on_the_way_.rend(), step);
  if (newest != on_the_way_.rend()) on_the_way_.erase(on_the_way_.begin(), newest.base());
}

std::optional<ViewerMessage> ViewerQueue::next() {
  if (welcome_) return ViewerMessage{false, std::exchange(welcome_, nullptr)};
  if (!greetings_.empty()) {
    ViewerMessage message = std::move(greetings_.front().message);
    greetings_.pop_front();
    return message;
  }
  if (state_) return ViewerMessage{false, std::exchange(state_, nullptr)};
  if (!texts_.empty()) {
    ViewerMessage message{false, std::move(texts_.front())};
    texts_.pop_front();
    text_bytes_ -= message.bytes->size();
    return message;
  }
  if (frameMayGo() && (samples_.empty() || !frame_went_last_)) return takeFrame();
  if (!samples_.empty()) return takeSamples();
  return std::nullopt;
}

ViewerMessage ViewerQueue::takeFrame() {
  ViewerFrame frame = std::move(*frame_);
  frame_.reset();
  frame_went_last_ = true;
  on_the_way_.push_back(frame.step);
  if (frame.light && nodes_of_ == frame.step) return {true, std::move(frame.light)};
  nodes_of_ = frame.step;
  return {true, std::move(frame.full)};
}

ViewerMessage ViewerQueue::takeSamples() {
  ViewerSamples samples = std::move(samples_.front());
  samples_.pop_front();
  sample_bytes_ -= samples.bytes->size();
  frame_went_last_ = false;
  if (lost_ > 0) {
    auto patched = std::make_shared<std::string>(*samples.bytes);
    setLostField(*patched, saturatedSum(lost_, lostField(*patched)));
    samples.bytes = std::move(patched);
    lost_ = 0;
  }
  return {true, std::move(samples.bytes)};
}

}  // namespace palpate
