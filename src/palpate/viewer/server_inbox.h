#pragma once

#include <cstddef>
#include <mutex>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "palpate/viewer/viewer_queue.h"

namespace palpate {

// What other threads ask of the server's.

struct GreetingOrder {
  std::vector<std::pair<bool, Bytes>> messages;
};
struct StateOrder {
  Bytes json;
};
struct TextOrder {
  Bytes json;
  std::optional<int> viewer;
};
using Order = std::variant<GreetingOrder, StateOrder, TextOrder, ViewerFrame, ViewerSamples>;

/// Takes what other threads ask until the server's thread comes for it. Orders in the order in which they were given;
/// of frames and states only the newest, as the server may be busy.
class Inbox {
 public:
  /// @return true where the server has to be woken
  bool add(Order&& order) {
    const std::lock_guard lock(mutex_);
    if (closed_) return false;
    if (std::holds_alternative<GreetingOrder>(order)) {
      frame_.reset();
    } else if (std::holds_alternative<ViewerFrame>(order)) {
      if (replaced(frame_, order)) return false;
    } else if (std::holds_alternative<StateOrder>(order)) {
      if (replaced(state_, order)) return false;
    }
    orders_.push_back(std::move(order));
    return orders_.size() == 1;
  }

  /// Takes all; `taken` is emptied and its memory used again.
  void take(std::vector<Order>& taken) {
    taken.clear();
    const std::lock_guard lock(mutex_);
    taken.swap(orders_);
    frame_.reset();
    state_.reset();
  }

  /// Nobody takes any more.
  void close() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    orders_.clear();
  }

 private:
  /// Puts the order in the place of one of its kind that waits, or remembers the place that it will get.
  bool replaced(std::optional<std::size_t>& place, Order& order) {
    if (place) {
      orders_[*place] = std::move(order);
      return true;
    }
    place = orders_.size();
    return false;
  }

  std::mutex mutex_;
  std::vector<Order> orders_;
  std::optional<std::size_t> frame_, state_;  ///< index of the one that a newer one replaces
  bool closed_ = false;
};

}  // namespace palpate
