// Tasks that may run, lowest id first, with the few that the memory budget refused kept aside.
#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "base/ids.h"

namespace rilievo::engine {

/// One pass over the candidates: Begin(), then Next() in ascending id; Refuse() what was not admitted. A pass stops
/// once kMostRefused tasks wait, all lower than the rest, so it stays cheap however many there are.
class ReadyQueue {
 public:
  void Push(TaskId id) {
    heap_.push_back(id);
    std::push_heap(heap_.begin(), heap_.end(), std::greater<>());
  }

  void Begin() { cursor_ = 0; }

  /// The next candidate, taken out of the queue.
  std::optional<TaskId> Next() {
    const bool from_refused = cursor_ < refused_.size() && (heap_.empty() || refused_[cursor_] < heap_.front());
    if (from_refused) {
      const TaskId id = refused_[cursor_];
      refused_.erase(refused_.begin() + static_cast<std::ptrdiff_t>(cursor_));
      return id;
    }
    const bool below_a_refused = cursor_ < refused_.size();
    if (heap_.empty() || (!below_a_refused && refused_.size() >= kMostRefused)) return std::nullopt;
    std::pop_heap(heap_.begin(), heap_.end(), std::greater<>());
    const TaskId id = heap_.back();
    heap_.pop_back();
    return id;
  }

  /// Puts the candidate just given back; it comes again in the next pass.
  void Refuse(TaskId id) { refused_.insert(refused_.begin() + static_cast<std::ptrdiff_t>(cursor_++), id); }

  bool empty() const { return heap_.empty() && refused_.empty(); }

 private:
  static constexpr std::size_t kMostRefused = 64;
  std::vector<TaskId> heap_;     ///< min-heap
  std::vector<TaskId> refused_;  ///< ascending
  std::size_t cursor_ = 0;
};

}  // namespace rilievo::engine
